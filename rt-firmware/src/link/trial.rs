//! Missions on trial: how long, why one was given up, and who remembers that across a reset.

use serde::{Deserialize, Serialize};

use super::message::{LinkError, SafeReason};
use crate::realtime::params::SavedParams;
use crate::store::keep::{FlashHealth, Kept, Start};

/// A mission that runs on trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Trial {
    /// Time until the robot falls back by itself, in milliseconds.
    pub left_ms: u32,
    /// Hash of the mission that it falls back to; none where there was none, so that its motors will be off.
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

/// Remembers across a reset which mission is on trial and which was confirmed: a store on a flash. A board that has one hands it out by
/// [`LinkPort::keeper`](super::device::LinkPort::keeper).
///
/// All of this is called from the link's context and may take as long as a flash does: slots go on meanwhile, requests wait.
pub trait MissionKeeper {
    /// A mission was uploaded and checked, and is about to take over: none is on trial any more, and one whose confirmation was not taken is confirmed first. When this has come back, a reset must find the mission whole, on trial; if it comes back with
    /// an error, the mission does not take over, and the one before is to be found as if nothing had been, as far as the memory still takes anything.
    ///
    /// # Errors
    /// What the host is to be told.
    fn trial_begins(&mut self, blob: &[u8]) -> Result<(), LinkError>;

    /// The mission with this hash was confirmed, or took over without a trial. The host is told after this has come back.
    ///
    /// # Errors
    /// What the host is to be told. The mission goes on all the same, until the next reset; this is done again if the host confirms it again.
    fn trial_confirmed(&mut self, mission: u32) -> Result<(), LinkError>;

    /// The mission with this hash was given up: the one before runs already, if there is one. Returns whether the robot is to [choose](Self::choose) another, for
    /// there was no mission before since the start, and now the one that was confirmed last is due.
    fn trial_failed(&mut self, mission: u32) -> bool;

    /// The time, in microseconds since the robot started: the allowance of erases fills up with it, and what was put off for want of it is done. To be called often.
    fn tick(&mut self, now_us: u64);

    /// How the flash is.
    fn flash_health(&mut self) -> FlashHealth;

    /// Puts the mission that the robot is to start with into the beginning of `room`: one that `accepts` takes.
    fn choose(&mut self, room: &mut [u8], accepts: &mut dyn FnMut(&[u8]) -> bool) -> Start;

    /// Which mission runs, and why.
    fn kept(&self) -> Kept;

    /// Keeps values of parameters, in place of those before, for whatever mission they were; none of [`SavedParams::NONE`]. Cut at any time, these are kept or those before.
    ///
    /// # Errors
    /// What the host is to be told. Those before may have stayed.
    fn save_params(&mut self, saved: &SavedParams) -> Result<(), LinkError>;

    /// The values that are kept.
    fn saved_params(&mut self) -> SavedParams;

    /// Whether an emergency stop was latched last.
    fn is_emergency_stopped(&self) -> bool;

    /// An emergency stop is latched, or released. The host is told after this has come back.
    ///
    /// # Errors
    /// What the host is to be told. Until the next loss of power it is so all the same. A release that was put off for want of erases is kept later, unless there is another stop
    /// before.
    fn set_emergency_stop(&mut self, latched: bool) -> Result<(), LinkError>;
}

/// How long a mission that a robot starts with may run on trial, in milliseconds: one whose upload came to its end and whose trial did not begin before the
/// power was lost.
pub const TRIAL_AT_START_MS: u32 = 30_000;

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
