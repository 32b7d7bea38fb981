//! What a control law sees and says.

use super::situation::SafetyCheck;
use crate::declaration::Params;
use crate::odometry::LocalFrame;
use crate::tasks::{Bearings, Pose, Ranges, Twist};

/// What a behaviour sees when it is to say how the robot moves.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Where the robot is, and the frame that it is seen from; none where it is seen already.
    pose: &'a Pose,
    frame: Option<&'a LocalFrame>,
    /// What is around the robot; none where nobody knows.
    pub ranges: Option<&'a Ranges>,
    /// Time between two looks, in microseconds.
    pub period_us: u32,
}

impl<'a> Scene<'a> {
    /// What a behaviour sees that is there in its local frame.
    pub fn at(pose: &'a Pose, ranges: Option<&'a Ranges>, period_us: u32) -> Self {
        Self {
            pose,
            frame: None,
            ranges,
            period_us,
        }
    }

    /// What a behaviour sees that has this local frame.
    pub fn seen_from(
        frame: &'a LocalFrame,
        pose: &'a Pose,
        ranges: Option<&'a Ranges>,
        period_us: u32,
    ) -> Self {
        Self {
            frame: Some(frame),
            ..Self::at(pose, ranges, period_us)
        }
    }

    /// Where the robot is in the behaviour's local frame. Worked out when it is asked for: ten sums
    /// and products, which who only looks at ranges does not pay.
    pub fn pose(&self) -> Pose {
        (self.frame).map_or(*self.pose, |frame| frame.see(*self.pose))
    }
}

/// What a behaviour says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Control {
    /// Move like this.
    Move(Twist),
    /// The goal is reached.
    Done,
    /// The goal cannot be reached.
    Failed,
}

/// A control law.
pub trait Behaviour: Send {
    /// The centre of its local frame: the robot's pose when the behaviour comes onto the list,
    /// unless the law says otherwise.
    fn centre(&self, start: Pose, _params: &Params) -> Pose {
        start
    }

    /// Where it must be able to look. If a sonar there is dead, and fewer are that look there once
    /// the robot has turned around, it turns around and drives with its back ahead.
    fn needs(&self, _params: &Params) -> Bearings {
        Bearings::FRONT
    }

    /// Whether the robot's front must be ahead, whatever it can see: one that drives with its back
    /// ahead turns around first.
    fn is_front_first(&self) -> bool {
        false
    }

    /// Free way that is to be left when the robot has stopped, in metres from its rim.
    fn clearance_m(&self, _scene: &Scene<'_>, _params: &Params) -> f32 {
        SafetyCheck::CLEARANCE_M
    }

    /// Whether its last look took readings of sonars that were new, which is most of its work: who
    /// else listens to them beside it waits for an activation in which it has less to do.
    fn has_heard(&self) -> bool {
        false
    }

    /// Says how to move now. Called in each activation of its slot, while it executes.
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control;
}
