//! VRML97 geometry nodes to polygons and lines.

use super::primitives::{Solid, cuboid, frustum, sphere};
use super::vrml::{Fields, axis_angle};
use crate::mesh::{MeshData, Polygon, Segment};
use nalgebra::{Matrix3, Point3, Vector3};

/// Points, polygons with optional texture coordinates, and lines of one geometry node.
#[derive(Default)]
pub(super) struct Geometry {
    solid: Solid,
    texcoords: Vec<Option<Vec<[f32; 2]>>>,
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
            "ElevationGrid" => elevation_grid(node)?,
            "Extrusion" => extrusion(node)?,
            "IndexedFaceSet" => return faces(node).map(Some),
            "IndexedLineSet" => return lines(node).map(Some),
            _ => return Ok(None),
        };
        Ok(Some(Self { solid, ..Self::default() }))
    }

    /// Adds the geometry to a mesh under construction.
    pub fn append(
        self,
        data: &mut MeshData,
        frame: impl Fn(&Point3<f64>) -> Point3<f64>,
        material: Option<u32>,
        part: u32,
    ) {
        let base = data.vertices.len() as u32;
        data.vertices.extend(self.solid.points.iter().map(frame));
        let mut texcoords = self.texcoords.into_iter();
        data.polygons.extend(self.solid.polygons.into_iter().map(|mut corners| {
            corners.iter_mut().for_each(|c| *c += base);
            Polygon { corners, texcoords: texcoords.next().flatten(), material, part, name: None }
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

fn faces(node: Fields) -> Result<Geometry, Mismatch> {
    let points = points(node);
    let indices = node.integers("coordIndex");
    let flat = node.child("texCoord").map(|t| t.floats("point")).unwrap_or_default();
    let texture: Vec<[f32; 2]> = flat.chunks_exact(2).map(|c| [c[0] as f32, c[1] as f32]).collect();
    // An empty texCoordIndex means: as coordIndex.
    let texture_indices = Some(node.integers("texCoordIndex")).filter(|t| !t.is_empty()).unwrap_or(indices);
    let clockwise = node.flag("ccw") == Some(false);
    let mut out = Geometry::default();
    let mut at = 0;
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
        let mut texcoords = None;
        if !texture.is_empty() {
            let run = texture_indices.get(range).ok_or_else(|| {
                (
                    format!("{} texCoordIndex entries", texture_indices.len()),
                    format!("as many as coordIndex, {}", indices.len()),
                )
            })?;
            let mut list = Vec::with_capacity(run.len());
            for &i in run {
                list.push(texture[vertex(i, texture.len(), "texCoordIndex")? as usize]);
            }
            texcoords = Some(list);
        }
        if clockwise {
            corners.reverse();
            texcoords.iter_mut().for_each(|t| t.reverse());
        }
        out.solid.polygons.push(corners);
        out.texcoords.push(texcoords);
    }
    out.solid.points = points;
    Ok(out)
}

/// Polylines; a polyline of one point, which modellers do write, draws nothing.
fn lines(node: Fields) -> Result<Geometry, Mismatch> {
    let points = points(node);
    let mut out = Geometry::default();
    for run in node.integers("coordIndex").split(|&i| i < 0) {
        for pair in run.windows(2) {
            let end = |i| vertex(i, points.len(), "coordIndex");
            out.lines.push([end(pair[0])?, end(pair[1])?]);
        }
    }
    out.solid.points = points;
    Ok(out)
}

/// Height field over the xz plane (6.17), one quadrilateral per cell.
fn elevation_grid(node: Fields) -> Result<Solid, Mismatch> {
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
    let points = points.collect();
    let mut polygons = Vec::new();
    for z in 1..nz {
        for x in 1..nx {
            let at = |x: u32, z: u32| z * nx + x;
            polygons.push(vec![at(x - 1, z - 1), at(x - 1, z), at(x, z), at(x, z - 1)]);
        }
    }
    Ok(Solid { points, polygons })
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
