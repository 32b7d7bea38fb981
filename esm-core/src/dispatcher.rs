//! Which slot runs when: a binary heap of slots, ordered by their next nominal start.
//!
//! Times are whole microseconds since the epoch of the schedule, 64 bits wide, and every start is the one before plus the period:
//! nothing drifts and no counter wraps in the life of a robot. Taking an occurrence costs a number of comparisons
//! logarithmic in the number of slots; no table is as long as the hyperperiod.

use crate::tables::Slot;

/// One nominal start of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Occurrence {
    /// Index of the slot in the blob.
    pub slot: usize,
    /// Nominal start in microseconds since the epoch.
    pub start_us: u64,
    /// How many occurrences of the slot came before, missed ones included.
    pub index: u64,
}

/// Why a dispatcher could not be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DispatcherError {
    /// The schedule has more slots than this dispatcher can hold.
    TooManySlots {
        /// Slots of the schedule.
        slots: usize,
        /// Slots that fit.
        capacity: usize,
    },
    /// There is nothing to dispatch.
    NoSlots,
    /// A slot has the period 0.
    ZeroPeriod {
        /// Index of the slot.
        slot: usize,
    },
}

/// What is kept for a slot.
#[derive(Clone, Copy, Debug, Default)]
struct Entry {
    next_start_us: u64,
    index: u64,
    period_us: u32,
    missed: u32,
}

impl Entry {
    const UNUSED: Self = Self {
        next_start_us: 0,
        index: 0,
        period_us: 0,
        missed: 0,
    };
}

/// Hands out the occurrences of up to `SLOTS` slots in the order of their nominal starts.
///
/// ```
/// use esm_core::{Dispatcher, tables::Slot};
/// let slot = |number, period_us, start_us| Slot { number, period_us, duration_us: 100, start_us };
/// let mut dispatcher = Dispatcher::<4>::new([slot(1, 1_000, 0), slot(2, 500, 200)].into_iter()).unwrap();
/// let starts: Vec<_> = (0..5).map(|_| {
///     let start_us = dispatcher.next().start_us;
///     (dispatcher.take(start_us).unwrap().slot, start_us)
/// }).collect();
/// assert_eq!(starts, [(0, 0), (1, 200), (1, 700), (0, 1_000), (1, 1_200)]);
/// ```
#[derive(Clone, Debug)]
pub struct Dispatcher<const SLOTS: usize> {
    entries: [Entry; SLOTS],
    /// Slot indices; the first `len` form a heap, earliest start at the root.
    heap: [u16; SLOTS],
    len: usize,
}

impl<const SLOTS: usize> Dispatcher<SLOTS> {
    /// A dispatcher of no slots, to be [started](Self::restart). For statics and places that are used again: nothing is copied.
    #[must_use]
    pub const fn idle() -> Self {
        Self {
            entries: [Entry::UNUSED; SLOTS],
            heap: [0; SLOTS],
            len: 0,
        }
    }

    /// A dispatcher at its epoch. The slot index of an [`Occurrence`] is the position in `slots`.
    ///
    /// # Errors
    /// See [`DispatcherError`].
    pub fn new(slots: impl ExactSizeIterator<Item = Slot>) -> Result<Self, DispatcherError> {
        let mut dispatcher = Self::idle();
        dispatcher.restart(slots)?;
        Ok(dispatcher)
    }

    /// Puts the dispatcher at its epoch, with other slots. After an error it has none.
    ///
    /// # Errors
    /// See [`DispatcherError`].
    pub fn restart(
        &mut self,
        slots: impl ExactSizeIterator<Item = Slot>,
    ) -> Result<(), DispatcherError> {
        let len = slots.len();
        self.len = 0;
        if len > SLOTS {
            return Err(DispatcherError::TooManySlots {
                slots: len,
                capacity: SLOTS,
            });
        }
        if len == 0 {
            return Err(DispatcherError::NoSlots);
        }
        let places = self.entries.iter_mut().zip(&mut self.heap);
        for (index, (slot, (entry, place))) in slots.zip(places).enumerate() {
            if slot.period_us == 0 {
                return Err(DispatcherError::ZeroPeriod { slot: index });
            }
            *entry = Entry {
                next_start_us: u64::from(slot.start_us),
                period_us: slot.period_us,
                ..Entry::UNUSED
            };
            *place = index as u16;
        }
        self.len = len;
        for at in (0..len / 2).rev() {
            self.sift_down(at);
        }
        Ok(())
    }

