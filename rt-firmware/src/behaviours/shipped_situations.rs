//! Situations that ship, as tasks of a mission.

use super::landmarks::Landmarks;
use super::list::BehaviourList;
use super::lookout::{Lookout, Stillness};
use super::situation::{Circumstances, Situation};
use crate::declaration::Params;
use crate::situation;
use crate::task::Param;
use crate::tasks::{Battery, Pose, Ranges};
use esm_link::behaviours::Situation as Kind;

/// The parameter of a situation comes first, before `reaction`.
const VALUE: Param<f32> = Param::at(0);

/// Looks for one of the situations that scripts know, by its number: for any but a landmark.
#[derive(Debug)]
pub struct Watcher<const KIND: u8> {
    lookout: Lookout,
    stillness: Stillness,
}

impl<const KIND: u8> Default for Watcher<KIND> {
    fn default() -> Self {
        Self {
            lookout: Lookout::new(Kind::ALL[KIND as usize], 0.0),
            stillness: Stillness::NONE,
        }
    }
}

impl<const KIND: u8> Situation for Watcher<KIND> {
    fn look(&mut self, seen: &Circumstances<'_>, params: &Params) -> bool {
        self.lookout.set(params.get(VALUE));
        let moves = self.stillness.moves(seen);
        self.lookout.look(seen, &Landmarks::NONE, moves)
    }

    fn number(&self) -> u8 {
        KIND
    }
}

/// Looks for a landmark, by its number among the situations that scripts know.
#[derive(Debug)]
pub struct LandmarkWatcher<const KIND: u8> {
    lookout: Lookout,
    landmarks: Landmarks,
}

impl<const KIND: u8> Default for LandmarkWatcher<KIND> {
    fn default() -> Self {
        Self {
            lookout: Lookout::new(Kind::ALL[KIND as usize], 0.0),
            landmarks: Landmarks::NONE,
        }
    }
}

impl<const KIND: u8> Situation for LandmarkWatcher<KIND> {
    fn look(&mut self, seen: &Circumstances<'_>, params: &Params) -> bool {
        self.lookout.set(params.get(VALUE));
        let (pose, ranges) = (seen.pose.as_ref(), seen.ranges);
        self.landmarks.look(pose, ranges, seen.period_us, false);
        self.lookout.look(seen, &self.landmarks, true)
    }

    fn number(&self) -> u8 {
        KIND
    }
}

situation! {
    /// Situation: the robot is too far from where it was when the state was entered.
    impl OutsideRange watches Watcher<{ Kind::OutsideRange as u8 }> {
        wcet 200 us;
        params {
            /// Farther than this, in metres.
            radius_m: f32 = 5.0, 0.0..=1000.0;
        }
    }
}

situation! {
    /// Situation: the robot was to move, and has not.
    impl Stuck watches Watcher<{ Kind::Stuck as u8 }> {
        wcet 200 us;
        params {
            /// For so long, in seconds.
            after_s: f32 = 2.0, 0.0..=600.0;
        }
    }
}

situation! {
    /// Situation: nobody knows what is ahead.
    impl SensorLost watches Watcher<{ Kind::SensorLost as u8 }> {
        wcet 200 us;
        params {
            /// For so long, in seconds.
            after_s: f32 = 1.0, 0.0..=600.0;
        }
    }
}

situation! {
    /// Situation: the battery is low, or nobody measures it.
    impl LowBattery watches Watcher<{ Kind::LowBattery as u8 }> {
        wcet 200 us;
        params {
            /// Below this, in volts.
            below_v: f32 = 6.6, 0.0..=100.0;
        }
    }
}

situation! {
    /// Situation: something is near, on any side, or a sonar does not know.
    impl Near watches Watcher<{ Kind::Near as u8 }> {
        wcet 200 us;
        params {
            /// Nearer than this, in metres.
            range_m: f32 = 0.3, 0.0..=4.0;
        }
    }
}

situation! {
    /// Situation: the robot has passed a door on the left, within the last second.
    impl DoorLeft watches LandmarkWatcher<{ Kind::DoorLeft as u8 }> {
        wcet 200 us;
        params {
            /// So wide at least, in metres.
            least_m: f32 = 0.7, 0.0..=1.3;
        }
    }
}

situation! {
    /// Situation: the robot has passed a door on the right, within the last second.
    impl DoorRight watches LandmarkWatcher<{ Kind::DoorRight as u8 }> {
        wcet 200 us;
        params {
            /// So wide at least, in metres.
            least_m: f32 = 0.7, 0.0..=1.3;
        }
    }
}

situation! {
    /// Situation: a wall ahead and one on the left make a corner.
    impl CornerLeft watches LandmarkWatcher<{ Kind::CornerLeft as u8 }> {
        wcet 200 us;
        params {
            /// Both nearer than this, in metres.
            range_m: f32 = 1.0, 0.0..=4.0;
        }
    }
}

situation! {
    /// Situation: a wall ahead and one on the right make a corner.
    impl CornerRight watches LandmarkWatcher<{ Kind::CornerRight as u8 }> {
        wcet 200 us;
        params {
            /// Both nearer than this, in metres.
            range_m: f32 = 1.0, 0.0..=4.0;
        }
    }
}
