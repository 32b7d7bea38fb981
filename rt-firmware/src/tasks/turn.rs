//! Turns on the spot.

use super::laws::Approach;
use super::values::{Pose, Twist};
use crate::odometry::wrapped_rad;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// It slows down at the end, and never so far that friction would end the turn early: the wheels
/// roll by 7 mm/s then, and 0.8 mm, 0.008 rad, more when they are to stand: as much as the
/// tolerance, so that it ends at the goal. An encoder count is 0.0007 rad.
const APPROACH: Approach = Approach {
    per_s: 5.0,
    slowest_per_s: 0.07,
    tolerance: 0.008,
    standing_per_s: 0.05,
};

/// Turns on the spot by `angle_rad` and finishes when it stands there: to the left if `left` is
/// set, else to the right. Where it has turned too far, it turns back. As long as it has no pose,
/// it stands.
#[derive(Clone, Copy, Debug, Default)]
pub struct Turn {
    /// Heading at the last step, none before the first.
    last_heading_rad: Option<f32>,
    turned_rad: f32,
}

task! {
    /// Turns on the spot by `angle_rad`, to half a degree, and finishes when it stands: to the left
    /// if `left` is set, else to the right. Without a pose it stands.
    impl Turn {
        slot 2;
        wcet 300 us;
        exclusive motion;
        data {
            /// Where the robot is.
            in pose: Pose optional within 100 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        flags {
            /// Set on the way in: to the left.
            in left;
        }
        params {
            /// By how much, in radians.
            angle_rad: f32 = 1.1, 0.0..=6.2;
            /// How fast at most, in radians per second.
            rate_rad_per_s: f32 = 1.2, 0.3..=3.0;
        }
    }
}

impl Task for Turn {
    fn enter(&mut self) {
        *self = Self::default();
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(pose) = io.try_read(Self::POSE) else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let heading_rad = pose.heading_rad;
        let last_heading_rad = self.last_heading_rad.replace(heading_rad);
        let moved_rad = wrapped_rad(heading_rad - last_heading_rad.unwrap_or(heading_rad));
        self.turned_rad += moved_rad;
        let angle_rad = io.param(Self::ANGLE_RAD);
        let goal_rad = if io.flag(Self::LEFT) {
            angle_rad
        } else {
            -angle_rad
        };
        let left_rad = goal_rad - self.turned_rad;
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: 0.0,
            turn_rad_per_s: APPROACH.speed(left_rad, io.param(Self::RATE_RAD_PER_S)),
        };
        if APPROACH.is_reached(left_rad, moved_rad, io.period_us()) {
            Step::Finished
        } else {
            Step::Run
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    /// Turns a robot that follows perfectly and returns by how much.
    fn turned_rad(start_rad: f32, angle_rad: f32, left: bool) -> f32 {
        let mut bench = TaskBench::new(Turn::default());
        bench.period_us(20_000).set(Turn::LEFT, left);
        bench
            .param(Turn::ANGLE_RAD, angle_rad)
            .param(Turn::RATE_RAD_PER_S, 1.5);
        let (mut heading_rad, mut turned_rad) = (start_rad, 0.0);
        for _ in 0..1_000 {
            bench.give(
                Turn::POSE,
                Pose {
                    heading_rad,
                    ..Pose::START
                },
            );
            if bench.step() == Some(Step::Finished) {
                return turned_rad;
            }
            let step_rad = bench.output(Turn::TWIST).unwrap().turn_rad_per_s * 0.02;
            turned_rad += step_rad;
            heading_rad = wrapped_rad(heading_rad + step_rad);
        }
        panic!("never finished");
    }

    #[test]
    fn it_stands_without_a_pose() {
        let mut bench = TaskBench::new(Turn::default());
        bench
            .param(Turn::ANGLE_RAD, 1.0)
            .param(Turn::RATE_RAD_PER_S, 1.5);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(Turn::TWIST), Some(Twist::STILL));
        bench.give(Turn::POSE, Pose::START).step();
        assert_ne!(bench.output(Turn::TWIST), Some(Twist::STILL));
        bench.take_away(Turn::POSE).step();
        assert_eq!(bench.output(Turn::TWIST), Some(Twist::STILL));
    }

    #[test]
    fn it_turns_by_the_angle_also_over_the_wrap() {
        for (start_rad, angle_rad, left, expected_rad) in [
            (0.0, 1.2, true, 1.2),
            (0.0, 1.2, false, -1.2),
            (3.0, 1.0, true, 1.0),
            (-3.0, 1.0, false, -1.0),
            (1.0, 6.0, true, 6.0),
            (0.0, 0.0, true, 0.0),
        ] {
            let turned_rad = turned_rad(start_rad, angle_rad, left);
            assert!(
                (turned_rad - expected_rad).abs() < 0.04,
                "{start_rad} {angle_rad}: {turned_rad}"
            );
        }
    }
}
