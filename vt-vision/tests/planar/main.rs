//! Flat targets in simulated pictures: both forms of every measurement agree, and each leads a nearby start to the truth.

mod adaptation;
mod convergence;
mod duality;
mod mass;
mod outline_search;
mod scene;
mod search;
