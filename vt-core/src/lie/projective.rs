//! Affine maps and homographies of the plane: groups of 3×3 matrices.

use nalgebra::{Const, Matrix3, Point2, RealField, SMatrix, SVector};

use super::{LieGroup, manifold_of_group, series, sim3};

/// `e^A`.
fn exp<T: RealField + Copy>(a: &Matrix3<T>) -> Matrix3<T> {
    Matrix3::identity() + a * sim3::phi(a)
}

/// Square root with eigenvalues in the right half-plane: the product form of the iteration of Denman and Beavers
/// (N. Higham, "Functions of Matrices", 2008, Eq. 6.29). `None` where it does not converge.
fn square_root<T: RealField + Copy>(a: &Matrix3<T>) -> Option<Matrix3<T>> {
    let (one, half) = (Matrix3::<T>::identity(), series::real::<T>(0.5));
    let (mut product, mut root) = (*a, *a);
    for _ in 0..40 {
        let near = (product - one).norm_squared() < series::real(1e-20);
        let inverse = product.try_inverse()?;
        root = root * (one + inverse) * half;
        product = (one + (product + inverse) * half) * half;
        if near {
            return Some(root);
        }
    }
    None
}

/// Principal logarithm by inverse scaling and squaring; not a number where there is none (negative eigenvalues).
fn log<T: RealField + Copy>(m: &Matrix3<T>) -> Matrix3<T> {
    let one = Matrix3::<T>::identity();
    let undefined = Matrix3::from_element(series::real(f64::NAN));
    let (mut root, mut factor) = (*m, T::one() + T::one());
    for _ in 0..64 {
        if (root - one).norm_squared() < series::real(0.04) {
            break;
        }
        let Some(next) = square_root(&root) else { return undefined };
        root = next;
        factor += factor;
    }
    // ln Y = 2 artanh((Y − 1)(Y + 1)⁻¹)
    let Some(inverse) = (root + one).try_inverse() else { return undefined };
    let z = (root - one) * inverse;
    let squared = z * z;
    let mut sum = Matrix3::zeros();
    for k in (0..11).rev() {
        sum = squared * sum + one * series::real::<T>(1.0 / f64::from(2 * k + 1));
    }
    z * sum * factor
}

/// A group of matrices with `N` generators.
trait Generated<T: RealField + Copy, const N: usize>: Sized {
    /// The element of the algebra with these coordinates.
    fn hat(d: &SVector<T, N>) -> Matrix3<T>;
    /// Its coordinates.
    fn vee(a: &Matrix3<T>) -> SVector<T, N>;

    /// Matrix of a linear map of the algebra to itself.
    fn linear(map: impl Fn(&Matrix3<T>) -> Matrix3<T>) -> SMatrix<T, N, N> {
        let mut m = SMatrix::<T, N, N>::zeros();
        for k in 0..N {
            let mut unit = SVector::zeros();
            unit[k] = T::one();
            m.set_column(k, &Self::vee(&map(&Self::hat(&unit))));
        }
        m
    }

    /// `φ(ad(d))`.
    fn integral(d: &SVector<T, N>) -> SMatrix<T, N, N> {
        let a = Self::hat(d);
        sim3::phi(&Self::linear(|e| a * e - e * a))
    }
}

/// An affine map of the plane, `x ↦ L x + b` with `det L > 0`.
///
/// Tangent order: translation (2), rotation (radians), logarithm of the scale, stretch along x against y, shear: the
/// matrix of a tangent vector is `[σ+κ  η−θ  v_x; η+θ  σ−κ  v_y; 0 0 0]`. A map without a real logarithm (half a turn
/// with a stretch) has no finite one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine2<T: RealField + Copy = f64> {
    /// Homogeneous matrix; the last row is `0 0 1`.
    pub matrix: Matrix3<T>,
}

/// A homography of the plane, as a matrix of determinant one.
///
/// Tangent order: that of [`Affine2`], then the two coordinates of the tilt (1 / unit of the plane): the matrix of a tangent
/// vector is `[σ/3+κ  η−θ  v_x; η+θ  σ/3−κ  v_y; p  q  −2σ/3]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SL3<T: RealField + Copy = f64> {
    /// Homogeneous matrix of determinant one.
    pub matrix: Matrix3<T>,
}

impl Affine2 {
    /// The map with the rows `a b c` and `d e f` of its matrix; `None` where it is not finite, mirrors or flattens.
    pub fn from_rows([a, b, c]: [f64; 3], [d, e, f]: [f64; 3]) -> Option<Self> {
        let determinant = a * e - b * d;
        let fits = determinant > 0.0 && determinant.is_finite() && c.is_finite() && f.is_finite();
        fits.then(|| Self { matrix: Matrix3::new(a, b, c, d, e, f, 0.0, 0.0, 1.0) })
    }
}

