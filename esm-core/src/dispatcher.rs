//! Which slot runs when: a tournament of slots, won by the one with the earliest nominal start.
//!
//! Times are whole microseconds since the origin of the schedule, and every start is the one before
//! plus the period: nothing drifts, and no counter wraps in the life of a robot. Taking an
//! activation replays the winner's matches, one comparison for each level of the tournament:
//! logarithmic in the number of slots, and the same number for all of them, or one less. No table
//! is as long as the hyperperiod.
//!
//! Slots are compared by words of 32 bits: the time from a base to the next start, if it is less
//! than eight seconds, and the slot's index. So the activation that is taken on time costs no
//! arithmetic of 64 bits. The base moves on every few seconds, when an activation is taken by
//! `take`.

use core::ops::{Deref, DerefMut};

use crate::tables::Slot;

/// One nominal start of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Activation {
    /// Index of the slot in the blob.
    pub slot: usize,
    /// Nominal start in microseconds since the origin.
    pub start_us: u64,
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

/// What slots are compared by: the next nominal start, in microseconds since the base, and below
/// it, in [`SLOT_BITS`], the slot's index. So no two keys are equal, and slots with equal starts
/// come in the order of their indices.
type Key = u32;

/// Bits of a key that hold the slot's index.
const SLOT_BITS: u32 = 8;

/// Stands for a slot that did not enter yet. It wins all matches, or is the first slot's key.
const ABSENT: Key = 0;

/// The bit of keys whose start is too far from the base for a key: it stands with the slot.
const FAR: Key = 1 << (Key::BITS - 1);
/// Starts from here on are far, in microseconds from the base.
const FAR_US: u32 = FAR >> SLOT_BITS;
/// When a start that is so far from the base is taken, the base moves on.
const REBASE_US: u32 = FAR_US / 2;

/// The index in a key.
fn slot_of(key: Key) -> usize {
    (key % (1 << SLOT_BITS)) as usize
}

/// An activation whose start is near the queue's base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Near(Key);

impl Near {
    /// The first slot at the base.
    pub const BASE: Near = Near(0);

    /// Index of the slot in the blob.
    #[must_use]
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn slot(self) -> usize {
        slot_of(self.0)
    }

    /// Nominal start in microseconds since the base.
    #[must_use]
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn since_us(self) -> u32 {
        self.0 >> SLOT_BITS
    }
}

/// What is kept for a slot.
#[derive(Clone, Copy, Debug)]
struct Entry {
    period_us: u32,
    /// The period as what is added to a key; [`FAR`] where that would be more.
    period: Key,
    missed: u32,
    /// The slot's first match, for as many slots as there are.
    first_match: u32,
    /// The next nominal start, where its key says that it is far.
    start_us: u64,
}

impl Entry {
    const UNUSED: Self = Self {
        period_us: 0,
        period: 0,
        missed: 0,
        first_match: 0,
        start_us: 0,
    };
}

/// Hands out the activations of up to `SLOTS` slots, at most 256, in the order of their nominal
/// starts.
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
    slots: SlotQueue<[Seat; SLOTS]>,
}

/// A [`Dispatcher`] of any number of slots, by reference.
#[derive(Clone, Debug)]
pub struct SlotQueue<S: ?Sized = [Seat]> {
    /// No slot's next start is before this.
    base_us: u64,
    len: usize,
    /// The key of the slot that won all matches.
    winner: Key,
    /// The tournament. Match `m`, from 1 to `len - 1`, is between the winners of the matches `2m`
    /// and `2m + 1`; the slot with index `i` enters at the place of match `len + i`. The key of the
    /// loser of match `m` is kept in seat `m - 1`.
    seats: S,
}

/// What is kept for a slot, and beside it the loser of a match.
#[derive(Clone, Copy, Debug)]
pub struct Seat {
    entry: Entry,
    key: Key,
}

impl<const SLOTS: usize> Dispatcher<SLOTS> {
    /// A dispatcher of no slots, to be [started](SlotQueue::restart_at). For statics and places
    /// that are used again: nothing is copied.
    #[must_use]
    pub const fn idle() -> Self {
        const { assert!(SLOTS <= 1 << SLOT_BITS, "an index fits into a key") };
        Self {
            slots: SlotQueue {
                base_us: 0,
                len: 0,
                winner: ABSENT,
                seats: [Seat {
                    entry: Entry::UNUSED,
                    key: 0,
                }; SLOTS],
            },
        }
    }

    /// A dispatcher at its origin. The slot index of an [`Activation`] is the position in `slots`.
    ///
    /// # Errors
    /// See [`DispatcherError`].
    pub fn new(slots: impl ExactSizeIterator<Item = Slot>) -> Result<Self, DispatcherError> {
        let mut dispatcher = Self::idle();
        dispatcher.restart_at(slots, 0)?;
        Ok(dispatcher)
    }
}

