//! The one pass that a blob must survive before anything is taken from it.
//!
//! What it proves is what the [format](mod@crate::format) says: every index points into its table, every part begins where the one before ended, every jump and
//! every `next` goes ahead, and each record of the instance tree is what its template makes of it. From that follows all that the
//! interpreter relies on: its walk ends, its guards end, the flags and tasks that it touches belong to the instance that it is in.
//!
//! Templates come first. A container's spans (flags, tasks, regions, instances that one instance of it takes) must be the exact
//! sums of its parts, so no container can hold itself. Then the instance tree, from the machine on: each instance says of the instances inside its
//! superstates, and of its task instances, what must stand in their records. Their numbers follow from the template, so none is
//! claimed twice, and as many must have been claimed as there are records, so none is left out. Time grows with the number of state instances, which is
//! bounded, and with the square of the number of slots; the depth of the stack is constant.
//!
//! Texts are not looked at: see [`crate::texts`].

use core::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::format::{self, Section};
use crate::interpreter::ArenaLayout;
use crate::tables::{self, Slot, Tables};

/// No index, as a field reads it.
const NONE: usize = format::NONE as usize;

/// Why a blob is refused. It must be built again, or sent again; none of these can be put right on the robot.
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
    /// A jump, or a `next`, does not go ahead or goes too far.
    Direction,
    /// A record of the instance tree is not what its template makes of it.
    Template,
    /// A text is malformed, or its hash or its counts differ; told by [`texts::check`](crate::texts::check) alone.
    Text,
    /// A port's type is not that of its net; told by [`texts::check`](crate::texts::check) alone.
    Type,
    /// Two slots overlap, or have the same number.
    Overlap,
}

/// Where the sections of a blob are, and what was worked out on the way.
#[derive(Clone, Copy, Debug)]
struct Layout {
    sections: tables::Sections,
    crc: u32,
}

/// A blob that passed [`verify`]. Only such a blob can be interpreted.
///
/// `B` must give the same bytes whenever it is dereferenced, as every slice, vector or array does. If it does not, the
/// interpreter may do nonsense, but no memory is at risk.
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
    match check(&bytes) {
        Ok(layout) => Ok(Verified { bytes, layout }),
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

    /// Gives the blob back.
    pub fn into_bytes(self) -> B {
        self.bytes
    }

    /// The mission hash: the CRC-32 at the blob's end.
    #[must_use]
    pub fn hash(&self) -> u32 {
        self.layout.crc
    }

    /// 32-bit words that [`Interpreter::new`](crate::Interpreter::new) needs: one and a half and two bits for each region instance, a bit for each flag and each task
    /// instance, and half a word for each place in the queue.
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

impl Layout {
    #[inline]
    fn tables<'a>(&'a self, bytes: &'a [u8]) -> Tables<'a> {
        Tables::new(bytes, &self.sections)
    }

    /// Reads the envelope: the postcard encoding of [`format::Envelope`].
    fn read(bytes: &[u8]) -> Result<Self, Refusal> {
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
        let mut sections = [(0, 0); Section::ALL.len()];
        let mut rest = body.get(format::MAGIC.len()..).ok_or(Refusal::Cut)?;
        for (section, place) in Section::ALL.into_iter().zip(&mut sections) {
            let (length, content) = format::read_varint(rest).ok_or(Refusal::Cut)?;
            rest = content.get(length as usize..).ok_or(Refusal::Cut)?;
            *place = ((body.len() - content.len()) as u32, length);
            let records = length as usize / tables::record_bytes(section);
            let is_text = tables::record_bytes(section) == 1;
            if records * tables::record_bytes(section) != length as usize
                || (!is_text && records >= NONE)
            {
                return Err(Refusal::SectionLength(section));
            }
        }
        if !rest.is_empty() {
            return Err(Refusal::TrailingBytes);
        }
        Ok(Self {
            sections,
            crc: stored,
        })
    }
}

/// The whole check.
fn check(bytes: &[u8]) -> Result<Layout, Refusal> {
    let layout = Layout::read(bytes)?;
    let mut pass = Pass::over(layout.tables(bytes));
    pass.check();
    match pass.refusal {
        None => Ok(layout),
        Some(refusal) => Err(refusal),
    }
}

/// The 16-bit words of a record, and some of those behind it; [`NONE`] where the table has ended. More than a record has: with one length for all tables, one
/// function reads them all, and where a record is short it reads where the next one's parts begin.
type Words = [usize; 11];

/// What an instance takes, or where its next parts are: flags, task instances, region instances, container instances. In the order of a
/// container's fields.
type Spans = [usize; 4];
const TASKS: usize = 1;
const REGIONS: usize = 2;
const INSTANCES: usize = 3;

/// The pass, with the places that it has come to. It goes on after the first thing that is wrong, as far as the next loop: so most
/// checks need no way out.
struct Pass<'a> {
    tables: Tables<'a>,
    /// Records that were come to, by section: what comes next begins there.
    seen: [usize; Section::ALL.len()],
    /// The record under test: it is the one that is wrong if a test fails.
    section: Section,
    index: usize,
    refusal: Option<Refusal>,
    state_instances: usize,
}

