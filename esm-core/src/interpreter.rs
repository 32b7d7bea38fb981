//! The interpreter: what a machine does, once, for firmware and host.
//!
//! It keeps its state in an arena of 32-bit words that the caller lends it. Everything else is read from the blob.
//!
//! **Who is visited.** Two bits are kept for each region instance, 32 in a word, the first in the highest bit. *Active* says that all superstates around it are current;
//! *awake* that the pulse may do something there. A pulse visits those that are both, an event those of its channel's row that are active, and each in ascending order, which is the
//! order of the tree. So what has nothing to do costs nothing. A guard is a function of flags of its own state and of the head of its instance's block, and a region is
//! woken when one of these changes: by a transition of its own, by its superstate's start, from outside, by an action or a `final` around it, by its timer. A guard that asks for busy tasks inside
//! wakes its region each time.
//!
//! **Timers.** The time of a macro step is its number times the period, so timers count macro steps. How many pass before some timer may have run out is kept; it may be too few, never too
//! many. The macro step behind them wakes whoever is due and finds the next.
//!
//! **Places.** The tables are read at bytes of the blob, by [reads](crate::reads) that need not check them again. That every loop ends is what [`verify`](crate::verify()) proved.

mod carry;
mod progress;

use core::ops::{Deref, Range};

pub use carry::{TakenOver, TaskPairs};
pub use progress::{MAX_STEPS, Progress, ResumeError};

use crate::format::{self, Section};
use crate::layout::{
    Field, channel, code, container, instance, mask, region_instance, state, task_instance,
    transition,
};
use crate::reads::access::Access;
use crate::reads::{Checked, DefaultReads, Reads, WINDOW_BITS};
use crate::tables::{Tables, TaskPlaces, record_bytes};
use crate::verify::Verified;

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

/// How the arena is divided: the word at which each part begins. The parts stand in this order.
///
/// The current states come first, two a word, the one of the lower region instance in the low half.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArenaLayout {
    /// For each 32 region instances a word that says who is active, and one that says who is awake.
    active: usize,
    /// All flags, the first in the lowest bit.
    flags: usize,
    /// The enable bits of the task instances, the first in the lowest bit.
    enabled: usize,
    /// For each region instance the low 32 bits of the number of the macro step in which its state was entered, if that has a timeout.
    entered: usize,
    /// The channels of events that wait, two a word.
    queue: usize,
    end: usize,
    /// Numbers of region instances and of task instances.
    regions: usize,
    tasks: usize,
}

impl ArenaLayout {
    pub(crate) fn of(tables: &Tables<'_>) -> Self {
        let regions = tables.region_instance_count();
        let tasks = tables.task_instance_count();
        let active = regions.div_ceil(2);
        let flags = active + 2 * regions.div_ceil(WORD_BITS);
        let enabled = flags + tables.flag_count().div_ceil(WORD_BITS);
        let entered = enabled + tasks.div_ceil(WORD_BITS);
        let queue = entered + regions;
        let end = queue + queue_places(tables).div_ceil(2);
        Self {
            active,
            flags,
            enabled,
            entered,
            queue,
            end,
            regions,
            tasks,
        }
    }

    pub(crate) fn words(&self) -> usize {
        self.end
    }
}

/// Where the tables begin that are read most.
#[derive(Clone, Copy, Debug)]
struct Starts<P> {
    states: P,
    transitions: P,
    instances: P,
    region_instances: P,
    channels: P,
    listeners: P,
    task_instances: P,
}

impl<P> Starts<P> {
    fn of<R: Access<Place = P>>(tables: &Tables<'_>) -> Self {
        let start = |section| R::place(tables.bytes(), tables.start(section));
        Self {
            states: start(Section::States),
            transitions: start(Section::Transitions),
            instances: start(Section::Instances),
            region_instances: start(Section::RegionInstances),
            channels: start(Section::Channels),
            listeners: start(Section::Listeners),
            task_instances: start(Section::TaskInstances),
        }
    }
}

/// Where the parts of the arena begin that are used most.
#[derive(Clone, Copy, Debug)]
struct Parts<P> {
    current: P,
    active: P,
    flags: P,
    enabled: P,
    entered: P,
    queue: P,
}

impl<P> Parts<P> {
    fn of<R: Access<Part = P>>(arena: &mut [u32], layout: &ArenaLayout) -> Self {
        let mut part = |word| R::part(arena, word);
        Self {
            current: part(0),
            active: part(layout.active),
            flags: part(layout.flags),
            enabled: part(layout.enabled),
            entered: part(layout.entered),
            queue: part(layout.queue),
        }
    }
}

/// Places of the event queue: a power of two, so that going round is cheap.
fn queue_places(tables: &Tables<'_>) -> usize {
    tables.queue_capacity().next_power_of_two()
}

/// A machine that runs. `R` says how it reads its tables: see [`Reads`].
// What is used most stands first if it is compiled for size: there loads are shorter.
#[derive(Debug)]
#[cfg_attr(small, repr(C))]
pub struct Interpreter<'m, B, R: Access = DefaultReads> {
    parts: Parts<R::Part>,
    starts: Starts<R::Place>,
    period_us: u32,
    /// Macro steps until a timer may have run out, that one included. A machine that was stopped has none left but the next.
    steps_left: u32,
    /// Macro steps that will have begun then, or been skipped.
    due: u64,
    /// Events that were put into the queue in this macro step, and taken out: the second is the number of the micro step. The queue is a ring, as long as a power of
    /// two: the low bits say the place.
    queued: u32,
    taken: u32,
    queue_mask: u32,
    queue_capacity: u32,
    arena: &'m mut [u32],
    layout: ArenaLayout,
    verified: Verified<B>,
    /// What the next macro step does, and what it does once some region is awake.
    next_step: Step,
    visit: Step,
    fault: Option<Fault>,
}

/// Whether it is compiled for size: one way for all, where there are shorter ones for what is frequent. See the build script.
const SMALL: bool = cfg!(small);

/// What a macro step does if no timer runs out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// All sleep.
    Rest,
    /// It visits the region instances, which are in one word.
    Near,
    /// It visits the region instances, word by word.
    Far,
}

const WORD_BITS: usize = u32::BITS as usize;
const TRANSITION_BYTES: usize = record_bytes(Section::Transitions);
/// The first region instance of a word.
const FIRST: u32 = 1 << (u32::BITS - 1);

/// The region instances of its word that are not before a region instance.
#[inline(always)]
fn from_place(region: usize) -> u32 {
    u32::MAX >> (region % WORD_BITS)
}

/// The region instances of a word of 32 that are not before `region`.
#[inline]
fn not_before(region: usize, word: usize) -> u32 {
    match region.saturating_sub(WORD_BITS * word) {
        offset @ 0..WORD_BITS => u32::MAX >> offset,
        _ => 0,
    }
}

/// The words that some region instances have bits in, each with their bits there.
#[inline]
fn words_of(regions: Range<usize>) -> impl Iterator<Item = (usize, u32)> {
    let words = regions.start / WORD_BITS..regions.end.div_ceil(WORD_BITS);
    words.map(move |word| {
        let those = not_before(regions.start, word) & !not_before(regions.end, word);
        (word, those)
    })
}

