//! The one pass that a blob must survive before anything is taken from it.
//!
//! What it proves is what the [format](crate::format) says: every index points into its table, every part begins where the one before ended, every jump and
//! every `next` goes ahead, and each record of the instance tree is what its template makes of it. From that follows all that the
//! interpreter relies on: its walk ends, its guards end, the flags and tasks that it touches belong to the instance that it is in.
//!
//! Templates come first. A container's spans (flags, tasks, regions, instances that one instance of it takes) must be the exact
//! sums of its parts, so no container can hold itself. Then each instance is checked against the superstate that it says it is inside of. Since instance
//! numbers follow from the parent's by the template, no two instances can share a superstate; and since there are as many
//! as the machine's span says, no superstate is without. So nothing is visited twice, and time grows linearly with the size of the blob
//! (save for the pairs of slots, and a logarithm), with a stack of constant depth.

use core::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::format::{self, Section};
use crate::layout::{
    code, container, instance, mission, region, region_instance, state, task, task_instance,
    task_state, transition,
};
use crate::signature::{Port, fnv1a, is_identifier_part};
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
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// An index points outside of what it may point to.
    Index,
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
    /// A text is malformed, or its hash or its counts differ.
    Text,
    /// A port's type is not that of its net.
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
            section: pass.section,
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
    /// The record under test: it is the one that is wrong if a test fails.
    section: Section,
    index: usize,
    /// Next records of the templates.
    regions: usize,
    states: usize,
    transitions: usize,
    code: usize,
    task_states: usize,
    params: usize,
    /// Control flags of containers.
    control_flags: usize,
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
            section: Section::Mission,
            index: 0,
            regions: 0,
            states: 0,
            transitions: 0,
            code: 0,
            task_states: 0,
            params: 0,
            control_flags: 0,
        }
    }

    fn check(&mut self) -> Result<(), Cause> {
        self.mission()?;
        self.slots()?;
        self.tasks()?;
        self.templates()?;
        self.instances()?;
        self.channels()?;
        self.task_instances()?;
        self.names()
    }

    /// Says which record is under test.
    fn at(&mut self, section: Section, index: usize) {
        self.section = section;
        self.index = index;
    }

    /// Nothing is left of the section under test behind `checked` records.
    fn end(&mut self, section: Section, checked: usize) -> Result<(), Cause> {
        self.at(section, checked);
        ensure(checked == self.tables.count(section), Cause::Order)
    }

    /// A 16-bit field of the record under test.
    fn field(&self, field: usize) -> usize {
        self.tables.word(self.section, self.index, field)
    }

    /// A 16-bit field of the record under test has this value.
    #[inline(never)]
    fn expect(&self, field: usize, value: usize, cause: Cause) -> Result<(), Cause> {
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
        self.has(Section::Slots, self.field(mission::INTERPRETER_SLOT))
    }

    /// Slots are strictly periodic: two of them never overlap if and only if they do not within the greatest common divisor of
    /// their periods (Korst, Aarts, Lenstra 1996).
    fn slots(&mut self) -> Result<(), Cause> {
        let mut index = 0;
        while let Some(slot) = self.tables.slot(index) {
            self.at(Section::Slots, index);
            let in_range = slot.number >= 1
                && slot.period_us <= format::MAX_TIME_US
                && slot.duration_us <= slot.period_us
                && slot.start_us < slot.period_us;
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
        let mut index = 0;
        while let Some(task) = self.tables.task(index) {
            self.at(Section::Tasks, index);
            // A text that would end behind the last one reads as empty, which has no counts.
            self.expect(task::TEXT_START, text_bytes, Cause::Order)?;
            let text = task.signature.text();
            text_bytes += text.len();
            let right =
                task.signature.counts() == Some(task.ports) && fnv1a(text) == task.signature_hash;
            ensure(right, Cause::Text)?;
            let group = self.field(task::EXCLUSIVE);
            ensure(group < groups || group == NONE, Cause::Range)?;
            index += 1;
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
        self.at(Section::Containers, index);
        self.expect(container::FIRST_REGION, self.regions, Cause::Order)?;
        let instance = self.field(container::FIRST_INSTANCE);
        self.has(Section::Instances, instance)?;
        let instance_of = self.instance(instance, instance::CONTAINER);
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
        self.control_flags += flags;
        let mut region_instances = 0;
        while self
            .tables
            .word(Section::Regions, self.regions, region::CONTAINER)
            == index
        {
            spans.regions = 1;
            self.region(&mut spans)?;
            region_instances += spans.regions;
            self.regions += 1;
        }
        self.at(Section::Containers, index);
        ensure(region_instances > 0, Cause::Template)?;
        self.expect(container::FLAG_SPAN, spans.flags, Cause::Template)?;
        self.expect(container::TASK_SPAN, spans.tasks, Cause::Template)?;
        self.expect(container::REGION_SPAN, region_instances, Cause::Template)?;
        self.expect(container::INSTANCE_SPAN, spans.instances, Cause::Template)
    }

    fn region(&mut self, spans: &mut Spans) -> Result<(), Cause> {
        self.at(Section::Regions, self.regions);
        let first_state = self.states;
        self.expect(region::FIRST_STATE, first_state, Cause::Order)?;
        let end_state = self.tables.region_end(self.regions);
        loop {
            self.at(Section::States, self.states);
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
                let first_task = self.instance(spans.instance, instance::FIRST_TASK);
                let right_task =
                    self.instance(inside, instance::FIRST_TASK) == first_task + spans.tasks;
                ensure(right_task, Cause::Order)?;
                let content = self.instance(inside, instance::CONTAINER);
                self.has(Section::Containers, content)?;
                spans.tasks += self.container_field(content, container::TASK_SPAN);
                spans.regions += self.container_field(content, container::REGION_SPAN);
                spans.instances += self.container_field(content, container::INSTANCE_SPAN);
                flag_span = self.container_field(content, container::FLAG_SPAN);
                format::CONTAINER_CONTROL_FLAGS + self.container_field(content, container::FLAGS)
            }
            _ => return Err(Cause::Kind),
        };
        spans.flags += flag_span;
        ensure(flags == right_flags, Cause::Template)
    }

    fn instance(&self, index: usize, field: usize) -> usize {
        self.tables.word(Section::Instances, index, field)
    }

    fn container_field(&self, index: usize, field: usize) -> usize {
        self.tables.word(Section::Containers, index, field)
    }

    /// Checks the next task state and returns the number of its task's control flags.
    fn task_state(&mut self, real_time: bool) -> Result<usize, Cause> {
        self.at(Section::TaskStates, self.task_states);
        self.has(Section::TaskStates, self.task_states)?;
        let task = self.field(task_state::TASK);
        self.has(Section::Tasks, task)?;
        if real_time {
            self.has(Section::Slots, self.field(task_state::SLOT))?;
        } else {
            self.expect(task_state::SLOT, NONE, Cause::Index)?;
        }
        self.expect(task_state::FIRST_PARAM, self.params, Cause::Order)?;
        self.params += self.tables.word(Section::Tasks, task, task::PARAMS);
        self.task_states += 1;
        self.at(Section::States, self.states);
        Ok(self.tables.word(Section::Tasks, task, task::FLAGS))
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
            self.at(Section::Transitions, self.transitions);
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
            self.at(Section::Code, self.code);
            self.has(Section::Code, self.code)?;
            let control = self.field(code::CONTROL) as u16;
            let low = control & format::CODE_LOW_MASK;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            let is_test = (format::CODE_JUMP_IF_CLEAR..=format::CODE_JUMP_IF_BUSY_INSIDE)
                .contains(&operation);
            // What an operand must be below; nothing looks at the operand of what needs none.
            let mut limit = self.container_field(container, container::FLAG_SPAN);
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
                    limit = self.container_field(container, container::CHANNELS);
                }
            }
            ensure(self.field(code::OPERAND) < limit, Cause::Index)?;
            self.code += 1;
            if operation == format::CODE_END || (!is_test && low != 0) {
                return Ok(());
            }
        }
    }

    /// Checks the instance tree: container instances with their region instances.
    fn instances(&mut self) -> Result<(), Cause> {
        let count = self.tables.count(Section::Instances);
        let mut regions = 0;
        let mut channels = 0;
        self.at(Section::Instances, 0);
        self.has(Section::Instances, 0)?;
        for index in 0..count {
            self.at(Section::Instances, index);
            let container = self.field(instance::CONTAINER);
            self.has(Section::Containers, container)?;
            self.expect(instance::FIRST_CHANNEL, channels, Cause::Order)?;
            channels += self.container_field(container, container::CHANNELS);
            let after = if index == 0 {
                self.machine()?
            } else {
                self.walk_behind(index, container)?
            };
            let end_task = self.field(instance::FIRST_TASK)
                + self.container_field(container, container::TASK_SPAN);
            self.expect(instance::END_TASK, end_task, Cause::Template)?;
            regions += self.region_instances(index, container, after)?;
        }
        self.end(Section::RegionInstances, regions)?;
        self.end(Section::Channels, channels)
    }

    /// Checks instance 0, and returns where the walk goes on behind it.
    fn machine(&self) -> Result<usize, Cause> {
        for field in [
            instance::CONTAINER,
            instance::FIRST_REGION,
            instance::FIRST_FLAG,
            instance::FIRST_TASK,
        ] {
            self.expect(field, 0, Cause::Template)?;
        }
        let spans = [
            (container::FIRST_INSTANCE, 0),
            (container::FLAG_SPAN, self.tables.flag_count()),
            (
                container::TASK_SPAN,
                self.tables.count(Section::TaskInstances),
            ),
            (
                container::REGION_SPAN,
                self.tables.count(Section::RegionInstances),
            ),
            (
                container::INSTANCE_SPAN,
                self.tables.count(Section::Instances),
            ),
        ];
        for (field, value) in spans {
            ensure(self.container_field(0, field) == value, Cause::Template)?;
        }
        Ok(self.tables.count(Section::RegionInstances))
    }

    /// Checks the instance under test against the superstate that it says it is inside of. Returns where the walk goes on behind that.
    fn walk_behind(&self, index: usize, container: usize) -> Result<usize, Cause> {
        let tables = &self.tables;
        let region = self.field(instance::PARENT_REGION);
        let state = self.field(instance::PARENT_STATE);
        self.has(Section::RegionInstances, region)?;
        self.has(Section::States, state)?;
        let of_region = |field| tables.word(Section::RegionInstances, region, field);
        let of_state = |field| tables.word(Section::States, state, field);
        let kind = of_state(state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
        let around = of_region(region_instance::INSTANCE);
        self.has(Section::Instances, around)?;
        let inside = of_state(state::B);
        // What the first instance of the container around makes of this state holds for all of them.
        let around_of = self.instance(around, instance::CONTAINER);
        let model_around = self.container_field(around_of, container::FIRST_INSTANCE);
        let model = model_around + inside;
        self.has(Section::Instances, model)?;
        let first_task = self.instance(around, instance::FIRST_TASK)
            + self.instance(model, instance::FIRST_TASK);
        let model_task = self.instance(model_around, instance::FIRST_TASK);
        let exact = kind == format::STATE_SUPER
            && tables.is_state_of(state, region)
            && around + inside == index
            && self.instance(model, instance::CONTAINER) == container
            && self.field(instance::FIRST_TASK) + model_task == first_task;
        ensure(exact, Cause::Template)?;
        let first_region = region + of_state(state::A);
        self.expect(instance::FIRST_REGION, first_region, Cause::Template)?;
        let first_flag = of_region(region_instance::FIRST_FLAG) + of_state(state::FIRST_FLAG);
        self.expect(instance::FIRST_FLAG, first_flag, Cause::Template)?;
        Ok(of_region(region_instance::NEXT))
    }

    /// Checks the regions of one instance, behind which the walk goes on at `after`, and returns their number.
    fn region_instances(
        &mut self,
        index: usize,
        container: usize,
        after: usize,
    ) -> Result<usize, Cause> {
        let first_flag = self.field(instance::FIRST_FLAG);
        let mut at = self.field(instance::FIRST_REGION);
        let first_template = self.container_field(container, container::FIRST_REGION);
        let mut template = first_template;
        while self
            .tables
            .word(Section::Regions, template, region::CONTAINER)
            == container
        {
            self.at(Section::RegionInstances, at);
            // The one before was not the last, so the walk must not have left the instance.
            ensure(at < after, Cause::Direction)?;
            self.has(Section::RegionInstances, at)?;
            let initial = self
                .tables
                .word(Section::Regions, template, region::FIRST_STATE);
            self.expect(region_instance::INITIAL, initial, Cause::Template)?;
            self.expect(region_instance::INSTANCE, index, Cause::Template)?;
            self.expect(region_instance::FIRST_FLAG, first_flag, Cause::Template)?;
            let next = self.field(region_instance::NEXT);
            ensure(next > at, Cause::Direction)?;
            at = next;
            template += 1;
        }
        ensure(at == after, Cause::Direction)?;
        Ok(template - first_template)
    }

    fn channels(&mut self) -> Result<(), Cause> {
        let tables = self.tables;
        let mut index = 0;
        while let Some(channel) = tables.channel(index) {
            self.at(Section::Channels, index);
            let instances = channel.instances;
            let bytes = instances.div_ceil(8);
            let in_bits = channel.bits.is_none_or(|first| {
                let available = tables.count(Section::Visibility).checked_sub(first);
                available.is_some_and(|available| bytes <= available)
            });
            let right = channel.event != format::PULSE
                && usize::from(channel.event) <= tables.event_count()
                && channel.first_instance + instances <= tables.count(Section::Instances)
                && in_bits;
            ensure(right, Cause::Index)?;
            index += 1;
        }
        Ok(())
    }

    fn task_instances(&mut self) -> Result<(), Cause> {
        let mut connections = 0;
        for index in 0..self.tables.count(Section::TaskInstances) {
            self.at(Section::TaskInstances, index);
            let state = self.field(task_instance::STATE);
            let region = self.field(task_instance::REGION);
            self.has(Section::States, state)?;
            self.has(Section::RegionInstances, region)?;
            self.expect(task_instance::FIRST_CONNECTION, connections, Cause::Order)?;
            let of_state = |field| self.tables.word(Section::States, state, field);
            let kind = of_state(state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
            let is_task = kind == format::STATE_TASK || kind == format::STATE_BACKGROUND_TASK;
            ensure(is_task, Cause::Kind)?;
            let around =
                self.tables
                    .word(Section::RegionInstances, region, region_instance::INSTANCE);
            let first_task = self.instance(around, instance::FIRST_TASK);
            let exact =
                self.tables.is_state_of(state, region) && first_task + of_state(state::A) == index;
            ensure(exact, Cause::Template)?;
            let task_state = of_state(state::B);
            let task = self
                .tables
                .word(Section::TaskStates, task_state, task_state::TASK);
            let task = self.tables.task(task).ok_or(Cause::Index)?;
            for port in task.signature.ports() {
                if let Port::Data { type_name, .. } = port {
                    self.connection(connections, type_name)?;
                    connections += 1;
                }
            }
        }
        self.end(Section::Connections, connections)
    }

    /// Checks that a port with the type `type_name` is open or on a net of that type.
    fn connection(&mut self, index: usize, type_name: &[u8]) -> Result<(), Cause> {
        self.at(Section::Connections, index);
        self.has(Section::Connections, index)?;
        let net = self.field(0);
        if net == NONE {
            return Ok(());
        }
        let net = self.tables.net(net).ok_or(Cause::Index)?;
        ensure(net.type_hash == fnv1a(type_name), Cause::Type)
    }

    /// A name table is whole or absent.
    fn names(&mut self) -> Result<(), Cause> {
        let tables = self.tables;
        let Some(mut names) = tables.names() else {
            return Ok(());
        };
        // A region has one name of its own and none for its two pseudo-states.
        let of_regions = tables.count(Section::States) - tables.count(Section::Regions);
        let expected = tables.event_count()
            + tables.count(Section::Containers)
            + self.control_flags
            + of_regions
            + tables.exclusive_group_count();
        let mut count = 0;
        for name in names.by_ref() {
            self.at(Section::Names, count);
            let is_identifier = !name.is_empty() && name.iter().copied().all(is_identifier_part);
            ensure(is_identifier, Cause::Text)?;
            count += 1;
        }
        ensure(count == expected && names.rest().is_empty(), Cause::Order)
    }
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
