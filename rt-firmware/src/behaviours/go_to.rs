//! Drives to a point.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Pose, Ranges, Twist};

/// Nearer than this to its point the robot is there, in metres.
const REACHED_M: f32 = 0.03;
/// Speed for each metre that is left, in 1/s.
const SPEED_PER_M: f32 = 1.0;
/// The slowest speed, in metres per second.
const SLOW_M_PER_S: f32 = 0.05;
/// Turning rate for each metre that the goal lies to the left, a metre ahead, in rad/s.
const TURN_GAIN_RAD_PER_S: f32 = 2.0;
/// The fastest turn, in radians per second.
const TURN_MOST_RAD_PER_S: f32 = 1.0;

/// Drives to a point of its local frame: turns on the spot while the point is more than 45° off the
/// heading, then drives towards it, slower as it comes near.
#[derive(Clone, Copy, Debug, Default)]
pub struct GoToLaw;

behaviour! {
    /// Behaviour: drives to a point, counted from where it began, and ends.
    impl GoTo runs GoToLaw {
        wcet 300 us;
        params {
            /// How far ahead, in metres.
            x_m: f32 = 1.0, -100.0..=100.0;
            /// How far to the left, in metres.
            y_m: f32 = 0.0, -100.0..=100.0;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.05..=0.5;
        }
    }
}

impl GoToLaw {
    /// The law for a goal that lies so far ahead and to the left of the robot.
    pub fn twist(ahead_m: f32, left_m: f32, most_m_per_s: f32) -> Option<Twist> {
        let square_m2 = ahead_m * ahead_m + left_m * left_m;
        if square_m2 < REACHED_M * REACHED_M {
            return None;
        }
        // The larger of the two is at least 0.7 of the distance, which is enough to slow down by.
        let far_m = ahead_m.abs().max(left_m.abs());
        if ahead_m < left_m.abs() {
            return Some(Twist {
                forward_m_per_s: 0.0,
                turn_rad_per_s: TURN_MOST_RAD_PER_S.copysign(left_m),
            });
        }
        let rate = TURN_GAIN_RAD_PER_S * left_m / far_m;
        Some(Twist {
            forward_m_per_s: (far_m * SPEED_PER_M).clamp(SLOW_M_PER_S, most_m_per_s),
            turn_rad_per_s: rate.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
        })
    }
}

impl Behaviour for GoToLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let goal = Pose {
            x_m: params.get(GoTo::X_M),
            y_m: params.get(GoTo::Y_M),
            heading_rad: 0.0,
        };
        let seen = scene.pose().to_local(goal);
        let twist = Self::twist(seen.x_m, seen.y_m, params.get(GoTo::SPEED_M_PER_S));
        twist.map_or(Control::Done, Control::Move)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MOST_M_PER_S: f32 = 0.25;

    #[test]
    fn it_turns_on_the_spot_drives_towards_its_point_and_slows_down() {
        for (ahead_m, left_m, expected) in [
            (1.0, 0.0, Some((0.25, 0.0))),
            (0.1, 0.0, Some((0.1, 0.0))),
            (0.04, 0.0, Some((0.05, 0.0))),
            (1.0, 0.25, Some((0.25, 0.5))),
            (1.0, -0.9, Some((0.25, -1.0))),
            (0.5, 0.6, Some((0.0, 1.0))),
            (-1.0, -0.1, Some((0.0, -1.0))),
            (0.02, -0.02, None),
        ] {
            let twist = GoToLaw::twist(ahead_m, left_m, MOST_M_PER_S);
            let twist = twist.map(|twist| (twist.forward_m_per_s, twist.turn_rad_per_s));
            assert_eq!(twist, expected, "{ahead_m}, {left_m}");
        }
    }

    #[test]
    fn an_ideal_robot_ends_at_its_point_wherever_that_is() {
        const PERIOD_S: f32 = 0.02;
        for (x_m, y_m) in [
            (1.0, 0.0),
            (0.5, 0.5),
            (-1.0, 0.3),
            (0.0, -2.0),
            (-0.4, 0.0),
        ] {
            let goal = Pose {
                x_m,
                y_m,
                heading_rad: 0.0,
            };
            let mut pose = Pose::START;
            let mut steps = 0;
            loop {
                let seen = pose.to_local(goal);
                let Some(twist) = GoToLaw::twist(seen.x_m, seen.y_m, MOST_M_PER_S) else {
                    break;
                };
                pose = (pose.translate(twist.forward_m_per_s * PERIOD_S, 0.0))
                    .rotate(twist.turn_rad_per_s * PERIOD_S);
                steps += 1;
                assert!(steps < 1_000, "{x_m}, {y_m}: {pose:?}");
            }
            let (off_x_m, off_y_m) = (pose.x_m - x_m, pose.y_m - y_m);
            assert!(off_x_m * off_x_m + off_y_m * off_y_m < REACHED_M * REACHED_M);
        }
    }
}