impl<const SLOTS: usize> Deref for Dispatcher<SLOTS> {
    type Target = SlotQueue;

    #[cfg_attr(feature = "speed", inline(always))]
    fn deref(&self) -> &SlotQueue {
        &self.slots
    }
}

impl<const SLOTS: usize> DerefMut for Dispatcher<SLOTS> {
    #[cfg_attr(feature = "speed", inline(always))]
    fn deref_mut(&mut self) -> &mut SlotQueue {
        &mut self.slots
    }
}

impl SlotQueue {
    /// Starts with other slots at a time of their schedule: the first activation of each is its
    /// first one that starts at or after `from_us`, in microseconds since the origin. Nothing was
    /// missed yet. After an error there are no slots.
    ///
    /// # Errors
    /// See [`DispatcherError`].
    pub fn restart_at(
        &mut self,
        slots: impl ExactSizeIterator<Item = Slot>,
        from_us: u64,
    ) -> Result<(), DispatcherError> {
        let len = slots.len();
        self.len = 0;
        if len > self.seats.len() {
            return Err(DispatcherError::TooManySlots {
                slots: len,
                capacity: self.seats.len(),
            });
        }
        if len == 0 {
            return Err(DispatcherError::NoSlots);
        }
        for (index, (slot, seat)) in slots.zip(&mut self.seats).enumerate() {
            if slot.period_us == 0 {
                return Err(DispatcherError::ZeroPeriod { slot: index });
            }
            let mut start_us = u64::from(slot.start_us);
            if let Some(past_us) = from_us.checked_sub(start_us) {
                // Rounded up: the activation before would start before `from_us`.
                let past_us = past_us + u64::from(slot.period_us - 1);
                start_us += periods_in(past_us, slot.period_us) * u64::from(slot.period_us);
            }
            seat.entry = Entry {
                period_us: slot.period_us,
                period: slot.period_us.min(FAR_US) << SLOT_BITS,
                missed: 0,
                first_match: (len + index) as u32 / 2,
                start_us,
            };
        }
        self.len = len;
        self.play_all();
        Ok(())
    }

    /// The earliest activation that was not taken: what the slot timer must be set to.
    #[must_use]
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn next(&self) -> Activation {
        // The base moves before the earliest start is far from it.
        let winner = Near(self.winner);
        Activation {
            slot: winner.slot(),
            start_us: self.base_us + u64::from(winner.since_us()),
        }
    }

    /// Takes the earliest activation if it is due at `now_us`, which must not lie before an earlier
    /// call's.
    ///
    /// An activation whose whole period has passed is missed: it is counted and skipped, and the
    /// slot goes on with the one that `now_us` falls into. So one slot is handed out at most once a
    /// period, however late the caller is.
    pub fn take(&mut self, now_us: u64) -> Option<Activation> {
        if self.is_empty() {
            return None;
        }
        let mut activation = self.next();
        let late_us = now_us.checked_sub(activation.start_us)?;
        let entry = &mut self.seats.get_mut(activation.slot)?.entry;
        let period_us = u64::from(entry.period_us);
        if late_us >= period_us {
            let missed = periods_in(late_us, entry.period_us);
            activation.start_us += missed * period_us;
            entry.missed = entry
                .missed
                .saturating_add(u32::try_from(missed).unwrap_or(u32::MAX));
        }
        self.put(activation.slot, activation.start_us + period_us);
        Some(activation)
    }

    /// Start that [`Near`] ones are counted from, in microseconds since the origin.
    #[must_use]
    pub fn base_us(&self) -> u64 {
        self.base_us
    }

