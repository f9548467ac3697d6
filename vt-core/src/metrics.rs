//! How good estimates are, against truth.

mod boxes;
mod consistency;
mod pose;

pub use boxes::{Rectangle, success_auc, success_rate};
pub use consistency::{Consistency, mean_chi_square_interval};
pub use pose::{PoseError, add, add_s, area_under_errors, share_below};