/// The instance under test, and its container.
struct Around {
    /// Whether it is the first instance of its container, which then is under test itself.
    is_model: bool,
    /// Number of the first instance of its container.
    model: usize,
    /// First flag, task instance and region instance, and the instance.
    base: Spans,
    /// Flags at the head of its block.
    head: usize,
    channels: usize,
}

/// The region under test, with the states from `first` up to `end`.
struct Region {
    number: usize,
    first: usize,
    end: usize,
}

/// The state under test.
struct Source {
    kind: u16,
    first_flag: usize,
    flags: usize,
}

impl<'a> Pass<'a> {
    fn over(tables: Tables<'a>) -> Self {
        Self {
            tables,
            seen: [0; Section::ALL.len()],
            section: Section::Mission,
            index: 0,
            refusal: None,
            state_instances: 0,
        }
    }

    fn check(&mut self) {
        self.mission();
        self.slots();
        self.tasks();
        for index in 0..self.tables.count(Section::Instances) {
            if self.refusal.is_some() {
                return;
            }
            self.instance(index);
        }
        self.channels();
        self.connections();
        self.ends();
    }

    /// Says which record is under test.
    fn at(&mut self, section: Section, index: usize) {
        self.section = section;
        self.index = index;
    }

    /// The words of any record.
    #[inline(never)]
    fn words(&self, section: Section, index: usize) -> Words {
        let mut words = [NONE; _];
        let start = index * tables::record_bytes(section);
        let bytes = self.tables.section(section).get(start..).unwrap_or(&[]);
        let (pairs, _) = bytes.as_chunks();
        for (word, pair) in words.iter_mut().zip(pairs) {
            *word = usize::from(u16::from_le_bytes(*pair));
        }
        words
    }

    /// The words of the record that is under test from now on.
    #[inline(never)]
    fn read(&mut self, section: Section, index: usize) -> Words {
        self.at(section, index);
        self.words(section, index)
    }

    /// The words of the next record of a section, which is under test from now on.
    #[inline(never)]
    fn next(&mut self, section: Section) -> Words {
        let index = self.take(section);
        self.read(section, index)
    }

    /// Goes on by a record.
    fn take(&mut self, section: Section) -> usize {
        let index = self.seen[section as usize];
        self.seen[section as usize] += 1;
        index
    }

    #[inline(never)]
    fn ensure(&mut self, holds: bool, cause: Cause) {
        if !holds && self.refusal.is_none() {
            self.refusal = Some(Refusal::Record {
                section: self.section,
                index: self.index as u16,
                cause,
            });
        }
    }

    /// Words begin with these.
    #[inline(never)]
    fn expect(&mut self, words: &[usize], expected: &[usize], cause: Cause) {
        let equal = words
            .iter()
            .zip(expected)
            .all(|(word, expected)| word == expected);
        self.ensure(equal, cause);
    }