/// Where the visit of a micro step goes on after a transition of one region instance.
///
/// Most change only what the region instance itself is in, and the visit goes on as it was: that is 0. Where who is active or awake changed, it is the next region instance that
/// is not inside that one, and so above 0. [`NOT_TAKEN`] if the queue had no room for an event.
type Resume = usize;
const ON: Resume = 0;
const NOT_TAKEN: Resume = usize::MAX;

/// A region instance that is visited.
#[derive(Clone, Copy)]
struct Here<P> {
    region: usize,
    /// The record of its current state.
    current: P,
}

/// What guards see: in the low half the first own flags of a state, in the high half their complement. Cores that test the highest bit of a shifted word at no cost have it the other way
/// round.
#[derive(Clone, Copy)]
struct Window<const REVERSED: bool = { cfg!(target_arch = "arm") }>(u32);

impl<const REVERSED: bool> Window<REVERSED> {
    #[inline(always)]
    fn of(flags: u32) -> Self {
        let flags = flags & ((1 << format::WINDOW_FLAGS) - 1);
        let bits = flags | !flags << format::GUARD_IF_CLEAR;
        Self(if REVERSED { bits.reverse_bits() } else { bits })
    }

    /// The first that is true of guards that ask for one bit each, `count` of them, from this one on.
    #[inline(always)]
    fn first_of<R: Access>(self, guard: usize, count: usize) -> Option<usize> {
        let (guard, count) = (R::below_32(guard), R::below_32(count));
        let first = if REVERSED {
            let bits = (self.0 << guard) & !(u32::MAX >> count);
            (bits != 0).then(|| bits.leading_zeros())
        } else {
            let bits = (self.0 >> guard) & ((1 << count) - 1);
            (bits != 0).then(|| bits.trailing_zeros())
        };
        first.map(|first| first as usize)
    }

    /// Whether a guard that asks for one bit is true.
    #[inline(always)]
    fn holds(self, guard: usize) -> bool {
        let guard = guard as u32 % u32::BITS;
        if REVERSED {
            (self.0 << guard) >> (u32::BITS - 1) != 0
        } else {
            self.0 >> guard & 1 != 0
        }
    }
}

/// Whether a guard that asks for one bit is true, if the first own flags of a state are these.
fn is_bit_right(flags: u32, guard: usize) -> bool {
    let window = flags & ((1 << format::WINDOW_FLAGS) - 1);
    let if_clear = usize::from(format::GUARD_IF_CLEAR);
    (window >> (guard % if_clear) & 1 != 0) == (guard < if_clear)
}

impl<'m, B> Interpreter<'m, B>
where
    B: Deref<Target = [u8]>,
    DefaultReads: Reads<B>,
{
    /// A machine before its first macro step: all regions in `initial`, all flags reset, no task enabled.
    ///
    /// # Errors
    /// The arena has less than [`Verified::arena_words`].
    #[expect(
        clippy::result_large_err,
        reason = "gives the blob back, and there is no heap to box it on"
    )]
    pub fn new(verified: Verified<B>, arena: &'m mut [u32]) -> Result<Self, ArenaTooSmall<'m, B>> {
        Self::with_reads(verified, arena)
    }
}

impl<'m, B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'m, B, R> {
    /// The same as [`Interpreter::new`], for other reads than those of most machines: `Interpreter::<_, Checked>::with_reads(…)`.
    ///
    /// # Errors
    /// The arena has less than [`Verified::arena_words`].
    #[expect(
        clippy::result_large_err,
        reason = "gives the blob back, and there is no heap to box it on"
    )]
    #[cfg_attr(small, inline(never))]
    pub fn with_reads(
        verified: Verified<B>,
        arena: &'m mut [u32],
    ) -> Result<Self, ArenaTooSmall<'m, B>> {
        let tables = verified.tables();
        let layout = ArenaLayout::of(&tables);
        let queue_capacity = tables.queue_capacity() as u32;
        // Where there is one place only, the word has a second one.
        let queue_mask = (2 * (layout.end - layout.queue) - 1) as u32;
        let period_us = tables
            .slot(tables.interpreter_slot())
            .map_or(0, |slot| slot.period_us);
        let needed_words = layout.words();
        let Some(used) = arena.get_mut(..needed_words) else {
            return Err(ArenaTooSmall {
                verified,
                arena,
                needed_words,
            });
        };
        used.fill(0);
        let parts = Parts::of::<R>(used, &layout);
        let starts = Starts::of::<R>(&tables);
        let mut machine = Self {
            verified,
            arena,
            layout,
            starts,
            parts,
            period_us,
            steps_left: u32::MAX,
            due: u32::MAX.into(),
            queued: 0,
            taken: 0,
            queue_mask,
            queue_capacity,
            next_step: Step::Rest,
            visit: if !SMALL && layout.regions <= WORD_BITS {
                Step::Near
            } else {
                Step::Far
            },
            fault: None,
        };
        for region in 0..layout.regions {
            let record = machine.record(Section::RegionInstances, region);
            let initial = machine.field(record, region_instance::INITIAL);
            machine.set_current(region, initial);
        }
        machine.start_regions(0, layout.regions);
        Ok(machine)
    }

    /// The same machine with another time between its macro steps than the period of the interpreter's slot, as a simulation may
    /// ask for. To be called before the first macro step; a robot's time comes from its slots.
    #[must_use]
    pub fn with_period_us(self, period_us: u32) -> Self {
        Self { period_us, ..self }
    }

    /// Lets occurrences of the interpreter's slot pass that were missed: time and number of the next macro step move on.
    pub fn skip(&mut self, missed: u32) {
        if missed < self.steps_left {
            self.steps_left -= missed;
        } else {
            self.age_timers(missed);
            self.due = self.begun() + u64::from(missed) + 1;
            self.steps_left = 1;
        }
    }

    /// Runs one macro step. Its time is its number times the period of the interpreter's slot.
    ///
    /// # Errors
    /// The fault that stopped the machine, in this macro step or before.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    pub fn macro_step(&mut self, observer: &mut impl Observer) -> Result<StepSummary, Fault> {
        self.steps_left -= 1;
        let step = self.begun() - 1;
        if self.steps_left == 0 {
            self.run_timers()?;
        }
        let mut summary = StepSummary {
            step,
            t_us: step * u64::from(self.period_us),
            micro_steps: 1,
            changed: false,
            finished: false,
        };
        if SMALL {
            summary.changed = self.walk_any(observer)?;
            summary.micro_steps = self.taken as u8 + 1;
        } else if self.next_step == Step::Near {
            summary.changed = self.walk::<_, true>(observer)?;
            summary.micro_steps = self.taken as u8 + 1;
        } else if self.next_step != Step::Rest {
            summary.changed = self.walk_far(observer)?;
            summary.micro_steps = self.taken as u8 + 1;
        }
        summary.finished = if SMALL {
            self.flag_at(format::FLAG_EXIT)
        } else {
            self.is_finished()
        };
        Ok(summary)
    }

    /// Whether an active task state inside a superstate is busy: the superstate's busy flag, which is false unless it is current.
    pub fn is_busy_inside(&self, region_instance: usize, superstate: usize) -> bool {
        self.is_current_state(region_instance, superstate) && self.is_busy_within(region_instance)
    }

    /// Changes a control flag of a task instance, by its place in the signature. Between macro steps only.
    pub fn set_flag(&mut self, task_instance: usize, flag: usize, value: bool) {
        self.write_task_flag(task_instance, format::TASK_CONTROL_FLAGS + flag, value);
    }

    /// [`set_flag`](Self::set_flag) of the task instance with these places.
    pub fn set_flag_at(&mut self, places: &TaskPlaces, flag: usize, value: bool) {
        self.write_flag_at(places, format::TASK_CONTROL_FLAGS + flag, value);
    }

    /// [`set_busy`](Self::set_busy) of the task instance with these places.
    pub fn set_busy_at(&mut self, places: &TaskPlaces, busy: bool) {
        self.write_flag_at(places, format::FLAG_BUSY, busy);
    }

    /// Changes the busy flag of a task instance. Between macro steps only.
    pub fn set_busy(&mut self, task_instance: usize, busy: bool) {
        self.write_system_flag(task_instance, format::FLAG_BUSY, busy);
    }

    /// A task reports that it is finished: its exit flag is set, its enable bit reset. Between macro steps only.
    pub fn report_exit(&mut self, task_instance: usize) {
        self.write_system_flag(task_instance, format::FLAG_EXIT, true);
        self.clear_enabled(task_instance);
    }

    /// Resets an enable bit alone: the run of a slot-0 task ended after its state was left. Between macro steps only.
    pub fn clear_enabled(&mut self, task_instance: usize) {
        if task_instance < self.layout.tasks {
            self.disable(task_instance);
        }
    }

    /// The same as [`Self::write_task_flag`], where less room is worth more than speed.
    #[cfg_attr(not(small), inline(never))]
    fn write_system_flag(&mut self, task: usize, flag: usize, value: bool) {
        self.write_task_flag(task, flag, value);
    }

    /// Writes a bit of a task instance's flag block, if the block has it.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn write_task_flag(&mut self, task: usize, flag: usize, value: bool) {
        if task >= self.layout.tasks {
            return;
        }
        let record = self.record(Section::TaskInstances, task);
        let left = self.record(Section::States, self.field(record, task_instance::STATE));
        if flag < self.field(left, state::SHAPE) & usize::from(format::STATE_FLAGS_MASK) {
            let first = self.field(record, task_instance::FIRST_FLAG);
            let region = self.field(record, task_instance::REGION);
            self.write_flag(first + flag, region, value);
        }
    }

    /// Writes a bit of the flag block with these places, which need not come from this machine's tables.
    fn write_flag_at(&mut self, places: &TaskPlaces, flag: usize, value: bool) {
        let (bit, region) = (
            usize::from(places.first_flag) + flag,
            usize::from(places.region),
        );
        let flags = WORD_BITS * (self.layout.enabled - self.layout.flags);
        if flag < usize::from(places.flags) && bit < flags && region < self.layout.regions {
            self.write_flag(bit, region, value);
        }
    }

    /// Writes a flag, and wakes the region that it belongs to if it changes.
    #[inline]
    fn write_flag(&mut self, flag: usize, region: usize, value: bool) {
        if SMALL {
            if self.write_bit(self.parts.flags, flag, value) != value {
                self.wake(region);
            }
            return;
        }
        let (flags, place) = (self.parts.flags, flag / WORD_BITS);
        let bit = 1 << (flag % WORD_BITS);
        let word = self.load(flags, place);
        let written = if value { word | bit } else { word & !bit };
        if written != word {
            self.store(flags, place, written);
            self.wake(region);
        }
    }
}

