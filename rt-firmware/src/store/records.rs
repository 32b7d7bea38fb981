//! Small records that survive a loss of power: saved parameters, the counter of signed uploads, the key that is installed.
//!
//! A record is up to [`MAX_VALUE_BYTES`] under a number, its key. All of them together are one table, which stands in RAM, where [`get`](Records::get) finds a
//! record without a look at the flash, and in two areas of the flash, which are [slots](super) as those of missions are. [`put`](Records::put) writes the
//! whole table, with the new record in it, to the area that is not in use, and confirms it there; then to the other, in the same way. So all that is promised of missions holds: a record that was
//! acknowledged is not lost, one whose writing was cut is there with its new value or with its old one, from the next [`open`](Records::open) on always the same, and
//! records are whole or not there.
//!
//! # Damage
//! What was acknowledged is there twice: bits of one area that change by themselves, or that cannot be read, lose nothing, and the next `open` writes the table anew there. Only where
//! the writing of a table was cut, or failed, there is one of it until the next `open`. Damage of that one is [`Found::Damage`]: the records are not known, and what is in the flash stays as it is. A flash that never
//! had a table is told from that by the words of a slot that come after its header, of which no first content of a chip has two.
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
//! A `put` erases both areas, one after the other, and writes to each the table and seven blocks; one that changes nothing costs nothing. It waits for the flash: to be
//! called from the link's context, never from a slot's. An `open` writes the table once after a `put` that was cut and after damage, and else nothing. A flash that
//! lasts 10,000 erases lasts 10,000 puts.
//!
//! # Limits
//! The table has as many bytes as the room that [`open`](Records::open) is given, or as an area has behind its head, whichever is less; a record takes two bytes
//! more than its value. Where the writing of a table was cut before it was confirmed, damage of the new one brings back the one before; and so does damage in its head, as long as there is one of it: that `put` was not
//! acknowledged. One area of which nothing can be read, beside one whose writing was cut, is what a cut first writing leaves: a start takes it for a flash without records.

use embedded_storage::nor_flash::NorFlash;

use super::layout::{HEADED, HEADED_AT, SEALED, SEALED_AT};
use super::{Choice, Layout, LayoutError, Slot, SlotState, Store};
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

/// Why a record was not kept. The one before is still there, if there was one; after [`Flash`](PutError::Flash) it may be the new one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PutError {
    /// A value has at most [`MAX_VALUE_BYTES`].
    TooLong,
    /// The table has no room for it.
    Full {
        /// Bytes that the table has for records.
        capacity: usize,
    },
    /// The flash did not take it, or not twice.
    Flash,
    /// There is [damage](Found::Damage): a new table in the place of the damaged one would lack its records.
    Damaged,
}

/// What a start found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing was ever kept.
    Nothing,
    /// A table.
    Table,
    /// There was a table, and it is not whole, or cannot be read. A robot must not take this for one that never had records. Nothing is kept until the flash is erased, or
    /// reads well.
    Damage,
}

