//! What a task notes for the trace and the flight recorder, beside its flags and values.

use heapless::Vec;

use crate::features::BEHAVIOURS;
use esm_link::black_box::Event;

/// How much a task can note in one execution: what the owner of the list of behaviours does at
/// most, which is four changes of the list, the two situations that behaviours have beside them,
/// three situations of each of eight, and where the robot is, which takes two.
pub(crate) const MAX_NOTES: usize = 4 + 2 + 3 * 8 + 2;

/// What a task has noted in its last execution. A firmware without behaviours has no room for it.
#[derive(Debug)]
pub(crate) struct Notes([Vec<Event, MAX_NOTES>; BEHAVIOURS as usize]);

impl Notes {
    /// Nothing.
    pub(crate) const EMPTY: Self = Self([const { Vec::new() }; BEHAVIOURS as usize]);

    /// One more. False where there is no room.
    pub(crate) fn push(&mut self, event: Event) -> bool {
        let notes = self.0.first_mut();
        notes.is_some_and(|notes| notes.push(event).is_ok())
    }

    /// The one of this number.
    pub(crate) fn get(&self, index: usize) -> Option<Event> {
        self.0.first()?.get(index).copied()
    }

    /// Whether there are any.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.iter().all(Vec::is_empty)
    }

    /// Nothing any more.
    pub(crate) fn clear(&mut self) {
        self.0.iter_mut().for_each(Vec::clear);
    }
}
