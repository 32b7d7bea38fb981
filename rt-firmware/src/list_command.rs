//! What the link asks of the list of behaviours, on its way to the list's owner and back.

use crate::declaration::Params;
use crate::features::BEHAVIOURS;
use crate::odometry::Pose;
use esm_link::behaviours::{
    ENTRY_BYTES, ListEntry, MAX_CALL_PARAMS, MAX_WATCHES, ScriptStatus, Watch,
};
use esm_link::message::LinkError;
use esm_link::position::Correction;

const _: () = assert!(MAX_CALL_PARAMS == crate::declaration::MAX_PARAMS);

/// Name of the type of a list of behaviours.
pub(crate) const LIST_TYPE: &str = "BehaviourList";

/// The owner of the list asks for commands in each activation. One that has not for so long is not
/// there, in microseconds.
const DEAF_US: u64 = 200_000;

/// A behaviour that is to be inserted: looked at, and found to be one of the firmware's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Call {
    /// Hash of its task's signature.
    pub(crate) task: u64,
    /// Its parameters.
    pub(crate) params: Params,
    /// Situations that are watched beside it.
    pub(crate) watches: [Option<Watch>; MAX_WATCHES],
}

/// What the list of behaviours is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ListCommand {
    /// Insert a behaviour before the head, or at the tail.
    Insert {
        /// Before the head.
        at_head: bool,
        /// Which one.
        call: Call,
    },
    /// Take a behaviour off.
    Cancel(u16),
    /// Suspend a behaviour, or resume it.
    Hold(u16, bool),
    /// Move by hand, until a time.
    Drive {
        /// Ahead, in metres per second.
        forward_m_per_s: f32,
        /// To the left, in radians per second.
        turn_rad_per_s: f32,
        /// The last microsecond at which it holds: on the board's clock as the link brings it, then
        /// in robot time, by which slots start.
        until_us: u64,
    },
    /// Move by hand no more.
    EndDrive,
    /// Put a step of a script away.
    Step {
        /// Which script.
        script: u32,
        /// Which step.
        index: u8,
        /// What it inserts.
        call: Call,
    },
    /// Begin a script.
    Run {
        /// Which script.
        script: u32,
        /// Its steps.
        steps: u8,
        /// All of them, those included that situations insert.
        all: u8,
    },
    /// End the script.
    EndScript,
    /// Suspend the script, or resume it.
    HoldScript(bool),
    /// Where the robot is in the global frame, or how far off it is there. That is no command to
    /// the list, but comes the same way.
    Position(Correction, Pose),
    /// Say what stands on the list.
    Read,
}

/// What came of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Answer {
    /// Done.
    Done,
    /// This is the key of what was inserted.
    Inserted(u16),
    /// This stands on the list.
    List(Report),
    /// Not done.
    Refused(LinkError),
}

/// Places on the list, IDLE's included.
pub(crate) const MAX_ENTRIES: usize = 9;

/// What stands on the list, and how the script is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Report {
    /// How the script is.
    pub(crate) script: ScriptStatus,
    /// What stands on the list, as on the link. What is behind `len` means nothing.
    pub(crate) entries: [[u8; ENTRY_BYTES]; MAX_ENTRIES],
    /// How many there are.
    pub(crate) len: u8,
}

impl Report {
    /// Nobody is on the list.
    pub(crate) fn new(script: ScriptStatus) -> Self {
        Self {
            script,
            entries: [[0; ENTRY_BYTES]; MAX_ENTRIES],
            len: 0,
        }
    }

    /// One more. There is room for as many as a list has places.
    pub(crate) fn push(&mut self, entry: ListEntry) {
        if let Some(place) = self.entries.get_mut(usize::from(self.len)) {
            *place = entry.to_bytes();
            self.len += 1;
        }
    }

    /// The bytes of the entries.
    pub(crate) fn bytes(&self) -> &[u8] {
        let entries = self.entries.get(..usize::from(self.len));
        entries.unwrap_or_default().as_flattened()
    }
}

/// The one command that is on its way, or its answer. A firmware without behaviours has no room for
/// it.
#[derive(Debug)]
pub(crate) struct CommandBox([Place; BEHAVIOURS as usize]);

#[derive(Debug)]
struct Place {
    command: Option<ListCommand>,
    answer: Option<Answer>,
    /// When the owner of the list asked last, in robot time.
    owner_us: Option<u64>,
    /// When who knows the global position did.
    position_us: Option<u64>,
}

