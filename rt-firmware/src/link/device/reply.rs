//! The command to the real-time side, and the answer that it brings.
//!
//! *Invariant:* there is one command. While it is away, who would need it is told
//! [`Busy`](LinkError::Busy).

use super::answers::text_part;
use super::client_session::Sender;
use super::handler::{PendingRequest, Reaction, RequestHandler};
use crate::realtime::mailbox::{Command, Content, NO_DEADLINE, Posted, Reply};
use esm_link::message::{LinkError, Response};

impl<'m> RequestHandler<'_, 'm> {
    /// Asks the real-time side.
    #[inline(never)]
    pub(super) fn ask<'a>(&mut self, question: Command<'m>) -> Reaction<'a> {
        match &mut self.command {
            Some(content) => {
                **content = Content::Command(question);
                self.post()
            }
            None => Reaction::Answer(Err(LinkError::Busy)),
        }
    }

    /// Sends the command to the real-time side, with what was put into it: for the request that is
    /// carried out, if one is.
    pub(super) fn post<'a>(&mut self) -> Reaction<'a> {
        let Some(content) = self.command.take() else {
            return Reaction::Answer(Err(LinkError::Busy));
        };
        let asked = self.pending.take();
        let by_us = match asked {
            Some(pending) if !mutant!(DeadlineForgotten) => pending.by_us,
            _ => NO_DEADLINE,
        };
        // What nobody has asked for starts nothing that a stop has ended.
        let stops = match asked {
            Some(asked) => asked.stops,
            None => self.heartbeats.stops.overtaken(),
        };
        preemptible!();
        match self.to_real_time.enqueue(Posted {
            content,
            by_us,
            stops,
        }) {
            Ok(()) => {
                self.heartbeats.attention.set();
                self.asked = asked;
                Reaction::Later
            }
            // There is one command, so that there is always room.
            Err(Posted { content, .. }) => {
                self.put_away(content);
                Reaction::Answer(Err(LinkError::Busy))
            }
        }
    }

    /// Whether the command is away for somebody who is not the owner.
    pub(super) fn is_with_a_stranger(&self) -> bool {
        let asked = self.asked.as_ref();
        asked.is_some_and(|asked| asked.sender == Sender::Anyone)
    }

    /// The command, if it has come back, and the request that it answers.
    pub(super) fn open_reply(&mut self) -> Option<(Option<PendingRequest>, &'m mut Content<'m>)> {
        let content = self.from_real_time.dequeue()?;
        Some((self.asked.take(), content))
    }

    /// Keeps the command until there is something to ask, and the buffer that is in one that could
    /// not be sent.
    pub(super) fn put_away(&mut self, content: &'m mut Content<'m>) {
        self.tell_of_mission(false);
        match core::mem::replace(content, Content::Empty) {
            Content::Command(Command::Swap { mission, .. }) => {
                let blob = self.memories.take_apart(mission);
                self.keep(blob);
            }
            Content::Reply(Reply::Swapped { pairs, .. }) => self.memories.keep_table(pairs),
            _ => {}
        }
        self.command = Some(content);
    }
}

/// The answer that came back in the command's place.
pub(super) fn answer_of<'l>(content: &'l Content<'_>) -> Result<Response<'l>, LinkError> {
    let Content::Reply(reply) = content else {
        // It came back as it went.
        return Err(LinkError::Late);
    };
    match reply {
        Reply::Swapped {
            mission, carried, ..
        } => Ok(Response::Committed {
            mission: *mission,
            carried: *carried,
        }),
        Reply::Failed(error) => Err(*error),
        Reply::Blob { total, bytes } => Ok(Response::Blob {
            total: *total,
            data: bytes.as_slice(),
        }),
        Reply::States { step, total, bytes } => Ok(Response::States {
            step: *step,
            total: *total,
            states: bytes.as_slice(),
        }),
        Reply::Slot(counters) => Ok(Response::Slot(*counters)),
        #[cfg(feature = "links")]
        Reply::Frame(counters) => Ok(Response::Frame(*counters)),
        Reply::Task(counters) => Ok(Response::TaskInstance(*counters)),
        Reply::Param {
            value,
            of_mission,
            saved,
        } => Ok(Response::Param {
            value: *value,
            of_mission: *of_mission,
            saved: *saved,
        }),
        Reply::Fields { text, offset } => Ok(text_part(text, usize::from(*offset))),
        Reply::ParamsSaved { count } => Ok(Response::ParamsSaved { count: *count }),
        Reply::ParamSet { before } => Ok(Response::ParamSet { before: *before }),
        Reply::Behaviour { key } => Ok(Response::Behaviour { key: *key }),
        Reply::BehaviourList(report) => Ok(Response::BehaviourList {
            script: report.script,
            entries: report.bytes(),
        }),
        Reply::Done
        | Reply::Started
        | Reply::Confirmed { .. }
        | Reply::Released
        | Reply::ValuesWanted { .. } => Ok(Response::Done),
        // It goes to the mission store, and is no answer.
        Reply::Changed(_) => Err(LinkError::Late),
    }
}
