//! What a robot keeps in its flash: two missions, and the records behind them.

use embedded_storage::nor_flash::NorFlash;

use super::budget::{self, Budget};
#[cfg(feature = "behaviours")]
use super::kept_script::KeptScript;
use super::key_values::{Found, Key, KeyValues, PutError};
use super::{
    AppendError, BeginError, Choice, FinishError, FlashBank, HEADER_BYTES, Layout, LayoutError,
    Store, TrialError, journal,
};
use crate::mission_store::{MissionStore, Start};
use crate::realtime::params::SavedParams;
use crate::retained_ram::RetainedRam;
use esm_link::key_store::{KeyStore, NotStored, StoredKey, WriteError};
use esm_link::message::{BankState, Capacity, FlashHealth, LinkError, Source, StoreStatus};

/// Room for records: what [`FlashStore::open`] is to be given.
pub const RECORD_BYTES: usize = 512;

/// The record of [`SavedParams`]; those before it are [those of the
/// key](esm_link::key_store::StoredKey).
const SAVED_PARAMS: Key = Key(4);

/// Bytes of flash that a robot's missions of up to `blob_bytes` and its records take, where
/// `erase_bytes` are erased at once.
pub const fn flash_bytes(blob_bytes: u32, erase_bytes: u32) -> u32 {
    2 * (bank_bytes(blob_bytes, erase_bytes) + bank_bytes(RECORD_BYTES as u32, erase_bytes))
        + journal::bytes(erase_bytes)
}

/// The same with the script that a robot with behaviours can keep, behind all else.
pub const fn flash_bytes_with_script(blob_bytes: u32, erase_bytes: u32) -> u32 {
    flash_bytes(blob_bytes, erase_bytes) + script_bytes(erase_bytes)
}

#[cfg(feature = "behaviours")]
const fn script_bytes(erase_bytes: u32) -> u32 {
    2 * bank_bytes(super::SCRIPT_BYTES as u32, erase_bytes)
}

#[cfg(not(feature = "behaviours"))]
const fn script_bytes(_erase_bytes: u32) -> u32 {
    0
}

/// Bytes of flash that a mission, or records, of up to `payload_bytes` take: what is erased for
/// them.
pub const fn bank_bytes(payload_bytes: u32, erase_bytes: u32) -> u32 {
    (HEADER_BYTES + payload_bytes).next_multiple_of(erase_bytes)
}

impl From<FlashBank> for Source {
    fn from(slot: FlashBank) -> Self {
        match slot {
            FlashBank::A => Source::A,
            FlashBank::B => Source::B,
        }
    }
}

/// Why a mission could not be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashStoreError {
    /// Another one is on trial.
    OnTrial,
    /// It is longer than a slot.
    TooLong {
        /// Its length in bytes.
        needed: u32,
        /// The longest mission in bytes.
        capacity: u32,
    },
    /// The flash did not take it.
    Flash,
    /// The flash was erased too often of late.
    Budget {
        /// Seconds until it may be tried again.
        s: u32,
    },
}

/// Missions and records of a robot.
pub struct FlashStore<'m, F> {
    missions: Store<F>,
    records: KeyValues<'m, F>,
    /// The mission that runs if the flash has none that may: the firmware's own.
    default_mission: Option<&'m [u8]>,
    /// It was the one to start with.
    own_ran: bool,
    kept: StoreStatus,
    budgets: Budgets<'m>,
    /// An emergency stop was latched, or released, and the flash does not say so yet.
    stop_put_off: Option<bool>,
    /// None where the flash has no room for it.
    #[cfg(feature = "behaviours")]
    script: Option<KeptScript<F>>,
}

/// What may still be erased.
struct Budgets<'m> {
    uploads: Budget<'m>,
    records: Budget<'m>,
    keys: Budget<'m>,
    /// When they were filled last.
    filled: u32,
}

impl<'m> Budgets<'m> {
    const FULL: Budgets<'m> = Budgets {
        uploads: Budget::new(budget::UPLOADS),
        records: Budget::new(budget::RECORDS),
        keys: Budget::new(budget::KEYS),
        filled: 0,
    };

    fn fill(&mut self, now_us: u64) {
        let unit = budget::unit(now_us);
        let units = unit.saturating_sub(self.filled);
        if units > 0 {
            self.filled = unit;
            for budget in [&mut self.uploads, &mut self.records, &mut self.keys] {
                budget.fill(units);
            }
        }
    }
}

