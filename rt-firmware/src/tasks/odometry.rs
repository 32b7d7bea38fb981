//! Works out pose and wheel speeds from the encoders.

use super::values::{Chassis, Pose, WheelSpeeds};
use crate::drivers::{EncoderCounter, WheelEncoder};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Adds up what the wheels have rolled. The pose belongs to the robot, not to a mission: it goes on
/// when missions are swapped.
#[derive(Debug)]
pub struct Odometry<L, R> {
    left: WheelEncoder<L>,
    right: WheelEncoder<R>,
    // Of the chassis no more than it needs: RAM is short.
    metres_per_count: f32,
    wheel_base_m: f32,
    located: Pose,
}

task! {
    /// Works out from the encoders where the robot is, counted from where it was switched on.
    impl[L: EncoderCounter + Send, R: EncoderCounter + Send] Odometry<L, R> {
        slot 2;
        wcet 1 ms;
        endless;
        data {
            /// Where it is.
            out pose: Pose;
            /// How fast its wheels roll.
            out speeds: WheelSpeeds;
        }
    }
}

impl<L: EncoderCounter, R: EncoderCounter> Odometry<L, R> {
    /// Odometry with these encoders, starting at [`Pose::START`].
    pub fn new(left: WheelEncoder<L>, right: WheelEncoder<R>, chassis: Chassis) -> Self {
        Self {
            left,
            right,
            metres_per_count: chassis.metres_per_count,
            wheel_base_m: chassis.wheel_base_m,
            located: Pose::START,
        }
    }
}

impl<L: EncoderCounter + Send, R: EncoderCounter + Send> Task for Odometry<L, R> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let metres = |counts: i32| counts as f32 * self.metres_per_count;
        let left_m = metres(self.left.take_counts());
        let right_m = metres(self.right.take_counts());
        self.located = self.located.rolled(left_m, right_m, self.wheel_base_m);
        let period_s = io.period_us() as f32 / 1e6;
        *io.write(Self::POSE) = self.located;
        *io.write(Self::SPEEDS) = WheelSpeeds {
            left_m_per_s: left_m / period_s,
            right_m_per_s: right_m / period_s,
        };
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{EncoderCount, PinImage, Sensors};

    type Task<'a> = Odometry<EncoderCount<'a>, EncoderCount<'a>>;

    #[test]
    fn counts_become_pose_and_speeds() {
        let pins = PinImage::new();
        let parts = pins.parts();
        let chassis = Chassis {
            wheel_base_m: 0.2,
            metres_per_count: 0.001,
            full_speed_m_per_s: 1.0,
            friction_power: 0.0,
        };
        let mut bench = TaskBench::new(Task::new(
            WheelEncoder::new(parts.left_encoder),
            WheelEncoder::new(parts.right_encoder),
            chassis,
        ));
        bench.period_us(20_000);
        for (left_count, right_count) in [(100, 65_530), (110, 4), (120, 14)] {
            pins.set_sensors(&Sensors {
                left_count,
                right_count,
                ..Sensors::default()
            });
            bench.step();
        }
        let pose = bench.output(Task::POSE).unwrap();
        assert!(
            (pose.x_m - 0.02).abs() < 1e-6 && pose.heading_rad == 0.0,
            "{pose:?}"
        );
        let speeds = bench.output(Task::SPEEDS).unwrap();
        assert!((speeds.left_m_per_s - 0.5).abs() < 1e-5, "{speeds:?}");
        assert!((speeds.right_m_per_s - 0.5).abs() < 1e-5, "{speeds:?}");
    }
}
