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
    fn read(&mut self, bytes: &[u8], counts: &mut Counts) -> Result<(), Refusal> {
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
        let mut rest = body.get(format::MAGIC.len()..).ok_or(Refusal::Cut)?;
        for ((section, count), place) in Section::ALL.iter().zip(counts).zip(&mut self.sections) {
            let (length, content) = format::read_varint(rest).ok_or(Refusal::Cut)?;
            rest = content.get(length as usize..).ok_or(Refusal::Cut)?;
            *place = ((body.len() - content.len()) as u32, length);
            let record_bytes = tables::record_bytes(*section);
            *count = length as usize / record_bytes;
            if *count * record_bytes != length as usize || (record_bytes > 1 && *count >= NONE) {
                return Err(Refusal::SectionLength(*section));
            }
        }
        if !rest.is_empty() {
            return Err(Refusal::TrailingBytes);
        }
        Ok(())
    }
}

/// A number of records of each section.
type Counts = [usize; Section::ALL.len()];

/// What an instance takes: flags, task instances, region instances and container instances, as a container tells them.
type Spans = [usize; 4];
const FLAGS: usize = 0;
const TASKS: usize = 1;
const REGIONS: usize = 2;
const INSTANCES: usize = 3;

/// The whole check.
fn check(bytes: &[u8], layout: &mut Layout) -> Result<(), Refusal> {
    let mut counts = [0; _];
    layout.read(bytes, &mut counts)?;
    let mut pass = Pass {
        words: [0; _],
        section: Section::Mission,
        wrong: None,
        is_model: false,
        index: 0,
        events: 0,
        state_instances: 0,
        base: [0; _],
        taken: [0; _],
        model: 0,
        head: 0,
        channels: 0,
        region: 0,
        first_state: 0,
        end_state: 0,
        seen: [0; _],
        counts,
        tables: layout.tables(bytes),
    };
    pass.check();
    match pass.wrong {
        None => Ok(()),
        Some(cause) => Err(Refusal::Record {
            section: pass.section,
            index: pass.index,
            cause,
        }),
    }
}

/// The pass. The record under test is the one that was read last. After the first thing that is wrong it goes on as far as the next loop, without reading
/// anything: so most checks need no way out.
// What is used most stands first: short instructions reach it.
#[repr(C)]
struct Pass<'a> {
    /// The 16-bit words of the record under test and some of those behind it, [`NONE`] where the table has ended. More than a record has: with one length for
    /// all tables one function reads them all, and where a record is short it tells where the parts of the next one begin.
    words: [usize; 11],
    section: Section,
    wrong: Option<Cause>,
    /// Whether the instance under test is the first one of its container, which then is under test itself.
    is_model: bool,
    index: u16,
    events: usize,
    state_instances: usize,

    /// Of the instance under test: where its parts begin, and which of them were come to.
    base: Spans,
    taken: Spans,
    /// Number of the first instance of its container.
    model: usize,
    /// Flags at the head of its block.
    head: usize,
    channels: usize,

    /// The region under test, and its states.
    region: usize,
    first_state: usize,
    end_state: usize,

    /// Records that were come to: what comes next begins there.
    seen: Counts,
    counts: Counts,
    tables: Tables<'a>,
}