impl<'m, F: NorFlash + Clone> FlashStore<'m, F> {
    /// Opens missions and records of a flash: from its first byte on two slots for missions of up
    /// to `blob_bytes`, then the records, for whose table `room` is: [`RECORD_BYTES`].
    ///
    /// # Errors
    /// They do not fit the flash.
    pub fn open(
        flash: F,
        blob_bytes: u32,
        default_mission: Option<&'m [u8]>,
        room: &'m mut [u8],
    ) -> Result<Self, LayoutError> {
        let erase_bytes = F::ERASE_SIZE as u32;
        let mission_bytes = bank_bytes(blob_bytes, erase_bytes);
        let record_bytes = bank_bytes(RECORD_BYTES as u32, erase_bytes);
        let missions = Store::new(flash.clone(), Layout::new(0, mission_bytes))?;
        let layout = Layout::new(2 * mission_bytes, record_bytes);
        #[cfg(feature = "behaviours")]
        let script = {
            let script_at = flash_bytes(blob_bytes, erase_bytes);
            let layout = Layout::new(script_at, script_bytes(erase_bytes) / 2);
            KeptScript::open(flash.clone(), layout).ok()
        };
        Ok(FlashStore {
            missions,
            records: KeyValues::open(flash, layout, room)?,
            default_mission,
            own_ran: false,
            kept: StoreStatus {
                runs: Source::Nothing,
                slots: [BankState::Empty; 2],
            },
            budgets: Budgets::FULL,
            stop_put_off: None,
            #[cfg(feature = "behaviours")]
            script,
        })
    }

    /// Lets a reset leave the allowances for erases as they were: a board with retained RAM calls
    /// this before anything is kept, and after [`RetainedRam::begin`], which fills them when power
    /// comes.
    #[must_use]
    pub fn over_resets(mut self, retained: &'m RetainedRam) -> Self {
        let [uploads, records, keys] = retained.allowances();
        self.budgets.uploads.retain(uploads);
        self.budgets.records.retain(records);
        self.budgets.keys.retain(keys);
        self
    }

