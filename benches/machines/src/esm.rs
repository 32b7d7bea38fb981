//! The player as a mission that the interpreter runs. A button is a flag of the panel's task: the
//! pulse turns it into an event, and the event moves the player, both in one macro step.

use core::hint;

use esm_core::tables::TaskPlaces;
use esm_core::{Interpreter, Observer, TransitionTaken};

use crate::{Button, Counters, Player};

/// Transitions that are told apart: those whose places leave the same remainder are counted
/// together.
pub const TRANSITIONS: usize = 64;

/// Counts of transitions, by their place in the mission's tables.
pub type TransitionCounters = Counters<TRANSITIONS>;

/// Counts the transitions that the interpreter takes.
pub struct Count<'c>(pub &'c TransitionCounters);

impl Observer for Count<'_> {
    #[inline(always)]
    fn transition(&mut self, taken: TransitionTaken) {
        self.0.count(usize::from(taken.transition) % TRANSITIONS);
    }
}

/// The task state whose flags are set from outside: each mission here has it as its first.
pub const PANEL: usize = 0;

/// The player.
pub struct Machine<'m, 'c> {
    interpreter: Interpreter<'m, &'m [u8]>,
    /// Found when the mission was taken, as a firmware does it for each of its tasks.
    panel: TaskPlaces,
    counters: &'c TransitionCounters,
}

impl<'m, 'c> Machine<'m, 'c> {
    /// The machine that `interpreter` runs.
    #[must_use]
    pub fn new(interpreter: Interpreter<'m, &'m [u8]>, counters: &'c TransitionCounters) -> Self {
        let panel = interpreter.tables().task_places(PANEL).unwrap_or_default();
        Self {
            interpreter,
            // Not to be computed while this is compiled.
            panel: hint::black_box(panel),
            counters,
        }
    }

    /// Sets a flag of the panel, or clears it.
    #[inline(always)]
    pub fn set(&mut self, flag: usize, value: bool) {
        // As an executor has it: a bit for each flag that its task wrote, and one for each it set.
        let written = (1_u32 << flag) as u16;
        let values = if value { written } else { 0 };
        self.interpreter.set_flags_at(&self.panel, written, values);
    }

    /// One macro step.
    #[inline(never)]
    pub fn step(&mut self) {
        // A fault shows in the counts.
        let _ = self.interpreter.macro_step(&mut Count(self.counters));
    }
}

impl Player for Machine<'_, '_> {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        self.set(button as usize, true);
        self.step();
    }
}
