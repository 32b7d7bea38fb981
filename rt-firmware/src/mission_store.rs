//! Who remembers across a reset which mission is on trial.

use esm_link::message::{FlashHealth, LinkError, StoreStatus};

use crate::realtime::params::SavedParams;

/// Remembers across a reset which mission is on trial and which was confirmed: a store on a flash.
/// A board that has one hands it out by
/// [`LinkPort::mission_store`](crate::LinkPort::mission_store).
///
/// All of this is called from the link's context and may take as long as a flash does: slots go on
/// meanwhile, requests wait.
pub trait MissionStore {
    /// A mission was uploaded and checked, and is about to take over: none is on trial any more,
    /// and one whose confirmation was not taken is confirmed first. When this has come back, a
    /// reset must find the mission whole, on trial; if it comes back with an error, the mission
    /// does not take over, and the one before is to be found as if nothing had been, as far as the
    /// memory still takes anything.
    ///
    /// # Errors
    /// What the host is to be told.
    fn trial_begins(&mut self, blob: &[u8]) -> Result<(), LinkError>;

    /// The mission with this hash was confirmed, or took over without a trial. The host is told
    /// after this has come back.
    ///
    /// # Errors
    /// What the host is to be told. The mission goes on all the same, until the next reset; this is
    /// done again if the host confirms it again.
    fn trial_confirmed(&mut self, mission: u32) -> Result<(), LinkError>;

    /// The mission with this hash was given up: the one before runs already, if there is one.
    /// Returns whether the robot is to [choose](Self::choose) another, for there was no mission
    /// before since the start, and now the one that was confirmed last is due.
    fn trial_failed(&mut self, mission: u32) -> bool;

    /// The time, in microseconds since the robot started: the allowance of erases fills up with it,
    /// and what was put off for want of it is done. To be called often.
    fn tick(&mut self, now_us: u64);

    /// How the flash is.
    fn flash_health(&mut self) -> FlashHealth;

    /// Puts the mission that the robot is to start with into the beginning of `room`: one that
    /// `accepts` takes.
    fn choose(&mut self, room: &mut [u8], accepts: &mut dyn FnMut(&[u8]) -> bool) -> Start;

    /// Which mission runs, and why.
    fn kept(&self) -> StoreStatus;

    /// Keeps values of parameters, in place of those before, for whatever mission they were; none
    /// of [`SavedParams::NONE`]. Cut at any time, these are kept or those before.
    ///
    /// # Errors
    /// What the host is to be told. Those before may have stayed.
    fn save_params(&mut self, saved: &SavedParams) -> Result<(), LinkError>;

    /// The values that are kept.
    fn saved_params(&mut self) -> SavedParams;

    /// Keeps a script beside the missions, in the place of the one before; `None` for none. Cut at
    /// any time, this one is kept or the one before.
    ///
    /// # Errors
    /// What the host is to be told: [`LinkError::NoStore`] where there is no room for one.
    fn keep_script(&mut self, _script: Option<&[u8]>) -> Result<(), LinkError> {
        Err(LinkError::NoStore)
    }

    /// Reads the script that is kept into the beginning of `room`. Returns its length, 0 where
    /// there is none.
    fn kept_script(&mut self, _room: &mut [u8]) -> usize {
        0
    }

    /// Whether an emergency stop was latched last.
    fn is_emergency_stopped(&self) -> bool;

    /// An emergency stop is latched, or released. The host is told after this has come back.
    ///
    /// # Errors
    /// What the host is to be told. Until the next loss of power it is so all the same. A release
    /// that was put off for want of erases is kept later, unless there is another stop before.
    fn set_emergency_stop(&mut self, latched: bool) -> Result<(), LinkError>;
}

/// What to start with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The mission of this length that is in the room now.
    Mission {
        /// Its length in bytes.
        len: usize,
        /// It was never confirmed: if it is not now, the other one is to run.
        on_trial: bool,
    },
    /// Nothing: the flash has no mission that may run, and the firmware has none.
    Nothing,
}

/// How long a mission that a robot starts with may run on trial, in milliseconds: one whose upload
/// came to its end and whose trial did not begin before the power was lost.
pub const TRIAL_AT_START_MS: u32 = 30_000;
