//! The journal of the records: what says that a robot has records although none of them can be
//! read.
//!
//! It lies behind the two areas of the [records](super::key_values), in erase units of its own, in
//! two halves. An entry is added each time that records are kept, behind all that were there, and
//! is never changed. Only when a half is full the other one is erased, never the one with the
//! newest entry. So from the first record on there is always an entry.
//!
//! # An entry
//! An entry is there twice, one copy behind the other; the second is begun when the first was read
//! back. So a pair whose second copy is blank was cut, and one of which neither copy is whole was
//! damaged. A copy is [`COPY_BYTES`], little endian:
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 4 | `esmJ` |
//! | 4 | 4 | number: that of the entry before and one |
//! | 8 | 4 | floor: the least sequence number that an area with all that was acknowledged has |
//! | 12 | 1 | 0x69 for the entry before the first table, which has no floor; 0x96 for each other |
//! | 13 | 1 | length of the key record; 0 where there is no key, 0xFF for one that is longer than its place |
//! | 14 | 2 | 0 |
//! | 16 | 64 | the key record |
//! | | 4 | at the end: CRC-32 of all before |
//!
//! A checksum of 32 bits finds each pattern of up to four wrong bits in so few bytes. What is read
//! as blank may have up to [`WORN_BITS`] zeros; an entry has many times as many, whatever is in it.
//!
//! # What it proves
//! An area whose sequence number is below the floor is older than what was acknowledged last. A
//! journal in which more was written than the entry before the first table says that there were
//! records. What it cannot tell is a flash that was put back as it was, journal and all.

use embedded_storage::nor_flash::NorFlash;

use super::layout::{BLANK, BLOCK_BYTES, is_newer};
use esm_link::key_store::STORED_KEY_BYTES;

/// `esmJ`
const MAGIC: u32 = 0x4A6D_7365;
/// Kinds of entries.
const BEGUN: u8 = 0x69;
const KEPT: u8 = 0x96;
/// Where the key is in a copy.
const KEY_AT: usize = 16;
/// Bytes of one copy of an entry.
pub(super) const COPY_BYTES: usize =
    (KEY_AT + STORED_KEY_BYTES + size_of::<u32>()).next_multiple_of(BLOCK_BYTES);
const PAIR_BYTES: u32 = COPIES * COPY_BYTES as u32;
/// How often an entry is there.
const COPIES: u32 = 2;
/// Bytes of a half, where the flash does not erase more at once.
const HALF_BYTES: u32 = 1024;
/// Stands for the length of a key that has no room.
const TOO_LONG: u8 = 0xFF;
const _: () = assert!(STORED_KEY_BYTES < TOO_LONG as usize);

/// As many zeros in a place that was never written are bits that changed by themselves.
pub(super) const WORN_BITS: u32 = 8;

/// Bytes of flash that a journal takes, where `erase_bytes` are erased at once.
pub(super) const fn bytes(erase_bytes: u32) -> u32 {
    2 * HALF_BYTES.next_multiple_of(erase_bytes)
}

type CopyBytes = [u8; COPY_BYTES];

/// The key record of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct KeyCopy {
    bytes: [u8; STORED_KEY_BYTES],
    len: u8,
}

impl KeyCopy {
    pub(super) const NONE: KeyCopy = KeyCopy {
        bytes: [0; STORED_KEY_BYTES],
        len: 0,
    };

    pub(super) fn new(record: &[u8]) -> Self {
        let mut copy = KeyCopy {
            len: TOO_LONG,
            ..Self::NONE
        };
        if let Some(place) = copy.bytes.get_mut(..record.len()) {
            place.copy_from_slice(record);
            copy.len = record.len() as u8;
        }
        copy
    }

    /// The record, where it had room.
    pub(super) fn record(&self) -> Option<&[u8]> {
        self.bytes.get(..usize::from(self.len))
    }
}

/// What an entry says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    number: u32,
    floor: Option<u32>,
    key: KeyCopy,
}

