//! Eigenvalues of symmetric matrices, and the directions that an information matrix does not determine.

use nalgebra::{DefaultAllocator, Dim, OMatrix, OVector, U1};

use crate::manifold::Alloc;

/// Eigenvalues (not sorted) and orthonormal eigenvectors (columns) of a symmetric matrix, by Jacobi rotations:
/// accurate to rounding for small eigenvalues beside large ones, and without bounds beyond storage.
pub fn symmetric_eigen<D: Dim>(matrix: &OMatrix<f64, D, D>) -> (OVector<f64, D>, OMatrix<f64, D, D>)
where
    DefaultAllocator: Alloc<D>,
{
    let size = matrix.shape_generic().0;
    let n = size.value();
    let mut a = matrix.clone();
    let mut v = OMatrix::<f64, D, D>::identity_generic(size, size);
    for _ in 0..50 {
        let mut rotated = false;
        for p in 0..n {
            for q in p + 1..n {
                let off = a[(p, q)];
                // Negligible against both diagonal entries.
                if off.abs() <= 1e-16 * (a[(p, p)] * a[(q, q)]).abs().sqrt() || off.abs() < f64::MIN_POSITIVE
                {
                    continue;
                }
                rotated = true;
                let theta = (a[(q, q)] - a[(p, p)]) / (2.0 * off);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                a[(p, p)] -= t * off;
                a[(q, q)] += t * off;
                a[(p, q)] = 0.0;
                a[(q, p)] = 0.0;
                for k in (0..n).filter(|k| *k != p && *k != q) {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    a[(k, p)] = c * x - s * y;
                    a[(k, q)] = s * x + c * y;
                    a[(p, k)] = a[(k, p)];
                    a[(q, k)] = a[(k, q)];
                }
                for k in 0..n {
                    let (x, y) = (v[(k, p)], v[(k, q)]);
                    v[(k, p)] = c * x - s * y;
                    v[(k, q)] = s * x + c * y;
                }
            }
        }
        if !rotated {
            break;
        }
    }
    (a.diagonal(), v)
}

/// An information matrix split into directions that data determine and directions that they do not.
///
/// Metres and radians differ in size, so the split is made after scaling the matrix to a unit diagonal: a direction
/// counts as unobservable when its scaled eigenvalue is at most `tolerance`.
#[derive(Clone, Debug)]
pub struct Spectrum<D: Dim>
where
    DefaultAllocator: Alloc<D>,
{
    scale: OVector<f64, D>,
    values: OVector<f64, D>,
    vectors: OMatrix<f64, D, D>,
    tolerance: f64,
    /// Unobservable directions in its first columns, and how many they are.
    null: OMatrix<f64, D, D>,
    nullity: usize,
}

/// Diagonal entries below this part of the largest are not scaled up further: they are rounding, not information.
const DIAGONAL_FLOOR: f64 = 1e-10;

impl<D: Dim> Spectrum<D>
where
    DefaultAllocator: Alloc<D>,
{
    /// Splits a symmetric positive semi-definite matrix.
    pub fn new(information: &OMatrix<f64, D, D>, tolerance: f64) -> Self {
        let size = information.shape_generic().0;
        let n = size.value();
        let largest = (0..n).map(|k| information[(k, k)]).fold(0.0, f64::max);
        let scale = OVector::<f64, D>::from_fn_generic(size, U1, |k, _| {
            let d = information[(k, k)].max(DIAGONAL_FLOOR * largest);
            if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 }
        });
        let mut scaled = information.clone();
        for r in 0..n {
            for c in 0..n {
                scaled[(r, c)] *= scale[r] * scale[c];
            }
        }
        let (values, vectors) = symmetric_eigen(&scaled);
        let (mut null, mut nullity) = (OMatrix::<f64, D, D>::zeros_generic(size, size), 0);
        for k in (0..n).filter(|k| values[*k] <= tolerance) {
            // A null vector of the scaled matrix, in tangent units, orthogonal to those before.
            let mut d = vectors.column(k).component_mul(&scale);
            for other in 0..nullity {
                let other = null.column(other);
                let part = other.dot(&d);
                d.axpy(-part, &other, 1.0);
            }
            let length = d.norm();
            if length > 0.0 {
                null.set_column(nullity, &(d / length));
                nullity += 1;
            }
        }
        Self { scale, values, vectors, tolerance, null, nullity }
    }

    /// Unit tangent vectors, orthogonal to each other, that span the unobservable directions.
    pub fn unobservable(&self) -> impl ExactSizeIterator<Item = OVector<f64, D>> {
        (0..self.nullity).map(|k| self.null.column(k).into_owned())
    }

    /// Number of observable directions.
    pub fn rank(&self) -> usize {
        self.values.iter().filter(|v| **v > self.tolerance).count()
    }

    /// `(eigenvalue, coordinate of g)` of each observable direction in scaled space, by index.
    fn coordinates<'a>(&'a self, g: &'a OVector<f64, D>) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let scaled = g.component_mul(&self.scale);
        (0..self.values.len())
            .filter(|k| self.values[*k] > self.tolerance)
            .map(move |k| (k, self.values[k], self.vectors.column(k).dot(&scaled)))
    }

    /// `gᵀ A⁺ g`: squared length of the full step to `A δ = g` in standard deviations.
    pub fn decrement(&self, g: &OVector<f64, D>) -> f64 {
        self.coordinates(g).map(|(_, value, c)| c * c / value).sum()
    }

    /// Step of `(A + μ D) δ = g`, `D` the scaling to a unit diagonal, without any part along unobservable directions;
    /// and the decrease of the quadratic model that it promises.
    pub fn step(&self, g: &OVector<f64, D>, damping: f64) -> (OVector<f64, D>, f64) {
        let mut step = OVector::zeros_generic(self.values.shape_generic().0, U1);
        let mut decrease = 0.0;
        for (k, value, c) in self.coordinates(g) {
            let y = c / (value + damping);
            decrease += y * (c - 0.5 * value * y);
            step.axpy(y, &self.vectors.column(k), 1.0);
        }
        step.component_mul_assign(&self.scale);
        for null in self.unobservable() {
            let along = null.dot(&step);
            step.axpy(-along, &null, 1.0);
        }
        (step, decrease)
    }

    /// `A` without what rounding left along unobservable directions.
    pub fn information(&self) -> OMatrix<f64, D, D> {
        self.rebuild(|value| value, |scale| 1.0 / scale)
    }

    /// Pseudo-inverse of `A`: the covariance in the observable directions, zero along the others.
    pub fn covariance(&self) -> OMatrix<f64, D, D> {
        let mut c = self.rebuild(|value| 1.0 / value, |scale| scale);
        for null in self.unobservable() {
            // C ← (1 - n nᵀ) C (1 - n nᵀ)
            let along = &c * &null;
            let both = null.dot(&along);
            c.ger(-1.0, &null, &along, 1.0);
            c.ger(-1.0, &along, &null, 1.0);
            c.ger(both, &null, &null, 1.0);
        }
        c
    }

    fn rebuild(&self, value: impl Fn(f64) -> f64, scale: impl Fn(f64) -> f64) -> OMatrix<f64, D, D> {
        let size = self.values.shape_generic().0;
        let mut m = OMatrix::<f64, D, D>::zeros_generic(size, size);
        let scale = self.scale.map(scale);
        for k in (0..self.values.len()).filter(|k| self.values[*k] > self.tolerance) {
            let d = self.vectors.column(k).component_mul(&scale);
            m.ger(value(self.values[k]), &d, &d, 1.0);
        }
        m
    }
}
