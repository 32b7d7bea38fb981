//! Small records that survive a loss of power: saved parameters, the counter of signed uploads, the
//! key that is installed.
//!
//! A record is up to [`MAX_VALUE_BYTES`] under a number, its key. All of them together are one
//! table, which stands in RAM, where [`get`](KeyValues::get) finds a record without a look at the
//! flash, and in two areas of the flash, which are [slots](super) as those of missions are.
//! [`put`](KeyValues::put) writes the whole table, with the new record in it, to the area that is
//! not in use, and confirms it there; then to the other, in the same way. So all that is promised
//! of missions holds: a record that was acknowledged is not lost, one whose writing was cut is
//! there with its new value or with its old one, from the next [`open`](KeyValues::open) on always
//! the same, and records are whole or not there.
//!
//! # Damage
//! What was acknowledged is there twice: bits of one area that change by themselves, or that cannot
//! be read, lose nothing, and the next `open` writes the table anew there. Only where the writing
//! of a table was cut, or failed, there is one of it until the next `open`. Damage of that one
//! is [`Found::Damage`]: the records are not known, and what is in the flash stays as it is until
//! they are [renewed](KeyValues::renew).
//!
//! That there were records is kept apart from them, in a journal behind the areas, in erase units
//! of its own: each [`put`](KeyValues::put) adds an entry, which has the sequence number that both
//! areas have at least, and a copy of the robot's key. So neither areas that are damaged beyond
//! what a header tells, nor an old one that was put back beside an erased one, are taken for a
//! robot without a key, or for one that was not stopped. Only a flash that is blank, or whose first
//! `put` of all was cut, is one that [never had records](Found::Nothing): a chip that comes with
//! anything in it is to be erased first.
//!
//! ```
//! # use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
//! # struct Chip([u8; 6144]);
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
//! # let flash = Chip([0xFF; 6144]);
//! use rt_firmware::store::{Layout, key_values::{Key, KeyValues}};
//!
//! let mut room = [0; 512];
//! // Two areas of 2 KiB each from the byte 0 of the flash on, and the journal behind them.
//! let mut records = KeyValues::open(flash, Layout::new(0, 2048), &mut room)?;
//! assert_eq!(records.get(Key(7)), None);
//! records.put(Key(7), b"seven").expect("the flash takes it");
//! assert_eq!(records.get(Key(7)), Some(&b"seven"[..]));
//! # Ok::<(), rt_firmware::store::LayoutError>(())
//! ```
//!
//! # Costs
//! A `put` erases both areas, one after the other, and writes to each the table and seven blocks,
//! and six blocks to the journal, of which each fifth `put` erases a half; one that changes nothing
//! costs nothing. It waits for the flash: to be called from the link's context, never from a
//! slot's. An `open` reads all of it, and writes the table once after a `put` that was cut and
//! after damage, and else nothing. A flash that lasts 10,000 erases lasts 10,000 puts.
//!
//! # Limits
//! The table has as many bytes as the room that [`open`](KeyValues::open) is given, or as an area
//! has behind its head, whichever is less; a record takes two bytes more than its value. Where the
//! writing of a table was cut before it was confirmed, damage of the new one brings back the one
//! before; and so does damage in its head, as long as there is one of it: that `put` was not
//! acknowledged. Who puts back all of the flash as it was, areas and journal, is not noticed.

use embedded_storage::nor_flash::NorFlash;

use esm_link::message::{BankState, KeyValuesState, WayIn};

use super::journal::{self, Journal, KeyCopy, WORN_BITS};
use super::layout::is_newer;
use super::{Choice, FlashBank, Layout, LayoutError, Store};
use esm_link::key_store::{NotStored, StoredKey};

/// The longest value of a record, in bytes.
pub const MAX_VALUE_BYTES: usize = 64;

/// Bytes of a record before its value: its key and its length.
const HEADER_BYTES: usize = 2;

