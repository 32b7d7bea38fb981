//! How long a script is that is kept.

use esm_link::behaviours::{
    MAX_CALL_PARAMS, MAX_SCRIPT_STEPS, MAX_WATCHES, PARAM_BYTES, WATCH_BYTES,
};

/// Bytes before the steps of a script.
pub(crate) const HEAD_BYTES: usize = 12;
/// Bytes of a step: its task, its parameters and situations, and how many it has of both.
pub(crate) const STEP_BYTES: usize =
    8 + MAX_CALL_PARAMS * PARAM_BYTES + MAX_WATCHES * WATCH_BYTES + 2;
/// Bytes of a script, at most.
pub const SCRIPT_BYTES: usize = HEAD_BYTES + MAX_SCRIPT_STEPS * STEP_BYTES;
