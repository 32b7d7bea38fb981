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
use crate::layout::{
    Field, code, connection, container, instance, mission, region, region_instance, state, task,
    task_instance, task_state, transition,
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

    /// 32-bit words that [`Interpreter::new`](crate::Interpreter::new) needs: two for each region instance, a bit for each flag and each task instance, and half a
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

/// How the interpreter divides its arena. Counts of words.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArenaLayout {
    pub(crate) regions: usize,
    pub(crate) flags: usize,
    pub(crate) enabled: usize,
    pub(crate) queue: usize,
    /// In events, not words.
    pub(crate) queue_capacity: usize,
}

impl ArenaLayout {
    #[inline]
    pub(crate) fn of(tables: &Tables<'_>) -> Self {
        const WORD_BITS: usize = 32;
        Self {
            regions: 2 * tables.region_instance_count(),
            flags: tables.flag_count().div_ceil(WORD_BITS),
            enabled: tables.task_instance_count().div_ceil(WORD_BITS),
            queue: tables.queue_capacity().div_ceil(2),
            queue_capacity: tables.queue_capacity(),
        }
    }

    pub(crate) fn words(self) -> usize {
        self.regions + self.flags + self.enabled + self.queue
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
            let is_text = matches!(
                section,
                Section::Visibility | Section::Signatures | Section::Names
            );
            if records * tables::record_bytes(section) != length as usize
                || (!is_text && records >= usize::from(format::NONE))
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
    match pass.check() {
        Ok(()) => Ok(layout),
        Err(cause) => Err(Refusal::Record {
            section: Section::ALL
                .get(usize::from(pass.section))
                .copied()
                .unwrap_or(Section::Mission),
            index: pass.index as u16,
            cause,
        }),
    }
}

fn ensure(holds: bool, cause: Cause) -> Result<(), Cause> {
    if holds { Ok(()) } else { Err(cause) }
}

/// The pass, with the places that it has come to.
struct Pass<'a> {
    tables: Tables<'a>,
    /// The record under test, by section number and index: it is the one that is wrong if a test fails.
    section: u8,
    index: usize,
    /// Next records of the templates.
    regions: usize,
    states: usize,
    transitions: usize,
    code: usize,
    task_states: usize,
    params: usize,
}

/// The container under test, and what its states took of its spans so far.
struct Spans {
    container: usize,
    /// Its first instance.
    instance: usize,
    flags: usize,
    tasks: usize,
    /// Relative to the region instance whose states are being checked.
    regions: usize,
    instances: usize,
}

impl<'a> Pass<'a> {
    fn over(tables: Tables<'a>) -> Self {
        Self {
            tables,
            section: Section::Mission as u8,
            index: 0,
            regions: 0,
            states: 0,
            transitions: 0,
            code: 0,
            task_states: 0,
            params: 0,
        }
    }

    fn check(&mut self) -> Result<(), Cause> {
        self.mission()?;
        self.slots()?;
        self.tasks()?;
        self.templates()?;
        self.instances()?;
        self.channels()?;
        self.connections()
    }

    /// Says which record is under test. Its section is that of the field read last.
    #[inline(always)]
    fn at(&mut self, index: usize) {
        self.index = index;
    }

    /// The same where no field was read yet.
    fn at_in(&mut self, section: Section, index: usize) {
        self.section = section as u8;
        self.index = index;
    }

    /// Nothing is left of a section behind `checked` records.
    #[inline(never)]
    fn end(&mut self, section: Section, checked: usize) -> Result<(), Cause> {
        self.at_in(section, checked);
        ensure(checked == self.tables.count(section), Cause::Order)
    }

    /// A field of the record under test.
    #[inline(never)]
    fn field(&mut self, field: Field) -> usize {
        self.section = field.section() as u8;
        self.tables.word(field, self.index)
    }

    /// A field of the record under test has this value.
    #[inline(never)]
    fn expect(&mut self, field: Field, value: usize, cause: Cause) -> Result<(), Cause> {
        ensure(self.field(field) == value, cause)
    }

    /// A section has a record with this index.
    #[inline(never)]
    fn has(&self, section: Section, index: usize) -> Result<(), Cause> {
        ensure(index < self.tables.count(section), Cause::Index)
    }

    fn mission(&mut self) -> Result<(), Cause> {
        self.end(Section::Mission, 1)?;
        self.index = 0;
        let queue = self.field(mission::QUEUE);
        ensure(queue.wrapping_sub(1) < format::MAX_QUEUE, Cause::Range)?;
        let events = self.field(mission::EVENTS);
        ensure(events <= usize::from(format::MAX_EVENT), Cause::Range)?;
        let slot = self.field(mission::INTERPRETER_SLOT);
        self.has(Section::Slots, slot)
    }

