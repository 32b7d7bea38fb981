//! The number of macro steps, and how many pass until timers are looked at.

/// The time of a machine, in macro steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    /// How many macro steps will have begun, or been skipped, when timers are looked at: so a macro
    /// step writes one word here, and not three.
    at_look: u64,
    /// Macro steps until a timer may have run out, that one included. A machine that was stopped
    /// has none left but the next.
    steps_left: u32,
}

impl Clock {
    /// So many macro steps began, or were skipped, and timers are looked at so many later.
    pub(super) fn at(begun: u64, steps_left: u32) -> Self {
        Self {
            at_look: begun + u64::from(steps_left),
            steps_left,
        }
    }

    /// Macro steps that began, or were skipped.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn begun(&self) -> u64 {
        self.at_look - u64::from(self.steps_left)
    }

    pub(super) fn steps_left(&self) -> u32 {
        self.steps_left
    }

    /// The low bits of the number of the last macro step that began.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn now(&self) -> u32 {
        (self.begun() as u32).wrapping_sub(1)
    }

    /// Begins a macro step. Returns whether timers are to be looked at in it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn begin(&mut self) -> bool {
        self.steps_left -= 1;
        self.steps_left == 0
    }

    /// Looks at timers in the macro step that comes so many after the last that began.
    pub(super) fn look_in(&mut self, steps: u32) {
        *self = Self::at(self.begun(), steps);
    }

    /// Skips macro steps, none of which would have looked at timers. False, and nothing changes, if
    /// one would have.
    pub(super) fn skip(&mut self, missed: u32) -> bool {
        let skips = missed < self.steps_left;
        if skips {
            self.steps_left -= missed;
        }
        skips
    }
}
