//! The interpreter: what a machine does, once, for firmware and host.
//!
//! It keeps its state in an arena of 32-bit words that the caller lends it: for each region instance its current state and the
//! time at which that was entered, then the flags, the enable bits of the task instances, and the event queue. Everything else is read from
//! the blob.
//!
//! Nothing here indexes: a read outside a table gives nothing, a write outside the arena does nothing. So there is no panic to reach, whatever a
//! blob says, and no code for one. That every loop ends is what [`verify`](crate::verify()) proved.

use core::ops::Deref;

use crate::format::{self, Section};
use crate::tables::{Channel, Instance, RegionInstance, StateKind, Tables, TaskPlaces};
use crate::verify::{ArenaLayout, Verified};

/// Why a machine was stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A transition sent an event for which the queue had no room. The queue's capacity is too small, or events cause each other in a circle.
    EventQueueOverflow,
    /// A macro step had more than [`MAX_MICRO_STEPS`] events. Events cause each other in a circle.
    MacroStepLimit,
}

impl Fault {
    /// The name of the fault in traces and messages.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::EventQueueOverflow => "event-queue-overflow",
            Self::MacroStepLimit => "macro-step-limit",
        }
    }
}

/// The most micro steps of a macro step.
pub const MAX_MICRO_STEPS: u8 = 255;

/// The arena that was lent is too small for this blob.
#[derive(Debug)]
pub struct ArenaTooSmall<'m, B> {
    /// The blob, given back.
    pub verified: Verified<B>,
    /// The arena, given back.
    pub arena: &'m mut [u32],
    /// Words that the blob needs.
    pub needed_words: usize,
}

/// A transition that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransitionTaken {
    /// The micro step, from 0 in each macro step.
    pub micro: u8,
    /// The region instance that took it.
    pub region_instance: u16,
    /// The transition in the tables.
    pub transition: u16,
}

/// Watches a macro step from inside. Its methods do nothing unless implemented.
pub trait Observer {
    /// A transition was taken: its actions are done, its target is current.
    #[inline(always)]
    fn transition(&mut self, taken: TransitionTaken) {
        let _ = taken;
    }

    /// A task state was entered: its task is enabled anew. For a slot-0 task the run of an earlier activation may still go on.
    #[inline(always)]
    fn enabled(&mut self, task_instance: u16) {
        let _ = task_instance;
    }

    /// A task that was enabled is so no more, because its state or one around it was left. Not called for slot-0 tasks.
    #[inline(always)]
    fn disabled(&mut self, task_instance: u16) {
        let _ = task_instance;
    }
}

/// Watches nothing.
impl Observer for () {}

/// What a macro step did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepSummary {
    /// Its number, from 0.
    pub step: u64,
    /// Its time: microseconds since the first macro step.
    pub t_us: u64,
    /// Events that were handled, the pulse included.
    pub micro_steps: u8,
    /// Whether any transition was taken.
    pub changed: bool,
    /// Whether a region of the machine has reached `final`, now or before.
    pub finished: bool,
}

/// A machine that runs.
#[derive(Debug)]
pub struct Interpreter<'m, B> {
    verified: Verified<B>,
    arena: &'m mut [u32],
    layout: ArenaLayout,
    period_us: u32,
    /// Number and time of the next macro step.
    step: u64,
    t_us: u64,
    /// Time of the last pulse that was walked.
    walked_us: u64,
    /// As long as no flag changes from outside, macro steps up to this time do nothing.
    quiet_until_us: Option<u64>,
    fault: Option<Fault>,
}

