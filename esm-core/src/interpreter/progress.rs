//! All that a machine is between two macro steps, to be kept and taken up again: words of its arena
//! and a few numbers.
//!
//! The words are the arena's up to the event queue, which is empty then. What entered a machine
//! from outside since its last macro step is what differs in
//! [`Interpreter::input_words`](super::Interpreter::input_words): the flags and, behind them, the
//! enable bits. [`Interpreter::toggle_input`](super::Interpreter::toggle_input) does it again.

use super::clock::Clock;
use super::events::Fault;
use super::machine::{Here, Machine, Mark};
use crate::arena::WORD_BITS;
use crate::reads::{Checked, access::Access};
use crate::tables::Tables;

/// What a machine is between two macro steps, beside the words of its arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Macro steps that began, or were skipped. At most `MAX_STEPS`.
    pub steps: u64,
    /// Macro steps until the timers are looked at, that one included; 0 stands for 1.
    pub steps_left: u32,
    /// Whether the next pulse visits anyone.
    pub is_awake: bool,
    /// The fault that stopped the machine.
    pub fault: Option<Fault>,
}

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
    /// More than `MAX_STEPS`.
    TooManySteps,
    /// The current state of this region instance is none of its region.
    NoSuchState {
        /// The region instance.
        region_instance: usize,
    },
}

impl<R: Access> Machine<'_, R> {
    /// What it is, beside the words of its arena.
    pub(super) fn progress(&self) -> Progress {
        let mut words = (0..self.layout.regions).step_by(WORD_BITS);
        let is_awake = words.any(|region| {
            let marks = self.word_of(region).marks;
            self.marked(marks, Mark::Active) & self.marked(marks, Mark::Awake) != 0
        });
        Progress {
            steps: self.clock.begun(),
            steps_left: self.clock.steps_left(),
            is_awake,
            fault: self.fault,
        }
    }

    /// Whether a word of the arena says who is awake.
    pub(super) fn says_who_is_awake(&self, word: usize) -> bool {
        let from_active = word.checked_sub(self.layout.active);
        word < self.layout.flags && from_active.is_some_and(|word| word % 2 == Mark::Awake as usize)
    }

    /// Goes on as the machine of which these were taken. They were looked at.
    pub(super) fn take_up(&mut self, tables: &Tables<'_>, words: &[u32], progress: Progress) {
        for (place, word) in self.arena.iter_mut().zip(words) {
            *place = *word;
        }
        self.find_active(tables);
        self.fault = progress.fault;
        // A machine that was stopped says so in its next macro step.
        let steps_left = match progress.fault {
            Some(_) => 1,
            None => progress.steps_left.max(1),
        };
        self.clock = Clock::at(progress.steps, steps_left);
    }

    /// Who is active follows from the current states.
    fn find_active(&mut self, tables: &Tables<'_>) {
        let mut next_active = 0;
        for region in 0..self.layout.regions {
            let Here { bit, marks, .. } = self.here(region);
            let others = self.marked(marks, Mark::Active) & !bit;
            let is_active = region == next_active;
            let own = if is_active { bit } else { 0 };
            self.set_marked(marks, Mark::Active, others | own);
            if is_active {
                let inside = tables.first_region_inside(region, self.current(region));
                let next = || tables.region_instance(region).map_or(0, |it| it.next);
                next_active = inside.unwrap_or_else(next);
            }
        }
    }

    /// The same as [`Interpreter::toggle_input`](super::Interpreter::toggle_input).
    pub(super) fn toggle_input(&mut self, tables: &Tables<'_>, bit: usize) -> bool {
        if let Some(task) = bit.checked_sub(self.layout.flag_bits) {
            if task >= self.layout.tasks {
                return false;
            }
            if !self.disable(task) {
                self.enable(task);
            }
            return true;
        }
        let Some(region) = region_of_task_flag(tables, self.layout.tasks, bit) else {
            return false;
        };
        self.write_flag(bit, region, !self.flag(bit));
        true
    }
}

/// The region instance of the task that a flag is of. Instances take flags and tasks in the same
/// order, so that the flags of tasks ascend: the task is the last whose flags do not begin behind
/// the flag.
fn region_of_task_flag(tables: &Tables<'_>, tasks: usize, bit: usize) -> Option<usize> {
    let (mut first, mut end) = (0, tasks);
    // Each turn halves what is left.
    while end - first > 1 {
        let middle = first + (end - first) / 2;
        match usize::from(tables.task_places(middle)?.first_flag) <= bit {
            true => first = middle,
            false => end = middle,
        }
    }
    let (own, flags) = tables.flags_of_task(first)?;
    (own..own + flags)
        .contains(&bit)
        .then(|| tables.task_instance(first).map(|it| it.region))?
}

/// The first region instance whose current state, in the words of an arena, is none of its region.
pub(super) fn find_wrong_state(tables: &Tables<'_>, words: &[u32]) -> Option<usize> {
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
