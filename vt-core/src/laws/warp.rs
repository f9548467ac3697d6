//! Laws of warps.

use nalgebra::{DefaultAllocator, Dim, OVector, U1};

use super::{block, compare, difference_jacobian};
use crate::agent::{Posed, Projected, Warp};
use crate::manifold::{Alloc, Manifold};

/// Checks Jacobians against differences, and that batch and single calls agree; returns how many points could be
/// projected. A Jacobian is compared only where the whole neighbourhood of the differences can be projected.
///
/// # Panics
/// When a law is broken.
pub fn check_warp<P: Manifold, W: Warp<P>>(warp: &W, pose: &P, bodies: &[W::Body], tolerance: f64) -> usize
where
    DefaultAllocator: Alloc<P::D>,
{
    const STEP: f64 = 1e-4;
    let (n, columns) = (pose.dim(), pose.blocks());
    let rows = vec![("image x".to_string(), 1), ("image y".to_string(), 1)];
    let mut out = Projected::default();
    // Twice, for the content must be replaced.
    warp.project(pose, bodies, &mut out);
    warp.project(pose, bodies, &mut out);
    assert_eq!(
        [out.points.len(), out.jacobians.len(), out.valid.len()],
        [bodies.len(); 3],
        "number of results"
    );
    let posed = warp.at(pose);
    let mut seen = 0;
    for (k, body) in bodies.iter().enumerate() {
        let located = posed.locate(body);
        let linearized = posed.linearize(body);
        assert_eq!(
            located.is_some(),
            out.valid[k],
            "locate and project disagree on whether point {k} projects"
        );
        assert_eq!(
            linearized.is_some(),
            out.valid[k],
            "linearize and project disagree on whether point {k} projects"
        );
        let (Some(y), Some((z, j))) = (located, linearized) else { continue };
        let close = |a: &nalgebra::Point2<f64>| (a - y).amax() <= 1e-9 * (1.0 + y.coords.amax());
        assert!(close(&z) && close(&out.points[k]), "locate, linearize and project differ at point {k}");
        let found = block(&j);
        assert!(
            (block(&out.jacobians[k]) - &found).amax() <= 1e-9 * (1.0 + found.amax()),
            "Jacobians differ at {k}"
        );
        seen += 1;
        let mut border = false;
        let expected = difference_jacobian(2, n.value(), STEP, |e| {
            let moved = pose.retract(&OVector::from_fn_generic(n, U1, |k, _| e[k]));
            match warp.at(&moved).locate(body) {
                Some(at) => vec![at.x - y.x, at.y - y.y],
                None => {
                    border = true;
                    vec![0.0; 2]
                }
            }
        });
        if !border {
            compare(
                "Jacobian of the warp against differences",
                &rows,
                &columns,
                &found,
                &expected,
                tolerance,
            );
        }
    }
    seen
}
