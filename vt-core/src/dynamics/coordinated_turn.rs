//! Coordinated turn in the plane with an unknown rate.

use nalgebra::{Matrix5, Vector2, Vector3, Vector5};

use super::noise::{check_density, driven_noise_in};
use crate::agent::Dynamics;
use crate::error::ConfigError;
use crate::lie::Vector;
use crate::math;
use crate::time::Seconds;

/// State `x, y` (m), `ẋ, ẏ` (m/s), turn rate `ω` (rad/s): the velocity turns at the rate `ω`, with continuous white noise
/// on acceleration and turn rate (Bar-Shalom, Li, Kirubarajan 2001, §11.7).
///
/// `ω = 0` is no special case: `sin(ωΔ)/ω` and its kin are summed as series near it. Path and `F` compose exactly; `Q` is
/// their noise integral (Gauss–Legendre of five points on parts of at most half a radian). A body that turns with its path
/// is [`super::ConstantVelocity`] on SE(2), which needs no such model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoordinatedTurn {
    density: Vector3<f64>,
}

/// `sin θ/θ`, `(1 − cos θ)/θ` and their derivatives.
fn turn(theta: f64) -> [f64; 4] {
    if theta.abs() < 1.0 {
        let x = -theta * theta;
        let [mut s, mut c, mut ds, mut dc] = [0.0; 4];
        // (−θ²)^k / (2k+1)!, with the derivatives of θ^(2k) and θ^(2k+1).
        let mut term = 1.0;
        for k in 0..12 {
            let k2 = 2.0 * f64::from(k);
            s += term;
            let next = term / (k2 + 2.0);
            c += next;
            dc += (k2 + 1.0) * next;
            // d/dθ of the next term of s.
            let after = -next / (k2 + 3.0);
            ds += (k2 + 2.0) * after;
            term = x * next / (k2 + 3.0);
        }
        return [s, c * theta, ds * theta, dc];
    }
    let (sin, cos) = math::sin_cos(theta);
    let (s, c) = (sin / theta, (1.0 - cos) / theta);
    [s, c, (cos - s) / theta, (sin - c) / theta]
}

impl CoordinatedTurn {
    /// Spectral densities of the acceleration (m²/s³, each axis) and of the turn's acceleration (rad²/s³).
    ///
    /// # Errors
    /// When one is negative or not finite.
    pub fn new(acceleration: f64, turn: f64) -> Result<Self, ConfigError> {
        Ok(Self { density: check_density(Vector3::new(acceleration, acceleration, turn))? })
    }
}

impl Dynamics<Vector<5>> for CoordinatedTurn {
    fn propagate(&self, state: &Vector<5>, Seconds(dt): Seconds) -> Vector<5> {
        let [x, y, vx, vy, rate] = state.0.into();
        let [s, c, ..] = turn(rate * dt);
        let (sin, cos) = math::sin_cos(rate * dt);
        let path = Vector2::new(s * vx - c * vy, c * vx + s * vy) * dt;
        Vector(Vector5::new(x + path.x, y + path.y, cos * vx - sin * vy, sin * vx + cos * vy, rate))
    }

    fn jacobian(&self, state: &Vector<5>, Seconds(dt): Seconds) -> Matrix5<f64> {
        let [_, _, vx, vy, rate] = state.0.into();
        let [s, c, ds, dc] = turn(rate * dt);
        let (sin, cos) = math::sin_cos(rate * dt);
        let (s, c, square) = (s * dt, c * dt, dt * dt);
        Matrix5::from_row_slice(&[
            1.0,
            0.0,
            s,
            -c,
            (ds * vx - dc * vy) * square,
            0.0,
            1.0,
            c,
            s,
            (dc * vx + ds * vy) * square,
            0.0,
            0.0,
            cos,
            -sin,
            (-sin * vx - cos * vy) * dt,
            0.0,
            0.0,
            sin,
            cos,
            (cos * vx - sin * vy) * dt,
            0.0,
            0.0,
            0.0,
            0.0,
            1.0,
        ])
    }

    fn noise(&self, state: &Vector<5>, dt: Seconds) -> Matrix5<f64> {
        driven_noise_in(super::parts_of(state.0[4].abs(), dt), self, state, dt, self.density.as_slice())
    }
}
