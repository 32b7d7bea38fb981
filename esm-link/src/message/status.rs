//! How a robot is: what it is doing, and since when what went wrong.

use serde::{Deserialize, Serialize};

use super::crash_report::ResetReason;
use super::flash::{FlashHealth, StoreStatus};
use super::mode::Mode;
use super::trial::{FallBack, Trial};

#[cfg(doc)]
use super::Request;

/// How the robot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// What it is doing.
    pub mode: Mode,
    /// Hash of its mission.
    pub mission: Option<u32>,
    /// Macro steps that were completed since the mission started.
    pub steps: u64,
    /// Nominal start of the last macro step, in microseconds since the mission started.
    pub t_us: u64,
    /// Activations of slots that were executed since the mission started.
    pub executed: u32,
    /// Activations of slots that did not start within their period, since the robot started.
    pub missed: u32,
    /// Activations of slots whose tasks took longer than the slot's duration, since the robot
    /// started.
    pub overruns: u32,
    /// Longest delay between the nominal and the actual start of an activation since the mission
    /// started, in nanoseconds.
    pub max_delay_ns: u32,
    /// Trace records dropped since the robot started.
    pub trace_dropped: u32,
    /// Whether a background run is under way.
    pub background_busy: bool,
    /// The most bytes of stack that were in use since the robot started, where the board measures
    /// it.
    pub stack_bytes: Option<u32>,
    /// Why the robot started the last time.
    pub reset: ResetReason,
    /// If the mission runs on trial.
    pub trial: Option<Trial>,
    /// The last mission that was given up on trial since the robot started.
    pub fell_back: Option<FallBack>,
    /// Where the mission is that runs, and what else its flash has; none of a robot that keeps no
    /// missions.
    pub kept: Option<StoreStatus>,
    /// Parameters whose values differ from the mission's.
    pub changed_params: u8,
    /// Records of recordings dropped since the robot started.
    pub record_dropped: u32,
    /// Whether something that was recorded was not sent yet, or another stream's part stands before
    /// it.
    pub record_pending: bool,
    /// Values of parameters that were [saved](Request::SaveParams) for the mission.
    pub saved_params: u8,
    /// The button of the emergency stop is pressed, so that no [`Request::Release`] is taken;
    /// looked at while a stop is latched.
    pub stop_pressed: bool,
    /// How its flash is; none of a robot that keeps nothing.
    pub flash: Option<FlashHealth>,
}
