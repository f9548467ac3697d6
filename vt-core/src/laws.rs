//! One harness of laws for manifolds, Lie groups, motion models, warps and measurements; yours too.
//!
//! Each macro makes a module of tests from a type or value and a strategy of cases:
//!
//! ```
//! use vt_core::{laws, lie::SE3, manifold_laws};
//! manifold_laws!(rigid_motions: laws::group::<SE3>(1.0));
//! # fn main() {}
//! ```
//!
//! | macro | what holds |
//! |---|---|
//! | [`crate::manifold_laws!`] | retraction and local coordinates are inverse; both Jacobians |
//! | [`crate::lie_group_laws!`] | group axioms, `Exp`, `Log`, `Ad`, action, all four Jacobians |
//! | [`crate::dynamics_laws!`] | `F`, `Q`, its root, no time, two steps are one |
//! | [`crate::warp_laws!`] | Jacobian of the projection, batch and single calls agree |
//! | [`crate::measurement_laws!`] | both forms of a measurement say the same |
//!
//! Jacobians meet two oracles: central differences of fourth order, and dual numbers through the same generic code
//! where there is some. A mismatch names the block, such as `translation/rotation` (row/column). Cases are drawn
//! from a fixed seed: a run repeats exactly. Every law is also a function, for use in tests of your own.

use core::fmt::Debug;

use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

pub use num_dual::Dual64;
pub use proptest;

mod damage;
mod derivative;
mod dynamics;
mod group;
mod manifold;
mod measurement;
mod warp;

pub use damage::{Damage, damage};
pub use derivative::{Blocks, block, compare, difference_jacobian, dual_jacobian};
pub use dynamics::{check_composition, check_dynamics};
pub use group::{Sample, check_group, group, lift};
pub use manifold::{check_manifold, tangent};
pub use measurement::{MeasurementTolerance, check_measurement};
pub use warp::check_warp;

/// Cases of each law.
pub const CASES: u32 = 32;

/// Sizes of tangent vectors: at the point, near it, at random, and near the border of the chart.
pub const SCALES: [f64; 5] = [0.0, 1e-8, 1e-3, 1.0, 1.7];

/// Runs `check` on [`CASES`] values of `strategy`, the same in every run.
///
/// # Panics
/// When a check panics; the message holds that of the check and the case.
pub fn for_each<S: Strategy>(strategy: S, check: impl Fn(S::Value))
where
    S::Value: Debug,
{
    for_cases(CASES, strategy, check);
}

/// As [`for_each`], with so many cases.
pub fn for_cases<S: Strategy>(cases: u32, strategy: S, check: impl Fn(S::Value))
where
    S::Value: Debug,
{
    let config = Config { cases, failure_persistence: None, max_shrink_iters: 32, ..Config::default() };
    let mut runner = TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha));
    let outcome = runner.run(&strategy, |value| {
        check(value);
        Ok(())
    });
    if let Err(error) = outcome {
        panic!("{error}");
    }
}

/// Tests that a space obeys the laws of [`crate::manifold::Manifold`]: `manifold_laws!(name: strategy)` with a
/// strategy of points; optionally `, tolerance = 1e-7`.
#[macro_export]
macro_rules! manifold_laws {
    ($name:ident: $points:expr $(, tolerance = $tolerance:expr)?) => {
        #[cfg(test)]
        mod $name {
            #[allow(unused_imports, reason = "the strategy may need nothing from outside")]
            use super::*;
            #[test]
            fn obeys_the_laws_of_a_manifold() {
                let tolerance = [$($tolerance,)? 1e-7][0];
                $crate::laws::for_each(
                    ($points, $crate::laws::proptest::prelude::any::<u64>()),
                    |(x, seed)| $crate::laws::check_manifold(&x, seed, tolerance),
                );
            }
        }
    };
}

/// Tests that a type obeys the laws of [`crate::lie::LieGroup`]: `lie_group_laws!(name: Type)`; optionally
/// `, tolerance = 1e-7`. Its points need [`Sample`].
#[macro_export]
macro_rules! lie_group_laws {
    ($name:ident: $group:ty $(, tolerance = $tolerance:expr)?) => {
        #[cfg(test)]
        mod $name {
            #[allow(unused_imports, reason = "the type may be a full path")]
            use super::*;
            #[test]
            fn obeys_the_laws_of_a_lie_group() {
                let tolerance = [$($tolerance,)? 1e-7][0];
                $crate::laws::for_each($crate::laws::proptest::prelude::any::<u64>(), |seed| {
                    $crate::laws::check_group::<$group>(seed, tolerance)
                });
            }
        }
    };
}