impl Entry {
    fn encode(&self) -> CopyBytes {
        let mut bytes = [0; COPY_BYTES];
        let words = [MAGIC, self.number, self.floor.unwrap_or_default()];
        for (place, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        let kind = if self.floor.is_some() { KEPT } else { BEGUN };
        let rest = [kind, self.key.len, 0, 0];
        let rest = rest.iter().chain(&self.key.bytes);
        let places = bytes.iter_mut().skip(KEY_AT - 4);
        for (place, byte) in places.zip(rest) {
            *place = *byte;
        }
        let crc = checksum(&bytes);
        if let Some(place) = bytes.last_chunk_mut() {
            *place = crc.to_le_bytes();
        }
        bytes
    }

    fn decode(bytes: &CopyBytes) -> Option<Self> {
        let crc = u32::from_le_bytes(*bytes.last_chunk()?);
        if crc != checksum(bytes) {
            return None;
        }
        let [magic, number, floor, rest] =
            [0, 1, 2, 3].map(|at| bytes.as_chunks().0.get(at).copied().unwrap_or_default());
        if u32::from_le_bytes(magic) != MAGIC {
            return None;
        }
        let floor = match rest[0] {
            BEGUN => None,
            KEPT => Some(u32::from_le_bytes(floor)),
            _ => return None,
        };
        let mut key = KeyCopy {
            len: rest[1],
            ..KeyCopy::NONE
        };
        if usize::from(key.len) > STORED_KEY_BYTES && key.len != TOO_LONG {
            return None;
        }
        for (place, byte) in key.bytes.iter_mut().zip(bytes.iter().skip(KEY_AT)) {
            *place = *byte;
        }
        let number = u32::from_le_bytes(number);
        Some(Entry { number, floor, key })
    }
}

/// Checksum of all bytes of a copy but those of the checksum.
fn checksum(bytes: &CopyBytes) -> u32 {
    let covered = bytes.get(..COPY_BYTES - size_of::<u32>());
    covered.map_or(0, esm_core::format::crc32)
}

/// What is in the place of a copy.
enum Copy {
    Blank,
    /// Blank but for some bits.
    Worn,
    Whole(Entry),
    /// A part of a copy, or a damaged one, or whatever a chip came with.
    Broken,
}

impl Copy {
    fn whole(&self) -> Option<&Entry> {
        match self {
            Copy::Whole(entry) => Some(entry),
            _ => None,
        }
    }

    fn is_broken(&self) -> bool {
        matches!(self, Copy::Broken)
    }
}

/// The newest entry.
#[derive(Clone, Copy)]
struct Last {
    entry: Entry,
    /// Which pair it is, counted over both halves.
    place: u32,
    /// Both copies are whole: so its writing came to an end.
    is_certain: bool,
}

/// The journal, as it was last read.
pub(super) struct Journal {
    start: u32,
    half_bytes: u32,
    last: Option<Last>,
    /// There were records, or something that is no part of a journal's beginning.
    is_marked: bool,
    flaws: u32,
}

impl Journal {
    /// The journal from this byte of a flash on, unread.
    pub(super) const fn new(start: u32, erase_bytes: u32) -> Self {
        Journal {
            start,
            half_bytes: bytes(erase_bytes) / 2,
            last: None,
            is_marked: false,
            flaws: 0,
        }
    }

    /// Reads all of it.
    pub(super) fn scan(&mut self, flash: &mut impl NorFlash) {
        self.last = None;
        self.is_marked = false;
        self.flaws = 0;
        for half in [0, 1] {
            // Behind the last pair there is nothing.
            let start = self.start + half * self.half_bytes;
            for at in (self.pairs() * PAIR_BYTES..self.half_bytes).step_by(BLOCK_BYTES) {
                let is_blank = read::<BLOCK_BYTES>(flash, start + at) == Some(BLANK);
                self.flaws += u32::from(!is_blank);
            }
        }
        for place in 0..2 * self.pairs() {
            let [first, second] = self.pair(flash, place);
            for copy in [&first, &second] {
                self.flaws += u32::from(matches!(copy, Copy::Worn | Copy::Broken));
            }
            let Some(entry) = first.whole().or(second.whole()) else {
                // A second copy is begun only where the first was whole.
                self.is_marked |= second.is_broken();
                continue;
            };
            self.is_marked |= entry.floor.is_some();
            let is_last = (self.last).is_none_or(|last| is_newer(entry.number, last.entry.number));
            if is_last {
                self.last = Some(Last {
                    entry: *entry,
                    place,
                    is_certain: first.whole() == second.whole(),
                });
            }
        }
    }

    /// Whether it says that there were records, or is not what a journal begins as.
    pub(super) fn is_marked(&self) -> bool {
        self.is_marked
    }

    /// Whether there is an entry.
    pub(super) fn has_entry(&self) -> bool {
        self.last.is_some()
    }

