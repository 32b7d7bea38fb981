//! The device's end of the [link](esm_link): what the robot answers, and how stops are heard.

/// Whether this defect is planted. Only tests have defects to plant: each must make them fail.
#[cfg(test)]
macro_rules! planted {
    ($bug:ident) => {
        esm_link::mutants::is_planted(esm_link::mutants::Bug::$bug)
    };
}
#[cfg(not(test))]
macro_rules! planted {
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
pub mod news;
#[cfg(test)]
mod planted;
#[cfg(test)]
mod preemption;
pub mod stop_listener;
pub(crate) mod stops;
pub mod trial;
