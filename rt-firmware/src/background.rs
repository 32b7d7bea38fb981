//! The background side: runs tasks of slot 0 in the time that is left.

use core::sync::atomic::Ordering;

use heapless::spsc::{Consumer, Producer};

use crate::heartbeats::Heartbeats;
use crate::ports::BackgroundRun;
use crate::task::Step;

/// Runs background tasks, one at a time, preempted by every slot. A board polls it from its idle
/// loop.
pub struct Background<'q, 'm> {
    pub(crate) background_runs: Consumer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(crate) ended: Producer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(crate) current: Option<&'m mut Option<BackgroundRun<'m>>>,
    pub(crate) heartbeats: &'m Heartbeats,
}

impl Background<'_, '_> {
    /// Does one step of the current run, or of the next one. Returns false if there is nothing to
    /// do: time to sleep until an interrupt.
    pub fn poll(&mut self) -> bool {
        self.heartbeats.background.store(true, Ordering::Relaxed);
        let Some(place) = self
            .current
            .take()
            .or_else(|| self.background_runs.dequeue())
        else {
            return false;
        };
        let ended = place
            .as_mut()
            .is_none_or(|background_run| background_run.step() == Step::Finished);
        // There is one background run, so that there is room for it.
        self.current = if ended {
            let refused = self.ended.enqueue(place).err();
            self.heartbeats.attention.set();
            refused
        } else {
            Some(place)
        };
        true
    }

    /// Whether a run is under way, or waits to be begun.
    pub fn is_busy(&self) -> bool {
        self.current.is_some() || self.background_runs.ready()
    }
}
