//! Measurements by a function: `z = h(x) + v`, `v ~ N(0, R)`, for sensors that are not pictures.
//!
//! A [`MeasurementModel`] is `h` with its Jacobian (by differences unless given); an [`Instrument`] is a model with its
//! noise, checked once; a [`Reading`] is one value of it and a [`Measurement`], so that it runs under every
//! estimator. What each asks of it:
//!
//! | estimator | asks for |
//! |---|---|
//! | extended, iterated, square-root, information | `h` and its Jacobian at one point |
//! | unscented, cubature | `h` at every sigma point ([`Measurement::normalized_residuals`]) |
//! | particle | the likelihood of every particle |
//!
//! The argument of `h` is what the estimator calls its pose. A function of the whole state (with velocities) takes
//! that state as its pose: every state is a pose of its own.
//!
//! ```
//! use vt_core::lie::Vector;
//! use vt_core::measurement_model::{Angular, Function, Instrument};
//! use vt_core::nalgebra::{Matrix2, Vector2};
//! use vt_core::math;
//!
//! // Bearing (radians) and range (metres) of a target with the state x, y, vx, vy.
//! let h = Function(|s: &Vector<4>| Vector2::new(math::atan2(s.0[1], s.0[0]), math::hypot(s.0[0], s.0[1])));
//! let radar = Instrument::new(Angular::new(h, [0]), Matrix2::new(1e-4, 0.0, 0.0, 0.25))?;
//! let reading = radar.read(Vector2::new(0.3, 12.0))?;
//! # Ok::<(), vt_core::error::EstimateError>(())
//! ```

use std::sync::Arc;

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector};

use crate::belief::cholesky;
use crate::error::EstimateError;
use crate::lie::VectorSpace;
use crate::manifold::{AllocPair, Manifold, differences_between};
use crate::math;
use crate::measurement::{Level, Linearized, Measurement, NormalEquations, Quality};
use crate::robust::Robust;

/// What a sensor shows of a pose or state `P`: `h(p)`.
pub trait MeasurementModel<P: Manifold>: Send + Sync
where
    DefaultAllocator: AllocPair<P::D, Self::M>,
{
    /// Number of rows of `z`; `Dyn` where it is known at run time only.
    type M: Dim;

    /// `h(at)`.
    fn predict(&self, at: &P) -> OVector<f64, Self::M>;

    /// Whether `h` is made for poses of this size; see [`Measurement::fits`].
    ///
    /// # Errors
    /// [`EstimateError::Dimension`] when it is not.
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        let _ = at;
        Ok(())
    }

    /// `z ⊟ h`: `seen − predicted` unless overridden (angles wrap).
    fn residual(
        &self,
        seen: &OVector<f64, Self::M>,
        predicted: &OVector<f64, Self::M>,
    ) -> OVector<f64, Self::M> {
        seen - predicted
    }

    /// `∂h(at ⊞ δ)/∂δ`, where there is a closed form.
    fn jacobian(&self, at: &P) -> Option<OMatrix<f64, Self::M, P::D>> {
        let _ = at;
        None
    }

    /// `h(at)` and its Jacobian: that of [`Self::jacobian`], or by central differences compared by [`Self::residual`].
    /// For models that share work between both.
    fn linearize(&self, at: &P) -> (OVector<f64, Self::M>, OMatrix<f64, Self::M, P::D>) {
        let predicted = self.predict(at);
        let jacobian = self.jacobian(at).unwrap_or_else(|| {
            let subtract = |a: &OVector<f64, Self::M>, b: &OVector<f64, Self::M>| self.residual(a, b);
            let m = predicted.shape_generic().0;
            differences_between(at.dim(), m, |e| self.predict(&at.retract(e)), subtract)
        });
        (predicted, jacobian)
    }
}

/// A model from a function, with a Jacobian by differences.
#[derive(Clone, Copy, Debug)]
pub struct Function<H>(pub H);