    /// Places of copies that hold neither nothing nor a whole one.
    pub(super) fn flaws(&self) -> u32 {
        self.flaws
    }

    /// The least sequence number that an area with all that was acknowledged has.
    pub(super) fn floor(&self) -> Option<u32> {
        self.last?.entry.floor
    }

    /// Whether the newest entry says this, and was written to its end.
    pub(super) fn says(&self, floor: Option<u32>, key: &KeyCopy) -> bool {
        self.last.is_some_and(|last| {
            last.is_certain && last.entry.floor == floor && last.entry.key == *key
        })
    }

    /// The key record that was kept last, an empty one where there was none; nothing where that is
    /// not known for certain.
    pub(super) fn key(&self, flash: &mut impl NorFlash) -> Option<KeyCopy> {
        let last = self.last?;
        last.entry.floor?;
        // An entry behind it that is damaged may have had another key.
        for step in 1..2 * self.pairs() {
            let [first, second] = self.pair(flash, (last.place + step) % (2 * self.pairs()));
            if first.whole().or(second.whole()).is_some() {
                break;
            }
            if second.is_broken() {
                return None;
            }
            if !first.is_broken() {
                break;
            }
        }
        last.entry.key.record().map(|_| last.entry.key)
    }

    /// Adds an entry. Returns whether it is there, both copies of it.
    pub(super) fn append<F: NorFlash>(
        &mut self,
        flash: &mut F,
        floor: Option<u32>,
        key: KeyCopy,
    ) -> bool {
        let pairs = self.pairs();
        let (number, next) = match self.last {
            Some(last) => (last.entry.number.wrapping_add(1), last.place + 1),
            None => (1, 0),
        };
        let entry = Entry { number, floor, key };
        let half = next.saturating_sub(1) / pairs;
        let end = (half + 1) * pairs;
        if (next..end).any(|place| self.write(flash, place, entry)) {
            return true;
        }
        // The other half, in which nothing is needed any more.
        let half = 1 - half;
        let from = self.start + half * self.half_bytes;
        if flash.erase(from, from + self.half_bytes).is_err() {
            return false;
        }
        (half * pairs..(half + 1) * pairs).any(|place| self.write(flash, place, entry))
    }

    /// Writes an entry to a place, if that is blank. Returns whether it is there.
    fn write(&mut self, flash: &mut impl NorFlash, place: u32, entry: Entry) -> bool {
        if !matches!(self.pair(flash, place), [Copy::Blank, Copy::Blank]) {
            return false;
        }
        let bytes = entry.encode();
        for number in 0..COPIES {
            let at = self.address(place, number);
            let (blocks, _) = bytes.as_chunks::<BLOCK_BYTES>();
            let is_written = (at..)
                .step_by(BLOCK_BYTES)
                .zip(blocks)
                .all(|(at, block)| flash.write(at, block).is_ok());
            if !is_written || read(flash, at) != Some(bytes) {
                return false;
            }
        }
        self.is_marked |= entry.floor.is_some();
        self.last = Some(Last {
            entry,
            place,
            is_certain: true,
        });
        true
    }

    /// Pairs of a half.
    fn pairs(&self) -> u32 {
        self.half_bytes / PAIR_BYTES
    }

    fn address(&self, place: u32, copy: u32) -> u32 {
        let (half, pair) = (place / self.pairs(), place % self.pairs());
        self.start + half * self.half_bytes + pair * PAIR_BYTES + copy * COPY_BYTES as u32
    }

    /// What is in the two places of a pair.
    fn pair(&self, flash: &mut impl NorFlash, place: u32) -> [Copy; 2] {
        [0, 1].map(|number| {
            let Some(bytes) = read::<COPY_BYTES>(flash, self.address(place, number)) else {
                return Copy::Broken;
            };
            let zeros: u32 = bytes.iter().map(|byte| byte.count_zeros()).sum();
            match Entry::decode(&bytes) {
                Some(entry) => Copy::Whole(entry),
                None if zeros == 0 => Copy::Blank,
                None if zeros <= WORN_BITS => Copy::Worn,
                None => Copy::Broken,
            }
        })
    }
}

/// Some bytes of the flash. What cannot be read is tried once more.
fn read<const BYTES: usize>(flash: &mut impl NorFlash, at: u32) -> Option<[u8; BYTES]> {
    let mut bytes = [0; BYTES];
    let is_read = flash.read(at, &mut bytes).is_ok() || flash.read(at, &mut bytes).is_ok();
    is_read.then_some(bytes)
}
