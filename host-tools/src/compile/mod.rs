//! From a resolved model to a blob.

use crate::model::Model;

/// Why a model cannot become a blob.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompileError {
    /// The set of files has no machine.
    #[error("there is no machine to compile: add a `machine`, or name the file that has one")]
    NoMachine,
    /// The set of files says not which slot runs the interpreter.
    #[error("no slot runs the interpreter: add `interpreter slot N;`")]
    NoInterpreterSlot,
    /// Not as many start times as slots.
    #[error("{starts} start times for {slots} slots")]
    StartTimes {
        /// Slots of the model.
        slots: usize,
        /// Start times given.
        starts: usize,
    },
    /// Something is more than the blob's format can hold.
    #[error("{found} {what}, but a blob holds at most {limit}")]
    Limit {
        /// What there is too much of.
        what: Capacity,
        /// How many the model needs.
        found: usize,
        /// How many there can be.
        limit: usize,
    },
    /// The start times let slots overlap.
    #[error("the start times of the slots do not fit: slot {0} overlaps with an earlier one")]
    Schedule(u32),
}

/// Compiles the machine of a model, with the first start of each slot in microseconds, into a blob. Equal input gives equal bytes.
///
/// # Errors
/// See [`CompileError`].
pub fn compile(model: &Model, starts_us: &[u32]) -> Result<Vec<u8>, CompileError> {
    let _ = (model, starts_us);
    Err(CompileError::NoMachine)
}

/// What a blob's format limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capacity {
    /// Flag bits of all instances.
    Flags,
}

impl std::fmt::Display for Capacity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Flags => "flags",
        })
    }
}
