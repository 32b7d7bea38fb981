//! Which way round the robot drives.
//!
//! A ring of sonars looks to all sides alike. So a robot that has lost a sonar with which it must
//! look ahead turns around once, and from then on drives with its back ahead: its laws see a robot
//! whose front that is.

use core::f32::consts::PI;

use super::turn_rate::rate_rad_per_s;
use crate::odometry::wrapped_rad;
use crate::tasks::{Bearings, Pose, Ranges, Twist};

/// Whether robots turn around. A small one does without, and stands.
const TURNS_AROUND: bool = cfg!(feature = "all-behaviours");

/// How many ends of its own a robot knows of beside its front.
const OTHER_ENDS: usize = TURNS_AROUND as usize;

/// Which end of the robot is ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WayRound([Turned; OTHER_ENDS]);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Turned {
    is_reversed: bool,
    /// The heading that the robot turns to before the other end is ahead, in radians.
    to_rad: Option<f32>,
}

impl WayRound {
    /// The front is ahead.
    pub const FORWARDS: Self = Self(
        [Turned {
            is_reversed: false,
            to_rad: None,
        }; OTHER_ENDS],
    );

    /// Whether the back is ahead.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn is_reversed(&self) -> bool {
        self.0.first().is_some_and(|turned| turned.is_reversed)
    }

    /// The robot's pose, as its laws see it.
    pub fn pose(self, pose: Pose) -> Pose {
        if self.is_reversed() {
            pose.rotate(PI)
        } else {
            pose
        }
    }

    /// What is around the robot, as its laws see it; `room` is for what differs from the ranges.
    pub fn ranges<'a>(
        self,
        ranges: Option<&'a Ranges>,
        room: &'a mut Option<Ranges>,
    ) -> Option<&'a Ranges> {
        if !self.is_reversed() {
            return ranges;
        }
        *room = ranges.map(Ranges::reversed);
        room.as_ref()
    }

    /// How the robot is to move for what its laws say.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn twist(&self, twist: Twist) -> Twist {
        if self.is_reversed() {
            Twist {
                forward_m_per_s: -twist.forward_m_per_s,
                ..twist
            }
        } else {
            twist
        }
    }

    /// Whether there is nothing to find out: the front is ahead, and all sonars hear.
    #[inline(always)]
    pub fn is_settled(&self, ranges: Option<&Ranges>) -> bool {
        let is_usual = |turned: &Turned| !turned.is_reversed && turned.to_rad.is_none();
        self.0.first().is_none_or(is_usual)
            && ranges.is_none_or(|ranges| ranges.dead | ranges.deaf == 0)
    }

    /// Whether the robot is to turn around, or does so. `ranges` are as the laws see them. `needs`
    /// is where it must be able to look; none where its front must be ahead.
    pub fn is_to_change(
        self,
        ranges: Option<&Ranges>,
        needs: impl Fn() -> Option<Bearings>,
    ) -> bool {
        let is_wrong = || match needs() {
            Some(needs) => ranges.is_some_and(|ranges| is_better(ranges, needs)),
            None => self.is_reversed(),
        };
        (self.0.iter()).any(|turned| turned.to_rad.is_some() || is_wrong())
    }

    /// Looks at the sonars that are needed, in the laws' eyes. Says how to turn, as long as the
    /// robot turns around; then the other end is ahead. `pose` is the robot's own.
    pub fn turn_around(
        &mut self,
        pose: &Pose,
        ranges: Option<&Ranges>,
        needs: impl Fn() -> Option<Bearings>,
    ) -> Option<Twist> {
        if self.is_settled(ranges) || !self.is_to_change(ranges, needs) {
            return None;
        }
        let turned = self.0.first_mut()?;
        let back_rad = wrapped_rad(pose.heading_rad + PI);
        let to_rad = *turned.to_rad.get_or_insert(back_rad);
        let rate = rate_rad_per_s(wrapped_rad(pose.heading_rad - to_rad));
        if rate.is_none() {
            *turned = Turned {
                is_reversed: !turned.is_reversed,
                to_rad: None,
            };
        }
        Some(Twist {
            forward_m_per_s: 0.0,
            turn_rad_per_s: rate.unwrap_or(0.0),
        })
    }
}

/// Whether a robot that has lost a sonar sees more of what it needs to see with its other end
/// ahead.
fn is_better(ranges: &Ranges, needs: Bearings) -> bool {
    if ranges.dead | ranges.deaf == 0 {
        return false;
    }
    let live = ranges.live();
    needs.without(live.reversed()).count() < needs.without(live).count()
}