/// The records, and the flash that keeps them.
pub struct Records<'m, F> {
    store: Store<F>,
    /// The table is the first `len` bytes: records, each its key, its length, and its value. No key is there twice.
    room: &'m mut [u8],
    len: usize,
    found: Found,
    /// Both areas have the table.
    is_twice: bool,
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
            is_twice: false,
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
        if self.found == Found::Damage {
            return Err(PutError::Damaged);
        }
        let is_settled = self.is_twice || self.found == Found::Nothing;
        if self.get(key).unwrap_or_default() == value && is_settled {
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
        // At first one without records, so that it is known what was before where the writing of the next is cut.
        if self.store.running_slot().is_none() && !planted!(RecordsUnformatted) {
            self.write().ok_or(PutError::Flash)?;
        }
        self.remove(key);
        self.append(key, value);
        self.is_twice = self.write_twice();
        if self.is_twice {
            self.found = Found::Table;
            return Ok(());
        }
        if planted!(RecordKeptInMemoryOnly) {
            return Err(PutError::Flash);
        }
        let had_table = self.found == Found::Table;
        self.load();
        if had_table && self.found == Found::Nothing {
            // It was there: what cannot be read any more is not what never was.
            self.found = Found::Damage;
        }
        // What the flash did not take at once, it may have taken now.
        if self.is_twice && self.get(key).unwrap_or_default() == value {
            return Ok(());
        }
        Err(PutError::Flash)
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

    /// Writes the table to one area and then to the other.
    fn write_twice(&mut self) -> bool {
        self.write().is_some() && (planted!(RecordOnce) || self.write().is_some())
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
        if self.store.confirm().is_err() {
            // So that the next table can go the same way.
            self.store.fall_back();
            return None;
        }
        Some(())
    }

    /// Reads the table that counts, and sees to it that both areas have it. Where its writing was cut it is confirmed before, for it might read well today and not tomorrow.
    fn load(&mut self) {
        // What reads badly is looked at twice. And a table that was never confirmed, and cannot be now, gives way to the other.
        for look in 0..LOOKS {
            self.len = 0;
            self.found = Found::Damage;
            self.is_twice = false;
            let Choice { mission, slots } = self.store.choose(self.room, is_table);
            let Some(chosen) = mission else {
                if look < LOOKS - 1 {
                    continue;
                }
                let signs = self.signs_of_table(Slot::A) + self.signs_of_table(Slot::B);
                let is_taken_for_new =
                    planted!(EmptyTakenForNew) && slots.contains(&SlotState::Empty);
                if signs < CERTAIN || is_taken_for_new {
                    self.found = Found::Nothing;
                }
                return;
            };
            let other = chosen.slot.other();
            let state = other.of(slots);
            let [header, of_other] = [chosen.slot, other].map(|slot| self.store.head(slot));
            let Ok(header) = header.header else {
                continue;
            };
            let (copy, is_confirmed) = (of_other.header, of_other.confirmed_rank().is_some());
            let is_same = copy.is_ok_and(|copy| (copy.len, copy.crc) == (header.len, header.crc));
            self.is_twice = is_same
                && state == SlotState::Spare
                && self.store.payload_crc(other, header.len, &mut []) == Some(header.crc);
            if look == 0 && !self.is_twice && !chosen.on_trial {
                continue;
            }
            // What was looked at before the one that was chosen is newer.
            let is_newer_damaged = match state {
                SlotState::OtherFormat | SlotState::TooLong => true,
                // What was not confirmed was not acknowledged either.
                SlotState::BrokenPayload => is_confirmed && !is_same,
                SlotState::NoRoom { .. } | SlotState::Refused | SlotState::Unreadable => {
                    copy.is_ok() && !is_same
                }
                _ => false,
            };
            if is_newer_damaged && !planted!(DamageGivesWay) {
                return;
            }
            let len = chosen.len as usize;
            let bytes = self.room.get(..len).unwrap_or_default();
            self.len = if *bytes == NO_RECORDS { 0 } else { len };
            self.found = Found::Table;
            if self.is_twice && !chosen.on_trial {
                return;
            }
            if planted!(RecordUnsettled) || self.store.confirm().is_ok() {
                if !self.is_twice && !planted!(CutRecordUnsettled) {
                    self.is_twice = self.write().is_some();
                }
                return;
            }
        }
    }

    /// Whether an area without a table that counts had one: [`CERTAIN`] if it had, half of that if it cannot be read.
    fn signs_of_table(&mut self, slot: Slot) -> u8 {
        let head = self.store.head(slot);
        match head.header {
            // With a table that has no records nothing is lost: the first one of all may have been cut.
            Ok(header) if head.is_sealed && header.len as usize > NO_RECORDS.len() => CERTAIN,
            Ok(_) => 0,
            Err(SlotState::OtherFormat | SlotState::TooLong) => CERTAIN,
            // No cut of a first table leaves these words without the header, and no chip comes with both.
            Err(_) => {
                let words = [HEADED_AT, SEALED_AT].map(|at| self.store.read(slot, at));
                match words {
                    [Some(HEADED), Some(SEALED)] => CERTAIN,
                    [Some(_), Some(_)] => 0,
                    _ => CERTAIN / 2,
                }
            }
        }
    }
}

/// How often areas are looked at that do not both have a table.
const LOOKS: usize = 3;

/// As many signs of a table leave no doubt.
const CERTAIN: u8 = 2;

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
