//! The script that the robot keeps, and runs by itself when it starts.
//!
//! Steps come one after the other; what has arrived of them stands here as well, so that it can be
//! put into the flash. When the robot starts with a mission, what the flash has for that is asked
//! of the list's owner step by step, as a client would.

use super::behaviours::checked;
use super::handler::{Reaction, RequestHandler};
use super::port::LinkPort;
use super::script_keeper::{Head, StartUp};
use crate::list_command::ListCommand;
use crate::realtime::mailbox::{Command, Content, Reply};
use esm_link::behaviours::{BehaviourRequest, ScriptState, ScriptStatus};
use esm_link::message::{LinkError, Response};

/// So long after its start the robot tries to run the script, in microseconds: the mission must
/// have begun by then, and know where it is.
const START_US: u64 = 10_000_000;
/// From one try to the next, in microseconds.
const AGAIN_US: u64 = 100_000;

impl RequestHandler<'_, '_> {
    /// Answers what is about the script that is kept. None where a request is not.
    pub(super) fn of_kept_script<'a>(
        &mut self,
        request: &BehaviourRequest<'_>,
        port: &mut impl LinkPort,
    ) -> Option<Reaction<'a>> {
        let answer = match *request {
            BehaviourRequest::KeepScript { script: 0 } => self.remove_script(port),
            BehaviourRequest::KeepScript { script } => self.keep_script(script, port),
            BehaviourRequest::KeptScript => Ok(self.kept_script()),
            _ => return None,
        };
        Some(Reaction::Answer(answer))
    }

    fn keep_script<'a>(
        &mut self,
        script: u32,
        port: &mut impl LinkPort,
    ) -> Result<Response<'a>, LinkError> {
        let mission_store = port.mission_store().ok_or(LinkError::NoStore)?;
        let mission = self.running().ok_or(LinkError::NoMission)?;
        let (run, steps, all) = self.script_keeper.run;
        if run != script {
            return Err(LinkError::NoScript);
        }
        let head = Head {
            script,
            steps,
            all,
            mission,
        };
        mission_store.keep_script(Some(self.script_keeper.whole(head)?))?;
        self.script_keeper.kept = Some(head);
        Ok(Response::Done)
    }

    fn remove_script<'a>(&mut self, port: &mut impl LinkPort) -> Result<Response<'a>, LinkError> {
        let mission_store = port.mission_store().ok_or(LinkError::NoStore)?;
        if self.script_keeper.kept.is_some() {
            mission_store.keep_script(None)?;
            self.script_keeper.kept = None;
        }
        self.script_keeper.start_up = None;
        Ok(Response::Done)
    }

    fn kept_script<'a>(&self) -> Response<'a> {
        let running = self.running();
        let status = self.script_keeper.kept.map(|head| ScriptStatus {
            script: head.script,
            steps: head.steps,
            ended: 0,
            state: if running == Some(head.mission) {
                ScriptState::Runs
            } else {
                ScriptState::Ended
            },
        });
        Response::BehaviourList {
            script: status.unwrap_or_default(),
            entries: &[],
        }
    }

    /// Hash of the mission that runs.
    fn running(&self) -> Option<u32> {
        let health = self.snapshot.read()?;
        health.mission
    }

    /// The robot starts: it looks which script it keeps, and runs that, if it `may`, as soon as the
    /// mission runs that it is for.
    pub(super) fn begin_with_kept_script(&mut self, port: &mut impl LinkPort, may_start: bool) {
        self.script_keeper.load(port);
        let now_us = port.now_us();
        self.script_keeper.start_up = may_start.then_some(StartUp {
            next: 0,
            until_us: now_us.saturating_add(START_US),
            again_us: now_us,
            is_asked: false,
        });
    }

    /// Asks for the next step of the script that is kept, as long as the robot starts.
    pub(super) fn go_on_with_kept_script(&mut self, port: &mut impl LinkPort) {
        let Some(start_up) = self.script_keeper.start_up else {
            return;
        };
        let now_us = port.now_us();
        let Some(head) = self
            .script_keeper
            .kept
            .filter(|_| now_us <= start_up.until_us)
        else {
            if !start_up.is_asked {
                self.script_keeper.start_up = None;
            }
            return;
        };
        let is_free = self.command.is_some() && !start_up.is_asked;
        if now_us < start_up.again_us || !is_free || self.running() != Some(head.mission) {
            return;
        }
        let Some(command) = self.next_of_script(head, start_up.next) else {
            // It is of another firmware.
            self.script_keeper.start_up = None;
            return;
        };
        // No client has asked for it.
        self.pending = None;
        if let Reaction::Later = self.ask(Command::Behaviours(command))
            && let Some(start_up) = &mut self.script_keeper.start_up
        {
            start_up.is_asked = true;
        }
    }

    /// What came of it, which no client has asked for.
    pub(super) fn take_answer_to_kept_script(&mut self, content: &Content<'_>, now_us: u64) {
        let Some(start_up) = &mut self.script_keeper.start_up else {
            return;
        };
        let all = self.script_keeper.kept.map_or(0, |head| head.all);
        if !core::mem::take(&mut start_up.is_asked) {
            return;
        }
        match content {
            Content::Reply(Reply::Done) if start_up.next < all => start_up.next += 1,
            // The mission has not come so far.
            Content::Reply(Reply::Failed(LinkError::NoBehaviours)) => {
                start_up.again_us = now_us.saturating_add(AGAIN_US);
            }
            // It runs, or cannot.
            _ => self.script_keeper.start_up = None,
        }
    }

    /// What is to be asked of the list's owner next.
    fn next_of_script(&self, head: Head, next: u8) -> Option<ListCommand> {
        let Head {
            script, steps, all, ..
        } = head;
        if next == all {
            return Some(ListCommand::Run { script, steps, all });
        }
        let call = self.script_keeper.step(next)?;
        Some(ListCommand::Step {
            script,
            index: next,
            call: checked(&call, self.registry).ok()?,
        })
    }
}
