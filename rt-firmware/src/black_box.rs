//! The black box: what happened last, in RAM that survives a reset.
//!
//! Records stand in three rings, so that a machine that changes its state in each macro step does
//! not wash away why the robot stopped: one ring for transitions, one for what is about behaviours,
//! one for all else. A record has a
//! sequence number, which orders the records of all, and a checksum over all of it: one that a
//! reset tore, or that power-on left, is none.
//!
//! There is one writer at a time: the real-time side while the robot runs, and whoever ends the
//! firmware when that never runs again. Writing a record is five stores and a checksum over four
//! words, without a loop: about 45 instructions of a Cortex-M3. Whoever reads may be interrupted by
//! the writer at any place: a record that changes while it is read fails its checksum, and counts
//! as overwritten.
//!
//! A firmware without the feature `black-box` has no room for records, and none of the code.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::features::NOTES;
use esm_link::black_box::{Event, Record};

/// Whether this firmware keeps records at all.
pub const KEEPS_RECORDS: bool = cfg!(feature = "black-box");

/// Transitions that are kept.
pub const TRANSITIONS: usize = if KEEPS_RECORDS { 24 } else { 0 };
/// Records of all other kinds that are kept.
pub const EVENTS: usize = if KEEPS_RECORDS { 24 } else { 0 };

/// Records about behaviours that are kept, in a firmware that has some: of eight changes, each
/// with the two of a pose.
pub const BEHAVIOUR_RECORDS: usize = if KEEPS_RECORDS && NOTES { 24 } else { 0 };

/// Words of a record in RAM: sequence number; time, its low half; time, 16 more bits, kind and the
/// small value; the large value; checksum.
const WORDS: usize = 5;

#[cfg_attr(feature = "speed", inline(always))]
fn to_words(record: Record) -> [u32; WORDS] {
    let (kind, small, large) = record.event.pack();
    let high = (record.at_us >> 32) as u16;
    let words = [
        record.sequence,
        record.at_us as u32,
        u32::from(high) << 16 | u32::from(kind) << 8 | u32::from(small),
        large,
    ];
    let [sequence, time, third, large] = words;
    [sequence, time, third, large, checksum(words)]
}

fn from_words(words: [u32; WORDS]) -> Option<Record> {
    let [sequence, time, third, large, sum] = words;
    if checksum([sequence, time, third, large]) != sum {
        return None;
    }
    Some(Record {
        sequence,
        at_us: u64::from(third >> 16) << 32 | u64::from(time),
        event: Event::unpack((third >> 8) as u8, third as u8, large)?,
    })
}

/// Each step is a bijection of the sum and of the word, so that a change of a single word never
/// goes unnoticed.
#[cfg_attr(feature = "speed", inline(always))]
fn checksum(words: [u32; WORDS - 1]) -> u32 {
    const SEED: u32 = 0xE5B1_ACB0;
    const ODD: u32 = 0x9E37_79B1;
    words.iter().fold(SEED, |sum, word| {
        (sum ^ word).wrapping_mul(ODD).rotate_left(15)
    })
}

/// The words of one record.
struct Place([AtomicU32; WORDS]);

impl Place {
    const fn empty() -> Place {
        Place([const { AtomicU32::new(0) }; WORDS])
    }

    /// The sequence number of its record, if it holds one.
    fn sequence(&self) -> u32 {
        let [sequence, ..] = &self.0;
        sequence.load(Relaxed)
    }

    fn read(&self) -> Option<Record> {
        from_words(self.0.each_ref().map(|word| word.load(Relaxed)))
    }

    fn write(&self, record: Record) {
        for (place, word) in self.0.iter().zip(to_words(record)) {
            place.store(word, Relaxed);
        }
    }

    fn clear(&self) {
        for word in &self.0 {
            word.store(0, Relaxed);
        }
    }
}

/// A ring of records.
struct Lane<const N: usize> {
    places: [Place; N],
    /// Where the next record goes.
    next: AtomicU32,
}

