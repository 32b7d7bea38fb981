//! Where what lies in the flash, and what headers and words look like there.

use embedded_storage::nor_flash::NorFlash;

use esm_link::message::BankState;

/// Bytes of a block, the unit of everything in a slot: one write of the store is one block, and no
/// block is written twice between two erases. So a flash may program up to this many bytes at once.
pub const BLOCK_BYTES: usize = 32;
/// Bytes of a slot before its payload.
pub const HEADER_BYTES: u32 = 32 * BLOCK_BYTES as u32;
/// Blocks of a slot that say that its mission was confirmed, one for each time that it was asked
/// for and not known for certain.
pub const CONFIRMATIONS: u32 = 5;
/// Blocks of a slot that say that its mission is about to be confirmed. One is enough; another is
/// there if the flash does not take it.
pub const PROMOTIONS: u32 = 2;
/// Blocks of a slot that say that its mission stands over that of the other slot, one for each
/// upload that had to erase one.
pub const ADVANCES: u32 = 21;

/// As many confirmations are not all torn: each would have taken a cut of its own.
pub(super) const CERTAIN_CONFIRMATIONS: u32 = 3;
/// The first advance. Confirmations come first, then promotions.
pub(super) const FIRST_ADVANCE: u32 = CONFIRMATIONS + PROMOTIONS;
/// All of them.
pub(super) const NOTES: u32 = FIRST_ADVANCE + ADVANCES;

/// Offsets in a slot.
pub(super) const HEADER_WRITTEN_AT: u32 = 0;
pub(super) const SEALED_AT: u32 = BLOCK_BYTES as u32;
pub(super) const TRIED_AT: u32 = 2 * BLOCK_BYTES as u32;
pub(super) const NOTES_AT: u32 = 3 * BLOCK_BYTES as u32;
pub(super) const HEADER_AT: u32 = NOTES_AT + NOTES * BLOCK_BYTES as u32;
const _: () = assert!(HEADER_AT + BLOCK_BYTES as u32 == HEADER_BYTES);

pub(super) type Block = [u8; BLOCK_BYTES];

/// What an erased block reads as.
pub(super) const BLANK: Block = [0xFF; BLOCK_BYTES];
/// State words. They have ones and zeros in every byte, so that neither an erase that was cut
/// (ones) nor what some flashes program before they erase (zeros) looks like one of them.
pub(super) const HEADER_WRITTEN: Block = [0x69; BLOCK_BYTES];
pub(super) const SEALED: Block = [0x5A; BLOCK_BYTES];
pub(super) const TRIED: Block = [0xC3; BLOCK_BYTES];
/// All notes are alike, and what a note means follows from where it is. So whoever writes to a
/// block whose writing was cut, but which reads as blank, completes what was begun there.
pub(super) const NOTE: Block = [0x96; BLOCK_BYTES];

/// By how much a note takes its mission forward in the order. A promotion takes it over two
/// advances of the other slot whose writing was cut while the mission was to be given up; each
/// advance takes it two places further. Uploads take the odd places in between.
pub(super) const fn lead(note: u32) -> u32 {
    if note < CONFIRMATIONS {
        0
    } else {
        4 + 2 * (note + 1).saturating_sub(FIRST_ADVANCE)
    }
}

/// By how much an upload is ahead of the newest mission: more than the next note.
pub(super) const UPLOAD_LEAD: u32 = 3;

/// Whether place `a` in the order is after place `b`, where they are less than 2^31 apart: also
/// when numbers start anew in between.
pub(super) fn is_newer(a: u32, b: u32) -> bool {
    a.wrapping_sub(b).cast_signed() > 0
}

/// One of the two places for a mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashBank {
    /// The first.
    A,
    /// The second.
    B,
}

impl FlashBank {
    /// The other one.
    #[must_use]
    pub const fn other(self) -> FlashBank {
        match self {
            FlashBank::A => FlashBank::B,
            FlashBank::B => FlashBank::A,
        }
    }

    /// Its part of a pair.
    pub(super) fn of<T>(self, [a, b]: [T; 2]) -> T {
        match self {
            FlashBank::A => a,
            FlashBank::B => b,
        }
    }
}

/// Which part of a flash the store has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    start: u32,
    bank_bytes: u32,
}

/// Why there can be no store in such a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayoutError {
    /// Start or length of the slots is no multiple of what the flash erases at once.
    NotAligned {
        /// What it erases at once.
        erase_bytes: usize,
    },
    /// A slot has no room for a payload behind its head of [`HEADER_BYTES`].
    SlotTooShort,
    /// The slots end behind the end of the flash.
    BeyondFlash {
        /// Where the flash ends.
        flash_bytes: usize,
    },
}

