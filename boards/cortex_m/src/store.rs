//! What a board keeps in its flash: missions and records.

use core::mem::MaybeUninit;

use embedded_storage::nor_flash::NorFlash;
use rt_firmware::store::flash_store::{self, FlashStore, RECORD_BYTES};

use crate::crash;

/// The memory of what a board keeps in a flash of this type.
pub struct StoreMemory<F: 'static> {
    keep: MaybeUninit<FlashStore<'static, F>>,
    records: [u8; RECORD_BYTES],
}

impl<F: NorFlash + Clone> StoreMemory<F> {
    /// Memory that nothing uses yet.
    #[allow(clippy::new_without_default, reason = "there is one, in a static")]
    pub const fn new() -> Self {
        StoreMemory {
            keep: MaybeUninit::uninit(),
            records: [0; RECORD_BYTES],
        }
    }

    /// Opens what is kept in a flash. None if it does not fit there.
    // Not inlined: the app's first function should not keep what this needs of the stack.
    #[inline(never)]
    pub fn open(
        &'static mut self,
        flash: F,
        blob_bytes: u32,
        default_mission: Option<&'static [u8]>,
    ) -> Option<&'static mut FlashStore<'static, F>> {
        let opened = FlashStore::open(flash, blob_bytes, default_mission, &mut self.records);
        let keep = opened.ok()?.over_resets(crash::kept());
        Some(self.keep.write(keep))
    }
}

/// How long the operations of a flash take at most.
pub struct FlashTimes {
    /// What is erased at once, in bytes.
    pub erase_bytes: u32,
    /// How long that takes, in microseconds.
    pub erase_us: u32,
    /// What is written at once, in bytes.
    pub write_bytes: u32,
    /// How long that takes, in microseconds.
    pub write_us: u32,
}

impl FlashTimes {
    /// Milliseconds that it takes at most to keep a mission of so many bytes that is signed: its
    /// bank is erased and written, and before it a table of records, three times if it is the first
    /// of all, and a half of its journal; reading it back, checking it and the slots that run
    /// meanwhile take as long again.
    pub const fn longest_ms(&self, blob_bytes: u32) -> u16 {
        let us = self.written_us(blob_bytes) + 4 * self.written_us(RECORD_BYTES as u32);
        let ms = 2 * us / 1_000;
        assert!(ms <= u16::MAX as u32, "the flash is too slow for the link");
        ms as u16
    }

    const fn written_us(&self, bytes: u32) -> u32 {
        let bank_bytes = flash_store::bank_bytes(bytes, self.erase_bytes);
        bank_bytes / self.erase_bytes * self.erase_us
            + bank_bytes / self.write_bytes * self.write_us
    }
}
