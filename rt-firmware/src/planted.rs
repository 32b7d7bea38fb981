//! What tests plant in the code of stops and of the link: defects, and interrupts that come where
//! they do most harm.

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
