//! The one pass that a blob must survive before anything is taken from it.
//!
//! What it proves is what the [format](mod@crate::format) says: every index points into its table, every part begins where the one before ended, every jump
//! goes ahead, and each record of the instance tree is what its template makes of it.
//!
//! It walks the instances in the order of their numbers, and of each its regions, and of each region its states. An instance says what must stand in the
//! records of its region instances and task instances, and in those of the instances inside its superstates. The first instance of a container is its *model*: there the walk checks the
//! template, too, with transitions and code, and that the container's spans (flags, tasks, regions, instances that one instance of it takes) are the sums of its parts. So
//! no container can hold itself, and the machine's spans are what the tables hold: nothing is claimed twice, and nothing is left out. Other
//! tables are checked a record at a time. Time grows with the number of state instances, which is bounded, and with the square of the number of slots; the depth of the stack is constant.
//!
//! # What stands when a blob has passed
//!
//! Reads that check nothing again name the one of these that they rely on.
//!
//! * **mission**: the queue holds 1 to 255 events; the interpreter's slot exists; no event's number is above the mission's count. The flags of the
//!   whole machine are as many as the mission says.
//! * **tree**: the region instances of an instance, and all that is inside them, stand together; `next` of a region instance is above its number and at most their count, and what lies
//!   between is inside it. The instance of a region instance, the container and the region instance around of an instance, the instance inside a superstate (the instance plus *a*) with its first region
//!   instance exist, and the numbers of what is inside are above.
//! * **current**: `initial` of a region instance, and each target of a transition out of a state of its region, is a state of its region; a target is never `initial`.
//! * **flags**: the first flag of an instance plus any relative flag that a state, test or action of its container names is below the mission's count of flags; so are all flags of a
//!   state's block. Tests name flags at the head of the block of their instance, or own ones of the state that is left; actions the same of the state that is entered.
//! * **transitions**: those of a state are a range in the table, as long as the next state's begin behind. Those on the pulse come first, up to *first not on the pulse*; the others are
//!   sorted by their events. `events` has a bit for each, and no other. `final` has none.
//! * **plain**: the mark is set on every transition from `initial` or a simple state to a simple state without flags that has no action, and on no other.
//! * **guards**: a bit is one of the state's own flags; a mask has two bits at least, all own flags, its value no others; a program ends, its jumps lead ahead and to its end at most, it
//!   looks inside superstates only. All code records that they need exist.
//! * **actions**: a row ends. The channels of an instance exist: its first plus the one that is named.
//! * **timers**: a state with a timeout has a flag for it and a record among the timers, of at most [`format::MAX_TIME_US`].
//! * **rows**: a channel's words are in the table of listeners, and those of its region words that exist; a bit is that of a region instance. Its event is not the pulse.
//! * **tasks**: a task instance exists for each task state of each instance; its state, region instance, first flag, task state are right. The task of a task state, its slot, its parameters
//!   and the connections of a task instance exist, as many as the task has; the state has as many flags as the task.
//! * **slots**: their periods are not 0, and no two are ever due at once.
//!
//! Texts are not looked at: see [`crate::texts`].

