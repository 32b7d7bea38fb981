//! What a robot keeps in its flash, and how the flash is.

use serde::{Deserialize, Serialize};

/// Which mission runs, and why: what the robot tells of its flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoreStatus {
    /// Where the mission is that runs.
    pub runs: Source,
    /// What is in bank A and bank B.
    pub slots: [BankState; 2],
}

impl StoreStatus {
    /// Whether a mission is on trial: neither confirmed nor given up.
    pub fn is_on_trial(&self) -> bool {
        self.slots.contains(&BankState::OnTrial)
    }
}

/// How a robot's flash is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FlashHealth {
    /// How its records are.
    pub records: KeyValuesState,
    /// Places of the records that were neither blank nor whole at the start: bits that have
    /// changed, or what a loss of power has left. Where the records can be read, nothing was lost
    /// by it.
    pub flaws: u16,
    /// How often a slot for a mission was erased, both counted together.
    pub mission_erases: u32,
    /// How often an area for records was erased, both counted together.
    pub record_erases: u32,
}

/// Where a mission is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// Nowhere: none runs.
    Nothing,
    /// In bank A of the flash.
    A,
    /// In bank B of the flash.
    B,
    /// In the firmware.
    Firmware,
}

/// What is in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BankState {
    /// The mission that runs.
    Runs,
    /// The mission that runs on trial.
    OnTrial,
    /// A confirmed mission, older than the one that runs.
    Spare,
    /// Nothing.
    Empty,
    /// A mission whose upload did not end.
    Unsealed,
    /// No header with a right checksum: an upload that did not come to its end, an erase that was
    /// cut, or damage.
    BrokenHeader,
    /// A header of a layout that this firmware does not know.
    OtherFormat,
    /// A mission that is longer than a slot of this firmware.
    TooLong,
    /// A mission that is longer than the room that it was to be read into.
    NoRoom {
        /// Its length in bytes.
        len: u32,
    },
    /// A mission with a wrong checksum: damage.
    BrokenPayload,
    /// The flash gave an error when it was read.
    Unreadable,
    /// The caller refused it.
    Refused,
    /// A mission that was on trial and was not confirmed.
    TrialFailed,
    /// A mission that may not run, for the flash did not take the word that says that it is on
    /// trial.
    TrialNotRecorded,
    /// A mission that never ran, and whose place in the order was taken by the other one.
    GivenUp,
}

/// How the records are,.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum KeyValuesState {
    /// Nothing was ever kept.
    New,
    /// All that was kept is there twice.
    Whole,
    /// All that was kept is there, but the flash did not take it twice: the next damage loses it.
    Once,
    /// There were records, and none of them can be read: the robot is stopped, and takes nothing
    /// but from who [gets in](WayIn).
    Unreadable(WayIn),
    /// The records that can be read are older than those that were kept last, or nothing says that
    /// they are not; as with those that cannot be read.
    Older(WayIn),
}

/// Who gets into a robot whose records are damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum WayIn {
    /// The owner of the key that it had, which it remembers.
    Key,
    /// Everybody: it is certain that it had no key.
    NoKey,
    /// Nobody: its flash must be erased at the programmer, for it is not known which key it had.
    Erase,
}
