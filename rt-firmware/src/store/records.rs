//! Small records that survive a loss of power: saved parameters, the counter of signed uploads, the key that is installed.
//!
//! A record is up to [`MAX_VALUE_BYTES`] under a number, its key. All of them together are one table, which stands in RAM, where [`get`](Records::get) finds a
//! record without a look at the flash, and in two areas of the flash, which are [slots](super) as those of missions are. [`put`](Records::put) writes the
//! whole table, with the new record in it, to the area that is not in use, and confirms it there. So all that is promised of missions holds: a record that was
//! acknowledged is not lost, one whose writing was cut is there with its new value or with its old one, from the next [`open`](Records::open) on always the same, and
//! records are whole or not there.
//!
//! ```
//! # use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
//! # struct Chip([u8; 4096]);
//! # impl ErrorType for Chip { type Error = NorFlashErrorKind; }
//! # impl ReadNorFlash for Chip {
//! #     const READ_SIZE: usize = 1;
//! #     fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
//! #         bytes.copy_from_slice(&self.0[at as usize..][..bytes.len()]);
//! #         Ok(())
//! #     }
//! #     fn capacity(&self) -> usize { self.0.len() }
//! # }
//! # impl NorFlash for Chip {
//! #     const WRITE_SIZE: usize = 4;
//! #     const ERASE_SIZE: usize = 1024;
//! #     fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
//! #         self.0[from as usize..to as usize].fill(0xFF);
//! #         Ok(())
//! #     }
//! #     fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
//! #         self.0[at as usize..][..bytes.len()].copy_from_slice(bytes);
//! #         Ok(())
//! #     }
//! # }
//! # let flash = Chip([0xFF; 4096]);
//! use rt_firmware::store::{Layout, records::{Key, Records}};
//!
//! let mut room = [0; 512];
//! // Two areas of 2 KiB each from the byte 0 of the flash on.
//! let mut records = Records::open(flash, Layout::new(0, 2048), &mut room)?;
//! assert_eq!(records.get(Key(7)), None);
//! records.put(Key(7), b"seven").expect("the flash takes it");
//! assert_eq!(records.get(Key(7)), Some(&b"seven"[..]));
//! # Ok::<(), rt_firmware::store::LayoutError>(())
//! ```
//!
//! # Costs
//! A `put` erases one area (of two, in turn) and writes the table and seven blocks; one that changes nothing costs nothing. It waits for the flash: to be
//! called from the link's context, never from a slot's. An `open` writes at most three blocks, and nothing from the fourth start after a `put` on; the first of all,
//! and one after a `put` that was cut, write the table. A flash that
//! lasts 10,000 erases lasts 20,000 puts.
//!
//! # Limits
//! The table has as many bytes as the room that [`open`](Records::open) is given, or as an area has behind its head, whichever is less; a record takes two bytes
//! more than its value. Damage of the table that is in use (bits that change by themselves) brings back the table before.

use embedded_storage::nor_flash::NorFlash;

use super::{Layout, LayoutError, SlotState, Store};
use crate::link::key_safe::{KeyRecord, NotKept};

/// The longest value of a record, in bytes.
pub const MAX_VALUE_BYTES: usize = 64;

/// Bytes of a record before its value: its key and its length.
const HEAD_BYTES: usize = 2;

/// Which record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Key(pub u8);

impl Key {
    /// Says, with any value, that an emergency stop is latched.
    pub(crate) const EMERGENCY_STOP: Key = Key(5);
    /// Says, with any value, that the firmware's own mission is not to run: the robot waits for a host.
    pub(crate) const WAITS: Key = Key(6);
}

impl From<KeyRecord> for Key {
    fn from(record: KeyRecord) -> Self {
        Key(match record {
            KeyRecord::Key => 1,
            KeyRecord::Counter => 2,
            KeyRecord::Starts => 3,
        })
    }
}

