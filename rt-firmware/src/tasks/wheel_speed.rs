//! Makes the wheels follow a twist.

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

use super::ramp::{Ramp, RampLimits};
use super::values::{Chassis, Twist, WheelControl, WheelSpeeds};
use crate::drivers::DcMotor;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// The integral never asks for more power than this, or a blocked wheel would jump when it comes
/// free.
const INTEGRAL_LIMIT: f32 = 0.5;

/// Goals are at most this part of the speed at full power: the rest is the controller's, and that
/// of a battery that is not fresh.
const GOAL_PART: f32 = 0.9;

/// Slower than this part of its goal a wheel counts as blocked …
const BLOCKED_PART: f32 = 0.2;

/// … if its goal is at least this fast, in m/s …
const BLOCKED_GOAL_M_PER_S: f32 = 0.05;

/// … and it lasts for this long.
const BLOCKED_AFTER_US: u32 = 800_000;

/// Keeps both wheels at the speeds that a twist asks for: a feed-forward that knows the motors
/// roughly, and a PI controller for the rest (load, battery, unequal motors). Goals change no
/// faster than the wheels can grip, and no more abruptly than the robot's load likes.
///
/// A twist that is too fast for a wheel is driven more slowly, on the same curve: both wheels get
/// the same part of it. So it is where the battery is too weak for what is asked: both get the same
/// part of the power, and the integral rests meanwhile.
///
/// Where nobody has asked for a twist for a while the wheels brake, within the same bounds: from a
/// speed v the robot stands after v / acceleration + acceleration / jerk, 0.29 s at 0.3 m/s. Where
/// nobody knows how fast they roll, the motors are off.
///
/// `blocked` is set while a wheel does not turn although it is driven, or a motor driver reports a
/// failure.
#[derive(Debug)]
pub struct WheelSpeed<LP, LD, RP, RD> {
    left: DrivenWheel<LP, LD>,
    right: DrivenWheel<RP, RD>,
    chassis: Chassis,
    blocked_for_us: u32,
}

task! {
    /// Keeps both wheels at the speeds that a twist asks for. Where nobody has said how to move for
    /// 100 ms, they brake. Where nobody knows how fast they roll, the motors are off.
    impl[
        LP: SetDutyCycle + Send, LD: OutputPin + Send, RP: SetDutyCycle + Send, RD: OutputPin + Send
    ] WheelSpeed<LP, LD, RP, RD> {
        slot 2;
        wcet 500 us;
        endless;
        data {
            /// How to move.
            in twist: Twist optional within 100 ms;
            /// How fast the wheels roll.
            in speeds: WheelSpeeds optional within 100 ms;
            /// What the wheels are to do, and what their motors get for it.
            out control: WheelControl;
        }
        flags {
            /// A wheel does not turn although it is driven, or a motor driver has failed.
            out blocked;
        }
        params {
            /// How fast the wheels may change their speed, in m/s for each second.
            acceleration_m_per_s2: f32 = 1.2, 0.1..=5.0;
            /// How fast that may set in and end, in m/s² for each second.
            jerk_m_per_s3: f32 = 30.0, 0.5..=1000.0;
            /// Power for each m/s of speed that is lacking.
            proportional_s_per_m: f32 = 0.8, 0.0..=20.0;
            /// Power for each metre that has been lost by lacking speed.
            integral_per_m: f32 = 4.0, 0.0..=200.0;
        }
    }
}

/// A wheel with its motor and the state of its controller.
#[derive(Debug)]
struct DrivenWheel<P, D> {
    motor: DcMotor<P, D>,
    goal: Ramp,
    integral_power: f32,
}

/// What a controller needs to know beside its wheel.
struct Surroundings<'a> {
    chassis: &'a Chassis,
    limits: RampLimits,
    proportional_s_per_m: f32,
    integral_per_step: f32,
}

/// What a wheel is to get.
struct Asked {
    power: f32,
    /// The integral, if nothing keeps the wheel from getting that power.
    integral_power: f32,
}

impl<P: SetDutyCycle, D: OutputPin> DrivenWheel<P, D> {
    fn new(motor: DcMotor<P, D>) -> Self {
        Self {
            motor,
            goal: Ramp::default(),
            integral_power: 0.0,
        }
    }

