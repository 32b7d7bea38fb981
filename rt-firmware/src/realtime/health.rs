//! What the link reads of the real-time side: its health, told when it has changed and at the end
//! of each macro step.

use super::RealTime;
use super::observers::Present;
use crate::board::microseconds;
use esm_link::message::Mode;
use esm_link::trial;

impl RealTime<'_, '_> {
    /// Counters and mode of a robot before its next mission.
    pub(super) fn begin_health(&mut self) {
        self.observers.begin_health();
        self.safety.go_to(Mode::Empty);
    }

    pub(super) fn tell_health(&mut self) {
        const US_PER_MS: u32 = 1_000;
        let hash = self.machine.hash();
        let robot_us = self.timetable.previous_end_us();
        let trial = self.machine.trial().map(|trial| trial::Trial {
            // Divided as ticks are: a division of 64 bits would take a routine of its own.
            left_ms: microseconds(trial.until_us.saturating_sub(robot_us), US_PER_MS) as u32,
            before: trial.before.as_ref().map(|before| before.mission.hash()),
        });
        self.observers.show(Present {
            mode: self.safety.mode(),
            executed: hash.map_or(0, |_| self.timetable.activations()),
            background_busy: self.execution.is_background_busy(),
            changed_params: self.machine.params().len(),
            saved_params: hash.map_or(0, |hash| self.machine.saved_of(hash).len()),
            trial,
            robot_us,
        });
    }
}
