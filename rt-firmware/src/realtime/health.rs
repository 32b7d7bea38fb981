//! What others see of the real-time side: the snapshot that the link reads, and the flight
//! recorder.

use super::RealTime;
use crate::board::microseconds;
use crate::status::Health;
use esm_link::black_box::Event;
use esm_link::message::Mode;
use esm_link::trial;

impl RealTime<'_, '_> {
    /// Counters and mode of a robot before its next mission.
    pub(super) fn begin_health(&mut self) {
        self.health = Health {
            missed: self.health.missed,
            overruns: self.health.overruns,
            fell_back: self.health.fell_back,
            ..Health::EMPTY
        };
        self.max_delay_ticks = 0;
        if !self.mode.is_latched() {
            self.mode = Mode::Empty;
        }
    }

    pub(super) fn tell_health(&mut self) {
        self.health.mode = self.mode;
        // What wraps is the number that is told.
        self.health.executed = self
            .mission
            .as_ref()
            .map_or(0, |mission| mission.activations as u32);
        self.health.background_busy = self.executor.checked_out().is_some();
        self.health.changed_params = self.params.len();
        let saved = self
            .health
            .mission
            .map(|mission| self.saved.of(mission).len());
        self.health.saved_params = saved.unwrap_or_default();
        const US_PER_MS: u32 = 1_000;
        self.health.trial = self.trial.as_ref().map(|trial| trial::Trial {
            // Divided as ticks are: a division of 64 bits would take a routine of its own.
            left_ms: microseconds(
                trial.until_us.saturating_sub(self.previous_end_us),
                US_PER_MS,
            ) as u32,
            before: trial.before.as_ref().map(|before| before.mission.hash()),
        });
        if let Some(kept) = self.kept {
            kept.set_alive(self.previous_end_us);
        }
        self.snapshot.write(&self.health);
    }

    /// Writes into the black box.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn note(&self, event: Event) {
        self.note_at(self.previous_end_us, event);
    }

    /// Writes into the black box what happened at this robot time.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn note_at(&self, robot_us: u64, event: Event) {
        if let Some(kept) = self.kept {
            kept.black_box.record(robot_us, event);
        }
    }
}
