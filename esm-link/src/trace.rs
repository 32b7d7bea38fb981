//! What the interpreter did, as compact binary records. The firmware's observer writes them, the
//! host gives them names.
//!
//! A record is one byte that says its kind and fields after it, whole numbers as LEB128 (seven bits
//! a byte, the lowest first, the high bit set on all but the last byte). Lists begin with their
//! length; the indices in them grow and are written as differences from the one before. A step in
//! which nothing happened, as most are, takes two bytes.

use crate::black_box::Event;

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TraceEvent<'a> {
    /// A mission starts; its first macro step is next.
    Started {
        /// Its hash.
        mission: u32,
        /// When, in microseconds since the first macro step of the first mission.
        start_us: u64,
    },
    /// A transition was taken, in the macro step that the next [`Step`](TraceEvent::Step),
    /// [`Same`](TraceEvent::Same) or [`Fault`](TraceEvent::Fault) ends.
    Transition {
        /// Events of the macro step before this one.
        micro: u8,
        /// The region instance.
        region_instance: u16,
        /// Index of the transition in the blob.
        transition: u16,
    },
    /// A macro step ended.
    Step {
        /// Its number, from 0.
        step: u64,
        /// Events that it handled.
        micro_steps: u8,
        /// Current local states.
        states: States<'a>,
        /// Enabled task instances.
        enabled: Indices<'a>,
    },
    /// The macro step after the last one ended and left states and enabled tasks as they were.
    Same {
        /// Events that it handled.
        micro_steps: u8,
    },
    /// The machine stopped.
    Fault {
        /// Number of the macro step.
        step: u64,
        /// Why.
        code: FaultCode,
    },
    /// A run in slot 0 started.
    BackgroundRunStarted {
        /// The task instance.
        task_instance: u16,
        /// The activation, counted over all slots since the mission started, at whose end this was.
        activation: u64,
    },
    /// A run in slot 0 ended.
    BackgroundRunEnded {
        /// The task instance.
        task_instance: u16,
        /// The activation, counted over all slots since the mission started, at whose start this
        /// became known.
        activation: u64,
    },
    /// A task took longer than its slot.
    Overrun {
        /// The task instance.
        task_instance: u16,
        /// What it took, in microseconds.
        took_us: u32,
    },
    /// Activations of a slot did not start within their period.
    DeadlineMiss {
        /// Index of the slot in the blob.
        slot: u16,
        /// How many.
        count: u32,
    },
    /// The motors are off, and why: the number of a [`SafeReason`](crate::message::SafeReason),
    /// [`EMERGENCY`] for an emergency stop, or none after `stop`.
    MotorsOff {
        /// Why.
        reason: Option<u8>,
    },
    /// A mission on trial was given up. What comes next is the start of the one before, if there
    /// was one.
    FellBack {
        /// Its hash.
        mission: u32,
        /// The number of a [`FallBackReason`](crate::trial::FallBackReason).
        reason: u8,
    },
    /// A task noted something, as the flight recorder keeps it.
    Noted(Event),
}

/// Why motors are off after an emergency stop, beside the numbers of reasons.
pub const EMERGENCY: u8 = u8::MAX - 1;

/// Why a machine stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultCode {
    /// `event-queue-overflow`
    EventQueueOverflow,
    /// `macro-step-limit`
    MacroStepLimit,
}

/// Current states of the active regions: pairs of region instance and state, both indices in the
/// blob's tables, ordered by region instance, which is depth first: each superstate is followed by
/// what is inside.
#[derive(Clone, Copy, PartialEq)]
pub struct States<'a> {
    bytes: &'a [u8],
}

/// Task instances, ordered.
#[derive(Clone, Copy, PartialEq)]
pub struct Indices<'a> {
    bytes: &'a [u8],
}

impl core::fmt::Debug for States<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_map().entries(*self).finish()
    }
}

impl core::fmt::Debug for Indices<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(*self).finish()
    }
}

/// Iterates over [`States`] as (region instance, local state).
pub struct StatesIter<'a> {
    bytes: &'a [u8],
    region_instance: u16,
}

impl Iterator for StatesIter<'_> {
    type Item = (u16, u16);

    fn next(&mut self) -> Option<(u16, u16)> {
        self.region_instance = self
            .region_instance
            .checked_add(take(&mut self.bytes).ok()?)?;
        Some((self.region_instance, take(&mut self.bytes).ok()?))
    }
}

impl<'a> IntoIterator for States<'a> {
    type Item = (u16, u16);
    type IntoIter = StatesIter<'a>;

    fn into_iter(self) -> StatesIter<'a> {
        StatesIter {
            bytes: self.bytes,
            region_instance: 0,
        }
    }
}

/// Iterates over [`Indices`].
pub struct IndicesIter<'a> {
    bytes: &'a [u8],
    index: u16,
}

