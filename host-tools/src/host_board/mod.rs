//! The host board: the firmware's runtime and tasks as a part of this process.

/// The board's name, as `--board` takes it and as it calls itself.
pub const BOARD: &str = "host";
