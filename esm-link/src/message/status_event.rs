//! Status events: what a robot tells without being asked each time, where a host wants it. A sample
//! of its counters each period, and one at once when its mode, its mission or the trial of that
//! changes.

use serde::{Deserialize, Serialize};

use super::mode::Mode;
use super::trial::FallBack;

/// The shortest period of samples, in milliseconds: a shorter one counts as this. A sample is less
/// than 8 ms of a line of 115,200 baud.
pub const SHORTEST_PERIOD_MS: u32 = 10;

/// Why there are status events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// They were asked for just now.
    Begun,
    /// The period is over.
    Period,
    /// Another mission runs, the same one began anew after a fall-back, or there is none any more.
    Mission,
    /// A trial began or ended.
    Trial,
    /// The robot was stopped or started, or went to its safe state or left it.
    Mode,
}

/// How a robot is, in short.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StatusEvent {
    /// Counts status events modulo 256, from 0 at
    /// [`Request::Watch`](crate::message::Request::Watch): a gap are status events that the line
    /// lost.
    pub seq: u8,
    /// Why. Of several causes the first in this order: mission, trial, mode, period.
    pub cause: Cause,
    /// What it is doing.
    pub mode: Mode,
    /// Hash of its mission.
    pub mission: Option<u32>,
    /// Whether that runs on trial.
    pub on_trial: bool,
    /// The last mission that was given up on trial since the robot started.
    pub fell_back: Option<FallBack>,
    /// Macro steps since the mission started.
    pub steps: u64,
    /// Nominal start of the last one, in microseconds since the mission started.
    pub t_us: u64,
    /// Activations of slots that were executed since the mission started.
    pub executed: u32,
    /// Activations missed since the robot started.
    pub missed: u32,
    /// Overruns since the robot started.
    pub overruns: u32,
    /// Longest start delay since the mission started, in nanoseconds.
    pub max_delay_ns: u32,
    /// Frames from the host that arrived corrupt since the robot started; wraps.
    pub corrupt_frames: u32,
}
