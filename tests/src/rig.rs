//! The edge task on the sequences that ViSP ships, without the task language.
