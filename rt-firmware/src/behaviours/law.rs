//! What a control law sees and says.

use crate::ports::Io;
use crate::task::{MAX_PARAMS, Param, ParamType};
use crate::tasks::{Pose, Ranges, Twist};

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

/// The parameters of a behaviour: those of its task state, or of the command that inserted it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Params([u32; MAX_PARAMS]);

impl Params {
    /// Those of the task that is executed.
    pub fn of(io: &Io<'_>) -> Self {
        Self(*io.param_bits())
    }

    /// The value of a parameter.
    pub fn get<P: ParamType>(&self, param: Param<P>) -> P {
        let bits = self.0.get(usize::from(param.index));
        P::from_bits(bits.copied().unwrap_or(0))
    }
}

impl From<[u32; MAX_PARAMS]> for Params {
    fn from(bits: [u32; MAX_PARAMS]) -> Self {
        Self(bits)
    }
}

/// A control law.
pub trait Behaviour: Send {
    /// The centre of its local frame: the robot's pose when the behaviour comes onto the list,
    /// unless the law says otherwise.
    fn centre(&self, start: Pose, _params: &Params) -> Pose {
        start
    }

    /// Says how to move now. Called in each activation of its slot, while it executes.
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control;
}
