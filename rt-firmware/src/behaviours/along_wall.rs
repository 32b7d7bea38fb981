//! Drives along a wall.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Bearing, Bearings, Pose, RIM_M, Ranges, Twist, WallSight};

/// What is nearer ahead is another wall, in metres from the rim: farther than the way is to be free
/// at the greatest speed.
const CORNER_M: f32 = 0.45;
/// How fast it turns away from that, in radians per second.
const TURN_RAD_PER_S: f32 = 0.8;
/// The fastest turn beside the wall, in radians per second.
const TURN_MOST_RAD_PER_S: f32 = 1.0;
/// Part of its speed around the end of a wall: what is behind it no sonar has seen.
const ROUND_PART: f32 = 0.5;
/// It fails where it has turned by so much and has not found the wall again, in radians.
const LOST_RAD: f32 = 4.7;

/// Keeps a wall beside it: turns away at an inner corner, and drives around an outer one.
#[derive(Clone, Copy, Debug, Default)]
pub struct AlongWallLaw {
    last: Option<Pose>,
    way_m: f32,
    /// By how much it has turned towards a wall that is lost, in radians.
    lost_rad: f32,
}

behaviour! {
    /// Behaviour: keeps a wall beside it, and ends after a distance. It fails where that is lost.
    impl AlongWall runs AlongWallLaw {
        wcet 400 us;
        params {
            /// The wall is to the left, not to the right.
            left: bool = false, false..=true;
            /// How far from the wall to drive, in metres from the rim.
            wall_m: f32 = 0.25, 0.15..=1.0;
            /// How far to drive, in metres.
            distance_m: f32 = 5.0, 0.1..=1000.0;
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.2, 0.05..=0.3;
        }
    }
}

impl AlongWallLaw {
    /// How to move beside a wall to the right, with so much free ahead; a wall to the left is its
    /// mirror image. It stands where one of the three is not known.
    pub fn twist(sight: &WallSight, ahead_m: f32, wall_m: f32, most_m_per_s: f32) -> Twist {
        if ahead_m.min(sight.beside_m).min(sight.diagonal_m) <= 0.0 {
            return Twist::STILL;
        }
        if ahead_m < CORNER_M || sight.scrapes(wall_m) {
            return Twist {
                forward_m_per_s: 0.0,
                turn_rad_per_s: TURN_RAD_PER_S,
            };
        }
        if sight.is_lost(wall_m) {
            let forward_m_per_s = most_m_per_s * ROUND_PART;
            return Twist {
                forward_m_per_s,
                turn_rad_per_s: -forward_m_per_s / (wall_m + RIM_M),
            };
        }
        let towards_rad_per_s = sight.towards_rad_per_s(wall_m);
        Twist {
            forward_m_per_s: most_m_per_s,
            turn_rad_per_s: -towards_rad_per_s.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
        }
    }
}

impl Behaviour for AlongWallLaw {
    fn needs(&self, params: &Params) -> Bearings {
        let side = if params.get(AlongWall::LEFT) {
            Bearing::Left
        } else {
            Bearing::Right
        };
        Bearings::FRONT.with(Bearings::of(&[side]))
    }

    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let pose = scene.pose();
        let moved = (self.last.replace(pose)).map_or(Pose::START, |last| last.to_local(pose));
        self.way_m += moved.x_m;
        if self.way_m >= params.get(AlongWall::DISTANCE_M) {
            return Control::Done;
        }
        let Some(ranges) = scene.ranges else {
            return Control::Move(Twist::STILL);
        };
        let is_left = params.get(AlongWall::LEFT);
        let (beside_m, diagonal_m) = if is_left {
            (ranges.left_m(), ranges.ahead_left_m())
        } else {
            (ranges.right_m(), ranges.ahead_right_m())
        };
        let sight = WallSight {
            beside_m,
            diagonal_m,
        };
        let wall_m = params.get(AlongWall::WALL_M);
        self.lost_rad = if sight.is_lost(wall_m) {
            self.lost_rad + moved.heading_rad.abs()
        } else {
            0.0
        };
        if self.lost_rad > LOST_RAD {
            return Control::Failed;
        }
        let most_m_per_s = params.get(AlongWall::SPEED_M_PER_S);
        let mut twist = Self::twist(&sight, ranges.ahead_m(), wall_m, most_m_per_s);
        if is_left {
            twist.turn_rad_per_s = -twist.turn_rad_per_s;
        }
        Control::Move(twist)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_its_distance_turns_at_corners_and_drives_around_ends() {
        // Ranges to the right, half right and ahead; speed, and the sign of the turn.
        for (beside_m, diagonal_m, ahead_m, speed, turn) in [
            (0.25, 0.399, 4.0, 0.2, 0.0),
            (0.35, 0.54, 4.0, 0.2, -1.0),
            (0.18, 0.3, 4.0, 0.2, 1.0),
            (0.25, 0.399, 0.4, 0.0, 1.0),
            (0.25, 0.15, 4.0, 0.0, 1.0),
            (1.0, 1.5, 4.0, 0.1, -1.0),
            (0.0, 0.399, 4.0, 0.0, 0.0),
            (0.25, 0.0, 4.0, 0.0, 0.0),
            (0.25, 0.399, 0.0, 0.0, 0.0),
        ] {
            let sight = WallSight {
                beside_m,
                diagonal_m,
            };
            let twist = AlongWallLaw::twist(&sight, ahead_m, 0.25, 0.2);
            assert!(
                (twist.forward_m_per_s - speed).abs() < 1e-6,
                "{sight:?}: {twist:?}"
            );
            let has_turn = match turn {
                0.0 => twist.turn_rad_per_s.abs() < 0.01,
                turn => twist.turn_rad_per_s * turn > 0.05,
            };
            assert!(has_turn, "{sight:?}: {twist:?}");
        }
    }
}
