//! Direct alignment on pictures that are known everywhere: how far away it may start, what light and occluders do to it,
//! whether its covariance is honest, and what it refuses.

mod consistency;
mod convergence;
mod light;
mod refusals;
mod scene;
