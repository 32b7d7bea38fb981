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
use crate::signature::{Port, fnv1a};
use crate::tables::{self, Code, Container, Instance, Region, State, StateKind, Tables};

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

/// A [`Refusal::Record`] on its way: small enough for a register.
#[derive(Clone, Copy)]
struct BadRecord {
    section: Section,
    cause: Cause,
    index: u16,
}

impl From<BadRecord> for Refusal {
    fn from(bad: BadRecord) -> Self {
        let BadRecord {
            section,
            cause,
            index,
        } = bad;
        Self::Record {
            section,
            index,
            cause,
        }
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
    check_tables(&layout.tables(bytes))?;
    Ok(layout)
}

fn check_tables(tables: &Tables<'_>) -> Result<(), BadRecord> {
    check_mission(tables)?;
    check_slots(tables)?;
    check_tasks(tables)?;
    Templates::default().check(tables)?;
    check_instances(tables)?;
    check_channels(tables)?;
    check_task_instances(tables)?;
    check_names(tables)
}

/// One record under test.
#[derive(Clone, Copy)]
struct Place(Section, usize);

impl Place {
    fn refuse(self, cause: Cause) -> BadRecord {
        BadRecord {
            section: self.0,
            cause,
            index: self.1 as u16,
        }
    }

    fn ensure(self, holds: bool, cause: Cause) -> Result<(), BadRecord> {
        if holds {
            Ok(())
        } else {
            Err(self.refuse(cause))
        }
    }
}

fn check_mission(tables: &Tables<'_>) -> Result<(), BadRecord> {
    let place = Place(Section::Mission, 0);
    place.ensure(tables.count(Section::Mission) == 1, Cause::Order)?;
    let in_range = (1..=format::MAX_QUEUE).contains(&tables.queue_capacity())
        && tables.event_count() <= usize::from(format::MAX_EVENT);
    place.ensure(in_range, Cause::Range)?;
    place.ensure(
        tables.interpreter_slot() < tables.count(Section::Slots),
        Cause::Index,
    )
}

/// Slots are strictly periodic: two of them never overlap if and only if they do not within the greatest common divisor of
/// their periods (Korst, Aarts, Lenstra 1996).
fn check_slots(tables: &Tables<'_>) -> Result<(), BadRecord> {
    for (index, slot) in tables.slots().enumerate() {
        let place = Place(Section::Slots, index);
        let in_range = slot.number >= 1
            && (1..=format::MAX_TIME_US).contains(&slot.period_us)
            && slot.duration_us <= slot.period_us
            && slot.start_us < slot.period_us;
        place.ensure(in_range, Cause::Range)?;
        for earlier in tables.slots().take(index) {
            let base_us = greatest_common_divisor(slot.period_us, earlier.period_us);
            let ahead_us = if slot.start_us >= earlier.start_us {
                (slot.start_us - earlier.start_us) % base_us
            } else {
                (base_us - (earlier.start_us - slot.start_us) % base_us) % base_us
            };
            let fits = earlier.duration_us <= ahead_us
                && base_us
                    .checked_sub(slot.duration_us)
                    .is_some_and(|room_us| ahead_us <= room_us);
            place.ensure(fits && slot.number != earlier.number, Cause::Overlap)?;
        }
    }
    Ok(())
}

fn greatest_common_divisor(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

fn check_tasks(tables: &Tables<'_>) -> Result<(), BadRecord> {
    let mut text_bytes = 0;
    for (index, task) in tables.tasks().enumerate() {
        let place = Place(Section::Tasks, index);
        let text = task.signature.text();
        // Texts in a row: each begins where the one before ended.
        let expected = tables.section(Section::Signatures).get(text_bytes..);
        let in_row = expected.is_some_and(|rest| {
            rest.as_ptr() == text.as_ptr() && rest.starts_with(text) && !text.is_empty()
        });
        place.ensure(in_row, Cause::Order)?;
        text_bytes += text.len();
        let right = task.signature.counts() == Some(task.ports)
            && task.signature.hash() == task.signature_hash;
        place.ensure(right, Cause::Text)?;
        let in_range = task
            .exclusive
            .is_none_or(|group| usize::from(group) < tables.count(Section::Tasks));
        place.ensure(in_range, Cause::Range)?;
    }
    let place = Place(Section::Signatures, text_bytes);
    place.ensure(
        text_bytes == tables.count(Section::Signatures),
        Cause::Order,
    )
}

/// How far the pass over the templates has come.
#[derive(Default)]
struct Templates {
    regions: usize,
    states: usize,
    transitions: usize,
    code: usize,
    task_states: usize,
    params: usize,
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

impl Templates {
    fn check(mut self, tables: &Tables<'_>) -> Result<(), BadRecord> {
        for (index, container) in tables.containers().enumerate() {
            self.container(tables, index, &container)?;
        }
        let ends = [
            (
                Section::Regions,
                self.regions,
                tables.count(Section::Regions),
            ),
            (Section::States, self.states, tables.count(Section::States)),
            (
                Section::Transitions,
                self.transitions,
                tables.count(Section::Transitions),
            ),
            (Section::Code, self.code, tables.count(Section::Code)),
            (
                Section::TaskStates,
                self.task_states,
                tables.count(Section::TaskStates),
            ),
            (Section::Params, self.params, tables.count(Section::Params)),
        ];
        for (section, checked, length) in ends {
            Place(section, checked).ensure(checked == length, Cause::Order)?;
        }
        Ok(())
    }

    fn container(
        &mut self,
        tables: &Tables<'_>,
        index: usize,
        container: &Container,
    ) -> Result<(), BadRecord> {
        let place = Place(Section::Containers, index);
        place.ensure(container.first_region == self.regions, Cause::Order)?;
        let instance = tables
            .instance(container.first_instance)
            .filter(|instance| instance.container == index)
            .ok_or(place.refuse(Cause::Index))?;
        let mut spans = Spans {
            flags: format::CONTAINER_CONTROL_FLAGS + container.flags,
            tasks: 0,
            regions: 0,
            instances: 1,
        };
        let mut region_instances = 0;
        while let Some(region) = tables
            .region(self.regions)
            .filter(|region| region.container == index)
        {
            spans.regions = 1;
            self.region(tables, &region, container, &instance, &mut spans)?;
            region_instances += spans.regions;
            self.regions += 1;
        }
        let exact = container.flag_span == spans.flags
            && container.task_span == spans.tasks
            && container.region_span == region_instances
            && container.instance_span == spans.instances;
        place.ensure(exact && region_instances > 0, Cause::Template)
    }

    fn region(
        &mut self,
        tables: &Tables<'_>,
        region: &Region,
        container: &Container,
        instance: &Instance,
        spans: &mut Spans,
    ) -> Result<(), BadRecord> {
        Place(Section::Regions, self.regions)
            .ensure(region.first_state == self.states, Cause::Order)?;
        let end = tables
            .region(self.regions + 1)
            .map_or(tables.count(Section::States), |next| next.first_state);
        let mut is_first = true;
        loop {
            let place = Place(Section::States, self.states);
            let state = tables.state(self.states).ok_or(place.refuse(Cause::Kind))?;
            let is_last = self.states + 1 == end;
            let right_kind = is_first == (state.kind == StateKind::Initial)
                && is_last == (state.kind == StateKind::Final);
            place.ensure(right_kind, Cause::Kind)?;
            self.state(tables, place, &state, container, instance, spans)?;
            self.transitions(tables, place, &state, container, region.first_state..end)?;
            self.states += 1;
            is_first = false;
            if is_last {
                return Ok(());
            }
        }
    }

    fn state(
        &mut self,
        tables: &Tables<'_>,
        place: Place,
        state: &State,
        container: &Container,
        instance: &Instance,
        spans: &mut Spans,
    ) -> Result<(), BadRecord> {
        place.ensure(state.first_flag == spans.flags, Cause::Order)?;
        let in_range = state
            .timeout_us
            .is_none_or(|timeout_us| timeout_us <= format::MAX_TIME_US && state.flags > 0);
        place.ensure(in_range, Cause::Range)?;
        let right_flags = match state.kind {
            StateKind::Initial | StateKind::Final => state.flags == 0,
            StateKind::Simple => {
                spans.flags += state.flags;
                state.flags <= 1
            }
            StateKind::Task {
                task_offset,
                task_state,
                real_time,
            } => {
                let in_order = task_offset == spans.tasks && task_state == self.task_states;
                place.ensure(in_order, Cause::Order)?;
                spans.tasks += 1;
                spans.flags += state.flags;
                state.flags == format::TASK_CONTROL_FLAGS + self.task_state(tables, real_time)?
            }
            StateKind::Super {
                region_offset,
                instance_offset,
            } => {
                let inside = tables
                    .instance(container.first_instance + instance_offset)
                    .ok_or(place.refuse(Cause::Index))?;
                let content = tables
                    .container(inside.container)
                    .ok_or(place.refuse(Cause::Index))?;
                let in_order = region_offset == spans.regions
                    && instance_offset == spans.instances
                    && inside.first_task == instance.first_task + spans.tasks;
                place.ensure(in_order, Cause::Order)?;
                spans.flags += content.flag_span;
                spans.tasks += content.task_span;
                spans.regions += content.region_span;
                spans.instances += content.instance_span;
                state.flags == format::CONTAINER_CONTROL_FLAGS + content.flags
            }
        };
        place.ensure(right_flags, Cause::Template)
    }

    /// Checks the next task state and returns the number of its task's control flags.
    fn task_state(&mut self, tables: &Tables<'_>, real_time: bool) -> Result<usize, BadRecord> {
        let place = Place(Section::TaskStates, self.task_states);
        let task_state = tables
            .task_state(self.task_states)
            .ok_or(place.refuse(Cause::Index))?;
        let task = tables
            .task(task_state.task)
            .ok_or(place.refuse(Cause::Index))?;
        let right_slot = match task_state.slot {
            None => !real_time,
            Some(slot) => real_time && slot < tables.count(Section::Slots),
        };
        place.ensure(right_slot, Cause::Index)?;
        place.ensure(task_state.first_param == self.params, Cause::Order)?;
        self.params += task.ports.params;
        self.task_states += 1;
        Ok(task.ports.flags)
    }

    /// Checks the transitions out of a state whose region has the states `region`.
    fn transitions(
        &mut self,
        tables: &Tables<'_>,
        state_place: Place,
        state: &State,
        container: &Container,
        region: core::ops::Range<usize>,
    ) -> Result<(), BadRecord> {
        let end = tables
            .state(self.states + 1)
            .map_or(tables.count(Section::Transitions), |next| {
                next.first_transition
            });
        let in_order = state.first_transition == self.transitions
            && (self.transitions..=end).contains(&state.first_event_transition);
        state_place.ensure(in_order, Cause::Order)?;
        state_place.ensure(
            state.kind != StateKind::Final || end == self.transitions,
            Cause::Kind,
        )?;
        while self.transitions < end {
            let place = Place(Section::Transitions, self.transitions);
            let transition = tables
                .transition(self.transitions)
                .ok_or(place.refuse(Cause::Index))?;
            let on_pulse = self.transitions < state.first_event_transition;
            let right_event = on_pulse == (transition.event == format::PULSE)
                && usize::from(transition.event) <= tables.event_count();
            place.ensure(right_event, Cause::Index)?;
            let enters_state = transition.target > region.start && transition.target < region.end;
            place.ensure(enters_state, Cause::Index)?;
            if let Some(start) = transition.code {
                place.ensure(start == self.code, Cause::Order)?;
                self.code(tables, state, container)?;
            }
            self.transitions += 1;
        }
        Ok(())
    }

    /// Checks a guard and the actions behind it.
    fn code(
        &mut self,
        tables: &Tables<'_>,
        source: &State,
        container: &Container,
    ) -> Result<(), BadRecord> {
        let mut farthest_jump = self.code;
        let mut in_guard = true;
        loop {
            let place = Place(Section::Code, self.code);
            let code = tables.code(self.code).ok_or(place.refuse(Cause::Kind))?;
            let jump = match code {
                Code::Test { jump, .. } | Code::TestBusyInside { jump, .. } => jump,
                _ => {
                    // A jump may lead to what follows the last test, and no farther.
                    place.ensure(!in_guard || farthest_jump <= self.code, Cause::Direction)?;
                    None
                }
            };
            farthest_jump = farthest_jump.max(self.code + jump.unwrap_or(0));
            let follows_guard = in_guard;
            in_guard &= code.is_test();
            let last = match code {
                Code::Test { flag, .. } => {
                    place.ensure(in_guard, Cause::Kind)?;
                    place.ensure(flag < container.flag_span, Cause::Index)?;
                    false
                }
                Code::TestBusyInside { .. } => {
                    let is_super = matches!(source.kind, StateKind::Super { .. });
                    place.ensure(in_guard && is_super, Cause::Kind)?;
                    false
                }
                Code::End => {
                    place.ensure(follows_guard, Cause::Kind)?;
                    true
                }
                Code::Send { channel, last } => {
                    place.ensure(channel < container.channels, Cause::Index)?;
                    last
                }
                Code::Write { flag, last, .. } => {
                    place.ensure(flag < container.flag_span, Cause::Index)?;
                    last
                }
            };
            self.code += 1;
            if last {
                return Ok(());
            }
        }
    }
}

/// Checks the instance tree: container instances with their region instances.
fn check_instances(tables: &Tables<'_>) -> Result<(), BadRecord> {
    let mut regions = 0;
    let mut channels = 0;
    for index in 0..tables.count(Section::Instances) {
        let place = Place(Section::Instances, index);
        let no_index = place.refuse(Cause::Index);
        let instance = tables.instance(index).ok_or(no_index)?;
        let container = tables.container(instance.container).ok_or(no_index)?;
        place.ensure(instance.first_channel == channels, Cause::Order)?;
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
                && container.instance_span == tables.count(Section::Instances);
            place.ensure(is_whole, Cause::Template)?;
            tables.count(Section::RegionInstances)
        } else {
            check_parent(tables, place, &instance).ok_or(place.refuse(Cause::Template))??
        };
        let end_task = instance.first_task + container.task_span;
        place.ensure(instance.end_task == end_task, Cause::Template)?;
        regions += check_region_instances(tables, index, &instance, &container, after)?;
    }
    Place(Section::Instances, tables.count(Section::Instances))
        .ensure(!(tables.count(Section::Instances) == 0), Cause::Order)?;
    Place(Section::RegionInstances, regions).ensure(
        regions == tables.count(Section::RegionInstances),
        Cause::Order,
    )?;
    Place(Section::Channels, channels)
        .ensure(channels == tables.count(Section::Channels), Cause::Order)
}

/// Checks an instance against the superstate around it and returns where the walk goes on behind that: `None` if there is no such superstate.
fn check_parent(
    tables: &Tables<'_>,
    place: Place,
    instance: &Instance,
) -> Option<Result<usize, BadRecord>> {
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
        && region.instance + instance_offset == place.1
        && model.container == instance.container
        && region.first_flag + state.first_flag == instance.first_flag
        && around.first_task + model.first_task == instance.first_task + model_around.first_task;
    Some(place.ensure(exact, Cause::Template).map(|()| region.next))
}

/// Checks the regions of one instance, behind which the walk goes on at `after`, and returns their number.
fn check_region_instances(
    tables: &Tables<'_>,
    index: usize,
    instance: &Instance,
    container: &Container,
    after: usize,
) -> Result<usize, BadRecord> {
    let templates = tables
        .regions()
        .skip(container.first_region)
        .take_while(|region| region.container == instance.container);
    let mut at = instance.first_region;
    let mut count = 0;
    for template in templates {
        let place = Place(Section::RegionInstances, at);
        // The one before was not the last, so the walk must not have left the instance.
        place.ensure(at < after, Cause::Direction)?;
        let region = tables
            .region_instance(at)
            .ok_or(place.refuse(Cause::Index))?;
        let exact = region.instance == index
            && region.initial == template.first_state
            && region.first_flag == instance.first_flag;
        place.ensure(exact, Cause::Template)?;
        place.ensure(region.next > at, Cause::Direction)?;
        at = region.next;
        count += 1;
    }
    Place(Section::Instances, index).ensure(at == after, Cause::Direction)?;
    Ok(count)
}

/// Whether a state is one of those that a region instance can be in.
fn is_state_of(tables: &Tables<'_>, state: usize, region: &tables::RegionInstance) -> bool {
    tables
        .region(tables.region_of_state(state))
        .is_some_and(|template| template.first_state == region.initial)
}

fn check_channels(tables: &Tables<'_>) -> Result<(), BadRecord> {
    for index in 0..tables.count(Section::Channels) {
        let place = Place(Section::Channels, index);
        let channel = tables.channel(index).ok_or(place.refuse(Cause::Index))?;
        let right_event =
            channel.event != format::PULSE && usize::from(channel.event) <= tables.event_count();
        let in_tree =
            channel.first_instance + channel.instances <= tables.count(Section::Instances);
        let in_bits = channel.bits.is_none_or(|first| {
            tables
                .count(Section::Visibility)
                .checked_sub(first)
                .is_some_and(|bytes| channel.instances.div_ceil(8) <= bytes)
        });
        place.ensure(right_event && in_tree && in_bits, Cause::Index)?;
    }
    Ok(())
}

fn check_task_instances(tables: &Tables<'_>) -> Result<(), BadRecord> {
    let mut connections = 0;
    for index in 0..tables.count(Section::TaskInstances) {
        let place = Place(Section::TaskInstances, index);
        let no_index = place.refuse(Cause::Index);
        let task_instance = tables.task_instance(index).ok_or(no_index)?;
        let region = tables
            .region_instance(task_instance.region)
            .ok_or(no_index)?;
        let around = tables.instance(region.instance).ok_or(no_index)?;
        let state = tables.state(task_instance.state).ok_or(no_index)?;
        let StateKind::Task {
            task_offset,
            task_state,
            ..
        } = state.kind
        else {
            return Err(place.refuse(Cause::Kind));
        };
        let exact = is_state_of(tables, task_instance.state, &region)
            && around.first_task + task_offset == index;
        place.ensure(exact, Cause::Template)?;
        place.ensure(task_instance.first_connection == connections, Cause::Order)?;
        let task = tables
            .task_state(task_state)
            .and_then(|task_state| tables.task(task_state.task))
            .ok_or(no_index)?;
        for port in task.signature.ports() {
            if let Port::Data { type_name, .. } = port {
                check_connection(tables, connections, type_name)?;
                connections += 1;
            }
        }
    }
    Place(Section::Connections, connections).ensure(
        connections == tables.count(Section::Connections),
        Cause::Order,
    )
}

/// Checks that a port with the type `type_name` is open or on a net of that type.
fn check_connection(tables: &Tables<'_>, index: usize, type_name: &[u8]) -> Result<(), BadRecord> {
    let place = Place(Section::Connections, index);
    let no_index = place.refuse(Cause::Index);
    if let Some(net) = tables.connection(index).ok_or(no_index)? {
        let net = tables.net(net).ok_or(no_index)?;
        place.ensure(net.type_hash == fnv1a(type_name), Cause::Type)?;
    }
    Ok(())
}

/// A name table is whole or absent.
fn check_names(tables: &Tables<'_>) -> Result<(), BadRecord> {
    let Some(mut names) = tables.names() else {
        return Ok(());
    };
    let control_flags: usize = tables.containers().map(|container| container.flags).sum();
    let groups = tables
        .tasks()
        .filter_map(|task| task.exclusive)
        .max()
        .map_or(0, |last| usize::from(last) + 1);
    let pseudo_states = 2 * tables.count(Section::Regions);
    let expected = tables.event_count()
        + tables.count(Section::Containers)
        + control_flags
        + tables.count(Section::Regions)
        + (tables.count(Section::States) - pseudo_states)
        + groups;
    let is_part = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'_';
    let mut count = 0;
    for name in names.by_ref() {
        Place(Section::Names, count)
            .ensure(!name.is_empty() && name.iter().all(is_part), Cause::Text)?;
        count += 1;
    }
    let whole = count == expected && names.rest().is_empty();
    Place(Section::Names, count).ensure(whole, Cause::Order)
}