impl<P, M, H> MeasurementModel<P> for Function<H>
where
    P: Manifold,
    M: Dim,
    H: Fn(&P) -> OVector<f64, M> + Send + Sync,
    DefaultAllocator: AllocPair<P::D, M>,
{
    type M = M;

    fn predict(&self, at: &P) -> OVector<f64, M> {
        (self.0)(at)
    }
}

/// A model from a function and its Jacobian.
#[derive(Clone, Copy, Debug)]
pub struct Differentiable<H, J> {
    /// `p ↦ h(p)`.
    pub function: H,
    /// `p ↦ ∂h(p ⊞ δ)/∂δ`.
    pub jacobian: J,
}

impl<P, M, H, J> MeasurementModel<P> for Differentiable<H, J>
where
    P: Manifold,
    M: Dim,
    H: Fn(&P) -> OVector<f64, M> + Send + Sync,
    J: Fn(&P) -> OMatrix<f64, M, P::D> + Send + Sync,
    DefaultAllocator: AllocPair<P::D, M>,
{
    type M = M;

    fn predict(&self, at: &P) -> OVector<f64, M> {
        (self.function)(at)
    }
    fn jacobian(&self, at: &P) -> Option<OMatrix<f64, M, P::D>> {
        Some((self.jacobian)(at))
    }
}

/// `h(x) = H x` on a vector space.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear<M: Dim, D: Dim>(pub OMatrix<f64, M, D>)
where
    DefaultAllocator: AllocPair<D, M>;

impl<P, M> MeasurementModel<P> for Linear<M, P::D>
where
    P: VectorSpace,
    M: Dim,
    DefaultAllocator: AllocPair<P::D, M>,
{
    type M = M;

    fn predict(&self, at: &P) -> OVector<f64, M> {
        &self.0 * at.components()
    }
    fn jacobian(&self, _: &P) -> Option<OMatrix<f64, M, P::D>> {
        Some(self.0.clone())
    }
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        EstimateError::unless_equal("the measurement's matrix", self.0.ncols(), at.dim().value())
    }
}

/// A model some rows of which are angles in radians: their residuals lie in `(−π, π]`.
#[derive(Clone, Debug)]
pub struct Angular<H> {
    model: H,
    rows: Vec<usize>,
}

impl<H> Angular<H> {
    /// `model` with these rows as angles.
    pub fn new(model: H, rows: impl IntoIterator<Item = usize>) -> Self {
        Self { model, rows: rows.into_iter().collect() }
    }
}

impl<P, H> MeasurementModel<P> for Angular<H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    type M = H::M;

    fn predict(&self, at: &P) -> OVector<f64, H::M> {
        self.model.predict(at)
    }
    fn residual(&self, seen: &OVector<f64, H::M>, predicted: &OVector<f64, H::M>) -> OVector<f64, H::M> {
        let mut r = self.model.residual(seen, predicted);
        for &k in &self.rows {
            if let Some(angle) = r.get_mut(k) {
                *angle = math::wrap_angle(*angle);
            }
        }
        r
    }
    fn jacobian(&self, at: &P) -> Option<OMatrix<f64, H::M, P::D>> {
        self.model.jacobian(at)
    }
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        self.model.fits(at)
    }
}

/// A model with the covariance `R` of its noise, in squared units of `z`. Clones share both.
pub struct Instrument<P, H>(Arc<Parts<P, H>>)
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>;

struct Parts<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    model: H,
    noise: OMatrix<f64, H::M, H::M>,
    /// Lower triangular `L⁻¹` with `L Lᵀ = R`.
    whitening: OMatrix<f64, H::M, H::M>,
    log_det: f64,
    robust: Robust,
}

