//! What entered the interpreter, as compact binary records: enough to have the same run again. The
//! firmware writes them between macro steps, whoever replays reads them.
//!
//! A macro step is made of what the machine is and of the flags that tasks wrote since the one
//! before, so these are all that is recorded, by how they differ. A macro step before which nothing
//! changed only lengthens a count.
//!
//! A record begins with a number, written as in [trace records](crate::trace): four times the macro
//! steps without a change before it, and what follows in the two low bits. 1 and 2 are as many
//! changed bits, 3 is three and as many more as the next number says; 0 is one of the kinds below,
//! whose byte is next. Bits are counted as in
//! [`Interpreter::input_words`](esm_core::Interpreter::input_words): flags, and from the next
//! multiple of 32 on the enable bits of task instances. The first is a number, each further one the
//! difference from the one before. Each such bit is turned over, and then the next macro step is
//! made.

use esm_core::{Fault, Progress};

use crate::trace::{RecordSink, TraceError, byte, hash, put_number, take};

/// Macro steps without a change after which a record says so, at most: a reader is never further
/// behind than this.
pub const MAX_QUIET: u32 = 128;

/// Bytes of [`Recorded::State`] at most beside its words, and of each word.
pub const STATE_HEADER_BYTES: usize = 1 + 1 + 4 + 10 + 10 + 5 + 1 + 3;
/// See [`STATE_HEADER_BYTES`].
pub const STATE_WORD_BYTES: usize = 5;

/// Something that entered the interpreter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Recorded<'a> {
    /// These bits of flags and enable bits were turned over before the next macro step, which is
    /// made.
    Changes {
        /// Macro steps before that one without a change.
        quiet: u32,
        /// The bits.
        bits: Bits<'a>,
    },
    /// So many macro steps had no change.
    Quiet {
        /// How many.
        quiet: u32,
    },
    /// A mission starts, from its beginning; its first macro step is next.
    Started {
        /// Macro steps of the mission before, without a change, since the last record.
        quiet: u32,
        /// Whether something before it did not come, or never will: it is the first that this
        /// subscription brings, or records before it found no room.
        anew: bool,
        /// Its hash.
        mission: u32,
        /// When, in microseconds since the first macro step of the first mission.
        start_us: u64,
    },
    /// Macro steps were left out before the next one: their activations were missed.
    Skipped {
        /// Macro steps before that without a change.
        quiet: u32,
        /// How many were left out.
        missed: u32,
    },
    /// All that the machine is before the next macro step: where a recording begins in the middle
    /// of a mission, and after what was lost.
    State {
        /// As of [`Recorded::Started`].
        anew: bool,
        /// Hash of the mission.
        mission: u32,
        /// When it started, in microseconds since the first macro step of the first mission.
        start_us: u64,
        /// Numbers of the machine.
        progress: Progress,
        /// Words of the machine, as in
        /// [`Interpreter::state_words`](esm_core::Interpreter::state_words).
        words: Words<'a>,
    },
}

/// Bits that were turned over, ascending.
#[derive(Clone, Copy, PartialEq)]
pub struct Bits<'a> {
    bytes: &'a [u8],
}

/// Words of a machine.
#[derive(Clone, Copy, PartialEq)]
pub struct Words<'a> {
    bytes: &'a [u8],
}

impl core::fmt::Debug for Bits<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl core::fmt::Debug for Words<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<'a> Bits<'a> {
    /// The bits.
    pub fn iter(self) -> impl Iterator<Item = u32> + use<'a> {
        let mut bytes = self.bytes;
        let mut last = 0u32;
        core::iter::from_fn(move || {
            last = last.wrapping_add(take(&mut bytes).ok()?);
            Some(last)
        })
    }
}

impl<'a> Words<'a> {
    /// The words.
    pub fn iter(self) -> impl Iterator<Item = u32> + use<'a> {
        let mut bytes = self.bytes;
        core::iter::from_fn(move || take(&mut bytes).ok())
    }
}

mod code {
    pub const KIND: u32 = 0;
    pub const MANY: u32 = 3;
    pub const BITS: u32 = 2;
}

mod kind {
    pub const QUIET: u8 = 0;
    pub const STARTED: u8 = 1;
    pub const SKIPPED: u8 = 2;
    pub const STATE: u8 = 3;
    /// Of the two beginnings: nothing is known of what was before.
    pub const ANEW: u8 = 4;
}

fn beginning(kind: u8, anew: bool) -> u8 {
    if anew { kind | kind::ANEW } else { kind }
}

/// What [`Recorded::State`] says of faults: none, and each by its number.
const FAULTS: [Option<Fault>; 3] = [
    None,
    Some(Fault::EventQueueOverflow),
    Some(Fault::MacroStepLimit),
];
const IS_AWAKE: u8 = 0x80;

fn put_head(sink: &mut impl RecordSink, quiet: u32, code: u32) {
    put_number(sink, u64::from(quiet) << code::BITS | u64::from(code));
}

fn put_kind(sink: &mut impl RecordSink, quiet: u32, kind: u8) {
    put_head(sink, quiet, code::KIND);
    sink.put(kind);
}

