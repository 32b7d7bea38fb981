//! Drives the motors of a robot without encoders.

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

use super::ramp::{Ramp, RampLimits};
use super::values::{Chassis, Twist};
use crate::drivers::DcMotor;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Drives both motors with the power that the speeds of a twist need on a flat floor with a fresh
/// battery.
///
/// For robots without encoders, in place of [`WheelSpeed`](super::WheelSpeed): nothing corrects an
/// empty battery, a slope or unequal motors. `left_part` and `right_part` make up for the last by
/// hand.
#[derive(Debug)]
pub struct DriveOpenLoop<LP, LD, RP, RD> {
    left: OpenWheel<LP, LD>,
    right: OpenWheel<RP, RD>,
    chassis: Chassis,
}

task! {
    /// Drives the motors of a robot without encoders: the power that a speed needs on a flat floor
    /// with a fresh battery. Where nobody has said how to move for 100 ms, the wheels brake.
    impl[
        LP: SetDutyCycle + Send, LD: OutputPin + Send, RP: SetDutyCycle + Send, RD: OutputPin + Send
    ] DriveOpenLoop<LP, LD, RP, RD> {
        slot 2;
        wcet 300 us;
        endless;
        data {
            /// How to move. Ten periods of the slot in which it is usually decided: at 0.3 m/s the
            /// robot rolls 3 cm in this time.
            in twist: Twist optional within 100 ms;
        }
        flags {
            /// A motor driver has failed.
            out failed;
        }
        params {
            /// How fast the wheels may change their speed, in m/s for each second.
            acceleration_m_per_s2: f32 = 1.2, 0.1..=5.0;
            /// How fast that may set in and end, in m/s² for each second.
            jerk_m_per_s3: f32 = 30.0, 0.5..=1000.0;
            /// Power of the left motor, as a part of what is worked out: less than 1 for the
            /// stronger motor.
            left_part: f32 = 1.0, 0.5..=1.0;
            /// Power of the right motor, as a part of what is worked out.
            right_part: f32 = 1.0, 0.5..=1.0;
        }
    }
}

#[derive(Debug)]
struct OpenWheel<P, D> {
    motor: DcMotor<P, D>,
    speed: Ramp,
}

impl<P: SetDutyCycle, D: OutputPin> OpenWheel<P, D> {
    /// Goes towards a speed. Returns whether the motor's driver took it.
    fn drive(
        &mut self,
        chassis: &Chassis,
        asked_m_per_s: f32,
        limits: &RampLimits,
        part: f32,
    ) -> bool {
        let speed_m_per_s = self.speed.step(asked_m_per_s, limits);
        let power = if speed_m_per_s.abs() < Chassis::STANDING_M_PER_S {
            0.0
        } else {
            chassis.rolling_power(speed_m_per_s) * part
        };
        self.motor.drive(power).is_ok()
    }
}

impl<LP: SetDutyCycle, LD: OutputPin, RP: SetDutyCycle, RD: OutputPin>
    DriveOpenLoop<LP, LD, RP, RD>
{
    /// Drives these motors.
    pub fn new(left: DcMotor<LP, LD>, right: DcMotor<RP, RD>, chassis: Chassis) -> Self {
        Self {
            left: OpenWheel {
                motor: left,
                speed: Ramp::default(),
            },
            right: OpenWheel {
                motor: right,
                speed: Ramp::default(),
            },
            chassis,
        }
    }
}

impl<LP, LD, RP, RD> Task for DriveOpenLoop<LP, LD, RP, RD>
where
    LP: SetDutyCycle + Send,
    LD: OutputPin + Send,
    RP: SetDutyCycle + Send,
    RD: OutputPin + Send,
{
    fn reset(&mut self) {
        self.left.speed.stop();
        self.right.speed.stop();
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let twist = io.try_read(Self::TWIST).copied().unwrap_or(Twist::STILL);
        let chassis = &self.chassis;
        let speeds = chassis
            .wheel_speeds(&twist)
            .at_most(chassis.full_speed_m_per_s);
        let period_s = io.period_us() as f32 / 1e6;
        let limits = RampLimits::new(
            io.param(Self::ACCELERATION_M_PER_S2),
            io.param(Self::JERK_M_PER_S3),
            period_s,
        );
        let (left_part, right_part) = (io.param(Self::LEFT_PART), io.param(Self::RIGHT_PART));
        let left = (self.left).drive(chassis, speeds.left_m_per_s, &limits, left_part);
        let right = (self.right).drive(chassis, speeds.right_m_per_s, &limits, right_part);
        io.set(Self::FAILED, !(left && right));
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{DirectionPin, MotorPwm, PinImage};

    type Task<'a> = DriveOpenLoop<MotorPwm<'a>, DirectionPin<'a>, MotorPwm<'a>, DirectionPin<'a>>;

    const CHASSIS: Chassis = Chassis {
        wheel_base_m: 0.2,
        metres_per_count: 0.001,
        full_speed_m_per_s: 0.6,
        friction_power: 0.1,
    };

    fn bench(pins: &PinImage) -> TaskBench<'_> {
        let parts = pins.parts();
        let mut bench = TaskBench::new(Task::new(
            DcMotor::new(parts.left_pwm, parts.left_direction),
            DcMotor::new(parts.right_pwm, parts.right_direction),
            CHASSIS,
        ));
        bench.period_us(20_000);
        bench
            .param(Task::ACCELERATION_M_PER_S2, 1.0)
            .param(Task::JERK_M_PER_S3, 1_000.0)
            .param(Task::LEFT_PART, 1.0)
            .param(Task::RIGHT_PART, 0.5);
        bench
    }

    #[test]
    fn the_motors_get_the_power_of_their_speeds_and_their_parts() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        bench.give(
            Task::TWIST,
            Twist {
                forward_m_per_s: 0.3,
                turn_rad_per_s: -1.0,
            },
        );
        for _ in 0..30 {
            bench.step();
        }
        // 0.4 m/s are 0.4 / 0.6 · 0.9 + 0.1 = 0.7 of full power; 0.2 m/s are 0.4, and half of it is
        // asked for.
        let actuators = pins.take_actuators();
        assert_eq!((actuators.left_duty, actuators.right_duty), (700, 200));
        assert!(!bench.flag(Task::FAILED));
    }

    #[test]
    fn without_a_twist_the_wheels_brake_as_fast_as_they_grip() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let twist = Twist {
            forward_m_per_s: 0.3,
            turn_rad_per_s: 0.0,
        };
        bench.give(Task::TWIST, twist);
        for _ in 0..30 {
            bench.step();
        }
        assert!(pins.take_actuators().left_duty > 500);
        bench.take_away(Task::TWIST);
        // 0.3 m/s at 1 m/s² are 15 steps of 20 ms.
        let stands_after = (1..100).find(|_| {
            bench.step();
            pins.take_actuators().left_duty == 0
        });
        assert_eq!(stands_after, Some(15));
    }
}
