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
use crate::signature::{Port, fnv1a, is_identifier_part};
use crate::tables::{
    self, Code, Container, Instance, Region, RegionInstance, Slot, State, StateKind, Tables,
};

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

/// What the states of a container took of its spans so far.
#[derive(Clone, Copy)]
struct Spans {
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

    /// Nothing of a section may be left behind `checked` records.
    fn end(&mut self, section: Section, checked: usize) -> Result<(), Cause> {
        self.at(section, checked);
        ensure(checked == self.tables.count(section), Cause::Order)
    }

    fn mission(&mut self) -> Result<(), Cause> {
        let tables = self.tables;
        self.end(Section::Mission, 1)?;
        let in_range = (1..=format::MAX_QUEUE).contains(&tables.queue_capacity())
            && tables.event_count() <= usize::from(format::MAX_EVENT);
        ensure(in_range, Cause::Range)?;
        let slots = tables.count(Section::Slots);
        ensure(tables.interpreter_slot() < slots, Cause::Index)
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
            let signature = task.signature;
            // A text that would end behind the last one reads as empty, which has no counts.
            ensure(task.text_start == text_bytes, Cause::Order)?;
            text_bytes += signature.text().len();
            let right =
                signature.counts() == Some(task.ports) && signature.hash() == task.signature_hash;
            ensure(right, Cause::Text)?;
            let in_range = task
                .exclusive
                .is_none_or(|group| usize::from(group) < groups);
            ensure(in_range, Cause::Range)?;
            index += 1;
        }
        self.end(Section::Signatures, text_bytes)
    }

    fn templates(&mut self) -> Result<(), Cause> {
        let mut index = 0;
        while let Some(container) = self.tables.container(index) {
            self.container(index, &container)?;
            self.control_flags += container.flags;
            index += 1;
        }
        self.end(Section::Regions, self.regions)?;
        self.end(Section::States, self.states)?;
        self.end(Section::Transitions, self.transitions)?;
        self.end(Section::Code, self.code)?;
        self.end(Section::TaskStates, self.task_states)?;
        self.end(Section::Params, self.params)
    }

    fn container(&mut self, index: usize, container: &Container) -> Result<(), Cause> {
        self.at(Section::Containers, index);
        ensure(container.first_region == self.regions, Cause::Order)?;
        let instance = self
            .tables
            .instance(container.first_instance)
            .ok_or(Cause::Index)?;
        ensure(instance.container == index, Cause::Index)?;
        let mut spans = Spans {
            flags: format::CONTAINER_CONTROL_FLAGS + container.flags,
            tasks: 0,
            regions: 0,
            instances: 1,
        };
        let mut region_instances = 0;
        while let Some(region) = self.tables.region(self.regions) {
            if region.container != index {
                break;
            }
            spans.regions = 1;
            self.region(&region, container, &instance, &mut spans)?;
            region_instances += spans.regions;
            self.regions += 1;
        }
        self.at(Section::Containers, index);
        let exact = container.flag_span == spans.flags
            && container.task_span == spans.tasks
            && container.region_span == region_instances
            && container.instance_span == spans.instances
            && region_instances > 0;
        ensure(exact, Cause::Template)
    }

    fn region(
        &mut self,
        region: &Region,
        container: &Container,
        instance: &Instance,
        spans: &mut Spans,
    ) -> Result<(), Cause> {
        self.at(Section::Regions, self.regions);
        ensure(region.first_state == self.states, Cause::Order)?;
        let end = match self.tables.region(self.regions + 1) {
            Some(next) => next.first_state,
            None => self.tables.count(Section::States),
        };
        loop {
            self.at(Section::States, self.states);
            let state = self.tables.state(self.states).ok_or(Cause::Kind)?;
            let is_first = self.states == region.first_state;
            let is_last = self.states + 1 == end;
            let right_kind = is_first == (state.kind == StateKind::Initial)
                && is_last == (state.kind == StateKind::Final);
            ensure(right_kind, Cause::Kind)?;
            self.state(&state, container, instance, spans)?;
            self.transitions(&state, container, region.first_state, end)?;
            self.states += 1;
            if is_last {
                return Ok(());
            }
        }
    }

    fn state(
        &mut self,
        state: &State,
        container: &Container,
        instance: &Instance,
        spans: &mut Spans,
    ) -> Result<(), Cause> {
        ensure(state.first_flag == spans.flags, Cause::Order)?;
        if let Some(timeout_us) = state.timeout_us {
            let in_range = timeout_us <= format::MAX_TIME_US && state.flags > 0;
            ensure(in_range, Cause::Range)?;
        }
        let (flags, flag_span) = match state.kind {
            StateKind::Initial | StateKind::Final => (0, 0),
            StateKind::Simple => {
                let timeout = state.flags.min(1);
                (timeout, timeout)
            }
            StateKind::Task {
                task_offset,
                task_state,
                real_time,
            } => {
                let in_order = task_offset == spans.tasks && task_state == self.task_states;
                ensure(in_order, Cause::Order)?;
                spans.tasks += 1;
                let flags = format::TASK_CONTROL_FLAGS + self.task_state(real_time)?;
                (flags, flags)
            }
            StateKind::Super {
                region_offset,
                instance_offset,
            } => {
                let inside = self
                    .tables
                    .instance(container.first_instance + instance_offset)
                    .ok_or(Cause::Index)?;
                let content = self
                    .tables
                    .container(inside.container)
                    .ok_or(Cause::Index)?;
                let in_order = region_offset == spans.regions
                    && instance_offset == spans.instances
                    && inside.first_task == instance.first_task + spans.tasks;
                ensure(in_order, Cause::Order)?;
                spans.tasks += content.task_span;
                spans.regions += content.region_span;
                spans.instances += content.instance_span;
                let flags = format::CONTAINER_CONTROL_FLAGS + content.flags;
                (flags, content.flag_span)
            }
        };
        spans.flags += flag_span;
        ensure(state.flags == flags, Cause::Template)
    }

    /// Checks the next task state and returns the number of its task's control flags.
    fn task_state(&mut self, real_time: bool) -> Result<usize, Cause> {
        self.at(Section::TaskStates, self.task_states);
        let task_state = self
            .tables
            .task_state(self.task_states)
            .ok_or(Cause::Index)?;
        let task = self.tables.task(task_state.task).ok_or(Cause::Index)?;
        let slots = self.tables.count(Section::Slots);
        let right_slot = match task_state.slot {
            None => !real_time,
            Some(slot) => real_time && slot < slots,
        };
        ensure(right_slot, Cause::Index)?;
        ensure(task_state.first_param == self.params, Cause::Order)?;
        self.params += task.ports.params;
        self.task_states += 1;
        self.at(Section::States, self.states);
        Ok(task.ports.flags)
    }

    /// Checks the transitions out of the next state, whose region has the states from `first_state` up to `end_state`.
    fn transitions(
        &mut self,
        state: &State,
        container: &Container,
        first_state: usize,
        end_state: usize,
    ) -> Result<(), Cause> {
        let end = self
            .tables
            .transition_end(self.states)
            .unwrap_or(self.transitions);
        let in_order = state.first_transition == self.transitions
            && self.transitions <= state.first_event_transition
            && state.first_event_transition <= end;
        ensure(in_order, Cause::Order)?;
        let is_left = end != self.transitions;
        ensure(!is_left || state.kind != StateKind::Final, Cause::Kind)?;
        while self.transitions < end {
            self.at(Section::Transitions, self.transitions);
            let transition = self
                .tables
                .transition(self.transitions)
                .ok_or(Cause::Index)?;
            let on_pulse = self.transitions < state.first_event_transition;
            let enters_other_than_initial =
                transition.target > first_state && transition.target < end_state;
            let right = on_pulse == (transition.event == format::PULSE)
                && usize::from(transition.event) <= self.tables.event_count()
                && enters_other_than_initial;
            ensure(right, Cause::Index)?;
            if let Some(start) = transition.code {
                ensure(start == self.code, Cause::Order)?;
                self.code(state, container)?;
            }
            self.transitions += 1;
        }
        Ok(())
    }

    /// Checks a guard and the actions behind it.
    fn code(&mut self, source: &State, container: &Container) -> Result<(), Cause> {
        let mut farthest_jump = self.code;
        let mut in_guard = true;
        loop {
            self.at(Section::Code, self.code);
            let code = self.tables.code(self.code).ok_or(Cause::Kind)?;
            let may_end = in_guard;
            if !code.is_test() {
                // A jump may lead to what follows the last test, and no farther.
                ensure(!in_guard || farthest_jump <= self.code, Cause::Direction)?;
                in_guard = false;
            }
            let (flag, last) = match code {
                Code::Test { flag, jump, .. } => {
                    farthest_jump = farthest_jump.max(self.code + jump.unwrap_or(0));
                    ensure(in_guard, Cause::Kind)?;
                    (flag, false)
                }
                Code::TestBusyInside { jump, .. } => {
                    farthest_jump = farthest_jump.max(self.code + jump.unwrap_or(0));
                    let is_super = matches!(source.kind, StateKind::Super { .. });
                    ensure(in_guard && is_super, Cause::Kind)?;
                    (0, false)
                }
                Code::End => {
                    ensure(may_end, Cause::Kind)?;
                    (0, true)
                }
                Code::Send { channel, last } => {
                    ensure(channel < container.channels, Cause::Index)?;
                    (0, last)
                }
                Code::Write { flag, last, .. } => (flag, last),
            };
            ensure(flag < container.flag_span, Cause::Index)?;
            self.code += 1;
            if last {
                return Ok(());
            }
        }
    }

    /// Checks the instance tree: container instances with their region instances.
    fn instances(&mut self) -> Result<(), Cause> {
        let tables = self.tables;
        let count = tables.count(Section::Instances);
        let mut regions = 0;
        let mut channels = 0;
        let mut index = 0;
        while let Some(instance) = tables.instance(index) {
            self.at(Section::Instances, index);
            let container = tables.container(instance.container).ok_or(Cause::Index)?;
            ensure(instance.first_channel == channels, Cause::Order)?;
            channels += container.channels;
            let after = if index == 0 {
                let is_whole = instance.container == 0
                    && instance.first_region == 0
                    && instance.first_flag == 0
                    && instance.first_task == 0
                    && container.first_instance == 0
                    && container.flag_span == tables.flag_count()
                    && container.task_span == tables.count(Section::TaskInstances)
                    && container.region_span == tables.count(Section::RegionInstances)
                    && container.instance_span == count;
                ensure(is_whole, Cause::Template)?;
                container.region_span
            } else {
                walk_behind(&tables, index, &instance).ok_or(Cause::Template)?
            };
            let end_task = instance.first_task + container.task_span;
            ensure(instance.end_task == end_task, Cause::Template)?;
            regions += self.region_instances(index, &instance, &container, after)?;
            index += 1;
        }
        ensure(index > 0, Cause::Order)?;
        self.end(Section::RegionInstances, regions)?;
        self.end(Section::Channels, channels)
    }

    /// Checks the regions of one instance, behind which the walk goes on at `after`, and returns their number.
    fn region_instances(
        &mut self,
        index: usize,
        instance: &Instance,
        container: &Container,
        after: usize,
    ) -> Result<usize, Cause> {
        let mut template_index = container.first_region;
        let mut at = instance.first_region;
        while let Some(template) = self.tables.region(template_index) {
            if template.container != instance.container {
                break;
            }
            self.at(Section::RegionInstances, at);
            // The one before was not the last, so the walk must not have left the instance.
            ensure(at < after, Cause::Direction)?;
            let region = self.tables.region_instance(at).ok_or(Cause::Index)?;
            let exact = region.instance == index
                && region.initial == template.first_state
                && region.first_flag == instance.first_flag;
            ensure(exact, Cause::Template)?;
            ensure(region.next > at, Cause::Direction)?;
            at = region.next;
            template_index += 1;
        }
        ensure(at == after, Cause::Direction)?;
        Ok(template_index - container.first_region)
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
        let tables = self.tables;
        let mut connections = 0;
        let mut index = 0;
        while let Some(task_instance) = tables.task_instance(index) {
            self.at(Section::TaskInstances, index);
            let region = tables
                .region_instance(task_instance.region)
                .ok_or(Cause::Index)?;
            let around = tables.instance(region.instance).ok_or(Cause::Index)?;
            let state = tables.state(task_instance.state).ok_or(Cause::Index)?;
            let StateKind::Task {
                task_offset,
                task_state,
                ..
            } = state.kind
            else {
                return Err(Cause::Kind);
            };
            let exact = is_state_of(&tables, task_instance.state, &region)
                && around.first_task + task_offset == index;
            ensure(exact, Cause::Template)?;
            ensure(task_instance.first_connection == connections, Cause::Order)?;
            let task_state = tables.task_state(task_state).ok_or(Cause::Index)?;
            let task = tables.task(task_state.task).ok_or(Cause::Index)?;
            for port in task.signature.ports() {
                if let Port::Data { type_name, .. } = port {
                    self.connection(connections, type_name)?;
                    connections += 1;
                }
            }
            index += 1;
        }
        self.end(Section::Connections, connections)
    }

    /// Checks that a port with the type `type_name` is open or on a net of that type.
    fn connection(&mut self, index: usize, type_name: &[u8]) -> Result<(), Cause> {
        self.at(Section::Connections, index);
        let Some(net) = self.tables.connection(index).ok_or(Cause::Index)? else {
            return Ok(());
        };
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

/// Checks an instance against the superstate that it says it is inside of. Returns where the walk goes on behind that: `None`
/// if there is no such superstate.
fn walk_behind(tables: &Tables<'_>, index: usize, instance: &Instance) -> Option<usize> {
    let (parent_region, parent_state) = instance.parent;
    let region = tables.region_instance(parent_region)?;
    let state = tables.state(parent_state)?;
    let StateKind::Super {
        region_offset,
        instance_offset,
    } = state.kind
    else {
        return None;
    };
    // What the first instance of the container around makes of this state holds for all of them.
    let around = tables.instance(region.instance)?;
    let model_around_index = tables.container(around.container)?.first_instance;
    let model_around = tables.instance(model_around_index)?;
    let model = tables.instance(model_around_index + instance_offset)?;
    let exact = is_state_of(tables, parent_state, &region)
        && parent_region + region_offset == instance.first_region
        && region.instance + instance_offset == index
        && model.container == instance.container
        && region.first_flag + state.first_flag == instance.first_flag
        && around.first_task + model.first_task == instance.first_task + model_around.first_task;
    exact.then_some(region.next)
}

/// Whether a state is one of those that a region instance can be in.
fn is_state_of(tables: &Tables<'_>, state: usize, region: &RegionInstance) -> bool {
    tables
        .region(tables.region_of_state(state))
        .is_some_and(|template| template.first_state == region.initial)
}
