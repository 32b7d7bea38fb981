//! The host board without a thread: the firmware's runtime and tasks as a value that somebody
//! drives from one slot to the next.
//!
//! Dispatcher, registry, interpreter, tasks, link: all the code that a firmware runs. What differs
//! is what a board gives: the timer is virtual and jumps from one slot to the next, the byte link
//! is a [`HostPort`], the pins lead to the [plant](crate::plant::behind_pins) by a call. Code takes
//! no time here, so that nothing is ever late; a task in slot 0 ends before the next slot, or where
//! a recording says that it did.
//!
//! In the `esm` command it lives in a thread, and its port is a pipe or a line. In a page, and
//! wherever there is no thread, a [run](crate::host_run) drives it.

mod body;
mod life;
pub mod log_lines;
mod memory;

pub use body::{OpenLine, Outputs, RecordedEnds};
pub use life::{HostLife, HostPort};
pub use memory::{BOARD, CAPACITIES, HostMemory, about};