impl<'m, B: Deref<Target = [u8]>> Interpreter<'m, B> {
    /// A machine before its first macro step: all regions in `initial`, all flags reset, no task enabled.
    ///
    /// # Errors
    /// The arena has less than [`Verified::arena_words`].
    #[expect(
        clippy::result_large_err,
        reason = "gives the blob back, and there is no heap to box it on"
    )]
    pub fn new(verified: Verified<B>, arena: &'m mut [u32]) -> Result<Self, ArenaTooSmall<'m, B>> {
        let tables = verified.tables();
        let layout = ArenaLayout::of(&tables);
        let needed_words = layout.words();
        if arena.len() < needed_words {
            return Err(ArenaTooSmall {
                verified,
                arena,
                needed_words,
            });
        }
        arena.fill(0);
        let (regions, _) = arena.as_chunks_mut::<2>();
        for (place, region) in regions
            .iter_mut()
            .zip(tables.records(Section::RegionInstances))
        {
            let [current, _] = place;
            *current = RegionInstance::decode(region).initial as u32;
        }
        let period_us = tables
            .slot(tables.interpreter_slot())
            .map_or(0, |slot| slot.period_us);
        Ok(Self {
            verified,
            arena,
            layout,
            period_us,
            step: 0,
            t_us: 0,
            walked_us: 0,
            quiet_until_us: None,
            fault: None,
        })
    }

    /// The same machine with another time between its macro steps than the period of the interpreter's slot, as a simulation may
    /// ask for. To be called before the first macro step; a robot's time comes from its slots.
    #[must_use]
    pub fn with_period_us(self, period_us: u32) -> Self {
        Self { period_us, ..self }
    }

    /// Gives blob and arena back.
    pub fn into_parts(self) -> (Verified<B>, &'m mut [u32]) {
        (self.verified, self.arena)
    }

    /// The blob that it runs.
    pub fn verified(&self) -> &Verified<B> {
        &self.verified
    }

    /// The tables of the blob that it runs.
    pub fn tables(&self) -> Tables<'_> {
        self.verified.tables()
    }

    /// Lets occurrences of the interpreter's slot pass that were missed: time and number of the next macro step move on.
    pub fn skip(&mut self, missed: u32) {
        self.step += u64::from(missed);
        self.t_us += u64::from(missed) * u64::from(self.period_us);
    }

    /// Runs one macro step. Its time is its number times the period of the interpreter's slot.
    ///
    /// # Errors
    /// The fault that stopped the machine, in this macro step or before.
    pub fn macro_step(&mut self, observer: &mut impl Observer) -> Result<StepSummary, Fault> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let (step, t_us) = (self.step, self.t_us);
        self.step += 1;
        self.t_us += u64::from(self.period_us);
        let mut summary = StepSummary {
            step,
            t_us,
            micro_steps: 1,
            changed: false,
            finished: false,
        };
        if self.quiet_until_us.is_some_and(|until_us| t_us <= until_us) {
            summary.finished = self.is_finished();
            return Ok(summary);
        }
        let since_walk_us = t_us - self.walked_us;
        self.walked_us = t_us;
        let tables = self.verified.tables();
        let mut run = Run::new(tables, self.layout, self.arena, observer);
        run.now_us = t_us as u32;
        run.since_walk_us = u32::try_from(since_walk_us).unwrap_or(u32::MAX);
        match run.macro_step() {
            Ok(micro_steps) => {
                summary.micro_steps = micro_steps;
                summary.changed = run.changed;
                let shortest_left_us = run.shortest_left_us;
                self.quiet_until_us = (!summary.changed).then(|| {
                    shortest_left_us.map_or(u64::MAX, |left_us| t_us + u64::from(left_us))
                });
                summary.finished = self.is_finished();
                Ok(summary)
            }
            Err(fault) => {
                run.disable_real_time(0..tables.task_instance_count());
                self.fault = Some(fault);
                Err(fault)
            }
        }
    }

    /// The fault that stopped the machine.
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// Whether a region of the machine has reached `final`.
    pub fn is_finished(&self) -> bool {
        self.flag(format::FLAG_EXIT)
    }

    /// The current state of a region instance, as an index into the tables. It means something only while the instance
    /// [is active](Self::is_active).
    pub fn current(&self, region_instance: usize) -> usize {
        self.arena
            .get(2 * region_instance)
            .map_or(0, |word| *word as usize)
    }

    /// Whether all superstates around a container instance are current. Takes time proportional to its depth.
    pub fn is_active(&self, instance: usize) -> bool {
        let tables = self.tables();
        let mut index = instance;
        while index != 0 {
            let Some(around) = tables.instance(index).map(|instance| instance.parent) else {
                return false;
            };
            if self.current(around.0) != around.1 {
                return false;
            }
            // The instance around has a lower number: so this ends.
            index = tables
                .region_instance(around.0)
                .map_or(0, |region| region.instance);
        }
        true
    }

    /// Whether a state of a region instance is current, and all superstates around it are.
    pub fn is_current_state(&self, region_instance: usize, state: usize) -> bool {
        self.current(region_instance) == state
            && self
                .tables()
                .region_instance(region_instance)
                .is_some_and(|region| self.is_active(region.instance))
    }

    /// Whether the state of a task instance is current, and all superstates around it are.
    pub fn is_current(&self, task_instance: usize) -> bool {
        self.tables()
            .task_instance(task_instance)
            .is_some_and(|instance| self.is_current_state(instance.region, instance.state))
    }

    /// Whether a task instance is enabled.
    pub fn is_enabled(&self, task_instance: usize) -> bool {
        bit(self.enabled_words(), task_instance)
    }

    /// The enable bits of all task instances, the first in the lowest bit of the first word.
    pub fn enabled_words(&self) -> &[u32] {
        let layout = self.layout;
        let start = layout.regions + layout.flags;
        self.arena.get(start..start + layout.enabled).unwrap_or(&[])
    }

    /// A flag by its bit in the whole machine; see [`Tables::flags_of_state`]. The busy bit of a superstate does not exist: see
    /// [`Self::is_busy_inside`].
    pub fn flag(&self, flag: usize) -> bool {
        let layout = self.layout;
        self.arena
            .get(layout.regions..layout.regions + layout.flags)
            .is_some_and(|flags| bit(flags, flag))
    }

    /// Whether an active task state inside a superstate is busy: the superstate's busy flag, while it is current.
    pub fn is_busy_inside(&self, region_instance: usize, superstate: usize) -> bool {
        let tables = self.tables();
        let layout = self.layout;
        let (regions, rest) = self.arena.split_at(layout.regions.min(self.arena.len()));
        let StateKind::Super { region_offset, .. } = tables
            .state(superstate)
            .map_or(StateKind::Initial, |state| state.kind)
        else {
            return false;
        };
        let end = tables
            .region_instance(region_instance)
            .map_or(0, |region| region.next);
        let (regions, _) = regions.as_chunks::<2>();
        any_busy(&tables, regions, rest, region_instance + region_offset, end)
    }

    /// Changes a control flag of a task instance, by its place in the signature. Between macro steps only.
    pub fn set_flag(&mut self, task_instance: usize, flag: usize, value: bool) {
        self.write_task_flag(task_instance, format::TASK_CONTROL_FLAGS + flag, value);
    }

    /// A control flag of a task instance, by its place in the signature.
    pub fn task_flag(&self, task_instance: usize, flag: usize) -> bool {
        self.tables()
            .flags_of_task(task_instance)
            .is_some_and(|(first, length)| {
                let flag = format::TASK_CONTROL_FLAGS + flag;
                flag < length && self.flag(first + flag)
            })
    }

    /// The first 16 control flags of the task instance with these places, the first in the lowest bit.
    pub fn control_flags_at(&self, places: &TaskPlaces) -> u16 {
        let count = usize::from(places.flags).saturating_sub(format::TASK_CONTROL_FLAGS);
        if count == 0 {
            return 0;
        }
        let first = usize::from(places.first_flag) + format::TASK_CONTROL_FLAGS;
        let layout = self.layout;
        let words = self
            .arena
            .get(layout.regions..layout.regions + layout.flags);
        let word = |index| {
            words
                .and_then(|words| words.get(index))
                .map_or(0, |word| *word)
        };
        let shift = first % WORD_BITS;
        let low = word(first / WORD_BITS) >> shift;
        // Shifted twice, since a word cannot be shifted by all of its bits.
        let high = word(first / WORD_BITS + 1) << 1 << (WORD_BITS - 1 - shift);
        let unused = 16usize.saturating_sub(count) as u32;
        (low | high) as u16 & u16::MAX >> unused
    }

    /// [`set_flag`](Self::set_flag) of the task instance with these places.
    pub fn set_flag_at(&mut self, places: &TaskPlaces, flag: usize, value: bool) {
        self.write_flag_at(places, format::TASK_CONTROL_FLAGS + flag, value);
    }

    /// [`set_busy`](Self::set_busy) of the task instance with these places.
    pub fn set_busy_at(&mut self, places: &TaskPlaces, busy: bool) {
        self.write_flag_at(places, format::FLAG_BUSY, busy);
    }

    /// The exit flag of a task instance.
    pub fn has_exited(&self, task_instance: usize) -> bool {
        self.tables()
            .flags_of_task(task_instance)
            .is_some_and(|(first, _)| self.flag(first + format::FLAG_EXIT))
    }

    /// The busy flag of a task instance.
    pub fn is_busy(&self, task_instance: usize) -> bool {
        self.tables()
            .flags_of_task(task_instance)
            .is_some_and(|(first, _)| self.flag(first + format::FLAG_BUSY))
    }

    /// Changes the busy flag of a task instance. Between macro steps only.
    pub fn set_busy(&mut self, task_instance: usize, busy: bool) {
        self.write_task_flag(task_instance, format::FLAG_BUSY, busy);
    }

    /// A task reports that it is finished: its exit flag is set, its enable bit reset. Between macro steps only.
    pub fn report_exit(&mut self, task_instance: usize) {
        self.write_task_flag(task_instance, format::FLAG_EXIT, true);
        self.clear_enabled(task_instance);
    }

    /// Resets an enable bit alone: the run of a slot-0 task ended after its state was left. Between macro steps only.
    pub fn clear_enabled(&mut self, task_instance: usize) {
        let layout = self.layout;
        let start = layout.regions + layout.flags;
        if let Some(words) = self.arena.get_mut(start..start + layout.enabled) {
            set_bit(words, task_instance, false);
        }
    }

    /// Writes a bit of a task instance's flag block, if the block has it.
    fn write_task_flag(&mut self, task_instance: usize, flag: usize, value: bool) {
        let Some((first, length)) = self.tables().flags_of_task(task_instance) else {
            return;
        };
        self.write_flag(first, length, flag, value);
    }

    fn write_flag_at(&mut self, places: &TaskPlaces, flag: usize, value: bool) {
        self.write_flag(
            usize::from(places.first_flag),
            usize::from(places.flags),
            flag,
            value,
        );
    }

    /// Writes a bit of the flag block that begins at `first` and has `length` bits, if it is one of them.
    fn write_flag(&mut self, first: usize, length: usize, flag: usize, value: bool) {
        let layout = self.layout;
        if flag >= length {
            return;
        }
        if let Some(flags) = self
            .arena
            .get_mut(layout.regions..layout.regions + layout.flags)
            && bit(flags, first + flag) != value
        {
            set_bit(flags, first + flag, value);
            self.quiet_until_us = None;
        }
    }
}

