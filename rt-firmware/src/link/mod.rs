//! The device's end of the [link](esm_link): what the robot answers, and how stops are heard.

/// Whether this defect is planted. Only tests have defects to plant: each must make them fail.
#[cfg(test)]
macro_rules! mutant {
    ($bug:ident) => {
        esm_link::mutants::is_mutant(esm_link::mutants::Bug::$bug)
    };
}
#[cfg(not(test))]
macro_rules! mutant {
    ($bug:ident) => {
        false
    };
}

/// A place where an interrupt may come between two looks at what sides share. Tests let one come.
#[cfg(test)]
macro_rules! preemptible {
    () => {
        crate::link::preemption::point()
    };
}
#[cfg(not(test))]
macro_rules! preemptible {
    () => {};
}

pub mod device;
#[cfg(test)]
mod mutants;
#[cfg(test)]
mod preemption;
pub mod status_event;
pub mod stop_listener;
pub(crate) mod stops;
pub mod trial;
