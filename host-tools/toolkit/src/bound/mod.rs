//! The most instructions that a macro step of a mission takes: worked out from the compiled
//! mission, before it runs.
//!
//! - [`costs`]: what a macro step is made of, and how many instructions of a board each of that
//!   takes. They are measured, see `cargo xtask bench bound`.
//! - [`machine`]: the walk of the interpreter through a mission's tables, as a list of these
//!   constructs.
//! - [`worst`]: the bound, the most over all states that can be current together and all events
//!   that can follow from a pulse.
//! - [`tally`]: what a macro step that was run consisted of.
//! - [`search`]: the longest macro steps that are found by running the mission. No bound is below
//!   them.
//! - [`report`]: the bound in words, with what contributes most.

pub mod costs;
pub mod machine;
pub mod report;
pub mod search;
pub mod tally;
pub mod worst;

pub use costs::Costs;
pub use machine::Machine;
pub use worst::{Bound, bound};
