//! What a run tells the list of behaviours while it goes: a script, movements by hand, positions.

use esm_link::position::Correction;
use rt_firmware::tasks::{Pose, Twist};

use crate::link_client::behaviours::Pilot;
use crate::link_client::{ClientError, LinkClient};
use crate::serial::ByteLink;
use esm_toolkit::script::Script;

/// Robot time between two movements that are sent, in microseconds.
const DRIVE_INTERVAL_US: u64 = 100_000;

/// A robot steered by hand for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driven {
    /// Robot time at which it begins, in microseconds.
    pub from_us: u64,
    /// Robot time at which it ends.
    pub to_us: u64,
    /// How it moves.
    pub twist: Twist,
}

/// A robot that is told where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Robot time at which it is, in microseconds.
    pub at_us: u64,
    /// Whether `by` is a position or a difference.
    pub correction: Correction,
    /// Where it is, or how far from where it believes itself to be.
    pub by: Pose,
}

/// What the list of behaviours is told.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ByHand {
    /// A script, and the robot time at which it is sent.
    pub script: Option<(u64, Script)>,
    /// Movements, in the order of their times.
    pub driven: Vec<Driven>,
    /// Positions, in the order of their times.
    pub placed: Vec<Placed>,
}

/// How far that has come.
#[derive(Debug, Default)]
pub(super) struct Telling {
    rest: ByHand,
    pilot: Pilot,
    /// When a movement was sent last, in robot time, since one began.
    sent_us: Option<u64>,
}

impl From<ByHand> for Telling {
    fn from(rest: ByHand) -> Self {
        Self {
            rest,
            ..Self::default()
        }
    }
}

impl Telling {
    /// Tells what is due at this robot time.
    ///
    /// # Errors
    /// [`ClientError`]
    pub(super) fn tell<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        robot_us: u64,
    ) -> Result<(), ClientError> {
        if let Some((_, script)) = self.rest.script.take_if(|(at_us, _)| *at_us <= robot_us) {
            robot.run_script(&script)?;
        }
        while let Some(placed) =
            (self.rest.placed.first().copied()).filter(|placed| placed.at_us <= robot_us)
        {
            self.rest.placed.remove(0);
            robot.correct_position(placed.correction, placed.by)?;
        }
        let Some(driven) = self.rest.driven.first().copied() else {
            return Ok(());
        };
        if driven.to_us <= robot_us {
            self.rest.driven.remove(0);
            if self.sent_us.take().is_some() {
                robot.end_drive()?;
            }
            return Ok(());
        }
        let next_us = match self.sent_us {
            None => driven.from_us,
            Some(sent_us) => sent_us.saturating_add(DRIVE_INTERVAL_US),
        };
        if next_us <= robot_us {
            self.sent_us = Some(robot_us);
            self.pilot.drive(robot, driven.twist)?;
        }
        Ok(())
    }
}
