//! What all motions of the picture plane have in common: each is a homography, and each has generators.

use nalgebra::{DefaultAllocator, Matrix2, Matrix2x3, Matrix2x4, Matrix3, OMatrix, Point2, SMatrix, U2};

use super::{Affine2, LieGroup, SE2, SL3, Sim2, TranslationScale, Vector};
use crate::manifold::{Alloc, Coordinates};
use crate::math;
use crate::report::BeliefRecord;

/// A Lie group of motions of the plane that keep straight lines straight, under perturbations on the right.
///
/// | motion | `x ↦` | tangent |
/// |---|---|---|
/// | [`Vector<2>`] | `x + b` | `b` |
/// | [`TranslationScale`] | `a x + b` | `v σ` |
/// | [`SE2`] | `R(θ) x + b` | `v θ` |
/// | [`Sim2`] | `a R(θ) x + b` | `v θ σ` |
/// | [`Affine2`] | `L x + b` | `v θ σ`, stretch, shear |
/// | [`SL3`] | homography | those of [`Affine2`], tilt (2) |
pub trait PlanarMotion: Coordinates
where
    DefaultAllocator: Alloc<Self::D>,
{
    /// Homogeneous matrix of the motion, of positive determinant.
    fn matrix(&self) -> Matrix3<f64>;

    /// `∂(Exp(δ) x)/∂δ` at `δ = 0`: how `x` moves under each generator.
    fn generators(x: &Point2<f64>) -> OMatrix<f64, U2, Self::D>;

    /// The motion that leaves out of a similarity what this group does not have.
    fn of(similarity: &Sim2) -> Self;

    /// Image of `x`, and how points about it move: `y(x + d) ≈ c + L d`.
    fn about(&self, x: &Point2<f64>) -> (Point2<f64>, Matrix2<f64>) {
        let m = self.matrix();
        let h = m * x.to_homogeneous();
        let c = Point2::new(h.x, h.y) / h.z;
        let [a, b] = [m.m31, m.m32];
        (c, Matrix2::new(m.m11 - c.x * a, m.m12 - c.x * b, m.m21 - c.y * a, m.m22 - c.y * b) / h.z)
    }

    /// The similarity that is nearest to the motion at the origin.
    fn similarity(&self) -> Sim2 {
        let (c, l) = self.about(&Point2::origin());
        let angle = math::atan2(l.m21 - l.m12, l.m11 + l.m22);
        Sim2::new(c.x, c.y, angle, l.determinant().abs().sqrt())
    }
}

impl PlanarMotion for Vector<2> {
    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(1.0, 0.0, self.0.x, 0.0, 1.0, self.0.y, 0.0, 0.0, 1.0)
    }
    fn generators(_: &Point2<f64>) -> Matrix2<f64> {
        Matrix2::identity()
    }
    fn of(s: &Sim2) -> Self {
        Self(s.translation)
    }
}

impl PlanarMotion for TranslationScale {
    fn matrix(&self) -> Matrix3<f64> {
        let (a, b) = (self.scale, self.translation);
        Matrix3::new(a, 0.0, b.x, 0.0, a, b.y, 0.0, 0.0, 1.0)
    }
    fn generators(p: &Point2<f64>) -> Matrix2x3<f64> {
        Matrix2x3::new(1.0, 0.0, p.x, 0.0, 1.0, p.y)
    }
    fn of(s: &Sim2) -> Self {
        Self::new(s.translation.x, s.translation.y, s.scale)
    }
}

impl PlanarMotion for SE2 {
    fn matrix(&self) -> Matrix3<f64> {
        Sim2 { rotation: self.rotation, translation: self.translation, scale: 1.0 }.matrix()
    }
    fn generators(p: &Point2<f64>) -> Matrix2x3<f64> {
        Matrix2x3::new(1.0, 0.0, -p.y, 0.0, 1.0, p.x)
    }
    fn of(s: &Sim2) -> Self {
        Self::new(s.translation.x, s.translation.y, s.angle())
    }
}

impl PlanarMotion for Sim2 {
    fn matrix(&self) -> Matrix3<f64> {
        let (c, s, b) = (self.rotation.re * self.scale, self.rotation.im * self.scale, self.translation);
        Matrix3::new(c, -s, b.x, s, c, b.y, 0.0, 0.0, 1.0)
    }
    fn generators(p: &Point2<f64>) -> Matrix2x4<f64> {
        Matrix2x4::new(1.0, 0.0, -p.y, p.x, 0.0, 1.0, p.x, p.y)
    }
    fn of(s: &Sim2) -> Self {
        *s
    }
}

impl PlanarMotion for Affine2 {
    fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }
    fn generators(p: &Point2<f64>) -> SMatrix<f64, 2, 6> {
        let (x, y) = (p.x, p.y);
        SMatrix::<f64, 2, 6>::from_row_slice(&[1.0, 0.0, -y, x, x, y, 0.0, 1.0, x, y, -y, x])
    }
    fn of(s: &Sim2) -> Self {
        let m: Matrix3<f64> = s.matrix();
        Self::from_rows([m.m11, m.m12, m.m13], [m.m21, m.m22, m.m23]).unwrap_or_else(LieGroup::identity)
    }
}

impl PlanarMotion for SL3 {
    fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }
    fn generators(p: &Point2<f64>) -> SMatrix<f64, 2, 8> {
        let (x, y) = (p.x, p.y);
        let rows = [
            [1.0, 0.0, -y, x, x, y, -x * x, -x * y], //
            [0.0, 1.0, x, y, -y, x, -x * y, -y * y],
        ];
        SMatrix::<f64, 2, 8>::from_row_slice(rows.as_flattened())
    }
    fn of(s: &Sim2) -> Self {
        Self::from_matrix(&s.matrix()).unwrap_or_else(LieGroup::identity)
    }
}

