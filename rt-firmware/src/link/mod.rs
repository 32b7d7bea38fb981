//! The link between a robot and its host: frames, messages, and what the robot answers.
//!
//! A link is a stream of bytes in each direction, which may lose, change or double some of them. On it travel [frames](frame); a frame holds
//! one [message]. The host asks and the robot answers, one request at a time: a request without an answer is sent again
//! under the same sequence number, and the robot, which remembers its last answer, does nothing twice. Beside answers the robot
//! sends [trace records](trace), a [recording](record) and log bytes as streams, where there is room between answers.

/// Whether this defect is planted. Only tests have defects to plant: each must make them fail.
#[cfg(test)]
macro_rules! planted {
    ($bug:ident) => {
        crate::link::planted::is_planted(crate::link::planted::Bug::$bug)
    };
}
#[cfg(not(test))]
macro_rules! planted {
    ($bug:ident) => {
        false
    };
}

/// A place where an interrupt may come between two looks at what sides share. Tests let one come.
#[cfg(test)]
macro_rules! preemptible {
    () => {
        crate::link::preemption::point()
    };
}
#[cfg(not(test))]
macro_rules! preemptible {
    () => {};
}

pub mod access;
pub mod device;
pub mod frame;
pub mod key_safe;
#[cfg(feature = "keys")]
pub mod keys;
#[cfg(not(feature = "keys"))]
#[path = "no_keys.rs"]
pub(crate) mod keys;
pub mod message;
pub mod news;
#[cfg(test)]
pub(crate) mod planted;
#[cfg(test)]
mod preemption;
#[cfg(feature = "keys")]
pub mod proof;
pub mod record;
pub mod stop_listener;
pub(crate) mod stops;
pub mod telemetry;
pub mod trace;
pub mod trial;
