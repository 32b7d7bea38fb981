//! A robot of one's own: the rover, with a headlight that comes on where something is near.
//!
//! Three things make it: a [driver](lamp) for the lamp, a [task](headlight) that owns it, and the
//! registry [`MyRobot`], which has that task beside those that ship. The same code is a firmware
//! (`firmware/`) and a program for the host (`src/bin/`).
#![no_std]

// Whoever builds on the robot has the framework with it.
pub use esm;

pub mod headlight;
pub mod lamp;

use core::marker::PhantomData;

use esm::rt_firmware::robot_parts::{PartTypes, RobotParts};
use esm::rt_firmware::rover::Measures;
use esm::rt_firmware::tasks::{BatteryMonitor, Cruise, Odometry, SonarRing, Turn, WheelSpeed};
use esm::rt_firmware::{TaskPool, registry};

use headlight::Headlight;
use lamp::Lamp;

/// What the robot measures. The simulated halls have the rover in them, so these are the rover's;
/// put your own here.
pub const MEASURES: Measures = Measures::ROVER;

registry! {
    /// The rover's motion, and a headlight, on the parts of any board.
    pub struct MyRobot[P: PartTypes, const SONARS: usize]<P, SONARS> marks P {
        sonar_ring: SonarRing<P::Trigger, P::EchoTimer, SONARS>[1],
        odometry: Odometry<P::LeftEncoder, P::RightEncoder>[1],
        wheel_speed: WheelSpeed<P::Pwm, P::Direction, P::Pwm, P::Direction>[1],
        battery_monitor: BatteryMonitor<P::Analog>[1],
        cruise: Cruise[1],
        turn: Turn[1],
        headlight: Headlight<P::Output>[1],
    }
}

impl<P: PartTypes, const SONARS: usize> MyRobot<P, SONARS> {
    /// The robot on a board's parts: the lamp is at the first output.
    pub fn new(parts: RobotParts<P, SONARS>, measures: &Measures<SONARS>) -> Self {
        let [lamp_pin, ..] = parts.outputs;
        let hardware = parts.rover.into_tasks(measures);
        Self {
            marks: PhantomData,
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
