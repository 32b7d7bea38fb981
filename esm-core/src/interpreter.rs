//! The interpreter: what a machine does, once, for firmware and host.
//!
//! It keeps its state in an arena of 32-bit words that the caller lends it. Everything else is read
//! from the blob, at bytes of it, by [reads](crate::reads) that need not check them again. That
//! every loop ends is what [`verify`](crate::verify()) proved.
//!
//! Who is visited in a macro step, and in which order, is said in [`walk`]; what a transition does,
//! in [`transitions`]; when a state is overdue, in [`timers`].

mod clock;
mod events;
mod guards;
mod machine;
mod migration;
mod progress;
mod timers;
mod transitions;
mod walk;

use core::ops::{Deref, Range};

use crate::arena::WORD_BITS;
use crate::format::{self, Section};
use crate::layout;
use crate::reads::{DefaultReads, Reads, access::Access};
use crate::state_mapping::StateMapping;
use crate::tables::{Tables, TaskPlaces};
use crate::verify::Verified;

use machine::{Machine, Mark};
use walk::Ended;

pub use events::{Fault, MAX_MICRO_STEPS, Observer, StepSummary, TransitionTaken};
pub use migration::TakenOver;
pub use progress::{Progress, ResumeError};
pub use timers::MAX_STEPS;

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

/// A machine that runs. `R` says how it reads its tables: see [`Reads`].
#[derive(Debug)]
pub struct Interpreter<'m, B, R: Access = DefaultReads> {
    machine: Machine<'m, R>,
    verified: Verified<B>,
}

/// Making one.
impl<'m, B> Interpreter<'m, B>
where
    B: Deref<Target = [u8]>,
    DefaultReads: Reads<B>,
{
    /// A machine before its first macro step: all regions in `initial`, all flags reset, no task
    /// enabled.
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

    /// The same as [`Interpreter::new`] where the arena is known to be large enough. If it is not
    /// there is none, and the blob is lost. It takes less of the stack, for there is nothing to
    /// give back.
    #[inline]
    #[must_use]
    pub fn in_arena(verified: Verified<B>, arena: &'m mut [u32]) -> Option<Self> {
        if arena.len() < verified.arena_words() {
            return None;
        }
        let machine = Machine::new(&verified.tables(), arena);
        Some(Self { machine, verified })
    }
}

impl<'m, B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'m, B, R> {
    /// The same as [`Interpreter::new`], for other reads than those of most machines:
    /// `Interpreter::<_, Checked>::with_reads(…)`.
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
        let needed_words = verified.arena_words();
        if arena.len() < needed_words {
            return Err(ArenaTooSmall {
                needed_words,
                verified,
                arena,
            });
        }
        let machine = Machine::new(&verified.tables(), arena);
        Ok(Self { machine, verified })
    }

    /// The same machine with another time between its macro steps than the period of the
    /// interpreter's slot, as a simulation may ask for. To be called before the first macro step; a
    /// robot's time comes from its slots.
    #[must_use]
    pub fn with_period_us(mut self, period_us: u32) -> Self {
        self.machine.period_us = period_us;
        self
    }

    /// Gives blob and arena back.
    pub fn into_parts(self) -> (Verified<B>, &'m mut [u32]) {
        (self.verified, self.machine.arena)
    }
}

/// What moves it on.
impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Runs one macro step. Its time is its number times the period of the interpreter's slot.
    ///
    /// # Errors
    /// The fault that stopped the machine, in this macro step or before.
    // What of the summary is not asked for is not worked out.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn macro_step(&mut self, observer: &mut impl Observer) -> Result<StepSummary, Fault> {
        let blob = R::blob(self.verified.tables().bytes());
        let machine = &mut self.machine;
        let ended = if machine.clock.begin() {
            machine.walk_after_timers(blob, observer)
        } else if machine.is_awake() {
            machine.walk(blob, observer)
        } else {
            Ended::Resting
        };
        let (micro_steps, changed) = match ended {
            Ended::Resting => (1, false),
            Ended::Walked => (machine.taken as u8 + 1, machine.changed),
            Ended::Stopped(fault) => return Err(fault),
        };
        Ok(StepSummary {
            step: machine.clock.begun() - 1,
            period_us: machine.period_us,
            micro_steps,
            changed,
            finished: machine.flag_at(format::FLAG_EXIT),
        })
    }

    /// Changes a control flag of a task instance, by its place in the signature. Between macro
    /// steps only.
    pub fn set_flag(&mut self, task_instance: usize, flag: usize, value: bool) {
        self.write_task_flag(task_instance, format::TASK_CONTROL_FLAGS + flag, value);
    }

    /// [`set_flag`](Self::set_flag) for the first 16 control flags of the task instance with these
    /// places at once: those whose bit is set in `written` become what it is in `values`. Bits of
    /// flags that the task has not mean nothing.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn set_flags_at(&mut self, places: &TaskPlaces, written: u16, values: u16) {
        let first = usize::from(places.first_flag) + format::TASK_CONTROL_FLAGS;
        let written = written & places.control_flags;
        (self.machine).write_flags(first, places.region, written.into(), values.into());
    }

    /// [`set_busy`](Self::set_busy) of the task instance with these places.
    #[inline(never)]
    pub fn set_busy_at(&mut self, places: &TaskPlaces, busy: bool) {
        let flag = usize::from(places.first_flag) + format::FLAG_BUSY;
        self.machine
            .write_flags(flag, places.region, 1, busy.into());
    }

    /// Changes the busy flag of a task instance. Between macro steps only.
    pub fn set_busy(&mut self, task_instance: usize, busy: bool) {
        self.write_task_flag(task_instance, format::FLAG_BUSY, busy);
    }

    /// A task reports that it is finished: its exit flag is set, its enable bit reset. Between
    /// macro steps only.
    pub fn report_exit(&mut self, task_instance: usize) {
        self.write_task_flag(task_instance, format::FLAG_EXIT, true);
        self.clear_enabled(task_instance);
    }

    fn write_task_flag(&mut self, task: usize, flag: usize, value: bool) {
        let blob = R::blob(self.verified.tables().bytes());
        self.machine.write_task_flag(blob, task, flag, value);
    }
}

impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Resets an enable bit alone: the run of a background task ended after its state was left.
    /// Between macro steps only.
    pub fn clear_enabled(&mut self, task_instance: usize) {
        if task_instance < self.machine.layout.tasks {
            self.machine.disable(task_instance);
        }
    }

    /// Lets activations of the interpreter's slot pass that were missed: time and number of the
    /// next macro step move on, to [`MAX_STEPS`] at most. No more macro steps pass beyond that: so
    /// no counter of them wraps, and timers run out as they do after any other wait.
    pub fn skip(&mut self, missed: u32) {
        let blob = R::blob(self.verified.tables().bytes());
        self.machine.skip(blob, missed);
    }

    /// Takes over what the machine before has in common with this one: states, timers, flags,
    /// enable bits. To be called before the first macro step, between two macro steps of the other,
    /// which goes no further. A machine that stopped by a fault hands over nothing, nor does one
    /// without names.
    ///
    /// `mapping` is what was [found](StateMapping::find) for the tables of both, this machine's
    /// first. That of other machines gives nonsense, but no memory is at risk.
    pub fn take_over(
        &mut self,
        before: &Interpreter<'_, B, R>,
        mapping: &StateMapping<'_>,
    ) -> TakenOver {
        let tables = self.verified.tables();
        let other = (&before.machine, R::blob(before.verified.tables().bytes()));
        let states = tables.state_count();
        (self.machine).take_over(R::blob(tables.bytes()), other, mapping, states)
    }

    /// Whether an active task state inside a superstate is busy: the superstate's busy flag, which
    /// is false unless it is current.
    pub fn is_busy_inside(&self, region_instance: usize, superstate: usize) -> bool {
        let blob = R::blob(self.verified.tables().bytes());
        self.is_current_state(region_instance, superstate)
            && self.machine.is_busy_within(blob, region_instance)
    }
}

/// What it shows of itself.
impl<B: Deref<Target = [u8]>, R: Access> Interpreter<'_, B, R> {
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
        self.machine.fault
    }

    /// Whether a region of the machine has reached `final`.
    pub fn is_finished(&self) -> bool {
        self.flag(format::FLAG_EXIT)
    }

    /// The current state of a region instance, as an index into the tables. It means something only
    /// while the instance [is active](Self::is_active).
    pub fn current(&self, region_instance: usize) -> usize {
        self.machine.current(region_instance)
    }

    /// Whether all superstates around a container instance are current. Takes constant time.
    pub fn is_active(&self, instance: usize) -> bool {
        self.tables()
            .instance(instance)
            .is_some_and(|instance| self.is_region_active(instance.first_region))
    }

    /// Whether all superstates around a region instance are current. Takes constant time.
    pub fn is_region_active(&self, region_instance: usize) -> bool {
        self.machine.is_marked(region_instance, Mark::Active)
    }

    /// Whether the next pulse visits a region instance, if it is active then: for those who count
    /// what a macro step does.
    pub fn is_region_awake(&self, region_instance: usize) -> bool {
        self.machine.is_marked(region_instance, Mark::Awake)
    }

    /// Whether the next macro step looks at all timers: for those who count what a macro step does.
    pub fn looks_at_timers(&self) -> bool {
        self.machine.clock.steps_left() == 1 && self.machine.fault.is_none()
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
        self.machine.is_enabled(task_instance)
    }

    /// The enable bits of all task instances, the first in the lowest bit of the first word.
    pub fn enabled_words(&self) -> &[u32] {
        self.part(self.machine.layout.enabled..self.machine.layout.entered)
    }

    /// A flag by its bit in the whole machine; see [`Tables::flags_of_state`]. The busy bit of a
    /// superstate does not exist: see [`Self::is_busy_inside`].
    pub fn flag(&self, flag: usize) -> bool {
        self.machine.flag(flag)
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

    /// The first 16 control flags of the task instance with these places, the first in the lowest
    /// bit.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn control_flags_at(&self, places: &TaskPlaces) -> u16 {
        let first = usize::from(places.first_flag) + format::TASK_CONTROL_FLAGS;
        // Places need not come from this machine's tables. Behind the flags other words follow: so
        // a window that begins in them is in the arena.
        if first >= self.machine.layout.flag_bits {
            return 0;
        }
        let flags = R::window(self.machine.arena, self.machine.places.flags, first);
        flags as u16 & places.control_flags
    }

    /// Finds the values of parameters of the task instance with these places, from the first one
    /// on. Where there are not so many, all are left.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn params_at(&self, places: &TaskPlaces, values: &mut [u32]) {
        let tables = self.verified.tables();
        let first = usize::from(places.first_param);
        // Places need not come from this machine's tables.
        if first + values.len() > tables.count(Section::Params) {
            return;
        }
        let blob = R::blob(tables.bytes());
        let param_bytes = size_of::<layout::Param>();
        let mut place = R::ahead(self.machine.places.params, first * param_bytes);
        for value in values {
            *value = R::word(blob, place);
            place = R::ahead(place, param_bytes);
        }
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

    fn part(&self, words: Range<usize>) -> &[u32] {
        self.machine.words(words)
    }
}