impl<P, H> Clone for Instrument<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<P, H> Instrument<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    /// A model with Gaussian noise.
    ///
    /// # Errors
    /// When `R` is not finite, not symmetric or not positive definite.
    pub fn new(model: H, noise: OMatrix<f64, H::M, H::M>) -> Result<Self, EstimateError> {
        Self::robust(model, noise, Robust::Square)
    }

    /// A model with an M-estimator on the length `√(rᵀ R⁻¹ r)` of its residual, for readings that may be false.
    ///
    /// # Errors
    /// When `R` is not finite, not symmetric or not positive definite.
    pub fn robust(model: H, noise: OMatrix<f64, H::M, H::M>, robust: Robust) -> Result<Self, EstimateError> {
        if noise.iter().any(|v| !v.is_finite()) {
            return Err(EstimateError::NotFinite("the measurement's noise"));
        }
        let unfit = EstimateError::NotPositiveDefinite("the measurement's noise");
        let even = (0..noise.nrows()).all(|r| {
            (0..r).all(|c| {
                (noise[(r, c)] - noise[(c, r)]).abs() <= 1e-9 * (noise[(r, r)] * noise[(c, c)]).abs().sqrt()
            })
        });
        if !even {
            return Err(unfit);
        }
        let l = cholesky(noise.clone()).ok_or_else(|| unfit.clone())?.unpack();
        let log_det = (0..l.nrows()).map(|k| 2.0 * math::ln(l[(k, k)])).sum();
        let m = l.shape_generic().0;
        let mut whitening = OMatrix::identity_generic(m, m);
        if !l.solve_lower_triangular_mut(&mut whitening) {
            return Err(unfit);
        }
        Ok(Self(Arc::new(Parts { model, noise, whitening, log_det, robust })))
    }

    /// One value that it shows.
    ///
    /// # Errors
    /// When `z` is not finite or of another size than its noise.
    pub fn read(&self, z: OVector<f64, H::M>) -> Result<Reading<P, H>, EstimateError> {
        if z.len() != self.0.noise.nrows() {
            let (found, expected) = (z.len(), self.0.noise.nrows());
            return Err(EstimateError::Dimension { what: "the measurement", found, expected });
        }
        if z.iter().any(|v| !v.is_finite()) {
            return Err(EstimateError::NotFinite("the measurement"));
        }
        Ok(Reading { instrument: self.clone(), z })
    }

    /// The model.
    pub fn model(&self) -> &H {
        &self.0.model
    }

    /// `R`.
    pub fn noise(&self) -> &OMatrix<f64, H::M, H::M> {
        &self.0.noise
    }

    /// `ln det R`.
    pub fn log_det(&self) -> f64 {
        self.0.log_det
    }

    /// The M-estimator; [`Robust::Square`] for Gaussian noise.
    pub fn loss(&self) -> Robust {
        self.0.robust
    }
}

/// A value `z` of an [`Instrument`].
pub struct Reading<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    instrument: Instrument<P, H>,
    z: OVector<f64, H::M>,
}

impl<P, H> Clone for Reading<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    fn clone(&self) -> Self {
        Self { instrument: self.instrument.clone(), z: self.z.clone() }
    }
}

