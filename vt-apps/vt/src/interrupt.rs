//! Ctrl-C ends a run after the current step, with complete outputs; a second one ends the program at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a program that was ended by Ctrl-C, by the convention of shells.
pub const INTERRUPTED: u8 = 130;

/// A flag that the first Ctrl-C sets.
///
/// # Errors
/// When the system refuses the handler, or when there is one already.
pub fn flag() -> Result<Arc<AtomicBool>, ctrlc::Error> {
    let flag = Arc::new(AtomicBool::new(false));
    let seen = flag.clone();
    ctrlc::set_handler(move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(INTERRUPTED.into());
        }
    })?;
    Ok(flag)
}