impl Iterator for IndicesIter<'_> {
    type Item = u16;

    fn next(&mut self) -> Option<u16> {
        self.index = self.index.checked_add(take(&mut self.bytes).ok()?)?;
        Some(self.index)
    }
}

impl<'a> IntoIterator for Indices<'a> {
    type Item = u16;
    type IntoIter = IndicesIter<'a>;

    fn into_iter(self) -> IndicesIter<'a> {
        IndicesIter {
            bytes: self.bytes,
            index: 0,
        }
    }
}

mod kind {
    pub const STARTED: u8 = 0;
    pub const TRANSITION: u8 = 1;
    pub const STEP: u8 = 2;
    pub const SAME: u8 = 3;
    pub const FAULT: u8 = 4;
    pub const BACKGROUND_RUN_STARTED: u8 = 5;
    pub const BACKGROUND_RUN_ENDED: u8 = 6;
    pub const OVERRUN: u8 = 7;
    pub const DEADLINE_MISS: u8 = 8;
    pub const MOTORS_OFF: u8 = 9;
    pub const FELL_BACK: u8 = 10;
    pub const NOTED: u8 = 11;
}

/// Where the bytes of a record go.
pub trait RecordSink {
    /// Takes the next byte of the record.
    fn put(&mut self, byte: u8);
}

/// Writes a number.
pub(crate) fn put_number(sink: &mut impl RecordSink, number: impl Into<u64>) {
    let mut number: u64 = number.into();
    while number >= 0x80 {
        sink.put(number as u8 | 0x80);
        number >>= 7;
    }
    sink.put(number as u8);
}

/// Writes [`TraceEvent::Step`] from iterators: `states` as (region instance, local state),
/// `enabled` as task instances, both ordered by index, and cheap to go through twice.
pub fn write_step(
    sink: &mut impl RecordSink,
    step: u64,
    micro_steps: u8,
    states: impl Iterator<Item = (u16, u16)> + Clone,
    enabled: impl Iterator<Item = u16> + Clone,
) {
    sink.put(kind::STEP);
    put_number(sink, step);
    sink.put(micro_steps);
    put_number(sink, states.clone().count() as u64);
    let mut last = 0;
    for (region_instance, state) in states {
        put_number(sink, region_instance.wrapping_sub(last));
        put_number(sink, state);
        last = region_instance;
    }
    put_number(sink, enabled.clone().count() as u64);
    let mut last = 0;
    for task_instance in enabled {
        put_number(sink, task_instance.wrapping_sub(last));
        last = task_instance;
    }
}

impl<'a> TraceEvent<'a> {
    /// Writes the record.
    pub fn write(&self, sink: &mut impl RecordSink) {
        match *self {
            TraceEvent::Started { mission, start_us } => {
                sink.put(kind::STARTED);
                for byte in mission.to_le_bytes() {
                    sink.put(byte);
                }
                put_number(sink, start_us);
            }
            TraceEvent::Transition {
                micro,
                region_instance,
                transition,
            } => {
                sink.put(kind::TRANSITION);
                sink.put(micro);
                put_number(sink, region_instance);
                put_number(sink, transition);
            }
            TraceEvent::Step {
                step,
                micro_steps,
                states,
                enabled,
            } => {
                write_step(
                    sink,
                    step,
                    micro_steps,
                    StatesIter::from(states),
                    IndicesIter::from(enabled),
                );
            }
            TraceEvent::Same { micro_steps } => {
                sink.put(kind::SAME);
                sink.put(micro_steps);
            }
            TraceEvent::Fault { step, code } => {
                sink.put(kind::FAULT);
                put_number(sink, step);
                sink.put(code as u8);
            }
            TraceEvent::BackgroundRunStarted {
                task_instance,
                activation,
            } => {
                sink.put(kind::BACKGROUND_RUN_STARTED);
                put_number(sink, task_instance);
                put_number(sink, activation);
            }
            TraceEvent::BackgroundRunEnded {
                task_instance,
                activation,
            } => {
                sink.put(kind::BACKGROUND_RUN_ENDED);
                put_number(sink, task_instance);
                put_number(sink, activation);
            }
            TraceEvent::Overrun {
                task_instance,
                took_us,
            } => {
                sink.put(kind::OVERRUN);
                put_number(sink, task_instance);
                put_number(sink, took_us);
            }
            TraceEvent::DeadlineMiss { slot, count } => {
                sink.put(kind::DEADLINE_MISS);
                put_number(sink, slot);
                put_number(sink, count);
            }
            TraceEvent::MotorsOff { reason } => {
                sink.put(kind::MOTORS_OFF);
                sink.put(reason.map_or(0, |reason| reason.saturating_add(1)));
            }
            TraceEvent::FellBack { mission, reason } => {
                sink.put(kind::FELL_BACK);
                for byte in mission.to_le_bytes() {
                    sink.put(byte);
                }
                sink.put(reason);
            }
            TraceEvent::Noted(event) => {
                let (kind, small, large) = event.pack();
                sink.put(kind::NOTED);
                sink.put(kind);
                sink.put(small);
                for byte in large.to_le_bytes() {
                    sink.put(byte);
                }
            }
        }
    }

