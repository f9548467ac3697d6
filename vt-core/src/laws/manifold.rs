//! Laws of manifolds.

use nalgebra::{DefaultAllocator, Dim, OVector, U1};

use super::{SCALES, block, compare, difference_jacobian};
use crate::manifold::{Alloc, Manifold, Tangent};
use crate::random::{Random, Stream};

/// A tangent vector with coordinates in `[-1, 1]`.
pub fn tangent<D: Dim>(dim: D, random: &mut Random) -> OVector<f64, D>
where
    DefaultAllocator: Alloc<D>,
{
    OVector::from_fn_generic(dim, U1, |_, _| 2.0 * random.uniform() - 1.0)
}

/// Checks all laws at `x`, with tangent vectors of all [`SCALES`] drawn from `seed`.
///
/// # Panics
/// When a law is broken.
pub fn check_manifold<M: Manifold>(x: &M, seed: u64, tolerance: f64)
where
    DefaultAllocator: Alloc<M::D>,
{
    let (n, blocks) = (x.dim(), x.blocks());
    let size = n.value();
    let vector = |e: &[f64]| OVector::from_fn_generic(n, U1, |k, _| e[k]);
    let list = |d: Tangent<M>| d.iter().copied().collect::<Vec<f64>>();
    let column = |d: &Tangent<M>| block(d);
    let one = vec![(String::new(), 1)];
    assert!(x.is_finite(), "a point of the strategy is not finite");
    let mut random = Random::new(seed, Stream::Sim, 0, 0, 0);
    let direction = tangent(n, &mut random);
    let exact = 1e-12_f64.max(tolerance * 1e-4);
    for scale in SCALES {
        let d = &direction * scale;
        let y = x.retract(&d);
        compare("x.local(x.retract(d)) = d", &blocks, &one, &column(&x.local(&y)), &column(&d), exact);
        let back = x.retract(&x.local(&y));
        compare(
            "x.retract(x.local(y)) = y",
            &blocks,
            &one,
            &column(&y.local(&back)),
            &column(&x.zero()),
            exact,
        );
        let found = block(&x.retract_jacobian(&d));
        let expected =
            difference_jacobian(size, size, 1e-3, |e| list(y.local(&x.retract(&(&d + vector(e))))));
        compare("retract_jacobian against differences", &blocks, &blocks, &found, &expected, tolerance);
        let found = block(&x.transport(&d));
        let expected =
            difference_jacobian(size, size, 1e-3, |e| list(y.local(&x.retract(&vector(e)).retract(&d))));
        compare("transport against differences", &blocks, &blocks, &found, &expected, tolerance);
    }
}