const WORD_BITS: usize = u32::BITS as usize;

#[inline]
fn bit(words: &[u32], index: usize) -> bool {
    words
        .get(index / WORD_BITS)
        .is_some_and(|word| word >> (index % WORD_BITS) & 1 != 0)
}

#[inline(never)]
fn set_bit(words: &mut [u32], index: usize, value: bool) {
    if let Some(word) = words.get_mut(index / WORD_BITS) {
        let mask = 1 << (index % WORD_BITS);
        *word = if value { *word | mask } else { *word & !mask };
    }
}

/// Clears `count` bits from `first` on.
#[inline]
fn clear_bits(words: &mut [u32], first: usize, count: usize) {
    let mut first = first;
    let mut count = count;
    while count > 0 {
        let shift = first % WORD_BITS;
        let here = count.min(WORD_BITS - shift);
        if let Some(word) = words.get_mut(first / WORD_BITS) {
            *word &= !((u32::MAX >> (WORD_BITS - here)) << shift);
        }
        first += here;
        count -= here;
    }
}

/// Whether the busy flag of a current task state is set in the region instances from `first` up to `end`, which are all that
/// is inside a current superstate.
#[inline(never)]
fn any_busy(
    tables: &Tables<'_>,
    regions: &[[u32; 2]],
    flags: &[u32],
    first: usize,
    end: usize,
) -> bool {
    let mut at = first;
    while at < end {
        let (Some(region), Some([current, _])) = (tables.region_instance(at), regions.get(at))
        else {
            return false;
        };
        let Some(state) = tables.state(*current as usize) else {
            return false;
        };
        at = match state.kind {
            StateKind::Super { region_offset, .. } => at + region_offset,
            StateKind::Task { .. }
                if bit(
                    flags,
                    region.first_flag + state.first_flag + format::FLAG_BUSY,
                ) =>
            {
                return true;
            }
            _ => region.next,
        };
    }
    false
}

