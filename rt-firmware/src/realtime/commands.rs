//! The command from the link: what can be done at once is done and answered, and what changes the
//! mission or a parameter waits for the interpreter's next activation.
//!
//! *Invariant:* there is one command. It is on its way, waits here, or is answered, and goes back
//! each time.

use core::sync::atomic::Ordering;

use super::params::SavedParams;
use super::safe_state::is_stop_pressed;
use super::{RealTime, params};
use crate::board::{Board, ticks};
use crate::features::{PARAMS, TELEMETRY, WARM};
use crate::realtime::mailbox::{Command, Posted};
use esm_link::message::{LinkError, Mode};

impl<'m> RealTime<'_, 'm> {
    /// Takes what the link wants, and answers it or keeps it for the interpreter's next activation.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn take_command<B: Board>(&mut self, board: &mut B) {
        let Some(Posted {
            command,
            by_us,
            stops,
        }) = self.from_link.dequeue()
        else {
            return;
        };
        self.settle();
        let now_ticks = board.now_ticks();
        if is_late::<B>(now_ticks, by_us) {
            self.send(command);
            return;
        }
        self.waiting_by_us = by_us;
        if WARM {
            self.waiting_since_ticks = now_ticks;
        }
        let answer = match &*command {
            Command::Swap { .. } => {
                self.waiting = Some(command);
                return;
            }
            &Command::FallBack { mission } if self.is_on_trial(mission) => {
                self.waiting = Some(command);
                return;
            }
            &Command::Confirm { mission, again }
                if self.is_on_trial(mission) || again && self.stays(mission) =>
            {
                let before = self.trial.take().and_then(|trial| trial.before);
                if let Some(before) = before {
                    self.free(before, None);
                }
                Command::Confirmed { mission }
            }
            Command::FallBack { .. } | Command::Confirm { .. } => {
                Command::Failed(LinkError::NotOnTrial)
            }
            &Command::SetParam {
                mission,
                param,
                value,
            } if PARAMS => match self.check_param(mission, param, value) {
                Ok(()) => {
                    self.waiting = Some(command);
                    return;
                }
                Err(error) => Command::Failed(error),
            },
            &Command::ReadChanged { mission } if PARAMS => {
                match (&self.trial, self.mission_of(mission)) {
                    // So that what the mission before starts with is what was saved for it.
                    (Some(_), _) => Command::Failed(LinkError::OnTrial),
                    (None, Ok(_)) => Command::Changed(SavedParams::new(mission, self.params)),
                    (None, Err(error)) => Command::Failed(error),
                }
            }
            Command::Saved(saved) if PARAMS => {
                self.saved.assign(saved);
                Command::ParamsSaved {
                    count: self.saved.len(),
                }
            }
            &Command::AskValues { number, ref ask } if TELEMETRY => self
                .answer_of_values(number, ask.as_slice())
                .unwrap_or_else(Command::Failed),
            // Latched by the link, and not looked at in a slot yet.
            Command::Start if self.heartbeats.emergency_stop.load(Ordering::Relaxed) => {
                Command::Failed(LinkError::EmergencyStopped)
            }
            // It is older than a stop that has come meanwhile.
            Command::Start if self.heartbeats.stops.overtakes(stops) => {
                Command::Failed(LinkError::StopCame)
            }
            Command::Start => match (self.mode, &self.mission) {
                (Mode::Running, _) => Command::Done,
                (Mode::EmergencyStopped, _) => Command::Failed(LinkError::EmergencyStopped),
                (_, None) => {
                    self.mode = Mode::Empty;
                    Command::Done
                }
                (_, Some(_)) => {
                    self.waiting = Some(command);
                    return;
                }
            },
            // A stop that came behind it goes on.
            Command::Release
                if self.heartbeats.stops.overtakes(stops) || is_stop_pressed(board) =>
            {
                Command::Failed(LinkError::EmergencyStopped)
            }
            Command::Release => {
                // Who wanted it may have released it before any slot has looked.
                let is_latched = self.heartbeats.emergency_stop.load(Ordering::Relaxed);
                self.heartbeats
                    .emergency_stop
                    .store(false, Ordering::Relaxed);
                self.heartbeats.stop_pressed.store(false, Ordering::Relaxed);
                if let Some(kept) = self.kept {
                    kept.set_emergency_stop(false);
                }
                if is_latched || self.mode == Mode::EmergencyStopped {
                    self.set_stopped(Mode::Stopped, board);
                }
                if self.heartbeats.stops.overtakes(stops) {
                    // It came while this was done.
                    self.heartbeats.latch_emergency_stop(self.kept);
                    Command::Failed(LinkError::EmergencyStopped)
                } else {
                    Command::Released
                }
            }
            question => self.answer(question, B::TICKS_PER_US),
        };
        *command = answer;
        self.tell_health();
        self.send(command);
    }

    /// Hands what waits back if it is too late for it now.
    #[inline(never)]
    pub(super) fn refuse_late<B: Board>(&mut self, now_ticks: u64) {
        if is_late::<B>(now_ticks, self.waiting_by_us)
            && let Some(command) = self.waiting.take()
        {
            self.send(command);
        }
    }

    /// Whether a parameter can be given this value.
    fn check_param(&self, mission: u32, param: u16, value: u32) -> Result<(), LinkError> {
        let tables = self.mission_of(mission)?.interpreter.tables();
        let declared = params::declared(&tables, self.executor.registry(), param)
            .ok_or(LinkError::NoSuchIndex)?;
        params::check(declared, value)?;
        self.params.has_room(param)
    }

    /// Gives a parameter the value that a command says, and makes the answer of it. The value was
    /// checked when the command came, for the mission that it names: where that has ended
    /// meanwhile, nothing is done.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn set_param(&mut self, command: &mut Command<'_>) {
        let Command::SetParam {
            mission,
            param,
            value,
        } = *command
        else {
            return;
        };
        *command = match self.mission_of(mission) {
            Ok(mission) => {
                let tables = mission.interpreter.tables();
                let of_mission = tables.param(usize::from(param)).unwrap_or_default();
                let before = self.params.get(param).unwrap_or(of_mission);
                self.params.set(param, value, of_mission);
                Command::ParamSet { before }
            }
            Err(error) => Command::Failed(error),
        };
    }

    pub(super) fn send(&mut self, command: &'m mut Command<'m>) {
        // There is one command, so that there is room for it.
        let refused = self.to_link.enqueue(command);
        debug_assert!(refused.is_ok());
    }
}

/// Whether the board's clock is past this time in microseconds.
fn is_late<B: Board>(now_ticks: u64, by_us: u64) -> bool {
    now_ticks > ticks::<B>(by_us)
}
