//! What a task notes for the trace and the flight recorder, beside its flags and values.

use heapless::Vec;

use crate::features::NOTES;
use esm_link::black_box::Event;

/// How much a task can note in one execution: the owner of the list of behaviours notes at most
/// nine situations and four changes of the list, or where the robot is, which takes two. Of more
/// situations that come up at once the last are not told.
pub(crate) const MAX_NOTES: usize = 9 + 4;

/// What a task has noted in its last execution. A firmware that tells nothing of behaviours
/// has no room for it.
#[derive(Debug)]
pub(crate) struct Notes([Vec<Event, MAX_NOTES>; NOTES as usize]);

impl Notes {
    /// Nothing.
    pub(crate) const EMPTY: Self = Self([const { Vec::new() }; NOTES as usize]);

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