/// Why a record was not kept. The one before is still there, if there was one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PutError {
    /// A value has at most [`MAX_VALUE_BYTES`].
    TooLong,
    /// The table has no room for it.
    Full {
        /// Bytes that the table has for records.
        capacity: usize,
    },
    /// The flash did not take it.
    Flash,
}

/// What a start found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing was ever kept. A table without records is there now.
    Nothing,
    /// A table.
    Table,
    /// Both areas hold something, and none of them a table that is whole. A robot must not take this for one that never had records. The next `put` makes a new
    /// table.
    Damage,
}

/// The records, and the flash that keeps them.
pub struct Records<'m, F> {
    store: Store<F>,
    /// The table is the first `len` bytes: records, each its key, its length, and its value. No key is there twice.
    room: &'m mut [u8],
    len: usize,
    found: Found,
}

impl<'m, F: NorFlash> Records<'m, F> {
    /// Reads the table into `room`.
    ///
    /// # Errors
    /// The areas (the slots of the layout) do not fit the flash.
    pub fn open(flash: F, layout: Layout, room: &'m mut [u8]) -> Result<Self, LayoutError> {
        let capacity = room.len().min(layout.payload_capacity() as usize);
        let room = room.get_mut(..capacity).unwrap_or_default();
        let store = Store::new(flash, layout)?;
        let mut records = Records {
            store,
            room,
            len: 0,
            found: Found::Nothing,
        };
        records.load();
        Ok(records)
    }

    /// What the last look into the flash found.
    pub fn found(&self) -> Found {
        self.found
    }

    /// The value of a record.
    pub fn get(&self, key: Key) -> Option<&[u8]> {
        let (_, value) = records(self.table()).find(|(found, _)| *found == key)?;
        Some(value)
    }

    /// Keeps a record, in place of the one under the same key. When this returns, it is in the flash. An empty value is no record.
    ///
    /// # Errors
    /// Why it is not kept.
    pub fn put(&mut self, key: Key, value: &[u8]) -> Result<(), PutError> {
        if value.len() > MAX_VALUE_BYTES {
            return Err(PutError::TooLong);
        }
        if self.get(key).unwrap_or_default() == value {
            return Ok(());
        }
        let taken = match self.get(key) {
            Some(before) => HEAD_BYTES + before.len(),
            None => 0,
        };
        let needed = match value.len() {
            0 => 0,
            len => HEAD_BYTES + len,
        };
        let capacity = self.room.len();
        if self.len - taken + needed > capacity {
            return Err(PutError::Full { capacity });
        }
        self.remove(key);
        self.append(key, value);
        if self.write().is_none() {
            if !planted!(RecordKeptInMemoryOnly) {
                self.load();
            }
            return Err(PutError::Flash);
        }
        self.found = Found::Table;
        Ok(())
    }

    /// Reads what belongs to the robot's key, as [`KeySafe::read`](crate::link::key_safe::KeySafe::read) does.
    ///
    /// # Errors
    /// [`NotKept`]: there is damage, or the record has no room.
    pub fn read_of_key(&self, record: KeyRecord, room: &mut [u8]) -> Result<usize, NotKept> {
        if self.found == Found::Damage {
            return Err(NotKept);
        }
        let kept = self.get(record.into()).unwrap_or_default();
        room.get_mut(..kept.len())
            .ok_or(NotKept)?
            .copy_from_slice(kept);
        Ok(kept.len())
    }

    /// Keeps what belongs to the robot's key, as [`KeySafe::write`](crate::link::key_safe::KeySafe::write) does.
    ///
    /// # Errors
    /// [`NotKept`]: there is damage, or the flash did not take it.
    pub fn write_of_key(&mut self, record: KeyRecord, bytes: &[u8]) -> Result<(), NotKept> {
        // A new table in the place of a damaged one would have no key.
        if self.found == Found::Damage {
            return Err(NotKept);
        }
        self.put(record.into(), bytes).map_err(|_| NotKept)
    }

    fn table(&self) -> &[u8] {
        self.room.get(..self.len).unwrap_or_default()
    }

