//! What every estimator must do, against closed forms, batch solutions and simulated truth.

mod assignment;
mod consistency;
mod forms;
mod honesty;
mod linear;
mod loose_and_tight;
mod particle_consistency;
mod particle_methods;
mod particle_reach;
mod particles;
mod posterior;
mod prediction;
mod problems;
mod several;
mod sizes;
