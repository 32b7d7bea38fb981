//! What a person wants to know of a drive afterwards: the path, the rooms, the touches.

use crate::world::World;

use super::pose::BodyPose;
use super::touch::Touch;

/// Where the body was at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSample {
    /// Plant time, in microseconds.
    pub t_us: u64,
    /// Where it was.
    pub pose: BodyPose,
}

/// Path, rooms and touches of a run.
#[derive(Clone, Debug, Default)]
pub struct Statistics {
    path: Vec<PathSample>,
    rooms_entered: Vec<String>,
    room_now: Option<String>,
    touches: Vec<Touch>,
}

impl Statistics {
    /// Time between two samples of the path, in microseconds.
    pub const SAMPLE_PERIOD_US: u64 = 100_000;

    /// The path, a sample each [`Self::SAMPLE_PERIOD_US`], the start first.
    pub fn path(&self) -> &[PathSample] {
        &self.path
    }

    /// The rooms that the robot has come into, each once, in the order of the first time. The room
    /// in which it started is among them only after it has left and come back.
    pub fn rooms_entered(&self) -> &[String] {
        &self.rooms_entered
    }

    /// The room in which the robot is, if it is in one.
    pub fn room_now(&self) -> Option<&str> {
        self.room_now.as_deref()
    }

    /// All touches of walls and people, in the order of their times.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// How many of them a robot that obeys its stop distance could have avoided.
    pub fn avoidable(&self) -> u32 {
        // So many touches that they cannot be counted do not fit into a run.
        self.touches.iter().filter(|touch| touch.avoidable).count() as u32
    }

    pub(super) fn add_touch(&mut self, touch: Touch) {
        self.touches.push(touch);
    }

    pub(super) fn sample(&mut self, t_us: u64, pose: BodyPose, world: &World) {
        let first = self.path.is_empty();
        self.path.push(PathSample { t_us, pose });
        let room = world.room_at(pose.position).map(|room| room.name.as_str());
        if room == self.room_now.as_deref() {
            return;
        }
        self.room_now = room.map(str::to_owned);
        if let Some(name) = room
            && !first
            && !self.rooms_entered.iter().any(|entered| entered == name)
        {
            self.rooms_entered.push(name.to_owned());
        }
    }
}
