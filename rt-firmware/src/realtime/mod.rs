//! The real-time side: owned by the slot timer's interrupt, it executes what is due and says when
//! it wants to be called again.
//!
//! It has six parts, each a struct with fields of its own. The `timetable` says which slot starts
//! when, and what the time is then. The `machine` is the mission that runs, with its interpreter,
//! parameters and trial. The `execution` has the tasks, those of slot 0 too. `safety` decides
//! whether the robot may move and whether the watchdog is fed. The `observers` are told what
//! happens, as `events`. `commands` has the one command of the link. Of these, the execution knows
//! machine and observers, and no other knows one.
//!
//! [`RealTime`] puts them together. The timer's interrupt enters at `activation`, which has looked
//! up the next one, as a rule; `due` finds what else is due. An `activation` is a macro step, where
//! the slot is the interpreter's, the slot's enabled tasks, in the order of the instance tree, and
//! the background runs, which are taken back and started; `counters` says what was counted of it,
//! and when that is too much. A `mission` starts and ends; `change` is when another one takes over,
//! or the same one starts anew, and `trial` how the robot goes back to the one before. `requests`
//! is what is done for a command, `answers` what for a question. `safe_state` is motors off.
//! `health` is what the link sees of all this.
//!
//! *Invariant:* nothing here waits or locks.
//!
//! *Invariant:* after a stop or in the safe state slots go on, so that time, counters, link and the
//! simulated body do, but neither the interpreter nor any task is executed. After an emergency stop
//! the motors are switched off before each exchange with the body besides, whoever else may have
//! written them.

mod activation;
mod answers;
mod change;
pub(crate) mod commands;
mod counters;
mod due;
mod events;
pub(crate) mod execution;
mod health;
mod limits;
pub(crate) mod machine;
pub mod mailbox;
mod mission;
pub(crate) mod observers;
pub mod params;
mod requests;
mod safe_state;
pub(crate) mod safety;
pub(crate) mod slots;
pub(crate) mod staging;
mod state;
pub(crate) mod tasks;
pub(crate) mod timetable;
pub(crate) mod trace;
mod trial;

pub use limits::{IDLE_POLL_US, Limits};
pub use state::RealTime;