/// What it shows of itself, and gives back.
impl<'m, B: Deref<Target = [u8]>, R: Access> Interpreter<'m, B, R> {
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
        if region_instance < self.layout.regions {
            Checked::load_half(self.arena, 0, region_instance).into()
        } else {
            0
        }
    }

    /// Whether all superstates around a container instance are current. Takes constant time.
    pub fn is_active(&self, instance: usize) -> bool {
        self.tables()
            .instance(instance)
            .is_some_and(|instance| self.is_region_active(instance.first_region))
    }

    /// Whether all superstates around a region instance are current. Takes constant time.
    pub fn is_region_active(&self, region_instance: usize) -> bool {
        let word = 2 * (region_instance / WORD_BITS);
        let active = Checked::load(self.arena, self.layout.active, word);
        region_instance < self.layout.regions && active & bit_of(region_instance) != 0
    }

    /// Whether the next pulse visits a region instance, if it is active then: for those who count what a macro step does.
    pub fn is_region_awake(&self, region_instance: usize) -> bool {
        let word = 2 * (region_instance / WORD_BITS) + 1;
        let awake = Checked::load(self.arena, self.layout.active, word);
        region_instance < self.layout.regions && awake & bit_of(region_instance) != 0
    }

    /// Whether the next macro step looks at all timers: for those who count what a macro step does.
    pub fn looks_at_timers(&self) -> bool {
        self.steps_left == 1 && self.fault.is_none()
    }

    /// Whether a state of a region instance is current, and all superstates around it are.
    pub fn is_current_state(&self, region_instance: usize, state: usize) -> bool {
        self.current(region_instance) == state && self.is_region_active(region_instance)
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
        self.part(self.layout.enabled..self.layout.entered)
    }

    fn flag_words(&self) -> &[u32] {
        self.part(self.layout.flags..self.layout.enabled)
    }

    fn part(&self, words: Range<usize>) -> &[u32] {
        self.arena.get(words).unwrap_or(&[])
    }

    /// A flag by its bit in the whole machine; see [`Tables::flags_of_state`]. The busy bit of a superstate does not exist: see
    /// [`Self::is_busy_inside`].
    pub fn flag(&self, flag: usize) -> bool {
        bit(self.flag_words(), flag)
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
        // Places need not come from this machine's tables.
        let flags = Checked::window(self.flag_words(), 0, first);
        let unused = 16usize.saturating_sub(count) as u32;
        flags as u16 & u16::MAX >> unused
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
}

