//! The one pass that a blob must survive before anything is taken from it.
//!
//! What it proves is what the [format](mod@crate::format) says: every index points into its table,
//! every part begins where the one before ended, every jump goes ahead, and each record of the
//! instance tree is what its template makes of it.
//!
//! It walks the instances in the order of their numbers, and of each its regions, and of each
//! region its states. An instance says what must stand in the records of its region instances and
//! task instances, and in those of the instances inside its superstates. The first instance of a
//! container is its *model*: there the walk checks the template, too, with transitions and code,
//! and that the container's spans (flags, tasks, regions, instances that one instance of it takes)
//! are the sums of its parts. So no container can hold itself, and the machine's spans are what the
//! tables hold: nothing is claimed twice, and nothing is left out. Other tables are checked a
//! record at a time. Time grows with the number of state instances, which is bounded, and with the
//! square of the number of slots, which is, too; the depth of the stack is constant.
//!
//! Most of it stands in tables of rules, in `rules.rs`: what must be equal or below, where a record
//! is, which list applies to which part. Here is what applies them, and the few steps that take
//! numbers apart.
//!
//! # What stands when a blob has passed
//!
//! Reads that check nothing again name the one of these that they rely on.
//!
//! * **mission**: the queue holds 1 to 255 events; the interpreter's slot exists; no event's number
//!   is above the mission's count. The flags of the whole machine are as many as the mission says.
//! * **tree**: the region instances of an instance, and all that is inside them, stand together;
//!   `next` of a region instance is above its number and at most their count, and what lies between
//!   is inside it. The instance of a region instance, the container and the region instance around
//!   of an instance, the instance inside a superstate (the instance plus *a*) with its first region
//!   instance exist, and the numbers of what is inside are above.
//! * **current**: `initial` of a region instance, and each target of a transition out of a state of
//!   its region, is a state of its region; a target is never `initial`.
//! * **flags**: the first flag of an instance plus any relative flag that a state, test or action
//!   of its container names is below the mission's count of flags; so are all flags of a state's
//!   block. Tests name flags at the head of the block of their instance, or own ones of the state
//!   that is left; actions the same of the state that is entered.
//! * **transitions**: those of a state are a range in the table, as long as the next state's begin
//!   behind. Those on the pulse come first, up to *first not on the pulse*; the others are sorted
//!   by their events. `events` has a bit for each, and no other. `final` has none.
//! * **plain**: the mark is set on every transition from `initial` or a simple state to a simple
//!   state without flags that has no action; on every one on the pulse from a real-time task state
//!   without timeout and with at most [`format::PLAIN_FLAGS`] flags to itself whose action is one
//!   `send`; and on no other.
//! * **guards**: a bit is one of the state's own flags; a mask has two bits at least, all own
//!   flags, its value no others; a program ends, its jumps lead ahead and to its end at most, it
//!   looks inside superstates only. All code records that they need exist. Where *b* of a state
//!   without timeout is not 0, that many of its first transitions are on the pulse, with guards
//!   that are bits, each one more than the guard before.
//! * **actions**: a row ends. The channels of an instance exist: its first plus the one that is
//!   named. No action writes `exit` or `timeout` of a state or superstate.
//! * **timers**: a state with a timeout has a flag for it and a record among the timers, of at most
//!   [`format::MAX_TIME_US`]. So nothing but entering its state resets a timeout flag.
//! * **rows**: a channel's words are in the table of listeners, and those of its region words that
//!   exist; a bit is that of a region instance. Its event is not the pulse.
//! * **tasks**: a task instance exists for each task state of each instance; its state, region
//!   instance, first flag, task state are right. The task of a task state, its slot, its parameters
//!   and the connections of a task instance exist, as many as the task has; the state has as many
//!   flags as the task.
//! * **slots**: their periods are not 0, and no two are ever due at once.
//!
//! Texts are not looked at: see [`crate::texts`].

use core::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::arena::ArenaLayout;
use crate::buffer::{BlobBuffer, BlobReader};
use crate::format::{self, Section};
use crate::layout::Field;
use crate::rules::{self, List, Value, rule};
use crate::tables::{self, Tables};

