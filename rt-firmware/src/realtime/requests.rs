//! The command from the link: what can be done at once is done and answered, by a function for each
//! command, and what changes the mission or a parameter waits for the interpreter's next
//! activation. What is only asked stands in [`answers`](super::answers).

use super::params::SavedParams;
use super::safe_state::is_stop_pressed;
use super::{RealTime, params};
use crate::board::Board;
use crate::features::{PARAMS, TELEMETRY};
use crate::realtime::mailbox::{Command, Content, Posted, Reply};
use esm_link::message::{LinkError, Mode};

impl<'m> RealTime<'_, 'm> {
    /// Takes what the link wants, and answers it or keeps it for the interpreter's next activation.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn take_command<B: Board>(&mut self, board: &mut B) {
        let Some(Posted {
            content,
            by_us,
            stops,
        }) = self.commands.take()
        else {
            return;
        };
        self.settle();
        let now_ticks = board.now_ticks();
        if self.commands.is_late::<B>(now_ticks, by_us) {
            self.commands.send(content);
            return;
        }
        if let Some(command) = content.command() {
            let Some(reply) = self.carry_out(board, command, stops) else {
                self.commands.keep_waiting(content);
                return;
            };
            *content = Content::Reply(reply);
        }
        self.tell_health();
        self.commands.send(content);
    }

    /// Carries a command out that was sent when there had been so many wishes to stop. None if it
    /// waits.
    fn carry_out<B: Board>(
        &mut self,
        board: &mut B,
        command: &Command<'m>,
        stops: u32,
    ) -> Option<Reply<'m>> {
        let done = match *command {
            Command::Swap { .. } => return None,
            Command::FallBack { mission } if self.machine.is_on_trial(mission) => return None,
            Command::FallBack { .. } => Err(LinkError::NotOnTrial),
            Command::Confirm { mission, again } => self.confirm(mission, again),
            Command::SetParam {
                mission,
                param,
                value,
            } if PARAMS => match self.check_param(mission, param, value) {
                Ok(()) => return None,
                Err(error) => Err(error),
            },
            Command::ReadChanged { mission } if PARAMS => self.read_changed(mission),
            Command::Saved(ref saved) if PARAMS => Ok(self.save_params(saved)),
            Command::AskValues { number, ref ask } if TELEMETRY => {
                self.answer_of_values(number, ask.as_slice())
            }
            Command::Start => match self.start(stops) {
                Some(done) => done,
                None => return None,
            },
            Command::Release => self.release(board, stops),
            ref question => self.answer(question, B::TICKS_PER_US),
        };
        Some(done.unwrap_or_else(Reply::Failed))
    }

    /// The mission on trial stays.
    fn confirm(&mut self, mission: u32, again: bool) -> Result<Reply<'m>, LinkError> {
        if !self.machine.is_on_trial(mission) && !(again && self.machine.stays(mission)) {
            return Err(LinkError::NotOnTrial);
        }
        let before = self.machine.end_trial().and_then(|trial| trial.before);
        if let Some(before) = before {
            self.machine.free(before, None);
        }
        Ok(Reply::Confirmed { mission })
    }

    /// What differs from the mission's values, to be saved.
    fn read_changed(&self, mission: u32) -> Result<Reply<'m>, LinkError> {
        // So that what the mission before starts with is what was saved for it.
        if self.machine.trial().is_some() {
            return Err(LinkError::OnTrial);
        }
        self.machine.mission_of(mission)?;
        let params = *self.machine.params();
        Ok(Reply::Changed(SavedParams::new(mission, params)))
    }

    /// Values were saved: the mission starts with them from now on.
    fn save_params(&mut self, saved: &SavedParams) -> Reply<'m> {
        self.machine.save(saved);
        Reply::ParamsSaved {
            count: self.machine.saved_len(),
        }
    }

    /// Starts the mission anew, which waits, or says why not.
    fn start(&mut self, stops: u32) -> Option<Result<Reply<'m>, LinkError>> {
        // Latched by the link, and not looked at in a slot yet.
        if self.safety.is_latched() {
            return Some(Err(LinkError::EmergencyStopped));
        }
        // It is older than a stop that has come meanwhile.
        if self.safety.is_overtaken(stops) {
            return Some(Err(LinkError::StopCame));
        }
        match (self.safety.mode(), self.machine.mission()) {
            (Mode::Running, _) => Some(Ok(Reply::Done)),
            (Mode::EmergencyStopped, _) => Some(Err(LinkError::EmergencyStopped)),
            (_, None) => {
                self.safety.set_mode(Mode::Empty);
                Some(Ok(Reply::Done))
            }
            (_, Some(_)) => None,
        }
    }

    /// Ends the emergency stop.
    fn release<B: Board>(&mut self, board: &mut B, stops: u32) -> Result<Reply<'m>, LinkError> {
        // A stop that came behind it goes on.
        if self.safety.is_overtaken(stops) || is_stop_pressed(board) {
            return Err(LinkError::EmergencyStopped);
        }
        let was_stopped = self.safety.release();
        self.observers.keep_emergency_stop(false);
        if was_stopped {
            self.set_stopped(Mode::Stopped, board);
        }
        if self.safety.is_overtaken(stops) {
            // It came while this was done.
            self.safety.latch_again(self.observers.kept());
            return Err(LinkError::EmergencyStopped);
        }
        Ok(Reply::Released)
    }

    /// Whether a parameter can be given this value.
    fn check_param(&self, mission: u32, param: u16, value: u32) -> Result<(), LinkError> {
        let tables = self.machine.mission_of(mission)?.tables();
        let declared = params::declared(&tables, self.execution.registry(), param)
            .ok_or(LinkError::NoSuchIndex)?;
        params::check(declared, value)?;
        self.machine.params().has_room(param)
    }

    /// Gives a parameter the value that a command says, and makes the answer of it. The value was
    /// checked when the command came, for the mission that it names: where that has ended
    /// meanwhile, nothing is done.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    pub(super) fn set_param(&mut self, content: &mut Content<'_>) {
        let Some(&Command::SetParam {
            mission,
            param,
            value,
        }) = content.command()
        else {
            return;
        };
        *content = Content::Reply(match self.machine.set_param(mission, param, value) {
            Ok(before) => Reply::ParamSet { before },
            Err(error) => Reply::Failed(error),
        });
    }
}