/// One macro step: tables and arena taken apart once, for all of it.
struct Run<'a, O> {
    tables: HotTables<'a>,
    /// For what is rare.
    all_tables: Tables<'a>,
    /// Current state and time of its entry, by region instance.
    regions: &'a mut [[u32; 2]],
    flags: &'a mut [u32],
    enabled: &'a mut [u32],
    /// A ring of channels, two a word.
    queue: &'a mut [u32],
    queue_capacity: usize,
    queue_first: usize,
    queued: usize,
    now_us: u32,
    since_walk_us: u32,
    /// The least time that a running timer has left.
    shortest_left_us: Option<u32>,
    micro: u8,
    changed: bool,
    observer: &'a mut O,
}

/// The tables that a macro step reads, cut out once for all of it.
#[derive(Clone, Copy)]
struct HotTables<'a> {
    region_instances: &'a [[u8; 8]],
    states: &'a [[u8; 16]],
    transitions: &'a [[u8; 6]],
    code: &'a [[u8; 4]],
    instances: &'a [[u8; 16]],
    channels: &'a [[u8; 10]],
    visibility: &'a [u8],
}

impl<'a> HotTables<'a> {
    fn of(tables: &Tables<'a>) -> Self {
        Self {
            region_instances: tables.records(Section::RegionInstances),
            states: tables.records(Section::States),
            transitions: tables.records(Section::Transitions),
            code: tables.records(Section::Code),
            instances: tables.records(Section::Instances),
            channels: tables.records(Section::Channels),
            visibility: tables.section(Section::Visibility),
        }
    }
}

