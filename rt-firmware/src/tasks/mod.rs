//! The tasks that ship: what a mission can make the robot do without a line of Rust.
//!
//! | task | does | hardware |
//! |---|---|---|
//! | [`SonarRing`] | measures the ranges around the robot | sonars |
//! | [`Odometry`] | works out pose and wheel speeds | encoders |
//! | [`WheelSpeed`] | makes the wheels follow a twist | motors |
//! | [`BatteryMonitor`] | watches the battery | battery input |
//! | [`ProximityMonitor`] | watches whether something comes too close | |
//! | [`Cruise`] | drives ahead, towards free space | |
//! | [`Back`] | backs up | |
//! | [`Turn`] | turns on the spot by an angle | |
//! | [`FollowWall`] | keeps a wall to the right at a distance | |
//! | [`RoundCorner`] | drives around the end of a wall to the right | |
//! | [`Stop`] | stands still | |
//! | [`LineSensor`] | measures where a line on the floor is | reflectance sensors |
//! | [`LineMonitor`] | watches for a line and for crossings | |
//! | [`FollowLine`] | drives along a line | |
//! | [`SlotMonitor`] | watches whether slots keep their times | |
//! | [`LinkMonitor`] | watches whether the host still calls, and stops the robot if it does not | |
//! | [`BatteryGuard`] | stops the robot when the battery is empty | |
//! | [`Logger`] | writes pose and battery to the log, in no hurry | |
//!
//! Tasks with hardware own their drivers. Those that move the robot never touch a motor: they publish a [`Twist`], and the mission's
//! data paths decide whose twist reaches the wheels.

mod back;
mod battery_guard;
mod battery_monitor;
mod cruise;
mod follow_line;
mod follow_wall;
mod line_monitor;
mod line_sensor;
mod link_monitor;
mod logger;
mod odometry;
mod proximity_monitor;
mod round_corner;
mod slot_monitor;
mod sonar_ring;
mod stop;
mod turn;
mod values;
mod wheel_speed;

pub use back::Back;
pub use battery_guard::BatteryGuard;
pub use battery_monitor::BatteryMonitor;
pub use cruise::Cruise;
pub use follow_line::FollowLine;
pub use follow_wall::FollowWall;
pub use line_monitor::LineMonitor;
pub use line_sensor::LineSensor;
pub use link_monitor::LinkMonitor;
pub use logger::Logger;
pub use odometry::Odometry;
pub use proximity_monitor::ProximityMonitor;
pub use round_corner::RoundCorner;
pub use slot_monitor::SlotMonitor;
pub use sonar_ring::{DEAD_AFTER, DEAF_AFTER, RING_WINDOWS, SonarRing, firing_windows};
pub use stop::Stop;
pub use turn::Turn;
pub use values::{
    Battery, Bearing, Chassis, Line, MAX_SONARS, Pose, Ranges, Reading, Twist, WheelSpeeds,
};
pub use wheel_speed::WheelSpeed;