/// Reads and writes.
impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Where a record begins.
    #[inline(always)]
    fn record(&self, section: Section, index: usize) -> R::Place {
        let start = match section {
            Section::States => self.starts.states,
            Section::Transitions => self.starts.transitions,
            Section::Instances => self.starts.instances,
            Section::RegionInstances => self.starts.region_instances,
            Section::Channels => self.starts.channels,
            Section::Listeners => self.starts.listeners,
            Section::TaskInstances => self.starts.task_instances,
            _ => {
                let tables = self.verified.tables();
                R::place(tables.bytes(), tables.start(section))
            }
        };
        R::ahead(start, record_bytes(section) * index)
    }

    /// A field of a record.
    #[inline(always)]
    fn field(&self, record: R::Place, field: Field) -> usize {
        let place = R::ahead(record, field.offset());
        R::half(self.verified.tables().bytes(), place).into()
    }

    #[inline(always)]
    fn word_of(&self, record: R::Place) -> u32 {
        R::word(self.verified.tables().bytes(), record)
    }

    /// Which events a state's transitions are on. It is the first field of a state.
    #[inline(always)]
    fn events(&self, state: R::Place) -> u32 {
        self.word_of(state)
    }

    #[inline(always)]
    fn load(&self, part: R::Part, word: usize) -> u32 {
        R::load(self.arena, part, word)
    }

    #[inline(always)]
    fn store(&mut self, part: R::Part, word: usize, value: u32) {
        R::store(self.arena, part, word, value);
    }

    /// The record of a region instance's current state.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn current_record(&self, region: usize) -> R::Place {
        let current = R::load_half(self.arena, self.parts.current, region);
        self.record(Section::States, current.into())
    }

    #[inline(always)]
    fn set_current(&mut self, region: usize, state: usize) {
        R::store_half(self.arena, self.parts.current, region, state as u16);
    }

    /// Who is active of a word of region instances.
    #[inline(always)]
    fn active(&self, word: usize) -> u32 {
        self.load(self.parts.active, 2 * word)
    }

    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn is_active_at(&self, region: usize) -> bool {
        self.active(region / WORD_BITS) & bit_of(region) != 0
    }

    #[inline(always)]
    fn set_active(&mut self, word: usize, active: u32) {
        self.store(self.parts.active, 2 * word, active);
    }

    /// Who is awake of a word of region instances.
    #[inline(always)]
    fn awake(&self, word: usize) -> u32 {
        self.load(self.parts.active, 2 * word + 1)
    }

    #[inline(always)]
    fn set_awake(&mut self, word: usize, awake: u32) {
        self.store(self.parts.active, 2 * word + 1, awake);
    }

    /// The next region instance that is not inside this one.
    #[inline(always)]
    fn next(&self, region: usize) -> usize {
        let record = self.record(Section::RegionInstances, region);
        self.field(record, region_instance::NEXT)
    }

    /// The first own flag of a state in a region instance.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn first_flag(&self, region: usize, state: R::Place) -> usize {
        let region = self.record(Section::RegionInstances, region);
        self.field(region, region_instance::FIRST_FLAG) + self.field(state, state::FIRST_FLAG)
    }

    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn flag_at(&self, flag: usize) -> bool {
        self.load(self.parts.flags, flag / WORD_BITS) >> (flag % WORD_BITS) & 1 != 0
    }

    #[cfg_attr(not(small), inline(never))]
    fn set_flag_to(&mut self, flag: usize, value: bool) {
        self.write_bit(self.parts.flags, flag, value);
    }

    /// Writes a bit of a part of the arena, the first in the lowest bit, and says what it was.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn write_bit(&mut self, part: R::Part, index: usize, value: bool) -> bool {
        let place = index / WORD_BITS;
        let bit = 1 << (index % WORD_BITS);
        let word = self.load(part, place);
        self.store(part, place, if value { word | bit } else { word & !bit });
        word & bit != 0
    }

    /// Writes one of the two bits of a region instance: that in the first word of its two, or in the second.
    #[cfg_attr(small, inline(never))]
    fn mark(&mut self, region: usize, second: bool, value: bool) {
        let words = 2 * (region / WORD_BITS) + usize::from(second);
        let bit = (WORD_BITS - 1) - region % WORD_BITS;
        self.write_bit(self.parts.active, WORD_BITS * words + bit, value);
    }

    #[inline(always)]
    fn wake(&mut self, region: usize) {
        if SMALL {
            return self.mark(region, true, true);
        }
        let word = region / WORD_BITS;
        self.set_awake(word, self.awake(word) | bit_of(region));
        self.next_step = self.visit;
    }

    /// Resets an enable bit and says whether it was set.
    #[cfg_attr(not(small), inline(never))]
    fn disable(&mut self, task: usize) -> bool {
        if SMALL {
            return self.write_bit(self.parts.enabled, task, false);
        }
        let (enabled, place) = (self.parts.enabled, task / WORD_BITS);
        let bit = 1 << (task % WORD_BITS);
        let word = self.load(enabled, place);
        let was_enabled = word & bit != 0;
        if was_enabled {
            self.store(enabled, place, word & !bit);
        }
        was_enabled
    }

    /// Sets an enable bit and says whether it was set.
    #[inline(always)]
    fn enable(&mut self, task: usize) -> bool {
        self.write_bit(self.parts.enabled, task, true)
    }
}

