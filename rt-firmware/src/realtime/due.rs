//! What is due, but was not looked up before: activations of the interpreter's slot and those that
//! are late, missions that take over, and what is to be done while there is none.
//!
//! *Invariant:* each round of the loop takes an activation from the dispatcher, exchanges missions,
//! or is the last. So it ends when nothing is due.

use core::sync::atomic::Ordering;

use super::change::lead_ticks;
use super::running::Activation;
use super::running::Origin;
use super::{IDLE_POLL_US, RealTime};
use crate::board::{Board, microseconds, ticks};
use crate::features::{PARAMS, WARM};
use esm_link::message::Mode;

impl RealTime<'_, '_> {
    /// Executes what else is due, and returns when to be called again. A command from the link
    /// waits until the slot is done that the interrupt was for, unless that is the interpreter's.
    #[inline(never)]
    pub(super) fn go_on<B: Board>(&mut self, board: &mut B, command_waits: bool) -> u64 {
        let began_ticks = board.now_low_ticks();
        self.pass_over_next();
        // Before a command, which may be older.
        self.look_for_stops(board);
        if !command_waits {
            self.take_command(board);
        }
        let mut at_ticks = self.execute_due(board);
        if command_waits {
            self.take_command(board);
            if WARM && self.waiting.is_some() {
                at_ticks = self.execute_due(board);
            }
        }
        self.forget_next();
        let next = self.dispatcher.next();
        if let Some(mission) = &self.mission {
            let start_ticks = mission.origin.ticks + ticks::<B>(next.start_us);
            if start_ticks == at_ticks {
                self.look_up::<B>(next, start_ticks);
            }
        }
        self.count_time(board.now_low_ticks().wrapping_sub(began_ticks));
        self.heartbeats.settle_slots(B::TICKS_PER_US);
        at_ticks
    }

    /// Executes all that is due; returns when to be called again.
    fn execute_due<B: Board>(&mut self, board: &mut B) -> u64 {
        let poll_ticks = poll_ticks::<B>();
        loop {
            let now = board.now_ticks();
            self.settle();
            self.look_for_stops(board);
            if self.waiting.is_some() {
                self.refuse_late::<B>(now);
            }
            let Some(mission) = &self.mission else {
                match self.stand_by(board, now) {
                    Some(at_ticks) => return at_ticks,
                    None => continue,
                }
            };
            let (origin, interpreter_slot) = (mission.origin, mission.interpreter_slot);
            let at = |start_us: u64| Origin {
                ticks: origin.ticks + ticks::<B>(start_us),
                us: origin.us + start_us,
            };
            let next = self.dispatcher.next();
            let start_ticks = at(next.start_us).ticks;
            if WARM
                && let Some(wait_ticks) = start_ticks.checked_sub(now)
                && next.slot == interpreter_slot
            {
                let is_asked = self.changes_mission::<B>(at(next.start_us));
                let lead_ticks = lead_ticks::<B>();
                let is_coming =
                    is_asked || self.heartbeats.mission_is_coming.load(Ordering::Relaxed);
                if is_coming && wait_ticks > lead_ticks {
                    self.feed_watchdog(board, now);
                    return now + poll_ticks.min(wait_ticks - lead_ticks);
                }
                if is_asked {
                    // Nothing of the mission before is due until then.
                    self.change_mission(at(next.start_us));
                    continue;
                }
            }
            let Some(late_ticks) = now.checked_sub(start_ticks) else {
                self.feed_watchdog(board, now);
                // A slot is not delayed by a poll just before it.
                return if start_ticks - now > 2 * poll_ticks {
                    now + poll_ticks
                } else {
                    start_ticks
                };
            };
            let late_us = microseconds(late_ticks, B::TICKS_PER_US);
            let missed_before = self.dispatcher.missed(next.slot);
            let Some(taken) = self.dispatcher.take(next.start_us + late_us) else {
                return now + poll_ticks;
            };
            let missed = self
                .dispatcher
                .missed(taken.slot)
                .wrapping_sub(missed_before);
            let interpreter = taken.slot == interpreter_slot;
            if PARAMS
                && interpreter
                && let Some(command) = self.waiting.take_if(|command| command.sets_param())
            {
                self.set_param(command);
                self.send(command);
            }
            let start = at(taken.start_us);
            if interpreter && self.changes_mission::<B>(start) {
                self.note_deadline_misses(taken.slot, missed);
                self.give_up_before(taken.start_us);
                self.change_mission(start);
                continue;
            }
            let Some(mission) = &mut self.mission else {
                continue;
            };
            let activation = Activation {
                slot: taken.slot,
                start_us: taken.start_us,
                number: mission.activations,
                interpreter,
            };
            if interpreter && missed > 0 {
                mission.interpreter.skip(missed);
                mission.next_step += u64::from(missed);
                self.record.skipped(missed);
                self.trace.write_next_in_full();
            }
            self.count_deadline_misses(board, &activation, missed);
            self.execute(board, &activation, now, start.ticks);
        }
    }

    /// Starts the mission that waits, where there is none; or else keeps the robot still, and
    /// returns when to be called again.
    fn stand_by<B: Board>(&mut self, board: &mut B, now: u64) -> Option<u64> {
        if self.waiting.is_some() {
            let lead_ticks = ticks::<B>(B::START_LEAD_US);
            self.change_mission(Origin {
                ticks: now + lead_ticks,
                us: self.previous_end_us,
            });
            if self.mission.is_some() {
                return None;
            }
        }
        self.send_answered();
        self.take_run_back(None);
        self.feed_watchdog(board, now);
        if self.mode == Mode::EmergencyStopped {
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
        while let Some(last_us) = start_us.checked_sub(1) {
            let owed = self.dispatcher.next().slot;
            let before = self.dispatcher.missed(owed);
            if self.dispatcher.take(last_us).is_none() {
                return;
            }
            let skipped = self.dispatcher.missed(owed).wrapping_sub(before);
            // It was handed out, but is not executed.
            self.note_deadline_misses(owed, skipped.saturating_add(1));
        }
    }
}

/// How long nothing is looked at while nothing is due.
#[cfg_attr(feature = "speed", inline(always))]
fn poll_ticks<B: Board>() -> u64 {
    ticks::<B>(IDLE_POLL_US)
}
