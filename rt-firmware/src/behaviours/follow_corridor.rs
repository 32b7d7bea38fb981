//! Drives along the middle of a corridor.

use core::f32::consts::PI;

use super::corridor::Corridor;
use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use super::openings::{Door, Openings};
use super::pings::Pings;
use crate::behaviour;
use crate::declaration::Params;
use crate::odometry::wrapped_rad;
use crate::tasks::{Bearing, Bearings, OnTrack, Pose, Ranges, Sector, Twist};

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
/// Where it turns around to go back, it drives once it looks along the corridor to this, in
/// radians; it turns by so much for each radian, in 1/s, and no faster than this, in radians per
/// second.
const ALONG_RAD: f32 = 0.05;
const ALONG_PER_S: f32 = 4.0;
const ALONG_RAD_PER_S: f32 = 0.6;

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
    /// It turns around to go back there, for nobody looks behind.
    turns_around: bool,
    lost_us: u32,
    /// New pings came in the last look.
    has_heard: bool,
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

    /// The same for a robot that never drives backwards: it turns around to go back, and again at
    /// its goal.
    pub fn twist_around_to(place: &OnTrack, goal_m: f32) -> Option<Twist> {
        let left_m = goal_m - place.along_m;
        let is_there = left_m.abs() < BESIDE_M;
        let looks_back = left_m < 0.0 && !is_there;
        let turned_rad = if looks_back {
            wrapped_rad(place.turned_rad - PI)
        } else {
            place.turned_rad
        };
        let turn_rad_per_s = -turned_rad * ALONG_PER_S;
        let twist = |forward_m_per_s| {
            Some(Twist {
                forward_m_per_s,
                turn_rad_per_s: turn_rad_per_s.clamp(-ALONG_RAD_PER_S, ALONG_RAD_PER_S),
            })
        };
        if turned_rad.abs() > ALONG_RAD {
            return twist(0.0);
        }
        if is_there {
            return None;
        }
        twist((left_m.abs() * BACK_PER_S).clamp(BACK_LEAST_M_PER_S, BACK_MOST_M_PER_S))
    }

    /// Looks at the walls. Returns the door that ends, if it is the one that is looked for.
    fn look(&mut self, scene: &Scene<'_>, params: &Params) -> Option<Door> {
        let ranges = scene.ranges?;
        if !self.corridor.is_known() {
            self.corridor.search(&scene.pose(), ranges);
            return None;
        }
        let has_heard = &mut self.has_heard;
        let fresh = (self.pings.fresh(ranges, scene.period_us)).inspect(|_| *has_heard = true);
        let [left, right] = (self.corridor).correct(fresh, ranges.live(), scene.period_us);
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
    fn needs(&self, params: &Params) -> Bearings {
        let mut needs = Bearings::FRONT;
        for (doors, side) in [
            (FollowCorridor::DOORS_LEFT, Bearing::Left),
            (FollowCorridor::DOORS_RIGHT, Bearing::Right),
        ] {
            if params.get(doors) > 0 {
                needs = needs.with(Bearings::of(&[side]));
            }
        }
        needs
    }

    fn has_heard(&self) -> bool {
        self.has_heard
    }

    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        self.has_heard = false;
        self.corridor.go_on(&scene.pose());
        if self.goal_m.is_none() {
            // The short way back to a door's middle leads past its posts, by which a slow robot
            // would be misled: there it goes by odometry.
            self.goal_m = self.look(scene, params).map(|door| door.middle_m);
        }
        let place = self.corridor.place();
        if let Some(goal_m) = self.goal_m {
            let is_behind = place.along_m > goal_m;
            let is_seen = |ranges: &Ranges| ranges.free_range(Sector::Back) > 0.0;
            self.turns_around |= is_behind && !scene.ranges.is_some_and(is_seen);
            let twist = if self.turns_around {
                Self::twist_around_to(&place, goal_m)
            } else {
                Self::twist_to(&place, goal_m)
            };
            return twist.map_or(Control::Done, Control::Move);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_never_drives_backwards_turns_around_goes_back_and_looks_along_again() {
        const PERIOD_S: f32 = 0.02;
        for (goal_m, turned_rad) in [(-0.6, 0.0), (-0.05, 0.1), (0.3, -0.2), (0.0, 0.5)] {
            let mut pose = Pose {
                heading_rad: turned_rad,
                ..Pose::START
            };
            let mut steps = 0;
            loop {
                let place = OnTrack {
                    along_m: pose.x_m,
                    left_m: pose.y_m,
                    turned_rad: pose.heading_rad,
                };
                let Some(twist) = FollowCorridorLaw::twist_around_to(&place, goal_m) else {
                    break;
                };
                assert!(twist.forward_m_per_s >= 0.0);
                pose = (pose.translate(twist.forward_m_per_s * PERIOD_S, 0.0))
                    .rotate(twist.turn_rad_per_s * PERIOD_S);
                steps += 1;
                assert!(steps < 2_000, "{goal_m}: {pose:?}");
            }
            assert!((pose.x_m - goal_m).abs() < BESIDE_M, "{goal_m}: {pose:?}");
            assert!(pose.heading_rad.abs() <= ALONG_RAD && pose.y_m.abs() < 0.03);
        }
    }
}
