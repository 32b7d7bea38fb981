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
//! many. The macro step behind them begins with setting the flags of those that have, wakes whom that concerns, and finds the next. Who is left before its turn in this macro step takes its
//! flag with it: so this is no other than each one's being set when its region is looked at.
//!
//! **Places.** The tables are read at bytes of the blob, by [reads](crate::reads) that need not check them again. That every loop ends is what [`verify`](crate::verify()) proved.

mod carry;
mod clock;
mod progress;

use core::ops::{Deref, Range};

use clock::Clock;

pub use carry::TakenOver;
pub use progress::{MAX_STEPS, Progress, ResumeError};

use crate::format::{self, Section};
use crate::layout::{
    Field, channel, code, container, instance, mission, region_instance, slot, state,
    task_instance, transition,
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
    /// Microseconds from one macro step to the next.
    pub period_us: u32,
    /// Events that were handled, the pulse included.
    pub micro_steps: u8,
    /// Whether any transition was taken.
    pub changed: bool,
    /// Whether a region of the machine has reached `final`, now or before.
    pub finished: bool,
}

impl StepSummary {
    /// Its time: microseconds since the first macro step. Where that is more than 64 bits can hold, after half
    /// a million years, time stands still there.
    #[must_use]
    #[inline]
    pub fn t_us(&self) -> u64 {
        self.step.saturating_mul(u64::from(self.period_us))
    }
}

/// How the arena is divided: the word at which each part begins. The parts stand in this order.
///
/// The current states come first, two a word, the one of the lower region instance in the low half.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(small, repr(C))]
pub(crate) struct ArenaLayout {
    /// Numbers of region instances and of task instances.
    regions: usize,
    tasks: usize,
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
}

impl ArenaLayout {
    pub(crate) fn of(tables: &Tables<'_>) -> Self {
        Self::new(
            tables.region_instance_count(),
            tables.task_instance_count(),
            tables.flag_count(),
            tables.queue_capacity(),
        )
    }

    fn new(regions: usize, tasks: usize, flag_count: usize, queue_capacity: usize) -> Self {
        let active = regions.div_ceil(2);
        let flags = active + 2 * words_for(regions);
        let enabled = flags + words_for(flag_count);
        let entered = enabled + words_for(tasks);
        let queue = entered + regions;
        let end = queue + queue_words(queue_capacity);
        Self {
            regions,
            tasks,
            active,
            flags,
            enabled,
            entered,
            queue,
            end,
        }
    }

    pub(crate) fn words(&self) -> usize {
        self.end
    }
}

/// Where the tables begin that are read.
type Starts<P> = [P; Section::TaskInstances as usize + 1];

