//! The letter from the link: what can be done at once is done and answered, and what changes the
//! mission or a parameter waits for the interpreter's next occurrence.
//!
//! *Invariant:* there is one letter. It is on its way, waits here, or is answered, and goes back
//! each time.

use core::sync::atomic::Ordering;

use super::params::SavedParams;
use super::safe_state::is_stop_pressed;
use super::{RealTime, params};
use crate::board::{Board, ticks};
use crate::features::{PARAMS, TELEMETRY, WARM};
use crate::mail::{Letter, Posted};
use esm_link::message::{LinkError, Mode};

impl<'m> RealTime<'_, 'm> {
    /// Takes what the link wants, and answers it or keeps it for the interpreter's next occurrence.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn take_letter<B: Board>(&mut self, board: &mut B) {
        let Some(Posted {
            letter,
            by_us,
            stops,
        }) = self.from_link.dequeue()
        else {
            return;
        };
        let now_ticks = board.now_ticks();
        if is_late::<B>(now_ticks, by_us) {
            self.send(letter);
            return;
        }
        self.waiting_by_us = by_us;
        if WARM {
            self.waiting_since_ticks = now_ticks;
        }
        let answer = match &*letter {
            Letter::Swap { .. } => {
                self.waiting = Some(letter);
                return;
            }
            &Letter::FallBack { mission } if self.is_on_trial(mission) => {
                self.waiting = Some(letter);
                return;
            }
            &Letter::Confirm { mission, again }
                if self.is_on_trial(mission) || again && self.stays(mission) =>
            {
                let before = self.trial.take().and_then(|trial| trial.before);
                if let Some(before) = before {
                    self.free(before, None);
                }
                Letter::Confirmed { mission }
            }
            Letter::FallBack { .. } | Letter::Confirm { .. } => {
                Letter::Failed(LinkError::NotOnTrial)
            }
            &Letter::SetParam {
                mission,
                param,
                value,
            } if PARAMS => match self.check_param(mission, param, value) {
                Ok(()) => {
                    self.waiting = Some(letter);
                    return;
                }
                Err(error) => Letter::Failed(error),
            },
            &Letter::ReadChanged { mission } if PARAMS => {
                match (&self.trial, self.mission_of(mission)) {
                    // So that what the mission before starts with is what was saved for it.
                    (Some(_), _) => Letter::Failed(LinkError::OnTrial),
                    (None, Ok(_)) => Letter::Changed(SavedParams::new(mission, self.params)),
                    (None, Err(error)) => Letter::Failed(error),
                }
            }
            Letter::Saved(saved) if PARAMS => {
                self.saved.become_those(saved);
                Letter::ParamsSaved {
                    count: self.saved.len(),
                }
            }
            &Letter::AskValues { number, ref ask } if TELEMETRY => self
                .answer_of_values(number, ask.as_slice())
                .unwrap_or_else(Letter::Failed),
            // Latched by the link, and not looked at in a slot yet.
            Letter::Start if self.signs.emergency_stop.load(Ordering::Relaxed) => {
                Letter::Failed(LinkError::EmergencyStopped)
            }
            // It is older than a stop that has come meanwhile.
            Letter::Start if self.signs.stops.overtakes(stops) => {
                Letter::Failed(LinkError::StopCame)
            }
            Letter::Start => match (self.mode, &self.mission) {
                (Mode::Running, _) => Letter::Done,
                (Mode::EmergencyStopped, _) => Letter::Failed(LinkError::EmergencyStopped),
                (_, None) => {
                    self.mode = Mode::Empty;
                    Letter::Done
                }
                (_, Some(_)) => {
                    self.waiting = Some(letter);
                    return;
                }
            },
            // A stop that came behind it goes on.
            Letter::Release
                if !self.signs.release.load(Ordering::Relaxed)
                    || self.signs.stops.overtakes(stops)
                    || is_stop_pressed(board) =>
            {
                Letter::Failed(LinkError::EmergencyStopped)
            }
            Letter::Release => {
                // Who wanted it may have released it before any slot has looked.
                let is_latched = self.signs.emergency_stop.load(Ordering::Relaxed);
                self.signs.emergency_stop.store(false, Ordering::Relaxed);
                self.signs.stop_pressed.store(false, Ordering::Relaxed);
                if let Some(kept) = self.kept {
                    kept.set_emergency_stop(false);
                }
                if is_latched || self.mode == Mode::EmergencyStopped {
                    self.set_stopped(Mode::Stopped, board);
                }
                if self.signs.stops.overtakes(stops) {
                    // It came while this was done.
                    self.signs.latch_emergency_stop(self.kept);
                    Letter::Failed(LinkError::EmergencyStopped)
                } else {
                    Letter::Released
                }
            }
            question => self.answer(question, B::TICKS_PER_US),
        };
        *letter = answer;
        self.tell_health();
        self.send(letter);
    }

    /// Hands what waits back if it is too late for it now.
    #[inline(never)]
    pub(super) fn refuse_late<B: Board>(&mut self, now_ticks: u64) {
        if is_late::<B>(now_ticks, self.waiting_by_us)
            && let Some(letter) = self.waiting.take()
        {
            self.send(letter);
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

    /// Gives a parameter the value that a letter says, and makes the answer of it. The value was
    /// checked when the letter came, for the mission that it names: where that has ended meanwhile,
    /// nothing is done.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn set_param(&mut self, letter: &mut Letter<'_>) {
        let Letter::SetParam {
            mission,
            param,
            value,
        } = *letter
        else {
            return;
        };
        *letter = match self.mission_of(mission) {
            Ok(mission) => {
                let tables = mission.interpreter.tables();
                let of_mission = tables.param(usize::from(param)).unwrap_or_default();
                let before = self.params.get(param).unwrap_or(of_mission);
                self.params.set(param, value, of_mission);
                Letter::ParamSet { before }
            }
            Err(error) => Letter::Failed(error),
        };
    }

    pub(super) fn send(&mut self, letter: &'m mut Letter<'m>) {
        // There is one letter, so that there is room for it.
        let refused = self.to_link.enqueue(letter);
        debug_assert!(refused.is_ok());
    }
}

/// Whether the board's clock is past this time in microseconds.
fn is_late<B: Board>(now_ticks: u64, by_us: u64) -> bool {
    now_ticks > ticks::<B>(by_us)
}
