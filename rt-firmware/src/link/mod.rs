//! The device's end of the [link](esm_link): what the robot answers, and how stops are heard.

pub mod device;
#[cfg(test)]
mod mutants;
#[cfg(test)]
pub(crate) mod preemption;
pub mod status_event;
pub mod stop_listener;
