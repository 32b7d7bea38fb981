//! What lies between the processors of a robot, simulated: lines, memory that two share, a CAN bus.
//!
//! Time is plant time, an integer in picoseconds, in which a bit of any usual rate has a length. A
//! processor names times by its own [`clock`], in whole microseconds, which may run fast or slow.
//! What a medium does to what it carries follows from its settings and a seed alone: two runs are
//! equal to the byte.
//!
//! A medium knows nothing of what is in the bytes; on CAN, a frame has an identifier.

pub mod can;
pub mod chance;
pub mod clock;
pub mod line;
pub mod memory;

/// Picoseconds in a microsecond.
pub const PS_IN_US: u64 = 1_000_000;
/// Picoseconds in a second.
pub const PS_IN_S: u64 = 1_000_000 * PS_IN_US;

/// A time in which nothing passes, in picoseconds of plant time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cut {
    /// It begins here.
    pub from_ps: u64,
    /// It is over here.
    pub to_ps: u64,
}

/// Whether something that takes from one time to another meets a cut.
fn is_cut(cuts: &[Cut], from_ps: u64, to_ps: u64) -> bool {
    (cuts.iter()).any(|cut| from_ps < cut.to_ps && cut.from_ps < to_ps)
}