    fn mission(&mut self) {
        // What the machine takes is all there is.
        let [.., flags, tasks, regions, instances, _, _, _] = self.words(Section::Containers, 0);
        self.seen[Section::Mission as usize] = 1;
        self.seen[Section::TaskInstances as usize] = tasks;
        self.seen[Section::RegionInstances as usize] = regions;
        self.seen[Section::Instances as usize] = instances;
        let words = self.read(Section::Mission, 0);
        let [queue, slot, events, ..] = words;
        self.ensure(queue.wrapping_sub(1) < format::MAX_QUEUE, Cause::Range);
        self.ensure(events <= usize::from(format::MAX_EVENT), Cause::Range);
        self.ensure(slot < self.tables.count(Section::Slots), Cause::Index);
        self.expect(&words, &[queue, slot, events, flags], Cause::Template);
    }

    /// Slots are strictly periodic: two of them never overlap if and only if they do not within the greatest common divisor of
    /// their periods (Korst, Aarts, Lenstra 1996).
    ///
    /// The interpreter's slot starts at 0, for the time of a machine is that of its slots.
    fn slots(&mut self) {
        let tables = self.tables;
        let interpreter = tables.interpreter_slot();
        let mut index = 0;
        while let Some(slot) = tables.slot(index) {
            self.at(Section::Slots, index);
            let in_range = slot.number >= 1
                && slot.period_us <= format::MAX_TIME_US
                && slot.duration_us <= slot.period_us
                && slot.start_us < slot.period_us
                && (slot.start_us == 0 || index != interpreter);
            self.ensure(in_range, Cause::Range);
            if self.refusal.is_some() {
                return;
            }
            for earlier in (0..index).filter_map(|earlier| tables.slot(earlier)) {
                let apart = do_not_overlap(&earlier, &slot) && slot.number != earlier.number;
                self.ensure(apart, Cause::Overlap);
            }
            index += 1;
        }
    }

    fn tasks(&mut self) {
        let groups = self.tables.exclusive_group_count();
        for index in 0..self.tables.count(Section::Tasks) {
            let [_, _, _, _, text_start, text_length, exclusive, ..] =
                self.read(Section::Tasks, index);
            let text = self.seen[Section::Signatures as usize];
            self.seen[Section::Signatures as usize] += text_length;
            self.ensure(text_start == text, Cause::Order);
            self.ensure(exclusive < groups || exclusive == NONE, Cause::Range);
        }
    }

    /// Checks an instance's regions and what is inside them, and its container where this is the first instance of it.
    fn instance(&mut self, index: usize) {
        let words = self.read(Section::Instances, index);
        let [
            number,
            first_region,
            first_flag,
            first_channel,
            first_task,
            around,
            ..,
        ] = words;
        let mut behind = self.words(Section::RegionInstances, around)[0];
        if index == 0 {
            behind = self.tables.count(Section::RegionInstances);
            self.expect(&words, &[0; 6], Cause::Template);
        }
        self.ensure(
            first_channel == self.seen[Section::Channels as usize],
            Cause::Order,
        );
        let is_model = number == self.seen[Section::Containers as usize];
        if is_model {
            self.take(Section::Containers);
        }
        self.ensure(
            number < self.seen[Section::Containers as usize],
            Cause::Order,
        );

        let container = self.words(Section::Containers, number);
        let [first_template, flags, channels, model, spans @ .., _, _, _] = container;
        if is_model {
            self.at(Section::Containers, number);
            let regions = self.seen[Section::Regions as usize];
            self.expect(&container, &[regions, flags, channels, index], Cause::Order);
        }
        self.seen[Section::Channels as usize] += channels;
        let around = Around {
            is_model,
            model,
            base: [first_flag, first_task, first_region, index],
            head: format::CONTAINER_CONTROL_FLAGS + flags,
            channels,
        };
        let mut next = around.base;
        next[0] += around.head;
        next[INSTANCES] += 1;
        let mut template = first_template;
        loop {
            let [first, _, next_first, next_of, ..] = self.words(Section::Regions, template);
            template += 1;
            if is_model {
                let words = self.next(Section::Regions);
                let states = self.seen[Section::States as usize];
                self.expect(&words, &[states, number], Cause::Order);
            }
            let region = Region {
                number: next[REGIONS],
                first,
                end: next_first.min(self.tables.count(Section::States)),
            };
            next[REGIONS] += 1;
            let mut state = first;
            loop {
                self.state(&around, &region, state, &mut next);
                state += 1;
                if state >= region.end {
                    break;
                }
                if self.refusal.is_some() {
                    return;
                }
            }
            let is_last = next_of != number;
            let words = self.read(Section::RegionInstances, region.number);
            let after = if is_last { behind } else { next[REGIONS] };
            self.expect(&words, &[after], Cause::Direction);
            self.expect(&words, &[after, first_flag, first, index], Cause::Template);
            if is_last || self.refusal.is_some() {
                break;
            }
        }
        self.at(Section::Containers, number);
        for (next, base) in next.iter_mut().zip(around.base) {
            *next -= base;
        }
        self.expect(&spans, &next, Cause::Template);
    }

