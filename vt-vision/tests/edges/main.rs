//! The edge modality on pictures whose pose is known.

mod accuracy;
mod duality;
mod failures;
mod observability;
mod scene;
mod search;
mod shapes;