impl<const N: usize> Lane<N> {
    const fn empty() -> Lane<N> {
        Lane {
            places: [const { Place::empty() }; N],
            next: AtomicU32::new(0),
        }
    }

    fn write(&self, record: Record) {
        let next = self.next.load(Relaxed) as usize;
        if let Some(place) = self.places.get(next) {
            place.write(record);
            let after = if next + 1 < N { next + 1 } else { 0 };
            self.next.store(after as u32, Relaxed);
        }
    }

    /// Goes on behind the newest record, which is the one that comes latest before `end`.
    fn resume(&self, newest: u32) {
        let after = |at: usize| if at + 1 < N { at + 1 } else { 0 };
        let found = self
            .places
            .iter()
            .position(|place| place.read().is_some_and(|record| record.sequence == newest));
        self.next.store(found.map_or(0, after) as u32, Relaxed);
    }

    /// Sequence number of the newest record.
    fn newest(&self) -> Option<u32> {
        let numbers = || (self.places.iter()).filter_map(|place| Some(place.read()?.sequence));
        let any = numbers().next()?;
        numbers().max_by_key(|number| number.wrapping_sub(any) as i32)
    }
}

/// The recorder. Every pattern of its words is one: it may be put over memory that nobody has
/// written.
pub struct BlackBox {
    transitions: Lane<TRANSITIONS>,
    events: Lane<EVENTS>,
    behaviours: Lane<BEHAVIOUR_RECORDS>,
    /// Sequence number of the next record.
    next: AtomicU32,
}

impl Default for BlackBox {
    fn default() -> Self {
        Self::new()
    }
}

impl BlackBox {
    /// A recorder without a record.
    pub const fn new() -> Self {
        BlackBox {
            transitions: Lane::empty(),
            events: Lane::empty(),
            behaviours: Lane::empty(),
            next: AtomicU32::new(0),
        }
    }

    fn places(&self) -> impl Iterator<Item = &Place> {
        let places = self.transitions.places.iter().chain(&self.events.places);
        places.chain(&self.behaviours.places)
    }

    /// Forgets all records: what stands there is what power-on left.
    pub(crate) fn clear(&self) {
        if !KEEPS_RECORDS {
            return;
        }
        self.places().for_each(Place::clear);
        self.transitions.next.store(0, Relaxed);
        self.events.next.store(0, Relaxed);
        self.behaviours.next.store(0, Relaxed);
        self.next.store(0, Relaxed);
    }

    /// Goes on behind the records that are there, after a reset that may have come at any
    /// instruction of a write.
    pub(crate) fn resume(&self) {
        if !KEEPS_RECORDS {
            return;
        }
        let newest = [
            self.transitions.newest(),
            self.events.newest(),
            self.behaviours.newest(),
        ];
        let [transition, event, behaviour] = newest.map(Option::unwrap_or_default);
        self.transitions.resume(transition);
        self.events.resume(event);
        self.behaviours.resume(behaviour);
        let later = |one: u32, other: u32| {
            if (one.wrapping_sub(other) as i32) < 0 {
                other
            } else {
                one
            }
        };
        let newest = newest.into_iter().flatten().reduce(later);
        let next = newest.map_or(0, |newest| newest.wrapping_add(1));
        self.next.store(next, Relaxed);
    }

    /// Writes down what happens at this robot time.
    pub fn record(&self, at_us: u64, event: Event) {
        if !KEEPS_RECORDS {
            return;
        }
        let sequence = self.next.load(Relaxed);
        self.next.store(sequence.wrapping_add(1), Relaxed);
        let record = Record {
            sequence,
            at_us,
            event,
        };
        match event {
            Event::Transition { .. } => self.transitions.write(record),
            _ if NOTES && event.is_about_behaviours() => self.behaviours.write(record),
            _ => self.events.write(record),
        }
    }

    /// Sequence number that the next record will have.
    pub fn end(&self) -> u32 {
        self.next.load(Relaxed)
    }