/// What happens in a macro step.
impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Handles the pulse and all events that follow from it, in a machine whose region instances are `NEAR`: in one word. Says whether a transition was taken.
    #[inline(always)]
    fn walk<O: Observer, const NEAR: bool>(&mut self, observer: &mut O) -> Result<bool, Fault> {
        let mut changed = false;
        self.queued = 0;
        self.taken = 0;
        self.next_step = Step::Rest;
        if !self.pulse::<O, NEAR>(&mut changed, observer) {
            return Err(self.stop(Fault::EventQueueOverflow, observer));
        }
        while self.taken != self.queued {
            if self.taken == u32::from(MAX_MICRO_STEPS - 1) {
                return Err(self.stop(Fault::MacroStepLimit, observer));
            }
            let place = (self.taken & self.queue_mask) as usize;
            self.taken += 1;
            let sent = R::load_half(self.arena, self.parts.queue, place);
            if !self.event::<O, NEAR>(sent.into(), &mut changed, observer) {
                return Err(self.stop(Fault::EventQueueOverflow, observer));
            }
        }
        Ok(changed)
    }

    /// The same in any machine and with any event, the pulse among them: what it lacks in speed it spares in room.
    #[inline(always)]
    fn walk_any<O: Observer>(&mut self, observer: &mut O) -> Result<bool, Fault> {
        let mut changed = false;
        self.queued = 0;
        self.taken = 0;
        let mut event = format::PULSE;
        // The next region instance to look at, where those end who may be visited, and how far ahead of a word of them its word of the row is.
        let (mut at, mut end, mut row) = (0, self.layout.regions, 0);
        loop {
            while at < end {
                let word = at / WORD_BITS;
                let who = if event == format::PULSE {
                    self.awake(word)
                } else {
                    self.word_of(self.record(Section::Listeners, word.wrapping_add(row)))
                };
                let visit = self.active(word) & who & from_place(at);
                at = WORD_BITS * word + visit.leading_zeros() as usize;
                if visit == 0 {
                    continue;
                }
                let here = Here {
                    region: at,
                    current: self.current_record(at),
                };
                at += 1;
                let Some(found) = self.find(event, here) else {
                    continue;
                };
                changed = true;
                at = self.take_any(here.region, found, observer);
                if at == NOT_TAKEN {
                    return Err(self.stop(Fault::EventQueueOverflow, observer));
                }
                self.tell(here, found, observer);
            }
            if self.taken == self.queued {
                return Ok(changed);
            }
            if self.taken == u32::from(MAX_MICRO_STEPS - 1) {
                return Err(self.stop(Fault::MacroStepLimit, observer));
            }
            let place = (self.taken & self.queue_mask) as usize;
            self.taken += 1;
            let sent = R::load_half(self.arena, self.parts.queue, place);
            let sent = self.record(Section::Channels, sent.into());
            event = self.field(sent, channel::EVENT) as u16;
            let first = self.field(sent, channel::FIRST_REGION_WORD);
            at = WORD_BITS * first;
            end = at + WORD_BITS * self.field(sent, channel::REGION_WORDS);
            row = self
                .field(sent, channel::FIRST_ROW_WORD)
                .wrapping_sub(first);
        }
    }

    /// The first transition on an event whose guard is true, out of the current state of a region instance. After a pulse that sleeps, if its guards allow.
    fn find(&mut self, event: u16, here: Here<R::Place>) -> Option<R::Place> {
        let Here { region, current } = here;
        if event == format::PULSE {
            self.put_to_sleep(region);
            return Some(self.find_on_pulse(here)?.0);
        }
        if self.events(current) >> (u32::from(event) % u32::BITS) & 1 == 0 {
            return None;
        }
        Some(self.find_on_event(event, here)?.0)
    }

    /// The same in any machine.
    #[inline(never)]
    fn walk_far<O: Observer>(&mut self, observer: &mut O) -> Result<bool, Fault> {
        self.walk::<O, false>(observer)
    }

    /// Shows the pulse to those who are awake. False if the queue had no room for an event.
    #[inline(always)]
    fn pulse<O: Observer, const NEAR: bool>(
        &mut self,
        changed: &mut bool,
        observer: &mut O,
    ) -> bool {
        let mut word = 0;
        let mut visit = self.active(word) & self.awake(word);
        loop {
            while visit != 0 {
                let offset = visit.leading_zeros();
                visit &= !(FIRST >> offset);
                let here = self.here(word, offset);
                let Some((at, flags)) = self.find_on_pulse(here) else {
                    continue;
                };
                *changed = true;
                let trigger = self.field(at, transition::EVENT) as u16;
                let action = self.field(at, transition::ACTION) as u16;
                if trigger & format::TRANSITION_IS_PLAIN != 0 {
                    if action == format::ACTION_NONE {
                        self.put_to_sleep(here.region);
                        self.take_plain(here, at);
                    } else if !self.take_again::<O, NEAR>(here, flags, action, observer) {
                        return false;
                    }
                    self.tell(here, at, observer);
                    continue;
                }
                self.put_to_sleep(here.region);
                let behind = self.take_any(here.region, at, observer);
                if behind == NOT_TAKEN {
                    return false;
                }
                self.tell(here, at, observer);
                if behind != ON {
                    if behind >= self.layout.regions {
                        return true;
                    }
                    if !NEAR {
                        word = behind / WORD_BITS;
                    }
                    visit = self.active(word) & self.awake(word) & from_place(behind);
                }
            }
            word += 1;
            if NEAR || WORD_BITS * word >= self.layout.regions {
                return true;
            }
            visit = self.active(word) & self.awake(word);
        }
    }

    /// Shows an event to those who listen. False if the queue had no room for another.
    #[inline(always)]
    fn event<O: Observer, const NEAR: bool>(
        &mut self,
        sent: usize,
        changed: &mut bool,
        observer: &mut O,
    ) -> bool {
        let sent = self.record(Section::Channels, sent);
        let mut words = self.field(sent, channel::REGION_WORDS);
        if words == 0 {
            return true;
        }
        let event = self.field(sent, channel::EVENT) as u16;
        let waits = 1 << (u32::from(event) % u32::BITS);
        let row = self.field(sent, channel::FIRST_ROW_WORD);
        let mut row = self.record(Section::Listeners, row);
        let mut word = if NEAR {
            words = 1;
            0
        } else {
            self.field(sent, channel::FIRST_REGION_WORD)
        };
        let mut visit = self.active(word) & self.word_of(row);
        loop {
            while visit != 0 {
                let offset = visit.leading_zeros();
                visit &= !(FIRST >> offset);
                let mut here = self.here(word, offset);
                if self.events(here.current) & waits == 0 {
                    // Where there are many, most do not wait: so there is a loop for them alone.
                    if NEAR || !self.skip_idle(&mut visit, word, waits, &mut here) {
                        continue;
                    }
                }
                let Some((at, is_plain)) = self.find_on_event(event, here) else {
                    continue;
                };
                *changed = true;
                if is_plain {
                    self.take_plain(here, at);
                    self.tell(here, at, observer);
                    continue;
                }
                let behind = self.take_any(here.region, at, observer);
                if behind == NOT_TAKEN {
                    return false;
                }
                self.tell(here, at, observer);
                if behind != ON {
                    let ahead = behind / WORD_BITS - word;
                    if ahead >= words {
                        return true;
                    }
                    if !NEAR {
                        words -= ahead;
                        word += ahead;
                        row = R::ahead(row, record_bytes(Section::Listeners) * ahead);
                    }
                    visit = self.active(word) & self.word_of(row) & from_place(behind);
                }
            }
            words -= 1;
            if NEAR || words == 0 {
                return true;
            }
            word += 1;
            row = R::ahead(row, record_bytes(Section::Listeners));
            visit = self.active(word) & self.word_of(row);
        }
    }

    /// Ends all for good.
    #[cold]
    #[inline(never)]
    fn stop<O: Observer>(&mut self, fault: Fault, observer: &mut O) -> Fault {
        self.disable_real_time(0..self.layout.tasks, observer);
        self.fault = Some(fault);
        self.taken = self.queued;
        self.look_at_timers_in(1);
        fault
    }

    /// Goes on to the next of the region instances in `visit` whose current state waits for one of these events, if there is one; it and those before it are taken out.
    #[inline(always)]
    fn skip_idle(
        &self,
        visit: &mut u32,
        word: usize,
        waits: u32,
        here: &mut Here<R::Place>,
    ) -> bool {
        while *visit != 0 {
            let offset = visit.leading_zeros();
            *here = self.here(word, offset);
            *visit &= !(FIRST >> offset);
            if self.events(here.current) & waits != 0 {
                return true;
            }
        }
        false
    }

    /// The region instance at a place of a word.
    #[inline(always)]
    fn here(&self, word: usize, offset: u32) -> Here<R::Place> {
        let region = WORD_BITS * word + offset as usize;
        Here {
            region,
            current: self.current_record(region),
        }
    }

    /// Tells of a transition that was taken.
    #[inline(always)]
    fn tell<O: Observer>(&self, here: Here<R::Place>, at: R::Place, observer: &mut O) {
        let first = self.record(Section::Transitions, 0);
        observer.transition(TransitionTaken {
            micro: self.taken as u8,
            region_instance: here.region as u16,
            transition: (R::distance(first, at) / TRANSITION_BYTES) as u16,
        });
    }

    /// Takes a plain transition to a simple state.
    #[inline(always)]
    fn take_plain(&mut self, here: Here<R::Place>, at: R::Place) {
        self.make_current(here.region, self.field(at, transition::TARGET));
    }

    /// The first transition on the pulse whose guard is true, out of the current state of a region instance; and where its flags begin in the arena.
    ///
    /// From then on the region instance sleeps until it is woken again, but if what was found is the state's entering itself anew by a plain transition.
    #[inline(always)]
    fn find_on_pulse(&mut self, here: Here<R::Place>) -> Option<(R::Place, usize)> {
        let Here { region, current } = here;
        let mut row = self.field(current, state::B);
        if self.field(current, state::SHAPE) & usize::from(format::STATE_HAS_TIMEOUT) != 0 {
            self.run_timer(region);
            row = 0;
        }
        let first = self.field(current, state::FIRST_TRANSITION);
        let end = self.field(current, state::FIRST_EVENT_TRANSITION);
        let mut at = self.record(Section::Transitions, first);
        let end = self.record(Section::Transitions, end);
        let flags = self.first_flag(region, current);
        let window: Window = Window::of(R::window(self.arena, self.parts.flags, flags));
        if row != 0 {
            let guard = self.field(at, transition::GUARD);
            if let Some(first) = window.first_of::<R>(guard, row) {
                return Some((R::ahead(at, TRANSITION_BYTES * first), flags));
            }
            at = R::ahead(at, TRANSITION_BYTES * row);
        }
        self.put_to_sleep(region);
        while at != end {
            let guard = self.field(at, transition::GUARD);
            let holds = if guard < usize::from(format::GUARD_PROGRAM) {
                window.holds(guard)
            } else {
                self.is_true(guard, region, current)
            };
            if holds {
                if self.is_again(at) {
                    self.wake(region);
                }
                return Some((at, flags));
            }
            at = R::ahead(at, TRANSITION_BYTES);
        }
        None
    }

    /// Whether a transition on the pulse is a plain one from a real-time task to itself.
    #[inline(always)]
    fn is_again(&self, at: R::Place) -> bool {
        let trigger = self.field(at, transition::EVENT) as u16;
        let action = self.field(at, transition::ACTION) as u16;
        trigger & format::TRANSITION_IS_PLAIN != 0 && action != format::ACTION_NONE
    }

    /// The same on another event; and whether it is plain.
    #[inline(always)]
    fn find_on_event(&mut self, event: u16, here: Here<R::Place>) -> Option<(R::Place, bool)> {
        let Here { region, current } = here;
        let first = self.field(current, state::FIRST_EVENT_TRANSITION);
        // `final` has no transitions, so a state that has some is not the last.
        let after = R::ahead(current, record_bytes(Section::States));
        let end = self.field(after, state::FIRST_TRANSITION);
        let mut at = self.record(Section::Transitions, first);
        let end = self.record(Section::Transitions, end);
        while at != end {
            // Without the mark, which is in the highest bit.
            let differs = self.field(at, transition::EVENT) as u16 ^ event;
            if differs << 1 == 0 {
                let guard = self.field(at, transition::GUARD);
                if guard == usize::from(format::GUARD_TRUE) || self.is_true(guard, region, current)
                {
                    return Some((at, differs != 0));
                }
            }
            at = R::ahead(at, TRANSITION_BYTES);
        }
        None
    }

    #[inline(always)]
    fn put_to_sleep(&mut self, region: usize) {
        if SMALL {
            return self.mark(region, true, false);
        }
        let word = region / WORD_BITS;
        self.set_awake(word, self.awake(word) & !bit_of(region));
    }

    /// Makes a state the current one of its region instance, which wakes if the state has transitions on the pulse.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn make_current(&mut self, region: usize, target: usize) {
        self.set_current(region, target);
        if self.events(self.record(Section::States, target)) & 1 != 0 {
            self.wake(region);
        }
    }

    /// A guard of any form.
    #[inline(never)]
    fn is_true(&mut self, guard: usize, region: usize, current: R::Place) -> bool {
        let flags = self.first_flag(region, current);
        let flags = R::window(self.arena, self.parts.flags, flags);
        if guard < usize::from(format::GUARD_PROGRAM) {
            if SMALL {
                return is_bit_right(flags, guard);
            }
            let window: Window = Window::of(flags);
            return window.holds(guard);
        }
        if guard >= usize::from(format::GUARD_MASK) {
            let at = self.record(Section::Code, guard % usize::from(format::GUARD_MASK));
            let differ = flags as usize ^ self.field(at, mask::VALUE);
            return differ & self.field(at, mask::MASK) == 0;
        }
        let here = self.record(Section::RegionInstances, region);
        let first_flag = self.field(here, region_instance::FIRST_FLAG);
        let mut at = self.record(Section::Code, guard - usize::from(format::GUARD_PROGRAM));
        loop {
            let control = self.field(at, code::CONTROL) as u16;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            let is_set = match operation {
                format::CODE_JUMP_IF_CLEAR | format::CODE_JUMP_IF_SET => {
                    self.flag_at(first_flag + self.field(at, code::OPERAND))
                }
                format::CODE_JUMP_IF_IDLE_INSIDE | format::CODE_JUMP_IF_BUSY_INSIDE => {
                    // Tasks get busy without waking anyone but their own region.
                    self.wake(region);
                    self.is_busy_within(region)
                }
                _ => return true,
            };
            // Those that jump if it is set have even numbers.
            let jumps = is_set == operation.is_multiple_of(2);
            let ahead = match (jumps, usize::from(control & format::CODE_LOW_MASK)) {
                (false, _) => 1,
                (true, 0) => return false,
                (true, jump) => jump,
            };
            at = R::ahead(at, record_bytes(Section::Code) * ahead);
        }
    }

    /// Whether the busy flag of a current task state is set anywhere inside the current superstate of a region instance.
    #[inline(never)]
    fn is_busy_within(&self, region: usize) -> bool {
        (region + 1..self.next(region)).any(|inside| {
            let current = self.current_record(inside);
            let kind = self.field(current, state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
            self.is_active_at(inside)
                && matches!(kind, format::STATE_TASK | format::STATE_BACKGROUND_TASK)
                && self.flag_at(self.first_flag(inside, current) + format::FLAG_BUSY)
        })
    }

    /// Takes a plain transition on the pulse from a real-time task to itself, with its one `send`. It stays awake: the transition is on the pulse. False if the queue had no room.
    #[inline(always)]
    fn take_again<O: Observer, const NEAR: bool>(
        &mut self,
        here: Here<R::Place>,
        flags: usize,
        action: u16,
        observer: &mut O,
    ) -> bool {
        let Here { region, current } = here;
        let record = self.record(Section::RegionInstances, region);
        let instance = self.field(record, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance);
        let task = self.field(instance, instance::FIRST_TASK) + self.field(current, state::A);
        let first_channel = self.field(instance, instance::FIRST_CHANNEL);
        let count = self.field(current, state::SHAPE) as u32 % u32::BITS;
        R::clear_window(self.arena, self.parts.flags, flags, count);
        // No event of this macro step has been taken out of the queue yet.
        if self.queued == self.queue_capacity {
            return false;
        }
        let channel = first_channel + usize::from(action & !format::ACTION_SEND);
        let place = self.queued as usize;
        R::store_half(self.arena, self.parts.queue, place, channel as u16);
        self.queued += 1;
        self.next_step = if NEAR { Step::Near } else { self.visit };
        if self.enable(task) {
            observer.disabled(task as u16);
        }
        observer.enabled(task as u16);
        true
    }

    /// Leaves a state, acts, enters another.
    #[inline(never)]
    fn take_any<O: Observer>(
        &mut self,
        region: usize,
        transition: R::Place,
        observer: &mut O,
    ) -> Resume {
        let target = self.field(transition, transition::TARGET);
        let left = self.current_record(region);
        let entered = self.record(Section::States, target);
        let here = self.record(Section::RegionInstances, region);
        let instance_index = self.field(here, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance_index);
        let mut is_wide = SMALL;
        let left_kind = self.field(left, state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
        if left_kind == format::STATE_TASK {
            let first_task = self.field(instance, instance::FIRST_TASK);
            let task = first_task + self.field(left, state::A);
            if self.disable(task) {
                observer.disabled(task as u16);
            }
        }
        let shape = self.field(entered, state::SHAPE) as u16;
        let first_flag = self.first_flag(region, entered);
        self.reset_flags(first_flag, shape & format::STATE_FLAGS_MASK);
        let action = self.field(transition, transition::ACTION) as u16;
        if action & format::ACTION_SEND != 0 {
            let first_channel = self.field(instance, instance::FIRST_CHANNEL);
            if !self.send_apart(first_channel + usize::from(action & !format::ACTION_SEND)) {
                return NOT_TAKEN;
            }
        } else if action != format::ACTION_NONE {
            match self.act(usize::from(action - format::ACTION_ROW), here, entered) {
                Some(wide) => is_wide |= wide,
                None => return NOT_TAKEN,
            }
        }
        // Not before it is known that there is room for what is sent: otherwise the state stays, and what is inside it.
        if left_kind == format::STATE_SUPER {
            let inside = instance_index + self.field(left, state::A);
            self.leave_regions(region, inside, observer);
            is_wide = true;
        }
        self.make_current(region, target);
        if shape & format::STATE_HAS_TIMEOUT != 0 {
            self.start_timer(region, entered);
        }
        match shape >> format::STATE_KIND_SHIFT {
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let first_task = self.field(instance, instance::FIRST_TASK);
                let task = first_task + self.field(entered, state::A);
                self.enable(task);
                observer.enabled(task as u16);
            }
            format::STATE_FINAL => {
                let exit = self.field(instance, instance::FIRST_FLAG) + format::FLAG_EXIT;
                self.set_flag_to(exit, true);
                self.wake_instance(instance_index);
                is_wide = true;
            }
            format::STATE_SUPER => {
                let inside = instance_index + self.field(entered, state::A);
                let inside = self.record(Section::Instances, inside);
                let first = self.field(inside, instance::FIRST_REGION);
                self.start_regions(first, self.next(region));
                is_wide = true;
            }
            _ => {}
        }
        if is_wide { self.next(region) } else { ON }
    }

    /// Carries out a row of actions of a transition in the region instance with the record `here` to the state with the record `entered`. Says whether it woke anyone; none if
    /// the queue had no room for an event.
    #[inline(never)]
    fn act(&mut self, first: usize, here: R::Place, entered: R::Place) -> Option<bool> {
        let mut is_wide = false;
        let first_flag = self.field(here, region_instance::FIRST_FLAG);
        let own = self.field(entered, state::FIRST_FLAG);
        let own_flags = self.field(entered, state::SHAPE) & usize::from(format::STATE_FLAGS_MASK);
        let instance_index = self.field(here, region_instance::INSTANCE);
        let mut at = self.record(Section::Code, first);
        loop {
            let control = self.field(at, code::CONTROL) as u16;
            let operand = self.field(at, code::OPERAND);
            let operation = control >> format::CODE_OPERATION_SHIFT;
            if operation == format::CODE_SEND {
                let instance = self.record(Section::Instances, instance_index);
                if !self.send_apart(self.field(instance, instance::FIRST_CHANNEL) + operand) {
                    return None;
                }
            } else {
                self.set_flag_to(first_flag + operand, operation == format::CODE_SET);
                // Own flags of the state that is entered are looked at by nobody else.
                if operand.wrapping_sub(own) >= own_flags {
                    self.wake_instance(instance_index);
                    is_wide = true;
                }
            }
            if control & format::CODE_LOW_MASK != 0 {
                return Some(is_wide);
            }
            at = R::ahead(at, record_bytes(Section::Code));
        }
    }

    /// Resets `count` flags from `first` on.
    #[inline(always)]
    fn reset_flags(&mut self, first: usize, count: u16) {
        let mut first = first;
        let mut left = u32::from(count);
        if SMALL {
            while left != 0 {
                let few = left.min(WINDOW_BITS);
                R::clear_window(self.arena, self.parts.flags, first, few);
                first += few as usize;
                left -= few;
            }
            return;
        }
        while left > WINDOW_BITS {
            R::clear_window(self.arena, self.parts.flags, first, WINDOW_BITS);
            first += WINDOW_BITS as usize;
            left -= WINDOW_BITS;
        }
        R::clear_window(self.arena, self.parts.flags, first, left);
    }

    /// The same as [`Self::send`], where less room is worth more than speed.
    #[inline(never)]
    fn send_apart(&mut self, channel: usize) -> bool {
        self.send(channel)
    }

    /// Appends an event to the queue. False if there is no room.
    #[inline(always)]
    fn send(&mut self, channel: usize) -> bool {
        if self.queued - self.taken == self.queue_capacity {
            return false;
        }
        let place = (self.queued & self.queue_mask) as usize;
        R::store_half(self.arena, self.parts.queue, place, channel as u16);
        self.queued += 1;
        true
    }

    /// Wakes those in a container instance, at any depth, and the region instance around it.
    #[inline(never)]
    fn wake_instance(&mut self, instance_index: usize) {
        let instance = self.record(Section::Instances, instance_index);
        let around = self.field(instance, instance::AROUND);
        let end = if instance_index == 0 {
            self.layout.regions
        } else {
            self.next(around)
        };
        self.wake_all(around..end);
    }

    #[inline(never)]
    fn wake_all(&mut self, regions: Range<usize>) {
        for (word, those) in words_of(regions) {
            self.set_awake(word, self.awake(word) | those);
        }
        self.next_step = self.visit;
    }

    /// Ends what is inside the superstate of a region instance, a container instance.
    #[inline(never)]
    fn leave_regions<O: Observer>(&mut self, region: usize, inside: usize, observer: &mut O) {
        let instance = self.record(Section::Instances, inside);
        let content = self.field(instance, instance::CONTAINER);
        let content = self.record(Section::Containers, content);
        let first_task = self.field(instance, instance::FIRST_TASK);
        let tasks = self.field(content, container::TASK_SPAN);
        self.disable_real_time(first_task..first_task + tasks, observer);
        for (word, those) in words_of(region + 1..self.next(region)) {
            self.set_active(word, self.active(word) & !those);
        }
    }

    /// Starts the region instances of a container instance, of which the first is `first`, and all are before `end`.
    #[inline(never)]
    fn start_regions(&mut self, first: usize, end: usize) {
        let mut at = first;
        while at < end {
            let record = self.record(Section::RegionInstances, at);
            let initial = self.field(record, region_instance::INITIAL);
            if SMALL {
                self.mark(at, false, true);
            } else {
                let word = at / WORD_BITS;
                self.set_active(word, self.active(word) | bit_of(at));
            }
            // It may have been woken when it was not active.
            self.put_to_sleep(at);
            self.make_current(at, initial);
            at = self.field(record, region_instance::NEXT);
        }
    }

    /// Disables the enabled real-time tasks among some task instances.
    #[inline(never)]
    fn disable_real_time<O: Observer>(&mut self, tasks: Range<usize>, observer: &mut O) {
        for task in tasks {
            let record = self.record(Section::TaskInstances, task);
            let state = self.record(Section::States, self.field(record, task_instance::STATE));
            let kind = self.field(state, state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
            if kind == format::STATE_TASK && self.disable(task) {
                observer.disabled(task as u16);
            }
        }
    }
}

/// Timers, and the number of macro steps.
///
/// A state's age is the number of macro steps since the one in which it was entered. Until its timeout flag is set, it is at most one above the highest at which the state is
/// not overdue, which fits in 32 bits. Macro steps that are skipped are added by [`Self::age_timers`].
impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Macro steps that began, or were skipped.
    #[inline(always)]
    fn begun(&self) -> u64 {
        self.due - u64::from(self.steps_left)
    }

    /// The low bits of the number of the last macro step that began.
    fn now(&self) -> u32 {
        (self.begun() as u32).wrapping_sub(1)
    }

    /// Looks at the timers in the macro step that comes so many after the last that began.
    fn look_at_timers_in(&mut self, steps: u32) {
        self.due = self.begun() + u64::from(steps);
        self.steps_left = steps;
    }

    /// The highest age at which a state is not overdue.
    fn limit(&self, state: R::Place) -> u32 {
        let timer = self.record(Section::Timers, self.field(state, state::B));
        // Where no time passes, none runs out.
        self.word_of(timer)
            .checked_div(self.period_us)
            .unwrap_or(u32::MAX - 1)
    }

    #[inline(never)]
    fn start_timer(&mut self, region: usize, entered: R::Place) {
        self.store(self.parts.entered, region, self.now());
        let steps = self.steps_left.min(self.limit(entered) + 1);
        self.look_at_timers_in(steps);
    }

    /// The timeout flag of a state in a region instance.
    fn timeout_flag(&self, region: usize, state: R::Place) -> usize {
        let kind = self.field(state, state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
        let of_simple = kind == format::STATE_SIMPLE;
        self.first_flag(region, state) + if of_simple { 0 } else { format::FLAG_TIMEOUT }
    }

    /// The record of a region instance's current state, if that is active and its timer runs, and after how many macro steps it is overdue; 0 if it is.
    fn timed(&self, region: usize) -> Option<(R::Place, u32)> {
        let active = self.is_active_at(region);
        let current = self.current_record(region);
        let timed = self.field(current, state::SHAPE) & usize::from(format::STATE_HAS_TIMEOUT) != 0;
        if !active || !timed || self.flag_at(self.timeout_flag(region, current)) {
            return None;
        }
        let age = self
            .now()
            .wrapping_sub(self.load(self.parts.entered, region));
        Some((current, (self.limit(current) + 1).saturating_sub(age)))
    }

    /// Sets the timeout flag of the current state of a region instance if that has been so for longer than its limit.
    #[cold]
    #[inline(never)]
    fn run_timer(&mut self, region: usize) {
        if let Some((current, 0)) = self.timed(region) {
            self.set_flag_to(self.timeout_flag(region, current), true);
        }
    }

    /// Wakes who is overdue, with all inside, for whom that is a flag of their instance; finds out when the next may be. A machine that was stopped has its last macro step
    /// again and again, so that no other has to look for its fault.
    #[cold]
    #[inline(never)]
    fn run_timers(&mut self) -> Result<(), Fault> {
        if let Some(fault) = self.fault {
            self.look_at_timers_in(1);
            return Err(fault);
        }
        let mut steps = u32::MAX;
        for region in 0..self.layout.regions {
            match self.timed(region) {
                Some((_, 0)) => self.wake_all(region..self.next(region)),
                Some((_, left)) => steps = steps.min(left),
                None => {}
            }
        }
        self.look_at_timers_in(steps);
        Ok(())
    }

    /// Lets the timers of states run out that will be overdue when more macro steps have passed. Their true ages might not fit.
    #[cold]
    #[inline(never)]
    fn age_timers(&mut self, missed: u32) {
        let next = (self.begun() as u32).wrapping_add(missed);
        for region in 0..self.layout.regions {
            if let Some((current, left)) = self.timed(region)
                && left.saturating_sub(1) <= missed
            {
                let entered = next.wrapping_sub(self.limit(current) + 1);
                self.store(self.parts.entered, region, entered);
            }
        }
    }
}

/// The bit of a region instance in its word.
#[inline(always)]
fn bit_of(region: usize) -> u32 {
    FIRST >> (region % WORD_BITS)
}

#[inline]
fn bit(words: &[u32], index: usize) -> bool {
    words
        .get(index / WORD_BITS)
        .is_some_and(|word| word >> (index % WORD_BITS) & 1 != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Holds each guard that asks for one bit, and each row of them, against the meaning of its number.
    fn assert_guards_mean_what_they_say<const REVERSED: bool>() {
        let one_flag = (0..format::WINDOW_FLAGS).map(|flag| 1u32 << flag);
        // What is above the window is of other states.
        let patterns = [0, u32::MAX, 0x7FFF, 0xFFFF_8000, 0x5555_5555, 0xDEAD_BEEF];
        for flags in one_flag
            .clone()
            .chain(one_flag.map(|it| !it))
            .chain(patterns)
        {
            let holds = |guard: u32| match guard {
                0..15 => flags >> guard & 1 != 0,
                15 => false,
                16..31 => flags >> (guard - 16) & 1 == 0,
                _ => guard == u32::from(format::GUARD_TRUE),
            };
            let window = Window::<REVERSED>::of(flags);
            for guard in 0..u32::from(format::GUARD_PROGRAM) {
                for found in [
                    window.holds(guard as usize),
                    is_bit_right(flags, guard as usize),
                ] {
                    assert_eq!(found, holds(guard), "{flags:#x} {guard}");
                }
                for count in 2..=(u32::from(format::GUARD_PROGRAM) - guard).min(16) {
                    let first = (0..count).find(|ahead| holds(guard + ahead));
                    let found = window.first_of::<Checked>(guard as usize, count as usize);
                    assert_eq!(
                        found,
                        first.map(|it| it as usize),
                        "{flags:#x} {guard} {count}"
                    );
                }
            }
        }
    }

    #[test]
    fn guards_mean_the_same_whichever_way_round_a_core_has_them() {
        assert_guards_mean_what_they_say::<false>();
        assert_guards_mean_what_they_say::<true>();
    }
}