/// Tests that a model obeys the laws of [`crate::agent::Dynamics`]: `dynamics_laws!(name: model, states)` with a
/// strategy of states; optionally `, tolerance = 1e-7`, `, composes = 1e-9` (two half steps of at most 0.1 s against
/// one, relative; absent: not checked), and `, dual = f` with `f(&state, Seconds, &[Dual64]) -> Vec<Dual64>`, the
/// local coordinates of the propagated perturbed state from the propagated state.
#[macro_export]
macro_rules! dynamics_laws {
    ($name:ident: $model:expr, $states:expr
        $(, tolerance = $tolerance:expr)? $(, composes = $composes:expr)? $(, dual = $dual:expr)?) => {
        #[cfg(test)]
        mod $name {
            #[allow(unused_imports, reason = "model and strategy may need nothing from outside")]
            use super::*;
            #[test]
            fn obeys_the_laws_of_dynamics() {
                let (model, tolerance) = ($model, [$($tolerance,)? 1e-7][0]);
                $crate::laws::for_each($states, |state| {
                    $crate::laws::check_dynamics(&model, &state, tolerance);
                    $($crate::laws::check_composition(&model, &state, $composes);)?
                    $(for dt in [-0.1, 0.0, 0.1, 1.0] {
                        let dt = $crate::time::Seconds(dt);
                        let blocks = $crate::manifold::Manifold::blocks(&state);
                        let found = $crate::agent::Dynamics::jacobian(&model, &state, dt);
                        let size = found.nrows();
                        let expected = $crate::laws::dual_jacobian(size, size, |e| $dual(&state, dt, e));
                        let found = $crate::laws::block(&found);
                        $crate::laws::compare("F against dual numbers", &blocks, &blocks, &found, &expected, tolerance);
                    })?
                });
            }
        }
    };
}

/// Tests that a warp obeys the laws of [`crate::agent::Warp`]: `warp_laws!(name: warp, poses, bodies)` with
/// strategies of poses and of lists of body points; optionally `, tolerance = 1e-6` (relative), and `, dual = f` with
/// `f(&warp, &pose, &body, &[Dual64]) -> Option<[Dual64; 2]>`, the image point under the perturbed pose.
#[macro_export]
macro_rules! warp_laws {
    ($name:ident: $warp:expr, $poses:expr, $bodies:expr $(, tolerance = $tolerance:expr)? $(, dual = $dual:expr)?) => {
        #[cfg(test)]
        mod $name {
            #[allow(unused_imports, reason = "warp and strategies may need nothing from outside")]
            use super::*;
            #[test]
            fn obeys_the_laws_of_a_warp() {
                let (warp, tolerance) = ($warp, [$($tolerance,)? 1e-6][0]);
                let seen = ::core::cell::Cell::new(0);
                $crate::laws::for_each(($poses, $bodies), |(pose, bodies)| {
                    seen.set(seen.get() + $crate::laws::check_warp(&warp, &pose, &bodies, tolerance));
                    $(
                        let posed = $crate::agent::Warp::at(&warp, &pose);
                        for body in &bodies {
                            let Some((_, found)) = $crate::agent::Posed::linearize(&posed, body) else { continue };
                            let expected = $crate::laws::dual_jacobian(2, found.ncols(), |e| {
                                let image = $dual(&warp, &pose, body, e);
                                image.expect("the dual form projects what the warp projects").to_vec()
                            });
                            let rows = vec![("image x".to_string(), 1), ("image y".to_string(), 1)];
                            let columns = $crate::manifold::Manifold::blocks(&pose);
                            let found = $crate::laws::block(&found);
                            let what = "Jacobian of the warp against dual numbers";
                            $crate::laws::compare(what, &rows, &columns, &found, &expected, tolerance);
                        }
                    )?
                });
                assert!(seen.get() > 0, "no body point could be projected in any case: the laws were not tested");
            }
        }
    };
}

/// Tests that a measurement obeys duality: `measurement_laws!(name: measurement, poses)` with a strategy of poses near
/// and far; optionally `, tolerance = MeasurementTolerance { .. }`.
#[macro_export]
macro_rules! measurement_laws {
    ($name:ident: $measurement:expr, $poses:expr $(, tolerance = $tolerance:expr)?) => {
        #[cfg(test)]
        mod $name {
            #[allow(unused_imports, reason = "measurement and strategy may need nothing from outside")]
            use super::*;
            #[test]
            fn obeys_the_laws_of_a_measurement() {
                let measurement = $measurement;
                let tolerance = [$($tolerance,)? $crate::laws::MeasurementTolerance::default()][0];
                $crate::laws::for_each($poses, |pose| {
                    $crate::laws::check_measurement(&measurement, &pose, tolerance);
                });
            }
        }
    };
}