/// Which record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Key(pub u8);

impl Key {
    /// The key of the robot.
    const OWNER: Key = Key(1);
    /// Says, with any value, that an emergency stop is latched.
    pub(crate) const EMERGENCY_STOP: Key = Key(5);
    /// Says, with any value, that the firmware's own mission is not to run: the robot waits for a
    /// host.
    pub(crate) const WAITS: Key = Key(6);
}

impl From<StoredKey> for Key {
    fn from(record: StoredKey) -> Self {
        Key(match record {
            StoredKey::Key => return Key::OWNER,
            StoredKey::Counter => 2,
            StoredKey::Starts => 3,
        })
    }
}

/// Why a record was not kept. The one before is still there, if there was one; after
/// [`Flash`](PutError::Flash) it may be the new one.
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
    /// There is [damage](Found::Damage): a new table in the place of the damaged one would lack its
    /// records.
    Damaged,
}

/// What a start found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// Nothing was ever kept.
    Nothing,
    /// A table.
    Table,
    /// There was a table, and it is not whole, or cannot be read, or is an old one. A robot must
    /// not take this for one that never had records. Nothing is kept until the records are
    /// [renewed](KeyValues::renew), the flash is erased, or reads well.
    Damage,
}

/// The records, and the flash that keeps them.
pub struct KeyValues<'m, F> {
    store: Store<F>,
    journal: Journal,
    /// The table is the first `len` bytes: records, each its key, its length, and its value. No key
    /// is there twice.
    room: &'m mut [u8],
    len: usize,
    found: Found,
    /// The table that was found is not the last that was kept.
    is_old: bool,
    /// Both areas have the table.
    is_twice: bool,
    /// The journal knows of it.
    is_entered: bool,
    /// Places that were neither blank nor whole at the start.
    flaws: u32,
}

impl<'m, F: NorFlash> KeyValues<'m, F> {
    /// Reads the table into `room`.
    ///
    /// # Errors
    /// The areas (the slots of the layout) do not fit the flash.
    pub fn open(flash: F, layout: Layout, room: &'m mut [u8]) -> Result<Self, LayoutError> {
        let capacity = room.len().min(layout.payload_capacity() as usize);
        let room = room.get_mut(..capacity).unwrap_or_default();
        let (_, journal_at) = layout.bounds(FlashBank::B);
        let flash_bytes = flash.capacity();
        let mut store = Store::new(flash, layout)?;
        let erase_bytes = F::ERASE_SIZE as u32;
        let journal_end = u64::from(journal_at) + u64::from(journal::bytes(erase_bytes));
        if journal_end > flash_bytes as u64 {
            return Err(LayoutError::BeyondFlash { flash_bytes });
        }
        let mut journal = Journal::new(journal_at, erase_bytes);
        journal.scan(&mut store.flash);
        let _ = store.choose(&mut [], |_| false);
        let flaws = store.flaws(FlashBank::A) + store.flaws(FlashBank::B) + journal.flaws();
        let mut records = KeyValues {
            store,
            journal,
            room,
            len: 0,
            found: Found::Nothing,
            is_old: false,
            is_twice: false,
            is_entered: false,
            flaws,
        };
        let erases = records.erases();
        records.load();
        // An area that is another than the other is told, too.
        if records.erases() != erases {
            records.flaws = records.flaws.max(1);
        }
        Ok(records)
    }

    /// What the last look into the flash found.
    pub fn found(&self) -> Found {
        self.found
    }

    /// How they are, for people.
    pub fn state(&mut self) -> KeyValuesState {
        match self.found {
            Found::Nothing => KeyValuesState::New,
            Found::Table if self.is_twice => KeyValuesState::Whole,
            Found::Table => KeyValuesState::Once,
            Found::Damage => {
                let way_in = match self.remembered().as_ref().map(KeyCopy::record) {
                    None | Some(None) => WayIn::Erase,
                    Some(Some([])) => WayIn::NoKey,
                    Some(Some(_)) => WayIn::Key,
                };
                if self.is_old {
                    KeyValuesState::Older(way_in)
                } else {
                    KeyValuesState::Unreadable(way_in)
                }
            }
        }
    }