/// The region instance that a transition is taken in.
#[derive(Clone, Copy)]
struct Here {
    index: usize,
    region: RegionInstance,
}

impl<'a, O: Observer> Run<'a, O> {
    #[inline]
    fn new(
        tables: Tables<'a>,
        layout: ArenaLayout,
        arena: &'a mut [u32],
        observer: &'a mut O,
    ) -> Self {
        let (regions, rest) = split(arena, layout.regions);
        let (flags, rest) = split(rest, layout.flags);
        let (enabled, rest) = split(rest, layout.enabled);
        let (queue, _) = split(rest, layout.queue);
        Self {
            tables: HotTables::of(&tables),
            all_tables: tables,
            queue_capacity: layout.queue_capacity,
            regions: regions.as_chunks_mut::<2>().0,
            flags,
            enabled,
            queue,
            queue_first: 0,
            queued: 0,
            now_us: 0,
            since_walk_us: 0,
            shortest_left_us: None,
            micro: 0,
            changed: false,
            observer,
        }
    }

    /// Handles the pulse and all events that follow from it; returns their number.
    fn macro_step(&mut self) -> Result<u8, Fault> {
        self.micro_step(None)?;
        while let Some(channel) = self.take_event() {
            if self.micro == MAX_MICRO_STEPS - 1 {
                return Err(Fault::MacroStepLimit);
            }
            self.micro += 1;
            self.micro_step(Some(channel))?;
        }
        Ok(self.micro + 1)
    }