    /// The records. What is kept there is not paid for.
    pub fn records(&mut self) -> &mut KeyValues<'m, F> {
        &mut self.records
    }

    /// Which mission runs, and why.
    pub fn kept(&self) -> StoreStatus {
        self.kept
    }

    /// Lets the firmware's own mission rest, from the next start on: where the flash has no mission
    /// that may run, the robot waits for a host to bring one. So time on a simulated robot begins
    /// with the mission that the run is of.
    ///
    /// # Errors
    /// The flash does not take it.
    pub fn wait_for_host(&mut self) -> Result<(), PutError> {
        self.records.put(Key::WAITS, &[1])
    }

    /// Reads the mission that is to run from now on into `room`: the flash's, or the firmware's own
    /// where none of them may run. `accepts` is asked before a mission is taken.
    pub fn choose(&mut self, room: &mut [u8], mut accepts: impl FnMut(&[u8]) -> bool) -> Start {
        let Choice { mission, slots } = self.missions.choose(room, &mut accepts);
        self.kept.slots = slots;
        self.own_ran = false;
        if let Some(mission) = mission {
            self.kept.runs = mission.slot.into();
            return Start::Mission {
                len: mission.len as usize,
                on_trial: mission.on_trial,
            };
        }
        self.kept.runs = Source::Nothing;
        let waits = self.records.get(Key::WAITS).is_some();
        let own = self.default_mission.filter(|own| !waits && accepts(own));
        match own.and_then(|own| Some((own, room.get_mut(..own.len())?))) {
            Some((own, room)) => {
                room.copy_from_slice(own);
                self.kept.runs = Source::Firmware;
                self.own_ran = true;
                Start::Mission {
                    len: own.len(),
                    on_trial: false,
                }
            }
            None => Start::Nothing,
        }
    }

    /// Puts a mission into the slot that does not run, and puts it on trial. It may run when this
    /// has come back.
    ///
    /// # Errors
    /// Why it may not. The mission before runs on, and after the next start, too, unless the flash
    /// took the whole mission and then not one word more: then the next start tries it.
    pub fn begin_trial(&mut self, blob: &[u8]) -> Result<(), FlashStoreError> {
        let len = u32::try_from(blob.len()).unwrap_or(u32::MAX);
        let written = self.write(len, blob);
        // What does not end here would go on if the same mission came again.
        self.missions.abort();
        written
    }

    fn write(&mut self, len: u32, blob: &[u8]) -> Result<(), FlashStoreError> {
        if self.kept.is_on_trial() {
            return Err(FlashStoreError::OnTrial);
        }
        (self.budgets.uploads.take(budget::ONE)).map_err(|s| FlashStoreError::Budget { s })?;
        let crc = esm_core::format::crc32(blob);
        self.missions
            .prepare(len, crc)
            .map_err(|error| match error {
                BeginError::OnTrial => FlashStoreError::OnTrial,
                BeginError::Length { capacity } => FlashStoreError::TooLong {
                    needed: len,
                    capacity,
                },
                BeginError::Flash(_) => FlashStoreError::Flash,
            })?;
        let Some(slot) = self.missions.upload_slot() else {
            return Err(FlashStoreError::Flash);
        };
        self.set(slot, BankState::Unsealed);
        while self
            .missions
            .erase_next()
            .map_err(|_| FlashStoreError::Flash)?
        {}
        self.missions.append(0, blob)?;
        self.missions.finish()?;
        self.set(slot, BankState::TrialNotRecorded);
        self.missions.begin_trial()?;
        self.set(slot, BankState::OnTrial);
        if slot.other().of(self.kept.slots) == BankState::Runs {
            self.set(slot.other(), BankState::Spare);
        }
        self.kept.runs = slot.into();
        Ok(())
    }

    fn set(&mut self, slot: FlashBank, state: BankState) {
        *slot.of(self.kept.slots.each_mut()) = state;
    }

    /// The mission on trial, if one is, is the one that runs from now on.
    ///
    /// # Errors
    /// The flash did not take it: it is still on trial.
    pub fn confirm(&mut self) -> Result<(), FlashStoreError> {
        if !self.kept.is_on_trial() {
            return Ok(());
        }
        self.missions
            .confirm()
            .map_err(|_| FlashStoreError::Flash)?;
        if let Some(slot) = self.missions.running_slot() {
            self.set(slot, BankState::Runs);
        }
        Ok(())
    }

    /// The mission on trial was left. Returns whether the one before runs again; if not, it was on
    /// trial since the start, and the next is to be [chosen](FlashStore::choose).
    pub fn fall_back(&mut self) -> bool {
        let failed = self.missions.running_slot();
        if !self.missions.fall_back() {
            return false;
        }
        if let Some(slot) = failed {
            self.set(slot, BankState::TrialFailed);
        }
        self.kept.runs = match self.missions.running_slot() {
            Some(slot) => {
                self.set(slot, BankState::Runs);
                slot.into()
            }
            None if self.own_ran => Source::Firmware,
            None => Source::Nothing,
        };
        true
    }
}

impl<F: NorFlash> FlashStore<'_, F> {
    /// Lets the flash know of the emergency stop, or of its release, that it does not know of yet.
    fn store_stop(&mut self) -> Result<(), LinkError> {
        let Some(latched) = self.stop_put_off else {
            return Ok(());
        };
        let value: &[u8] = if latched { &[1] } else { &[] };
        if !self.records.is_kept(Key::EMERGENCY_STOP, value) {
            // The release before a stop has paid for it, and there is no other way to come to a
            // stop that is not kept.
            let is_paid = latched || (self.budgets.records.take(budget::RELEASE_AND_STOP)).is_ok();
            if !is_paid {
                return Err(LinkError::StopNotStored);
            }
        }
        // A flash that does not take it wears out by asking again.
        self.stop_put_off = None;
        (self.records.put(Key::EMERGENCY_STOP, value)).map_err(|_| LinkError::StopNotStored)
    }
}

impl<F: NorFlash> KeyStore for FlashStore<'_, F> {
    fn read(&mut self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        self.records.read_of_key(record, room)
    }

    fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), WriteError> {
        if self.records.is_kept(record.into(), bytes) {
            return Ok(());
        }
        let paid = match record {
            StoredKey::Key => self.budgets.keys.take(budget::ONE),
            // An upload was signed.
            StoredKey::Counter => self.budgets.uploads.take(budget::ONE),
            // Once each start.
            StoredKey::Starts => Ok(()),
        };
        paid.map_err(|s| WriteError::Budget { s })?;
        Ok(self.records.write_of_key(record, bytes)?)
    }

    fn remembered_key(&mut self, room: &mut [u8]) -> Result<usize, NotStored> {
        self.records.remembered_key(room)
    }

    fn renew(&mut self, key: &[u8]) -> Result<(), WriteError> {
        let paid = self.budgets.keys.take(budget::ONE);
        paid.map_err(|s| WriteError::Budget { s })?;
        (self.records.renew(key)).map_err(|_| WriteError::NotStored)
    }
}