    /// Takes the earliest activation, and returns it and the one after it: for a caller who knows
    /// that it is due and that its period has not passed. The base stays. `None`, and nothing is
    /// done, where that takes arithmetic of 64 bits, which [`take_on_time`](Self::take_on_time)
    /// does.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn take_near(&mut self) -> Option<(Near, Near)> {
        let taken = Near(self.winner);
        let entry = &self.seats.get(taken.slot())?.entry;
        // The earliest start is near, and a period at most FAR.
        let key = self.winner.wrapping_add(entry.period);
        if key >= FAR {
            return None;
        }
        let first_match = entry.first_match;
        // Who wins is not later than this one, and so near.
        Some((taken, Near(self.replay(first_match, key)?)))
    }

    /// Takes the earliest activation, whichever time it is: for a caller who knows that it is due
    /// and that its period has not passed.
    #[inline(never)]
    pub fn take_on_time(&mut self) {
        let Activation { slot, start_us } = self.next();
        self.put(slot, start_us + u64::from(self.period_us(slot)));
    }

    /// The slot of the earliest activation starts next at this time.
    fn put(&mut self, slot: usize, start_us: u64) {
        let Some(seat) = self.seats.get_mut(slot) else {
            return;
        };
        seat.entry.start_us = start_us;
        let first_match = seat.entry.first_match;
        let key = self.key(slot, start_us);
        let winner = self.replay(first_match, key);
        if winner.is_some_and(|winner| winner >> SLOT_BITS >= REBASE_US) {
            self.rebase();
        }
    }

    fn key(&self, slot: usize, start_us: u64) -> Key {
        match u32::try_from(start_us - self.base_us) {
            Ok(since_us) if since_us < FAR_US => since_us << SLOT_BITS | slot as Key,
            _ => FAR | slot as Key,
        }
    }

    /// Moves the base to the earliest start.
    #[cold]
    #[inline(never)]
    fn rebase(&mut self) {
        let matches = self.len.saturating_sub(1);
        for place in 0..=matches {
            let key = match place.checked_sub(1) {
                None => self.winner,
                Some(loser) => self.seats.get(loser).map_or(FAR, |seat| seat.key),
            };
            if key < FAR
                && let Some(seat) = self.seats.get_mut(slot_of(key))
            {
                seat.entry.start_us = self.base_us + u64::from(key >> SLOT_BITS);
            }
        }
        self.play_all();
    }

    /// Plays all matches, from the earliest start on. Entries have their next starts.
    fn play_all(&mut self) {
        let seats = self.seats.iter().take(self.len);
        let starts_us = seats.map(|seat| seat.entry.start_us);
        self.base_us = starts_us.min().unwrap_or(0);
        self.winner = ABSENT;
        for seat in &mut self.seats {
            seat.key = ABSENT;
        }
        for slot in 0..self.len {
            let Some(seat) = self.seats.get(slot) else {
                return;
            };
            let (start_us, first_match) = (seat.entry.start_us, seat.entry.first_match);
            // Who was absent won so far, and is replaced.
            self.replay(first_match, self.key(slot, start_us));
        }
    }

    /// Plays the winner's matches anew, from the slot's first one on, with its next key, and
    /// returns the key of who wins. It met, on its way from where it entered to the final,
    /// everybody who can be the earliest now. `None`, and nothing is done, where there is no such
    /// match.
    #[inline]
    fn replay(&mut self, first_match: u32, key: Key) -> Option<Key> {
        let mut player = key;
        // The seats up to that of the slot's next match: half as many lead to the match after it.
        // So no index is compared with a length.
        let mut way = self.seats.get_mut(..first_match as usize)?;
        loop {
            let before = way.len() / 2;
            let Some(other) = way.last_mut() else {
                break;
            };
            if other.key < player {
                core::mem::swap(&mut other.key, &mut player);
            }
            way = way.get_mut(..before).unwrap_or_default();
        }
        self.winner = player;
        Some(player)
    }

    /// Period of a slot in microseconds; 0 if there is no such slot.
    #[must_use]
    #[inline]
    pub fn period_us(&self, slot: usize) -> u32 {
        self.seats.get(slot).map_or(0, |seat| seat.entry.period_us)
    }

    /// Activations of a slot that did not start within their period; saturates.
    #[must_use]
    pub fn missed(&self, slot: usize) -> u32 {
        self.seats.get(slot).map_or(0, |seat| seat.entry.missed)
    }

    /// Number of slots.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it is [idle](Dispatcher::idle) and hands out nothing.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// `duration_us / period_us`, by a short division where that is enough. Small cores do a 64-bit one