    /// Shows one event, or the pulse, to all that is active: outer before inner, regions in their order.
    fn micro_step(&mut self, event: Option<Channel>) -> Result<(), Fault> {
        let mut index = 0;
        while let Some(region) = self.tables.region_instances.get(index) {
            let here = Here {
                index,
                region: RegionInstance::decode(region),
            };
            index = match self.visit(here, &event)? {
                Some(inside) => inside,
                None => here.region.next,
            };
        }
        Ok(())
    }

    /// Shows an event to one region instance. Returns the first region instance inside its state, if that is to be visited too.
    #[inline(always)]
    fn visit(&mut self, here: Here, event: &Option<Channel>) -> Result<Option<usize>, Fault> {
        let Some([current, entered_us]) = self.regions.get(here.index).copied() else {
            return Ok(None);
        };
        let current = current as usize;
        let states = self.tables.states;
        // The last state of a region is `final`, which no transition leaves: so what can be left has another behind it.
        let Some([state, after]) = states.get(current..).and_then(<[_]>::first_chunk::<2>) else {
            return Ok(None);
        };
        let state = RawState::decode(state);
        let [end_low, end_high, ..] = *after;
        let (transitions, number) = match event {
            None => {
                if state.shape & format::STATE_HAS_TIMEOUT != 0 {
                    self.run_timer(&state, here, entered_us);
                }
                (
                    state.first_transition..state.first_event_transition,
                    format::PULSE,
                )
            }
            Some(channel) => {
                let end = usize::from(u16::from_le_bytes([end_low, end_high]));
                if channel.is_visible(self.tables.visibility, here.region.instance) {
                    (state.first_event_transition..end, channel.event)
                } else {
                    (0..0, channel.event)
                }
            }
        };
        for index in transitions {
            let Some(record) = self.tables.transitions.get(index) else {
                break;
            };
            let &[e0, e1, t0, t1, c0, c1] = record;
            let trigger = u16::from_le_bytes([e0, e1]);
            if trigger & !format::TRANSITION_HAS_CODE != number {
                continue;
            }
            let actions = if trigger & format::TRANSITION_HAS_CODE == 0 {
                None
            } else {
                let code = usize::from(u16::from_le_bytes([c0, c1]));
                match self.guard(code, &state, here) {
                    None => continue,
                    actions => actions,
                }
            };
            let target = usize::from(u16::from_le_bytes([t0, t1]));
            self.take(here, &state, target, actions)?;
            self.observer.transition(TransitionTaken {
                micro: self.micro,
                region_instance: here.index as u16,
                transition: index as u16,
            });
            return Ok(None);
        }
        let is_super = state.kind() == format::STATE_SUPER;
        Ok(is_super.then_some(here.index + state.a))
    }

    /// Sets the timeout flag if the state has been current for longer than its limit.
    ///
    /// Its age is kept in 32 bits. The flag was not set at the last walk, so the age was at most the limit then; every state that is current at a
    /// pulse was so at the last one, so the true age is at least the time since. An age below that has wrapped.
    #[inline(never)]
    fn run_timer(&mut self, state: &RawState, here: Here, entered_us: u32) {
        let timeout_bit = if state.kind() == format::STATE_SIMPLE {
            0
        } else {
            format::FLAG_TIMEOUT
        };
        let flag = here.region.first_flag + state.first_flag + timeout_bit;
        if bit(self.flags, flag) {
            return;
        }
        let age_us = self.now_us.wrapping_sub(entered_us);
        let left_us = if age_us > state.timeout_us || age_us < self.since_walk_us {
            set_bit(self.flags, flag, true);
            // A guard of a region before this one may look at it, so the next macro step must be walked.
            0
        } else {
            state.timeout_us - age_us
        };
        let shortest = self.shortest_left_us.unwrap_or(left_us);
        self.shortest_left_us = Some(shortest.min(left_us));
    }