    /// Takes the first record off some bytes.
    ///
    /// # Errors
    /// See [`TraceError`]. After an error the rest of the bytes means nothing; the next part of the
    /// stream that does not continue a record begins with a new one.
    pub fn take(bytes: &mut &'a [u8]) -> Result<TraceEvent<'a>, TraceError> {
        Ok(match byte(bytes)? {
            kind::STARTED => TraceEvent::Started {
                mission: hash(bytes)?,
                start_us: take(bytes)?,
            },
            kind::TRANSITION => TraceEvent::Transition {
                micro: byte(bytes)?,
                region_instance: take(bytes)?,
                transition: take(bytes)?,
            },
            kind::STEP => TraceEvent::Step {
                step: take(bytes)?,
                micro_steps: byte(bytes)?,
                states: States {
                    bytes: list(bytes, 2)?,
                },
                enabled: Indices {
                    bytes: list(bytes, 1)?,
                },
            },
            kind::SAME => TraceEvent::Same {
                micro_steps: byte(bytes)?,
            },
            kind::FAULT => TraceEvent::Fault {
                step: take(bytes)?,
                code: match byte(bytes)? {
                    0 => FaultCode::EventQueueOverflow,
                    1 => FaultCode::MacroStepLimit,
                    _ => return Err(TraceError::Unknown),
                },
            },
            kind::BACKGROUND_RUN_STARTED => TraceEvent::BackgroundRunStarted {
                task_instance: take(bytes)?,
                activation: take(bytes)?,
            },
            kind::BACKGROUND_RUN_ENDED => TraceEvent::BackgroundRunEnded {
                task_instance: take(bytes)?,
                activation: take(bytes)?,
            },
            kind::OVERRUN => TraceEvent::Overrun {
                task_instance: take(bytes)?,
                took_us: take(bytes)?,
            },
            kind::DEADLINE_MISS => TraceEvent::DeadlineMiss {
                slot: take(bytes)?,
                count: take(bytes)?,
            },
            kind::MOTORS_OFF => TraceEvent::MotorsOff {
                reason: byte(bytes)?.checked_sub(1),
            },
            kind::FELL_BACK => TraceEvent::FellBack {
                mission: hash(bytes)?,
                reason: byte(bytes)?,
            },
            kind::NOTED => {
                let (kind, small) = (byte(bytes)?, byte(bytes)?);
                let event = Event::unpack(kind, small, hash(bytes)?);
                TraceEvent::Noted(event.ok_or(TraceError::Unknown)?)
            }
            _ => return Err(TraceError::Unknown),
        })
    }
}

impl<'a> From<States<'a>> for StatesIter<'a> {
    fn from(states: States<'a>) -> Self {
        states.into_iter()
    }
}

impl<'a> From<Indices<'a>> for IndicesIter<'a> {
    fn from(indices: Indices<'a>) -> Self {
        indices.into_iter()
    }
}

impl Clone for StatesIter<'_> {
    fn clone(&self) -> Self {
        StatesIter { ..*self }
    }
}

impl Clone for IndicesIter<'_> {
    fn clone(&self) -> Self {
        IndicesIter { ..*self }
    }
}

/// Why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TraceError {
    /// The bytes end within a record.
    Incomplete,
    /// No record has this kind or this value.
    Unknown,
}

impl core::fmt::Display for TraceError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            TraceError::Incomplete => "the bytes end within a record",
            TraceError::Unknown => "no record has this kind or this value",
        })
    }
}

impl core::error::Error for TraceError {}

pub(crate) fn byte(bytes: &mut &[u8]) -> Result<u8, TraceError> {
    let (first, rest) = bytes.split_first().ok_or(TraceError::Incomplete)?;
    *bytes = rest;
    Ok(*first)
}

/// Takes the hash of a mission.
pub(crate) fn hash(bytes: &mut &[u8]) -> Result<u32, TraceError> {
    let (hash, rest) = bytes.split_first_chunk().ok_or(TraceError::Incomplete)?;
    *bytes = rest;
    Ok(u32::from_le_bytes(*hash))
}

pub(crate) fn take<N: TryFrom<u64>>(bytes: &mut &[u8]) -> Result<N, TraceError> {
    let mut number = 0u64;
    for shift in (0..u64::BITS).step_by(7) {
        let next = byte(bytes)?;
        number |= u64::from(next & 0x7f) << shift;
        if next & 0x80 == 0 {
            return N::try_from(number).map_err(|_| TraceError::Unknown);
        }
    }
    Err(TraceError::Unknown)
}

