//! The list of behaviours: what stands there, what is inserted, and driving by hand.

use std::time::{Duration, Instant};

use esm_link::behaviours::{
    BehaviourRequest, Call, ENTRY_BYTES, ListEntry, MAX_DRIVE_US, ScriptStatus,
};
use esm_link::message::{Request, Response};
use esm_link::position::Correction;
use rt_firmware::tasks::{Pose, Twist};

use super::{ClientError, LinkClient};
use crate::serial::ByteLink;
use esm_toolkit::script::Script;

/// Where a behaviour comes onto the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Before all others, which go on afterwards.
    Head,
    /// Behind all others.
    Tail,
}

/// What a robot says of its list of behaviours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// How its script is.
    pub script: ScriptStatus,
    /// What stands there, the head first.
    pub entries: Vec<ListEntry>,
}

impl<L: ByteLink> LinkClient<L> {
    /// What stands on the list of behaviours.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`NoBehaviours`](esm_link::message::LinkError::NoBehaviours)
    /// where nobody owns a list.
    pub fn behaviour_list(&mut self) -> Result<Listed, ClientError> {
        self.ask(
            "list behaviours",
            Request::BehaviourList,
            |response| match response {
                Response::BehaviourList { script, entries } => {
                    let (entries, []) = entries.as_chunks::<ENTRY_BYTES>() else {
                        return None;
                    };
                    let entries = entries.iter().map(|bytes| ListEntry::of_bytes(*bytes));
                    let entries = entries.collect::<Option<_>>()?;
                    Some(Listed { script, entries })
                }
                _ => None,
            },
        )
    }

    /// Inserts a behaviour. Answers its key.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`ListFull`](esm_link::message::LinkError::ListFull) and
    /// others.
    pub fn insert_behaviour(&mut self, end: End, call: Call<'_>) -> Result<u16, ClientError> {
        let request = match end {
            End::Head => BehaviourRequest::InsertAtHead(call),
            End::Tail => BehaviourRequest::InsertAtTail(call),
        };
        let request = Request::Behaviours(request);
        self.ask("insert the behaviour", request, |response| match response {
            Response::Behaviour { key } => Some(key),
            _ => None,
        })
    }

    /// Changes the list, where there is nothing to be answered but that it is done.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn change_behaviours(&mut self, request: BehaviourRequest<'_>) -> Result<(), ClientError> {
        self.ask_to_do(
            "change the list of behaviours",
            Request::Behaviours(request),
        )
    }

    /// Tells the robot where it is, or how far it is from where it believes itself to be.
    ///
    /// # Errors
    /// [`ClientError`]; refused with
    /// [`NoPosition`](esm_link::message::LinkError::NoPosition) where nobody takes it.
    pub fn correct_position(
        &mut self,
        correction: Correction,
        by: Pose,
    ) -> Result<(), ClientError> {
        let position = correction.to_bytes([by.x_m, by.y_m, by.heading_rad]);
        let request = BehaviourRequest::Position {
            position: &position,
        };
        self.ask_to_do("correct the position", Request::Behaviours(request))
    }

    /// Moves like this until a time on the robot's clock; a [`Pilot`] works out which.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn drive_until(&mut self, twist: Twist, until_us: u64) -> Result<(), ClientError> {
        let request = Request::Drive {
            forward_m_per_s: twist.forward_m_per_s,
            turn_rad_per_s: twist.turn_rad_per_s,
            until_us,
        };
        self.ask_to_do("drive", request)
    }

    /// Ends driving by hand: what was interrupted goes on.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn end_drive(&mut self) -> Result<(), ClientError> {
        self.ask_to_do("end the drive", Request::EndDrive)
    }

    /// Sends a script and begins it, in place of the one before.
    ///
    /// # Errors
    /// [`ClientError`]; what has arrived by then is not done.
    pub fn run_script(&mut self, script: &Script) -> Result<(), ClientError> {
        let id = script.id();
        for (index, step) in (0..).zip(&script.all) {
            self.change_behaviours(BehaviourRequest::Step {
                script: id,
                index,
                call: step.call(),
            })?;
        }
        self.change_behaviours(BehaviourRequest::Run {
            script: id,
            steps: script.steps as u8,
            all: script.all.len() as u8,
        })
    }

    /// Has the robot keep a script that was [run](Self::run_script) just now, and run it each time
    /// that it starts with the mission that runs.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`NoStore`](esm_link::message::LinkError::NoStore) where it
    /// keeps none.
    pub fn keep_script(&mut self, script: &Script) -> Result<(), ClientError> {
        let request = BehaviourRequest::KeepScript {
            script: script.id(),
        };
        self.ask_to_do("keep the script", Request::Behaviours(request))
    }

    /// No script is kept any more. What runs goes on.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`NoStore`](esm_link::message::LinkError::NoStore) where the
    /// robot keeps none.
    pub fn remove_script(&mut self) -> Result<(), ClientError> {
        let request = Request::Behaviours(BehaviourRequest::KeepScript { script: 0 });
        self.ask_to_do("remove the script", request)
    }

    /// The script that is kept: [`ScriptState::None`](esm_link::behaviours::ScriptState::None)
    /// where there is none, `Runs` where the robot starts it with the mission that runs, `Ended`
    /// where it is for another mission.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn kept_script(&mut self) -> Result<ScriptStatus, ClientError> {
        let request = Request::Behaviours(BehaviourRequest::KeptScript);
        self.ask("which script is kept", request, |response| match response {
            Response::BehaviourList { script, .. } => Some(script),
            _ => None,
        })
    }
}

/// How long the robot's clock is believed before it is asked again.
const BELIEVED: Duration = Duration::from_secs(10);

/// Drives a robot by hand: knows what its clock says, so that no movement lasts longer than it
/// should, however long it was on its way.
#[derive(Debug, Default)]
pub struct Pilot {
    /// What the robot's clock said, and when its answer was here.
    read: Option<(u64, Instant)>,
}

impl Pilot {
    /// Moves like this from now on, for [`MAX_DRIVE_US`] at most.
    ///
    /// # Errors
    /// [`ClientError`]; refused with [`Late`](esm_link::message::LinkError::Late) where it came too
    /// late, with [`TooFast`](esm_link::message::LinkError::TooFast) and others.
    pub fn drive<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        twist: Twist,
    ) -> Result<(), ClientError> {
        let (robot_us, at) = self.read(robot)?;
        // What the clock said was true when the answer began, which was earlier: so the movement
        // ends a little earlier than it may.
        let since = robot.clock().now().saturating_duration_since(at);
        let since_us = u64::try_from(since.as_micros()).unwrap_or(u64::MAX);
        let until_us = robot_us
            .saturating_add(since_us)
            .saturating_add(MAX_DRIVE_US);
        let driven = robot.drive_until(twist, until_us);
        if driven.is_err() {
            self.read = None;
        }
        driven
    }

    fn read<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
    ) -> Result<(u64, Instant), ClientError> {
        let now = robot.clock().now();
        if let Some(read) = self.read
            && now.saturating_duration_since(read.1) < BELIEVED
        {
            return Ok(read);
        }
        let robot_us = robot.robot_us()?;
        let read = (robot_us, robot.clock().now());
        self.read = Some(read);
        Ok(read)
    }
}
