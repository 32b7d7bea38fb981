//! What is due, but was not looked up before: activations of the interpreter's slot and those that
//! are late, missions that take over, and what is to be done while there is none.
//!
//! *Invariant:* each round of the loop takes an activation from the dispatcher, exchanges missions,
//! or is the last. So it ends when nothing is due.

use super::change::lead_ticks;
use super::timetable::Origin;
use super::{IDLE_POLL_US, RealTime};
use crate::board::{Board, microseconds, ticks};
use crate::features::{BEHAVIOURS, PARAMS, WARM};
use crate::realtime::mailbox::Command;
use esm_link::message::Mode;

impl RealTime<'_, '_> {
    /// Executes what else is due, and returns when to be called again. A command from the link
    /// waits until the slot is done that the interrupt was for, unless that is the interpreter's.
    #[inline(never)]
    pub(super) fn go_on<B: Board>(&mut self, board: &mut B, command_waits: bool) -> u64 {
        let began_ticks = board.now_low_ticks();
        self.timetable.pass_over_next();
        // Before a command, which may be older.
        self.look_for_stops(board);
        if !command_waits {
            self.take_command(board);
        }
        let mut at_ticks = self.execute_due(board);
        if command_waits {
            self.take_command(board);
            if WARM && self.commands.is_waiting() {
                at_ticks = self.execute_due(board);
            }
        }
        self.forget_next();
        if self.machine.mission().is_some() {
            let start_us = self.timetable.next().start_us;
            let start_ticks = self.timetable.at::<B>(start_us).ticks;
            if start_ticks == at_ticks {
                self.look_up::<B>(start_ticks);
            }
        }
        let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks);
        self.safety.count_time(took_ticks);
        self.safety.settle_time(B::TICKS_PER_US);
        at_ticks
    }

    /// Executes all that is due; returns when to be called again.
    fn execute_due<B: Board>(&mut self, board: &mut B) -> u64 {
        let poll_ticks = poll_ticks::<B>();
        loop {
            let now = board.now_ticks();
            self.settle();
            self.look_for_stops(board);
            if self.commands.is_waiting() {
                self.commands.refuse_late::<B>(now);
            }
            if BEHAVIOURS {
                self.answer_behaviours(now);
            }
            if self.machine.mission().is_none() {
                match self.stand_by(board, now) {
                    Some(at_ticks) => return at_ticks,
                    None => continue,
                }
            }
            let next = self.timetable.next();
            let start = self.timetable.at::<B>(next.start_us);
            if WARM
                && let Some(wait_ticks) = start.ticks.checked_sub(now)
                && self.timetable.is_interpreters(next.slot)
            {
                let is_asked = self.changes_mission::<B>(start);
                let lead_ticks = lead_ticks::<B>();
                let is_coming = is_asked || self.safety.is_mission_coming();
                if is_coming && wait_ticks > lead_ticks {
                    self.feed_watchdog(board, now);
                    return now + poll_ticks.min(wait_ticks - lead_ticks);
                }
                if is_asked {
                    // Nothing of the mission before is due until then.
                    self.change_mission(start);
                    continue;
                }
            }
            let Some(late_ticks) = now.checked_sub(start.ticks) else {
                self.feed_watchdog(board, now);
                // A slot is not delayed by a poll just before it.
                return if start.ticks - now > 2 * poll_ticks {
                    now + poll_ticks
                } else {
                    start.ticks
                };
            };
            let late_us = microseconds(late_ticks, B::TICKS_PER_US);
            let Some((activation, missed)) = self.timetable.take(late_us) else {
                return now + poll_ticks;
            };
            if PARAMS
                && activation.interpreter
                && let Some(content) = (self.commands)
                    .take_waiting_if(|command| matches!(command, Command::SetParam { .. }))
            {
                self.set_param(content);
                self.commands.send(content);
            }
            let start = self.timetable.at::<B>(activation.start_us);
            if activation.interpreter && self.changes_mission::<B>(start) {
                self.note_deadline_misses(activation.slot, missed);
                self.give_up_before(activation.start_us);
                self.change_mission(start);
                continue;
            }
            if activation.interpreter && missed > 0 {
                if let Some(mission) = self.machine.mission_mut() {
                    mission.skip(missed);
                }
                self.observers.skip_steps(missed);
            }
            self.count_deadline_misses(board, &activation, missed);
            self.execute(board, &activation, now, start.ticks);
        }
    }

    /// Starts the mission that waits, where there is none; or else keeps the robot still, and
    /// returns when to be called again.
    fn stand_by<B: Board>(&mut self, board: &mut B, now: u64) -> Option<u64> {
        if self.commands.is_waiting() {
            let lead_ticks = ticks::<B>(B::START_LEAD_US);
            self.change_mission(Origin {
                ticks: now + lead_ticks,
                us: self.timetable.previous_end_us(),
            });
            if self.machine.mission().is_some() {
                return None;
            }
        }
        self.send_answered();
        self.take_run_back(None);
        self.feed_watchdog(board, now);
        if self.safety.mode() == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        board.motors_off();
        self.tell_health();
        Some(now + poll_ticks::<B>())
    }

    /// Counts as missed what the old mission still owes when the interpreter comes so late that the
    /// new one starts first: activations whose nominal start is before this time.
    #[inline(never)]
    fn give_up_before(&mut self, start_us: u64) {
        // A slot that is taken goes on at or after `start_us`, so that each of them is taken once
        // at most.
        while let Some((slot, missed)) = self.timetable.give_up_before(start_us) {
            self.note_deadline_misses(slot, missed);
        }
    }
}

/// How long nothing is looked at while nothing is due.
#[cfg_attr(feature = "speed", inline(always))]
fn poll_ticks<B: Board>() -> u64 {
    ticks::<B>(IDLE_POLL_US)
}
