//! When and how missions change: another one takes over, the present one starts anew, or the robot
//! goes back to the one before.
//!
//! *Invariant:* missions are exchanged between two macro steps, and who asked for it is not
//! answered before the new mission runs.

use super::RealTime;
use super::machine::Trial;
use super::staging::StagedMission;
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
        let reply = match core::mem::replace(content, Content::Empty) {
            Content::Command(Command::FallBack { .. }) => {
                self.fall_back(FallBackReason::Asked, at);
                Reply::Done
            }
            Content::Command(Command::Swap {
                mission,
                swap,
                saved,
            }) => {
                self.machine.save(&saved);
                self.swap(mission, swap, at)
            }
            _ => self.start_anew(at),
        };
        *content = Content::Reply(reply);
        self.answer_then(content);
    }

    /// Switches to another mission.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    fn swap(&mut self, new: StagedMission<'m>, swap: Swap, at: Origin) -> Reply<'m> {
        let mission = new.mission().hash();
        // What failed or stands still has nothing to hand over.
        let warm = swap.warm && self.safety.is_running();
        let safe = self.safety.safe_reason();
        let (carried, old, pairs) = self.start_staged(new, warm, at);
        let on_trial = swap.trial_ms > 0;
        if on_trial {
            self.machine.begin_trial(Trial {
                before: old,
                safe,
                until_us: at.us + u64::from(swap.trial_ms) * 1_000,
                failed: None,
            });
        } else if let Some(old) = old {
            self.machine.free(old, None);
        }
        Reply::Swapped {
            mission,
            on_trial,
            carried,
            pairs,
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
