//! The tasks that ship: what a mission can make the robot do without a line of Rust.
//!
//! | task | does | hardware |
//! |---|---|---|
//! | [`SonarRing`] | measures the ranges around the robot | sonars |
//! | [`Odometry`] | works out pose and wheel speeds | encoders |
//! | `GlobalPosition` (feature `behaviours`) | says where the robot is in the global frame | |
//! | `SetPosition`, `CorrectPosition` (feature `position-tasks`) | tell it where that is | |
//! | [`WheelSpeed`] | makes the wheels follow a twist | motors |
//! | [`DriveOpenLoop`] | drives the motors where there are no encoders, in place of `WheelSpeed` | motors |
//! | [`BatteryMonitor`] | watches the battery | battery input |
//! | `Gyro` (feature `imu`) | measures how fast the robot turns | gyroscope |
//! | [`Bumpers`] | tells what the robot touches, and passes the ranges on with it | contact switches |
//! | [`ProximityMonitor`] | watches whether something comes too close | |
//! | [`Cruise`] | drives ahead, towards free space | |
//! | [`Back`] | backs up | |
//! | [`DriveDistance`] | drives a distance straight ahead or backwards | |
//! | [`Turn`] | turns on the spot by an angle | |
//! | [`FollowWall`] | keeps a wall to the right at a distance | |
//! | [`RoundCorner`] | drives around the end of a wall to the right | |
//! | [`Stop`] | stands still | |
//! | [`Count`] | counts how often its state was entered | |
//! | [`LineSensor`] | measures where a line on the floor is | reflectance sensors |
//! | [`LineMonitor`] | watches for a line and for crossings | |
//! | [`FollowLine`] | drives along a line | |
//! | [`SlotMonitor`] | watches whether slots keep their times | |
//! | [`LinkMonitor`] | watches whether the host still calls, and stops the robot if it does not | |
//! | [`BatteryGuard`] | stops the robot when the battery is empty | |
//! | [`Logger`] | writes pose and battery to the log, in no hurry | |
//!
//! # How old a value may be
//!
//! A value stays on its net when its writer is gone, so a task that moves the robot or decides
//! about its safety says how old what it reads may be, and does what is safe where there is nothing
//! as young as that: it stands, or it says that something is close. The times are made of the
//! periods of the writers' slots, 10 ms for control, 20 ms for decisions and 40 ms for the sonars:
//!
//! | value | within | for |
//! |---|---|---|
//! | [`Ranges`] | 200 ms | three windows of the 60 ms that a sonar's data sheet asks for, five of 40 ms; at 0.5 m/s that is 10 cm |
//! | [`Twist`] | 100 ms | three periods of 20 ms of a mission's decisions, and two in which nobody writes while a superstate is entered; 5 cm |
//! | [`Pose`], [`WheelSpeeds`], [`Line`] | 100 ms | ten periods, five in a robot with a slower slot: fewer would make a robot jerk that misses three slots in a row, which the runtime bears |
//! | [`Battery`] | 200 ms | five periods of 40 ms |
//!
//! Tasks with hardware own their drivers. Those that move the robot never touch a motor: they
//! publish a [`Twist`], and the mission's data paths decide whose twist reaches the wheels.

mod back;
mod battery_guard;
mod battery_monitor;
mod bumpers;
mod count;
mod cruise;
mod drive_distance;
mod drive_open_loop;
mod follow_line;
mod follow_wall;
#[cfg(feature = "behaviours")]
mod global_position;
#[cfg(feature = "imu")]
mod gyro;
mod laws;
mod line_monitor;
mod line_sensor;
mod link_monitor;
mod logger;
mod odometry;
#[cfg(feature = "behaviours")]
mod position;
mod proximity_monitor;
mod ramp;
mod round_corner;
mod sector_monitor;
#[cfg(feature = "behaviours")]
mod set_position;
mod slot_monitor;
mod sonar_array;
mod sonar_ring;
mod steer;
mod stop;
mod turn;
mod values;
mod wheel_speed;

pub use back::Back;
pub use battery_guard::BatteryGuard;
pub use battery_monitor::BatteryMonitor;
pub use bumpers::Bumpers;
pub use count::Count;
pub use cruise::Cruise;
pub use drive_distance::DriveDistance;
pub use drive_open_loop::DriveOpenLoop;
pub use follow_line::FollowLine;
pub use follow_wall::FollowWall;
#[cfg(feature = "behaviours")]
pub use global_position::GlobalPosition;
#[cfg(feature = "imu")]
pub use gyro::Gyro;
pub use laws::{Approach, OnTrack, RIM_M, Track, WallSight};
pub use line_monitor::LineMonitor;
pub use line_sensor::LineSensor;
pub use link_monitor::LinkMonitor;
pub use logger::Logger;
pub use odometry::Odometry;
#[cfg(feature = "behaviours")]
pub use position::{Asking, CorrectionState, GlobalPose, NotCorrected};
pub use proximity_monitor::ProximityMonitor;
pub use ramp::{Ramp, RampLimits};
pub use round_corner::RoundCorner;
pub use sector_monitor::SectorMonitor;
#[cfg(feature = "behaviours")]
pub use set_position::{CorrectPosition, SetPosition};
pub use slot_monitor::SlotMonitor;
pub use sonar_array::SonarArray;
pub use sonar_ring::{DEAD_AFTER, DEAF_AFTER, RING_WINDOWS, SonarRing, firing_windows};
pub use steer::Steer;
pub use stop::Stop;
pub use turn::Turn;
pub use values::{
    ARRAY_SONARS, ArrayRanges, Battery, Bearing, Bearings, Chassis, Contact, Line, MAX_SONARS,
    Pose, Ranges, Reading, Sector, Twist, WheelControl, WheelSpeeds, YawRate,
};
pub use wheel_speed::WheelSpeed;