impl SL3 {
    /// The homography of a matrix of any factor; `None` where it is singular or not finite.
    pub fn from_matrix(matrix: &Matrix3<f64>) -> Option<Self> {
        let factor = crate::math::cbrt(matrix.determinant());
        let matrix = matrix / factor;
        (factor != 0.0 && crate::math::all_finite(matrix.as_slice())).then_some(Self { matrix })
    }

    /// The homography that maps four points to four points; `None` where three of them lie on a line.
    pub fn from_points(from: &[Point2<f64>; 4], to: &[Point2<f64>; 4]) -> Option<Self> {
        let basis = |p: &[Point2<f64>; 4]| {
            let columns = Matrix3::from_columns(&[0, 1, 2].map(|k| p[k].to_homogeneous()));
            let weights = columns.try_inverse()? * p[3].to_homogeneous();
            Some(columns * Matrix3::from_diagonal(&weights))
        };
        Self::from_matrix(&(basis(to)? * basis(from)?.try_inverse()?))
    }
}

impl<T: RealField + Copy> Generated<T, 6> for Affine2<T> {
    fn hat(d: &SVector<T, 6>) -> Matrix3<T> {
        let [x, y, turn, scale, stretch, shear] = (*d).into();
        let o = T::zero();
        Matrix3::new(scale + stretch, shear - turn, x, shear + turn, scale - stretch, y, o, o, o)
    }
    fn vee(a: &Matrix3<T>) -> SVector<T, 6> {
        let half: T = series::real(0.5);
        let (sum, difference) = (a.m11 + a.m22, a.m11 - a.m22);
        [a.m13, a.m23, (a.m21 - a.m12) * half, sum * half, difference * half, (a.m21 + a.m12) * half].into()
    }
}

impl<T: RealField + Copy> Generated<T, 8> for SL3<T> {
    fn hat(d: &SVector<T, 8>) -> Matrix3<T> {
        let mut a = Affine2::hat(&d.fixed_rows::<6>(0).into_owned());
        let excess = d[3] * series::real(2.0 / 3.0);
        (a.m11, a.m22, a.m33) = (a.m11 - excess, a.m22 - excess, -excess);
        (a.m31, a.m32) = (d[6], d[7]);
        a
    }
    fn vee(a: &Matrix3<T>) -> SVector<T, 8> {
        let d = Affine2::vee(a);
        [d[0], d[1], d[2], d[3] - a.m33, d[4], d[5], a.m31, a.m32].into()
    }
}

/// Group operations on the matrix; `$normalize` undoes the drift of products.
macro_rules! matrix_group {
    ($group:ident, $n:literal, |$m:ident| $normalize:expr) => {
        impl<T: RealField + Copy> LieGroup<T> for $group<T> {
            type Dim = Const<$n>;
            type Point = Point2<T>;
            type Over<U: RealField + Copy> = $group<U>;

            fn identity() -> Self {
                Self { matrix: Matrix3::identity() }
            }
            fn compose(&self, other: &Self) -> Self {
                let $m = self.matrix * other.matrix;
                Self { matrix: $normalize }
            }
            fn inverse(&self) -> Self {
                let undefined = Matrix3::from_element(series::real(f64::NAN));
                Self { matrix: self.matrix.try_inverse().unwrap_or(undefined) }
            }
            fn exp(d: &SVector<T, $n>) -> Self {
                Self { matrix: exp(&Self::hat(d)) }
            }
            fn log(&self) -> SVector<T, $n> {
                Self::vee(&log(&self.matrix))
            }
            fn act(&self, p: &Point2<T>) -> Point2<T> {
                let image = self.matrix * p.to_homogeneous();
                Point2::new(image.x / image.z, image.y / image.z)
            }
            fn adjoint(&self) -> SMatrix<T, $n, $n> {
                let inverse = self.inverse().matrix;
                Self::linear(|e| self.matrix * e * inverse)
            }
            fn left_jacobian(d: &SVector<T, $n>) -> SMatrix<T, $n, $n> {
                Self::integral(d)
            }
            fn left_jacobian_inverse(d: &SVector<T, $n>) -> SMatrix<T, $n, $n> {
                let undefined = SMatrix::from_element(series::real(f64::NAN));
                Self::integral(d).try_inverse().unwrap_or(undefined)
            }
        }
    };
}

matrix_group!(Affine2, 6, |m| m);
matrix_group!(SL3, 8, |m| m * ((series::real::<T>(4.0) - m.determinant()) * series::real(1.0 / 3.0)));

manifold_of_group!([] Affine2, Const<6>, |_x| Const,
    [("translation", 2), ("rotation", 1), ("log scale", 1), ("stretch", 1), ("shear", 1)],
    fn is_finite(&self) -> bool {
        crate::math::all_finite(self.matrix.as_slice())
    }
);
manifold_of_group!([] SL3, Const<8>, |_x| Const,
    [("translation", 2), ("rotation", 1), ("log scale", 1), ("stretch", 1), ("shear", 1), ("tilt", 2)],
    fn is_finite(&self) -> bool {
        crate::math::all_finite(self.matrix.as_slice())
    }
);
