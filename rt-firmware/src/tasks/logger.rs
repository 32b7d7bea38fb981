//! Writes pose, battery and motors to the log, in no hurry.

use super::values::{Battery, Pose, WheelControl};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Writes a line to the log, and one on the motors where it knows of them, and finishes. It has no
/// slot of its own: it runs in the time that is left, on the values that its ports held when its
/// state was entered.
#[derive(Clone, Copy, Debug, Default)]
pub struct Logger;

task! {
    /// Writes pose and battery to the log, and how much power the motors get, and finishes. It runs
    /// in the time that slots leave.
    impl Logger {
        slot 0;
        data {
            /// Where the robot is.
            in pose: Pose;
            /// The battery.
            in battery: Battery;
            /// What the motors get, as `WheelSpeed` says.
            in control: WheelControl optional;
        }
    }
}

impl Task for Logger {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let pose = io.read(Self::POSE);
        let battery = io.read(Self::BATTERY);
        // Whole numbers: a log line is made of them without any arithmetic of floats.
        info!(
            "at x {} mm, y {} mm, heading {} mrad, battery {} mV",
            thousandths(pose.x_m),
            thousandths(pose.y_m),
            thousandths(pose.heading_rad),
            thousandths(battery.voltage_v)
        );
        if let Some(control) = io.try_read(Self::CONTROL) {
            info!(
                "left motor at {} of 1000, right motor at {}",
                thousandths(control.left_power),
                thousandths(control.right_power)
            );
        }
        Step::Finished
    }
}

/// Thousandths of `value`, cut to a whole number.
fn thousandths(value: f32) -> i32 {
    (value * 1e3) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_writes_one_line_and_is_done_once_it_knows_pose_and_battery() {
        let mut bench = TaskBench::new(Logger);
        bench.give(Logger::POSE, Pose::START);
        assert_eq!(bench.step(), None, "the battery is not known yet");
        bench.give(Logger::BATTERY, Battery { voltage_v: 7.4 });
        assert_eq!(bench.step(), Some(Step::Finished));
        bench.give(Logger::CONTROL, WheelControl::default());
        assert_eq!(bench.enter_anew().step(), Some(Step::Finished));
    }

    #[test]
    fn values_are_logged_in_thousandths() {
        for (value, expected) in [(1.2345, 1_234), (-0.5, -500), (0.0, 0), (f32::NAN, 0)] {
            assert_eq!(thousandths(value), expected);
        }
    }
}
