//! The letter to the real-time side, and the answer that it brings.
//!
//! *Invariant:* there is one letter. While it is away, who would need it is told
//! [`Busy`](LinkError::Busy).

use super::answers::text_part;
use super::conversation::Sender;
use super::desk::{Desk, Reaction, Ticket};
use crate::mail::{Letter, NO_DEADLINE, Posted};
use esm_link::message::{LinkError, Response};

impl<'m> Desk<'_, 'm> {
    /// Asks the real-time side.
    #[inline(never)]
    pub(super) fn ask<'a>(&mut self, question: Letter<'m>) -> Reaction<'a> {
        match &mut self.letter {
            Some(letter) => {
                **letter = question;
                self.post()
            }
            None => Reaction::Answer(Err(LinkError::Busy)),
        }
    }

    /// Sends the letter to the real-time side, with what was put into it: for the request that is
    /// carried out, if one is.
    pub(super) fn post<'a>(&mut self) -> Reaction<'a> {
        let Some(letter) = self.letter.take() else {
            return Reaction::Answer(Err(LinkError::Busy));
        };
        let asked = self.ticket.take();
        let by_us = match asked {
            Some(ticket) if !planted!(DeadlineForgotten) => ticket.by_us,
            _ => NO_DEADLINE,
        };
        // First how many, then whether one is ahead: so none is overlooked that is heard in
        // between.
        let stops = self.signs.stops.count();
        let is_overtaken = self.place.is_stop_ahead(&self.signs.stops);
        let stops = (!is_overtaken).then_some(stops);
        preemptible!();
        match self.to_real_time.enqueue(Posted {
            letter,
            by_us,
            stops,
        }) {
            Ok(()) => {
                self.asked = asked;
                Reaction::Later
            }
            // There is one letter, so that there is always room.
            Err(Posted { letter, .. }) => {
                self.put_away(letter);
                Reaction::Answer(Err(LinkError::Busy))
            }
        }
    }

    /// Whether the letter is away for somebody who is not the owner.
    pub(super) fn is_with_a_stranger(&self) -> bool {
        let asked = self.asked.as_ref();
        asked.is_some_and(|asked| asked.sender == Sender::Anyone)
    }

    /// The letter, if it has come back, and the request that it answers.
    pub(super) fn open_letter(&mut self) -> Option<(Option<Ticket>, &'m mut Letter<'m>)> {
        let letter = self.from_real_time.dequeue()?;
        Some((self.asked.take(), letter))
    }

    /// Keeps the letter until there is something to ask, and the buffer that is in one that could
    /// not be sent.
    pub(super) fn put_away(&mut self, letter: &'m mut Letter<'m>) {
        self.tell_of_mission(false);
        match core::mem::replace(letter, Letter::Empty) {
            Letter::Swap { mission, .. } => {
                let blob = self.rooms.take_apart(mission);
                self.keep(blob);
            }
            Letter::Swapped { pairs, .. } => self.rooms.keep_table(pairs),
            _ => {}
        }
        self.letter = Some(letter);
    }
}

/// The answer that a letter brings.
pub(super) fn answer_of<'l>(letter: &'l Letter<'_>) -> Result<Response<'l>, LinkError> {
    match letter {
        Letter::Swapped {
            mission, carried, ..
        } => Ok(Response::Committed {
            mission: *mission,
            carried: *carried,
        }),
        Letter::Failed(error) => Err(*error),
        Letter::Blob { total, bytes } => Ok(Response::Blob {
            total: *total,
            data: bytes.as_slice(),
        }),
        Letter::States { step, total, bytes } => Ok(Response::States {
            step: *step,
            total: *total,
            states: bytes.as_slice(),
        }),
        Letter::Slot(counters) => Ok(Response::Slot(*counters)),
        Letter::Task(counters) => Ok(Response::TaskInstance(*counters)),
        Letter::Param {
            value,
            of_mission,
            saved,
        } => Ok(Response::Param {
            value: *value,
            of_mission: *of_mission,
            saved: *saved,
        }),
        Letter::Fields { text, offset } => Ok(text_part(text, usize::from(*offset))),
        Letter::ParamsSaved { count } => Ok(Response::ParamsSaved { count: *count }),
        Letter::ParamSet { before } => Ok(Response::ParamSet { before: *before }),
        Letter::Done
        | Letter::Started
        | Letter::Confirmed { .. }
        | Letter::Released
        | Letter::ValuesWanted { .. } => Ok(Response::Done),
        // It came back as it went.
        _ => Err(LinkError::Late),
    }
}