    /// Checks what a state of a region instance stands for: a task instance, or an instance of a container. In the first instance of its container it
    /// checks the state, too.
    fn state(&mut self, around: &Around, region: &Region, index: usize, next: &mut Spans) {
        // Templates that are used often could make this pass much longer than the blob.
        self.state_instances += 1;
        let words = self.read(Section::States, index);
        let in_range = self.state_instances <= format::MAX_STATE_INSTANCES;
        self.ensure(in_range, Cause::Range);
        let shape = words[5] as u16;
        let kind = shape >> format::STATE_KIND_SHIFT;
        let flags = usize::from(shape & format::STATE_FLAGS_MASK);
        let timed = shape & format::STATE_HAS_TIMEOUT;
        let [first_flag, task_instance, first_region, instance] = *next;
        let first_task = task_instance;
        let mut taken: Spans = [flags, 0, 0, 0];
        // Flags that it must have, and the part of its number that the state has to name.
        let mut right_flags = usize::from(timed != 0 || flags != 0);
        let mut a = 0;
        match kind {
            format::STATE_SIMPLE => {}
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let words = self.read(Section::TaskInstances, task_instance);
                let [_, _, connection, _, mut task_state, _, _, behind, ..] = words;
                if around.is_model {
                    task_state = self.take(Section::TaskStates);
                }
                let expected = [index, region.number, connection, first_flag, task_state];
                self.expect(&words, &expected, Cause::Template);

                let words = self.words(Section::TaskStates, task_state);
                let [task, slot, mut first_param, ..] = words;
                let [.., data, flags, params, _] = self.words(Section::Tasks, task);
                let behind = behind.min(self.tables.count(Section::Connections));
                self.ensure(behind == connection + data, Cause::Order);

                self.at(Section::TaskStates, task_state);
                if around.is_model {
                    first_param = self.seen[Section::Params as usize];
                    self.seen[Section::Params as usize] += params;
                }
                self.expect(&words, &[task, slot, first_param, index], Cause::Order);
                let right_slot = if kind == format::STATE_TASK {
                    slot < self.tables.count(Section::Slots)
                } else {
                    slot == NONE
                };
                self.ensure(right_slot, Cause::Index);
                right_flags = format::TASK_CONTROL_FLAGS + flags;
                taken[TASKS] = 1;
                a = task_instance - around.base[TASKS];
            }
            format::STATE_SUPER => {
                // What the first instance of the container around makes of this state holds for all of them.
                a = instance - around.base[INSTANCES];
                let [number, ..] = self.words(Section::Instances, around.model + a);
                let words = self.read(Section::Instances, instance);
                let channel = words[3];
                let expected = [
                    number,
                    first_region,
                    first_flag,
                    channel,
                    first_task,
                    region.number,
                ];
                self.expect(&words, &expected, Cause::Template);
                let [_, flags, _, _, spans @ .., _, _, _] = self.words(Section::Containers, number);
                right_flags = format::CONTAINER_CONTROL_FLAGS + flags;
                taken = spans;
            }
            _ => right_flags = 0,
        }
        if around.is_model {
            let first_flag = first_flag - around.base[0];
            let mut b = 0;
            if timed != 0 {
                b = self.seen[Section::Timers as usize];
                let [low, high, ..] = self.next(Section::Timers);
                let in_range = (low | high << 16) <= format::MAX_TIME_US as usize;
                self.ensure(in_range && right_flags > 0, Cause::Range);
            }
            let source = Source {
                kind,
                first_flag,
                flags,
            };
            let first = self.seen[Section::Transitions as usize];
            let end = words[10].min(self.tables.count(Section::Transitions));
            let (events, first_on_event) = self.transitions(around, region, &source, end);
            self.at(Section::States, index);
            let right_kind = if index == region.first {
                kind == format::STATE_INITIAL
            } else if index + 1 == region.end {
                kind == format::STATE_FINAL && events == 0
            } else {
                (format::STATE_SIMPLE..=format::STATE_SUPER).contains(&kind)
            };
            self.ensure(right_kind, Cause::Kind);
            let shape = usize::from(shape & !format::STATE_FLAGS_MASK) | right_flags;
            let expected = [
                events as u16 as usize,
                events as usize >> 16,
                first,
                first_on_event,
                first_flag,
                shape,
                a,
                b,
            ];
            self.expect(&words, &expected, Cause::Order);
        }
        for (next, taken) in next.iter_mut().zip(taken) {
            *next += taken;
        }
    }

    /// Checks the next transitions up to `end`, all out of the state under test. Returns what events they are on, and the first that is not on the pulse.
    fn transitions(
        &mut self,
        around: &Around,
        region: &Region,
        source: &Source,
        end: usize,
    ) -> (u32, usize) {
        let mut events = 0;
        let mut last = 0;
        let mut first_on_event = self.seen[Section::Transitions as usize];
        while self.seen[Section::Transitions as usize] < end && self.refusal.is_none() {
            let [trigger, target, guard, action, ..] = self.next(Section::Transitions);
            let event = trigger & usize::from(format::MAX_EVENT);
            events |= 1_u32 << (event % 32);
            if event == 0 {
                first_on_event += 1;
            }
            self.ensure(event >= last, Cause::Order);
            last = event;
            let in_range =
                event <= self.tables.event_count() && target > region.first && target < region.end;
            self.ensure(in_range, Cause::Index);
            let [_, _, _, _, target_flag, target_shape, ..] = self.words(Section::States, target);
            let is_plain = source.kind <= format::STATE_SIMPLE
                && target_shape == usize::from(format::STATE_SIMPLE << format::STATE_KIND_SHIFT)
                && action == 0;
            self.ensure((trigger != event) == is_plain, Cause::Kind);

            // Flags that guards have short forms for.
            let window = source.flags.min(usize::from(format::WINDOW_FLAGS));
            if guard < usize::from(format::GUARD_PROGRAM) {
                let right = guard == usize::from(format::GUARD_TRUE)
                    || guard % usize::from(format::GUARD_IF_CLEAR) < window;
                self.ensure(right, Cause::Index);
            } else if guard < usize::from(format::GUARD_MASK) {
                let first = guard - usize::from(format::GUARD_PROGRAM);
                let operations = if source.kind == format::STATE_SUPER {
                    format::CODE_JUMP_IF_BUSY_INSIDE
                } else {
                    format::CODE_JUMP_IF_SET
                };
                self.code(
                    around,
                    first,
                    source.first_flag,
                    source.flags,
                    (format::CODE_END, operations),
                );
            } else {
                let at = self.seen[Section::Code as usize];
                let [mask, value, ..] = self.next(Section::Code);
                self.ensure(at == guard - usize::from(format::GUARD_MASK), Cause::Order);
                let right =
                    mask >> window == 0 && value & !mask == 0 && mask & mask.wrapping_sub(1) != 0;
                self.ensure(right, Cause::Index);
            }
            if action >= usize::from(format::ACTION_SEND) {
                let right = action - usize::from(format::ACTION_SEND) < around.channels;
                self.ensure(right, Cause::Index);
            } else if action != 0 {
                self.code(
                    around,
                    action - usize::from(format::ACTION_ROW),
                    target_flag,
                    target_shape & usize::from(format::STATE_FLAGS_MASK),
                    (format::CODE_SEND, format::CODE_SET),
                );
            }
        }
        (events, first_on_event)
    }

    /// Checks a program of tests, or a row of actions.
    #[inline(never)]
    fn code(
        &mut self,
        around: &Around,
        first: usize,
        first_flag: usize,
        flags: usize,
        (lowest, highest): (u16, u16),
    ) {
        let mut at = self.seen[Section::Code as usize];
        let mut farthest = 0;
        let mut right_place = at == first;
        loop {
            let [operand, control, ..] = self.next(Section::Code);
            self.ensure(right_place, Cause::Order);
            right_place = true;
            let control = control as u16;
            let low = control & format::CODE_LOW_MASK;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            self.ensure((lowest..=highest).contains(&operation), Cause::Kind);
            let right = if operation == format::CODE_SEND {
                operand < around.channels
            } else {
                operand < around.head || operand.wrapping_sub(first_flag) < flags
            };
            self.ensure(right, Cause::Index);
            let is_end = if operation < format::CODE_SEND {
                operation == format::CODE_END
            } else {
                low != 0
            };
            if is_end || self.refusal.is_some() {
                self.ensure(farthest <= at, Cause::Direction);
                return;
            }
            farthest = farthest.max(at + usize::from(low));
            at += 1;
        }
    }

    fn channels(&mut self) {
        let regions = self.tables.count(Section::RegionInstances);
        let listeners = self.tables.count(Section::Listeners);
        for index in 0..self.tables.count(Section::Channels) {
            let [event, first_row_word, first_region_word, words, ..] =
                self.read(Section::Channels, index);
            let end = first_region_word + words;
            let row_end = first_row_word + words;
            let right = event.wrapping_sub(1) < self.tables.event_count()
                && end <= regions.div_ceil(32)
                && row_end <= listeners;
            self.ensure(right, Cause::Index);
            if words != 0 && end > regions / 32 {
                // Bits behind the last region instance.
                let [low, high, ..] = self.words(Section::Listeners, row_end - 1);
                let word = (low | high << 16) as u32;
                self.ensure(word << (regions % 32) == 0, Cause::Range);
            }
        }
    }

    /// Checks the data ports of task instances.
    fn connections(&mut self) {
        self.at(Section::Connections, 0);
        let first = self.words(Section::TaskInstances, 0)[2];
        let connections = self.tables.count(Section::Connections);
        self.ensure(first.min(connections) == 0, Cause::Order);
        for index in 0..connections {
            let [net, ..] = self.read(Section::Connections, index);
            let right = net == NONE || net < self.tables.count(Section::Nets);
            self.ensure(right, Cause::Index);
        }
    }

    /// Nothing is left over.
    fn ends(&mut self) {
        for section in Section::ALL {
            if matches!(
                section,
                Section::Slots
                    | Section::Listeners
                    | Section::Tasks
                    | Section::Connections
                    | Section::Nets
                    | Section::Names
            ) {
                continue;
            }
            let seen = self.seen[section as usize];
            self.at(section, seen);
            self.ensure(seen == self.tables.count(section), Cause::Order);
        }
    }
}

/// Whether two slots can never be due at once. A slot without duration may start where another does.
fn do_not_overlap(earlier: &Slot, slot: &Slot) -> bool {
    let base_us = greatest_common_divisor(slot.period_us, earlier.period_us);
    let (mut after_us, is_before) =
        (slot.start_us % base_us).overflowing_sub(earlier.start_us % base_us);
    if is_before || (after_us == 0 && slot.duration_us == 0) {
        after_us = after_us.wrapping_add(base_us);
    }
    earlier.duration_us <= after_us && slot.duration_us <= base_us - after_us
}

fn greatest_common_divisor(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