/// Writes [`Recorded::Changes`]. The bits ascend, are at least one, and are cheap to go through
/// twice.
pub fn write_changes(
    sink: &mut impl RecordSink,
    quiet: u32,
    bits: impl Iterator<Item = u32> + Clone,
) {
    let count = bits.clone().count() as u32;
    put_head(sink, quiet, count.min(code::MANY));
    if let Some(more) = count.checked_sub(code::MANY) {
        put_number(sink, more);
    }
    let mut last = 0;
    for bit in bits {
        put_number(sink, bit - last);
        last = bit;
    }
}

/// Writes [`Recorded::Quiet`].
pub fn write_quiet(sink: &mut impl RecordSink, quiet: u32) {
    put_kind(sink, quiet, kind::QUIET);
}

/// Writes [`Recorded::Started`].
pub fn write_started(
    sink: &mut impl RecordSink,
    quiet: u32,
    anew: bool,
    mission: u32,
    start_us: u64,
) {
    put_kind(sink, quiet, beginning(kind::STARTED, anew));
    put_mission(sink, mission, start_us);
}

/// Writes [`Recorded::Skipped`].
pub fn write_skipped(sink: &mut impl RecordSink, quiet: u32, missed: u32) {
    put_kind(sink, quiet, kind::SKIPPED);
    put_number(sink, missed);
}

/// Writes [`Recorded::State`].
pub fn write_state(
    sink: &mut impl RecordSink,
    anew: bool,
    mission: u32,
    start_us: u64,
    progress: &Progress,
    words: &[u32],
) {
    put_kind(sink, 0, beginning(kind::STATE, anew));
    put_mission(sink, mission, start_us);
    put_number(sink, progress.steps);
    put_number(sink, progress.steps_left);
    let fault = FAULTS.iter().position(|fault| *fault == progress.fault);
    let awake = if progress.is_awake { IS_AWAKE } else { 0 };
    sink.put(fault.unwrap_or_default() as u8 | awake);
    put_number(sink, words.len() as u64);
    for word in words {
        put_number(sink, *word);
    }
}

fn put_mission(sink: &mut impl RecordSink, mission: u32, start_us: u64) {
    for byte in mission.to_le_bytes() {
        sink.put(byte);
    }
    put_number(sink, start_us);
}

fn take_mission(bytes: &mut &[u8]) -> Result<(u32, u64), TraceError> {
    Ok((hash(bytes)?, take(bytes)?))
}

impl<'a> Recorded<'a> {
    /// Takes the first record off some bytes.
    ///
    /// # Errors
    /// See [`TraceError`]. After an error the rest of the bytes means nothing.
    pub fn take(bytes: &mut &'a [u8]) -> Result<Recorded<'a>, TraceError> {
        Self::take_within(bytes, MAX_QUIET)
    }

    /// The same of records that count more macro steps without a change, up to `most_quiet`: those
    /// that a host has put together.
    ///
    /// # Errors
    /// See [`TraceError`]. After an error the rest of the bytes means nothing.
    pub fn take_within(bytes: &mut &'a [u8], most_quiet: u32) -> Result<Recorded<'a>, TraceError> {
        let head: u32 = take(bytes)?;
        let quiet = head >> code::BITS;
        if quiet > most_quiet {
            return Err(TraceError::Unknown);
        }
        let count = match head & code::MANY {
            code::KIND => return Self::take_kind(bytes, quiet),
            code::MANY => take::<u16>(bytes)?
                .checked_add(code::MANY as u16)
                .ok_or(TraceError::Unknown)?,
            few => few as u16,
        };
        let bytes = numbers::<u32>(bytes, count)?;
        Ok(Recorded::Changes {
            quiet,
            bits: Bits { bytes },
        })
    }

    fn take_kind(bytes: &mut &'a [u8], quiet: u32) -> Result<Recorded<'a>, TraceError> {
        const STARTED_ANEW: u8 = kind::STARTED | kind::ANEW;
        const STATE_ANEW: u8 = kind::STATE | kind::ANEW;
        let kind = byte(bytes)?;
        let anew = kind & kind::ANEW != 0;
        Ok(match kind {
            kind::QUIET => Recorded::Quiet { quiet },
            kind::STARTED | STARTED_ANEW => {
                let (mission, start_us) = take_mission(bytes)?;
                Recorded::Started {
                    quiet,
                    anew,
                    mission,
                    start_us,
                }
            }
            kind::SKIPPED => Recorded::Skipped {
                quiet,
                missed: take(bytes)?,
            },
            kind::STATE | STATE_ANEW => {
                let (mission, start_us) = take_mission(bytes)?;
                let (steps, steps_left) = (take(bytes)?, take(bytes)?);
                let marks = byte(bytes)?;
                let fault = FAULTS
                    .get(usize::from(marks & !IS_AWAKE))
                    .ok_or(TraceError::Unknown)?;
                let count = take(bytes)?;
                Recorded::State {
                    anew,
                    mission,
                    start_us,
                    progress: Progress {
                        steps,
                        steps_left,
                        is_awake: marks & IS_AWAKE != 0,
                        fault: *fault,
                    },
                    words: Words {
                        bytes: numbers::<u32>(bytes, count)?,
                    },
                }
            }
            _ => return Err(TraceError::Unknown),
        })
    }
}

/// Takes so many numbers.
fn numbers<'a, N: TryFrom<u64>>(bytes: &mut &'a [u8], count: u16) -> Result<&'a [u8], TraceError> {
    let start = *bytes;
    for _ in 0..count {
        take::<N>(bytes)?;
    }
    let len = start.len() - bytes.len();
    start.get(..len).ok_or(TraceError::Incomplete)
}