fn starts_of<R: Access>(tables: &Tables<'_>) -> Starts<R::Place> {
    core::array::from_fn(|section| R::place(tables.bytes(), tables.start_at(section)))
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

/// Words that have so many bits. There are less than a carry would take, which a division that rounds up would have to think of.
fn words_for(bits: usize) -> usize {
    (bits + (WORD_BITS - 1)) >> WORD_BITS.trailing_zeros()
}

/// Words of the event queue, of two places each: a power of two, so that going round is cheap.
fn queue_words(capacity: usize) -> usize {
    // One place has a word of its own, as two have.
    let last = capacity.wrapping_sub(1) | 1;
    (usize::MAX / 2 + 1) >> last.leading_zeros()
}

/// A machine that runs. `R` says how it reads its tables: see [`Reads`].
// What is used most stands first if it is compiled for size: there loads are shorter.
#[derive(Debug)]
#[cfg_attr(small, repr(C))]
pub struct Interpreter<'m, B, R: Access = DefaultReads> {
    parts: Parts<R::Part>,
    period_us: u32,
    /// Events that were put into the queue in this macro step, and taken out: the second is the number of the micro step. The queue is a ring, as long as a power of
    /// two: the low bits say the place.
    queued: u32,
    taken: u32,
    queue_mask: u32,
    queue_capacity: u32,
    fault: Option<Fault>,
    clock: Clock,
    layout: ArenaLayout,
    starts: Starts<R::Place>,
    arena: &'m mut [u32],
    verified: Verified<B>,
    /// What the next macro step does, and what it does once some region is awake.
    next_step: Step,
    visit: Step,
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
/// Where the two words of 32 region instances are: who is active, and who is awake.
const ACTIVE: usize = 0;
const AWAKE: usize = 1;

/// What is written of a region instance: in which of the two words, and twice the bit.
type Mark = usize;
const SET_INACTIVE: Mark = ACTIVE;
const SET_ASLEEP: Mark = AWAKE;
const SET_ACTIVE: Mark = ACTIVE | 2;
const SET_AWAKE: Mark = AWAKE | 2;
const TRANSITION_BYTES: usize = record_bytes(Section::Transitions);
/// The first region instance of a word.
const FIRST: u32 = 1 << (u32::BITS - 1);

/// The region instances of its word that are not before a region instance.
#[inline(always)]
fn from_place(region: usize) -> u32 {
    u32::MAX >> (region % WORD_BITS)
}

/// Where the visit of a micro step goes on after a transition of one region instance.
///
/// Most change only what the region instance itself is in, and the visit goes on as it was: that is 0. Where who is active or awake changed, it is the next region instance that
/// is not inside that one, and so above 0. [`NOT_TAKEN`] if the queue had no room for an event.
type Resume = usize;
const ON: Resume = 0;
const NOT_TAKEN: Resume = usize::MAX;

/// A timer that runs.
struct Timer {
    /// The flag of its state.
    flag: usize,
    /// Macro steps since its state was entered.
    age: u32,
    /// The highest age at which it has not run out.
    limit: u32,
}

/// Stands for no region instance.
const NOBODY: usize = usize::MAX;

/// Who is still to be shown an event.
struct Listening<P> {
    /// Those of a word of region instances.
    visit: u32,
    word: usize,
    /// Words of the row from this one on.
    words: usize,
    /// This word of the row.
    row: P,
}

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
    ((window >> (guard % if_clear)) as usize ^ (guard / if_clear)) & 1 != 0
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
    pub fn with_reads(
        verified: Verified<B>,
        arena: &'m mut [u32],
    ) -> Result<Self, ArenaTooSmall<'m, B>> {
        let tables = verified.tables();
        let mission = R::place(tables.bytes(), tables.start_at(Section::Mission as usize));
        let number = |field: Field| -> usize {
            R::half(tables.bytes(), R::ahead(mission, field.offset())).into()
        };
        let queue_capacity = number(mission::QUEUE);
        let interpreter_slot = number(mission::INTERPRETER_SLOT);
        let layout = ArenaLayout::new(
            tables.region_instance_count(),
            tables.task_instance_count(),
            number(mission::FLAGS),
            queue_capacity,
        );
        let needed_words = layout.words();
        // The result is made where it will stand.
        let mut made = if needed_words <= arena.len() {
            Ok(Self {
                parts: Parts::of::<R>(arena, &layout),
                period_us: 0,
                queued: 0,
                taken: 0,
                // Where there is one place only, the word has a second one.
                queue_mask: (2 * (layout.end - layout.queue) - 1) as u32,
                queue_capacity: queue_capacity as u32,
                fault: None,
                clock: Clock::at(0, u32::MAX),
                layout,
                starts: starts_of::<R>(&tables),
                arena,
                verified,
                next_step: Step::Rest,
                visit: if !SMALL && layout.regions <= WORD_BITS {
                    Step::Near
                } else {
                    Step::Far
                },
            })
        } else {
            Err(ArenaTooSmall {
                verified,
                arena,
                needed_words,
            })
        };
        if let Ok(machine) = &mut made {
            let slot = machine.record(Section::Slots, interpreter_slot);
            machine.period_us = machine.word_of(R::ahead(slot, slot::PERIOD.offset()));
            if let Some(used) = machine.arena.get_mut(..needed_words) {
                used.fill(0);
            }
            for region in 0..layout.regions {
                let record = machine.record(Section::RegionInstances, region);
                let initial = machine.field(record, region_instance::INITIAL);
                machine.set_current(region, initial);
            }
            machine.start_regions(0, layout.regions);
        }
        made
    }

    /// The same machine with another time between its macro steps than the period of the interpreter's slot, as a simulation may
    /// ask for. To be called before the first macro step; a robot's time comes from its slots.
    #[must_use]
    pub fn with_period_us(self, period_us: u32) -> Self {
        Self { period_us, ..self }
    }

    /// Lets occurrences of the interpreter's slot pass that were missed: time and number of the next macro step move on, to [`MAX_STEPS`] at most. No more macro steps pass
    /// beyond that: so no counter of them wraps, and timers run out as they do after any other wait.
    pub fn skip(&mut self, missed: u32) {
        let rest = MAX_STEPS.saturating_sub(self.clock.begun());
        let missed = u32::try_from(rest).map_or(missed, |rest| missed.min(rest));
        if !self.clock.skip(missed) {
            self.age_timers(missed);
            self.clock = Clock::at(self.clock.begun() + u64::from(missed), 1);
        }
    }

    /// Runs one macro step. Its time is its number times the period of the interpreter's slot.
    ///
    /// # Errors
    /// The fault that stopped the machine, in this macro step or before.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    pub fn macro_step(&mut self, observer: &mut impl Observer) -> Result<StepSummary, Fault> {
        let step = self.clock.begin();
        if self.clock.steps_left() == 0 {
            self.run_timers()?;
        }
        let mut summary = StepSummary {
            step,
            period_us: self.period_us,
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
        self.clock.steps_left() == 1 && self.fault.is_none()
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
        let place = task_instance / WORD_BITS;
        let word = Checked::load(self.arena, self.layout.enabled, place);
        task_instance < self.layout.tasks && word >> (task_instance % WORD_BITS) & 1 != 0
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
        R::ahead(self.starts[section as usize], record_bytes(section) * index)
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
        self.load(self.parts.active, 2 * word + ACTIVE)
    }

    #[cfg_attr(not(small), inline(always))]
    fn is_active_at(&self, region: usize) -> bool {
        self.active(region / WORD_BITS) & bit_of(region) != 0
    }

    #[inline(always)]
    fn set_active(&mut self, word: usize, active: u32) {
        self.store(self.parts.active, 2 * word + ACTIVE, active);
    }

    /// Who is awake of a word of region instances.
    #[inline(always)]
    fn awake(&self, word: usize) -> u32 {
        self.load(self.parts.active, 2 * word + AWAKE)
    }

    #[inline(always)]
    fn set_awake(&mut self, word: usize, awake: u32) {
        self.store(self.parts.active, 2 * word + AWAKE, awake);
    }

    /// The next region instance that is not inside this one.
    #[inline(always)]
    fn next(&self, region: usize) -> usize {
        let record = self.record(Section::RegionInstances, region);
        self.field(record, region_instance::NEXT)
    }

    /// The first own flag of a state in a region instance.
    #[inline(always)]
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

    /// Makes a [`Mark`] at some region instances.
    #[inline(never)]
    fn mark_all(&mut self, regions: Range<usize>, mark: Mark) {
        let Range { start: mut at, end } = regions;
        let (which, value) = (mark & 1, 0u32.wrapping_sub(mark as u32 >> 1));
        while at < end {
            let place = 2 * (at / WORD_BITS) + which;
            let mut those = from_place(at);
            at |= WORD_BITS - 1;
            if end <= at {
                those &= !from_place(end);
            }
            at += 1;
            let word = self.load(self.parts.active, place);
            self.store(self.parts.active, place, word ^ (word ^ value) & those);
        }
    }

    /// The same at one region instance.
    #[inline(always)]
    fn mark(&mut self, region: usize, mark: Mark) {
        self.mark_all(region..region + 1, mark);
    }

    #[inline(always)]
    fn wake(&mut self, region: usize) {
        if SMALL {
            return self.mark(region, SET_AWAKE);
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

    /// The first transition on an event, the pulse among them, whose guard is true, out of the current state of a region instance. After the pulse that sleeps, if its guards allow;
    /// [`Self::make_current`] wakes it.
    #[inline(always)]
    fn find(&mut self, event: u16, here: Here<R::Place>) -> Option<R::Place> {
        let Here { region, current } = here;
        let mut first = self.field(current, state::FIRST_TRANSITION);
        let mut end = self.field(current, state::FIRST_EVENT_TRANSITION);
        if event == format::PULSE {
            self.put_to_sleep(region);
        } else {
            if self.events(current) >> (u32::from(event) % u32::BITS) & 1 == 0 {
                return None;
            }
            first = end;
            // `final` has no transitions, so a state that has some is not the last.
            let after = R::ahead(current, record_bytes(Section::States));
            end = self.field(after, state::FIRST_TRANSITION);
        }
        let mut at = self.record(Section::Transitions, first);
        let end = self.record(Section::Transitions, end);
        while at != end {
            // Without the mark, which is in the highest bit.
            let differs = self.field(at, transition::EVENT) as u16 ^ event;
            if differs << 1 == 0 && self.is_true(self.field(at, transition::GUARD), region, current)
            {
                return Some(at);
            }
            at = R::ahead(at, TRANSITION_BYTES);
        }
        None
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
        let words = self.field(sent, channel::REGION_WORDS);
        if words == 0 {
            return true;
        }
        let event = self.field(sent, channel::EVENT) as u16;
        let waits = 1 << (u32::from(event) % u32::BITS);
        let row = self.field(sent, channel::FIRST_ROW_WORD);
        let row = self.record(Section::Listeners, row);
        let word = if NEAR {
            0
        } else {
            self.field(sent, channel::FIRST_REGION_WORD)
        };
        let mut left = Listening {
            visit: self.active(word) & self.word_of(row),
            word,
            words,
            row,
        };
        loop {
            let here = if NEAR {
                if left.visit == 0 {
                    return true;
                }
                let offset = left.visit.leading_zeros();
                left.visit &= !(FIRST >> offset);
                let here = self.here(0, offset);
                if self.events(here.current) & waits == 0 {
                    continue;
                }
                here
            } else {
                let region = self.next_waiting(&mut left, waits);
                if region == NOBODY {
                    return true;
                }
                Here {
                    region,
                    current: self.current_record(region),
                }
            };
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
                let ahead = behind / WORD_BITS - left.word;
                if ahead >= if NEAR { 1 } else { left.words } {
                    return true;
                }
                if !NEAR {
                    left.words -= ahead;
                    left.word += ahead;
                    left.row = R::ahead(left.row, record_bytes(Section::Listeners) * ahead);
                }
                left.visit = self.active(left.word) & self.word_of(left.row) & from_place(behind);
            }
        }
    }

    /// The next region instance that listens and whose current state waits for one of these events, in any word, or [`NOBODY`]. Apart from what is done with it, so that all that this goes
    /// over words and region instances with is at hand.
    #[inline(never)]
    fn next_waiting(&self, left: &mut Listening<R::Place>, waits: u32) -> usize {
        let Listening {
            mut visit,
            mut word,
            mut words,
            mut row,
        } = *left;
        loop {
            let states = R::further(self.parts.current, word * (WORD_BITS / 2));
            while visit != 0 {
                let offset = visit.leading_zeros() as usize;
                visit &= !(FIRST >> offset);
                let current = R::load_half(self.arena, states, offset);
                let current = self.record(Section::States, current.into());
                if self.events(current) & waits != 0 {
                    *left = Listening {
                        visit,
                        word,
                        words,
                        row,
                    };
                    return WORD_BITS * word + offset;
                }
            }
            words -= 1;
            if words == 0 {
                return NOBODY;
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
        self.clock.look_in(1);
        fault
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
        let first = self.field(current, state::FIRST_TRANSITION);
        let end = self.field(current, state::FIRST_EVENT_TRANSITION);
        let mut at = self.record(Section::Transitions, first);
        let end = self.record(Section::Transitions, end);
        let flags = self.first_flag(region, current);
        let window: Window = Window::of(R::window(self.arena, self.parts.flags, flags));
        let row = self.field(current, state::B);
        let has_timeout =
            self.field(current, state::SHAPE) & usize::from(format::STATE_HAS_TIMEOUT) != 0;
        if row != 0 && !has_timeout {
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
            return self.mark(region, SET_ASLEEP);
        }
        let word = region / WORD_BITS;
        self.set_awake(word, self.awake(word) & !bit_of(region));
    }

    /// Makes a state the current one of its region instance, which wakes if the state has transitions on the pulse.
    #[cfg_attr(not(small), inline(always))]
    #[cfg_attr(small, inline(never))]
    fn make_current(&mut self, region: usize, target: usize) {
        self.set_current(region, target);
        let events = self.events(self.record(Section::States, target)) as usize;
        if SMALL {
            // Whoever woke it before, there is nothing else to do on the pulse.
            return self.mark(region, SET_ASLEEP | (events & 1) << 1);
        }
        if events & 1 != 0 {
            self.wake(region);
        }
    }

    /// A guard of any form.
    #[cfg_attr(not(small), inline(never))]
    #[cfg_attr(small, inline(always))]
    fn is_true(&mut self, guard: usize, region: usize, current: R::Place) -> bool {
        let here = self.record(Section::RegionInstances, region);
        let first_flag = self.field(here, region_instance::FIRST_FLAG);
        let own = first_flag + self.field(current, state::FIRST_FLAG);
        let flags = R::window(self.arena, self.parts.flags, own);
        if guard < usize::from(format::GUARD_PROGRAM) {
            if SMALL {
                return is_bit_right(flags, guard);
            }
            let window: Window = Window::of(flags);
            return window.holds(guard);
        }
        if guard >= usize::from(format::GUARD_MASK) {
            let at = self.record(Section::Code, guard % usize::from(format::GUARD_MASK));
            let (mask, value) = halves(self.word_of(at));
            return (flags as u16 ^ value) & mask == 0;
        }
        let mut at = self.record(Section::Code, guard - usize::from(format::GUARD_PROGRAM));
        loop {
            let control = self.field(at, code::CONTROL) as u16;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            let is_set = match operation {
                format::CODE_END => return true,
                format::CODE_JUMP_IF_CLEAR | format::CODE_JUMP_IF_SET => {
                    self.flag_at(first_flag + self.field(at, code::OPERAND))
                }
                // Those that ask for what is busy inside: others are not in guards.
                _ => {
                    // Tasks get busy without waking anyone but their own region.
                    self.wake(region);
                    self.is_busy_within(region)
                }
            };
            // Those that jump if it is set have even numbers.
            let mut ahead = 1;
            if (operation ^ u16::from(is_set)) & 1 != 0 {
                ahead = usize::from(control & format::CODE_LOW_MASK);
                if ahead == 0 {
                    return false;
                }
            }
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
        if !SMALL && action & format::ACTION_SEND != 0 {
            let first_channel = self.field(instance, instance::FIRST_CHANNEL);
            if !self.send_apart(first_channel + usize::from(action & !format::ACTION_SEND)) {
                return NOT_TAKEN;
            }
        } else if action != format::ACTION_NONE {
            match self.act(action, here, entered) {
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

    /// Carries out a row of actions of a transition in the region instance with the record `here` to the state with the record `entered`; compiled for size, also a single `send`. Says
    /// whether it woke anyone; none if the queue had no room for an event.
    #[inline(never)]
    fn act(&mut self, action: u16, here: R::Place, entered: R::Place) -> Option<bool> {
        let mut is_wide = false;
        let first_flag = self.field(here, region_instance::FIRST_FLAG);
        let own = self.field(entered, state::FIRST_FLAG);
        let own_flags = self.field(entered, state::SHAPE) & usize::from(format::STATE_FLAGS_MASK);
        let instance_index = self.field(here, region_instance::INSTANCE);
        let is_row = !SMALL || action & format::ACTION_SEND == 0;
        let first = usize::from(action.wrapping_sub(format::ACTION_ROW));
        let mut at = self.record(Section::Code, first);
        loop {
            let mut operand = usize::from(action & !format::ACTION_SEND);
            // What a row of one `send` ends with.
            let mut control = format::CODE_SEND << format::CODE_OPERATION_SHIFT | 1;
            if is_row {
                operand = self.field(at, code::OPERAND);
                control = self.field(at, code::CONTROL) as u16;
            }
            let operation = control >> format::CODE_OPERATION_SHIFT;
            if operation == format::CODE_SEND {
                let instance = self.record(Section::Instances, instance_index);
                let channel = self.field(instance, instance::FIRST_CHANNEL) + operand;
                if !self.send_apart(channel) {
                    return None;
                }
            } else {
                self.set_flag_to(first_flag + operand, operation == format::CODE_SET);
                // Own flags of the state that is entered are looked at by nobody else.
                if operand.wrapping_sub(own) >= own_flags {
                    self.wake_instance(instance_index);
                    is_wide = !SMALL;
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

    #[cfg_attr(not(small), inline(never))]
    fn wake_all(&mut self, regions: Range<usize>) {
        self.mark_all(regions, SET_AWAKE);
        if !SMALL {
            self.next_step = self.visit;
        }
    }

    /// Ends what is inside the superstate of a region instance, a container instance.
    #[cfg_attr(not(small), inline(never))]
    fn leave_regions<O: Observer>(&mut self, region: usize, inside: usize, observer: &mut O) {
        let instance = self.record(Section::Instances, inside);
        let content = self.field(instance, instance::CONTAINER);
        let content = self.record(Section::Containers, content);
        let first_task = self.field(instance, instance::FIRST_TASK);
        let tasks = self.field(content, container::TASK_SPAN);
        self.disable_real_time(first_task..first_task + tasks, observer);
        self.mark_all(region + 1..self.next(region), SET_INACTIVE);
    }

    /// Starts the region instances of a container instance, of which the first is `first`, and all are before `end`.
    #[inline(never)]
    fn start_regions(&mut self, first: usize, end: usize) {
        let mut at = first;
        while at < end {
            let record = self.record(Section::RegionInstances, at);
            let initial = self.field(record, region_instance::INITIAL);
            if SMALL {
                self.mark(at, SET_ACTIVE);
            } else {
                let word = at / WORD_BITS;
                self.set_active(word, self.active(word) | bit_of(at));
                // It may have been woken when it was not active.
                self.put_to_sleep(at);
            }
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

/// Timers.
///
/// A state's age is the number of macro steps since the one in which it was entered. Until its timeout flag is set, it is at most one above the highest at which the state is
/// not overdue, which fits in 32 bits. Macro steps that are skipped are added by [`Self::age_timers`].
impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
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
        self.store(self.parts.entered, region, self.clock.now());
        let steps = self.clock.steps_left().min(self.limit(entered) + 1);
        self.clock.look_in(steps);
    }

    /// The timer of the current state of a region instance, if that is active and its timer runs.
    #[cfg_attr(not(small), inline(always))]
    fn timer(&self, region: usize) -> Option<Timer> {
        let current = self.current_record(region);
        let shape = self.field(current, state::SHAPE) as u16;
        if shape & format::STATE_HAS_TIMEOUT == 0 || !self.is_active_at(region) {
            return None;
        }
        let of_simple = shape >> format::STATE_KIND_SHIFT == format::STATE_SIMPLE;
        let own = self.first_flag(region, current);
        let flag = own + if of_simple { 0 } else { format::FLAG_TIMEOUT };
        let entered = self.load(self.parts.entered, region);
        (!self.flag_at(flag)).then(|| Timer {
            flag,
            age: self.clock.now().wrapping_sub(entered),
            limit: self.limit(current),
        })
    }

    /// Sets the flag of each timer that has run out, and wakes its region instance, with all inside, for whom that is a flag of their instance; finds out when the next may be. A
    /// machine that was stopped has its last macro step again and again, so that no other has to look for its fault.
    #[cold]
    #[cfg_attr(not(small), inline(never))]
    #[cfg_attr(small, inline(always))]
    fn run_timers(&mut self) -> Result<(), Fault> {
        if let Some(fault) = self.fault {
            self.clock.look_in(1);
            return Err(fault);
        }
        let mut steps = u32::MAX;
        for region in 0..self.layout.regions {
            let Some(timer) = self.timer(region) else {
                continue;
            };
            match timer.limit.checked_sub(timer.age) {
                Some(left) => steps = steps.min(left + 1),
                None => {
                    self.set_flag_to(timer.flag, true);
                    self.wake_all(region..self.next(region));
                }
            }
        }
        self.clock.look_in(steps);
        Ok(())
    }

    /// Lets the timers of states run out that will be overdue when more macro steps have passed. Their true ages might not fit.
    #[cold]
    #[inline(never)]
    fn age_timers(&mut self, missed: u32) {
        let next = (self.clock.begun() as u32).wrapping_add(missed);
        for region in 0..self.layout.regions {
            if let Some(Timer { age, limit, .. }) = self.timer(region)
                && limit.saturating_sub(age) <= missed
            {
                let entered = next.wrapping_sub(limit + 1);
                self.store(self.parts.entered, region, entered);
            }
        }
    }
}

/// The low and the high half of a word.
fn halves(word: u32) -> (u16, u16) {
    (word as u16, (word >> 16) as u16)
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
