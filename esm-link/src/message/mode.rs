//! What a robot is doing, and why it stopped by itself.

use serde::{Deserialize, Serialize};

#[cfg(doc)]
use super::Request;

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

/// Why a robot went to its safe state by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SafeReason {
    /// The machine sent more events than its queue holds.
    EventQueueOverflow,
    /// A macro step had too many micro steps.
    MacroStepLimit,
    /// Too many overruns.
    Overruns,
    /// Too many activations missed in a row.
    DeadlineMiss,
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
        SafeReason::DeadlineMiss,
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
