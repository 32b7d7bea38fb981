//! A run on the host board without a thread, a clock or a line: whoever has it lets as much robot
//! time pass as he likes, and looks at what happened.
//!
//! The board is the one of `esm run --board host`, the link and its messages too, and so is the
//! trace, byte for byte. Bytes of the link take no time, and missions take over at the very robot
//! time that is planned for them, as over a pipe.

mod kept;
mod port;
mod run;
mod session;
mod wired_link;

pub use kept::start_rover;
pub use port::DirectPort;
pub use run::{
    Behind, CALL_INTERVAL_US, Ended, Given, HostRun, LINK_MONITOR, Planned, RunMission, Settings,
    Shown, Switches,
};
pub use session::RunError;
pub use wired_link::WiredLink;