    /// Evaluates a guard. Returns where its actions begin if it is true.
    #[inline]
    fn guard(&self, code: usize, state: &RawState, here: Here) -> Option<usize> {
        let mut at = code;
        loop {
            let &[o0, o1, c0, c1] = self.tables.code.get(at)?;
            let control = u16::from_le_bytes([c0, c1]);
            let operand = usize::from(u16::from_le_bytes([o0, o1]));
            let jumps = match control >> format::CODE_OPERATION_SHIFT {
                format::CODE_JUMP_IF_CLEAR => !bit(self.flags, here.region.first_flag + operand),
                format::CODE_JUMP_IF_SET => bit(self.flags, here.region.first_flag + operand),
                operation @ (format::CODE_JUMP_IF_IDLE_INSIDE
                | format::CODE_JUMP_IF_BUSY_INSIDE) => {
                    let first = here.index + state.a;
                    let end = here.region.next;
                    any_busy(&self.all_tables, self.regions, self.flags, first, end)
                        == (operation == format::CODE_JUMP_IF_BUSY_INSIDE)
                }
                _ => return Some(at),
            };
            at += match (jumps, usize::from(control & format::CODE_LOW_MASK)) {
                (false, _) => 1,
                (true, 0) => return None,
                (true, jump) => jump,
            };
        }
    }

