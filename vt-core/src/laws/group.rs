//! Laws of Lie groups.

use nalgebra::{DMatrix, DefaultAllocator, Dim, OVector, Point2, Point3, RealField, SVector, U1};
use proptest::prelude::any;
use proptest::strategy::Strategy;

use super::{Dual64, SCALES, block, compare, difference_jacobian, dual_jacobian, tangent};
use crate::lie::LieGroup;
use crate::manifold::{Alloc, Manifold};
use crate::random::{Random, Stream};

/// Points that a group acts on, for the laws.
pub trait Sample {
    /// A point with coordinates in `[-1, 1]`.
    fn sample(random: &mut Random) -> Self;
    /// Its coordinates.
    fn components(&self) -> Vec<f64>;
}

impl<const N: usize> Sample for SVector<f64, N> {
    fn sample(random: &mut Random) -> Self {
        Self::from_fn(|_, _| 2.0 * random.uniform() - 1.0)
    }
    fn components(&self) -> Vec<f64> {
        self.iter().copied().collect()
    }
}

impl Sample for Point2<f64> {
    fn sample(random: &mut Random) -> Self {
        SVector::<f64, 2>::sample(random).into()
    }
    fn components(&self) -> Vec<f64> {
        self.coords.components()
    }
}

impl Sample for Point3<f64> {
    fn sample(random: &mut Random) -> Self {
        SVector::<f64, 3>::sample(random).into()
    }
    fn components(&self) -> Vec<f64> {
        self.coords.components()
    }
}

impl<A: Sample, B: Sample> Sample for (A, B) {
    fn sample(random: &mut Random) -> Self {
        (A::sample(random), B::sample(random))
    }
    fn components(&self) -> Vec<f64> {
        [self.0.components(), self.1.components()].concat()
    }
}

/// A strategy of group elements `Exp(d)` with coordinates of `d` in `[-size, size]`: one in eight is the identity, one
/// in eight within 1e-8 of it.
pub fn group<G>(size: f64) -> impl Strategy<Value = G>
where
    G: LieGroup + Manifold<D = <G as LieGroup>::Dim>,
    DefaultAllocator: Alloc<<G as LieGroup>::Dim>,
{
    any::<u64>().prop_map(move |seed| {
        let mut random = Random::new(seed, Stream::Sim, 1, 0, 0);
        let scale = match random.index(8) {
            0 => 0.0,
            1 => 1e-8,
            _ => 1.0,
        };
        G::exp(&(tangent(G::identity().dim(), &mut random) * (size * scale)))
    })
}

/// A vector over another scalar.
pub fn lift<T: RealField + Copy, D: Dim>(d: &OVector<f64, D>) -> OVector<T, D>
where
    DefaultAllocator: Alloc<D>,
{
    OVector::from_fn_generic(d.shape_generic().0, U1, |k, _| nalgebra::convert(d[k]))
}

/// What defines each Jacobian, as a function of a small `e` whose derivative at zero it is.
#[derive(Clone, Copy, Debug)]
enum Definition {
    Left,
    LeftInverse,
    Right,
    RightInverse,
    Adjoint,
}

impl Definition {
    const ALL: [Self; 5] = [Self::Left, Self::LeftInverse, Self::Right, Self::RightInverse, Self::Adjoint];

    /// Runs the definition over any scalar: `f64` for differences, dual numbers for exact derivatives.
    fn evaluate<T: RealField + Copy, G: LieGroup<T>>(
        self,
        d: &OVector<T, G::Dim>,
        e: &OVector<T, G::Dim>,
    ) -> Vec<T>
    where
        DefaultAllocator: Alloc<G::Dim>,
    {
        let x = G::exp(d);
        let value = match self {
            Self::Left => G::exp(&(d + e)).compose(&x.inverse()),
            Self::LeftInverse => G::exp(e).compose(&x),
            Self::Right => x.inverse().compose(&G::exp(&(d + e))),
            Self::RightInverse => x.compose(&G::exp(e)),
            Self::Adjoint => x.compose(&G::exp(e)).compose(&x.inverse()),
        };
        value.log().iter().copied().collect()
    }

