//! VRML97 geometry nodes to polygons and lines.

use super::MAX_ELEMENTS;
use super::primitives::{Solid, cuboid, frustum, sphere};
use super::vrml::{Fields, axis_angle};
use crate::mesh::{MeshData, Polygon, Segment, unit_normal};
use nalgebra::{Affine3, Matrix3, Point3, Vector3};
use std::ops::Range;
use vt_core::math;

/// Points, polygons with what they have per corner, and lines of one geometry node.
#[derive(Default)]
pub(super) struct Geometry {
    /// Points, polygons, lines and attributes that were read.
    pub elements: usize,
    solid: Solid,
    texcoords: Vec<Option<Vec<[f32; 2]>>>,
    colours: Vec<Option<Vec<[f32; 3]>>>,
    normals: Vec<Option<Vec<[f32; 3]>>>,
    lines: Vec<[u32; 2]>,
}

/// What was found and what was expected.
type Mismatch = (String, String);

impl Geometry {
    /// Reads a geometry node; `None` for nodes without surface or lines (text, points).
    pub fn read(node: Fields) -> Result<Option<Self>, Mismatch> {
        let solid = match node.type_name().as_str() {
            "Box" => cuboid(node.vector("size").unwrap_or_else(|| Vector3::repeat(2.0))),
            "Sphere" => sphere(node.number("radius").unwrap_or(1.0)),
            "Cylinder" => {
                let (r, h) = (node.number("radius").unwrap_or(1.0), node.number("height").unwrap_or(2.0));
                let shown = |name| node.flag(name).unwrap_or(true);
                frustum(r, r, h, [shown("bottom"), shown("top")], shown("side"))
            }
            "Cone" => {
                let (r, h) =
                    (node.number("bottomRadius").unwrap_or(1.0), node.number("height").unwrap_or(2.0));
                let shown = |name| node.flag(name).unwrap_or(true);
                frustum(r, 0.0, h, [shown("bottom"), false], shown("side"))
            }
            "ElevationGrid" => return elevation_grid(node).map(Some),
            "Extrusion" => extrusion(node)?,
            "IndexedFaceSet" => return faces(node).map(Some),
            "IndexedLineSet" => return lines(node).map(Some),
            _ => return Ok(None),
        };
        Ok(Some(Self { elements: solid.points.len() + solid.polygons.len(), solid, ..Self::default() }))
    }

    /// Gives faces without texture coordinates those of the standard (6.23): the longest side of the bounding box
    /// is s from 0 to 1, the second longest t in the same scale.
    pub fn map_texture(&mut self) {
        let points = &self.solid.points;
        let Some(first) = points.first() else { return };
        let (low, high) = points.iter().fold((*first, *first), |(l, h), p| (l.inf(p), h.sup(p)));
        let size = high - low;
        let mut axes = [0, 1, 2];
        // The sort is stable: of equal sides x comes before y before z, as the standard wants.
        axes.sort_by(|&a, &b| size[b].total_cmp(&size[a]));
        let scale = if size[axes[0]] > 0.0 { 1.0 / size[axes[0]] } else { 0.0 };
        let at = |c: &u32| [axes[0], axes[1]].map(|k| ((points[*c as usize][k] - low[k]) * scale) as f32);
        self.texcoords.resize(self.solid.polygons.len(), None);
        for (texcoords, corners) in self.texcoords.iter_mut().zip(&self.solid.polygons) {
            texcoords.get_or_insert_with(|| corners.iter().map(at).collect());
        }
    }

    /// Applies a map to all texture coordinates.
    pub fn transform_texture(&mut self, map: impl Fn([f32; 2]) -> [f32; 2]) {
        self.texcoords.iter_mut().flatten().flatten().for_each(|t| *t = map(*t));
    }

    /// Adds the geometry to a mesh under construction.
    pub fn append(
        self,
        data: &mut MeshData,
        object_from_node: &Affine3<f64>,
        material: Option<u32>,
        part: u32,
    ) {
        let base = data.vertices.len() as u32;
        data.vertices.extend(self.solid.points.iter().map(|p| object_from_node * p));
        let linear = object_from_node.matrix().fixed_view::<3, 3>(0, 0).into_owned();
        // Normals go by the inverse transpose; without one the transform is flat and so is the shading.
        let turn = linear.try_inverse().map_or(linear, |i| i.transpose());
        let turned = |n: [f32; 3]| {
            let n = turn * Vector3::from(n.map(f64::from));
            n.try_normalize(0.0).unwrap_or_else(Vector3::zeros).cast::<f32>().into()
        };
        let mut texcoords = self.texcoords.into_iter();
        let mut colours = self.colours.into_iter();
        let mut normals = self.normals.into_iter();
        data.polygons.extend(self.solid.polygons.into_iter().map(|mut corners| {
            corners.iter_mut().for_each(|c| *c += base);
            Polygon {
                corners,
                texcoords: texcoords.next().flatten(),
                colours: colours.next().flatten(),
                normals: normals.next().flatten().map(|n: Vec<_>| n.into_iter().map(turned).collect()),
                material,
                part,
                name: None,
            }
        }));
        let lines = self.lines.iter().map(|l| Segment { ends: l.map(|e| e + base), material, part });
        data.segments.extend(lines);
    }
}

