//! Which slot runs when: a tournament of slots, won by the one with the earliest nominal start.
//!
//! Times are whole microseconds since the origin of the schedule, and every start is the one before
//! plus the period: nothing drifts, and no counter wraps in the life of a robot. No table is as
//! long as the hyperperiod.
//!
//! Slots of one period always start in the same order. So they are one ring, of which the next one
//! takes part in the tournament. Taking an activation replays the winner's matches, one comparison
//! for each level of the tournament: logarithmic in the number of different periods. Where a slot
//! has missed its start by a whole period, the order is another for a while. Then each slot takes
//! part by itself, until the base moves on and the order is as it was.
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

/// What is added to a key for a later start; [`FAR`] where that is too much.
fn key_of(us: u32) -> Key {
    us.min(FAR_US) << SLOT_BITS
}

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
    /// What is added to the slot's key for that of its [successor](Self::successor); [`FAR`] where
    /// the period would be more.
    step: Key,
    missed: u32,
    /// The first match of the slot's ring, or of the slot, for as many players as there are.
    first_match: u16,
    /// The slot's neighbour in the ring of its period; itself, if it is alone.
    neighbour: u8,
    /// The next nominal start, where its key says that it is far, or starts are being looked at.
    start_us: u64,
}

impl Entry {
    const UNUSED: Self = Self {
        period_us: 0,
        step: 0,
        missed: 0,
        first_match: 0,
        neighbour: 0,
        start_us: 0,
    };

    /// Who plays when an activation of this slot was taken: its neighbour, or, where slots play by
    /// themselves, the slot itself.
    #[inline]
    fn successor(&self, slot: usize) -> usize {
        slot_of((slot as Key).wrapping_add(self.step))
    }