    fn claimed<G: LieGroup>(self, d: &OVector<f64, G::Dim>) -> DMatrix<f64>
    where
        DefaultAllocator: Alloc<G::Dim>,
    {
        match self {
            Self::Left => block(&G::left_jacobian(d)),
            Self::LeftInverse => block(&G::left_jacobian_inverse(d)),
            Self::Right => block(&G::right_jacobian(d)),
            Self::RightInverse => block(&G::right_jacobian_inverse(d)),
            Self::Adjoint => block(&G::exp(d).adjoint()),
        }
    }
}

/// Checks all laws with elements drawn from `seed` at all [`SCALES`].
///
/// # Panics
/// When a law is broken.
pub fn check_group<G>(seed: u64, tolerance: f64)
where
    G: LieGroup + Manifold<D = <G as LieGroup>::Dim>,
    G::Point: Sample,
    DefaultAllocator: Alloc<<G as LieGroup>::Dim>,
{
    let identity = G::identity();
    let (n, blocks) = (identity.dim(), identity.blocks());
    let size = n.value();
    let mut random = Random::new(seed, Stream::Sim, 2, 0, 0);
    let directions: [OVector<f64, <G as LieGroup>::Dim>; 3] =
        core::array::from_fn(|_| tangent(n, &mut random));
    let p = G::Point::sample(&mut random);
    let one = vec![(String::new(), 1)];
    let exact = 1e-12_f64.max(tolerance * 1e-4);
    let same = |what: &str, a: &G, b: &G| {
        let zero = DMatrix::zeros(size, 1);
        compare(what, &blocks, &one, &block(&a.inverse().compose(b).log()), &zero, exact);
    };
    for scale in SCALES {
        let [a, b, c] = directions.each_ref().map(|d| G::exp(&(d * scale)));
        let d = &directions[0] * scale;
        same("1 a = a", &identity.compose(&a), &a);
        same("a 1 = a", &a.compose(&identity), &a);
        same("a a⁻¹ = 1", &a.compose(&a.inverse()), &identity);
        same("(a b) c = a (b c)", &a.compose(&b).compose(&c), &a.compose(&b.compose(&c)));
        same("Exp(-d) = Exp(d)⁻¹", &G::exp(&-&d), &a.inverse());
        compare("Log(Exp(d)) = d", &blocks, &one, &block(&a.log()), &block(&d), exact);
        let (together, apart) = (a.compose(&b).act(&p).components(), a.act(&b.act(&p)).components());
        for (x, y) in together.iter().zip(&apart) {
            assert!((x - y).abs() <= exact * (1.0 + y.abs()), "(a b)·p = a·(b·p): {together:?}, {apart:?}");
        }
        let product = block(&a.adjoint()) * block(&b.adjoint());
        compare("Ad(a b) = Ad(a) Ad(b)", &blocks, &blocks, &block(&a.compose(&b).adjoint()), &product, exact);
        for law in Definition::ALL {
            let found = law.claimed::<G>(&d);
            let expected = difference_jacobian(size, size, 1e-3, |e| {
                law.evaluate::<f64, G>(&d, &OVector::from_fn_generic(n, U1, |k, _| e[k]))
            });
            compare(
                &format!("{law:?} Jacobian against differences"),
                &blocks,
                &blocks,
                &found,
                &expected,
                tolerance,
            );
            let lifted = lift::<Dual64, _>(&d);
            let expected = dual_jacobian(size, size, |e| {
                law.evaluate::<Dual64, G::Over<Dual64>>(
                    &lifted,
                    &OVector::from_fn_generic(n, U1, |k, _| e[k]),
                )
            });
            compare(
                &format!("{law:?} Jacobian against dual numbers"),
                &blocks,
                &blocks,
                &found,
                &expected,
                1e-3 * tolerance,
            );
        }
    }
}
