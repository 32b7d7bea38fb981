//! The `esm` command, and the two libraries behind it under one roof.
//!
//! The parts that need no operating system come from [`esm_toolkit`], those that reach a robot from
//! [`esm_client`]; here stand the command line ([`cli`]) and both libraries' modules side by side.

// All that goes to a terminal goes through `cli::console`, which cleans it.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod cli;

pub use esm_client::{
    bench, black_box, files, flashing, host_board, keys, link_client, lockstep, nearby, ports,
    qemu, reading, run, serial, system_run, time, trial, values,
};
pub use esm_toolkit::{
    behaviour_words, boards, bound, clean, compile, counters, diagram, fit, goal, host_run,
    inspect, language_server, link_node, medium, model, nearest, odometry, parameters, pictures,
    schedule, script, selftest, sim, system, task_page, timetable, trace, trace_events, tune,
    world,
};

/// The language front end, and its files on disk.
pub mod lang {
    pub use esm_client::sources::{identity, load, load_over, read_source};
    pub use esm_toolkit::lang::*;
}

/// The robot's body, and its flash.
pub mod plant {
    pub use esm_client::flash;
    pub use esm_toolkit::plant::*;
}

/// Recordings, and how they are made of a robot that runs.
pub mod recording {
    pub use esm_client::live_recording as live;
    pub use esm_toolkit::recording::*;
}

/// Scenarios, and the folders that they lie in.
pub mod scenario {
    pub use esm_client::scenario_folder as suite;
    pub use esm_toolkit::scenario::*;
}