impl Place {
    const EMPTY: Self = Self {
        command: None,
        answer: None,
        owner_us: None,
        position_us: None,
    };
}

impl CommandBox {
    /// Nothing is on its way.
    pub(crate) const EMPTY: Self = Self([Place::EMPTY; BEHAVIOURS as usize]);

    /// Puts a command in, at this robot time.
    ///
    /// # Errors
    /// [`LinkError::NoBehaviours`] or [`LinkError::NoPosition`] where nobody would take it.
    pub(crate) fn put(&mut self, command: ListCommand, now_us: u64) -> Result<(), LinkError> {
        let place = self.0.first_mut().ok_or(LinkError::NoBehaviours)?;
        let (heard_us, nobody) = match command {
            ListCommand::Position(..) => (place.position_us, LinkError::NoPosition),
            _ => (place.owner_us, LinkError::NoBehaviours),
        };
        let is_heard = heard_us.is_some_and(|heard_us| now_us.saturating_sub(heard_us) <= DEAF_US);
        if !is_heard {
            return Err(nobody);
        }
        (place.command, place.answer) = (Some(command), None);
        Ok(())
    }

    /// Takes it, for the owner of the list.
    pub(crate) fn take(&mut self, now_us: u64) -> Option<ListCommand> {
        let place = self.0.first_mut()?;
        place.owner_us = Some(now_us);
        (place.command).take_if(|command| !matches!(command, ListCommand::Position(..)))
    }

    /// Takes what is said of the position, for who knows the global one.
    pub(crate) fn take_position(&mut self, now_us: u64) -> Option<(Correction, Pose)> {
        let place = self.0.first_mut()?;
        place.position_us = Some(now_us);
        let Some(ListCommand::Position(correction, by)) = place.command else {
            return None;
        };
        place.command = None;
        Some((correction, by))
    }

    /// What came of it.
    pub(crate) fn answer(&mut self, answer: Answer) {
        if let Some(place) = self.0.first_mut() {
            place.answer = Some(answer);
        }
    }

    /// Takes the answer, if there is one.
    pub(crate) fn take_answer(&mut self) -> Option<Answer> {
        self.0.first_mut()?.answer.take()
    }

    /// Nobody waits for an answer any more.
    pub(crate) fn give_up(&mut self) {
        if let Some(place) = self.0.first_mut() {
            (place.command, place.answer) = (None, None);
        }
    }

    /// Another mission begins, whose owner of the list nobody has heard of.
    pub(crate) fn forget(&mut self) {
        *self = Self::EMPTY;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_taken_once_and_only_where_somebody_takes_commands() {
        let mut commands = CommandBox::EMPTY;
        let put = |commands: &mut CommandBox, now_us| commands.put(ListCommand::Read, now_us);
        assert_eq!(put(&mut commands, 0), Err(LinkError::NoBehaviours));
        assert_eq!(commands.take(10), None);
        assert_eq!(put(&mut commands, 10 + DEAF_US), Ok(()));
        assert_eq!(commands.take(20), Some(ListCommand::Read));
        assert_eq!(commands.take(30), None);
        commands.answer(Answer::Done);
        assert_eq!(commands.take_answer(), Some(Answer::Done));
        assert_eq!(commands.take_answer(), None);
        let late = put(&mut commands, 31 + DEAF_US);
        assert_eq!(late, Err(LinkError::NoBehaviours));
    }

    #[test]
    fn what_is_said_of_the_position_is_for_who_knows_that() {
        let mut commands = CommandBox::EMPTY;
        let position = ListCommand::Position(Correction::Set, Pose::START);
        assert_eq!(commands.take(10), None);
        assert_eq!(commands.put(position, 10), Err(LinkError::NoPosition));
        assert_eq!(commands.take_position(20), None);
        assert_eq!(commands.put(position, 20), Ok(()));
        assert_eq!(commands.take(30), None);
        let told = commands.take_position(30);
        assert_eq!(told, Some((Correction::Set, Pose::START)));
        assert_eq!(commands.put(ListCommand::Read, 30), Ok(()));
        assert_eq!(commands.take_position(40), None);
        assert_eq!(commands.take(40), Some(ListCommand::Read));
    }
}
