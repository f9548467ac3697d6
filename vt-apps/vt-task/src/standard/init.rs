//! Priors of the first frame.
