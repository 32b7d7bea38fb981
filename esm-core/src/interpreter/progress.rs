//! All that a machine is between two macro steps, to be kept and taken up again: words of its arena and a few numbers.
//!
//! The words are the arena's up to the event queue, which is empty then. What entered a machine from outside since its last macro step is what differs in
//! [`Interpreter::input_words`]: the flags and, behind them, the enable bits. [`Interpreter::toggle_input`] does it again.

use core::ops::Deref;

use super::clock::Clock;
use super::{Fault, Interpreter, SMALL, Step, WORD_BITS, bit_of};
use crate::reads::access::Access;
use crate::reads::{Checked, Reads};
use crate::tables::Tables;
use crate::verify::Verified;

/// What a machine is between two macro steps, beside the words of its arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Macro steps that began, or were skipped. At most [`MAX_STEPS`].
    pub steps: u64,
    /// Macro steps until the timers are looked at, that one included; 0 stands for 1.
    pub steps_left: u32,
    /// Whether the next pulse visits anyone.
    pub is_awake: bool,
    /// The fault that stopped the machine.
    pub fault: Option<Fault>,
}

/// The most macro steps that a machine can be taken up after: nine thousand years at 1 kHz.
pub const MAX_STEPS: u64 = 1 << 48;

/// Why a machine cannot be taken up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResumeError {
    /// The arena that was lent has not this many words.
    ArenaTooSmall {
        /// Words that the blob needs.
        needed_words: usize,
    },
    /// The machine of this blob has another number of words.
    OtherLength {
        /// Its words.
        expected_words: usize,
    },
    /// More than [`MAX_STEPS`].
    TooManySteps,
    /// The current state of this region instance is none of its region.
    NoSuchState {
        /// The region instance.
        region_instance: usize,
    },
}

impl<'m, B: Deref<Target = [u8]>, R: Access> Interpreter<'m, B, R> {
    /// What it is, beside [`Self::state_words`]. Between macro steps only.
    pub fn progress(&self) -> Progress {
        Progress {
            steps: self.clock.begun(),
            steps_left: self.clock.steps_left(),
            // Compiled for size, none keeps account of it: it looks who is awake.
            is_awake: SMALL || self.next_step != Step::Rest,
            fault: self.fault,
        }
    }

    /// The words that [`Interpreter::resume`] takes.
    pub fn state_words(&self) -> &[u32] {
        self.part(0..self.layout.queue)
    }

    /// All flags, the first in the lowest bit of the first word, and from the next whole word on the enable bits of the task instances.
    pub fn input_words(&self) -> &[u32] {
        self.part(self.layout.flags..self.layout.entered)
    }

    /// Whether this machine is what another was, of which these were taken. Who is awake is left out: a machine of which a flag was set and reset between two macro steps has someone awake
    /// who finds nothing to do.
    pub fn is_like(&self, words: &[u32], progress: &Progress) -> bool {
        let own = self.state_words();
        let awake = |place: usize| {
            place
                .checked_sub(self.layout.active)
                .is_some_and(|place| place % 2 != 0)
                && place < self.layout.flags
        };
        own.len() == words.len()
            && (own.iter().zip(words).enumerate()).all(|(place, (a, b))| a == b || awake(place))
            && self.progress().steps == progress.steps
            && self.fault == progress.fault
    }

    /// The bits of [`Self::input_words`], ascending, in which this machine and the one that `words` were taken of differ.
    pub fn inputs_unlike<'a>(&'a self, words: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
        let others = words
            .get(self.layout.flags..self.layout.entered)
            .unwrap_or_default();
        let pairs = self.input_words().iter().zip(others).enumerate();
        pairs.flat_map(|(place, (own, other))| {
            let differs = own ^ other;
            (0..WORD_BITS)
                .filter(move |bit| differs >> bit & 1 != 0)
                .map(move |bit| place * WORD_BITS + bit)
        })
    }

    /// For each region instance the low 32 bits of the number of the macro step in which its state was entered, if that has a timeout; a state that was overdue while macro steps
    /// were skipped counts as entered just so long ago.
    pub fn entered_words(&self) -> &[u32] {
        self.part(self.layout.entered..self.layout.queue)
    }

    /// Where the enable bits begin in [`Self::input_words`], in bits.
    pub fn first_enable_bit(&self) -> usize {
        WORD_BITS * (self.layout.enabled - self.layout.flags)
    }
}