    /// Slots are strictly periodic: two of them never overlap if and only if they do not within the greatest common divisor of
    /// their periods (Korst, Aarts, Lenstra 1996).
    ///
    /// The interpreter's slot starts at 0, for the time of a machine is that of its slots.
    fn slots(&mut self) -> Result<(), Cause> {
        let interpreter = self.tables.interpreter_slot();
        let mut index = 0;
        while let Some(slot) = self.tables.slot(index) {
            self.at_in(Section::Slots, index);
            let in_range = slot.number >= 1
                && slot.period_us <= format::MAX_TIME_US
                && slot.duration_us <= slot.period_us
                && slot.start_us < slot.period_us
                && (slot.start_us == 0 || index != interpreter);
            ensure(in_range, Cause::Range)?;
            for earlier in 0..index {
                let earlier = self.tables.slot(earlier).ok_or(Cause::Index)?;
                let apart = do_not_overlap(&earlier, &slot) && slot.number != earlier.number;
                ensure(apart, Cause::Overlap)?;
            }
            index += 1;
        }
        Ok(())
    }

    fn tasks(&mut self) -> Result<(), Cause> {
        let groups = self.tables.exclusive_group_count();
        let mut text_bytes = 0;
        for index in 0..self.tables.count(Section::Tasks) {
            self.at(index);
            self.expect(task::TEXT_START, text_bytes, Cause::Order)?;
            text_bytes += self.field(task::TEXT_LENGTH);
            let group = self.field(task::EXCLUSIVE);
            ensure(group < groups || group == NONE, Cause::Range)?;
        }
        self.end(Section::Signatures, text_bytes)
    }

    fn templates(&mut self) -> Result<(), Cause> {
        for index in 0..self.tables.count(Section::Containers) {
            self.container(index)?;
        }
        self.end(Section::Regions, self.regions)?;
        self.end(Section::States, self.states)?;
        self.end(Section::Transitions, self.transitions)?;
        self.end(Section::Code, self.code)?;
        self.end(Section::TaskStates, self.task_states)?;
        self.end(Section::Params, self.params)
    }

    fn container(&mut self, index: usize) -> Result<(), Cause> {
        self.at(index);
        self.expect(container::FIRST_REGION, self.regions, Cause::Order)?;
        let instance = self.field(container::FIRST_INSTANCE);
        self.has(Section::Instances, instance)?;
        let instance_of = self.tables.word(instance::CONTAINER, instance);
        ensure(instance_of == index, Cause::Index)?;
        let flags = self.field(container::FLAGS);
        let mut spans = Spans {
            container: index,
            instance,
            flags: format::CONTAINER_CONTROL_FLAGS + flags,
            tasks: 0,
            regions: 0,
            instances: 1,
        };
        let mut region_instances = 0;
        while self.tables.word(region::CONTAINER, self.regions) == index {
            spans.regions = 1;
            self.region(&mut spans)?;
            region_instances += spans.regions;
            self.regions += 1;
        }
        self.at(index);
        ensure(region_instances > 0, Cause::Template)?;
        self.expect(container::FLAG_SPAN, spans.flags, Cause::Template)?;
        self.expect(container::TASK_SPAN, spans.tasks, Cause::Template)?;
        self.expect(container::REGION_SPAN, region_instances, Cause::Template)?;
        self.expect(container::INSTANCE_SPAN, spans.instances, Cause::Template)
    }

    fn region(&mut self, spans: &mut Spans) -> Result<(), Cause> {
        self.at(self.regions);
        let first_state = self.states;
        self.expect(region::FIRST_STATE, first_state, Cause::Order)?;
        let end_state = self.tables.region_end(self.regions);
        loop {
            self.at(self.states);
            self.has(Section::States, self.states)?;
            let shape = self.field(state::SHAPE) as u16;
            let kind = shape >> format::STATE_KIND_SHIFT;
            let is_first = self.states == first_state;
            let is_last = self.states + 1 == end_state;
            let right_kind = is_first == (kind == format::STATE_INITIAL)
                && is_last == (kind == format::STATE_FINAL);
            ensure(right_kind, Cause::Kind)?;
            self.state(kind, shape, spans)?;
            self.transitions(kind, spans.container, first_state, end_state)?;
            self.states += 1;
            if is_last {
                return Ok(());
            }
        }
    }

