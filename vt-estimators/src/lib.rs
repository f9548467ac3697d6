//! Bayesian estimators on manifolds.
pub mod association;
pub mod kalman;
pub mod map;