    /// The oldest record from this sequence number on, or the oldest of all.
    pub fn first_from(&self, sequence: Option<u32>) -> Option<Record> {
        if !KEEPS_RECORDS {
            return None;
        }
        let end = self.end();
        // How far before the end: the oldest is farthest.
        let age = |sequence: u32| end.wrapping_sub(sequence);
        let oldest = sequence.map_or(u32::MAX, age);
        let mut first: Option<Record> = None;
        for place in self.places() {
            let known = first.as_ref().map_or(0, |record| age(record.sequence));
            // Most need not be read: a host may ask again and again.
            let age = age(place.sequence());
            if age <= known || age > oldest {
                continue;
            }
            if let Some(record) = place.read() {
                first = Some(record);
            }
        }
        first
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use esm_link::black_box::{PoseFrame, RECORD_BYTES, SAFETY_CHECK};
    use esm_link::message::{Mode, ResetReason, SafeReason};

    use super::*;

    const EXAMPLES: [Event; 14] = [
        Event::Started(ResetReason::BrownOut),
        Event::Ended {
            reason: ResetReason::Panic,
            detail: 77,
        },
        Event::Mission { hash: 0xDEAD_BEEF },
        Event::Transition {
            region_instance: 300,
            transition: 65_535,
        },
        Event::Mode(Mode::Safe(SafeReason::LinkLost)),
        Event::Overrun {
            task_instance: 9,
            took_us: 40_000,
        },
        Event::DeadlineMiss {
            slot: 3,
            count: 1 << 30,
        },
        Event::Behaviour {
            key: 0x1234,
            task: 0xFEDC,
            from: None,
            to: Some(0),
        },
        Event::Behaviour {
            key: 1,
            task: 0,
            from: Some(4),
            to: None,
        },
        Event::Situation {
            key: 2,
            task: 3,
            situation: SAFETY_CHECK,
            reaction: 15,
        },
        Event::PoseX {
            x_mm: -8_388_608,
            heading_mrad: -3_142,
        },
        Event::PoseY {
            y_mm: 8_388_607,
            frame: PoseFrame::Global,
        },
        Event::PoseY {
            y_mm: -1,
            frame: PoseFrame::Counted,
        },
        Event::Corrected {
            is_difference: true,
            is_refused: true,
        },
    ];

    fn all(black_box: &BlackBox) -> Vec<Record> {
        let mut from = None;
        let mut records = Vec::new();
        while let Some(record) = black_box.first_from(from) {
            from = Some(record.sequence.wrapping_add(1));
            records.push(record);
            if from == Some(black_box.end()) {
                break;
            }
        }
        records
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn records_read_back_as_they_were_written_oldest_first() {
        let black_box = BlackBox::new();
        for (at_us, event) in (0..).zip(EXAMPLES) {
            black_box.record(at_us << 33, event);
        }
        let read = all(&black_box);
        let expected = (0..).zip(EXAMPLES).map(|(at_us, event)| Record {
            sequence: at_us,
            at_us: u64::from(at_us) << 33,
            event,
        });
        assert!(read.iter().copied().eq(expected), "{read:?}");
        for record in read {
            assert_eq!(Record::from_bytes(&record.to_bytes()), Some(record));
        }
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn a_machine_that_changes_its_state_all_the_time_does_not_wash_away_why_the_robot_stopped() {
        let black_box = BlackBox::new();
        let stopped = Event::Mode(Mode::Safe(SafeReason::Overruns));
        black_box.record(1, stopped);
        for at_us in 2..1_000 {
            black_box.record(at_us, EXAMPLES[3]);
        }
        let read = all(&black_box);
        assert_eq!(read.len(), 1 + TRANSITIONS);
        assert_eq!(read[0].event, stopped);
        assert_eq!(read.last().map(|record| record.at_us), Some(999));
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn behaviours_that_change_all_the_time_do_not_wash_away_why_the_robot_stopped() {
        let black_box = BlackBox::new();
        let stopped = Event::Mode(Mode::Safe(SafeReason::Overruns));
        black_box.record(1, stopped);
        black_box.record(2, EXAMPLES[3]);
        for at_us in 3..1_000 {
            black_box.record(at_us, EXAMPLES[7]);
        }
        let read = all(&black_box);
        let kept = if NOTES { BEHAVIOUR_RECORDS } else { EVENTS };
        assert_eq!(read.len(), kept + 1 + usize::from(NOTES));
        assert_eq!(read[0].event == stopped, NOTES);
    }

    proptest! {
        /// Whatever the reset tore, what is left is whole, in order, and the records after it come
        /// behind it.
        #[test]
        #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
        fn a_reset_in_the_middle_of_a_write_costs_that_record_at_most(
            before in 0..100usize,
            transitions in any::<u64>(),
            torn in 0..WORDS,
            after in 1..60usize,
            start in any::<u32>(),
        ) {
            let event = |n: usize| if transitions >> (n % 64) & 1 == 1 { EXAMPLES[3] } else { EXAMPLES[4] };
            let black_box = BlackBox::new();
            black_box.next.store(start, Relaxed);
            let mut written = Vec::new();
            for n in 0..before {
                black_box.record(n as u64, event(n));
                written.push((n as u64, event(n)));
            }
            // The one that is torn: some of its words are there, and neither ring has moved on.
            let lost = Record { sequence: black_box.end(), at_us: 1 << 40, event: EXAMPLES[6] };
            let next = black_box.events.next.load(Relaxed) as usize;
            let overwritten = black_box.events.places[next].read();
            for (place, word) in black_box.events.places[next].0.iter().zip(to_words(lost)).take(torn) {
                place.store(word, Relaxed);
            }
            if torn > 0 && let Some(gone) = overwritten {
                // The oldest of its ring: those before it were gone already.
                written.retain(|(at_us, event)| matches!(event, Event::Transition { .. }) || *at_us > gone.at_us);
            }
            black_box.resume();
            for n in before..before + after {
                black_box.record(n as u64, event(n));
                written.push((n as u64, event(n)));
            }
            let read = all(&black_box);
            let kept = |wanted: bool, places: usize| -> Vec<(u64, Event)> {
                let is_wanted = |event: &Event| matches!(event, Event::Transition { .. }) == wanted;
                let of_kind: Vec<_> = written.iter().copied().filter(|(_, event)| is_wanted(event)).collect();
                of_kind[of_kind.len().saturating_sub(places)..].to_vec()
            };
            let mut expected = [kept(true, TRANSITIONS), kept(false, EVENTS)].concat();
            expected.sort_by_key(|(at_us, _)| *at_us);
            let found: Vec<_> = read.iter().map(|record| (record.at_us, record.event)).collect();
            prop_assert_eq!(found, expected);
            prop_assert!(read.windows(2).all(|pair| (pair[0].sequence.wrapping_sub(pair[1].sequence) as i32) < 0));
        }

        #[test]
        fn a_bit_that_tips_over_makes_a_record_none(sequence: u32, at_us in 0..1u64 << 48, example in 0..EXAMPLES.len(), word in 0..WORDS, bit in 0..32u32) {
            let mut words = to_words(Record { sequence, at_us, event: EXAMPLES[example] });
            words[word] ^= 1 << bit;
            prop_assert_eq!(from_words(words), None);
        }

        #[test]
        fn bytes_are_a_record_or_none_and_nothing_panics(bytes: [u8; RECORD_BYTES]) {
            let _ = Record::from_bytes(&bytes);
        }
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn what_power_on_left_is_forgotten() {
        let black_box = BlackBox::new();
        for place in black_box
            .events
            .places
            .iter()
            .chain(&black_box.transitions.places)
        {
            for (number, word) in (1..).zip(&place.0) {
                word.store(0x5A5A_5A5A ^ number << 9, Relaxed);
            }
        }
        black_box.events.next.store(u32::MAX, Relaxed);
        black_box.clear();
        assert_eq!(all(&black_box), []);
        black_box.record(5, EXAMPLES[0]);
        assert_eq!(all(&black_box).len(), 1);
    }
}
