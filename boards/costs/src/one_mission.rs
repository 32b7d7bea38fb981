//! How a mission gets into the runtime without a line: as the one that a flash has kept, which is a
//! file of the emulator's folder.

use esm_link::message::{BankState, FlashHealth, KeyValuesState, LinkError, Source, StoreStatus};
use rt_firmware::LinkPort;
use rt_firmware::mission_store::{MissionStore, Start};
use rt_firmware::realtime::params::SavedParams;

use crate::file;

/// The file of the mission.
const FILE: &core::ffi::CStr = c"mission.blob";

/// A line with nobody at its other end, and the mission.
pub struct Port {
    /// The time, in microseconds.
    pub now_us: u64,
    /// The mission.
    pub mission: OneMission,
}

impl LinkPort for Port {
    const KEEPS_LOG: bool = false;

    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        None
    }

    fn send(&mut self, _byte: u8) -> bool {
        true
    }

    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        Some(&mut self.mission)
    }
}

/// The mission in the file. Nothing else is kept.
pub struct OneMission;

impl MissionStore for OneMission {
    fn trial_begins(&mut self, _blob: &[u8]) -> Result<(), LinkError> {
        Err(LinkError::NoStore)
    }

    fn trial_confirmed(&mut self, _mission: u32) -> Result<(), LinkError> {
        Ok(())
    }

    fn trial_failed(&mut self, _mission: u32) -> bool {
        false
    }

    fn tick(&mut self, _now_us: u64) {}

    fn flash_health(&mut self) -> FlashHealth {
        FlashHealth {
            records: KeyValuesState::New,
            flaws: 0,
            mission_erases: 0,
            record_erases: 0,
        }
    }

    fn choose(&mut self, room: &mut [u8], accepts: &mut dyn FnMut(&[u8]) -> bool) -> Start {
        let len = file::read(FILE, room);
        match room.get(..len).is_some_and(accepts) {
            true => Start::Mission {
                len,
                on_trial: false,
            },
            false => Start::Nothing,
        }
    }

    fn kept(&self) -> StoreStatus {
        StoreStatus {
            runs: Source::A,
            slots: [BankState::Runs, BankState::Empty],
        }
    }

    fn save_params(&mut self, _saved: &SavedParams) -> Result<(), LinkError> {
        Err(LinkError::NoStore)
    }

    fn saved_params(&mut self) -> SavedParams {
        SavedParams::NONE
    }

    fn is_emergency_stopped(&self) -> bool {
        false
    }

    fn set_emergency_stop(&mut self, _latched: bool) -> Result<(), LinkError> {
        Err(LinkError::NoStore)
    }
}
