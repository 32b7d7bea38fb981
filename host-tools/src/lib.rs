//! The library behind the `esm` command.

pub mod boards;
pub mod cli;
pub mod compile;
pub mod counters;
pub mod diagram;
pub mod fit;
pub mod host_board;
pub mod inspect;
pub mod lang;
pub mod language_server;
pub mod link_client;
pub mod lockstep;
pub mod model;
pub mod nearest;
pub mod pictures;
pub mod plant;
pub mod qemu;
pub mod reading;
pub mod run;
pub mod scenario;
pub mod schedule;
pub mod serial;
pub mod sim;
pub mod trace;
pub mod world;