    fn rest(&mut self) {
        self.goal.stop();
        self.integral_power = 0.0;
    }

    fn stop(&mut self) {
        self.rest();
        // A driver that fails to stop its motor is told as blocked as soon as the wheel is to turn.
        let _ = self.motor.drive(0.0);
    }

    /// The power that brings the wheel towards `asked_m_per_s`.
    fn control(&mut self, asked_m_per_s: f32, speed_m_per_s: f32, around: &Surroundings) -> Asked {
        let goal_m_per_s = self.goal.step(asked_m_per_s, &around.limits);
        if goal_m_per_s.abs() < Chassis::STANDING_M_PER_S {
            return Asked {
                power: 0.0,
                integral_power: 0.0,
            };
        }
        let lack_m_per_s = goal_m_per_s - speed_m_per_s;
        let integral_power = (self.integral_power + around.integral_per_step * lack_m_per_s)
            .clamp(-INTEGRAL_LIMIT, INTEGRAL_LIMIT);
        let power = around.chassis.rolling_power(goal_m_per_s)
            + around.proportional_s_per_m * lack_m_per_s
            + integral_power;
        Asked {
            power,
            integral_power,
        }
    }

    /// Gives the wheel its power, which `is_all` that was asked for, or a part of it. Returns
    /// whether it follows.
    fn drive(&mut self, asked: &Asked, is_all: bool, speed_m_per_s: f32) -> bool {
        // Where there is no power for it, an integral would grow without an effect.
        if is_all || asked.integral_power.abs() < self.integral_power.abs() {
            self.integral_power = asked.integral_power;
        }
        let goal_m_per_s = self.goal.speed().abs();
        let turns = speed_m_per_s.abs() >= goal_m_per_s * BLOCKED_PART;
        let driven = self.motor.drive(asked.power).is_ok();
        driven && (turns || goal_m_per_s < BLOCKED_GOAL_M_PER_S)
    }
}

impl<LP: SetDutyCycle, LD: OutputPin, RP: SetDutyCycle, RD: OutputPin> WheelSpeed<LP, LD, RP, RD> {
    /// A controller for these motors.
    pub fn new(left: DcMotor<LP, LD>, right: DcMotor<RP, RD>, chassis: Chassis) -> Self {
        Self {
            left: DrivenWheel::new(left),
            right: DrivenWheel::new(right),
            chassis,
            blocked_for_us: 0,
        }
    }
}