/// Why a blob is refused. It must be built again, or sent again; none of these can be put right on
/// the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// It does not begin as a blob of this format's version does.
    Magic,
    /// It ends too early, or lengths in it are wrong.
    Cut,
    /// There are bytes between its last section and the CRC.
    TrailingBytes,
    /// Its bytes changed on the way.
    Checksum {
        /// What the blob says.
        stored: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// The length of a section is no multiple of its record's, or more than indices can reach.
    SectionLength(Section),
    /// A record is wrong.
    Record {
        /// Its table.
        section: Section,
        /// Its position in the table, or the table's length where records are missing.
        index: u16,
        /// What is wrong.
        cause: Cause,
    },
}

/// What is wrong with a record.
// From 1, so that "nothing is wrong" is 0, for which cores have shorter instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum Cause {
    /// An index points outside of what it may point to.
    Index = 1,
    /// A part does not begin where the one before it ended, or parts are missing or left over.
    Order,
    /// A number is outside its range.
    Range,
    /// A kind or an operation is unknown, or not allowed there.
    Kind,
    /// A jump does not go ahead, or goes too far.
    Direction,
    /// A record of the instance tree is not what its template makes of it.
    Template,
    /// A text is malformed, or its hash or its counts differ; told by
    /// [`texts::check`](crate::texts::check) alone.
    Text,
    /// A port's type is not that of its net; told by [`texts::check`](crate::texts::check) alone.
    Type,
    /// Two slots overlap, or have the same number.
    Overlap,
}

impl Cause {
    /// The cause with a number.
    // Spelt out it is no code at all, where a table would have to be looked up.
    #[cfg_attr(feature = "speed", inline(always))]
    fn with_number(number: u8) -> Option<Self> {
        Some(match number {
            1 => Self::Index,
            2 => Self::Order,
            3 => Self::Range,
            4 => Self::Kind,
            5 => Self::Direction,
            6 => Self::Template,
            7 => Self::Text,
            8 => Self::Type,
            9 => Self::Overlap,
            _ => return None,
        })
    }
}

/// Where the sections of a blob are, and what was worked out on the way.
#[derive(Clone, Copy, Debug)]
struct Layout {
    sections: tables::Sections,
    crc: u32,
}

/// A blob that passed [`verify`]. Only such a blob can be interpreted.
///
/// `B` must give the same bytes whenever it is dereferenced, as every slice, vector or array does.
/// If it does not, the interpreter may do nonsense, but no memory is at risk.
#[derive(Clone, Debug)]
pub struct Verified<B> {
    bytes: B,
    layout: Layout,
}

/// Checks a blob from the first byte to the last.
///
/// # Errors
/// Gives the bytes back, with the first thing that is wrong.
pub fn verify<B: Deref<Target = [u8]>>(bytes: B) -> Result<Verified<B>, (B, Refusal)> {
    let mut layout = Layout {
        sections: [(0, 0); _],
        crc: 0,
    };
    match check(&bytes, &mut layout) {
        Ok(()) => Ok(Verified { bytes, layout }),
        Err(refusal) => Err((bytes, refusal)),
    }
}

impl<B: Deref<Target = [u8]>> Verified<B> {
    /// The tables.
    #[inline]
    #[must_use]
    pub fn tables(&self) -> Tables<'_> {
        self.layout.tables(&self.bytes)
    }

    /// The blob as it was given to [`verify`].
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The same blob, borrowed: for another machine of it, which need not be checked again.
    #[must_use]
    pub fn by_ref(&self) -> Verified<&[u8]> {
        Verified {
            bytes: &self.bytes,
            layout: self.layout,
        }
    }

    /// Gives the blob back.
    pub fn into_bytes(self) -> B {
        self.bytes
    }

    /// The mission hash: the CRC-32 at the blob's end.
    #[must_use]
    pub fn hash(&self) -> u32 {
        self.layout.crc
    }

    /// 32-bit words that [`Interpreter::new`](crate::Interpreter::new) needs: one and a half and
    /// two bits for each region instance, a bit for each flag and each task instance, and half a
    /// word for each place in the queue.
    #[must_use]
    pub fn arena_words(&self) -> usize {
        ArenaLayout::of(&self.tables()).words()
    }

    /// [`Self::arena_words`] in bytes.
    #[must_use]
    pub fn ram_bytes(&self) -> usize {
        self.arena_words() * size_of::<u32>()
    }
}

