use nalgebra::Vector3;
use vt_core::math;

/// Why an edge is an edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EdgeKind {
    /// Two surfaces that fold by more than the crease angle.
    Crease,
    /// The rim of a surface.
    Boundary,
    /// Three or more surfaces meet.
    NonManifold,
    /// Drawn by the author where no fold is.
    Line,
    /// Two surfaces that fold by less than the crease angle: an edge only where it is the silhouette.
    Smooth,
}

/// A surface that leaves an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sheet {
    /// Unit vector in the surface, perpendicular to the edge, pointing into the surface.
    pub inward: Vector3<f64>,
    /// Unit normal of the polygon as wound by the author; neighbours may disagree in sign.
    pub normal: Vector3<f64>,
    /// A polygon of the surface.
    pub polygon: u32,
}

/// Sheets whose directions differ by less (about 1°) are one sheet drawn twice.
const SAME: f64 = 0.999_85;

/// Judges what the sheets at an edge make of it.
pub(super) struct Judge {
    crease: f64,
    coplanar: f64,
}

impl Judge {
    pub fn new(crease_angle: f64, coplanar_angle: f64) -> Self {
        Self { crease: math::cos(crease_angle), coplanar: math::cos(coplanar_angle) }
    }

    /// What kind of edge the sheets make, and the sheets that make it; `None` where there is no edge.
    ///
    /// The fold of two sheets is the angle between one's inward direction and the continuation of the other's;
    /// unlike the angle between normals it needs no orientation and tells a knife edge from a plane. Where more than
    /// two meet, those that continue each other in one plane only pass through: a wall standing on a floor makes
    /// the same edge whether or not the floor is cut along it, and two planes that cross make none.
    pub fn edge(&self, sheets: &[Sheet], line: bool) -> Option<(EdgeKind, Vec<Sheet>)> {
        let mut distinct = distinct(sheets);
        if distinct.len() > 2 {
            let ending = self.without_passing(&distinct);
            if !ending.is_empty() {
                distinct = ending;
            } else if !line {
                return None;
            }
        }
        let kind = match distinct[..] {
            [] => line.then_some(EdgeKind::Line),
            [_] => Some(EdgeKind::Boundary),
            [a, b] => {
                let straightness = -a.inward.dot(&b.inward);
                if straightness < self.crease {
                    Some(EdgeKind::Crease)
                } else if line {
                    Some(EdgeKind::Line)
                } else {
                    (straightness < self.coplanar).then_some(EdgeKind::Smooth)
                }
            }
            _ if self.without_passing(&distinct).is_empty() => Some(EdgeKind::Line),
            _ => Some(EdgeKind::NonManifold),
        };
        kind.map(|kind| (kind, distinct))
    }

    /// Sheets without the pairs that continue each other in one plane.
    fn without_passing(&self, distinct: &[Sheet]) -> Vec<Sheet> {
        let mut passing = vec![false; distinct.len()];
        for i in 0..distinct.len() {
            let partner = (i + 1..distinct.len()).find(|&j| {
                !passing[i] && !passing[j] && -distinct[i].inward.dot(&distinct[j].inward) >= self.coplanar
            });
            if let Some(j) = partner {
                passing[i] = true;
                passing[j] = true;
            }
        }
        distinct.iter().zip(passing).filter(|s| !s.1).map(|s| *s.0).collect()
    }
}

/// Sheets without repetitions, in order.
fn distinct(sheets: &[Sheet]) -> Vec<Sheet> {
    let mut out: Vec<Sheet> = Vec::with_capacity(sheets.len());
    for s in sheets {
        if out.iter().all(|o| o.inward.dot(&s.inward) < SAME) {
            out.push(*s);
        }
    }
    out
}

/// Whether two lists of distinct sheets leave in the same directions.
pub(super) fn alike(a: &[Sheet], b: &[Sheet]) -> bool {
    a.len() == b.len() && a.iter().all(|s| b.iter().any(|o| o.inward.dot(&s.inward) >= SAME))
}
