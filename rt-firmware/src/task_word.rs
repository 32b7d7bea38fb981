//! A word that says which task a slot executes, for whoever ends the firmware meanwhile.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Stands for no task.
pub(crate) const NO_TASK: u32 = u32::MAX;

/// The task instance that is executed, or [`NO_TASK`].
pub(crate) struct TaskWord(AtomicU32);

impl TaskWord {
    /// As power-on leaves it.
    pub(crate) const fn new() -> Self {
        TaskWord(AtomicU32::new(0))
    }

    /// A slot begins with this task.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn begin(&self, task_instance: u16) {
        self.0.store(task_instance.into(), Relaxed);
    }

    /// The slot is done with it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn end(&self) {
        self.0.store(NO_TASK, Relaxed);
    }

    /// The task that was begun and is not at its end.
    pub(crate) fn under_way(&self) -> Option<u16> {
        u16::try_from(self.0.load(Relaxed)).ok()
    }
}