fn points(node: Fields) -> Vec<Point3<f64>> {
    let flat = node.child("coord").map(|c| c.floats("point")).unwrap_or_default();
    flat.chunks_exact(3).map(|c| Point3::new(c[0], c[1], c[2])).collect()
}

fn vertex(index: i32, limit: usize, what: &str) -> Result<u32, Mismatch> {
    u32::try_from(index)
        .ok()
        .filter(|&i| (i as usize) < limit)
        .ok_or_else(|| (format!("{what} {index}"), format!("-1 or an index below {limit}")))
}

/// A list of values that faces refer to per corner or per face (6.23): colours, normals, texture coordinates.
struct Attribute<'a, const N: usize> {
    values: Vec<[f32; N]>,
    name: &'static str,
    indices: &'a [i32],
    per_vertex: bool,
}

impl<'a, const N: usize> Attribute<'a, N> {
    fn new(node: Fields<'a>, field: &str, list: &str, name: &'static str, switch: Option<&str>) -> Self {
        let flat = node.child(field).map(|c| c.floats(list)).unwrap_or_default();
        let values = flat.chunks_exact(N).map(|c| std::array::from_fn(|k| c[k] as f32)).collect();
        let per_vertex = switch.and_then(|s| node.flag(s)).unwrap_or(true);
        Self { values, name, indices: node.integers(name), per_vertex }
    }

    fn value(&self, index: i32) -> Result<[f32; N], Mismatch> {
        Ok(self.values[vertex(index, self.values.len(), self.name)? as usize])
    }

    /// Values of a face: `face` is its number, `range` where its corners stand in `coord`.
    fn of(&self, face: usize, coord: &[i32], range: Range<usize>) -> Result<Option<Vec<[f32; N]>>, Mismatch> {
        if self.values.is_empty() {
            return Ok(None);
        }
        if !self.per_vertex {
            let index =
                if self.indices.is_empty() { Some(face as i32) } else { self.indices.get(face).copied() };
            let index = index.ok_or_else(|| self.short(face + 1))?;
            return Ok(Some(vec![self.value(index)?; range.len()]));
        }
        // An empty list means: as coordIndex.
        let list = if self.indices.is_empty() { coord } else { self.indices };
        let run = list.get(range.clone()).ok_or_else(|| self.short(range.end))?;
        run.iter().map(|&i| self.value(i)).collect::<Result<_, _>>().map(Some)
    }

    fn short(&self, needed: usize) -> Mismatch {
        (format!("{} entries in {}", self.indices.len(), self.name), format!("at least {needed}"))
    }
}

fn faces(node: Fields) -> Result<Geometry, Mismatch> {
    let points = points(node);
    let indices = node.integers("coordIndex");
    let texture = Attribute::<2>::new(node, "texCoord", "point", "texCoordIndex", None);
    let colour = Attribute::<3>::new(node, "color", "color", "colorIndex", Some("colorPerVertex"));
    let normal = Attribute::<3>::new(node, "normal", "vector", "normalIndex", Some("normalPerVertex"));
    let clockwise = node.flag("ccw") == Some(false);
    let attributes = texture.values.len() + colour.values.len() + normal.values.len();
    let mut out = Geometry { elements: points.len() + indices.len() + attributes, ..Geometry::default() };
    let (mut at, mut face) = (0, 0);
    for run in indices.split(|&i| i < 0) {
        let range = at..at + run.len();
        at += run.len() + 1;
        if run.is_empty() {
            continue;
        }
        if run.len() < 3 {
            return Err((format!("a face of {} corners in coordIndex", run.len()), "at least 3".into()));
        }
        let mut corners = Vec::with_capacity(run.len());
        for &i in run {
            corners.push(vertex(i, points.len(), "coordIndex")?);
        }
        let mut texcoords = texture.of(face, indices, range.clone())?;
        let mut colours = colour.of(face, indices, range.clone())?;
        // Exporters do write one normal for all; shading is no reason to refuse a shape.
        let mut normals = normal.of(face, indices, range).unwrap_or_default();
        if clockwise {
            corners.reverse();
            texcoords.iter_mut().for_each(|t| t.reverse());
            colours.iter_mut().for_each(|t| t.reverse());
            normals.iter_mut().for_each(|t| t.reverse());
        }
        out.solid.polygons.push(corners);
        out.texcoords.push(texcoords);
        out.colours.push(colours);
        out.normals.push(normals);
        face += 1;
    }
    out.solid.points = points;
    if let Some(angle) = node.number("creaseAngle").filter(|a| *a > 0.0 && normal.values.is_empty()) {
        out.normals = crease_normals(&out.solid, angle);
    }
    Ok(out)
}