    /// Leaves a state, acts, enters another.
    #[inline(never)]
    fn take(
        &mut self,
        here: Here,
        left: &RawState,
        target: usize,
        actions: Option<usize>,
    ) -> Result<(), Fault> {
        let Here { index, region } = here;
        let instance = self.instance(region.instance);
        match left.kind() {
            format::STATE_TASK => {
                let task = instance.first_task + left.a;
                if bit(self.enabled, task) {
                    set_bit(self.enabled, task, false);
                    self.observer.disabled(task as u16);
                }
            }
            format::STATE_SUPER => {
                let inside = self.instance(region.instance + left.b);
                self.disable_real_time(inside.first_task..inside.end_task);
            }
            _ => {}
        }
        let Some(entered) = self.tables.states.get(target).map(RawState::decode) else {
            return Ok(());
        };
        let flags = usize::from(entered.shape & format::STATE_FLAGS_MASK);
        clear_bits(self.flags, region.first_flag + entered.first_flag, flags);
        if let Some(actions) = actions {
            self.act(actions, region.first_flag, instance.first_channel)?;
        }
        self.changed = true;
        if let Some(place) = self.regions.get_mut(index) {
            *place = [target as u32, self.now_us];
        }
        match entered.kind() {
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let task = instance.first_task + entered.a;
                set_bit(self.enabled, task, true);
                self.observer.enabled(task as u16);
            }
            format::STATE_FINAL => {
                set_bit(self.flags, region.first_flag + format::FLAG_EXIT, true);
            }
            format::STATE_SUPER => self.start_regions(index + entered.a, region.next),
            _ => {}
        }
        Ok(())
    }

    /// Carries out actions from `at` to the last.
    fn act(&mut self, at: usize, first_flag: usize, first_channel: usize) -> Result<(), Fault> {
        let mut at = at;
        while let Some(&[o0, o1, c0, c1]) = self.tables.code.get(at) {
            let control = u16::from_le_bytes([c0, c1]);
            let operand = usize::from(u16::from_le_bytes([o0, o1]));
            match control >> format::CODE_OPERATION_SHIFT {
                format::CODE_SEND => self.send(first_channel + operand)?,
                format::CODE_CLEAR => set_bit(self.flags, first_flag + operand, false),
                format::CODE_SET => set_bit(self.flags, first_flag + operand, true),
                _ => break,
            }
            if control & format::CODE_LOW_MASK != 0 {
                break;
            }
            at += 1;
        }
        Ok(())
    }

    /// Puts the regions of the container instance whose first one is `first`, all before `end`, into their initial states.
    fn start_regions(&mut self, first: usize, end: usize) {
        let mut at = first;
        while at < end {
            let Some(region) = self.tables.region_instances.get(at) else {
                return;
            };
            let region = RegionInstance::decode(region);
            if let Some(place) = self.regions.get_mut(at) {
                *place = [region.initial as u32, self.now_us];
            }
            at = region.next;
        }
    }

    /// Disables the enabled real-time tasks among some task instances.
    #[inline(never)]
    fn disable_real_time(&mut self, tasks: core::ops::Range<usize>) {
        for task in tasks {
            if bit(self.enabled, task) && self.is_real_time(task) {
                set_bit(self.enabled, task, false);
                self.observer.disabled(task as u16);
            }
        }
    }

    fn is_real_time(&self, task_instance: usize) -> bool {
        let state = self
            .all_tables
            .task_instance(task_instance)
            .and_then(|instance| self.tables.states.get(instance.state));
        state.is_some_and(|state| RawState::decode(state).kind() == format::STATE_TASK)
    }

    #[inline]
    fn instance(&self, index: usize) -> Instance {
        const NOWHERE: [u8; 16] = [0; 16];
        Instance::decode(self.tables.instances.get(index).unwrap_or(&NOWHERE))
    }

    /// Appends an event to the queue.
    #[inline]
    fn send(&mut self, channel: usize) -> Result<(), Fault> {
        let capacity = self.queue_capacity;
        if self.queued == capacity {
            return Err(Fault::EventQueueOverflow);
        }
        let mut at = self.queue_first + self.queued;
        if at >= capacity {
            at -= capacity;
        }
        self.queued += 1;
        if let Some(word) = self.queue.get_mut(at / 2) {
            let shift = at % 2 * 16;
            *word = *word & !(0xFFFF << shift) | (channel as u32) << shift;
        }
        Ok(())
    }

    /// Takes the first event from the queue.
    #[inline]
    fn take_event(&mut self) -> Option<Channel> {
        self.queued = self.queued.checked_sub(1)?;
        let at = self.queue_first;
        self.queue_first += 1;
        if self.queue_first == self.queue_capacity {
            self.queue_first = 0;
        }
        let channel = self.queue.get(at / 2)? >> (at % 2 * 16) & 0xFFFF;
        self.tables
            .channels
            .get(channel as usize)
            .map(Channel::decode)
    }
}

/// Cuts `count` words off, or all that there are.
fn split(words: &mut [u32], count: usize) -> (&mut [u32], &mut [u32]) {
    let count = count.min(words.len());
    words.split_at_mut(count)
}

/// A state's record as the interpreter reads it: numbers alone, no decisions.
struct RawState {
    first_transition: usize,
    first_event_transition: usize,
    first_flag: usize,
    shape: u16,
    a: usize,
    b: usize,
    timeout_us: u32,
}

impl RawState {
    #[inline(always)]
    fn decode(record: &[u8; 16]) -> Self {
        let &[
            t0,
            t1,
            e0,
            e1,
            f0,
            f1,
            k0,
            k1,
            a0,
            a1,
            b0,
            b1,
            l0,
            l1,
            l2,
            l3,
        ] = record;
        let word = |low, high| usize::from(u16::from_le_bytes([low, high]));
        Self {
            first_transition: word(t0, t1),
            first_event_transition: word(e0, e1),
            first_flag: word(f0, f1),
            shape: u16::from_le_bytes([k0, k1]),
            a: word(a0, a1),
            b: word(b0, b1),
            timeout_us: u32::from_le_bytes([l0, l1, l2, l3]),
        }
    }

    #[inline(always)]
    fn kind(&self) -> u16 {
        self.shape >> format::STATE_KIND_SHIFT
    }
}
