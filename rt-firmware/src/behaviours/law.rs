//! What a control law sees and says.

use super::situation::SafetyCheck;
use crate::declaration::Params;
use crate::tasks::{Bearings, Pose, Ranges, Twist};

/// What a behaviour sees when it is to say how the robot moves.
#[derive(Clone, Copy, Debug)]
pub struct Scene<'a> {
    /// Where the robot is in the behaviour's local frame.
    pub pose: Pose,
    /// What is around the robot; none where nobody knows.
    pub ranges: Option<&'a Ranges>,
    /// Time between two looks, in microseconds.
    pub period_us: u32,
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

    /// Says how to move now. Called in each activation of its slot, while it executes.
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control;
}