impl Pass<'_> {
    fn check(&mut self) {
        for section in &Section::ALL {
            for index in 0..self.count(*section) {
                self.read(*section, index);
                match section {
                    Section::Mission => self.mission(),
                    Section::Slots => self.slot(index),
                    Section::Instances => self.instance(index),
                    Section::Channels => self.channel(),
                    Section::Tasks => self.task(),
                    Section::Connections => self.connection(),
                    // Come to from the instances, or free.
                    _ => break,
                }
                if self.wrong.is_some() {
                    return;
                }
            }
        }
        self.ends();
    }

    #[inline(always)]
    fn count(&self, section: Section) -> usize {
        self.counts[section as usize]
    }

    /// Puts a record under test.
    #[inline(never)]
    fn read(&mut self, section: Section, index: usize) {
        if self.wrong.is_some() {
            return;
        }
        self.section = section;
        self.index = index as u16;
        let bytes = self.tables.section(section);
        let mut at = index * tables::record_bytes(section);
        for word in &mut self.words {
            *word = match bytes.get(at..at + 2) {
                Some([low, high]) => usize::from(u16::from_le_bytes([*low, *high])),
                _ => NONE,
            };
            at += 2;
        }
    }

    /// Puts the next record of a section under test.
    #[inline(never)]
    fn next(&mut self, section: Section) {
        let index = self.take(section, 1);
        self.read(section, index);
    }

    /// Goes on by some records; returns the first of them.
    #[inline(always)]
    fn take(&mut self, section: Section, records: usize) -> usize {
        let index = self.seen[section as usize];
        self.seen[section as usize] += records;
        index
    }

    #[inline(always)]
    fn ensure(&mut self, holds: bool, cause: Cause) {
        if !holds {
            self.refuse(cause);
        }
    }

    #[inline(never)]
    fn refuse(&mut self, cause: Cause) {
        if self.wrong.is_none() {
            self.wrong = Some(cause);
        }
    }

    /// The record under test begins with these words.
    #[inline(never)]
    fn expect(&mut self, expected: &[usize], cause: Cause) {
        if !self.words.starts_with(expected) {
            self.refuse(cause);
        }
    }

    /// The parts of the record under test, whose first one is its word 2, end where those of the next record begin.
    #[inline(never)]
    fn expect_parts(&mut self, parts: usize, next_first: usize, of: Section) {
        self.take(of, parts);
        let end = next_first.min(self.count(of));
        self.ensure(self.words[2] + parts == end, Cause::Order);
    }

    fn mission(&mut self) {
        let [queue, slot, events, flags, ..] = self.words;
        self.events = events;
        self.seen[Section::Mission as usize] = 1;
        let in_range =
            queue.wrapping_sub(1) < format::MAX_QUEUE && events <= usize::from(format::MAX_EVENT);
        self.ensure(in_range, Cause::Range);
        self.ensure(slot < self.count(Section::Slots), Cause::Index);
        // What the machine takes is all there is.
        self.read(Section::Containers, 0);
        let [_, _, _, _, in_flags, tasks, regions, instances, ..] = self.words;
        self.seen[Section::TaskInstances as usize] = tasks;
        self.seen[Section::RegionInstances as usize] = regions;
        self.seen[Section::Instances as usize] = instances;
        self.ensure(flags == in_flags, Cause::Template);
    }

    /// Slots are strictly periodic: two of them never overlap if and only if they do not within the greatest common divisor of
    /// their periods (Korst, Aarts, Lenstra 1996).
    ///
    /// The interpreter's slot starts at 0, for the time of a machine is that of its slots.
    fn slot(&mut self, index: usize) {
        let slot = self.slot_at(index);
        let in_range = slot.number >= 1
            && slot.period_us <= format::MAX_TIME_US
            && slot.duration_us <= slot.period_us
            && slot.start_us < slot.period_us
            && (slot.start_us == 0 || index != self.tables.interpreter_slot());
        self.ensure(in_range, Cause::Range);
        for earlier in 0..index {
            let earlier = self.slot_at(earlier);
            let apart = do_not_overlap(&earlier, &slot) && slot.number != earlier.number;
            self.read(Section::Slots, index);
            self.ensure(apart, Cause::Overlap);
        }
    }

    #[inline(never)]
    fn slot_at(&mut self, index: usize) -> Slot {
        self.read(Section::Slots, index);
        let long = |word| (self.words[word] | self.words[word + 1] << 16) as u32;
        Slot {
            number: long(0),
            period_us: long(2),
            duration_us: long(4),
            start_us: long(6),
        }
    }

    fn task(&mut self) {
        let [_, _, _, _, text_start, text_length, exclusive, ..] = self.words;
        let text = self.take(Section::Signatures, text_length);
        self.ensure(text_start == text, Cause::Order);
        let in_range = exclusive < self.tables.exclusive_group_count() || exclusive == NONE;
        self.ensure(in_range, Cause::Range);
    }

    /// Checks an instance's regions and what is inside them, and its container where this is the first instance of it.
    fn instance(&mut self, index: usize) {
        if index == 0 {
            self.expect(&[0; 6], Cause::Template);
        }
        let [
            number,
            first_region,
            first_flag,
            first_channel,
            first_task,
            around,
            ..,
        ] = self.words;
        self.base = [first_flag, first_task, first_region, index];
        let is_model = number == self.seen[Section::Containers as usize];
        self.is_model = is_model;
        if is_model {
            self.take(Section::Containers, 1);
        }
        let in_order = first_channel == self.seen[Section::Channels as usize]
            && number < self.seen[Section::Containers as usize];
        self.ensure(in_order, Cause::Order);
        self.read(Section::RegionInstances, around);
        let mut behind = self.words[0];
        if index == 0 {
            behind = self.count(Section::RegionInstances);
        }

        self.read(Section::Containers, number);
        let [mut template, flags, channels, model, ..] = self.words;
        if is_model {
            let regions = self.seen[Section::Regions as usize];
            self.expect(&[regions, flags, channels, index], Cause::Order);
        }
        self.take(Section::Channels, channels);
        self.model = model;
        self.channels = channels;
        self.head = format::CONTAINER_CONTROL_FLAGS + flags;
        self.taken = [self.head, 0, 0, 1];
        loop {
            self.read(Section::Regions, template);
            let [first, _, next_first, next_of, ..] = self.words;
            if is_model {
                self.take(Section::Regions, 1);
                let states = self.seen[Section::States as usize];
                self.expect(&[states, number], Cause::Order);
            }
            template += 1;
            self.region = first_region + self.taken[REGIONS];
            self.taken[REGIONS] += 1;
            self.first_state = first;
            self.end_state = next_first.min(self.count(Section::States));
            self.ensure(first + 1 < self.end_state, Cause::Order);
            let mut state = first;
            loop {
                self.state(state);
                state += 1;
                if state >= self.end_state {
                    break;
                }
                if self.wrong.is_some() {
                    return;
                }
            }
            self.read(Section::RegionInstances, self.region);
            let mut after = first_region + self.taken[REGIONS];
            let is_last = next_of != number;
            if is_last {
                after = behind;
            }
            self.expect(&[after, first_flag, first, index], Cause::Template);
            if is_last || self.wrong.is_some() {
                break;
            }
        }
        self.read(Section::Containers, number);
        let [_, _, _, _, spans @ .., _, _, _] = self.words;
        self.ensure(spans == self.taken, Cause::Template);
    }

    /// Checks what a state of a region instance stands for: a task instance, or an instance of a container. In the first instance of its container it
    /// checks the state, too.
    fn state(&mut self, index: usize) {
        // Templates that are used often could make this pass much longer than the blob.
        self.state_instances += 1;
        self.read(Section::States, index);
        let in_range = self.state_instances <= format::MAX_STATE_INSTANCES;
        self.ensure(in_range, Cause::Range);
        let [_, _, _, _, _, shape, .., end] = self.words;
        let kind = shape as u16 >> format::STATE_KIND_SHIFT;
        let flags = shape & usize::from(format::STATE_FLAGS_MASK);
        let timed = shape & usize::from(format::STATE_HAS_TIMEOUT);
        let own_flag = self.taken[FLAGS];
        let [flag, task_instance, region, instance] =
            core::array::from_fn(|part| self.base[part] + self.taken[part]);
        let mut right_shape = shape - flags;
        let mut a = 0;
        match kind {
            format::STATE_SIMPLE => {
                self.taken[FLAGS] += flags;
                right_shape += usize::from(timed != 0 || flags != 0);
            }
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                a = self.taken[TASKS];
                self.taken[FLAGS] += flags;
                self.taken[TASKS] += 1;
                self.read(Section::TaskInstances, task_instance);
                let mut task_state = self.words[4];
                if self.is_model {
                    task_state = self.take(Section::TaskStates, 1);
                }
                self.read(Section::TaskStates, task_state);
                let [task, mut slot, first_param, _, _, _, next_first_param, ..] = self.words;
                if kind == format::STATE_BACKGROUND_TASK {
                    slot = NONE;
                } else {
                    self.ensure(slot < self.count(Section::Slots), Cause::Index);
                }
                self.expect(&[task, slot, first_param, index], Cause::Order);
                self.read(Section::Tasks, task);
                let [.., data, task_flags, params, _] = self.words;
                right_shape += format::TASK_CONTROL_FLAGS + task_flags;
                if self.is_model {
                    self.read(Section::TaskStates, task_state);
                    self.expect_parts(params, next_first_param, Section::Params);
                }
                self.read(Section::TaskInstances, task_instance);
                let expected = [index, self.region, self.words[2], flag, task_state];
                self.expect(&expected, Cause::Template);
                self.expect_parts(data, self.words[7], Section::Connections);
            }
            format::STATE_SUPER => {
                a = self.taken[INSTANCES];
                // What the first instance of the container around makes of this state holds for all of them.
                self.read(Section::Instances, self.model + a);
                let [number, ..] = self.words;
                self.read(Section::Instances, instance);
                let channel = self.words[3];
                let expected = [number, region, flag, channel, task_instance, self.region];
                self.expect(&expected, Cause::Template);
                self.read(Section::Containers, number);
                let [_, flags, _, _, spans @ .., _, _, _] = self.words;
                right_shape += format::CONTAINER_CONTROL_FLAGS + flags;
                for (taken, span) in self.taken.iter_mut().zip(spans) {
                    *taken += span;
                }
            }
            _ => right_shape = usize::MAX,
        }
        if !self.is_model {
            return;
        }
        self.take(Section::States, 1);
        if index == self.first_state {
            right_shape = usize::from(format::STATE_INITIAL << format::STATE_KIND_SHIFT);
        } else if index + 1 == self.end_state {
            right_shape = usize::from(format::STATE_FINAL << format::STATE_KIND_SHIFT);
        }
        let mut b = 0;
        if timed != 0 {
            b = self.seen[Section::Timers as usize];
            self.next(Section::Timers);
            let [low, high, ..] = self.words;
            let in_range = (low | high << 16) <= format::MAX_TIME_US as usize;
            self.ensure(in_range, Cause::Range);
        }
        let first = self.seen[Section::Transitions as usize];
        let (events, first_on_event) = self.transitions(index, shape, end);
        self.read(Section::States, index);
        self.ensure(shape == right_shape, Cause::Kind);
        let expected = [
            events & 0xFFFF,
            events >> 16,
            first,
            first_on_event,
            own_flag,
            shape,
            a,
            b,
        ];
        self.expect(&expected, Cause::Order);
    }

    /// Checks the next transitions up to `end`, all out of the state under test. Returns what events they are on, and the first that is not on the pulse.
    fn transitions(&mut self, source: usize, source_shape: usize, end: usize) -> (usize, usize) {
        let kind = source_shape as u16 >> format::STATE_KIND_SHIFT;
        // Flags that guards have short forms for.
        let window = (source_shape & usize::from(format::STATE_FLAGS_MASK))
            .min(usize::from(format::WINDOW_FLAGS));
        let end = end.min(self.count(Section::Transitions));
        let mut events = 0;
        let mut last = 0;
        let mut first_on_event = self.seen[Section::Transitions as usize];
        while self.seen[Section::Transitions as usize] < end && self.wrong.is_none() {
            let index = self.take(Section::Transitions, 1);
            self.read(Section::Transitions, index);
            let [_, target, ..] = self.words;
            self.read(Section::States, target);
            let target_shape = self.words[5];
            self.read(Section::Transitions, index);
            let [trigger, _, guard, action, ..] = self.words;
            let event = trigger & usize::from(format::MAX_EVENT);
            events |= 1 << (event % 32);
            if event == 0 {
                first_on_event += 1;
            }
            self.ensure(event >= last, Cause::Order);
            last = event;
            let in_range = event <= self.events
                && target > self.first_state
                && target < self.end_state
                && kind != format::STATE_FINAL
                && action < usize::from(format::ACTION_SEND) + self.channels;
            self.ensure(in_range, Cause::Index);
            let is_plain = kind <= format::STATE_SIMPLE
                && target_shape == usize::from(format::STATE_SIMPLE << format::STATE_KIND_SHIFT)
                && action == 0;
            self.ensure((trigger != event) == is_plain, Cause::Kind);

            if guard < usize::from(format::GUARD_PROGRAM) {
                let right = guard == usize::from(format::GUARD_TRUE)
                    || guard % usize::from(format::GUARD_IF_CLEAR) < window;
                self.ensure(right, Cause::Index);
            } else if guard < usize::from(format::GUARD_MASK) {
                let operations = if kind == format::STATE_SUPER {
                    0b11111
                } else {
                    0b111
                };
                self.code(
                    guard - usize::from(format::GUARD_PROGRAM),
                    source,
                    operations,
                );
            } else {
                let at = self.seen[Section::Code as usize];
                self.next(Section::Code);
                let [mask, value, ..] = self.words;
                let in_order = at == guard - usize::from(format::GUARD_MASK);
                self.ensure(in_order, Cause::Order);
                let right =
                    mask >> window == 0 && value & !mask == 0 && mask & mask.wrapping_sub(1) != 0;
                self.ensure(right, Cause::Index);
            }
            if action != 0 && action < usize::from(format::ACTION_SEND) {
                self.code(
                    action - usize::from(format::ACTION_ROW),
                    target,
                    0b1110_0000,
                );
            }
        }
        (events, first_on_event)
    }

    /// Checks a program of tests, or a row of actions.
    #[inline(never)]
    fn code(&mut self, first: usize, state: usize, operations: usize) {
        self.read(Section::States, state);
        let [_, _, _, _, first_flag, shape, ..] = self.words;
        let flags = shape & usize::from(format::STATE_FLAGS_MASK);
        let mut in_order = self.seen[Section::Code as usize] == first;
        let mut farthest = 0;
        loop {
            self.next(Section::Code);
            let [operand, control, ..] = self.words;
            self.ensure(in_order, Cause::Order);
            in_order = true;
            let low = control & usize::from(format::CODE_LOW_MASK);
            let operation = control as u16 >> format::CODE_OPERATION_SHIFT;
            self.ensure(operations >> operation & 1 != 0, Cause::Kind);
            let right = if operation == format::CODE_SEND {
                operand < self.channels
            } else {
                operand < self.head || operand.wrapping_sub(first_flag) < flags
            };
            self.ensure(right, Cause::Index);
            let is_end = if operation < format::CODE_SEND {
                operation == format::CODE_END
            } else {
                low != 0
            };
            if is_end || self.wrong.is_some() {
                self.ensure(farthest <= usize::from(self.index), Cause::Direction);
                return;
            }
            farthest = farthest.max(usize::from(self.index) + low);
        }
    }

    fn channel(&mut self) {
        let regions = self.count(Section::RegionInstances);
        let [event, first_row_word, first_region_word, words, ..] = self.words;
        let end = first_region_word + words;
        let row_end = first_row_word + words;
        let right = event.wrapping_sub(1) < self.events
            && end <= regions.div_ceil(32)
            && row_end <= self.count(Section::Listeners);
        self.ensure(right, Cause::Index);
        if words != 0 && end > regions / 32 {
            // Bits behind the last region instance.
            self.read(Section::Listeners, row_end - 1);
            let [low, high, ..] = self.words;
            let word = (low | high << 16) as u32;
            self.ensure(word << (regions % 32) == 0, Cause::Range);
        }
    }

    fn connection(&mut self) {
        let [net, ..] = self.words;
        let right = net == NONE || net < self.count(Section::Nets);
        self.ensure(right, Cause::Index);
    }

    /// Nothing is left over.
    fn ends(&mut self) {
        const FREE: usize = 1 << Section::Slots as u8
            | 1 << Section::Listeners as u8
            | 1 << Section::Tasks as u8
            | 1 << Section::Nets as u8
            | 1 << Section::Names as u8;
        for section in &Section::ALL {
            let seen = self.seen[*section as usize];
            if FREE >> *section as u8 & 1 == 0 {
                self.read(*section, seen);
                self.ensure(seen == self.count(*section), Cause::Order);
            }
        }
    }
}

/// Whether two slots can never be due at once. A slot without duration may start where another does.
fn do_not_overlap(earlier: &Slot, slot: &Slot) -> bool {
    let base_us = greatest_common_divisor(slot.period_us, earlier.period_us).max(1);
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