/// Normals per corner, averaged over the faces at the vertex that turn from this one by less than the crease angle.
fn crease_normals(solid: &Solid, angle: f64) -> Vec<Option<Vec<[f32; 3]>>> {
    let face_normals: Vec<Option<Vector3<f64>>> = solid
        .polygons
        .iter()
        .map(|corners| unit_normal(&corners.iter().map(|&c| solid.points[c as usize]).collect::<Vec<_>>()))
        .collect();
    let mut at_vertex: Vec<Vec<u32>> = vec![Vec::new(); solid.points.len()];
    for (face, corners) in solid.polygons.iter().enumerate() {
        corners.iter().for_each(|&c| at_vertex[c as usize].push(face as u32));
    }
    let least = math::cos(angle.min(std::f64::consts::PI));
    let smooth = |own: &Vector3<f64>, corner: u32| -> [f32; 3] {
        let near = at_vertex[corner as usize].iter().filter_map(|&f| face_normals[f as usize]);
        let sum: Vector3<f64> = near.take(MAX_FACES_AT_VERTEX).filter(|n| n.dot(own) >= least).sum();
        sum.try_normalize(1e-9).unwrap_or(*own).cast::<f32>().into()
    };
    let faces = solid.polygons.iter().zip(&face_normals);
    faces.map(|(corners, own)| own.map(|own| corners.iter().map(|&c| smooth(&own, c)).collect())).collect()
}

/// Faces at a vertex that its normal takes into account: more are a fan or an attack.
const MAX_FACES_AT_VERTEX: usize = 1000;

/// Polylines; a polyline of one point, which modellers do write, draws nothing.
fn lines(node: Fields) -> Result<Geometry, Mismatch> {
    let points = points(node);
    let indices = node.integers("coordIndex");
    let mut out = Geometry { elements: points.len() + indices.len(), ..Geometry::default() };
    for run in indices.split(|&i| i < 0) {
        for pair in run.windows(2) {
            let end = |i| vertex(i, points.len(), "coordIndex");
            out.lines.push([end(pair[0])?, end(pair[1])?]);
        }
    }
    out.solid.points = points;
    Ok(out)
}

/// Height field over the xz plane (6.17), one quadrilateral per cell; colours per vertex or cell, texture
/// coordinates as given or over the whole field.
fn elevation_grid(node: Fields) -> Result<Geometry, Mismatch> {
    let size = |name| node.integer(name).and_then(|n| u32::try_from(n).ok()).unwrap_or(0);
    let (nx, nz) = (size("xDimension"), size("zDimension"));
    let (dx, dz) = (node.number("xSpacing").unwrap_or(1.0), node.number("zSpacing").unwrap_or(1.0));
    let height = node.floats("height");
    if height.len() as u64 != u64::from(nx) * u64::from(nz) {
        return Err((format!("{} heights", height.len()), format!("{nx} x {nz} of them")));
    }
    let points = height.iter().enumerate().map(|(i, &y)| {
        let (x, z) = (i as u32 % nx, i as u32 / nx);
        Point3::new(dx * f64::from(x), y, dz * f64::from(z))
    });
    let solid = Solid { points: points.collect(), polygons: vec![] };
    let texture = Attribute::<2>::new(node, "texCoord", "point", "texCoord", None);
    let colour = Attribute::<3>::new(node, "color", "color", "color", Some("colorPerVertex"));
    let elements = 2 * height.len() + texture.values.len() + colour.values.len();
    let mut out = Geometry { elements, solid, ..Geometry::default() };
    for z in 1..nz {
        for x in 1..nx {
            let at = |x: u32, z: u32| z * nx + x;
            let corners = [at(x - 1, z - 1), at(x - 1, z), at(x, z), at(x, z - 1)];
            let as_indices = corners.map(|c| c as i32);
            let cell = ((z - 1) * (nx - 1) + x - 1) as usize;
            let texcoords = match texture.of(cell, &as_indices, 0..4)? {
                Some(given) => given,
                None => {
                    let share = |c: u32, n: u32| c as f32 / (n - 1) as f32;
                    corners.iter().map(|c| [share(c % nx, nx), share(c / nx, nz)]).collect()
                }
            };
            out.texcoords.push(Some(texcoords));
            out.colours.push(colour.of(cell, &as_indices, 0..4)?);
            out.solid.polygons.push(corners.to_vec());
        }
    }
    Ok(out)
}