/// Calls a function of the pose space for each space of the plane, until one knows the record.
macro_rules! first_of_plane {
    ($of:ident, $($argument:expr),+) => {
        None.or_else(|| $of::<Vector<2>>($($argument),+))
            .or_else(|| $of::<TranslationScale>($($argument),+))
            .or_else(|| $of::<SE2>($($argument),+))
            .or_else(|| $of::<Sim2>($($argument),+))
            .or_else(|| $of::<Affine2>($($argument),+))
            .or_else(|| $of::<SL3>($($argument),+))
    };
}

/// Homogeneous matrix of the mean of a belief about a motion of the plane, whichever it is; `None` for other spaces.
pub fn picture_from_plane(record: &BeliefRecord) -> Option<Matrix3<f64>> {
    fn of<P: PlanarMotion>(record: &BeliefRecord) -> Option<Matrix3<f64>>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let read = || Some(P::read(&record.coordinates)?.matrix());
        (record.space == P::SPACE).then(read).flatten()
    }
    first_of_plane!(of, record)
}

/// Image of the point `x` of the plane under a belief about a motion of the plane, and its covariance to first order,
/// both in the units of the picture; `None` for other spaces.
pub fn image_of_plane_point(record: &BeliefRecord, x: &Point2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
    fn of<P: PlanarMotion>(record: &BeliefRecord, x: &Point2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)>
    where
        DefaultAllocator: Alloc<P::D>,
    {
        let belief = record.get::<P>()?;
        let (image, derivative) = belief.mean.about(x);
        // The point moves by its generators first, on the right.
        let generators = P::generators(x);
        let moved = &generators * &belief.covariance * generators.transpose();
        Some((image, derivative * moved * derivative.transpose()))
    }
    first_of_plane!(of, record, x)
}

#[cfg(test)]
mod record_tests {
    use super::*;
    use crate::belief::Gaussian;
    use nalgebra::Vector4;

    #[test]
    fn motions_keep_what_they_have_of_a_similarity() {
        let s = Sim2::new(3.0, 4.0, 0.5, 2.0);
        let x = Point2::new(1.0, -2.0);
        for y in [Sim2::of(&s).act(&x), Affine2::of(&s).act(&x), SL3::of(&s).act(&x)] {
            assert!((y - s.act(&x)).norm() < 1e-12);
        }
        // By differences, of a homography with a tilt.
        let tilted = SL3::of(&s)
            .compose(&SL3::exp(&nalgebra::SVector::from([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, -0.03])));
        for x in [Point2::origin(), x] {
            let (c, l) = tilted.about(&x);
            assert!((c - tilted.act(&x)).norm() < 1e-12);
            for (k, e) in [nalgebra::Vector2::x(), nalgebra::Vector2::y()].into_iter().enumerate() {
                let difference = tilted.act(&(x + 1e-6 * e)) - tilted.act(&(x - 1e-6 * e));
                assert!((difference / 2e-6 - l.column(k)).norm() < 1e-8);
            }
        }
        assert!((SL3::of(&s).similarity().matrix() - s.matrix()).norm() < 1e-12);
        assert_eq!(TranslationScale::of(&s), TranslationScale::new(3.0, 4.0, 2.0));
        assert!((SE2::of(&s).matrix() - SE2::new(3.0, 4.0, 0.5).matrix()).norm() < 1e-12);
        assert_eq!(Vector::<2>::of(&s).0, s.translation);
    }

    #[test]
    fn records_of_the_plane_are_matrices() {
        let pose = Sim2::new(3.0, -2.0, 0.4, 1.5);
        let mut record = BeliefRecord::default();
        assert_eq!(picture_from_plane(&record), None);
        record.set(&Gaussian::from_sigmas(pose, &Vector4::repeat(1.0)));
        assert!((picture_from_plane(&record).unwrap() - pose.matrix()).norm() < 1e-12);
        record.space = "se3";
        assert_eq!(picture_from_plane(&record), None);
        assert_eq!(image_of_plane_point(&record, &Point2::origin()), None);
    }

    /// Against differences, by a homography and a covariance with all correlations.
    #[test]
    fn a_point_is_as_uncertain_as_the_motion_makes_it() {
        let exp = |v: [f64; 8]| SL3::exp(&nalgebra::SVector::from(v));
        let mean = SL3::of(&Sim2::new(30.0, -20.0, 0.4, 1.5))
            .compose(&exp([0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 2e-3, -3e-3]));
        let root = SMatrix::<f64, 8, 8>::from_fn(|r, c| 1e-3 * (((5 * r + 3 * c) % 7) as f64 - 3.0));
        let mut record = BeliefRecord::default();
        record.set(&Gaussian { mean, covariance: root * root.transpose() });
        let x = Point2::new(12.0, -7.0);
        let (image, covariance) = image_of_plane_point(&record, &x).unwrap();
        assert!((image - mean.act(&x)).norm() < 1e-9);
        let jacobian = SMatrix::<f64, 2, 8>::from_columns(&core::array::from_fn::<_, 8, _>(|k| {
            let moved = |step: f64| {
                mean.compose(&exp(core::array::from_fn(|i| if i == k { step } else { 0.0 }))).act(&x)
            };
            (moved(1e-6) - moved(-1e-6)) / 2e-6
        }));
        let expected = jacobian * root * root.transpose() * jacobian.transpose();
        assert!((covariance - expected).amax() < 1e-7 * expected.amax(), "{covariance} {expected}");
    }
}
