//! Many rigid motions at once, as one after the other.
//!
//! Where all rotations of a batch are small the closed forms are polynomials without a branch, and the loops over lanes
//! become vector instructions; elsewhere each motion is computed for itself.

use nalgebra::{Quaternion, UnitQuaternion, Vector3, Vector6};

use super::SE3;
use crate::batch::{LANES, Row, vectorized, with_rows};
use crate::lie::series;
use crate::manifold::Manifold;

/// Translation and quaternion `i j k w`, a row each.
type Rows = [Row; 7];

/// Coordinates of all points, row by row.
#[inline(always)]
fn load(rows: &mut Rows, n: usize, mut point: impl FnMut(usize) -> SE3) {
    for first in (0..n).step_by(8) {
        let mut block = [[0.0; 8]; 7];
        for k in 0..8 {
            let SE3 { rotation: q, translation: t } = point((first + k).min(n - 1));
            for (row, v) in block.iter_mut().zip([t.x, t.y, t.z, q.i, q.j, q.k, q.w]) {
                row[k] = v;
            }
        }
        rows.iter_mut().zip(&block).for_each(|(row, block)| row[first..first + 8].copy_from_slice(block));
    }
}

/// [`Manifold::retract_each`].
pub(super) fn retract<S>(states: &mut [S], point: impl Fn(&mut S) -> &mut SE3, d: &[Row]) {
    let n = states.len().min(LANES);
    let (steps, _) = d.as_chunks::<6>();
    let small = |d: &[Row; 6]| (0..n).all(|k| series::is_small_rotation([d[3][k], d[4][k], d[5][k]]));
    if !steps.iter().all(small) {
        for (k, state) in states.iter_mut().enumerate() {
            let x = point(state);
            steps.iter().for_each(|d| *x = x.retract(&Vector6::from_fn(|r, _| d[r][k])));
        }
        return;
    }
    with_coordinates(|rows| {
        load(rows, n, |k| *point(&mut states[k]));
        vectorized(
            #[inline(always)]
            || steps.iter().for_each(|d| compose_exp(rows, d)),
        );
        for (k, state) in states.iter_mut().enumerate() {
            let [x, y, z, i, j, l, w] = core::array::from_fn(|r| rows[r][k]);
            let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, l));
            *point(state) = SE3 { rotation, translation: Vector3::new(x, y, z) };
        }
    });
}

