//! The command from the link: it is on its way, waits for the interpreter's next activation, or is
//! answered.
//!
//! *Invariant:* there is one command, and it goes back each time.

use heapless::spsc::{Consumer, Producer};

use super::mailbox::{Command, Content, NO_DEADLINE, Posted, Reply};
use crate::board::{Board, ticks};
use crate::features::{BEHAVIOURS, WARM};
use esm_link::message::LinkError;

/// The command, wherever it is, and the queues that bring it and take it back.
pub(crate) struct Commands<'q, 'm> {
    from_link: Consumer<'q, Posted<'m>>,
    to_link: Producer<'q, &'m mut Content<'m>>,
    /// A swap, a start, a fall-back or another value of a parameter, to be done at the
    /// interpreter's next activation.
    waiting: Option<&'m mut Content<'m>>,
    /// What the owner of the list of behaviours is to do, and until when it may take, in ticks.
    of_behaviours: [Option<(&'m mut Content<'m>, u64)>; BEHAVIOURS as usize],
    /// What is answered when the new mission begins.
    answered: Option<&'m mut Content<'m>>,
    /// When it is too late for what waits, on the board's clock in microseconds.
    waiting_by_us: u64,
    /// When it came, in ticks.
    waiting_since_ticks: u64,
}

impl<'q, 'm> Commands<'q, 'm> {
    pub(crate) fn new(
        from_link: Consumer<'q, Posted<'m>>,
        to_link: Producer<'q, &'m mut Content<'m>>,
    ) -> Self {
        Commands {
            from_link,
            to_link,
            waiting: None,
            of_behaviours: [const { None }; BEHAVIOURS as usize],
            answered: None,
            waiting_by_us: NO_DEADLINE,
            waiting_since_ticks: 0,
        }
    }

    /// Whether one has come.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn has_come(&self) -> bool {
        self.from_link.ready()
    }

    /// Takes the one that has come.
    pub(super) fn take(&mut self) -> Option<Posted<'m>> {
        self.from_link.dequeue()
    }

    /// Whether it is too late for one that has come by now. One for which it is not may wait from
    /// now on, until this time.
    pub(super) fn is_late<B: Board>(&mut self, now_ticks: u64, by_us: u64) -> bool {
        self.waiting_by_us = by_us;
        if WARM {
            self.waiting_since_ticks = now_ticks;
        }
        is_past::<B>(now_ticks, by_us)
    }

    /// Lets it wait for the interpreter's next activation.
    pub(super) fn keep_waiting(&mut self, content: &'m mut Content<'m>) {
        self.waiting = Some(content);
    }

    /// Whether it waits.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_waiting(&self) -> bool {
        self.waiting.is_some()
    }

    /// Whether it waits, and changes the mission at a macro step at this time. A swap that is asked
    /// for when that step is due waits for the one after it, for which there are `lead_ticks` to
    /// make it; where the step is late anyway, it comes with it.
    pub(super) fn changes_mission(&self, at_ticks: u64, lead_ticks: u64) -> bool {
        let waiting = self.waiting.as_ref();
        match waiting.and_then(|content| content.command()) {
            None | Some(Command::SetParam { .. }) => false,
            Some(Command::Swap { .. }) if WARM => {
                let due_ticks = self.waiting_since_ticks.checked_sub(at_ticks);
                due_ticks.is_none_or(|due_ticks| due_ticks > lead_ticks)
            }
            Some(_) => true,
        }
    }

    /// Takes the one that waits.
    pub(super) fn take_waiting(&mut self) -> Option<&'m mut Content<'m>> {
        self.waiting.take()
    }

    /// Takes the one that waits, if it is such a one.
    pub(super) fn take_waiting_if(
        &mut self,
        is_such: impl FnOnce(&Command<'m>) -> bool,
    ) -> Option<&'m mut Content<'m>> {
        self.waiting
            .take_if(|content| content.command().is_some_and(is_such))
    }

    /// Hands what waits back if it is too late for it now.
    #[inline(never)]
    pub(super) fn refuse_late<B: Board>(&mut self, now_ticks: u64) {
        if is_past::<B>(now_ticks, self.waiting_by_us)
            && let Some(content) = self.waiting.take()
        {
            self.send(content);
        }
    }

    /// A start that is under way does not come through.
    pub(super) fn refuse_start(&mut self) {
        let is_start = |command: &Command<'_>| matches!(command, Command::Start);
        if let Some(content) = self.take_waiting_if(is_start) {
            content.refuse(LinkError::StopCame);
            self.send(content);
        }
        if let Some(content) = &mut self.answered
            && let Content::Reply(Reply::Started) = **content
        {
            content.refuse(LinkError::StopCame);
        }
    }

    /// Lets it wait for the owner of the list of behaviours, until this time.
    pub(super) fn wait_for_behaviours(&mut self, content: &'m mut Content<'m>, until_ticks: u64) {
        match self.of_behaviours.first_mut() {
            Some(place) => *place = Some((content, until_ticks)),
            None => self.send(content),
        }
    }

    /// Whether it waits for the owner of the list of behaviours; and then, whether it has waited
    /// long enough.
    pub(super) fn waits_for_behaviours(&self, now_ticks: u64) -> Option<bool> {
        let (_, until_ticks) = self.of_behaviours.first()?.as_ref()?;
        Some(now_ticks > *until_ticks)
    }

    /// Sends the reply of the owner of the list of behaviours.
    pub(super) fn reply_of_behaviours(&mut self, reply: Reply<'m>) {
        let waiting = (self.of_behaviours.first_mut()).and_then(Option::take);
        if let Some((content, _)) = waiting {
            *content = Content::Reply(reply);
            self.send(content);
        }
    }

    /// Keeps it until the new mission begins.
    pub(super) fn answer_later(&mut self, content: &'m mut Content<'m>) {
        self.answered = Some(content);
    }

    /// Takes the one that was kept until the new mission begins.
    pub(super) fn take_answered(&mut self) -> Option<&'m mut Content<'m>> {
        self.answered.take()
    }

    /// Sends it back.
    pub(super) fn send(&mut self, content: &'m mut Content<'m>) {
        // There is one place, so that there is room for it.
        let refused = self.to_link.enqueue(content);
        debug_assert!(refused.is_ok());
    }
}

/// Whether the board's clock is past this time in microseconds.
fn is_past<B: Board>(now_ticks: u64, by_us: u64) -> bool {
    now_ticks > ticks::<B>(by_us)
}
