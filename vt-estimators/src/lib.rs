//! Bayesian estimators on manifolds.
pub mod kalman;
pub mod map;
