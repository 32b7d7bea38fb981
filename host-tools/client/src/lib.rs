//! How a computer reaches a robot: files and keys, serial lines and other byte links, the link's
//! client with uploads and streams, the emulated board and the board that is a part of this
//! process, and runs that put them together.
//!
//! It rests on [`esm_toolkit`], which knows missions and needs no operating system. The `esm`
//! command rests on both.

// All that goes to a terminal goes through the command's console, which cleans it.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod bench;
pub mod black_box;
mod counted_links;
pub mod files;
pub mod flash;
pub mod flashing;
pub mod host_board;
pub mod interrupt;
pub mod keys;
pub mod link_client;
pub mod live_recording;
pub mod lockstep;
pub mod nearby;
pub mod ports;
pub mod qemu;
pub mod reading;
pub mod run;
#[cfg(any(test, feature = "samples"))]
pub mod samples;
pub mod scenario_folder;
pub mod serial;
pub mod sources;
pub mod system_run;
pub mod time;
pub mod trial;
pub mod values;
