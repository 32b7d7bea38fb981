//! Turns to a heading.

// Parameters are written as in a mission, which has no names for angles.
#![allow(clippy::approx_constant)]

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use super::turn_rate::rate_rad_per_s;
use crate::behaviour;
use crate::declaration::Params;
use crate::odometry::wrapped_rad;
use crate::tasks::{Bearings, Pose, Ranges, Twist};

/// Turns until its heading in the local frame is zero. The frame's centre looks to the goal.
///
/// Source: Schoute, figure 4, `turn_bhv`.
#[derive(Clone, Copy, Debug, Default)]
pub struct TurnToLaw;

behaviour! {
    /// Behaviour: turns by `angle_rad`, counter-clockwise if positive, and ends.
    impl TurnTo runs TurnToLaw {
        wcet 300 us;
        params {
            /// By how much, in radians.
            angle_rad: f32 = 1.5708, -3.1416..=3.1416;
            /// How fast ahead meanwhile, in metres per second.
            speed_m_per_s: f32 = 0.0, -0.5..=0.5;
        }
    }
}

impl Behaviour for TurnToLaw {
    fn centre(&self, start: Pose, params: &Params) -> Pose {
        let heading_rad = wrapped_rad(start.heading_rad + params.get(TurnTo::ANGLE_RAD));
        Pose {
            heading_rad,
            ..start
        }
    }

    fn needs(&self, params: &Params) -> Bearings {
        Bearings::on_the_way(params.get(TurnTo::SPEED_M_PER_S))
    }

    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        match rate_rad_per_s(scene.pose().heading_rad) {
            None => Control::Done,
            Some(turn_rad_per_s) => Control::Move(Twist {
                forward_m_per_s: params.get(TurnTo::SPEED_M_PER_S),
                turn_rad_per_s,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, PI};

    use super::*;

    #[test]
    fn the_rate_is_that_of_figure_4() {
        for (heading_rad, expected) in [
            (1.01, Some(-0.6)),
            (-1.01, Some(0.6)),
            (0.75, Some(-0.45)),
            (-0.75, Some(0.45)),
            (0.5, Some(-0.3)),
            (-0.021, Some(0.3)),
            (0.019, None),
            (-0.019, None),
        ] {
            let rate = rate_rad_per_s(heading_rad);
            let is_equal = match (rate, expected) {
                (Some(rate), Some(expected)) => (rate - expected).abs() < 1e-6,
                (rate, expected) => rate == expected,
            };
            assert!(is_equal, "{heading_rad}: {rate:?}");
        }
    }

    #[test]
    fn ideal_turns_take_as_long_as_the_law_says() {
        // 0.6 rad/s down to 1 rad, ln 2 / 0.6 s down to 0.5 rad, 0.3 rad/s down to 0.02 rad.
        for (angle_rad, expected_s) in [(FRAC_PI_2, 3.71), (PI, 6.32), (-FRAC_PI_2, 3.71)] {
            const PERIOD_S: f32 = 0.01;
            let (mut heading_rad, mut time_s) = (-angle_rad, 0.0);
            while let Some(rate) = rate_rad_per_s(heading_rad) {
                heading_rad += rate * PERIOD_S;
                time_s += PERIOD_S;
                assert!(time_s < 10.0, "it does not end");
            }
            let off = (time_s / expected_s - 1.0).abs();
            assert!(off < 0.02, "{angle_rad}: {time_s} s");
        }
    }
}
