//! From any polygon heap to the edges a tracker can look for.
//!
//! Vertices are welded, sides of polygons that coincide or overlap along one straight line are cut into elementary
//! intervals, each interval is judged by the surfaces (*sheets*) that leave it, and neighbouring intervals judged
//! alike are joined. A triangle soup, subdivided, shuffled and unwelded, therefore gives the edges of the model it
//! came from. Orientation of the input polygons does not matter.

mod collinear;
mod sheet;
mod weld;

pub use sheet::{EdgeKind, Sheet};
pub(crate) use weld::weld;

use crate::mesh::Mesh;
use collinear::Raw;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// What counts as an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeOptions {
    /// Angle by which two surfaces deviate from a common plane at a hard edge, radians.
    pub crease_angle: f64,
    /// Angle below which two surfaces are one plane and their edge disappears, radians.
    pub coplanar_angle: f64,
    /// Welding distance as a part of the diagonal of the bounding box.
    pub weld: f64,
}

impl Default for EdgeOptions {
    /// 25°, 0.5° and 1e-5.
    fn default() -> Self {
        Self { crease_angle: 25.0_f64.to_radians(), coplanar_angle: 0.5_f64.to_radians(), weld: 1e-5 }
    }
}

/// An option outside its range, or a mesh whose sides cannot be compared in good time.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} of the edges: found {found}, expected {expected}")]
pub struct EdgeError {
    /// Field name, or what is counted.
    pub name: &'static str,
    /// Its value.
    pub found: f64,
    /// Its range.
    pub expected: &'static str,
}

/// Most faces at one side; they are compared with each other.
const MAX_SHEETS: usize = 1000;

/// One straight edge in the object frame.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Ends, metres.
    pub ends: [Point3<f64>; 2],
    /// Why it is an edge.
    pub kind: EdgeKind,
    /// Surfaces that leave it: two at creases and smooth edges, one at boundaries, none at free lines.
    pub sheets: Vec<Sheet>,
}

impl Edge {
    /// Unit vector from the first to the second end.
    #[must_use]
    pub fn direction(&self) -> Vector3<f64> {
        (self.ends[1] - self.ends[0]).normalize()
    }

    /// Length, metres.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }
}

/// What the conversion met and dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshReport {
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Different vertices after welding.
    pub welded: usize,
    /// Polygons dropped because they have no area after welding.
    pub degenerate_polygons: usize,
    /// Sides and lines dropped because their ends were welded together.
    pub degenerate_sides: usize,
    /// Edges between surfaces of one plane, dropped.
    pub coplanar: usize,
    /// Creases kept.
    pub creases: usize,
    /// Boundaries kept.
    pub boundaries: usize,
    /// Edges of three or more surfaces kept.
    pub non_manifold: usize,
    /// Lines kept.
    pub lines: usize,
    /// Smooth edges kept as silhouette candidates.
    pub smooth: usize,
}

/// Edges of a mesh: hard ones and silhouette candidates.
#[derive(Clone, Debug)]
pub struct EdgeModel {
    edges: Vec<Edge>,
    joints: Vec<[u32; 2]>,
    joint_count: usize,
    report: MeshReport,
}

impl EdgeModel {
    /// Finds the edges of a mesh.
    ///
    /// # Errors
    /// [`EdgeError`] for an option out of range, or a mesh with very many faces at one side or sides at one place.
    pub fn new(mesh: &Mesh, options: &EdgeOptions) -> Result<Self, EdgeError> {
        let half_turn = std::f64::consts::PI;
        let check = |name, found: f64, ok: bool, expected| {
            if ok { Ok(()) } else { Err(EdgeError { name, found, expected }) }
        };
        let EdgeOptions { crease_angle, coplanar_angle, weld } = *options;
        check(
            "coplanar_angle",
            coplanar_angle,
            (0.0..=crease_angle).contains(&coplanar_angle),
            "0 to crease_angle",
        )?;
        check("crease_angle", crease_angle, (0.0..half_turn).contains(&crease_angle), "0 to π, in radians")?;
        check("weld", weld, weld > 0.0 && weld < 0.1, "above 0, below 0.1")?;

        let tolerance = weld * mesh.bounds().diagonal().max(f64::MIN_POSITIVE);
        let (ids, points) = weld::weld(mesh.vertices(), tolerance);
        let mut report = MeshReport { vertices: ids.len(), welded: points.len(), ..Default::default() };
        let raw = raw_edges(mesh, &ids, &points, &mut report);
        let sheets = raw.iter().map(|r| r.sheets.len()).max().unwrap_or(0);
        check("faces at one side", sheets as f64, sheets <= MAX_SHEETS, "at most 1000")?;
        let judge = sheet::Judge::new(crease_angle, coplanar_angle);
        // Flat edges go before the costly search for collinear neighbours.
        let before = raw.len();
        let raw: Vec<Raw> = raw.into_iter().filter(|r| judge.edge(&r.sheets, r.line).is_some()).collect();
        report.coplanar = before - raw.len();
        let edges = collinear::join(&raw, &points, 2.0 * tolerance, &judge, &mut report);
        let expected = "sides in fewer than 20 million pairs that may touch";
        let edges = edges.ok_or(EdgeError { name: "sides", found: raw.len() as f64, expected })?;
        for edge in &edges {
            *match edge.kind {
                EdgeKind::Crease => &mut report.creases,
                EdgeKind::Boundary => &mut report.boundaries,
                EdgeKind::NonManifold => &mut report.non_manifold,
                EdgeKind::Line => &mut report.lines,
                EdgeKind::Smooth => &mut report.smooth,
            } += 1;
        }
        let (joints, joint_count) = joints(&edges);
        Ok(Self { edges, joints, joint_count, report })
    }