impl<LP, LD, RP, RD> Task for WheelSpeed<LP, LD, RP, RD>
where
    LP: SetDutyCycle + Send,
    LD: OutputPin + Send,
    RP: SetDutyCycle + Send,
    RD: OutputPin + Send,
{
    fn reset(&mut self) {
        self.left.rest();
        self.right.rest();
    }

    fn enter(&mut self) {
        self.blocked_for_us = 0;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(speeds) = io.try_read(Self::SPEEDS) else {
            self.left.stop();
            self.right.stop();
            *io.write(Self::CONTROL) = WheelControl::default();
            return Step::Run;
        };
        let twist = io.try_read(Self::TWIST).unwrap_or(&Twist::STILL);
        let period_s = io.period_us() as f32 / 1e6;
        let around = Surroundings {
            chassis: &self.chassis,
            limits: RampLimits::new(
                io.param(Self::ACCELERATION_M_PER_S2),
                io.param(Self::JERK_M_PER_S3),
                period_s,
            ),
            proportional_s_per_m: io.param(Self::PROPORTIONAL_S_PER_M),
            integral_per_step: io.param(Self::INTEGRAL_PER_M) * period_s,
        };
        let chassis = &self.chassis;
        let wanted = (chassis.wheel_speeds(twist)).at_most(GOAL_PART * chassis.full_speed_m_per_s);
        let mut left = (self.left).control(wanted.left_m_per_s, speeds.left_m_per_s, &around);
        let mut right = (self.right).control(wanted.right_m_per_s, speeds.right_m_per_s, &around);
        let most = left.power.abs().max(right.power.abs());
        let is_all = most <= 1.0;
        if !is_all {
            let part = 1.0 / most;
            left.power *= part;
            right.power *= part;
        }
        let left_follows = self.left.drive(&left, is_all, speeds.left_m_per_s);
        let right_follows = self.right.drive(&right, is_all, speeds.right_m_per_s);
        *io.write(Self::CONTROL) = WheelControl {
            left_set_m_per_s: self.left.goal.speed(),
            right_set_m_per_s: self.right.goal.speed(),
            left_power: left.power,
            right_power: right.power,
        };
        self.blocked_for_us = if left_follows && right_follows {
            0
        } else {
            self.blocked_for_us.saturating_add(io.period_us())
        };
        io.set(Self::BLOCKED, self.blocked_for_us >= BLOCKED_AFTER_US);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{DirectionPin, MotorPwm, PinImage};

    type Task<'a> = WheelSpeed<MotorPwm<'a>, DirectionPin<'a>, MotorPwm<'a>, DirectionPin<'a>>;

    const PERIOD_US: u32 = 10_000;

    const CHASSIS: Chassis = Chassis {
        wheel_base_m: 0.2,
        metres_per_count: 0.001,
        full_speed_m_per_s: 0.6,
        friction_power: 0.05,
    };

    fn bench(pins: &PinImage) -> TaskBench<'_> {
        let parts = pins.parts();
        let mut bench = TaskBench::new(Task::new(
            DcMotor::new(parts.left_pwm, parts.left_direction),
            DcMotor::new(parts.right_pwm, parts.right_direction),
            CHASSIS,
        ));
        bench.period_us(PERIOD_US);
        bench
            .param(Task::ACCELERATION_M_PER_S2, 1.0)
            .param(Task::JERK_M_PER_S3, 20.0)
            .param(Task::PROPORTIONAL_S_PER_M, 0.8)
            .param(Task::INTEGRAL_PER_M, 4.0);
        bench
    }

    /// Motors that follow their duty with a lag, the right one weaker by a fifth.
    fn wheels_after(bench: &mut TaskBench<'_>, pins: &PinImage, steps: usize) -> WheelSpeeds {
        let mut speeds = WheelSpeeds::default();
        for _ in 0..steps {
            bench.give(Task::SPEEDS, speeds);
            bench.step();
            let actuators = pins.take_actuators();
            let follow = |speed: &mut f32, duty: i16, strength: f32| {
                let goal = f32::from(duty) / 1_000.0 * 0.6 * strength;
                *speed += (goal - *speed) * 0.25;
            };
            follow(&mut speeds.left_m_per_s, actuators.left_duty, 1.0);
            follow(&mut speeds.right_m_per_s, actuators.right_duty, 0.8);
        }
        speeds
    }

    #[test]
    fn both_wheels_reach_their_speeds_though_the_motors_differ() {
        for (forward_m_per_s, turn_rad_per_s) in
            [(0.3, 0.0), (-0.2, 0.0), (0.0, 1.0), (0.2, -0.8), (0.0, 0.0)]
        {
            let pins = PinImage::new();
            let mut bench = bench(&pins);
            bench.give(
                Task::TWIST,
                Twist {
                    forward_m_per_s,
                    turn_rad_per_s,
                },
            );
            let speeds = wheels_after(&mut bench, &pins, 150);
            let expected = [
                forward_m_per_s - 0.1 * turn_rad_per_s,
                forward_m_per_s + 0.1 * turn_rad_per_s,
            ];
            for (speed, expected) in [speeds.left_m_per_s, speeds.right_m_per_s]
                .iter()
                .zip(expected)
            {
                assert!(
                    (speed - expected).abs() < 0.01,
                    "{speeds:?}, expected {expected}"
                );
            }
            assert!(!bench.flag(Task::BLOCKED));
        }
    }

    #[test]
    fn goals_change_no_faster_than_the_wheels_can_grip() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        bench.give(Task::SPEEDS, WheelSpeeds::default()).give(
            Task::TWIST,
            Twist {
                forward_m_per_s: 0.6,
                turn_rad_per_s: 0.0,
            },
        );
        // 0.2 m/s² after one step, 1 m/s² after five.
        let duties: [i16; 6] = core::array::from_fn(|_| {
            bench.step();
            pins.take_actuators().left_duty
        });
        assert_eq!(duties[0], 0, "slower than 5 mm/s");
        assert!((50..=150).contains(&duties[5]), "{duties:?}");
    }

    #[test]
    fn a_wheel_that_stands_though_driven_is_reported() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let twist = Twist {
            forward_m_per_s: 0.3,
            turn_rad_per_s: 0.0,
        };
        bench
            .give(Task::SPEEDS, WheelSpeeds::default())
            .give(Task::TWIST, twist);
        let steps_until_blocked = (1..200).find(|_| {
            bench.step();
            bench.flag(Task::BLOCKED)
        });
        // 80 ms until the goal is fast enough to tell, then 800 ms.
        assert_eq!(steps_until_blocked, Some(87));
    }

    #[test]
    fn wheels_brake_where_nobody_asks_for_a_twist_and_stop_where_nobody_knows_their_speed() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let twist = Twist {
            forward_m_per_s: 0.3,
            turn_rad_per_s: 0.0,
        };
        let duty = |pins: &PinImage| pins.take_actuators().left_duty;
        for without_twist in [true, false] {
            bench.give(Task::TWIST, twist);
            let speeds = wheels_after(&mut bench, &pins, 100);
            assert!(speeds.left_m_per_s > 0.25, "{speeds:?}");
            if without_twist {
                bench.take_away(Task::TWIST);
                let speeds = wheels_after(&mut bench, &pins, 60);
                assert!(speeds.left_m_per_s < 0.01, "{speeds:?}");
                assert_eq!(duty(&pins), 0);
            } else {
                bench.take_away(Task::SPEEDS).step();
                assert_eq!(duty(&pins), 0);
            }
        }
    }

    #[test]
    fn a_twist_that_is_too_fast_is_driven_on_its_curve() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        for (forward_m_per_s, turn_rad_per_s) in [(0.8, 4.0), (-0.9, 3.0), (0.2, -9.0)] {
            let twist = Twist {
                forward_m_per_s,
                turn_rad_per_s,
            };
            bench.give(Task::TWIST, twist);
            let speeds = wheels_after(&mut bench, &pins, 400);
            let forward = (speeds.left_m_per_s + speeds.right_m_per_s) / 2.0;
            let turn = (speeds.right_m_per_s - speeds.left_m_per_s) / CHASSIS.wheel_base_m;
            // The right motor is weaker by a fifth, and cannot do what the chassis promises.
            let curvature = turn / forward;
            let expected = turn_rad_per_s / forward_m_per_s;
            assert!(
                (curvature / expected - 1.0).abs() < 0.15,
                "{curvature} rad/m, not {expected}: {speeds:?}"
            );
            let fastest = speeds.left_m_per_s.abs().max(speeds.right_m_per_s.abs());
            assert!((0.4..=0.6).contains(&fastest), "{speeds:?}");
        }
    }

    #[test]
    fn what_was_lost_without_power_is_not_made_up_for() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        let twist = |forward_m_per_s| Twist {
            forward_m_per_s,
            turn_rad_per_s: 0.0,
        };
        // Held at half of its speed for two seconds, with all the power that there is.
        bench.give(Task::TWIST, twist(0.6));
        for _ in 0..200 {
            bench.give(
                Task::SPEEDS,
                WheelSpeeds {
                    left_m_per_s: 0.3,
                    right_m_per_s: 0.3,
                },
            );
            bench.step();
        }
        assert_eq!(pins.take_actuators().left_duty, 1_000);
        // Let go, it comes to its speed and does not shoot beyond.
        bench.give(Task::TWIST, twist(0.4));
        let mut most_m_per_s = 0.0_f32;
        for _ in 0..40 {
            let speeds = wheels_after(&mut bench, &pins, 5);
            most_m_per_s = most_m_per_s.max(speeds.left_m_per_s);
        }
        assert!(most_m_per_s < 0.5, "{most_m_per_s}");
    }

    #[test]
    fn standing_still_takes_no_power() {
        let pins = PinImage::new();
        let mut bench = bench(&pins);
        bench.give(Task::TWIST, Twist::STILL);
        bench.give(
            Task::SPEEDS,
            WheelSpeeds {
                left_m_per_s: 0.02,
                right_m_per_s: -0.02,
            },
        );
        bench.step();
        let actuators = pins.take_actuators();
        assert_eq!((actuators.left_duty, actuators.right_duty), (0, 0));
    }
}