impl<'m> Verified<BlobBuffer<'m>> {
    /// The same for somebody else, as long as the blob is where it is: see [`BlobBuffer::lend`].
    pub fn lend(&mut self) -> Option<Verified<BlobReader<'m>>> {
        let layout = self.layout;
        (self.bytes.lend()).map(|bytes| Verified { bytes, layout })
    }
}

impl Layout {
    #[inline]
    fn tables<'a>(&'a self, bytes: &'a [u8]) -> Tables<'a> {
        Tables::new(bytes, &self.sections)
    }

    /// Reads the envelope: the postcard encoding of [`format::Envelope`].
    fn read(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        if !bytes.starts_with(&format::MAGIC) {
            return Err(Refusal::Magic);
        }
        let (body, crc) = bytes
            .split_last_chunk::<{ format::CRC_BYTES }>()
            .ok_or(Refusal::Cut)?;
        let stored = u32::from_le_bytes(*crc);
        let computed = format::crc32(body);
        if stored != computed {
            return Err(Refusal::Checksum { stored, computed });
        }
        self.crc = stored;
        let mut at = format::MAGIC.len();
        for (section, place) in self.sections.iter_mut().enumerate() {
            let length = format::read_varint(body, &mut at).ok_or(Refusal::Cut)?;
            let record_bytes = tables::record_bytes_at(section);
            let records = length / record_bytes;
            *place = (at as u32, records);
            if body.len().wrapping_sub(at) < length as usize {
                return Err(Refusal::Cut);
            }
            at += length as usize;
            // Before the first of them is looked at: the time that slots take grows with their
            // square.
            let most = match section == Section::Slots as usize {
                true => format::MAX_SLOTS,
                false => format::NONE - 1,
            };
            let too_many = record_bytes > 1 && records > u32::from(most);
            if records * record_bytes != length || too_many {
                return Err(Refusal::SectionLength(Section::with_number(section as u8)));
            }
        }
        if at != body.len() {
            return Err(Refusal::TrailingBytes);
        }
        Ok(())
    }
}

/// The whole check.
#[inline(never)]
fn check(bytes: &[u8], layout: &mut Layout) -> Result<(), Refusal> {
    layout.read(bytes)?;
    let mut pass = Pass {
        section: Section::Mission as u8,
        index: 0,
        wrong: 0,
        values: [0; _],
        tables: layout.tables(bytes),
    };
    pass.check();
    match Cause::with_number(pass.wrong) {
        Some(cause) => Err(Refusal::Record {
            section: Section::with_number(pass.section),
            index: pass.index as u16,
            cause,
        }),
        None => Ok(()),
    }
}

/// The pass. The record under test is the one that was read last. After the first thing that is
/// wrong nothing is read, and the pass goes on as far as the next loop: so most checks need no way
/// out.
// In this order the values are at its own address, which is what most lines need.
#[repr(C)]
struct Pass<'a> {
    /// What the [rules] speak of.
    values: [u32; rules::VALUES],
    section: u8,
    index: u32,
    /// Number of the [`Cause`]; 0 as long as nothing is wrong.
    wrong: u8,
    tables: Tables<'a>,
}

