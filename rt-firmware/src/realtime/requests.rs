//! The command from the link: what can be done at once is done and answered, by a function for each
//! command, and what changes the mission or a parameter waits for the interpreter's next
//! activation. What is only asked stands in [`answers`](super::answers).

use super::params::SavedParams;
use super::safe_state::is_stop_pressed;
use super::{RealTime, params};
use crate::board::{Board, ticks};
use crate::features::{BEHAVIOURS, PARAMS, TELEMETRY};
use crate::list_command::{Answer, ListCommand};
use crate::realtime::mailbox::{Command, Content, Posted, Reply};
use esm_link::message::{LinkError, Mode};

/// How long the owner of the list of behaviours may take to answer, in microseconds: many periods
/// of its slot.
const BEHAVIOURS_ANSWER_US: u32 = 500_000;

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
        if BEHAVIOURS && let Some(&Command::Behaviours(command)) = content.command() {
            return self.ask_behaviours::<B>(content, command, now_ticks);
        }
        if let Some(command) = content.command() {
            *content = Content::Reply(match self.waits(command, stops) {
                Ok(true) => {
                    self.commands.keep_waiting(content);
                    return;
                }
                Ok(false) => self.carry_out(board, command, stops),
                Err(error) => Reply::Failed(error),
            });
        }
        self.tell_health();
        self.commands.send(content);
    }

    /// Asks the owner of the list of behaviours.
    #[inline(never)]
    fn ask_behaviours<B: Board>(
        &mut self,
        content: &'m mut Content<'m>,
        mut command: ListCommand,
        now_ticks: u64,
    ) {
        // The host goes by the board's clock, tasks by the nominal starts of their slots.
        let now_us = self.timetable.robot_us_at::<B>(now_ticks);
        if let ListCommand::Drive { until_us, .. } = &mut command {
            *until_us = self.timetable.robot_us_at::<B>(ticks::<B>(*until_us));
        }
        match self.execution.behaviours().put(command, now_us) {
            Ok(()) => {
                let until_ticks = now_ticks + ticks::<B>(BEHAVIOURS_ANSWER_US);
                self.commands.wait_for_behaviours(content, until_ticks);
            }
            Err(error) => {
                content.refuse(error);
                self.commands.send(content);
            }
        }
    }

    /// Replies what came of a command to the list of behaviours, if anything did by now.
    #[inline(never)]
    pub(super) fn answer_behaviours(&mut self, now_ticks: u64) {
        let Some(is_late) = self.commands.waits_for_behaviours(now_ticks) else {
            return;
        };
        let reply = match self.execution.behaviours().take_answer() {
            Some(Answer::Done) => Reply::Done,
            Some(Answer::Inserted(key)) => Reply::Behaviour { key },
            Some(Answer::List(report)) => Reply::BehaviourList(report),
            Some(Answer::Refused(error)) => Reply::Failed(error),
            None if is_late => {
                self.execution.behaviours().give_up();
                Reply::Failed(LinkError::NoBehaviours)
            }
            None => return,
        };
        self.commands.reply_of_behaviours(reply);
    }

    /// Whether a command waits for the interpreter's next activation that was sent when there had
    /// been so many wishes to stop.
    fn waits(&mut self, command: &Command<'m>, stops: u32) -> Result<bool, LinkError> {
        match *command {
            Command::Swap { .. } => Ok(true),
            Command::FallBack { mission } if self.machine.is_on_trial(mission) => Ok(true),
            Command::FallBack { .. } => Err(LinkError::NotOnTrial),
            Command::SetParam {
                mission,
                param,
                value,
            } if PARAMS => self.check_param(mission, param, value).map(|()| true),
            Command::Start => self.may_start(stops),
            _ => Ok(false),
        }
    }

    /// Carries a command out at once.
    fn carry_out<B: Board>(
        &mut self,
        board: &mut B,
        command: &Command<'m>,
        stops: u32,
    ) -> Reply<'m> {
        match *command {
            Command::Confirm { mission, again } => self.confirm(mission, again),
            Command::ReadChanged { mission } if PARAMS => self.read_changed(mission),
            Command::Saved(ref saved) if PARAMS => self.save_params(saved),
            Command::AskValues { number, ref ask } if TELEMETRY => {
                let answer = self.answer_of_values(number, ask.as_slice());
                answer.unwrap_or_else(Reply::Failed)
            }
            Command::Start => Reply::Done,
            Command::Release => self.release(board, stops),
            ref question => self.answer(question, B::TICKS_PER_US),
        }
    }

    /// The mission on trial stays.
    fn confirm(&mut self, mission: u32, again: bool) -> Reply<'m> {
        let is_meant = self.machine.is_on_trial(mission) || again && self.machine.stays(mission);
        if !is_meant {
            return Reply::Failed(LinkError::NotOnTrial);
        }
        let before = self.machine.end_trial().and_then(|trial| trial.before);
        if let Some(before) = before {
            self.machine.free(before, None);
        }
        Reply::Confirmed { mission }
    }

    /// What differs from the mission's values, to be saved.
    fn read_changed(&self, mission: u32) -> Reply<'m> {
        match (self.machine.trial(), self.machine.mission_of(mission)) {
            // So that what the mission before starts with is what was saved for it.
            (Some(_), _) => Reply::Failed(LinkError::OnTrial),
            (None, Ok(_)) => Reply::Changed(SavedParams::new(mission, *self.machine.params())),
            (None, Err(error)) => Reply::Failed(error),
        }
    }

    /// Values were saved: the mission starts with them from now on.
    fn save_params(&mut self, saved: &SavedParams) -> Reply<'m> {
        self.machine.save(saved);
        Reply::ParamsSaved {
            count: self.machine.saved_len(),
        }
    }

    /// Whether the mission starts anew, which waits. It need not where it runs, or is not there.
    fn may_start(&mut self, stops: u32) -> Result<bool, LinkError> {
        // Latched by the link, and not looked at in a slot yet.
        if self.safety.is_emergency_latched() {
            return Err(LinkError::EmergencyStopped);
        }
        // It is older than a stop that has come meanwhile.
        if self.safety.is_overtaken(stops) {
            return Err(LinkError::StopCame);
        }
        match (self.safety.mode(), self.machine.mission()) {
            (Mode::Running, _) => Ok(false),
            (Mode::EmergencyStopped, _) => Err(LinkError::EmergencyStopped),
            (_, None) => {
                self.safety.set_mode(Mode::Empty);
                Ok(false)
            }
            (_, Some(_)) => Ok(true),
        }
    }

    /// Ends the emergency stop.
    fn release<B: Board>(&mut self, board: &mut B, stops: u32) -> Reply<'m> {
        // A stop that came behind it goes on.
        if self.safety.is_overtaken(stops) || is_stop_pressed(board) {
            return Reply::Failed(LinkError::EmergencyStopped);
        }
        let was_stopped = self.safety.release();
        self.observers.keep_emergency_stop(false);
        if was_stopped {
            self.set_stopped(Mode::Stopped, board);
        }
        if self.safety.is_overtaken(stops) {
            // It came while this was done.
            self.safety.latch_again(self.observers.kept());
            return Reply::Failed(LinkError::EmergencyStopped);
        }
        Reply::Released
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