/// in a library routine of a kilobyte: after more than an hour, which happens at most once a slot
/// where a mission takes over, it is done bit by bit.
#[inline(never)]
pub(crate) fn periods_in(duration_us: u64, period_us: u32) -> u64 {
    if let Ok(duration_us) = u32::try_from(duration_us) {
        // Without a period nothing is divided: so there is no panic to link.
        return u64::from(duration_us.checked_div(period_us).unwrap_or(0));
    }
    // Bits of the duration go out at the top, and those of the result come in below.
    let (mut rest_us, mut periods) = (0_u32, duration_us);
    for _ in 0..u64::BITS {
        let is_above = rest_us > u32::MAX / 2;
        rest_us = rest_us << 1 | (periods >> (u64::BITS - 1)) as u32;
        periods <<= 1;
        // The bit that went out at the top of the rest is made up for by the subtraction.
        if is_above || rest_us >= period_us {
            rest_us = rest_us.wrapping_sub(period_us);
            periods |= 1;
        }
    }
    periods
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
    fn whole_periods_of_hours_and_ages() {
        for duration_us in [0, 1, 0xffff_ffff, 1 << 32, 1 << 40 | 12_345, u64::MAX] {
            for period_us in [1, 2, 2_500, 1_000_000, u32::MAX] {
                let expected = duration_us / u64::from(period_us);
                assert_eq!(
                    periods_in(duration_us, period_us),
                    expected,
                    "{duration_us} / {period_us}"
                );
            }
        }
    }

    #[test]
    fn occurrences_come_in_the_order_of_their_starts_without_drift() {
        let slots = [slot(2_500, 7), slot(1_000, 0), slot(3_333, 3), slot(400, 1)];
        let mut dispatcher = dispatcher(&slots);
        let mut last = (0, 0);
        let mut taken = [0_u64; 4];
        for _ in 0..100_000 {
            let next = dispatcher.next();
            let activation = dispatcher.take(next.start_us).unwrap();
            assert_eq!(activation, next);
            assert!((activation.start_us, activation.slot) >= last);
            last = (activation.start_us, activation.slot);
            let Slot {
                period_us,
                start_us,
                ..
            } = slots[activation.slot];
            let nominal_us = u64::from(start_us) + taken[activation.slot] * u64::from(period_us);
            assert_eq!(activation.start_us, nominal_us);
            taken[activation.slot] += 1;
        }
        assert!((0..4).all(|slot| dispatcher.missed(slot) == 0));
    }

    #[test]
    fn near_occurrences_are_those_that_are_taken_and_far_ones_are_left() {
        let slots = [slot(2_500, 7), slot(1_000_000, 0), slot(FAR_US, 3)];
        let (mut near, mut plain) = (dispatcher(&slots), dispatcher(&slots));
        let (mut taken, mut left) = (0, 0);
        for _ in 0..50_000 {
            let expected = plain.next();
            assert_eq!(near.next(), expected);
            plain.take(expected.start_us).unwrap();
            let base_us = near.base_us();
            let at = |near: Near| Activation {
                slot: near.slot(),
                start_us: base_us + u64::from(near.since_us()),
            };
            match near.take_near() {
                Some((found, next)) => {
                    taken += 1;
                    assert_eq!((at(found), at(next)), (expected, near.next()));
                    assert_eq!(near.base_us(), base_us);
                }
                None => {
                    left += 1;
                    assert_eq!(near.next(), expected, "nothing is done");
                    near.take_on_time();
                }
            }
            assert_eq!(near.next(), plain.next());
        }
        assert!(taken > 49_000 && left > 10, "{taken} and {left}");
    }

    #[test]
    fn an_idle_dispatcher_hands_out_nothing_and_can_be_started_again_and_again() {
        let mut dispatcher = Dispatcher::<2>::idle();
        assert_eq!(dispatcher.take(u64::MAX), None);
        for start_us in [500, 20] {
            dispatcher
                .restart_at([slot(1_000, start_us)].into_iter(), 0)
                .unwrap();
            assert_eq!(dispatcher.next().start_us, u64::from(start_us));
            dispatcher.take(1_000_000).unwrap();
        }
        assert!(
            dispatcher
                .restart_at([slot(1, 0); 3].into_iter(), 0)
                .is_err()
        );
        assert_eq!(
            dispatcher.take(u64::MAX),
            None,
            "an error leaves it without slots"
        );
    }

    #[test]
    fn a_schedule_that_goes_on_begins_with_the_first_starts_at_or_after_a_time() {
        let slots = [
            slot(1_000, 0),
            slot(4_000_000_000, 3_999_999_999),
            slot(300, 299),
        ];
        for from_us in [
            0,
            1,
            298,
            299,
            300,
            1_000,
            3_999_999_999,
            4_000_000_000,
            (1 << 32) - 1,
            1 << 32,
            (1 << 40) + 7,
        ] {
            for slot in slots {
                let mut started = Dispatcher::<1>::idle();
                started.restart_at([slot].into_iter(), from_us).unwrap();
                let first_us = started.next().start_us;
                let (period_us, start_us) = (u64::from(slot.period_us), u64::from(slot.start_us));
                assert_eq!(first_us % period_us, start_us);
                assert!(first_us >= from_us && first_us < (from_us + period_us).max(start_us + 1));
            }
        }
    }

    #[test]
    fn nothing_is_due_before_its_time() {
        let mut dispatcher = dispatcher(&[slot(1_000, 500)]);
        assert_eq!(dispatcher.take(499), None);
        assert_eq!(dispatcher.take(500).map(|taken| taken.start_us), Some(500));
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
            let expected = Activation {
                slot: 0,
                start_us: index * 1_000,
            };
            assert_eq!(taken, expected, "{late_us} us late");
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