    fn state(&mut self, kind: u16, shape: u16, spans: &mut Spans) -> Result<(), Cause> {
        self.expect(state::FIRST_FLAG, spans.flags, Cause::Order)?;
        let flags = usize::from(shape & format::STATE_FLAGS_MASK);
        if shape & format::STATE_HAS_TIMEOUT != 0 {
            let high = self.field(state::TIMEOUT_HIGH) as u32;
            let timeout_us = self.field(state::TIMEOUT_LOW) as u32 | high << 16;
            let in_range = timeout_us <= format::MAX_TIME_US && flags > 0;
            ensure(in_range, Cause::Range)?;
        }
        let mut flag_span = flags;
        let right_flags = match kind {
            format::STATE_INITIAL | format::STATE_FINAL => 0,
            format::STATE_SIMPLE => flags.min(1),
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                self.expect(state::A, spans.tasks, Cause::Order)?;
                self.expect(state::B, self.task_states, Cause::Order)?;
                spans.tasks += 1;
                format::TASK_CONTROL_FLAGS + self.task_state(kind == format::STATE_TASK)?
            }
            format::STATE_SUPER => {
                self.expect(state::A, spans.regions, Cause::Order)?;
                self.expect(state::B, spans.instances, Cause::Order)?;
                let inside = spans.instance + spans.instances;
                self.has(Section::Instances, inside)?;
                let first_task = self.tables.word(instance::FIRST_TASK, spans.instance);
                let right_task =
                    self.tables.word(instance::FIRST_TASK, inside) == first_task + spans.tasks;
                ensure(right_task, Cause::Order)?;
                let content = self.tables.word(instance::CONTAINER, inside);
                self.has(Section::Containers, content)?;
                spans.tasks += self.tables.word(container::TASK_SPAN, content);
                spans.regions += self.tables.word(container::REGION_SPAN, content);
                spans.instances += self.tables.word(container::INSTANCE_SPAN, content);
                flag_span = self.tables.word(container::FLAG_SPAN, content);
                format::CONTAINER_CONTROL_FLAGS + self.tables.word(container::FLAGS, content)
            }
            _ => return Err(Cause::Kind),
        };
        spans.flags += flag_span;
        ensure(flags == right_flags, Cause::Template)
    }

    /// Checks the next task state and returns the number of its task's control flags.
    fn task_state(&mut self, real_time: bool) -> Result<usize, Cause> {
        self.at(self.task_states);
        self.has(Section::TaskStates, self.task_states)?;
        let task = self.field(task_state::TASK);
        self.has(Section::Tasks, task)?;
        if real_time {
            let slot = self.field(task_state::SLOT);
            self.has(Section::Slots, slot)?;
        } else {
            self.expect(task_state::SLOT, NONE, Cause::Index)?;
        }
        self.expect(task_state::FIRST_PARAM, self.params, Cause::Order)?;
        self.params += self.tables.word(task::PARAMS, task);
        self.task_states += 1;
        self.at_in(Section::States, self.states);
        Ok(self.tables.word(task::FLAGS, task))
    }

    /// Checks the transitions out of the next state, whose region has the states from `first_state` up to `end_state`.
    fn transitions(
        &mut self,
        kind: u16,
        container: usize,
        first_state: usize,
        end_state: usize,
    ) -> Result<(), Cause> {
        let end = self.tables.transition_end(self.states);
        self.expect(state::FIRST_TRANSITION, self.transitions, Cause::Order)?;
        let first_on_event = self.field(state::FIRST_EVENT_TRANSITION);
        let in_order = self.transitions <= first_on_event && first_on_event <= end;
        ensure(in_order, Cause::Order)?;
        let is_left = end != self.transitions;
        ensure(!is_left || kind != format::STATE_FINAL, Cause::Kind)?;
        while self.transitions < end {
            self.at(self.transitions);
            self.has(Section::Transitions, self.transitions)?;
            let trigger = self.field(transition::EVENT) as u16;
            let event = trigger & !format::TRANSITION_HAS_CODE;
            let target = self.field(transition::TARGET);
            let on_pulse = self.transitions < first_on_event;
            let right = on_pulse == (event == format::PULSE)
                && usize::from(event) <= self.tables.event_count()
                && target > first_state
                && target < end_state;
            ensure(right, Cause::Index)?;
            if event != trigger {
                self.expect(transition::CODE, self.code, Cause::Order)?;
                self.code(kind, container)?;
            }
            self.transitions += 1;
        }
        Ok(())
    }

    /// Checks a guard and the actions behind it.
    fn code(&mut self, source_kind: u16, container: usize) -> Result<(), Cause> {
        let mut farthest_jump = self.code;
        let mut in_guard = true;
        loop {
            self.at(self.code);
            self.has(Section::Code, self.code)?;
            let control = self.field(code::CONTROL) as u16;
            let low = control & format::CODE_LOW_MASK;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            let is_test = (format::CODE_JUMP_IF_CLEAR..=format::CODE_JUMP_IF_BUSY_INSIDE)
                .contains(&operation);
            // What an operand must be below; nothing looks at the operand of what needs none.
            let mut limit = self.tables.word(container::FLAG_SPAN, container);
            if is_test {
                farthest_jump = farthest_jump.max(self.code + usize::from(low));
                let looks_inside = operation >= format::CODE_JUMP_IF_IDLE_INSIDE;
                let has_inside = source_kind == format::STATE_SUPER;
                ensure(in_guard && (has_inside || !looks_inside), Cause::Kind)?;
            } else {
                // A jump may lead to what follows the last test, and no farther.
                ensure(!in_guard || farthest_jump <= self.code, Cause::Direction)?;
                ensure(in_guard || operation != format::CODE_END, Cause::Kind)?;
                in_guard = false;
                if operation == format::CODE_SEND {
                    limit = self.tables.word(container::CHANNELS, container);
                }
            }
            ensure(self.field(code::OPERAND) < limit, Cause::Index)?;
            self.code += 1;
            if operation == format::CODE_END || (!is_test && low != 0) {
                return Ok(());
            }
        }
    }

    /// Checks the instance tree: each instance from the one around it.
    fn instances(&mut self) -> Result<(), Cause> {
        let count = self.tables.count(Section::Instances);
        self.at(0);
        self.has(Section::Instances, 0)?;
        self.expect(instance::CONTAINER, 0, Cause::Template)?;
        self.expect(instance::FIRST_REGION, 0, Cause::Template)?;
        self.expect(instance::FIRST_FLAG, 0, Cause::Template)?;
        self.expect(instance::FIRST_TASK, 0, Cause::Template)?;
        self.at(0);
        self.expect(container::FIRST_INSTANCE, 0, Cause::Template)?;
        self.expect(
            container::FLAG_SPAN,
            self.tables.flag_count(),
            Cause::Template,
        )?;
        let mut seen = Seen {
            instances: 1,
            ..Seen::default()
        };
        for index in 0..count {
            self.instance(index, &mut seen)?;
        }
        self.end(Section::Instances, seen.instances)?;
        self.end(Section::RegionInstances, seen.regions)?;
        self.end(Section::TaskInstances, seen.tasks)?;
        self.end(Section::Channels, seen.channels)
    }

    fn instance(&mut self, index: usize, seen: &mut Seen) -> Result<(), Cause> {
        self.at(index);
        let container = self.field(instance::CONTAINER);
        self.has(Section::Containers, container)?;
        self.expect(instance::FIRST_CHANNEL, seen.channels, Cause::Order)?;
        seen.channels += self.tables.word(container::CHANNELS, container);
        let first_task = self.field(instance::FIRST_TASK);
        let end_task = first_task + self.tables.word(container::TASK_SPAN, container);
        self.expect(instance::END_TASK, end_task, Cause::Template)?;
        let first_flag = self.field(instance::FIRST_FLAG);
        let parent = self.field(instance::PARENT_REGION);
        let after = if index == 0 {
            self.tables.count(Section::RegionInstances)
        } else {
            self.tables.word(region_instance::NEXT, parent)
        };
        let around = Around {
            index,
            container,
            first_flag,
            first_task,
        };
        let mut at = self.field(instance::FIRST_REGION);
        let mut template = self.tables.word(container::FIRST_REGION, container);
        while self.tables.word(region::CONTAINER, template) == container {
            self.at(at);
            // The one before was not the last, so the walk must not have left the instance.
            ensure(at < after, Cause::Direction)?;
            self.has(Section::RegionInstances, at)?;
            let next = self.field(region_instance::NEXT);
            ensure(next > at, Cause::Direction)?;
            self.expect(region_instance::INSTANCE, index, Cause::Template)?;
            self.expect(region_instance::FIRST_FLAG, first_flag, Cause::Template)?;
            let first_state = self.tables.word(region::FIRST_STATE, template);
            self.expect(region_instance::INITIAL, first_state, Cause::Template)?;
            for state in first_state..self.tables.region_end(template) {
                self.state_instance(&around, at, state, seen)?;
            }
            seen.regions += 1;
            at = next;
            template += 1;
        }
        self.at(index);
        ensure(at == after, Cause::Direction)
    }

    /// Checks what a state of a region instance stands for: a task instance, or an instance of a container.
    fn state_instance(
        &mut self,
        around: &Around,
        region: usize,
        state: usize,
        seen: &mut Seen,
    ) -> Result<(), Cause> {
        // Templates that are used often could make this pass much longer than the blob.
        seen.states += 1;
        ensure(seen.states <= format::MAX_STATE_INSTANCES, Cause::Range)?;
        let kind = self.tables.word(state::SHAPE, state) as u16 >> format::STATE_KIND_SHIFT;
        let a = self.tables.word(state::A, state);
        if kind == format::STATE_SUPER {
            seen.instances += 1;
            let offset = self.tables.word(state::B, state);
            let first_flag = around.first_flag + self.tables.word(state::FIRST_FLAG, state);
            // What the first instance of the container around makes of this state holds for all of them.
            let model_around = self
                .tables
                .word(container::FIRST_INSTANCE, around.container);
            let model = model_around + offset;
            let container = self.tables.word(instance::CONTAINER, model);
            let first_task = around.first_task + self.tables.word(instance::FIRST_TASK, model)
                - self.tables.word(instance::FIRST_TASK, model_around);
            self.at(around.index + offset);
            self.has(Section::Instances, self.index)?;
            self.expect(instance::CONTAINER, container, Cause::Template)?;
            self.expect(instance::FIRST_REGION, region + a, Cause::Template)?;
            self.expect(instance::FIRST_FLAG, first_flag, Cause::Template)?;
            self.expect(instance::FIRST_TASK, first_task, Cause::Template)?;
            self.expect(instance::PARENT_REGION, region, Cause::Template)?;
            self.expect(instance::PARENT_STATE, state, Cause::Template)?;
        } else if kind == format::STATE_TASK || kind == format::STATE_BACKGROUND_TASK {
            seen.tasks += 1;
            self.at(around.first_task + a);
            self.has(Section::TaskInstances, self.index)?;
            self.expect(task_instance::STATE, state, Cause::Template)?;
            self.expect(task_instance::REGION, region, Cause::Template)?;
        }
        Ok(())
    }

    fn channels(&mut self) -> Result<(), Cause> {
        let tables = self.tables;
        let mut index = 0;
        while let Some(channel) = tables.channel(index) {
            self.at_in(Section::Channels, index);
            let instances = channel.instances;
            let bits = tables.section(Section::Visibility).len();
            let in_bits = match channel.bits {
                None => true,
                Some(first) => first <= bits && instances.div_ceil(8) <= bits - first,
            };
            let right = usize::from(channel.event).wrapping_sub(1) < tables.event_count()
                && channel.first_instance + instances <= tables.count(Section::Instances)
                && in_bits;
            ensure(right, Cause::Index)?;
            index += 1;
        }
        Ok(())
    }

    /// Checks the data ports of task instances.
    fn connections(&mut self) -> Result<(), Cause> {
        let mut connections = 0;
        for index in 0..self.tables.count(Section::TaskInstances) {
            self.at(index);
            self.expect(task_instance::FIRST_CONNECTION, connections, Cause::Order)?;
            let state = self.field(task_instance::STATE);
            let task_state = self.tables.word(state::B, state);
            let task = self.tables.word(task_state::TASK, task_state);
            connections += self.tables.word(task::DATA, task);
        }
        self.end(Section::Connections, connections)?;
        for index in 0..connections {
            self.at(index);
            let net = self.field(connection::NET);
            if net != NONE {
                self.has(Section::Nets, net)?;
            }
        }
        Ok(())
    }
}

/// What the pass over the instance tree has come by so far.
#[derive(Default)]
struct Seen {
    instances: usize,
    regions: usize,
    states: usize,
    tasks: usize,
    channels: usize,
}

/// The instance whose states are looked at.
struct Around {
    index: usize,
    container: usize,
    first_flag: usize,
    first_task: usize,
}

/// Whether two slots can never be due at once. A slot without duration may start where another does.
fn do_not_overlap(earlier: &Slot, slot: &Slot) -> bool {
    let base_us = greatest_common_divisor(slot.period_us, earlier.period_us);
    let apart_us = slot.start_us.abs_diff(earlier.start_us) % base_us;
    let (first, second) = if slot.start_us >= earlier.start_us {
        (earlier, slot)
    } else {
        (slot, earlier)
    };
    let end_us = apart_us.saturating_add(second.duration_us);
    let is_point = apart_us == 0 && second.duration_us == 0 && first.duration_us <= base_us;
    is_point || (first.duration_us <= apart_us && end_us <= base_us)
}

fn greatest_common_divisor(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}