impl Layout {
    /// Two slots of `bank_bytes` each from the byte `start` of the flash on.
    #[must_use]
    pub const fn new(start: u32, bank_bytes: u32) -> Self {
        Layout { start, bank_bytes }
    }

    /// The longest mission, in bytes.
    #[must_use]
    pub const fn payload_capacity(&self) -> u32 {
        self.bank_bytes.saturating_sub(HEADER_BYTES)
    }

    /// Address of a byte of a slot.
    pub(super) const fn address(&self, slot: FlashBank, offset: u32) -> u32 {
        match slot {
            FlashBank::A => self.start + offset,
            FlashBank::B => self.start + self.bank_bytes + offset,
        }
    }

    /// Bytes of a slot.
    pub(super) const fn bank_bytes(&self) -> u32 {
        self.bank_bytes
    }

    /// First byte of a slot, and the first after it.
    pub(super) const fn bounds(&self, slot: FlashBank) -> (u32, u32) {
        let start = self.address(slot, 0);
        (start, start + self.bank_bytes)
    }

    /// Looks whether this fits a flash. All addresses are within it then, so that no sum of the
    /// above overflows.
    pub(super) fn check<F: NorFlash>(&self, flash: &F) -> Result<(), LayoutError> {
        const {
            assert!(
                F::WRITE_SIZE > 0 && BLOCK_BYTES.is_multiple_of(F::WRITE_SIZE),
                "a block of the store is no multiple of what the flash writes at once"
            );
            assert!(
                F::READ_SIZE > 0 && BLOCK_BYTES.is_multiple_of(F::READ_SIZE),
                "a block of the store is no multiple of what the flash reads at once"
            );
            assert!(
                F::ERASE_SIZE > 0 && F::ERASE_SIZE.is_multiple_of(BLOCK_BYTES),
                "the flash erases parts of a block of the store"
            );
        };
        let (start, len) = (self.start as usize, self.bank_bytes as usize);
        if !start.is_multiple_of(F::ERASE_SIZE) || !len.is_multiple_of(F::ERASE_SIZE) {
            return Err(LayoutError::NotAligned {
                erase_bytes: F::ERASE_SIZE,
            });
        }
        if self.payload_capacity() == 0 {
            return Err(LayoutError::SlotTooShort);
        }
        let flash_bytes = flash.capacity();
        let fits = flash_bytes
            .checked_sub(start)
            .is_some_and(|room| room / 2 >= len);
        if fits && u32::try_from(flash_bytes).is_ok() {
            Ok(())
        } else {
            Err(LayoutError::BeyondFlash { flash_bytes })
        }
    }
}

/// What a slot says of its mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    /// Its place in the order when it was new.
    pub(super) seq: u32,
    /// Bytes of the payload.
    pub(super) len: u32,
    /// Its checksum.
    pub(super) crc: u32,
    /// How often a slot was erased until then, this time included; both slots count.
    pub(super) erases: u32,
}

/// `esmS`
const MAGIC: u32 = 0x536D_7365;
/// The layout that is described here.
const FORMAT: u32 = 1;
/// Words of a header. One is not used yet and stays erased.
const WORDS: usize = BLOCK_BYTES / size_of::<u32>();

impl Header {
    /// The block of this header.
    pub(super) fn encode(&self) -> Block {
        let mut block = BLANK;
        let words = [MAGIC, FORMAT, self.seq, self.len, self.crc, self.erases];
        for (place, word) in block.as_chunks_mut().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        let crc = checksum(&block);
        if let Some(place) = block.last_chunk_mut() {
            *place = crc.to_le_bytes();
        }
        block
    }

    /// The header in this block, with a payload of at most `capacity` bytes, or what is there
    /// instead.
    pub(super) fn decode(block: &Block, capacity: u32) -> Result<Self, BankState> {
        let mut words = [0; WORDS];
        for (word, bytes) in words.iter_mut().zip(block.as_chunks().0) {
            *word = u32::from_le_bytes(*bytes);
        }
        let [magic, format, seq, len, crc, erases, _, own_crc] = words;
        if *block == BLANK {
            Err(BankState::Empty)
        } else if magic != MAGIC || own_crc != checksum(block) {
            Err(BankState::BrokenHeader)
        } else if format != FORMAT {
            Err(BankState::OtherFormat)
        } else if len == 0 || len > capacity {
            Err(BankState::TooLong)
        } else {
            // An earlier firmware left it erased.
            let erases = if erases == u32::MAX { 0 } else { erases };
            Ok(Header {
                seq,
                len,
                crc,
                erases,
            })
        }
    }
}

/// Checksum of all bytes of a header but those of the checksum.
fn checksum(block: &Block) -> u32 {
    let covered = BLOCK_BYTES - size_of::<u32>();
    block.get(..covered).map_or(0, esm_core::format::crc32)
}
