//! What a task reports to its machine.

/// What a task reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Report {
    /// A flag changes.
    Flag {
        /// Index of the flag in the task's signature.
        flag: usize,
        /// Its new value.
        value: bool,
    },
    /// The task is finished.
    Exit,
    /// The task cannot be executed, or can again.
    Busy(bool),
}