    /// All edges; their position is the edge id.
    #[must_use]
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Edges visible as lines from anywhere: all but the smooth ones.
    pub fn hard(&self) -> impl Iterator<Item = &Edge> {
        self.edges.iter().filter(|e| e.kind != EdgeKind::Smooth)
    }

    /// Ids of the places where the ends of an edge lie; edges that meet share one.
    ///
    /// # Panics
    /// Where there is no such edge.
    pub(crate) fn joints(&self, edge: usize) -> [u32; 2] {
        self.joints[edge]
    }

    /// How many different places edges end at.
    pub(crate) fn joint_count(&self) -> usize {
        self.joint_count
    }

    /// Counts.
    #[must_use]
    pub fn report(&self) -> &MeshReport {
        &self.report
    }
}

/// An id for each place where edges end, and how many there are. Ends were welded, so that equal means identical.
fn joints(edges: &[Edge]) -> (Vec<[u32; 2]>, usize) {
    let mut known: HashMap<[u64; 3], u32> = HashMap::with_capacity(2 * edges.len());
    let joints = edges.iter().map(|e| {
        e.ends.map(|p| {
            let next = known.len() as u32;
            *known.entry([p.x, p.y, p.z].map(f64::to_bits)).or_insert(next)
        })
    });
    let joints = joints.collect();
    (joints, known.len())
}

/// Sides of polygons and lines between welded vertices, those with the same ends as one.
fn raw_edges(mesh: &Mesh, ids: &[u32], points: &[Point3<f64>], report: &mut MeshReport) -> Vec<Raw> {
    let mut sides: Vec<([u32; 2], Option<Sheet>)> = Vec::new();
    let mut corners: Vec<u32> = Vec::new();
    let mut positions: Vec<Point3<f64>> = Vec::new();
    for (index, polygon) in mesh.polygons().iter().enumerate() {
        corners.clear();
        corners.extend(polygon.corners.iter().map(|&c| ids[c as usize]));
        let authored = corners.len();
        corners.dedup();
        while corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        report.degenerate_sides += authored - corners.len();
        positions.clear();
        positions.extend(corners.iter().map(|&c| points[c as usize]));
        let Some(normal) = crate::mesh::unit_normal(&positions) else {
            report.degenerate_polygons += 1;
            continue;
        };
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let along = points[b as usize] - points[a as usize];
            let Some(inward) = normal.cross(&along).try_normalize(0.0) else { continue };
            sides.push(([a.min(b), a.max(b)], Some(Sheet { inward, normal, polygon: index as u32 })));
        }
    }
    for segment in mesh.segments() {
        let [a, b] = segment.ends.map(|e| ids[e as usize]);
        if a == b {
            report.degenerate_sides += 1;
        } else {
            sides.push(([a.min(b), a.max(b)], None));
        }
    }
    sides.sort_by_key(|s| s.0);
    sides
        .chunk_by(|a, b| a.0 == b.0)
        .map(|run| Raw {
            ends: run[0].0,
            sheets: run.iter().filter_map(|s| s.1).collect(),
            line: run.iter().any(|s| s.1.is_none()),
        })
        .collect()
}

#[cfg(test)]
mod tests;
