//! A robot of one's own: the rover, with a headlight that comes on where something is near.
//!
//! Three things make it: a [driver](lamp) for the lamp, a [task](headlight) that owns it, and the
//! registry [`MyRobot`], which has that task beside those that ship. The same code is a firmware
//! (`firmware/`) and a program for the host (`src/bin/my_robot.rs`).
#![no_std]

// The firmware takes its board from there.
pub use esm;

pub mod headlight;
pub mod lamp;

use esm::rt_firmware::body::{
    AnalogChannel, AuxOutput, DirectionPin, EchoCapture, EncoderCount, MotorPwm, Parts, TriggerPin,
};
use esm::rt_firmware::rover::{ExtraParts, Measures, RoverParts};
use esm::rt_firmware::tasks::{BatteryMonitor, Cruise, Odometry, SonarRing, Turn, WheelSpeed};
use esm::rt_firmware::{TaskPool, registry};

use headlight::Headlight;
use lamp::Lamp;

/// What the robot measures. The simulated halls have the rover in them, so these are the rover's;
/// in a copy, put your own here.
pub const MEASURES: Measures = Measures::ROVER;

registry! {
    /// The rover's motion, and a headlight.
    pub struct MyRobot['a]<'a> {
        sonar_ring: SonarRing<TriggerPin<'a>, EchoCapture<'a>>[1],
        odometry: Odometry<EncoderCount<'a>, EncoderCount<'a>>[1],
        wheel_speed: WheelSpeed<MotorPwm<'a>, DirectionPin<'a>, MotorPwm<'a>, DirectionPin<'a>>[1],
        battery_monitor: BatteryMonitor<AnalogChannel<'a>>[1],
        cruise: Cruise[1],
        turn: Turn[1],
        headlight: Headlight<AuxOutput<'a>>[1],
    }
}

impl<'a> MyRobot<'a> {
    /// The robot on a board's pins: the lamp is at the first auxiliary output.
    pub fn new(parts: Parts<'a>) -> Self {
        let Parts { aux_outputs, .. } = parts;
        let [lamp_pin, ..] = aux_outputs;
        let [battery, _, _, _, left, middle, right] = parts.analog;
        let hardware = RoverParts {
            left_pwm: parts.left_pwm,
            left_direction: parts.left_direction,
            right_pwm: parts.right_pwm,
            right_direction: parts.right_direction,
            left_encoder: parts.left_encoder,
            right_encoder: parts.right_encoder,
            sonar_triggers: parts.sonar_triggers,
            echo_timers: parts.echo_timers,
            array: None,
            battery,
            line_sensors: [left, middle, right],
            extras: ExtraParts::NONE,
        }
        .into_tasks(&MEASURES);
        Self {
            sonar_ring: TaskPool::new([hardware.sonar_ring]),
            odometry: TaskPool::new([hardware.odometry]),
            wheel_speed: TaskPool::new([hardware.wheel_speed]),
            battery_monitor: TaskPool::new([hardware.battery_monitor]),
            cruise: TaskPool::new([Cruise]),
            turn: TaskPool::new([Turn::default()]),
            headlight: TaskPool::new([Headlight::new(Lamp::new(lamp_pin))]),
        }
    }
}
