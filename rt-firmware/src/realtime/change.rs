//! When and how missions change: another one takes over, the present one starts anew, or the robot
//! goes back to the one before.
//!
//! *Invariant:* missions are exchanged between two macro steps, and who asked for it is not
//! answered before the new mission runs.

use super::RealTime;
use super::machine::{NewTrial, Trial};
use super::staging::StoppedMission;
use super::timetable::Origin;
use crate::board::{Board, ticks};
use crate::features::WARM;
use crate::realtime::mailbox::{Command, Content, Reply};
use esm_link::message::{LinkError, Mode, Swap};
use esm_link::trial::FallBackReason;

/// How long before the first macro step of another mission the missions are exchanged, if nothing
/// is due in between: longer than that takes.
const CHANGE_LEAD_US: u32 = 2_000;

/// [`CHANGE_LEAD_US`] on the board's clock.
pub(super) fn lead_ticks<B: Board>() -> u64 {
    ticks::<B>(CHANGE_LEAD_US)
}

impl<'m> RealTime<'_, 'm> {
    /// Whether a macro step at this time is the first of another mission, or of this one anew.
    pub(super) fn changes_mission<B: Board>(&self, at: Origin) -> bool {
        self.commands.changes_mission(at.ticks, lead_ticks::<B>())
            || self.machine.trial_end(at.us).is_some()
    }

    /// Switches to the mission that waits, falls back to the one before, or starts the present one
    /// anew, at this time.
    pub(super) fn change_mission(&mut self, at: Origin) {
        if let Some(reason) = self.machine.trial_end(at.us) {
            // Whatever waits comes after it, unless it is what was asked for.
            self.fall_back(reason, at);
            let is_asked = |command: &Command<'_>| matches!(command, Command::FallBack { .. });
            if let Some(content) = self.commands.take_waiting_if(is_asked) {
                *content = Content::Reply(Reply::Done);
                self.answer_then(content);
            }
            return;
        }
        let Some(content) = self.commands.take_waiting() else {
            return;
        };
        // Looked at in its place: on the stack, it would lie under the mission that starts.
        let reply = match content {
            Content::Command(Command::FallBack { .. }) => {
                self.fall_back(FallBackReason::Asked, at);
                Reply::Done
            }
            Content::Command(Command::Swap { swap, saved, .. }) => {
                self.machine.save(saved);
                let swap = *swap;
                self.swap(content, swap, at)
            }
            _ => self.start_anew(at),
        };
        *content = Content::Reply(reply);
        self.answer_then(content);
    }

    /// Switches to the mission of a command.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    fn swap(&mut self, content: &mut Content<'m>, swap: Swap, at: Origin) -> Reply<'m> {
        // What failed or stands still has nothing to hand over.
        let warm = swap.warm && self.safety.is_running();
        let trial = (swap.trial_ms > 0).then(|| NewTrial {
            safe: self.safety.safe_reason(),
            until_us: at.us + u64::from(swap.trial_ms) * 1_000,
        });
        let on_trial = trial.is_some();
        let (carried, pairs) = self.start_staged(content, warm, trial, at);
        Reply::Swapped {
            mission: self.machine.hash().unwrap_or_default(),
            on_trial,
            carried,
            pairs,
        }
    }

    /// Keeps the mission before while the new one is on trial; if it is not, its buffer goes back.
    // Not inlined: the new mission should not be made on top of the one before.
    #[inline(never)]
    pub(super) fn leave(&mut self, before: Option<StoppedMission<'m>>, trial: Option<NewTrial>) {
        match (trial, before) {
            (Some(NewTrial { safe, until_us }), before) => self.machine.begin_trial(Trial {
                before,
                safe,
                until_us,
                failed: None,
            }),
            (None, Some(before)) => self.machine.free(before, None),
            (None, None) => {}
        }
    }

    /// Starts the present mission anew.
    #[inline(never)]
    fn start_anew(&mut self, at: Origin) -> Reply<'m> {
        // It came while this waited.
        if self.safety.mode() == Mode::EmergencyStopped {
            return Reply::Failed(LinkError::EmergencyStopped);
        }
        let running = self.running();
        let Some(mission) = self.end_mission() else {
            return Reply::Failed(LinkError::NoMission);
        };
        self.safety.set_mode(Mode::Running);
        self.start_again(mission, running, at);
        Reply::Started
    }

    /// Answers a command that has changed the mission when its first macro step begins: until then
    /// the one before runs, whatever was exchanged already.
    fn answer_then(&mut self, content: &'m mut Content<'m>) {
        if WARM {
            self.commands.answer_later(content);
        } else {
            self.tell_health();
            self.commands.send(content);
        }
    }

    pub(super) fn send_answered(&mut self) {
        if WARM && let Some(content) = self.commands.take_answered() {
            self.tell_health();
            self.commands.send(content);
        }
    }
}
