//! Drives along the middle of a corridor.

use super::corridor::Corridor;
use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use super::openings::{Door, Openings};
use super::pings::Pings;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{OnTrack, Pose, Ranges, Twist};

/// The fastest turn, in radians per second.
const TURN_MOST_RAD_PER_S: f32 = 1.0;
/// Off the corridor's direction the robot is slower: at this angle, in radians, it would stand.
const STANDING_RAD: f32 = 0.8;
/// The least part of its speed.
const LEAST_PART: f32 = 0.3;
/// Part of its speed while the walls are not known.
const SEARCH_PART: f32 = 0.5;
/// The fastest way back to a door's middle, in metres per second, speed for each metre of it, in
/// 1/s, and the slowest.
const BACK_MOST_M_PER_S: f32 = 0.1;
const BACK_PER_S: f32 = 1.0;
const BACK_LEAST_M_PER_S: f32 = 0.03;
/// Nearer than this the robot is beside the middle, in metres.
const BESIDE_M: f32 = 0.015;

/// It fails where it has not known the walls for so long, in microseconds.
const LOST_US: u32 = 15_000_000;

/// Keeps to the middle of a corridor by what its sonars see of the walls, and by odometry in
/// between.
#[derive(Clone, Copy, Debug, Default)]
pub struct FollowCorridorLaw {
    corridor: Corridor,
    pings: Pings,
    left: Openings,
    right: Openings,
    /// Where to end, along the corridor.
    goal_m: Option<f32>,
    lost_us: u32,
}

behaviour! {
    /// Behaviour: keeps to the middle of a corridor, and ends after a distance or beside a door.
    impl FollowCorridor runs FollowCorridorLaw {
        wcet 500 us;
        params {
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.05..=0.5;
            /// How far, in metres; beside a door it ends before that, or has failed.
            distance_m: f32 = 5.0, 0.1..=1000.0;
            /// Ends beside the door opening with this number to the left; 0 is none.
            doors_left: u32 = 0, 0..=100;
            /// Ends beside the door opening with this number to the right; 0 is none.
            doors_right: u32 = 0, 0..=100;
        }
    }
}

impl FollowCorridorLaw {
    /// How to move ahead from a place in the corridor.
    pub fn twist(place: &OnTrack, most_m_per_s: f32) -> Twist {
        let part = (1.0 - place.turned_rad.abs() / STANDING_RAD).max(LEAST_PART);
        let turn_rad_per_s = place.back_on_rad_per_s(false);
        Twist {
            forward_m_per_s: most_m_per_s * part,
            turn_rad_per_s: turn_rad_per_s.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
        }
    }

    /// How to move to a goal along the corridor, mostly back; none where it is reached.
    pub fn twist_to(place: &OnTrack, goal_m: f32) -> Option<Twist> {
        let left_m = goal_m - place.along_m;
        if left_m.abs() < BESIDE_M {
            return None;
        }
        let speed_m_per_s =
            (left_m.abs() * BACK_PER_S).clamp(BACK_LEAST_M_PER_S, BACK_MOST_M_PER_S);
        let turn_rad_per_s = place.back_on_rad_per_s(left_m < 0.0);
        Some(Twist {
            forward_m_per_s: speed_m_per_s.copysign(left_m),
            turn_rad_per_s: turn_rad_per_s.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
        })
    }

    /// Looks at the walls. Returns the door that ends, if it is the one that is looked for.
    fn look(&mut self, scene: &Scene<'_>, params: &Params) -> Option<Door> {
        let ranges = scene.ranges?;
        if !self.corridor.is_known() {
            self.corridor.search(&scene.pose, ranges);
            return None;
        }
        let fresh = self.pings.fresh(ranges, scene.period_us);
        let [left, right] = self.corridor.correct(fresh, scene.period_us);
        let wanted = [
            params.get(FollowCorridor::DOORS_LEFT),
            params.get(FollowCorridor::DOORS_RIGHT),
        ];
        let doors = [
            left.and_then(|look| self.left.look(&look)),
            right.and_then(|look| self.right.look(&look)),
        ];
        (doors.into_iter().zip(wanted))
            .find_map(|(door, wanted)| door.filter(|door| door.number == wanted))
    }
}

impl Behaviour for FollowCorridorLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        self.corridor.go_on(&scene.pose);
        if self.goal_m.is_none() {
            // The short way back to a door's middle leads past its posts, by which a slow robot
            // would be misled: there it goes by odometry.
            self.goal_m = self.look(scene, params).map(|door| door.middle_m);
        }
        let place = self.corridor.place();
        if let Some(goal_m) = self.goal_m {
            return Self::twist_to(&place, goal_m).map_or(Control::Done, Control::Move);
        }
        if place.along_m >= params.get(FollowCorridor::DISTANCE_M) {
            let to_a_door = params.get(FollowCorridor::DOORS_LEFT) > 0
                || params.get(FollowCorridor::DOORS_RIGHT) > 0;
            return if to_a_door {
                Control::Failed
            } else {
                Control::Done
            };
        }
        let speed_m_per_s = params.get(FollowCorridor::SPEED_M_PER_S);
        if self.corridor.is_known() {
            self.lost_us = 0;
            return Control::Move(Self::twist(&place, speed_m_per_s));
        }
        self.lost_us = self.lost_us.saturating_add(scene.period_us);
        if self.lost_us > LOST_US {
            return Control::Failed;
        }
        Control::Move(if self.corridor.has_axis() {
            Self::twist(&place, speed_m_per_s * SEARCH_PART)
        } else {
            Twist::STILL
        })
    }
}
