//! Laws of motion models.

use nalgebra::{DMatrix, DefaultAllocator, Dim, OVector, U1};

use super::{block, compare, difference_jacobian};
use crate::agent::Dynamics;
use crate::least_squares::symmetric_eigen;
use crate::manifold::{Alloc, Manifold};
use crate::time::Seconds;

/// Checks `F`, `Q` and its root at `state`, for spans of time back, none, short and long.
///
/// # Panics
/// When a law is broken.
pub fn check_dynamics<S: Manifold>(model: &impl Dynamics<S>, state: &S, tolerance: f64)
where
    DefaultAllocator: Alloc<S::D>,
{
    let (n, blocks) = (state.dim(), state.blocks());
    let size = n.value();
    let exact = 1e-12_f64.max(tolerance * 1e-4);
    let one = vec![(String::new(), 1)];
    let none = Seconds(0.0);
    let stays = block(&state.local(&model.propagate(state, none)));
    compare("no time, no motion", &blocks, &one, &stays, &DMatrix::zeros(size, 1), exact);
    let (zero, identity) = (DMatrix::zeros(size, size), DMatrix::identity(size, size));
    compare("Q(0) = 0", &blocks, &blocks, &block(&model.noise(state, none)), &zero, exact);
    compare("F(0) = 1", &blocks, &blocks, &block(&model.jacobian(state, none)), &identity, tolerance);
    for dt in [-0.1, 1e-3, 0.1, 1.0] {
        let dt = Seconds(dt);
        let ahead = model.propagate(state, dt);
        let found = block(&model.jacobian(state, dt));
        let expected = difference_jacobian(size, size, 1e-3, |e| {
            let moved = state.retract(&OVector::from_fn_generic(n, U1, |k, _| e[k]));
            ahead.local(&model.propagate(&moved, dt)).iter().copied().collect()
        });
        compare(&format!("F({dt:?}) against differences"), &blocks, &blocks, &found, &expected, tolerance);
        let q = model.noise(state, dt);
        let largest = q.amax();
        assert!(q.iter().all(|v| v.is_finite()), "Q({dt:?}) is not finite: {q}");
        assert!((&q - q.transpose()).amax() <= 1e-14 * largest, "Q({dt:?}) is not symmetric: {q}");
        let lowest = symmetric_eigen(&q).0.min();
        assert!(lowest >= -1e-13 * largest, "Q({dt:?}) has the negative eigenvalue {lowest}");
        let root = model.noise_root(state, dt);
        let error = (&root * root.transpose() - &q).amax();
        assert!(error <= 1e-12 * largest, "L Lᵀ = Q({dt:?}) fails by {error}");
    }
}

/// Checks that two half steps are one step: state, `F`, and `Q` (relative to its largest entry), within `tolerance`.
///
/// # Panics
/// When they are not.
pub fn check_composition<S: Manifold>(model: &impl Dynamics<S>, state: &S, tolerance: f64)
where
    DefaultAllocator: Alloc<S::D>,
{
    let blocks = state.blocks();
    let one = vec![(String::new(), 1)];
    for dt in [-0.1, 0.01, 0.1] {
        let half = Seconds(0.5 * dt);
        let middle = model.propagate(state, half);
        let apart = block(&model.propagate(state, Seconds(dt)).local(&model.propagate(&middle, half)));
        let zero = DMatrix::zeros(apart.nrows(), 1);
        compare("two half steps reach the state of one", &blocks, &one, &apart, &zero, tolerance);
        let second = model.jacobian(&middle, half);
        let product = block(&(&second * model.jacobian(state, half)));
        let whole = block(&model.jacobian(state, Seconds(dt)));
        compare("F of two half steps", &blocks, &blocks, &product, &whole, tolerance);
        let sum = &second * model.noise(state, half) * second.transpose() + model.noise(&middle, half);
        let q = model.noise(state, Seconds(dt));
        let size = if q.amax() > 0.0 { q.amax() } else { 1.0 };
        compare(
            "Q of two half steps",
            &blocks,
            &blocks,
            &block(&(sum / size)),
            &block(&(q / size)),
            tolerance,
        );
    }
}