    /// The earliest occurrence that was not taken: what the slot timer must be set to.
    #[must_use]
    pub fn next(&self) -> Occurrence {
        let slot = self.slot_at(0);
        let entry = self.entry(slot);
        Occurrence {
            slot,
            start_us: entry.next_start_us,
            index: entry.index,
        }
    }

    /// Takes the earliest occurrence if it is due at `now_us`, which must not lie before an earlier call's.
    ///
    /// An occurrence whose whole period has passed is missed: it is counted and skipped, and the slot goes on with the one that
    /// `now_us` falls into. So one slot is handed out at most once a period, however late the caller is.
    pub fn take(&mut self, now_us: u64) -> Option<Occurrence> {
        if self.is_empty() {
            return None;
        }
        let mut occurrence = self.next();
        let late_us = now_us.checked_sub(occurrence.start_us)?;
        let entry = self.entries.get_mut(occurrence.slot)?;
        let period_us = u64::from(entry.period_us);
        if late_us >= period_us {
            let missed = periods_in(late_us, entry.period_us);
            occurrence.start_us += missed * period_us;
            occurrence.index += missed;
            entry.missed = entry
                .missed
                .saturating_add(u32::try_from(missed).unwrap_or(u32::MAX));
        }
        entry.next_start_us = occurrence.start_us + period_us;
        entry.index = occurrence.index + 1;
        self.sift_down(0);
        Some(occurrence)
    }

    /// Occurrences of a slot that did not start within their period; saturates.
    #[must_use]
    pub fn missed(&self, slot: usize) -> u32 {
        self.entry(slot).missed
    }

    /// Number of slots.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it is [idle](Self::idle) and hands out nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    fn slot_at(&self, at: usize) -> usize {
        self.heap.get(at).map_or(0, |slot| usize::from(*slot))
    }

    fn put(&mut self, at: usize, slot: usize) {
        if let Some(place) = self.heap.get_mut(at) {
            *place = slot as u16;
        }
    }

    fn entry(&self, slot: usize) -> Entry {
        self.entries.get(slot).copied().unwrap_or_default()
    }

    /// Slots with equal starts come in the order of their indices, so that every run is the same.
    fn key(&self, at: usize) -> (u64, usize) {
        let slot = self.slot_at(at);
        (self.entry(slot).next_start_us, slot)
    }

    /// Restores the heap below `at`.
    fn sift_down(&mut self, mut at: usize) {
        // Each round goes a level down.
        loop {
            let mut child = 2 * at + 1;
            if child >= self.len {
                return;
            }
            if child + 1 < self.len && self.key(child + 1) < self.key(child) {
                child += 1;
            }
            if self.key(at) <= self.key(child) {
                return;
            }
            let (parent, below) = (self.slot_at(at), self.slot_at(child));
            self.put(at, below);
            self.put(child, parent);
            at = child;
        }
    }
}