/// What it is between two macro steps, to be kept.
impl<B: Deref<Target = [u8]>, R: Access> Interpreter<'_, B, R> {
    /// What it is, beside [`Self::state_words`]. Between macro steps only.
    pub fn progress(&self) -> Progress {
        self.machine.progress()
    }

    /// The words that [`Interpreter::resume`] takes.
    pub fn state_words(&self) -> &[u32] {
        self.part(0..self.machine.layout.queue)
    }

    /// All flags, the first in the lowest bit of the first word, and from the next whole word on
    /// the enable bits of the task instances.
    pub fn input_words(&self) -> &[u32] {
        self.part(self.machine.layout.flags..self.machine.layout.entered)
    }

    /// Whether this machine is what another was, of which these were taken. Who is awake is left
    /// out: a machine of which a flag was set and reset between two macro steps has someone awake
    /// who finds nothing to do.
    pub fn is_like(&self, words: &[u32], progress: &Progress) -> bool {
        let own = self.state_words();
        own.len() == words.len()
            && (own.iter().zip(words).enumerate())
                .all(|(place, (a, b))| a == b || self.machine.says_who_is_awake(place))
            && self.progress().steps == progress.steps
            && self.fault() == progress.fault
    }

    /// The bits of [`Self::input_words`], ascending, in which this machine and the one that `words`
    /// were taken of differ.
    pub fn inputs_unlike<'a>(&'a self, words: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
        let layout = &self.machine.layout;
        let others = words.get(layout.flags..layout.entered).unwrap_or_default();
        let pairs = self.input_words().iter().zip(others).enumerate();
        pairs.flat_map(|(place, (own, other))| {
            let differs = own ^ other;
            (0..WORD_BITS)
                .filter(move |bit| differs >> bit & 1 != 0)
                .map(move |bit| place * WORD_BITS + bit)
        })
    }

    /// For each region instance the low 32 bits of the number of the macro step in which its state
    /// was entered, if that has a timeout; a state that was overdue while macro steps were skipped
    /// counts as entered just so long ago.
    pub fn entered_words(&self) -> &[u32] {
        self.part(self.machine.layout.entered..self.machine.layout.queue)
    }

    /// Where the enable bits begin in [`Self::input_words`], in bits.
    pub fn first_enable_bit(&self) -> usize {
        self.machine.layout.flag_bits
    }
}

/// Taking up what was kept.
impl<'m, B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'m, B, R> {
    /// A machine as it was when `words` and `progress` were taken from it; it goes on as that one
    /// did. The words may come from anywhere.
    ///
    /// # Errors
    /// Why these are no words of such a machine.
    pub fn resume(
        verified: Verified<B>,
        arena: &'m mut [u32],
        words: &[u32],
        progress: Progress,
    ) -> Result<Self, ResumeError> {
        let mut resumed = Self::with_reads(verified, arena).map_err(|refusal| {
            let needed_words = refusal.needed_words;
            ResumeError::ArenaTooSmall { needed_words }
        })?;
        let expected_words = resumed.machine.layout.queue;
        if words.len() != expected_words {
            return Err(ResumeError::OtherLength { expected_words });
        }
        if progress.steps > MAX_STEPS {
            return Err(ResumeError::TooManySteps);
        }
        let tables = resumed.verified.tables();
        if let Some(region_instance) = progress::find_wrong_state(&tables, words) {
            return Err(ResumeError::NoSuchState { region_instance });
        }
        resumed.machine.take_up(&tables, words, progress);
        Ok(resumed)
    }

    /// Turns a bit of [`Self::input_words`] over, as a task or the end of a background run did.
    /// False, and nothing changes, if it is no flag of a task and no enable bit. Between macro
    /// steps only.
    pub fn toggle_input(&mut self, bit: usize) -> bool {
        self.machine.toggle_input(&self.verified.tables(), bit)
    }
}
