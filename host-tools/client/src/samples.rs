//! What tests here share with those of the command.

use esm_link::message::{Mode, ResetReason, Status};

/// What a robot says that drives with a mission, and to which nothing has happened.
pub fn status(mission: Option<u32>, steps: u64) -> Status {
    Status {
        mode: Mode::Running,
        mission,
        steps,
        t_us: 0,
        executed: 0,
        missed: 0,
        overruns: 0,
        max_delay_ns: 0,
        trace_dropped: 0,
        background_busy: false,
        stack_bytes: None,
        reset: ResetReason::PowerOn,
        trial: None,
        fell_back: None,
        kept: None,
        changed_params: 0,
        record_dropped: 0,
        record_pending: false,
        saved_params: 0,
        stop_pressed: false,
        flash: None,
    }
}
