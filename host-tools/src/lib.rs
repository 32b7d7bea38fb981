//! The library behind the `esm` command.

// All that goes to a terminal goes through `cli::console`, which cleans it.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod black_box;
pub mod boards;
pub mod bound;
pub mod clean;
pub mod cli;
pub mod compile;
pub mod counters;
pub mod diagram;
pub mod files;
pub mod fit;
pub mod host_board;
pub mod inspect;
pub mod keys;
pub mod lang;
pub mod language_server;
pub mod link_client;
pub mod lockstep;
pub mod model;
pub mod nearest;
pub mod parameters;
pub mod pictures;
pub mod plant;
pub mod qemu;
pub mod reading;
pub mod recording;
pub mod run;
pub mod scenario;
pub mod schedule;
pub mod serial;
pub mod sim;
mod superstates;
pub mod task_page;
pub mod timetable;
pub mod trace;
pub mod trace_events;
pub mod trial;
pub mod values;
mod work_time;
pub mod world;