impl<F: NorFlash + Clone> MissionStore for FlashStore<'_, F> {
    fn tick(&mut self, now_us: u64) {
        self.budgets.fill(now_us);
        // Who asked for it was told that it is late.
        let _ = self.store_stop();
    }

    fn flash_health(&mut self) -> FlashHealth {
        FlashHealth {
            records: self.records.state(),
            flaws: u16::try_from(self.records.flaws()).unwrap_or(u16::MAX),
            mission_erases: self.missions.erases(),
            record_erases: self.records.erases(),
        }
    }

    fn trial_begins(&mut self, blob: &[u8]) -> Result<(), LinkError> {
        // None is on trial any more: where the flash did not take a confirmation, it is to take it
        // now.
        self.confirm()?;
        Ok(self.begin_trial(blob)?)
    }

    fn trial_confirmed(&mut self, _mission: u32) -> Result<(), LinkError> {
        Ok(self.confirm()?)
    }

    fn trial_failed(&mut self, _mission: u32) -> bool {
        if !self.kept.is_on_trial() || self.fall_back() {
            return false;
        }
        // Until the next choice there is none that could be confirmed.
        if let Some(slot) = self.missions.running_slot() {
            self.set(slot, BankState::TrialFailed);
        }
        true
    }

    fn choose(&mut self, room: &mut [u8], accepts: &mut dyn FnMut(&[u8]) -> bool) -> Start {
        FlashStore::choose(self, room, accepts)
    }

    fn kept(&self) -> StoreStatus {
        self.kept
    }

    fn save_params(&mut self, saved: &SavedParams) -> Result<(), LinkError> {
        let mut room = [0; SavedParams::MAX_BYTES];
        let bytes = saved.put_into(&mut room);
        if !self.records.is_kept(SAVED_PARAMS, bytes) {
            (self.budgets.records.take(budget::ONE)).map_err(|s| LinkError::FlashBudget { s })?;
        }
        let kept = self.records.put(SAVED_PARAMS, bytes);
        kept.map_err(|_| LinkError::FlashRefused)
    }

    fn saved_params(&mut self) -> SavedParams {
        let record = self.records.get(SAVED_PARAMS);
        record.map_or(SavedParams::NONE, SavedParams::from_bytes)
    }

    #[cfg(feature = "behaviours")]
    fn keep_script(&mut self, script: Option<&[u8]>) -> Result<(), LinkError> {
        let kept = self.script.as_mut().ok_or(LinkError::NoStore)?;
        (self.budgets.uploads.take(budget::ONE)).map_err(|s| LinkError::FlashBudget { s })?;
        kept.keep(script).map_err(|()| LinkError::FlashRefused)
    }

    #[cfg(feature = "behaviours")]
    fn kept_script(&mut self, room: &mut [u8]) -> usize {
        self.script.as_mut().map_or(0, |kept| kept.read(room))
    }

    fn is_emergency_stopped(&self) -> bool {
        // Where it is not known, it is so.
        self.records.found() == Found::Damage || self.records.get(Key::EMERGENCY_STOP).is_some()
    }

    fn set_emergency_stop(&mut self, latched: bool) -> Result<(), LinkError> {
        self.stop_put_off = Some(latched);
        self.store_stop()
    }
}

impl From<FlashStoreError> for LinkError {
    fn from(error: FlashStoreError) -> Self {
        match error {
            FlashStoreError::OnTrial => LinkError::OnTrial,
            FlashStoreError::TooLong { needed, capacity } => LinkError::CapacityExceeded {
                what: Capacity::BlobBytes,
                needed,
                available: capacity,
            },
            FlashStoreError::Flash => LinkError::FlashRefused,
            FlashStoreError::Budget { s } => LinkError::FlashBudget { s },
        }
    }
}

impl From<AppendError> for FlashStoreError {
    fn from(_: AppendError) -> Self {
        FlashStoreError::Flash
    }
}

impl From<FinishError> for FlashStoreError {
    fn from(_: FinishError) -> Self {
        FlashStoreError::Flash
    }
}

impl From<TrialError> for FlashStoreError {
    fn from(_: TrialError) -> Self {
        FlashStoreError::Flash
    }
}