/// `duration_us / period_us` without a 64-bit division, which small cores do in a long library routine.
fn periods_in(mut duration_us: u64, period_us: u32) -> u64 {
    let periods_in_chunk = u32::MAX / period_us;
    let chunk_us = u64::from(periods_in_chunk * period_us);
    let mut periods = 0;
    // More than an hour late is a stopped clock, not a robot: one round an hour is bound enough.
    while duration_us > u64::from(u32::MAX) {
        duration_us -= chunk_us;
        periods += u64::from(periods_in_chunk);
    }
    periods + u64::from(duration_us as u32 / period_us)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn slot(period_us: u32, start_us: u32) -> Slot {
        Slot {
            number: 1,
            period_us,
            duration_us: 0,
            start_us,
        }
    }

    fn dispatcher(slots: &[Slot]) -> Dispatcher<8> {
        Dispatcher::new(slots.iter().copied()).unwrap()
    }

    #[test]
    fn occurrences_come_in_the_order_of_their_starts_without_drift() {
        let slots = [slot(2_500, 7), slot(1_000, 0), slot(3_333, 3), slot(400, 1)];
        let mut dispatcher = dispatcher(&slots);
        let mut last = (0, 0);
        let mut taken = [0_u64; 4];
        for _ in 0..100_000 {
            let next = dispatcher.next();
            let occurrence = dispatcher.take(next.start_us).unwrap();
            assert_eq!(occurrence, next);
            assert!((occurrence.start_us, occurrence.slot) >= last);
            last = (occurrence.start_us, occurrence.slot);
            let Slot {
                period_us,
                start_us,
                ..
            } = slots[occurrence.slot];
            assert_eq!(occurrence.index, taken[occurrence.slot]);
            let nominal_us = u64::from(start_us) + occurrence.index * u64::from(period_us);
            assert_eq!(occurrence.start_us, nominal_us);
            taken[occurrence.slot] += 1;
        }
        assert!((0..4).all(|slot| dispatcher.missed(slot) == 0));
    }

    #[test]
    fn an_idle_dispatcher_hands_out_nothing_and_can_be_started_again_and_again() {
        let mut dispatcher = Dispatcher::<2>::idle();
        assert_eq!(dispatcher.take(u64::MAX), None);
        for start_us in [500, 20] {
            dispatcher
                .restart([slot(1_000, start_us)].into_iter())
                .unwrap();
            assert_eq!(dispatcher.next().start_us, u64::from(start_us));
            dispatcher.take(1_000_000).unwrap();
        }
        assert!(dispatcher.restart([slot(1, 0); 3].into_iter()).is_err());
        assert_eq!(
            dispatcher.take(u64::MAX),
            None,
            "an error leaves it without slots"
        );
    }

    #[test]
    fn nothing_is_due_before_its_time() {
        let mut dispatcher = dispatcher(&[slot(1_000, 500)]);
        assert_eq!(dispatcher.take(499), None);
        assert_eq!(dispatcher.take(500).map(|taken| taken.index), Some(0));
        assert_eq!(dispatcher.take(501), None);
    }

    #[test]
    fn what_is_a_whole_period_late_is_missed_and_counted() {
        // Lateness, index that is handed out, missed ones.
        let cases = [
            (0, 0, 0),
            (999, 0, 0),
            (1_000, 1, 1),
            (2_999, 2, 2),
            (5_000_000_000, 5_000_000, 5_000_000),
            (40_000_000_000_000, 40_000_000_000, u32::MAX),
        ];
        for (late_us, index, missed) in cases {
            let mut dispatcher = dispatcher(&[slot(1_000, 0), slot(4_000_000_000, 999)]);
            let taken = dispatcher.take(late_us).unwrap();
            assert_eq!((taken.slot, taken.index), (0, index), "{late_us} us late");
            assert_eq!(taken.start_us, index * 1_000);
            assert_eq!(dispatcher.missed(0), missed, "{late_us} us late");
        }
    }

    #[test]
    fn what_cannot_be_dispatched_is_refused() {
        let new = |slots: &[Slot]| Dispatcher::<2>::new(slots.iter().copied()).err();
        let three: Vec<_> = (0..3).map(|start_us| slot(10, start_us)).collect();
        assert_eq!(new(&three[..2]), None);
        assert_eq!(new(&[]), Some(DispatcherError::NoSlots));
        assert_eq!(
            new(&three),
            Some(DispatcherError::TooManySlots {
                slots: 3,
                capacity: 2
            })
        );
        assert_eq!(
            new(&[slot(10, 0), slot(0, 0)]),
            Some(DispatcherError::ZeroPeriod { slot: 1 })
        );
    }
}