    /// Takes a record out of the table, if it is there.
    fn remove(&mut self, key: Key) {
        let mut at = 0;
        let found = records(self.table()).find_map(|(found, value)| {
            let place = at..at + HEAD_BYTES + value.len();
            at = place.end;
            (found == key).then_some(place)
        });
        if let Some(place) = found
            && !planted!(RecordTwice)
        {
            // Byte by byte: the library's routine for what overlaps takes a kilobyte and a half of flash.
            for (to, from) in (place.start..).zip(place.end..self.len) {
                let byte = self.room.get(from).copied();
                if let (Some(byte), Some(to)) = (byte, self.room.get_mut(to)) {
                    *to = byte;
                }
            }
            self.len -= place.len();
        }
    }

    /// Puts a record behind the others, for which there is room.
    fn append(&mut self, key: Key, value: &[u8]) {
        if value.is_empty() {
            return;
        }
        let head = [key.0, value.len() as u8];
        let places = self.room.iter_mut().skip(self.len);
        for (place, byte) in places.zip(head.iter().chain(value)) {
            *place = *byte;
        }
        self.len += HEAD_BYTES + value.len();
    }

    /// Writes the table, and makes it the one that counts.
    fn write(&mut self) -> Option<()> {
        let table = self.room.get(..self.len)?;
        // A table without records has a byte all the same, for no mission is empty either.
        let bytes = if table.is_empty() { &NO_RECORDS } else { table };
        let crc = esm_core::format::crc32(bytes);
        self.store.begin(bytes.len() as u32, crc).ok()?;
        self.store.append(0, bytes).ok()?;
        self.store.finish().ok()?;
        self.store.begin_trial().ok()?;
        if planted!(RecordUnconfirmed) {
            return Some(());
        }
        self.store.confirm().ok()
    }

    /// Reads the table that counts, and settles that it does: where its writing was cut, it might read well today and not tomorrow.
    fn load(&mut self) {
        // A table that was never confirmed, and cannot be now, gives way to the other.
        for _ in 0..2 {
            let choice = self.store.choose(self.room, is_table);
            let Some(chosen) = choice.mission else {
                self.len = 0;
                self.found = Found::Damage;
                // From the first start on there is a table. So where the writing of another was cut, it is known what was before.
                if choice.slots.contains(&SlotState::Empty) {
                    self.found = Found::Nothing;
                    if !planted!(RecordsUnformatted) {
                        let _ = self.write();
                    }
                }
                return;
            };
            let len = chosen.len as usize;
            let bytes = self.room.get(..len).unwrap_or_default();
            self.len = if *bytes == NO_RECORDS { 0 } else { len };
            self.found = Found::Table;
            if planted!(RecordUnsettled) || self.store.confirm().is_ok() {
                // A table whose writing was cut does not count today, and might tomorrow.
                let other = chosen.slot.other().of(choice.slots);
                let is_settled = matches!(
                    other,
                    SlotState::Empty | SlotState::Spare | SlotState::BrokenHeader
                );
                if !is_settled && !planted!(CutRecordUnsettled) {
                    let _ = self.write();
                }
                return;
            }
        }
    }
}

/// The table without records.
const NO_RECORDS: [u8; 1] = [0];

/// Whether these bytes are a table.
fn is_table(bytes: &[u8]) -> bool {
    let known: usize = records(bytes)
        .map(|(_, value)| HEAD_BYTES + value.len())
        .sum();
    known == bytes.len() || *bytes == NO_RECORDS
}

/// The records of a table, up to where it is none.
fn records(table: &[u8]) -> impl Iterator<Item = (Key, &[u8])> {
    let mut rest = table;
    core::iter::from_fn(move || {
        let ([key, len], behind) = rest.split_first_chunk()?;
        let (value, behind) = behind.split_at_checked(usize::from(*len))?;
        rest = behind;
        Some((Key(*key), value))
    })
}
