//! A mission on trial: it stays if it is confirmed in time. If it is not, fails, or somebody asks
//! for it, the robot goes back to the mission before, which is whole as long as the trial lasts.

use super::RealTime;
use super::running::{Origin, Trial};
use super::staging::StoppedMission;
use esm_link::message::{Mode, SafeReason};
use esm_link::trace::TraceEvent;
use esm_link::trial::{FallBack, FallBackReason};

impl<'m> RealTime<'_, 'm> {
    /// Whether the mission of this hash is on trial, and has not failed.
    pub(super) fn is_on_trial(&self, mission: u32) -> bool {
        let goes_on = (self.trial.as_ref()).is_some_and(|trial| trial.failed.is_none());
        goes_on && self.health.mission == Some(mission)
    }

    /// Whether the mission of this hash runs, and none is on trial.
    pub(super) fn stays(&self, mission: u32) -> bool {
        self.trial.is_none() && self.health.mission == Some(mission)
    }

    /// Goes back to the mission before the one on trial.
    #[inline(never)]
    pub(super) fn fall_back(&mut self, reason: FallBackReason, at: Origin) {
        let Some(Trial { before, safe, .. }) = self.trial.take() else {
            return;
        };
        let running = self.running();
        let Some(failed) = self.end_mission() else {
            return;
        };
        let fell_back = FallBack {
            mission: failed.mission.hash(),
            reason,
        };
        self.trace.record(TraceEvent::FellBack {
            mission: fell_back.mission,
            reason: reason.number(),
        });
        self.free(failed, Some(fell_back));
        self.health.fell_back = Some(fell_back);
        let mode = self.mode;
        self.go_back_to(before, running, at);
        match (mode, safe) {
            // What the mission before would not have helped against.
            (Mode::Safe(reason), _) if !is_the_missions_fault(reason) => self.mode = mode,
            // Where it had failed, nobody may be there to look after it.
            (_, Some(reason)) if self.is_running() => self.mode = Mode::Safe(reason),
            _ => {}
        }
        self.tell_health();
    }

    /// Starts a mission that ran before, or goes without one.
    fn go_back_to(
        &mut self,
        before: Option<StoppedMission<'m>>,
        running: Option<(Origin, u32)>,
        at: Origin,
    ) {
        self.begin_health();
        if let Some(before) = before {
            self.start_again(before, running, at);
        }
    }
}

/// Whether what led to the safe state is the doing of the mission that runs, so that the one before
/// would do without. A battery that is low or a body that is lost would be so with any mission, and
/// motors must not start again for it.
pub(super) fn is_the_missions_fault(reason: SafeReason) -> bool {
    matches!(
        reason,
        SafeReason::EventQueueOverflow
            | SafeReason::MacroStepLimit
            | SafeReason::Overruns
            | SafeReason::DeadlineMiss
    )
}