impl<'m, B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'m, B, R> {
    /// A machine as it was when `words` and `progress` were taken from it; it goes on as that one did. The words may come from anywhere.
    ///
    /// # Errors
    /// Why these are no words of such a machine.
    pub fn resume(
        verified: Verified<B>,
        arena: &'m mut [u32],
        words: &[u32],
        progress: Progress,
    ) -> Result<Self, ResumeError> {
        let mut machine = Self::with_reads(verified, arena).map_err(|refusal| {
            let needed_words = refusal.needed_words;
            ResumeError::ArenaTooSmall { needed_words }
        })?;
        let expected_words = machine.layout.queue;
        if words.len() != expected_words {
            return Err(ResumeError::OtherLength { expected_words });
        }
        if progress.steps > MAX_STEPS {
            return Err(ResumeError::TooManySteps);
        }
        if let Some(region_instance) = find_wrong_state(&machine.verified.tables(), words) {
            return Err(ResumeError::NoSuchState { region_instance });
        }
        for (place, word) in machine.arena.iter_mut().zip(words) {
            *place = *word;
        }
        machine.find_active();
        machine.fault = progress.fault;
        // A machine that was stopped says so in its next macro step.
        let steps_left = match progress.fault {
            Some(_) => 1,
            None => progress.steps_left.max(1),
        };
        machine.clock = Clock::at(progress.steps, steps_left);
        machine.next_step = if progress.is_awake {
            machine.visit
        } else {
            Step::Rest
        };
        Ok(machine)
    }

    /// Who is active follows from the current states.
    fn find_active(&mut self) {
        let mut next_active = 0;
        for region in 0..self.layout.regions {
            let word = region / WORD_BITS;
            let others = self.active(word) & !bit_of(region);
            let is_active = region == next_active;
            let own = if is_active { bit_of(region) } else { 0 };
            self.set_active(word, others | own);
            if is_active {
                let current = self.current(region);
                let inside = self.tables().first_region_inside(region, current);
                next_active = inside.unwrap_or_else(|| self.next(region));
            }
        }
    }

    /// Turns a bit of [`Self::input_words`] over, as a task or the end of a slot-0 run did. False, and nothing changes, if it is no flag of a task and no
    /// enable bit. Between macro steps only.
    pub fn toggle_input(&mut self, bit: usize) -> bool {
        if let Some(task) = bit.checked_sub(self.first_enable_bit()) {
            if task >= self.layout.tasks {
                return false;
            }
            if !self.disable(task) {
                self.enable(task);
            }
            return true;
        }
        let Some(region) = self.region_of_task_flag(bit) else {
            return false;
        };
        let value = !self.flag(bit);
        self.write_flag(bit, region, value);
        true
    }

    /// The region instance of the task that a flag is of. Instances take flags and tasks in the same order, so that the flags
    /// of tasks ascend: the task is the last whose flags do not begin behind the flag.
    fn region_of_task_flag(&self, bit: usize) -> Option<usize> {
        let tables = self.verified.tables();
        let (mut first, mut end) = (0, self.layout.tasks);
        // Each turn halves what is left.
        while end - first > 1 {
            let middle = first + (end - first) / 2;
            match usize::from(tables.task_places(middle)?.first_flag) <= bit {
                true => first = middle,
                false => end = middle,
            }
        }
        let places = tables.task_places(first)?;
        let own = usize::from(places.first_flag);
        (own..own + usize::from(places.flags))
            .contains(&bit)
            .then(|| usize::from(places.region))
    }
}

/// The first region instance whose current state, in the words of an arena, is none of its region.
fn find_wrong_state(tables: &Tables<'_>, words: &[u32]) -> Option<usize> {
    (0..tables.region_instance_count()).find(|region| {
        let current = usize::from(Checked::load_half(words, 0, *region));
        let initial = tables.region_instance(*region).map(|it| it.initial);
        let is_of_region = current < tables.state_count()
            && initial.is_some_and(|initial| {
                tables.region_of_state(current) == tables.region_of_state(initial)
            });
        !is_of_region
    })
}
