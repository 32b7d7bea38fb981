//! Works out pose and wheel speeds from the encoders.

use super::values::{Chassis, Pose, WheelSpeeds, YawRate};
use crate::drivers::{EncoderCounter, WheelEncoder};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// A robot whose wheels stand, and that turns no faster than this, stands: what its gyroscope says
/// is what its bias has changed by since it was measured. 2 °/s.
const STANDS_RAD_PER_S: f32 = 0.035;

/// Wheels stand that have not been counted on for so long, in microseconds: those that end a turn
/// are counted on less than once in an activation.
const STANDS_US: u32 = 100_000;

/// A rate counts for so many steps, 30 ms in a slot of 10 ms; where no new one has come by then,
/// nobody measures it any more. Its port has no `within`, which would have it on a net in each
/// mission.
const FRESH_STEPS: u8 = 3;

/// Adds up what the wheels have rolled, and where a gyroscope tells how fast the robot turns, takes
/// the turn from that: wheels slip, and nobody knows their distance well. The pose belongs to the
/// robot, not to a mission: it goes on when missions are swapped.
#[derive(Debug)]
pub struct Odometry<L, R> {
    left: WheelEncoder<L>,
    right: WheelEncoder<R>,
    // Of the chassis no more than it needs: RAM is short.
    metres_per_count: f32,
    wheel_base_m: f32,
    located: Pose,
    /// The number of the last rate, and for how many steps it counts still.
    rate_count: u8,
    fresh_steps: u8,
    /// How long no wheel was counted on, in microseconds.
    stood_us: u32,
}

task! {
    /// Works out from the encoders where the robot is, counted from where it was switched on. With
    /// a gyroscope, how far it has turned is what that says.
    impl[L: EncoderCounter + Send, R: EncoderCounter + Send] Odometry<L, R> {
        slot 2;
        wcet 1 ms;
        endless;
        data {
            /// How fast it turns.
            in yaw_rate: YawRate optional;
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
            rate_count: 0,
            fresh_steps: 0,
            stood_us: STANDS_US,
        }
    }
}

impl<L: EncoderCounter + Send, R: EncoderCounter + Send> Task for Odometry<L, R> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let (left, right) = (self.left.take_counts(), self.right.take_counts());
        let left_m = left as f32 * self.metres_per_count;
        let right_m = right as f32 * self.metres_per_count;
        let period_s = io.period_us() as f32 / 1e6;
        self.stood_us = if left | right != 0 {
            0
        } else {
            self.stood_us.saturating_add(io.period_us())
        };
        let mut turned_rad = (right_m - left_m) / self.wheel_base_m;
        if let Some(rate) = io.try_read(Self::YAW_RATE) {
            let rate_rad_per_s = rate.yaw_rate_rad_per_s;
            self.fresh_steps = if rate.count == self.rate_count {
                self.fresh_steps.saturating_sub(1)
            } else {
                FRESH_STEPS
            };
            self.rate_count = rate.count;
            let stands = self.stood_us >= STANDS_US && rate_rad_per_s.abs() <= STANDS_RAD_PER_S;
            if self.fresh_steps > 0 && !stands {
                turned_rad = rate_rad_per_s * period_s;
            }
        }
        let located = self.located.turned((left_m + right_m) / 2.0, turned_rad);
        self.located = located;
        *io.write(Self::POSE) = located;
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

    fn bench(pins: &PinImage) -> TaskBench<'_> {
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
        bench
    }

    #[test]
    fn the_gyroscope_says_how_far_it_turns_unless_it_stands() {
        // Counts of both wheels in a step, rate, and by how much that turns it.
        for (left, right, rate_rad_per_s, expected_rad) in [
            (0, 0, None, 0.0),
            (10, 12, None, 0.01),
            // The wheels slip, and the other way round.
            (10, 12, Some(0.0), 0.0),
            (10, 10, Some(1.0), 0.02),
            (-3, 3, Some(-0.5), -0.01),
            // The wheels stand: a bias that has changed, somebody who turns it.
            (0, 0, Some(0.03), 0.0),
            (0, 0, Some(-0.5), -0.01),
        ] {
            let pins = PinImage::new();
            let mut bench = bench(&pins);
            bench.step();
            pins.set_sensors(&Sensors {
                left_count: i16::cast_unsigned(left),
                right_count: i16::cast_unsigned(right),
                ..Sensors::default()
            });
            if let Some(yaw_rate_rad_per_s) = rate_rad_per_s {
                let rate = YawRate {
                    yaw_rate_rad_per_s,
                    count: 1,
                };
                bench.give(Task::YAW_RATE, rate);
            }
            bench.step();
            let pose = bench.output(Task::POSE).unwrap();
            let turned_rad = pose.heading_rad;
            assert!((turned_rad - expected_rad).abs() < 1e-6, "{turned_rad}");
            let way_m = f32::from(left + right) * 0.0005;
            assert!((pose.x_m - way_m).abs() < 1e-5, "{pose:?}");
        }
    }

    #[test]
    fn wheels_that_are_counted_on_now_and_then_do_not_stand() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let (mut left_count, mut last_rad) = (0, 0.0);
        for step in 0..50_u8 {
            // One count in four activations, until the wheels stand.
            left_count += u16::from(step % 4 == 0 && step < 20);
            pins.set_sensors(&Sensors {
                left_count,
                ..Sensors::default()
            });
            let rate = YawRate {
                yaw_rate_rad_per_s: -0.02,
                count: step + 1,
            };
            bench.give(Task::YAW_RATE, rate);
            bench.step();
            let heading_rad = bench.output(Task::POSE).unwrap().heading_rad;
            // The first count is before the first look; the last stands for 0.1 s.
            let turns = (4..21).contains(&step);
            let turned_rad = if turns { -0.0004 } else { 0.0 };
            assert!((heading_rad - last_rad - turned_rad).abs() < 1e-7, "{step}");
            last_rad = heading_rad;
        }
    }

    #[test]
    fn a_rate_that_nobody_measures_any_more_turns_nothing() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let rate = YawRate {
            yaw_rate_rad_per_s: 1.0,
            count: 1,
        };
        bench.give(Task::YAW_RATE, rate);
        for step in 0..20_u8 {
            bench.step();
            let turned_rad = f32::from((step + 1).min(FRESH_STEPS)) * 0.02;
            let heading_rad = bench.output(Task::POSE).unwrap().heading_rad;
            assert!((heading_rad - turned_rad).abs() < 1e-6, "{step}");
        }
    }

    #[test]
    fn counts_become_pose_and_speeds() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
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
