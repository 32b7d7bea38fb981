//! The runtime that a board is made of.
//!
//! A robot's program is a set of tasks, written once in Rust. Which of them run, when, and how
//! their data flows is decided by the mission: a blob that is uploaded while the robot stays on.
//! This crate holds what is the same on every board: the task registry, the nets between tasks, the
//! real-time side that executes slots, the background side for what has no deadline, the link to
//! the host, and the drivers and tasks that ship. It names no chip and no pin: a board gives a
//! timer, a byte link and embedded-hal parts. It builds on the host too, where the very same code
//! runs against simulated parts.
//!
//! What it is not: a scheduler that preempts real-time tasks, an allocator of anything, or a second
//! interpreter. What a mission means is decided in `esm-core` alone.
//!
//! [The module `task`](mod@task) shows how a task is written, [`runtime`] how a board puts
//! everything together.
#![cfg_attr(not(test), no_std)]

#[cfg(all(feature = "std", not(test)))]
extern crate std;

#[doc(hidden)]
pub use pastey;

// First: the macros are in scope in the modules that follow.
#[macro_use]
pub mod log;
#[macro_use]
mod planted;
#[macro_use]
pub mod show;

mod about;
pub mod background;
#[macro_use]
pub mod behaviours;
#[cfg(any(test, feature = "std"))]
pub mod bench;
pub mod black_box;
pub mod board;
pub mod body;
pub mod check;
pub mod clock;
mod declaration;
pub mod drivers;
mod emergency_stop;
pub mod features;
pub mod frames;
mod heartbeats;
pub mod link;
mod list_command;
pub mod mission_store;
mod notes;
pub mod odometry;
pub mod ports;
pub mod realtime;
#[cfg(feature = "links")]
mod received_value;
mod recorder;
pub mod registry;
pub mod retained_ram;
pub mod ring;
pub mod robot_parts;
pub mod rover;
pub mod runtime;
mod signal;
pub mod status;
mod stops;
pub mod store;
pub mod supervision;
pub mod task;
mod task_word;
pub mod tasks;
mod telemetry;

pub use about::{About, MAX_NAME_BYTES};
pub use background::Background;
#[cfg(any(test, feature = "std"))]
pub use bench::TaskBench;
pub use board::{ActivationStart, Board, WithStopButton};
pub use link::device::{LinkPort, LinkSide};
pub use link::stop_listener::StopListener;
pub use ports::{AnyTaskPool, Executor, Io, Net, Registry, RegistryFault, TaskPool, assemble};
pub use realtime::mailbox::Mailbox;
pub use realtime::{Limits, RealTime};
pub use registry::{nets, put_bank};
pub use retained_ram::RetainedRam;
pub use runtime::{Memory, Sides, split};
pub use show::Show;
pub use task::{
    Declaration, Declared, In, InFlag, InOut, OptIn, OptInOut, Out, OutFlag, Param, PortType, Step,
    Task, declaration_of,
};
