//! A mission on trial: it stays if it is confirmed in time. If it is not, fails, or somebody asks
//! for it, the robot goes back to the mission before, which is whole as long as the trial lasts.

use super::RealTime;
use super::events::Event;
use super::machine::Trial;
use super::staging::StoppedMission;
use super::timetable::Origin;
use esm_link::message::{Mode, SafeReason};
use esm_link::trial::{FallBack, FallBackReason};

impl<'m> RealTime<'_, 'm> {
    /// Goes back to the mission before the one on trial.
    #[inline(never)]
    pub(super) fn fall_back(&mut self, reason: FallBackReason, at: Origin) {
        let Some(Trial { before, safe, .. }) = self.machine.end_trial() else {
            return;
        };
        let running = self.running();
        if !self.end_failed(reason, at) {
            return;
        }
        let mode = self.safety.mode();
        self.go_back_to(before, running, at);
        match (mode, safe) {
            // What the mission before would not have helped against.
            (Mode::Safe(reason), _) if !is_the_missions_fault(reason) => {
                self.safety.set_mode(mode);
            }
            // Where it had failed, nobody may be there to look after it.
            (_, Some(reason)) if self.safety.is_running() => {
                self.safety.set_mode(Mode::Safe(reason));
            }
            _ => {}
        }
        self.tell_health();
    }

    /// Ends the mission on trial. Answers whether there was one.
    // Not inlined: no other mission should be made on top of this one.
    #[inline(never)]
    fn end_failed(&mut self, reason: FallBackReason, at: Origin) -> bool {
        let Some(failed) = self.end_mission() else {
            return false;
        };
        let fell_back = FallBack {
            mission: failed.mission.hash(),
            reason,
        };
        self.observers.tell(at.us, Event::FellBack(fell_back));
        self.machine.free(failed, Some(fell_back));
        true
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
