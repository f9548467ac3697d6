//! Bayesian estimators on manifolds.
pub mod association;
pub mod kalman;
pub mod map;
pub mod particle;
pub mod resampling;
