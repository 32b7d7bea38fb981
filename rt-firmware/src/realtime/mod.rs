//! The real-time side: owned by the slot timer's interrupt, it executes what is due and says when
//! it wants to be called again.
//!
//! What it does stands in modules of its own. The timer's interrupt enters at `activation`, which
//! has looked up the next one, as a rule; `due` finds what else is due. An `activation` is a macro
//! step, where the slot is the interpreter's, the `execution` of the slot's enabled tasks, in the
//! order of the instance tree, and the `background_runs` in slot 0, which are taken back and
//! started; `counters` says what was counted of it, and when that is too much. A `mission` starts
//! and ends; `change` is when another one takes over, or the same one starts anew, and `trial` how
//! the robot goes back to the one before. `commands` are what the link wants, and `answers` what it
//! asks. `safe_state` is motors off. `health` is what the others see of all this, and `heartbeats`
//! what the watchdog is fed for.
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
