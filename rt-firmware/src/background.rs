//! The background side: runs tasks of slot 0 in the time that is left.

use core::sync::atomic::Ordering;

use heapless::spsc::{Consumer, Producer};

use crate::ports::Job;
use crate::supervision::Signs;
use crate::task::Step;

/// Runs slot-0 tasks, one at a time, preempted by every slot. A board polls it from its idle loop.
pub struct Background<'q, 'm> {
    pub(crate) jobs: Consumer<'q, &'m mut Option<Job<'m>>>,
    pub(crate) ended: Producer<'q, &'m mut Option<Job<'m>>>,
    pub(crate) current: Option<&'m mut Option<Job<'m>>>,
    pub(crate) signs: &'m Signs,
}

impl Background<'_, '_> {
    /// Does one step of the current run, or of the next one. Returns false if there is nothing to
    /// do: time to sleep until an interrupt.
    pub fn poll(&mut self) -> bool {
        self.signs.slot_0.store(true, Ordering::Relaxed);
        let Some(place) = self.current.take().or_else(|| self.jobs.dequeue()) else {
            return false;
        };
        let ended = place
            .as_mut()
            .is_none_or(|job| job.step() == Step::Finished);
        // There is one job, so that there is room for it.
        self.current = if ended {
            self.ended.enqueue(place).err()
        } else {
            Some(place)
        };
        true
    }

    /// Whether a run is under way, or waits to be begun.
    pub fn is_busy(&self) -> bool {
        self.current.is_some() || self.jobs.ready()
    }
}
