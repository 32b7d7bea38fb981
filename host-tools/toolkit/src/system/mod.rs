//! A system: a robot with several processors, each with a mission of its own, on one body in one
//! world.
//!
//! A system file says which processors there are, which of the body's pins each has, and what lies
//! between them. [`read`] makes a [`declaration::System`] of its text, or says what is wrong with
//! it; [`ends`] holds both ends of each link against each other. [`shared_plant`] gives each
//! processor its part of one plant, and [`lock_step`] lets all of them run in one time.
//! [`arrivals`] notes what comes out of the links, and [`partner`] says what can be known from
//! that. [`drawing`] shows it all, and [`schedule`] when all slots and frames start.
//!
//! ```
//! use esm_toolkit::system::read::read;
//!
//! let text = "processor base mission \"base.esm\" pins motors, encoders;";
//! let (system, diagnostics) = read(text);
//! assert!(diagnostics.is_empty());
//! assert_eq!(system.map(|it| it.processors.len()), Some(1));
//! ```

pub mod arrivals;
pub mod declaration;
pub mod drawing;
pub mod ends;
pub mod lock_step;
pub mod merged_trace;
pub mod partner;
pub mod read;
pub mod schedule;
pub mod schedule_picture;
pub mod shared_plant;
mod token;
pub mod wiring;
