//! The last six sectors of the chip's flash, 6 to 11, of 128 KiB each, and what its controller does
//! to them (RM0090, 3).

use cortex_m_board::on_chip_flash::Cells;
use embedded_storage::nor_flash::NorFlashErrorKind;

use super::motors;
use crate::pac::{FLASH, flash};
use crate::watchdog;

/// What is erased at once.
pub const SECTOR_BYTES: u32 = 128 << 10;
/// What is written at once.
pub const WORD_BYTES: usize = 4;
/// The first sector of the store, and where it is; before it are four of 16 KiB, one of 64, one of
/// 128.
const FIRST_SECTOR: u32 = 6;
const START: u32 = 0x0804_0000;
/// Bytes of all of them.
pub const BYTES: u32 = 6 * SECTOR_BYTES;

/// The sectors of the store.
pub struct Sectors;

fn controller() -> &'static flash::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life. Once the clocks run, the store
    // alone writes them.
    unsafe { &*FLASH::PTR }
}

/// Does something to the flash: `control` is what the controller is told, `word` what is written
/// where, if something is.
///
/// # Errors
/// A motor has power, or the flash did not do it.
fn change(control: u32, word: Option<(u32, u32)>) -> Result<(), NorFlashErrorKind> {
    const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
    const LOCK: u32 = 1 << 31;
    /// All that can go wrong, in the status register.
    const FAILED: u32 = 0b1111 << 4 | 1 << 1;
    // The slot timer's handler could give a motor power in between. It comes when this is done.
    cortex_m::interrupt::free(|_| {
        if !motors::are_off() {
            return Err(NorFlashErrorKind::Other);
        }
        // SAFETY: keys, flags that are taken back by ones, and what the caller wants done.
        unsafe {
            for key in KEYS {
                controller().keyr().write(|w| w.bits(key));
            }
            controller().sr().write(|w| w.bits(FAILED));
            // What is erased is said before it begins.
            controller().cr().write(|w| w.bits(control & !BEGIN));
            let has_ended = act(controller(), control, word);
            controller().cr().write(|w| w.bits(LOCK));
            // What the caches have of it is old.
            (controller().acr()).modify(|_, w| w.dcen().disabled());
            (controller().acr()).modify(|_, w| w.dcrst().reset());
            (controller().acr()).modify(|_, w| w.dcrst().no_reset());
            (controller().acr()).modify(|_, w| w.dcen().enabled());
            let is_done = has_ended && controller().sr().read().bits() & FAILED == 0;
            is_done.then_some(()).ok_or(NorFlashErrorKind::Other)
        }
    })
}

/// The part of a change that runs while the flash cannot be read. Answers whether it came to an
/// end.
///
/// # Safety
/// The controller is unlocked, and `word` lies in the store.
// In RAM, with all that it does.
#[cfg_attr(target_os = "none", unsafe(link_section = ".data.change_flash"))]
#[inline(never)]
unsafe fn act(controller: &flash::RegisterBlock, control: u32, word: Option<(u32, u32)>) -> bool {
    const BUSY: u32 = 1 << 16;
    /// Many more looks than 2 s have, at 168 MHz.
    const LOOKS: u32 = 200_000_000;
    // SAFETY: as the caller promises.
    unsafe {
        controller.cr().write(|w| w.bits(control));
        if let Some((at, word)) = word {
            (at as *mut u32).write_volatile(word);
        }
    }
    for _ in 0..LOOKS {
        if controller.sr().read().bits() & BUSY == 0 {
            return true;
        }
        watchdog::feed();
    }
    false
}

/// Words are written at once.
const BY_WORDS: u32 = 0b10 << 8;
const PROGRAM: u32 = 1;
const BEGIN: u32 = 1 << 16;

/// What the controller is told to erase a sector of the store, from `offset` on.
const fn erase_sector(offset: u32) -> u32 {
    const ERASE: u32 = 1 << 1;
    ERASE | (FIRST_SECTOR + offset / SECTOR_BYTES) << 3 | BY_WORDS | BEGIN
}

impl Cells for Sectors {
    const READ_AT: u32 = START;
    const BYTES: u32 = BYTES;
    const ERASE_BYTES: usize = SECTOR_BYTES as usize;
    const WRITE_BYTES: usize = WORD_BYTES;

    fn erase(offset: u32) -> Result<(), NorFlashErrorKind> {
        change(erase_sector(offset), None)
    }

    fn write(offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let (words, _) = bytes.as_chunks::<WORD_BYTES>();
        words.iter().enumerate().try_for_each(|(place, word)| {
            let at = START + offset + (place * WORD_BYTES) as u32;
            change(BY_WORDS | PROGRAM, Some((at, u32::from_le_bytes(*word))))
        })
    }
}
