//! What can be done with a mission without a robot and without an operating system: read, check,
//! compile and lay it out, draw it, simulate it and the robot around it, replay recordings of it,
//! and serve an editor that works on it.
//!
//! Nothing here opens a file, starts a thread, reads a clock or talks to anybody. Files come from a
//! [`lang::Store`], time from a function that the caller names ([`schedule::Limit`]), and what is
//! written goes to any [`std::io::Write`]. So the same code serves the `esm` command and a page in
//! a browser.
//!
//! ```
//! let checked = esm_toolkit::lang::load_text("wrong.esm", "task T { out flag near; out flag near; }");
//! assert_eq!(checked.diagnostics[0].code.as_str(), "E003");
//! ```

// All that goes to a terminal goes through the command's console, which cleans it.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod behaviour_words;
pub mod boards;
pub mod bound;
pub mod clean;
pub mod compile;
pub mod counters;
pub mod diagram;
pub mod duration;
pub mod fit;
pub mod goal;
pub mod host_board;
pub mod host_run;
pub mod inspect;
pub mod lang;
pub mod language_server;
pub mod link_node;
pub mod medium;
pub mod mission_hash;
pub mod model;
pub mod nearest;
pub mod odometry;
pub mod parameters;
pub mod payload;
pub mod pictures;
pub mod plant;
pub mod recording;
#[cfg(any(test, feature = "samples"))]
#[allow(clippy::unwrap_used, reason = "it is for tests alone")]
pub mod samples;
pub mod scenario;
pub mod schedule;
pub mod script;
pub mod selftest;
pub mod sim;
pub mod story;
pub mod streams;
mod superstates;
pub mod system;
pub mod table;
pub mod task_page;
#[cfg(test)]
mod test_disk;
#[cfg(test)]
mod test_golden;
pub mod timetable;
pub mod trace;
pub mod trace_events;
pub mod tune;
pub mod values;
#[cfg(test)]
mod work_time;
pub mod world;
