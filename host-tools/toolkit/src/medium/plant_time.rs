//! Plant time, in picoseconds, and when nothing passes.

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
pub(super) fn is_cut(cuts: &[Cut], from_ps: u64, to_ps: u64) -> bool {
    (cuts.iter()).any(|cut| from_ps < cut.to_ps && cut.from_ps < to_ps)
}