    /// From the start of an activation of this slot to that of its successor.
    #[inline]
    fn gap_us(&self, slot: usize) -> u32 {
        let indices = (self.successor(slot) as Key).wrapping_sub(slot as Key);
        match self.step {
            FAR => self.period_us,
            step => step.wrapping_sub(indices) >> SLOT_BITS,
        }
    }
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
    len: u16,
    /// Rings, or slots where these play by themselves.
    players: u16,
    /// The key of the slot that won all matches.
    winner: Key,
    /// The tournament. Match `m`, from 1 to `players - 1`, is between the winners of the matches
    /// `2m` and `2m + 1`; player `i` enters at the place of match `players + i`. The key of the
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
                players: 0,
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
    #[inline]
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
                neighbour: index as u8,
                start_us,
                ..Entry::UNUSED
            };
        }
        // An index fits into a byte, so the number of them into this.
        self.len = len as u16;
        self.find_keys();
        for slot in 1..len {
            self.join_ring(slot);
        }
        self.play_all(true);
        Ok(())
    }

    #[inline]
    fn entry(&self, slot: usize) -> Entry {
        self.seats
            .get(slot)
            .map_or(Entry::UNUSED, |seat| seat.entry)
    }

    /// The key in a seat.
    #[inline]
    fn key_at(&self, slot: usize) -> Key {
        self.seats.get(slot).map_or(FAR, |seat| seat.key)
    }

    /// Moves the base to the earliest start, and puts the key of each slot into its seat, where
    /// those of losers were. Entries have their next starts.
    #[inline(never)]
    fn find_keys(&mut self) {
        let len = usize::from(self.len);
        let starts_us = self.seats.iter().take(len).map(|seat| seat.entry.start_us);
        self.base_us = starts_us.min().unwrap_or(0);
        for slot in 0..len {
            let key = self.key(slot, self.entry(slot).start_us);
            if let Some(seat) = self.seats.get_mut(slot) {
                seat.key = key;
            }
        }
    }

    /// A slot takes its place among those before it that have its period. All have their keys.
    #[inline(never)]
    fn join_ring(&mut self, slot: usize) {
        let (period_us, key) = (self.entry(slot).period_us, self.key_at(slot));
        let mut others = (0..slot).rev();
        let Some(mut before) = others.find(|other| self.entry(*other).period_us == period_us)
        else {
            return;
        };
        if period_us >= FAR_US {
            return;
        }
        let mut after = before;
        // As a rule slots are listed in the order in which they start.
        for _ in 0..slot {
            after = self.entry(before).neighbour.into();
            let (from, to) = (self.key_at(before), self.key_at(after));
            let (is_behind, is_ahead) = (from < key, key < to);
            // Between the last one and the first one is who is behind that or ahead of this.
            if is_behind && is_ahead || from >= to && (is_behind || is_ahead) {
                break;
            }
            before = after;
        }
        for (of, neighbour) in [(slot, after), (before, slot)] {
            if let Some(seat) = self.seats.get_mut(of) {
                seat.entry.neighbour = neighbour as u8;
            }
        }
    }

    /// What is added to the key of a slot for that of its neighbour, where the slot has nothing
    /// else in between; and whether the slot is the last one of its ring. All have their keys.
    #[inline(never)]
    fn step_to_neighbour(&self, slot: usize) -> (Option<Key>, bool) {
        let entry = self.entry(slot);
        let neighbour = usize::from(entry.neighbour);
        let period = key_of(entry.period_us);
        let (key, next) = (self.key_at(slot), self.key_at(neighbour));
        let is_last = next <= key;
        // The key of who starts in seven seconds and of who starts in seven more fit into a word.
        let next = if is_last {
            next.wrapping_add(period)
        } else {
            next
        };
        let step = next.wrapping_sub(key);
        let is_near = neighbour == slot || key < FAR && next >= key && (is_last || step < period);
        (is_near.then_some(step), is_last)
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

    /// The same, counted from the [base](Self::base_us).
    #[must_use]
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn next_near(&self) -> Near {
        Near(self.winner)
    }

    /// Takes the earliest activation if it is due at `now_us`, which must not lie before an earlier
    /// call's.
    ///
    /// An activation whose whole period has passed is missed: it is counted and skipped, and the
    /// slot goes on with the one that `now_us` falls into. So one slot is handed out at most once a
    /// period, however late the caller is.
    #[inline(never)]
    pub fn take(&mut self, now_us: u64) -> Option<Activation> {
        if self.is_empty() {
            return None;
        }
        let mut activation = self.next();
        let late_us = now_us.checked_sub(activation.start_us)?;
        let entry = self.entry(activation.slot);
        if late_us >= u64::from(entry.period_us) {
            if entry.successor(activation.slot) != activation.slot {
                self.note_starts();
                self.play_all(false);
            }
            let missed = periods_in(late_us, entry.period_us);
            activation.start_us += missed * u64::from(entry.period_us);
            let entry = &mut self.seats.get_mut(activation.slot)?.entry;
            entry.missed = entry
                .missed
                .saturating_add(u32::try_from(missed).unwrap_or(u32::MAX));
        }
        self.go_on_after(activation);
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
        // The earliest start is near, and what is added at most FAR.
        let key = self.winner.wrapping_add(entry.step);
        if key >= FAR {
            return None;
        }
        let first_match = entry.first_match;
        // Who wins is not later than this one, and so near.
        Some((taken, Near(self.replay(first_match, key)?)))
    }

    /// Takes the earliest activation, whichever time it is: for a caller who knows that it is due
    /// and that its period has not passed.
    #[inline]
    pub fn take_on_time(&mut self) {
        self.go_on_after(self.next());
    }

    /// An activation was taken: the slot's successor plays.
    #[inline(never)]
    fn go_on_after(&mut self, taken: Activation) {
        let entry = self.entry(taken.slot);
        let slot = entry.successor(taken.slot);
        let start_us = taken.start_us + u64::from(entry.gap_us(taken.slot));
        if let Some(seat) = self.seats.get_mut(slot) {
            seat.entry.start_us = start_us;
        }
        let key = self.key(slot, start_us);
        let winner = self.replay(entry.first_match, key);
        if winner.is_some_and(|winner| winner >> SLOT_BITS >= REBASE_US) {
            self.note_starts();
            self.play_all(true);
        }
    }

    #[inline]
    fn key(&self, slot: usize, start_us: u64) -> Key {
        match u32::try_from(start_us - self.base_us) {
            Ok(since_us) if since_us < FAR_US => since_us << SLOT_BITS | slot as Key,
            _ => FAR | slot as Key,
        }
    }

    /// Notes the next start of each slot, to [play](Self::play_all) anew.
    #[cold]
    #[inline(never)]
    fn note_starts(&mut self) {
        for place in 0..usize::from(self.players) {
            let key = match place.checked_sub(1) {
                None => self.winner,
                Some(loser) => self.key_at(loser),
            };
            let first = slot_of(key);
            let mut start_us = match key < FAR {
                true => self.base_us + u64::from(key >> SLOT_BITS),
                false => self.entry(first).start_us,
            };
            let mut slot = first;
            // A ring has no more slots than there are.
            for _ in 0..self.len {
                let Some(seat) = self.seats.get_mut(slot) else {
                    break;
                };
                seat.entry.start_us = start_us;
                start_us += u64::from(seat.entry.gap_us(slot));
                slot = seat.entry.successor(slot);
                if slot == first {
                    break;
                }
            }
        }
    }

    /// Plays all matches, from the earliest start on. Entries have their next starts. Slots of one
    /// period are one player, if they may be and their next starts are in the order of their ring.
    #[inline(never)]
    fn play_all(&mut self, in_rings: bool) {
        self.find_keys();
        let mut in_rings = in_rings;
        let mut rings = 0;
        for slot in 0..usize::from(self.len) {
            let (step, is_last) = self.step_to_neighbour(slot);
            rings += u16::from(is_last);
            in_rings &= step.is_some();
            if let Some(seat) = self.seats.get_mut(slot) {
                seat.entry.step = step.unwrap_or(0);
            }
        }
        self.players = if in_rings { rings } else { self.len };
        self.winner = ABSENT;
        for seat in &mut self.seats {
            seat.key = ABSENT;
        }
        let mut player = 0;
        for slot in 0..usize::from(self.len) {
            if !in_rings && let Some(seat) = self.seats.get_mut(slot) {
                seat.entry.step = key_of(seat.entry.period_us);
            }
            let entry = self.entry(slot);
            let first = entry.successor(slot);
            // The last one of a ring is followed by the first one; who is alone, by itself.
            if (entry.start_us, slot) < (self.entry(first).start_us, first) {
                continue;
            }
            let first_match = (self.players + player) / 2;
            player += 1;
            let mut member = first;
            for _ in 0..self.len {
                let Some(seat) = self.seats.get_mut(member) else {
                    break;
                };
                seat.entry.first_match = first_match;
                member = seat.entry.successor(member);
                if member == first {
                    break;
                }
            }
            // Who was absent won so far, and is replaced.
            self.replay(first_match, self.key(first, self.entry(first).start_us));
        }
    }

    /// Plays the winner's matches anew, from its first one on, with its successor's key, and
    /// returns the key of who wins. It met, on its way from where it entered to the final,
    /// everybody who can be the earliest now. `None`, and nothing is done, where there is no such
    /// match.
    #[inline]
    fn replay(&mut self, first_match: u16, key: Key) -> Option<Key> {
        let mut player = key;
        // The seats up to that of the player's next match: half as many lead to the match after it.
        // So no index is compared with a length.
        let mut way = self.seats.get_mut(..usize::from(first_match))?;
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
        self.len.into()
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

    /// What the next starts of these slots are, one by one.
    struct Starts(Vec<(u64, usize, u64)>);

    impl Starts {
        fn new(slots: &[Slot]) -> Self {
            let starts = slots.iter().enumerate();
            let start =
                |(index, slot): (_, &Slot)| (slot.start_us.into(), index, slot.period_us.into());
            Starts(starts.map(start).collect())
        }

        /// Takes the earliest one at this time, or when it is due. Answers it, and how many were
        /// missed.
        fn take(&mut self, now_us: u64) -> (Activation, u64) {
            let next = self.0.iter_mut().min().unwrap();
            let missed = now_us.saturating_sub(next.0) / next.2;
            let taken = Activation {
                slot: next.1,
                start_us: next.0 + missed * next.2,
            };
            next.0 = taken.start_us + next.2;
            (taken, missed)
        }
    }

    #[test]
    fn slots_of_one_period_come_in_their_order_whatever_was_missed() {
        let sets: [&[(u32, u32)]; 6] = [
            // Starts that are listed out of order, equal ones, and beside them another period.
            &[(900, 700), (900, 0), (400, 7), (900, 350), (900, 350)],
            // Periods that are almost too far, and too far, for a key.
            &[(FAR_US - 1, 5), (FAR_US - 1, 6_000_000), (FAR_US - 1, 5)],
            &[(5_000_000, 4_999_999), (5_000_000, 1), (1_000_000, 3)],
            &[(FAR_US, 1), (FAR_US, 0), (FAR_US + 1, 9), (FAR_US + 1, 9)],
            &[(1, 0), (1, 0), (2, 1)],
            // A first start that is behind the first period.
            &[(1_000, 2_500), (1_000, 0), (1_000, 20_000_000)],
        ];
        for set in sets {
            let slots: Vec<_> = set
                .iter()
                .map(|&(period, start)| slot(period, start))
                .collect();
            // Every so many activations one comes late by so many periods of the first slot.
            for (every, periods) in [(u32::MAX, 0), (7, 1), (13, 3), (50, 1_000_000)] {
                let mut dispatcher = dispatcher(&slots);
                let mut starts = Starts::new(&slots);
                let mut missed = Vec::from([0_u64; 5]);
                for count in 1..20_000 {
                    let next = dispatcher.next();
                    let late_us = match count % every {
                        0 => u64::from(slots[0].period_us) * periods + 1,
                        _ => 0,
                    };
                    let now_us = next.start_us + late_us;
                    let (expected, of_it) = starts.take(now_us);
                    missed[expected.slot] += of_it;
                    let found = match late_us {
                        0 if count % 2 == 0 => {
                            if dispatcher.take_near().is_none() {
                                dispatcher.take_on_time();
                            }
                            next
                        }
                        _ => dispatcher.take(now_us).unwrap(),
                    };
                    assert_eq!(found, expected, "{set:?}, {count}");
                }
                for (slot, missed) in (0..set.len()).zip(missed) {
                    let missed = u32::try_from(missed).unwrap_or(u32::MAX);
                    assert_eq!(dispatcher.missed(slot), missed, "{set:?}");
                }
            }
        }
    }

    #[test]
    fn slots_of_one_period_are_one_player_until_one_has_missed_its_start() {
        let slots = [slot(900, 700), slot(400, 7), slot(900, 0), slot(900, 350)];
        let mut dispatcher = dispatcher(&slots);
        assert_eq!(dispatcher.players, 2);
        let first_us = dispatcher.next().start_us;
        dispatcher.take(first_us + 899).unwrap();
        assert_eq!(dispatcher.players, 2, "late, but not missed");
        while dispatcher.next().slot == 1 {
            dispatcher.take_on_time();
        }
        let next_us = dispatcher.next().start_us;
        dispatcher.take(next_us + 900).unwrap();
        assert_eq!(dispatcher.players, 4);
        // The base moves on, and what was late has caught up.
        while dispatcher.base_us() < u64::from(REBASE_US) {
            let next_us = dispatcher.next().start_us;
            dispatcher.take(next_us).unwrap();
        }
        assert_eq!(dispatcher.players, 2);
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
