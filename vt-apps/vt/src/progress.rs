//! A progress bar with frames per second and the state of the targets.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::run::Progress;

/// A bar on stderr; it draws nothing when stderr is no terminal or `quiet` is wanted.
pub struct Bar {
    bar: ProgressBar,
}

impl Bar {
    /// A bar.
    pub fn new(quiet: bool) -> Self {
        let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(None, target);
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {pos}/{len} frames  {per_sec}  {msg}") {
            bar.set_style(style);
        }
        Self { bar }
    }

    /// Shows a step.
    pub fn show(&self, progress: &Progress<'_>) {
        self.show_of("", progress);
    }

    /// Shows a step of a sequence.
    pub fn show_of(&self, sequence: &str, progress: &Progress<'_>) {
        if let Some(total) = progress.total {
            self.bar.set_length(total as u64);
        }
        self.bar.set_position(progress.steps as u64);
        if !self.bar.is_hidden() {
            let states = progress.reports.iter().map(|r| format!("{} {}", r.target, r.verdict.status.name()));
            self.bar.set_message(format!("{sequence} {}", states.collect::<Vec<_>>().join(", ")));
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
