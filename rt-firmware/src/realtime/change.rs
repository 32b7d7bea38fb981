//! When and how missions change: another one takes over, the present one starts anew, or the robot
//! goes back to the one before.
//!
//! *Invariant:* missions are exchanged between two macro steps, and who asked for it is not
//! answered before the new mission runs.

use super::RealTime;
use super::running::{Origin, Trial};
use super::staging::{StagedMission, StoppedMission};
use crate::board::{Board, ticks};
use crate::features::WARM;
use crate::realtime::mailbox::{Command, Freed};
use esm_link::message::{LinkError, Mode, Swap};
use esm_link::trial::{FallBack, FallBackReason};

/// How long before the first macro step of another mission the missions are exchanged, if nothing
/// is due in between: longer than that takes.
const CHANGE_LEAD_US: u32 = 2_000;

/// [`CHANGE_LEAD_US`] on the board's clock.
pub(super) fn lead_ticks<B: Board>() -> u64 {
    ticks::<B>(CHANGE_LEAD_US)
}

impl<'m> RealTime<'_, 'm> {
    /// Whether a macro step at this time is the first of another mission, or of this one anew. A
    /// swap that is asked for when that step is due waits for the one after it, for which there is
    /// time to make it; where the step is late anyway, it comes with it.
    pub(super) fn changes_mission<B: Board>(&self, at: Origin) -> bool {
        let is_asked = (self.waiting.as_ref()).is_some_and(|command| match &**command {
            Command::SetParam { .. } => false,
            Command::Swap { .. } if WARM => {
                let due_ticks = self.waiting_since_ticks.checked_sub(at.ticks);
                due_ticks.is_none_or(|due_ticks| due_ticks > lead_ticks::<B>())
            }
            _ => true,
        });
        is_asked || (self.trial.as_ref()).is_some_and(|trial| trial.is_over(at.us))
    }

    /// Switches to the mission that waits, falls back to the one before, or starts the present one
    /// anew, at this time.
    pub(super) fn change_mission(&mut self, at: Origin) {
        if let Some(reason) = self.trial.as_ref().and_then(|trial| trial.end_at(at.us)) {
            // Whatever waits comes after it, unless it is what was asked for.
            self.fall_back(reason, at);
            if let Some(command) =
                (self.waiting).take_if(|command| matches!(command, Command::FallBack { .. }))
            {
                *command = Command::Done;
                self.answer_then(command);
            }
            return;
        }
        let Some(command) = self.waiting.take() else {
            return;
        };
        *command = match core::mem::replace(command, Command::Empty) {
            Command::FallBack { .. } => {
                self.fall_back(FallBackReason::Asked, at);
                Command::Done
            }
            Command::Swap {
                mission,
                swap,
                saved,
            } => {
                self.saved.assign(&saved);
                self.swap(mission, swap, at)
            }
            _ => self.start_anew(at),
        };
        self.answer_then(command);
    }

    /// Switches to another mission.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    fn swap(&mut self, new: StagedMission<'m>, swap: Swap, at: Origin) -> Command<'m> {
        let mission = new.mission().hash();
        // What failed or stands still has nothing to hand over.
        let warm = swap.warm && self.is_running();
        let safe = match self.mode {
            Mode::Safe(reason) => Some(reason),
            _ => None,
        };
        let (carried, old, pairs) = self.start_staged(new, warm, at);
        let on_trial = swap.trial_ms > 0;
        if on_trial {
            self.trial = Some(Trial {
                before: old,
                safe,
                until_us: at.us + u64::from(swap.trial_ms) * 1_000,
                failed: None,
            });
        } else if let Some(old) = old {
            self.free(old, None);
        }
        Command::Swapped {
            mission,
            on_trial,
            carried,
            pairs,
        }
    }

    /// Starts the present mission anew.
    #[inline(never)]
    fn start_anew(&mut self, at: Origin) -> Command<'m> {
        // It came while this waited.
        if self.mode == Mode::EmergencyStopped {
            return Command::Failed(LinkError::EmergencyStopped);
        }
        let running = self.running();
        let Some(mission) = self.end_mission() else {
            return Command::Failed(LinkError::NoMission);
        };
        self.mode = Mode::Running;
        self.start_again(mission, running, at);
        Command::Started
    }

    /// Answers a command that has changed the mission when its first macro step begins: until then
    /// the one before runs, whatever was exchanged already.
    fn answer_then(&mut self, command: &'m mut Command<'m>) {
        if WARM {
            self.answered = Some(command);
        } else {
            self.tell_health();
            self.send(command);
        }
    }

    pub(super) fn send_answered(&mut self) {
        if WARM && let Some(command) = self.answered.take() {
            self.tell_health();
            self.send(command);
        }
    }

    /// Gives a buffer back that no mission is in any more, with the memory that goes with it.
    pub(super) fn free(&mut self, ended: StoppedMission<'m>, fell_back: Option<FallBack>) {
        let freed = Freed {
            blob: ended.mission.into_bytes(),
            spare: ended.spare,
            fell_back,
        };
        // There are as many places as buffers.
        let refused = self.freed.enqueue(freed);
        debug_assert!(refused.is_ok());
    }
}