/// Cross-section swept along a spine (6.18); the spine-aligned plane of a straight spine is turned least from y.
fn extrusion(node: Fields) -> Result<Solid, Mismatch> {
    let spine: Vec<Vector3<f64>> =
        node.floats("spine").chunks_exact(3).map(|c| Vector3::new(c[0], c[1], c[2])).collect();
    let section: Vec<[f64; 2]> = node.floats("crossSection").chunks_exact(2).map(|c| [c[0], c[1]]).collect();
    if spine.len() < 2 || section.len() < 2 {
        let found = format!("a spine of {} and a cross-section of {} points", spine.len(), section.len());
        return Err((found, "at least 2 each".into()));
    }
    if spine.len().saturating_mul(section.len()) > MAX_ELEMENTS {
        let found = format!("a spine of {} and a cross-section of {} points", spine.len(), section.len());
        return Err((found, format!("at most {MAX_ELEMENTS} points in all")));
    }
    let scale = node.floats("scale");
    let turns = node.floats("orientation");
    let frames = spine_frames(&spine);
    let m = section.len();
    let mut solid = Solid::default();
    for (i, (origin, frame)) in spine.iter().zip(&frames).enumerate() {
        // One value serves the whole spine, else one per spine point.
        let pick = |list: &[f64], n: usize| -> Option<Vec<f64>> {
            let k = if list.len() <= n { 0 } else { i * n };
            list.get(k..k + n).map(<[f64]>::to_vec)
        };
        let s = pick(&scale, 2).unwrap_or_else(|| vec![1.0; 2]);
        let turn =
            pick(&turns, 4).map_or_else(Matrix3::identity, |r| *axis_angle(r[0], r[1], r[2], r[3]).matrix());
        for p in &section {
            let local = turn * Vector3::new(p[0] * s[0], 0.0, p[1] * s[1]);
            solid.points.push(Point3::from(origin + frame * local));
        }
    }
    for i in 1..spine.len() {
        for j in 1..m {
            let at = |i: usize, j: usize| (i * m + j) as u32;
            solid.polygons.push(vec![at(i - 1, j - 1), at(i - 1, j), at(i, j), at(i, j - 1)]);
        }
    }
    let closed = section[0] == section[m - 1];
    let cap = (if closed { m - 1 } else { m }) as u32;
    if cap >= 3 && node.flag("beginCap").unwrap_or(true) {
        solid.polygons.push((0..cap).rev().collect());
    }
    if cap >= 3 && node.flag("endCap").unwrap_or(true) {
        let base = ((spine.len() - 1) * m) as u32;
        solid.polygons.push((base..base + cap).collect());
    }
    Ok(solid)
}

/// Columns x, y, z of the spine-aligned cross-section plane at each spine point.
fn spine_frames(spine: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
    let n = spine.len();
    let closed = (spine[0] - spine[n - 1]).norm() == 0.0;
    let around = |i: usize| match i {
        0 if closed => (spine[n - 2], spine[1]),
        0 => (spine[0], spine[1]),
        _ if i == n - 1 && closed => (spine[n - 2], spine[1]),
        _ if i == n - 1 => (spine[n - 2], spine[n - 1]),
        _ => (spine[i - 1], spine[i + 1]),
    };
    let mut y: Vec<Option<Vector3<f64>>> = Vec::with_capacity(n);
    let mut z: Vec<Option<Vector3<f64>>> = Vec::with_capacity(n);
    for i in 0..n {
        let (before, after) = around(i);
        y.push((after - before).try_normalize(1e-12));
        z.push((after - spine[i]).cross(&(before - spine[i])).try_normalize(1e-12));
    }
    let first_y = y.iter().flatten().next().copied().unwrap_or_else(Vector3::y);
    let straight = nalgebra::Rotation3::rotation_between(&Vector3::y(), &first_y)
        .unwrap_or_else(|| axis_angle(1.0, 0.0, 0.0, std::f64::consts::PI));
    let mut last_z = z.iter().flatten().next().copied().unwrap_or_else(|| straight * Vector3::z());
    let mut last_y = first_y;
    let frames = (0..n).map(|i| {
        last_y = y[i].unwrap_or(last_y);
        let mut here = z[i].unwrap_or(last_z);
        if here.dot(&last_z) < 0.0 {
            here = -here;
        }
        last_z = here;
        let x = last_y.cross(&here).try_normalize(1e-12).unwrap_or_else(Vector3::x);
        Matrix3::from_columns(&[x, last_y, x.cross(&last_y)])
    });
    frames.collect()
}