use core::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::format::{self, Section};
use crate::interpreter::ArenaLayout;
use crate::layout::{
    Field, channel, code, connection, container, instance, listener, mask, mission, region,
    region_instance, slot, state, task, task_instance, task_state, timer, transition,
};
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
    /// A jump does not go ahead, or goes too far.
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
    fn read(&mut self, bytes: &[u8]) -> Result<(), Refusal> {
        if !bytes.starts_with(&format::MAGIC) {
            return Err(Refusal::Magic);
        }
        let (body, crc) = bytes
            .split_last_chunk::<{ format::CRC_BYTES }>()
            .ok_or(Refusal::Cut)?;
        let mut rest = body.get(format::MAGIC.len()..).ok_or(Refusal::Cut)?;
        let stored = u32::from_le_bytes(*crc);
        let computed = format::crc32(body);
        if stored != computed {
            return Err(Refusal::Checksum { stored, computed });
        }
        self.crc = stored;
        for (section, place) in Section::ALL.iter().zip(&mut self.sections) {
            let (length, content) = format::read_varint(rest).ok_or(Refusal::Cut)?;
            rest = content.get(length as usize..).ok_or(Refusal::Cut)?;
            let record_bytes = tables::record_bytes(*section) as u32;
            let records = length / record_bytes;
            *place = ((body.len() - content.len()) as u32, records);
            let too_many = record_bytes > 1 && records >= NONE as u32;
            if records * record_bytes != length || too_many {
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

/// What an instance takes, in the order in which a container tells it.
type Spans = [usize; 4];
/// Place of the flags in [`Spans`].
const FLAGS: usize = 0;
/// Place of the task instances.
const TASKS: usize = 1;
/// Place of the region instances.
const REGIONS: usize = 2;
/// Place of the container instances.
const INSTANCES: usize = 3;

/// The whole check.
#[inline(never)]
fn check(bytes: &[u8], layout: &mut Layout) -> Result<(), Refusal> {
    layout.read(bytes)?;
    let mut pass = Pass {
        words: [0; _],
        section: Section::Mission,
        wrong: None,
        is_model: false,
        index: 0,
        state_instances: 0,
        base: [0; _],
        taken: [0; _],
        model: 0,
        head: 0,
        channels: 0,
        region: 0,
        first_state: 0,
        end_state: 0,
        events: 0,
        seen: [0; _],
        tables: layout.tables(bytes),
    };
    pass.check();
    match pass.wrong {
        None => Ok(()),
        Some(cause) => Err(Refusal::Record {
            section: pass.section,
            index: pass.index as u16,
            cause,
        }),
    }
}

/// The pass. The record under test is the one that was read last. After the first thing that is wrong nothing is read, and the pass goes on as far as the next
/// loop: so most checks need no way out.
struct Pass<'a> {
    /// The 16-bit words of the record under test and some of those behind it, [`NONE`] where the table has ended. More than a record has: with one length for
    /// all tables one function reads them all, and where a record is short it tells where the parts of the next one begin.
    words: [usize; 11],
    section: Section,
    index: usize,
    wrong: Option<Cause>,

    /// Whether the instance under test is the first one of its container, which then is under test itself.
    is_model: bool,
    /// Number of the first instance of its container.
    model: usize,
    /// Where its parts begin, and which of them were come to.
    base: Spans,
    taken: Spans,
    /// Flags at the head of its block.
    head: usize,
    channels: usize,

    /// The region under test, and its states.
    region: usize,
    first_state: usize,
    end_state: usize,

    state_instances: usize,
    events: usize,
    /// Records that were come to: what comes next begins there.
    seen: Counts,
    tables: Tables<'a>,
}

impl Pass<'_> {
    #[inline(never)]
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
                    Section::TaskStates => self.task_state(),
                    Section::TaskInstances => self.task_instance(),
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
        self.tables.count(section)
    }

    /// Puts a record under test.
    #[inline(never)]
    fn read(&mut self, section: Section, index: usize) {
        if self.wrong.is_some() {
            return;
        }
        self.section = section;
        self.index = index;
        let found = self.tables.words_from(Field::first_of(section), index);
        for (number, word) in self.words.iter_mut().enumerate() {
            *word = match found.get(number) {
                Some(found) => usize::from(u16::from_le_bytes(*found)),
                None => NONE,
            };
        }
    }

    /// Puts the next record of a section under test.
    #[inline(never)]
    fn read_next(&mut self, section: Section) {
        let index = self.take(section, 1);
        self.read(section, index);
    }

    /// A field of the record under test.
    #[inline(always)]
    fn field(&self, field: Field) -> usize {
        self.words[field.number()]
    }

    /// The same field of the record behind it.
    #[inline(always)]
    fn field_behind(&self, field: Field) -> usize {
        let section = Section::ALL[field.section()];
        self.words[tables::record_bytes(section) / 2 + field.number()]
    }

    /// A 32-bit field of the record under test, by its low half.
    #[inline(always)]
    fn long(&self, low_half: Field) -> u32 {
        let low = low_half.number();
        (self.words[low] | self.words[low + 1] << 16) as u32
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

    /// Where the parts of the record behind the one under test begin, which is where its own end: at the end of their table where there is no record behind.
    #[inline(always)]
    fn first_behind(&self, first: Field, of: Section) -> usize {
        self.field_behind(first).min(self.count(of))
    }

    fn mission(&mut self) {
        let queue = self.field(mission::QUEUE);
        let flags = self.field(mission::FLAGS);
        self.events = self.field(mission::EVENTS);
        let in_range = queue.wrapping_sub(1) < format::MAX_QUEUE
            && self.events <= usize::from(format::MAX_EVENT);
        self.ensure(in_range, Cause::Range);
        let slot = self.field(mission::INTERPRETER_SLOT);
        self.ensure(slot < self.count(Section::Slots), Cause::Index);
        // What the machine takes is all there is.
        self.read(Section::Containers, 0);
        self.seen[Section::TaskInstances as usize] = self.field(container::TASK_SPAN);
        self.seen[Section::RegionInstances as usize] = self.field(container::REGION_SPAN);
        self.seen[Section::Instances as usize] = self.field(container::INSTANCE_SPAN);
        self.ensure(flags == self.field(container::FLAG_SPAN), Cause::Template);
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
        Slot {
            number: self.long(slot::NUMBER),
            period_us: self.long(slot::PERIOD),
            duration_us: self.long(slot::DURATION),
            start_us: self.long(slot::START),
        }
    }

    fn task(&mut self) {
        let text = self.take(Section::Signatures, self.field(task::TEXT_LENGTH));
        self.ensure(self.field(task::TEXT_START) == text, Cause::Order);
        let group = self.field(task::EXCLUSIVE);
        let in_range = group < self.tables.exclusive_group_count() || group == NONE;
        self.ensure(in_range, Cause::Range);
    }

    /// Checks an instance's regions and what is inside them, and its container where this is the first instance of it.
    fn instance(&mut self, index: usize) {
        let number = self.field(instance::CONTAINER);
        let first_region = self.field(instance::FIRST_REGION);
        let first_flag = self.field(instance::FIRST_FLAG);
        let first_task = self.field(instance::FIRST_TASK);
        let around = self.field(instance::AROUND);
        let channel = self.seen[Section::Channels as usize];
        let is_model = number == self.seen[Section::Containers as usize];
        self.seen[Section::Containers as usize] += usize::from(is_model);
        let in_order = self.field(instance::FIRST_CHANNEL) == channel
            && number < self.seen[Section::Containers as usize];
        self.ensure(in_order, Cause::Order);
        let mut behind = self.tables.word(region_instance::NEXT, around);
        if index == 0 {
            // Nothing is around the machine.
            behind = self.count(Section::RegionInstances);
            let is_root = number | first_region | first_flag | first_task | around == 0;
            self.ensure(is_root, Cause::Template);
        }

        self.read(Section::Containers, number);
        let mut template = self.field(container::FIRST_REGION);
        self.is_model = is_model;
        self.model = self.field(container::FIRST_INSTANCE);
        self.channels = self.field(container::CHANNELS);
        self.head = format::CONTAINER_CONTROL_FLAGS + self.field(container::FLAGS);
        self.base = [first_flag, first_task, first_region, index];
        self.taken = [self.head, 0, 0, 1];
        self.take(Section::Channels, self.channels);
        if is_model {
            let in_order = template == self.seen[Section::Regions as usize] && self.model == index;
            self.ensure(in_order, Cause::Order);
        }
        loop {
            self.read(Section::Regions, template);
            template += 1;
            let first = self.field(region::FIRST_STATE);
            let is_last = self.field_behind(region::CONTAINER) != number;
            self.first_state = first;
            self.end_state = self.first_behind(region::FIRST_STATE, Section::States);
            self.region = first_region + self.taken[REGIONS];
            self.taken[REGIONS] += 1;
            if is_model {
                self.take(Section::Regions, 1);
                let in_order = first == self.seen[Section::States as usize]
                    && first + 1 < self.end_state
                    && self.field(region::CONTAINER) == number;
                self.ensure(in_order, Cause::Order);
            }
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
            let mut next = first_region + self.taken[REGIONS];
            if is_last {
                next = behind;
            }
            self.expect(&[next, first_flag, first, index], Cause::Template);
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
        let shape = self.field(state::SHAPE);
        let end_transition = self.first_behind(state::FIRST_TRANSITION, Section::Transitions);
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
                right_shape = shape;
                self.read(Section::TaskInstances, task_instance);
                let connection = self.field(task_instance::FIRST_CONNECTION);
                let task_state = self.field(task_instance::TASK_STATE);
                let expected = [index, self.region, connection, flag, task_state];
                self.expect(&expected, Cause::Template);
                let right = self.tables.word(task_state::STATE, task_state) == index;
                self.ensure(right, Cause::Template);
                if self.is_model {
                    self.take(Section::TaskStates, 1);
                }
            }
            format::STATE_SUPER => {
                a = self.taken[INSTANCES];
                // What the first instance of the container around makes of this state holds for all of them.
                let number = self.tables.word(instance::CONTAINER, self.model + a);
                self.read(Section::Instances, instance);
                let channel = self.field(instance::FIRST_CHANNEL);
                let expected = [number, region, flag, channel, task_instance, self.region];
                self.expect(&expected, Cause::Template);
                self.read(Section::Containers, number);
                right_shape += format::CONTAINER_CONTROL_FLAGS + self.field(container::FLAGS);
                for (part, taken) in self.taken.iter_mut().enumerate() {
                    *taken += self.words[container::FLAG_SPAN.number() + part];
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
            self.read_next(Section::Timers);
            self.ensure(
                self.long(timer::TIMEOUT) <= format::MAX_TIME_US,
                Cause::Range,
            );
        }
        let first = self.seen[Section::Transitions as usize];
        let (events, first_on_event, row) = self.transitions(index, shape, end_transition);
        if timed == 0 {
            b = row;
        }
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

    /// Checks the next transitions up to `end`, all out of the state `source`. Returns what events they are on, the first that is not on the pulse, and the length of the row.
    fn transitions(
        &mut self,
        source: usize,
        source_shape: usize,
        end: usize,
    ) -> (usize, usize, usize) {
        let kind = source_shape as u16 >> format::STATE_KIND_SHIFT;
        // Flags that guards have short forms for.
        let window = (source_shape & usize::from(format::STATE_FLAGS_MASK))
            .min(usize::from(format::WINDOW_FLAGS));
        let may_be_again = source_shape >> 12 == usize::from(format::STATE_TASK << 1)
            && source_shape & usize::from(format::STATE_FLAGS_MASK)
                <= usize::from(format::PLAIN_FLAGS);
        // Guards of the row at the head, and the bit behind the last of them.
        let mut row = 0;
        let mut row_end = None;
        let first = self.seen[Section::Transitions as usize];
        let mut events = 0;
        let mut last = 0;
        let mut first_on_event = self.seen[Section::Transitions as usize];
        while self.seen[Section::Transitions as usize] < end && self.wrong.is_none() {
            self.read_next(Section::Transitions);
            let trigger = self.field(transition::EVENT);
            let target = self.field(transition::TARGET);
            let guard = self.field(transition::GUARD);
            let action = self.field(transition::ACTION);
            let event = trigger & usize::from(format::MAX_EVENT);
            events |= 1 << (event % 32);
            if event == usize::from(format::PULSE) {
                let goes_on = row == first_on_event - first
                    && guard < usize::from(format::GUARD_PROGRAM)
                    && row_end.is_none_or(|end| end == guard);
                if goes_on {
                    row += 1;
                    row_end = Some(guard + 1);
                }
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
            let target_shape = self.tables.word(state::SHAPE, target);
            let is_plain = kind <= format::STATE_SIMPLE
                && target_shape == usize::from(format::STATE_SIMPLE << format::STATE_KIND_SHIFT)
                && action == 0;
            let is_again = may_be_again
                && event == usize::from(format::PULSE)
                && target == source
                && action >= usize::from(format::ACTION_SEND);
            self.ensure((trigger != event) == (is_plain || is_again), Cause::Kind);

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
                self.read_next(Section::Code);
                let in_order = at == guard - usize::from(format::GUARD_MASK);
                self.ensure(in_order, Cause::Order);
                let (mask, value) = (self.field(mask::MASK), self.field(mask::VALUE));
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
        (events, first_on_event, if row > 1 { row } else { 0 })
    }

    /// Checks a program of tests, or a row of actions.
    #[inline(never)]
    fn code(&mut self, first: usize, state: usize, operations: usize) {
        self.read(Section::States, state);
        let first_flag = self.field(state::FIRST_FLAG);
        let flags = self.field(state::SHAPE) & usize::from(format::STATE_FLAGS_MASK);
        let mut at = first;
        let mut farthest = 0;
        loop {
            self.read_next(Section::Code);
            self.ensure(self.index == at, Cause::Order);
            let operand = self.field(code::OPERAND);
            let control = self.field(code::CONTROL);
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
                self.ensure(farthest <= at, Cause::Direction);
                return;
            }
            farthest = farthest.max(at + low);
            at += 1;
        }
    }

    fn channel(&mut self) {
        let regions = self.count(Section::RegionInstances);
        let words = self.field(channel::REGION_WORDS);
        let end = self.field(channel::FIRST_REGION_WORD) + words;
        let row_end = self.field(channel::FIRST_ROW_WORD) + words;
        let right = self.field(channel::EVENT).wrapping_sub(1) < self.events
            && end <= regions.div_ceil(32)
            && row_end <= self.count(Section::Listeners);
        self.ensure(right, Cause::Index);
        if words != 0 && end > regions / 32 {
            // Bits behind the last region instance.
            self.read(Section::Listeners, row_end - 1);
            self.ensure(
                self.long(listener::REGIONS) << (regions % 32) == 0,
                Cause::Range,
            );
        }
    }

    /// Checks what is told of a task state beside its state.
    fn task_state(&mut self) {
        let task = self.field(task_state::TASK);
        let slot = self.field(task_state::SLOT);
        let state = self.field(task_state::STATE);
        let shape = self.tables.word(state::SHAPE, state);
        let kind = shape as u16 >> format::STATE_KIND_SHIFT;
        let right_slot = if kind == format::STATE_BACKGROUND_TASK {
            slot == NONE
        } else {
            kind == format::STATE_TASK && slot < self.count(Section::Slots)
        };
        self.ensure(right_slot, Cause::Index);
        let flags = format::TASK_CONTROL_FLAGS + self.tables.word(task::FLAGS, task);
        let params = self.tables.word(task::PARAMS, task);
        let end = self.field(task_state::FIRST_PARAM) + params;
        self.take(Section::Params, params);
        let in_order = shape & usize::from(format::STATE_FLAGS_MASK) == flags
            && state < self.field_behind(task_state::STATE)
            && end == self.first_behind(task_state::FIRST_PARAM, Section::Params);
        self.ensure(in_order, Cause::Order);
    }

    /// Checks where the data ports of a task instance stand.
    fn task_instance(&mut self) {
        let task_state = self.field(task_instance::TASK_STATE);
        let task = self.tables.word(task_state::TASK, task_state);
        let ports = self.tables.word(task::DATA, task);
        let end = self.field(task_instance::FIRST_CONNECTION) + ports;
        self.take(Section::Connections, ports);
        let behind = self.first_behind(task_instance::FIRST_CONNECTION, Section::Connections);
        self.ensure(end == behind, Cause::Order);
    }

    fn connection(&mut self) {
        let net = self.field(connection::NET);
        let right = net == NONE || net < self.count(Section::Nets);
        self.ensure(right, Cause::Index);
    }

    /// Nothing is missing or left over.
    fn ends(&mut self) {
        /// Sections of which each record is under test, or any number may be.
        const FREE: usize = 1 << Section::Slots as u8
            | 1 << Section::Listeners as u8
            | 1 << Section::Tasks as u8
            | 1 << Section::Nets as u8
            | 1 << Section::Names as u8;
        self.seen[Section::Mission as usize] = 1;
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
