//! Standard coordinates of the groups, for files and reports.

use nalgebra::{DVector, Matrix3, Quaternion, SVector, UnitQuaternion, Vector3};

use super::{Affine2, DynVector, SE2, SE3, SL3, SO2, SO3, Sim2, Sim3, TranslationScale, Vector};
use crate::manifold::Coordinates;

/// Exactly `N` finite numbers.
fn finite<const N: usize>(c: &[f64]) -> Option<[f64; N]> {
    let c: [f64; N] = c.try_into().ok()?;
    c.iter().all(|v| v.is_finite()).then_some(c)
}

fn write_quaternion(q: &UnitQuaternion<f64>, out: &mut Vec<f64>) {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    out.extend([q.i, q.j, q.k, q.w].map(|v| v * sign));
}

/// Any multiple of a unit quaternion `x y z w`; `None` for zero.
fn read_quaternion(c: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let largest = c.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if largest == 0.0 {
        return None;
    }
    let [x, y, z, w] = c.map(|v| v / largest);
    Some(UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)))
}

/// `angle`, radians.
impl Coordinates for SO2 {
    const SPACE: &'static str = "so2";
    fn write(&self, out: &mut Vec<f64>) {
        out.push(self.angle());
    }
    fn read(c: &[f64]) -> Option<Self> {
        finite::<1>(c).map(|[angle]| Self::from_angle(angle))
    }
}

/// `x y angle`.
impl Coordinates for SE2 {
    const SPACE: &'static str = "se2";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend([self.translation.x, self.translation.y, self.angle()]);
    }
    fn read(c: &[f64]) -> Option<Self> {
        finite::<3>(c).map(|[x, y, angle]| Self::new(x, y, angle))
    }
}

/// `x y scale`, scale positive.
impl Coordinates for TranslationScale {
    const SPACE: &'static str = "translation-scale";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend([self.translation.x, self.translation.y, self.scale]);
    }
    fn read(c: &[f64]) -> Option<Self> {
        finite::<3>(c).filter(|c| c[2] > 0.0).map(|[x, y, scale]| Self::new(x, y, scale))
    }
}

/// `x y angle scale`, radians, scale positive.
impl Coordinates for Sim2 {
    const SPACE: &'static str = "sim2";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend([self.translation.x, self.translation.y, self.angle(), self.scale]);
    }
    fn read(c: &[f64]) -> Option<Self> {
        finite::<4>(c).filter(|c| c[3] > 0.0).map(|[x, y, angle, scale]| Self::new(x, y, angle, scale))
    }
}

/// The first two rows of the matrix, one after the other; determinant positive.
impl Coordinates for Affine2 {
    const SPACE: &'static str = "affine2";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend((0..6).map(|k| self.matrix[(k / 3, k % 3)]));
    }
    fn read(c: &[f64]) -> Option<Self> {
        let [a, b, c, d, e, f] = finite(c)?;
        Self::from_rows([a, b, c], [d, e, f])
    }
}

/// The rows of the matrix, one after the other; brought to determinant one when read.
impl Coordinates for SL3 {
    const SPACE: &'static str = "sl3";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend((0..9).map(|k| self.matrix[(k / 3, k % 3)]));
    }
    fn read(c: &[f64]) -> Option<Self> {
        Self::from_matrix(&Matrix3::from_row_slice(&finite::<9>(c)?))
    }
}

/// `qx qy qz qw` with `qw ≥ 0`; normalised when read.
impl Coordinates for SO3 {
    const SPACE: &'static str = "so3";
    fn write(&self, out: &mut Vec<f64>) {
        write_quaternion(&self.rotation, out);
    }
    fn read(c: &[f64]) -> Option<Self> {
        Some(Self { rotation: read_quaternion(finite(c)?)? })
    }
}

/// `tx ty tz qx qy qz qw` with `qw ≥ 0`; normalised when read.
impl Coordinates for SE3 {
    const SPACE: &'static str = "se3";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend(self.translation.iter());
        write_quaternion(&self.rotation, out);
    }
    fn read(c: &[f64]) -> Option<Self> {
        let [tx, ty, tz, qx, qy, qz, qw] = finite(c)?;
        Some(Self { rotation: read_quaternion([qx, qy, qz, qw])?, translation: Vector3::new(tx, ty, tz) })
    }
}

/// `tx ty tz qx qy qz qw scale`, scale positive.
impl Coordinates for Sim3 {
    const SPACE: &'static str = "sim3";
    fn write(&self, out: &mut Vec<f64>) {
        out.extend(self.translation.iter());
        write_quaternion(&self.rotation, out);
        out.push(self.scale);
    }
    fn read(c: &[f64]) -> Option<Self> {
        let (&scale, rigid) = c.split_last()?;
        let SE3 { rotation, translation } = SE3::read(rigid)?;
        (scale.is_finite() && scale > 0.0).then_some(Self { rotation, translation, scale })
    }
}

/// Names of the spaces of vectors by their dimension; the first is that of dimensions which are not known at compile time, or
/// too large.
const VECTORS: [&str; 17] = [
    "vector", "vector1", "vector2", "vector3", "vector4", "vector5", "vector6", "vector7", "vector8",
    "vector9", "vector10", "vector11", "vector12", "vector13", "vector14", "vector15", "vector16",
];

/// The components.
impl<const N: usize> Coordinates for Vector<N> {
    const SPACE: &'static str = VECTORS[if N < VECTORS.len() { N } else { 0 }];
    fn write(&self, out: &mut Vec<f64>) {
        out.extend(self.0.iter());
    }
    fn read(c: &[f64]) -> Option<Self> {
        finite::<N>(c).map(|c| Self(SVector::from(c)))
    }
}

/// The components.
impl Coordinates for DynVector {
    const SPACE: &'static str = VECTORS[0];
    fn write(&self, out: &mut Vec<f64>) {
        out.extend(self.0.iter());
    }
    fn read(c: &[f64]) -> Option<Self> {
        c.iter().all(|v| v.is_finite()).then(|| Self(DVector::from_column_slice(c)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_of_different_sizes_are_different_spaces() {
        assert_eq!(Vector::<2>::SPACE, "vector2");
        assert_eq!(Vector::<16>::SPACE, "vector16");
        assert_eq!([DynVector::SPACE, Vector::<17>::SPACE], ["vector"; 2]);
        for (n, name) in VECTORS.iter().enumerate().skip(1) {
            assert_eq!(*name, format!("vector{n}"));
        }
    }
}
