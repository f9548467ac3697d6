//! Evidence that a measurement may keep.

use std::sync::Arc;

/// Two buffers that take turns: what was made of a frame stays as it is while the next frame is processed, and so a
/// measurement keeps it without a copy.
#[derive(Clone, Debug, Default)]
pub struct Turns<T> {
    now: Arc<T>,
    spare: Arc<T>,
}

impl<T: Clone> Turns<T> {
    /// What was made last.
    pub fn now(&self) -> &Arc<T> {
        &self.now
    }

    /// The other buffer, to be filled; it is what was made last from here on.
    pub fn turn(&mut self) -> &mut T {
        core::mem::swap(&mut self.now, &mut self.spare);
        Arc::make_mut(&mut self.now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_does_not_change_and_buffers_come_back() {
        let mut turns = Turns::<Vec<u8>>::default();
        *turns.turn() = vec![1];
        let kept = turns.now().clone();
        *turns.turn() = vec![2];
        assert_eq!((&kept[..], &turns.now()[..]), (&[1][..], &[2][..]));
        drop(kept);
        assert_eq!(turns.turn(), &[1]);
    }
}