/// Takes a list of groups of numbers, each of which fits 16 bits.
fn list<'a>(bytes: &mut &'a [u8], numbers_in_group: u32) -> Result<&'a [u8], TraceError> {
    let groups: u16 = take(bytes)?;
    let start = *bytes;
    for _ in 0..u32::from(groups) * numbers_in_group {
        take::<u16>(bytes)?;
    }
    let len = start.len() - bytes.len();
    start.get(..len).ok_or(TraceError::Incomplete)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    impl RecordSink for Vec<u8> {
        fn put(&mut self, byte: u8) {
            self.push(byte);
        }
    }

    fn records() -> Vec<(TraceEvent<'static>, usize)> {
        // 3 and 300 regions on, in states 1 and 200; task instances 0 and 129.
        let states = States {
            bytes: &[3, 1, 0xac, 0x02, 0xc8, 0x01],
        };
        let enabled = Indices {
            bytes: &[0, 0x81, 0x01],
        };
        std::vec![
            (
                TraceEvent::Started {
                    mission: 0x1234_5678,
                    start_us: 300
                },
                7
            ),
            (
                TraceEvent::Transition {
                    micro: 1,
                    region_instance: 2,
                    transition: 3
                },
                4
            ),
            (
                TraceEvent::Transition {
                    micro: 255,
                    region_instance: 65_535,
                    transition: 65_535
                },
                8
            ),
            (
                TraceEvent::Step {
                    step: 5_000_000_000,
                    micro_steps: 2,
                    states,
                    enabled
                },
                18
            ),
            (TraceEvent::Same { micro_steps: 1 }, 2),
            (
                TraceEvent::Fault {
                    step: 9,
                    code: FaultCode::EventQueueOverflow
                },
                3
            ),
            (
                TraceEvent::Fault {
                    step: 9,
                    code: FaultCode::MacroStepLimit
                },
                3
            ),
            (
                TraceEvent::BackgroundRunStarted {
                    task_instance: 4,
                    activation: 1 << 40
                },
                8
            ),
            (
                TraceEvent::BackgroundRunEnded {
                    task_instance: 4,
                    activation: 17
                },
                3
            ),
            (
                TraceEvent::Overrun {
                    task_instance: 4,
                    took_us: 1_500
                },
                4
            ),
            (TraceEvent::DeadlineMiss { slot: 1, count: 2 }, 3),
            (TraceEvent::MotorsOff { reason: None }, 2),
            (TraceEvent::MotorsOff { reason: Some(3) }, 2),
            (
                TraceEvent::MotorsOff {
                    reason: Some(EMERGENCY),
                },
                2,
            ),
            (
                TraceEvent::FellBack {
                    mission: 0x8765_4321,
                    reason: 4
                },
                6
            ),
        ]
    }

    #[test]
    fn records_read_back_as_they_were_written() {
        let mut bytes = Vec::new();
        for (record, size) in records() {
            let before = bytes.len();
            record.write(&mut bytes);
            assert_eq!(bytes.len() - before, size, "{record:?}");
        }
        let mut rest = &bytes[..];
        for (record, _) in records() {
            assert_eq!(TraceEvent::take(&mut rest), Ok(record));
        }
        assert_eq!(rest, []);
    }

    #[test]
    fn lists_give_the_indices_that_were_written() {
        let states = [(0, 7), (1, 0), (999, 1_000), (65_535, 65_535)];
        let enabled = [5, 6, 700];
        let mut bytes = Vec::new();
        write_step(&mut bytes, 1, 1, states.into_iter(), enabled.into_iter());
        let TraceEvent::Step {
            states: s,
            enabled: e,
            ..
        } = TraceEvent::take(&mut &bytes[..]).unwrap()
        else {
            panic!("a step was written")
        };
        assert_eq!(s.into_iter().collect::<Vec<_>>(), states);
        assert_eq!(e.into_iter().collect::<Vec<_>>(), enabled);
    }

    #[test]
    fn a_cut_record_is_incomplete_and_nothing_panics() {
        for (record, size) in records() {
            let mut bytes = Vec::new();
            record.write(&mut bytes);
            for cut in 0..size {
                assert_eq!(
                    TraceEvent::take(&mut &bytes[..cut]),
                    Err(TraceError::Incomplete),
                    "{record:?} cut at {cut}"
                );
            }
            for at in 0..size {
                for value in 0..=255 {
                    let mut changed = bytes.clone();
                    changed[at] = value;
                    let _ = TraceEvent::take(&mut &changed[..]);
                }
            }
        }
    }
}
