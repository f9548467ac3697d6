//! Small measurements with known answers.

use nalgebra::{DMatrix, DefaultAllocator, Matrix2x3, Matrix2x6, OVector, Point3, Vector2, Vector6};
use vt_core::lie::SE3;
use vt_core::manifold::{Alloc, Coordinates, Manifold, Tangent};
use vt_core::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use vt_core::random::{Random, Stream};

/// Random numbers of a test case.
pub fn random(case: u64) -> Random {
    Random::new(11, Stream::Sim, 0, case, 0)
}

/// A vector of normal numbers with these deviations.
pub fn normals<D: nalgebra::Dim>(sigmas: &OVector<f64, D>, random: &mut Random) -> OVector<f64, D>
where
    DefaultAllocator: Alloc<D>,
{
    sigmas.map(|s| s * random.normal())
}

/// Any matrix as one of run-time size.
pub fn dense<R: nalgebra::Dim, C: nalgebra::Dim, S: nalgebra::RawStorage<f64, R, C>>(
    m: &nalgebra::Matrix<f64, R, C, S>,
) -> DMatrix<f64> {
    DMatrix::from_fn(m.nrows(), m.ncols(), |r, c| m[(r, c)])
}

/// Both forms of `½ Σ r²/σ²` from its rows.
macro_rules! measurement_from_rows {
    ($pose:ty) => {
        fn log_likelihoods(&self, poses: &[$pose], out: &mut [f64]) {
            let mut rows = Linearized::default();
            for (pose, l) in poses.iter().zip(out) {
                self.residuals(pose, &mut rows);
                *l = -rows.residuals.iter().zip(&rows.variances).map(|(r, v)| 0.5 * r * r / v).sum::<f64>();
            }
        }
        fn normal_equations(&self, at: &$pose, out: &mut NormalEquations<$pose>) {
            let mut rows = Linearized::default();
            self.residuals(at, &mut rows);
            out.clear();
            rows.accumulate(out);
        }
        fn quality(&self, _: &$pose) -> Quality {
            Quality::default()
        }
        fn level(&self) -> Level {
            Level::Feature
        }
    };
}

/// `z_k = h_k · x + noise` on a vector space.
#[derive(Clone, Debug)]
pub struct Rows<P: Manifold>
where
    DefaultAllocator: Alloc<P::D>,
{
    pub rows: Vec<Tangent<P>>,
    pub values: Vec<f64>,
    pub variances: Vec<f64>,
}

impl<P: Coordinates> Measurement<P> for Rows<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        let mut x = vec![];
        at.write(&mut x);
        out.clear();
        for ((h, z), variance) in self.rows.iter().zip(&self.values).zip(&self.variances) {
            let predicted: f64 = h.iter().zip(&x).map(|(a, b)| a * b).sum();
            out.push(z - predicted, h.clone(), *variance, 1.0);
        }
    }
    measurement_from_rows!(P);
}

/// Points of a body seen by a pinhole camera with a focal length of 500 px.
#[derive(Clone, Debug)]
pub struct Pixels {
    pub points: Vec<Point3<f64>>,
    pub seen: Vec<Vector2<f64>>,
    /// Deviation of a coordinate in pixels.
    pub sigma: f64,
}

const FOCAL: f64 = 500.0;

impl Pixels {
    /// What the camera sees of `points` from `truth`, with noise.
    pub fn simulate(points: &[Point3<f64>], truth: &SE3, sigma: f64, random: &mut Random) -> Self {
        let seen = points.iter().map(|p| {
            let q = truth.act(p);
            Vector2::new(q.x / q.z, q.y / q.z) * FOCAL + normals(&Vector2::repeat(sigma), random)
        });
        Self { points: points.to_vec(), seen: seen.collect(), sigma }
    }
}

impl Measurement<SE3> for Pixels {
    fn residuals(&self, at: &SE3, out: &mut Linearized<SE3>) {
        out.clear();
        let rotation = at.rotation.to_rotation_matrix();
        for (p, seen) in self.points.iter().zip(&self.seen) {
            let q = at.act(p);
            let image = Matrix2x3::new(1.0, 0.0, -q.x / q.z, 0.0, 1.0, -q.y / q.z) * (FOCAL / q.z);
            let mut j = Matrix2x6::zeros();
            j.fixed_columns_mut::<3>(0).copy_from(&(image * rotation));
            j.fixed_columns_mut::<3>(3).copy_from(&(image * rotation * -p.coords.cross_matrix()));
            let r = seen - Vector2::new(q.x / q.z, q.y / q.z) * FOCAL;
            for k in 0..2 {
                out.push(r[k], j.row(k).transpose(), self.sigma * self.sigma, 1.0);
            }
        }
    }
    measurement_from_rows!(SE3);
}

/// Corners of a box of 20 × 14 × 10 cm.
pub fn corners() -> Vec<Point3<f64>> {
    (0..8)
        .map(|k| {
            let side = |bit: i32| f64::from((k >> bit) & 1) - 0.5;
            Point3::new(0.2 * side(0), 0.14 * side(1), 0.1 * side(2))
        })
        .collect()
}

/// A pose of the box about 0.8 m before the camera.
pub fn before_camera(random: &mut Random) -> SE3 {
    let t =
        nalgebra::Vector3::new(0.1 * random.normal(), 0.1 * random.normal(), 0.8 + 0.05 * random.normal());
    SE3::from_rotation_vector(&nalgebra::Vector3::from_fn(|_, _| 0.6 * random.normal()), t)
}

/// Deviations of `metres` and `radians` in the tangent of SE(3).
pub fn deviations(metres: f64, radians: f64) -> Vector6<f64> {
    Vector6::new(metres, metres, metres, radians, radians, radians)
}

vt_core::measurement_laws!(pixels: Pixels::simulate(&corners(), &before_camera(&mut random(1)), 1.0, &mut random(2)),
    { use vt_core::laws::proptest::prelude::Strategy; (3_u64..1000).prop_map(|case| before_camera(&mut random(case))) });
vt_core::measurement_laws!(rows: Rows::<vt_core::lie::Vector<2>> {
    rows: vec![Vector2::new(1.0, 2.0), Vector2::new(-0.5, 3.0), Vector2::x()],
    values: vec![1.0, 0.3, -2.0],
    variances: vec![0.1, 0.5, 2.0],
}, { use vt_core::laws::proptest::prelude::Strategy; (-5.0..5.0).prop_map(|x| vt_core::lie::Vector(Vector2::new(x, 1.0 - x))) });