impl<P, H> Reading<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    /// What it was read from.
    pub fn instrument(&self) -> &Instrument<P, H> {
        &self.instrument
    }

    /// The value.
    pub fn z(&self) -> &OVector<f64, H::M> {
        &self.z
    }

    /// `z ⊟ h(at)`.
    pub fn residual(&self, at: &P) -> OVector<f64, H::M> {
        self.apart(&self.instrument.0.model.predict(at))
    }

    /// `z ⊟ h(at)` and the Jacobian of `h`.
    pub fn linearize(&self, at: &P) -> (OVector<f64, H::M>, OMatrix<f64, H::M, P::D>) {
        let (predicted, jacobian) = self.instrument.0.model.linearize(at);
        let (m, columns) = (self.z.shape_generic().0, jacobian.shape_generic().1);
        if jacobian.nrows() == self.z.len() {
            return (self.apart(&predicted), jacobian);
        }
        (self.apart(&predicted), OMatrix::repeat_generic(m, columns, f64::NAN))
    }

    /// `z ⊟ predicted`; no numbers, which every estimator refuses, where `h` has another number of rows than its noise.
    fn apart(&self, predicted: &OVector<f64, H::M>) -> OVector<f64, H::M> {
        if predicted.len() == self.z.len() {
            return self.instrument.0.model.residual(&self.z, predicted);
        }
        self.z.map(|_| f64::NAN)
    }

    /// [`Self::linearize`] in units of the noise.
    pub fn normalize(&self, at: &P) -> (OVector<f64, H::M>, OMatrix<f64, H::M, P::D>) {
        let (r, j) = self.linearize(at);
        let w = &self.instrument.0.whitening;
        (w * r, w * j)
    }

    /// [`Self::residual`] in units of the noise.
    pub fn normalized(&self, at: &P) -> OVector<f64, H::M> {
        &self.instrument.0.whitening * self.residual(at)
    }
}

impl<P, H> Measurement<P> for Reading<P, H>
where
    P: Manifold,
    H: MeasurementModel<P>,
    DefaultAllocator: AllocPair<P::D, H::M>,
{
    fn fits(&self, at: &P) -> Result<(), EstimateError> {
        self.instrument.0.model.fits(at)
    }

    fn log_likelihoods(&self, poses: &[P], out: &mut [f64]) {
        for (pose, l) in poses.iter().zip(out) {
            let square = self.normalized(pose).norm_squared();
            *l = match self.instrument.0.robust {
                Robust::Square => -0.5 * square,
                robust => -robust.rho(square.sqrt()),
            };
        }
    }

    fn residuals(&self, at: &P, out: &mut Linearized<P>) {
        out.clear();
        let (r, j) = self.normalize(at);
        if j.ncols() != at.dim().value() {
            // A Jacobian of another size says nothing that an estimator would take.
            return out.push(f64::NAN, at.zero(), 1.0, 1.0);
        }
        let weight = self.instrument.0.robust.weight(r.norm());
        for k in 0..r.len() {
            out.push(r[k], j.row(k).transpose(), 1.0, weight);
        }
    }

    fn normal_equations(&self, at: &P, out: &mut NormalEquations<P>) {
        let (r, j) = self.normalize(at);
        if j.ncols() != at.dim().value() {
            return out.gradient.fill(f64::NAN);
        }
        j.tr_mul_to(&j, &mut out.information);
        j.tr_mul_to(&r, &mut out.gradient);
        out.rows = r.len();
        let square = r.norm_squared();
        match self.instrument.0.robust {
            Robust::Square => out.cost = 0.5 * square,
            robust => {
                let length = square.sqrt();
                let weight = robust.weight(length);
                out.information *= weight;
                out.gradient *= weight;
                out.cost = robust.rho(length);
            }
        }
        crate::belief::symmetrize(&mut out.information);
    }

    fn normalized_residuals(&self, poses: &[P], out: &mut Vec<f64>) -> Option<usize> {
        if self.instrument.0.robust != Robust::Square {
            return None;
        }
        out.clear();
        for pose in poses {
            out.extend(self.normalized(pose).iter());
        }
        Some(self.z.len())
    }

    /// Rows within three deviations count as found. Nothing is known of clutter: `log_ratio` is zero.
    fn quality(&self, at: &P) -> Quality {
        let r = self.normalized(at);
        let within = r.iter().filter(|v| v.abs() <= 3.0);
        let (inliers, squares) = within.fold((0, 0.0), |(n, s), v| (n + 1, s + v * v));
        Quality {
            expected: r.len(),
            inliers,
            inlier_ratio: inliers as f64 / (r.len() as f64).max(1.0),
            log_ratio: 0.0,
            normalized_rms: (squares / (inliers as f64).max(1.0)).sqrt(),
        }
    }

    fn level(&self) -> Level {
        Level::Feature
    }
}
