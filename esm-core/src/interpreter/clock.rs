//! The number of macro steps, and how many pass until timers are looked at.

use super::SMALL;

/// The time of a machine, in macro steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// Compiled for size, how many macro steps began, or were skipped. Otherwise how many will have when timers are looked at: so a macro step writes one word here, and not three.
    number: u64,
    /// Macro steps until a timer may have run out, that one included. A machine that was stopped has none left but the next.
    steps_left: u32,
}

impl Clock {
    /// So many macro steps began, or were skipped, and timers are looked at so many later.
    pub(super) fn at(begun: u64, steps_left: u32) -> Self {
        Self {
            number: if SMALL {
                begun
            } else {
                begun + u64::from(steps_left)
            },
            steps_left,
        }
    }

    /// Macro steps that began, or were skipped.
    #[inline(always)]
    pub(super) fn begun(&self) -> u64 {
        if SMALL {
            self.number
        } else {
            self.number - u64::from(self.steps_left)
        }
    }

    pub(super) fn steps_left(&self) -> u32 {
        self.steps_left
    }

    /// The low bits of the number of the last macro step that began.
    pub(super) fn now(&self) -> u32 {
        (self.begun() as u32).wrapping_sub(1)
    }

    /// Begins a macro step and returns its number.
    #[inline(always)]
    pub(super) fn begin(&mut self) -> u64 {
        self.steps_left -= 1;
        if SMALL {
            self.number += 1;
        }
        self.begun() - 1
    }

    /// Looks at timers in the macro step that comes so many after the last that began.
    pub(super) fn look_in(&mut self, steps: u32) {
        if !SMALL {
            self.number = self.begun() + u64::from(steps);
        }
        self.steps_left = steps;
    }

    /// Skips macro steps, none of which would have looked at timers. False, and nothing changes, if one would have.
    pub(super) fn skip(&mut self, missed: u32) -> bool {
        let skips = missed < self.steps_left;
        if skips {
            self.steps_left -= missed;
            if SMALL {
                self.number += u64::from(missed);
            }
        }
        skips
    }
}