impl Pass<'_> {
    fn check(&mut self) {
        for section in 0..Section::ALL.len() as u8 {
            self.set(rules::COUNT + section, self.tables.count_at(section));
        }
        self.set(
            rules::MAX_STATE_INSTANCES,
            format::MAX_STATE_INSTANCES as u32,
        );
        self.set(rules::MAX_TIME, format::MAX_TIME_US);
        self.apply(List::Mission as u8);
        // Nothing is missing or left over.
        for section in 0..Section::ALL.len() as u8 {
            let seen = self.get(rules::SEEN + section);
            if self.wrong == 0 && seen != self.get(rules::COUNT + section) {
                self.section = section;
                self.index = seen;
                self.wrong = Cause::Order as u8;
            }
        }
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn get(&self, value: Value) -> u32 {
        self.values[usize::from(value) % rules::VALUES]
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn set(&mut self, value: Value, to: u32) {
        self.values[usize::from(value) % rules::VALUES] = to;
    }

    /// Applies the rules of a list one after another, up to the first that is not kept.
    #[inline(never)]
    fn apply(&mut self, list: u8) {
        let mut at = usize::from(list) * rules::LIST_ALIGNMENT;
        while self.wrong == 0
            && let Some(&[what, left, a, b]) = rules::PACKED.get(at..).and_then(<[u8]>::first_chunk)
        {
            let is_long = left / rules::LONG;
            let this = at;
            let next = at + rules::SHORT_BYTES + usize::from(is_long);
            // The byte behind a short line is the next one's.
            let to = left % rules::LONG;
            let b = b * is_long;
            let passed_over = usize::from(what >> rule::PASSED_SHIFT) + usize::from(b);
            let left = self.get(to);
            let first = self.get(a);
            let second = self.get(b);
            let sum = first.wrapping_add(second);
            let is_kept = match what & rule::WHAT_MASK {
                rule::END => {
                    if what != rule::AND {
                        return;
                    }
                    self.set(to, left & first);
                    true
                }
                rule::IS => left == sum,
                rule::BELOW => left < sum,
                rule::AT_MOST => left <= sum,
                other => {
                    at = next;
                    match other {
                        rule::LET => self.set(to, sum),
                        rule::SUBTRACT => self.set(to, first.wrapping_sub(second)),
                        rule::REMAINDER => self.set(to, first.checked_rem(second).unwrap_or(0)),
                        rule::SPLIT => {
                            let upper = first.wrapping_shr(u32::from(b));
                            self.set(to, upper);
                            self.set(to + 1, first - upper.wrapping_shl(u32::from(b)));
                        }
                        rule::BIT => self.set(to, left | 1_u32.wrapping_shl(first)),
                        rule::NUMBER => self.set(to, u32::from(u16::from_le_bytes([a, b]))),
                        rule::READ => self.read(to, first, b),
                        rule::GIVEN => {
                            if left != first {
                                at += passed_over;
                            }
                        }
                        rule::GIVEN_BELOW => {
                            if left >= first {
                                at += passed_over;
                            }
                        }
                        rule::WHILE => {
                            if left < first {
                                at = this;
                                self.apply(b);
                            }
                        }
                        rule::APPLY => {
                            if left == first {
                                self.apply(b);
                            }
                        }
                        // The rest is one.
                        _ => self.set(to, left.wrapping_add(first)),
                    }
                    continue;
                }
            };
            at = next;
            if !is_kept {
                self.wrong = what >> rule::CAUSE_SHIFT;
            }
        }
    }

    /// Puts a record under test; its words are the values from `to` on, and outside the table those
    /// that stand for none. Of sections that have 32-bit numbers only, each of these is the value
    /// that its low word would be.
    #[inline(never)]
    fn read(&mut self, section: u8, index: u32, to: Value) {
        /// Sections with 32-bit numbers only.
        const WIDE: u32 =
            1 << Section::Slots as u8 | 1 << Section::Timers as u8 | 1 << Section::Listeners as u8;
        if self.wrong != 0 {
            return;
        }
        self.section = section;
        self.index = index;
        let mut field = Field::first_at(section);
        let is_wide = WIDE.wrapping_shr(u32::from(section)) & 1;
        for number in 0..tables::record_words(section) {
            let mut word = self.tables.word(field, index as usize) as u32;
            field = field.next();
            let mut place = to + number;
            if u32::from(number) & is_wide != 0 {
                place -= 1;
                word = word << u16::BITS | self.get(place);
            }
            self.set(place, word);
        }
    }
}
