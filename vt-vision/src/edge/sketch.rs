//! Picture of what the edge modality looked for and found.

use nalgebra::{DefaultAllocator, Point2, Point3};
use vt_core::agent::{Posed, Warp};
use vt_core::manifold::{Alloc, Manifold};
use vt_core::sketch::{Mark, Role};

use super::mixture::EdgeMixture;

/// Appends the contour at `pose` and, for every line, the matched edge with the normal that leads to it.
pub(super) fn draw<P: Manifold, W: Warp<P, Body = Point3<f64>>>(
    mixture: &EdgeMixture<P, W>,
    pose: &P,
    out: &mut Vec<Mark>,
) where
    DefaultAllocator: Alloc<P::D>,
{
    let posed = mixture.warp.at(pose);
    let mut before: Option<(u32, Point2<f64>)> = None;
    for line in &mixture.lines {
        let Some(y) = posed.locate(&line.point) else {
            before = None;
            continue;
        };
        if let Some((edge, from)) = before
            && edge == line.edge
        {
            out.push(Mark::Segment { from: from.into(), to: y.into(), role: Role::Model });
        }
        before = Some((line.edge, y));
        let u = line.normal.dot(&y.coords);
        match mixture.vote(line, u, mixture.sigma).best {
            Some((k, p)) => {
                let m = y + line.normal * (mixture.edges[line.first as usize + k].position - u);
                let role = if p > 0.5 { Role::Inlier } else { Role::Outlier };
                out.push(Mark::Segment { from: y.into(), to: m.into(), role });
                out.push(Mark::Point { at: m.into(), role });
            }
            None => out.push(Mark::Point { at: y.into(), role: Role::Missing }),
        }
    }
}
