//! Missions on trial: how long, and why one was given up.

use serde::{Deserialize, Serialize};

use super::mode::SafeReason;

/// A mission that runs on trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Trial {
    /// Time until the robot falls back by itself, in milliseconds.
    pub left_ms: u32,
    /// Hash of the mission that it falls back to; none where there was none, so that its motors
    /// will be off.
    pub before: Option<u32>,
}

/// A mission on trial was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FallBack {
    /// Hash of the mission that was given up.
    pub mission: u32,
    /// Why.
    pub reason: FallBackReason,
}

/// Why a robot gave up a mission on trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FallBackReason {
    /// It was not confirmed in time.
    NotConfirmed,
    /// The host asked for it.
    Asked,
    /// The mission did what leads to the safe state.
    Failed(SafeReason),
}

impl FallBackReason {
    /// The reason's number, as trace records and snapshots carry it.
    pub fn number(self) -> u8 {
        match self {
            FallBackReason::NotConfirmed => 0,
            FallBackReason::Asked => 1,
            FallBackReason::Failed(reason) => 2 + reason.number(),
        }
    }

    /// The reason with this number.
    pub fn from_number(number: u8) -> Option<FallBackReason> {
        match number {
            0 => Some(FallBackReason::NotConfirmed),
            1 => Some(FallBackReason::Asked),
            failed => SafeReason::from_number(failed - 2).map(FallBackReason::Failed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_have_numbers_of_their_own() {
        let reasons = (0..=u8::MAX).filter_map(FallBackReason::from_number);
        let mut count = 0;
        for (reason, number) in reasons.zip(0..) {
            assert_eq!(reason.number(), number);
            count += 1;
        }
        assert!(count > 9, "{count}");
    }
}
