//! Poses on their way through the search, and which of them are worth more work.

use vt_core::lie::SE3;

use super::alignment::Support;
use super::views::Views;

/// A pose on its way through the search.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// The pose camera_from_object.
    pub pose: SE3,
    /// How far the picture speaks for it.
    pub support: Support,
    /// Size at which it was found, pixels.
    pub size: f64,
    /// Indices of the size and view that it was found with.
    pub view: Option<(usize, usize)>,
}

impl Candidate {
    /// The same elsewhere.
    pub fn at(&self, pose: SE3) -> Self {
        Self { pose, ..*self }
    }
}

/// The `most` candidates that rank first, in order, of which no two are the same pose; sorts all of them.
/// `coarseness` scales what counts as the same.
pub fn distinct(all: &mut [Candidate], most: usize, coarseness: f64, views: &Views) -> Vec<Candidate> {
    all.sort_by(|a, b| b.support.rank().total_cmp(&a.support.rank()));
    let mut kept: Vec<Candidate> = vec![];
    for c in all {
        if kept.len() >= most {
            break;
        }
        if !kept.iter().any(|k| same(&k.pose, &c.pose, coarseness, views)) {
            kept.push(*c);
        }
    }
    kept
}

/// True for poses that differ by less than `coarseness` times 5° in rotation, 5 % of the size across and 5 % of the
/// distance.
fn same(a: &SE3, b: &SE3, coarseness: f64, views: &Views) -> bool {
    let (p, q) = (a.act(&views.center), b.act(&views.center));
    let limit = 0.05 * coarseness;
    (p.z / q.z - 1.0).abs() < limit
        && (p.coords.normalize() * q.coords.norm() - q.coords).norm() < limit * views.diameter
        && a.rotation.angle_to(&b.rotation) < 0.087 * coarseness
}