    /// Places of the flash that were neither blank nor whole at the start: bits that have changed,
    /// or what a loss of power has left.
    pub fn flaws(&self) -> u32 {
        self.flaws
    }

    /// How often an area was erased, both counted together.
    pub fn erases(&self) -> u32 {
        self.store.erases()
    }

    /// The value of a record.
    pub fn get(&self, key: Key) -> Option<&[u8]> {
        match self.found {
            Found::Damage => None,
            Found::Nothing | Found::Table => self.find(key),
        }
    }

    /// The value of a record of the table that was read.
    fn find(&self, key: Key) -> Option<&[u8]> {
        let (_, value) = records(self.table()).find(|(found, _)| *found == key)?;
        Some(value)
    }

    /// Whether a record is kept already, so that keeping it costs nothing.
    pub fn is_kept(&self, key: Key, value: &[u8]) -> bool {
        let is_settled = match self.found {
            Found::Nothing => true,
            Found::Table => self.is_twice && self.is_entered,
            Found::Damage => false,
        };
        is_settled && self.get(key).unwrap_or_default() == value
    }

    /// Keeps a record, in place of the one under the same key. When this returns, it is in the
    /// flash. An empty value is no record.
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
        if self.is_kept(key, value) {
            return Ok(());
        }
        let taken = match self.get(key) {
            Some(before) => HEADER_BYTES + before.len(),
            None => 0,
        };
        let needed = match value.len() {
            0 => 0,
            len => HEADER_BYTES + len,
        };
        let capacity = self.room.len();
        if self.len - taken + needed > capacity {
            return Err(PutError::Full { capacity });
        }
        // Before anything else is in the flash, the journal says that what comes is the first.
        if self.found == Found::Nothing && !self.begin_journal() {
            return Err(PutError::Flash);
        }
        // Then a table without records, so that it is known what was before where the writing of
        // the next is cut.
        if self.store.running_slot().is_none() {
            self.write().ok_or(PutError::Flash)?;
        }
        self.remove(key);
        self.append(key, value);
        self.is_twice = self.write_twice();
        if self.is_twice && self.enter() {
            self.found = Found::Table;
            return Ok(());
        }
        let had_table = self.found == Found::Table;
        self.load();
        if had_table && self.found == Found::Nothing {
            // It was there: what cannot be read any more is not what never was.
            self.found = Found::Damage;
        }
        // What the flash did not take at once, it may have taken now.
        if self.found == Found::Table && self.is_kept(key, value) {
            return Ok(());
        }
        Err(PutError::Flash)
    }

    /// Writes the records anew where there is damage: this key, and an emergency stop that is
    /// latched; nothing else is known. The owner of the key that is
    /// [remembered](KeyValues::remembered_key) has asked for it.
    ///
    /// # Errors
    /// Why that is not done. Unless the flash has taken it all the same, there is still damage.
    pub fn renew(&mut self, key: &[u8]) -> Result<(), PutError> {
        if self.found != Found::Damage {
            return self.put(Key::OWNER, key);
        }
        if key.len() > MAX_VALUE_BYTES {
            return Err(PutError::TooLong);
        }
        self.len = 0;
        self.append(Key::OWNER, key);
        self.append(Key::EMERGENCY_STOP, &[1]);
        // What is there does not count, and what comes is newer than all that was acknowledged.
        self.store.stay_beyond(self.journal.floor());
        let room = &mut [];
        self.store.choose(room, |_| false);
        self.is_twice = self.write_twice();
        if self.is_twice && self.enter() {
            self.found = Found::Table;
            self.is_old = false;
            return Ok(());
        }
        self.load();
        if self.found == Found::Nothing {
            self.found = Found::Damage;
        }
        match self.found {
            Found::Table if self.is_kept(Key::OWNER, key) => Ok(()),
            _ => Err(PutError::Flash),
        }
    }

    /// Reads the key record that was kept last into the beginning of `room`, where there is
    /// [damage](Found::Damage); as
    /// [`KeyStore::remembered_key`](esm_link::key_store::KeyStore::remembered_key) does. 0 is for a
    /// robot that had none for certain.
    ///
    /// # Errors
    /// [`NotStored`]: it is not known, or has no room.
    pub fn remembered_key(&mut self, room: &mut [u8]) -> Result<usize, NotStored> {
        let key = self.remembered().ok_or(NotStored)?;
        let record = key.record().ok_or(NotStored)?;
        room.get_mut(..record.len())
            .ok_or(NotStored)?
            .copy_from_slice(record);
        Ok(record.len())
    }

    fn remembered(&mut self) -> Option<KeyCopy> {
        // Not that of a table, which may be an old one: it may have been that of an earlier owner.
        self.journal.key(&mut self.store.flash)
    }

    /// Lets the journal say that what comes is the first table of all.
    fn begin_journal(&mut self) -> bool {
        self.journal.says(None, &KeyCopy::NONE)
            || (self.journal).append(&mut self.store.flash, None, KeyCopy::NONE)
    }

    /// The key of the table, for the journal.
    fn key(&self) -> KeyCopy {
        KeyCopy::new(self.find(Key::OWNER).unwrap_or_default())
    }

    /// The lesser of the sequence numbers of both areas.
    fn least_seq(&mut self) -> Option<u32> {
        let [a, b] = [FlashBank::A, FlashBank::B].map(|slot| self.store.seq(slot));
        let (a, b) = (a?, b?);
        Some(if is_newer(a, b) { b } else { a })
    }

    /// Lets the journal know of the table that both areas have now.
    fn enter(&mut self) -> bool {
        self.is_entered = false;
        let Some(floor) = self.least_seq() else {
            return false;
        };
        let (floor, key) = (Some(floor), self.key());
        // The table before the first record may be there by words that were cut, in both areas:
        // should it go again, nothing was lost.
        let is_before_first = self.len == 0 && self.journal.floor().is_none();
        self.is_entered = is_before_first
            || self.journal.says(floor, &key)
            || self.journal.append(&mut self.store.flash, floor, key);
        self.is_entered
    }

    /// Reads what belongs to the robot's key, as
    /// [`KeyStore::read`](esm_link::key_store::KeyStore::read) does.
    ///
    /// # Errors
    /// [`NotStored`]: there is damage, or the record has no room.
    pub fn read_of_key(&self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        if self.found == Found::Damage {
            return Err(NotStored);
        }
        let kept = self.get(record.into()).unwrap_or_default();
        room.get_mut(..kept.len())
            .ok_or(NotStored)?
            .copy_from_slice(kept);
        Ok(kept.len())
    }

    /// Keeps what belongs to the robot's key, as
    /// [`KeyStore::write`](esm_link::key_store::KeyStore::write) does.
    ///
    /// # Errors
    /// [`NotStored`]: there is damage, or the flash did not take it.
    pub fn write_of_key(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), NotStored> {
        self.put(record.into(), bytes).map_err(|_| NotStored)
    }

    fn table(&self) -> &[u8] {
        self.room.get(..self.len).unwrap_or_default()
    }

    /// Takes a record out of the table, if it is there.
    fn remove(&mut self, key: Key) {
        let mut at = 0;
        let found = records(self.table()).find_map(|(found, value)| {
            let place = at..at + HEADER_BYTES + value.len();
            at = place.end;
            (found == key).then_some(place)
        });
        if let Some(place) = found {
            // Byte by byte: the library's routine for what overlaps takes a kilobyte and a half of
            // flash.
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
        self.len += HEADER_BYTES + value.len();
    }

    /// Writes the table to one area and then to the other.
    fn write_twice(&mut self) -> bool {
        self.write().is_some() && self.write().is_some()
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
        if self.store.confirm().is_err() {
            // So that the next table can go the same way.
            self.store.fall_back();
            return None;
        }
        Some(())
    }

    /// Reads the table that counts, holds it against the journal, and sees to it that both areas
    /// have it, and the journal knows of it.
    fn load(&mut self) {
        self.journal.scan(&mut self.store.flash);
        self.is_entered = false;
        self.is_old = false;
        self.load_table();
        if self.found == Found::Table && self.is_twice {
            // What an entry that was cut said is said once more.
            self.enter();
        }
    }

    /// Reads the table that counts, and sees to it that both areas have it. Where its writing was
    /// cut it is confirmed before, for it might read well today and not tomorrow.
    fn load_table(&mut self) {
        // What reads badly is looked at twice. And a table that was never confirmed, and cannot be
        // now, gives way to the other.
        for look in 0..LOOKS {
            self.len = 0;
            self.found = Found::Damage;
            self.is_twice = false;
            let Choice { mission, slots } = self.store.choose(self.room, is_table);
            let Some(chosen) = mission else {
                if look < LOOKS - 1 {
                    continue;
                }
                if self.is_new() {
                    self.found = Found::Nothing;
                }
                return;
            };
            let len = chosen.len as usize;
            let bytes = self.room.get(..len).unwrap_or_default();
            let table_len = if *bytes == NO_RECORDS { 0 } else { len };
            // Before the first table there is an entry. So one without is no beginning.
            let is_proven = self.journal.has_entry();
            let is_old = !is_proven
                || (self.journal.floor()).is_some_and(|floor| is_newer(floor, chosen.seq));
            if is_old {
                self.is_old = look == LOOKS - 1;
                continue;
            }
            let other = chosen.slot.other();
            let state = other.of(slots);
            let [header, of_other] = [chosen.slot, other].map(|slot| self.store.head(slot));
            let Ok(header) = header.header else {
                continue;
            };
            let (copy, is_confirmed) = (of_other.header, of_other.confirmed_rank().is_some());
            let is_same = copy.is_ok_and(|copy| (copy.len, copy.crc) == (header.len, header.crc));
            self.is_twice = is_same
                && state == BankState::Spare
                && self.store.payload_crc(other, header.len, &mut []) == Some(header.crc);
            if look == 0 && !self.is_twice && !chosen.on_trial {
                continue;
            }
            // What was looked at before the one that was chosen is newer.
            let is_newer_damaged = match state {
                BankState::OtherFormat | BankState::TooLong => true,
                // What was not confirmed was not acknowledged either.
                BankState::BrokenPayload => is_confirmed && !is_same,
                BankState::NoRoom { .. } | BankState::Refused | BankState::Unreadable => {
                    copy.is_ok() && !is_same
                }
                _ => false,
            };
            if is_newer_damaged {
                return;
            }
            self.len = table_len;
            self.found = Found::Table;
            if self.is_twice && !chosen.on_trial {
                return;
            }
            if self.store.confirm().is_ok() {
                if !self.is_twice {
                    self.is_twice = self.write().is_some();
                }
                return;
            }
        }
    }

    /// Whether a flash without a table never had one: it is blank, or the journal says that the
    /// first of all was about to be written.
    fn is_new(&mut self) -> bool {
        !self.journal.is_marked() && (self.journal.has_entry() || self.store.zeros() <= WORN_BITS)
    }
}

/// How often areas are looked at that do not both have a table.
const LOOKS: usize = 3;

/// The table without records.
const NO_RECORDS: [u8; 1] = [0];

/// Whether these bytes are a table.
fn is_table(bytes: &[u8]) -> bool {
    let known: usize = records(bytes)
        .map(|(_, value)| HEADER_BYTES + value.len())
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
