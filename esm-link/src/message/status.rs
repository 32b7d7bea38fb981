//! How a robot is: what it is doing, and since when what went wrong.

use serde::{Deserialize, Serialize};

use super::flash::{FlashHealth, Kept};
use super::last_words::ResetReason;
use crate::trial::{FallBack, Trial};

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
    /// Occurrences of slots that were executed since the mission started.
    pub executed: u32,
    /// Occurrences of slots that did not start within their period, since the robot started.
    pub missed: u32,
    /// Occurrences of slots whose tasks took longer than the slot's duration, since the robot
    /// started.
    pub overruns: u32,
    /// Longest delay between the nominal and the actual start of an occurrence since the mission
    /// started, in nanoseconds.
    pub max_delay_ns: u32,
    /// Trace records dropped since the robot started.
    pub trace_dropped: u32,
    /// Whether a slot-0 run is under way.
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
    pub kept: Option<Kept>,
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

/// What a robot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// It has no mission.
    Empty,
    /// Its mission runs.
    Running,
    /// It was stopped by the host: motors are off until [`Request::Start`].
    Stopped,
    /// Something broke: motors are off until [`Request::Start`] or a new mission.
    Safe(SafeReason),
    /// Somebody stopped it for an emergency: motors are off until [`Request::Release`], whatever
    /// comes.
    EmergencyStopped,
}

impl Mode {
    /// Whether it is latched: neither another mission nor a fault ends it.
    pub fn is_latched(self) -> bool {
        matches!(self, Mode::Stopped | Mode::EmergencyStopped)
    }
}

/// Why a robot went to its safe state by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SafeReason {
    /// The machine sent more events than its queue holds.
    EventQueueOverflow,
    /// A macro step had too many micro steps.
    MacroStepLimit,
    /// Too many overruns.
    Overruns,
    /// Too many occurrences missed in a row.
    Missed,
    /// The robot's body does not answer.
    BodyLost,
    /// The battery is low.
    LowBattery,
    /// The host did not call for too long, and the mission needs it.
    LinkLost,
    /// The board found something else.
    Board,
    /// A task that watches something for the mission said nothing any more.
    MonitorSilent,
}

impl SafeReason {
    /// All reasons, in the order of their numbers.
    pub const ALL: [SafeReason; 9] = [
        SafeReason::EventQueueOverflow,
        SafeReason::MacroStepLimit,
        SafeReason::Overruns,
        SafeReason::Missed,
        SafeReason::BodyLost,
        SafeReason::LowBattery,
        SafeReason::LinkLost,
        SafeReason::Board,
        SafeReason::MonitorSilent,
    ];

    /// The reason's number, as trace records and snapshots carry it.
    pub fn number(self) -> u8 {
        self as u8
    }

    /// The reason with this number.
    pub fn from_number(number: u8) -> Option<SafeReason> {
        Self::ALL.get(usize::from(number)).copied()
    }
}

impl Mode {
    /// The mode's number in records and snapshots: those of the reasons follow those of the modes.
    pub fn number(self) -> u8 {
        match self {
            Mode::Empty => 0,
            Mode::Running => 1,
            Mode::Stopped => 2,
            Mode::Safe(reason) => 3 + reason.number(),
            Mode::EmergencyStopped => u8::MAX,
        }
    }

    /// The mode with this number.
    pub fn from_number(number: u8) -> Option<Mode> {
        Some(match number {
            0 => Mode::Empty,
            1 => Mode::Running,
            2 => Mode::Stopped,
            u8::MAX => Mode::EmergencyStopped,
            safe => Mode::Safe(SafeReason::from_number(safe - 3)?),
        })
    }
}
