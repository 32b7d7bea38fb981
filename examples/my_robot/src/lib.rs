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
use esm::rt_firmware::tasks::{
    Back, BatteryMonitor, Count, Cruise, DriveDistance, FollowWall, Logger, Odometry,
    ProximityMonitor, RoundCorner, SonarRing, Stop, Turn, WheelSpeed,
};
use esm::rt_firmware::{TaskPool, registry};

use headlight::Headlight;
use lamp::Lamp;

/// What the robot measures. The simulated halls have the rover in them, so these are the rover's;
/// put your own here.
pub const MEASURES: Measures = Measures::ROVER;

registry! {
    /// A headlight, and what the missions `patrol`, `follow_wall` and `square` take, on the parts
    /// of any board. A number says how many states of a mission can have such a task.
    pub struct MyRobot[P: PartTypes, const SONARS: usize]<P, SONARS> marks P {
        sonar_ring: SonarRing<P::Trigger, P::EchoTimer, SONARS>[1],
        odometry: Odometry<P::LeftEncoder, P::RightEncoder>[1],
        wheel_speed: WheelSpeed<P::Pwm, P::Direction, P::Pwm, P::Direction>[1],
        battery_monitor: BatteryMonitor<P::Analog>[1],
        proximity_monitor: ProximityMonitor[1],
        cruise: Cruise[2],
        back: Back[3],
        turn: Turn[4],
        drive_distance: DriveDistance[2],
        count: Count[2],
        follow_wall: FollowWall[1],
        round_corner: RoundCorner[1],
        stop: Stop[3],
        logger: Logger[1],
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
            proximity_monitor: TaskPool::new([ProximityMonitor]),
            cruise: TaskPool::from_fn(|| Cruise),
            back: TaskPool::from_fn(Back::default),
            turn: TaskPool::from_fn(Turn::default),
            drive_distance: TaskPool::from_fn(DriveDistance::default),
            count: TaskPool::from_fn(Count::default),
            follow_wall: TaskPool::new([FollowWall]),
            round_corner: TaskPool::new([RoundCorner]),
            stop: TaskPool::from_fn(|| Stop),
            logger: TaskPool::new([Logger]),
            headlight: TaskPool::new([Headlight::new(Lamp::new(lamp_pin))]),
        }
    }
}