/// Rows with any content.
fn with_coordinates(use_them: impl FnOnce(&mut Rows)) {
    with_rows(7, |rows| {
        if let Ok(rows) = <&mut Rows>::try_from(rows) {
            use_them(rows);
        }
    });
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `x ← x · Exp(d)` for small rotations.
#[inline(always)]
fn compose_exp(x: &mut Rows, d: &[Row; 6]) {
    for k in 0..LANES {
        let [t, q] = [[x[0][k], x[1][k], x[2][k]], [x[3][k], x[4][k], x[5][k]]];
        let (v, w) = ([d[0][k], d[1][k], d[2][k]], [d[3][k], d[4][k], d[5][k]]);
        let (e, a, b) = series::small_rotation_exp(w);
        let wv = cross(w, v);
        let wwv = cross(w, wv);
        let step: [f64; 3] = core::array::from_fn(|r| v[r] + wv[r] * a + wwv[r] * b);
        let turned = series::rotate([q[0], q[1], q[2], x[6][k]], step);
        let q = series::quaternion_product([q[0], q[1], q[2], x[6][k]], e);
        for r in 0..3 {
            x[r][k] = turned[r] + t[r];
        }
        for r in 0..4 {
            x[3 + r][k] = q[r];
        }
    }
}

/// [`Manifold::local_each`].
pub(super) fn local(at: &SE3, points: &[SE3], out: &mut [Row]) {
    let Ok(out) = <&mut [Row; 6]>::try_from(out.get_mut(..6).unwrap_or_default()) else { return };
    let (q, t) = (&at.rotation, &at.translation);
    let inverse = [-q.i, -q.j, -q.k, q.w];
    let shift = series::rotate(inverse, [t.x, t.y, t.z]).map(|v| -v);
    let mut small = false;
    with_coordinates(|rows| {
        load(rows, points.len().min(LANES), |k| points[k]);
        small = vectorized(
            #[inline(always)]
            || log_relative(inverse, shift, rows, points.len(), out),
        );
    });
    for (k, x) in points.iter().take(LANES).enumerate().filter(|_| !small) {
        let d = at.local(x);
        out.iter_mut().zip(&d).for_each(|(row, v)| row[k] = *v);
    }
    out.iter_mut().for_each(|row| row[points.len()..].fill(0.0));
}

/// `Log(a · x)` of the first `n` lanes with the rotation and translation of `a`; false where a rotation is not small and the
/// result void.
#[inline(always)]
fn log_relative(rotation: [f64; 4], translation: [f64; 3], x: &Rows, n: usize, out: &mut [Row; 6]) -> bool {
    let mut sines = [0.0; LANES];
    for k in 0..LANES {
        let moved = series::rotate(rotation, [x[0][k], x[1][k], x[2][k]]);
        let t: [f64; 3] = core::array::from_fn(|r| moved[r] + translation[r]);
        let q = series::quaternion_product(rotation, [x[3][k], x[4][k], x[5][k], x[6][k]]);
        let (w, sine) = series::small_rotation_log(q);
        sines[k] = sine;
        let wt = cross(w, t);
        let wwt = cross(w, wt);
        let e = series::small_inverse_coefficient(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
        for r in 0..3 {
            out[r][k] = t[r] - wt[r] * 0.5 + wwt[r] * e;
            out[3 + r][k] = w[r];
        }
    }
    sines.iter().take(n).all(|s| *s < series::SMALL_SINE)
}

/// [`Manifold::centre`]: means of positions and of quaternions on the side of the first.
pub(super) fn centre(points: &[SE3], weights: &[f64]) -> Option<SE3> {
    let first = points.first()?.rotation.coords;
    let (mut t, mut q, mut total) = (Vector3::zeros(), first * 0.0, 0.0);
    for (x, w) in points.iter().zip(weights) {
        t += x.translation * *w;
        q += x.rotation.coords * w.copysign(x.rotation.coords.dot(&first));
        total += w;
    }
    let rotation = UnitQuaternion::try_new(Quaternion::from(q), 1e-3 * total)?;
    Some(SE3 { rotation, translation: t / total })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lie::LieGroup;
    use crate::random::{Random, Stream};

    #[test]
    fn the_centre_is_near_the_mean() {
        let mut random = Random::new(6, Stream::Sim, 0, 0, 0);
        for scale in [0.01, 0.3] {
            let at = SE3::exp(&Vector6::from_fn(|_, _| random.normal()));
            let points: Vec<_> =
                (0..50).map(|_| at.retract(&Vector6::from_fn(|_, _| scale * random.normal()))).collect();
            let weights: Vec<_> = (0..50).map(|_| random.uniform()).collect();
            let (centre, mean) = (SE3::centre(&points, &weights), SE3::mean(&points, &weights));
            let off = centre.expect("points").local(&mean.expect("points")).norm();
            assert!(off < 2.0 * scale * scale, "{off} at {scale}");
        }
        assert_eq!(SE3::centre(&[], &[]), None);
        assert_eq!(SE3::centre(&[SE3::identity()], &[0.0]), None);
    }

    /// Small and large rotations, full and partial batches.
    #[test]
    fn batches_are_the_single_motions() {
        let mut random = Random::new(5, Stream::Sim, 0, 0, 0);
        for (count, angle) in [(LANES, 0.03), (LANES, 0.5), (17, 0.05), (1, 3.0), (40, 2.0), (0, 1.0)] {
            let mut motion = |scale: f64| {
                let mut tangent =
                    || Vector6::from_fn(|r, _| random.normal() * if r < 3 { 1.0 } else { scale });
                (SE3::exp(&tangent()), tangent())
            };
            let (at, _) = motion(1.0);
            let steps: Vec<Vector6<f64>> = (0..count).map(|_| motion(angle).1).collect();
            let near: Vec<SE3> = steps.iter().map(|d| at.retract(d)).collect();
            let mut rows = [[f64::NAN; LANES]; 6];
            for (k, d) in steps.iter().enumerate() {
                rows.iter_mut().zip(d).for_each(|(row, v)| row[k] = *v);
            }
            let mut moved = vec![at; count];
            SE3::retract_each(&mut moved, |x| x, &rows);
            SE3::retract_each(&mut moved, |x| x, &[rows, rows].concat()[6..]);
            let near: Vec<SE3> = steps.iter().zip(&near).map(|(d, x)| x.retract(d)).collect();
            let bits = |x: &SE3| [x.translation.as_slice(), x.rotation.coords.as_slice()].concat();
            for (a, b) in moved.iter().zip(&near) {
                assert_eq!(bits(a), bits(b));
            }
            at.local_each(&near, &mut rows);
            for (k, x) in near.iter().enumerate() {
                let d = at.local(x);
                let size = 1e-15 * (1.0 + at.translation.norm() + x.translation.norm() + d.norm());
                assert!((0..6).all(|r| (rows[r][k] - d[r]).abs() < size), "{k} of {count}: {d}");
            }
            assert!(rows.iter().all(|row| row[count..].iter().all(|v| *v == 0.0)));
        }
    }
}
