//! Drives up to something.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{OnTrack, Pose, Ranges, Twist};

/// Speed for each metre that is left, in 1/s, and the slowest speed, in metres per second.
const SPEED_PER_M: f32 = 0.8;
const SLOW_M_PER_S: f32 = 0.05;
/// The fastest turn back to the line ahead, in radians per second.
const TURN_MOST_RAD_PER_S: f32 = 0.5;

/// Drives straight ahead until something is near, slower as it comes near. Where it does not know
/// what is ahead it stands.
#[derive(Clone, Copy, Debug, Default)]
pub struct ApproachLaw;

behaviour! {
    /// Behaviour: drives ahead until something is `distance_m` away, and ends.
    impl Approach runs ApproachLaw {
        wcet 300 us;
        params {
            /// How near to come, in metres from the rim.
            distance_m: f32 = 0.3, 0.25..=3.0;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.05..=0.5;
        }
    }
}

impl ApproachLaw {
    /// How fast to drive where so much is free ahead, in metres per second; none where it is near
    /// enough.
    pub fn speed_m_per_s(ahead_m: f32, distance_m: f32, most_m_per_s: f32) -> Option<f32> {
        let left_m = ahead_m - distance_m;
        (left_m > 0.0).then(|| (left_m * SPEED_PER_M).clamp(SLOW_M_PER_S, most_m_per_s))
    }

    /// How to drive at this speed along the line ahead of where the behaviour began.
    pub fn twist(pose: &Pose, forward_m_per_s: f32) -> Twist {
        let line = OnTrack {
            along_m: pose.x_m,
            left_m: pose.y_m,
            turned_rad: pose.heading_rad,
        };
        let turn_rad_per_s = line.back_on_rad_per_s(false);
        Twist {
            forward_m_per_s,
            turn_rad_per_s: turn_rad_per_s.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
        }
    }
}

impl Behaviour for ApproachLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let ahead_m = scene.ranges.map_or(0.0, Ranges::ahead_m);
        if ahead_m <= 0.0 {
            return Control::Move(Twist::STILL);
        }
        let most_m_per_s = params.get(Approach::SPEED_M_PER_S);
        let distance_m = params.get(Approach::DISTANCE_M);
        let Some(forward_m_per_s) = Self::speed_m_per_s(ahead_m, distance_m, most_m_per_s) else {
            return Control::Done;
        };
        Control::Move(Self::twist(&scene.pose(), forward_m_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::behaviours::situation::SafetyCheck;

    #[test]
    fn it_is_slower_as_it_comes_near_and_ends_there() {
        for (ahead_m, expected) in [
            (4.0, Some(0.3)),
            (0.75, Some(0.2)),
            (0.51, Some(0.05)),
            (0.5, None),
            (0.1, None),
        ] {
            let speed = ApproachLaw::speed_m_per_s(ahead_m, 0.5, 0.3);
            let is_equal = match (speed, expected) {
                (Some(speed), Some(expected)) => (speed - expected).abs() < 1e-6,
                (speed, expected) => speed == expected,
            };
            assert!(is_equal, "{ahead_m}: {speed:?}");
        }
    }

    #[test]
    fn an_ideal_robot_comes_as_near_as_it_may_and_is_never_suspended() {
        const PERIOD_S: f32 = 0.02;
        for distance_m in [0.25, 0.3, 1.0] {
            let (mut ahead_m, mut steps) = (3.0, 0);
            while let Some(speed) = ApproachLaw::speed_m_per_s(ahead_m, distance_m, 0.5) {
                assert!(ahead_m > SafetyCheck::stop_distance_m(speed), "{ahead_m}");
                ahead_m -= speed * PERIOD_S;
                steps += 1;
                assert!(steps < 2_000, "{distance_m}");
            }
            assert!((ahead_m - distance_m).abs() < 0.002, "{ahead_m}");
        }
    }

    #[test]
    fn it_stands_where_it_does_not_know_what_is_ahead() {
        let mut ranges = Ranges::FREE;
        ranges.range_m[0] = 0.0;
        for ranges in [None, Some(&ranges)] {
            let scene = Scene::at(&Pose::START, ranges, 20_000);
            let control = ApproachLaw.control(&scene, &Params::default());
            assert_eq!(control, Control::Move(Twist::STILL));
        }
    }
}
