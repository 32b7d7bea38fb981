//! The flash that missions are kept in: the plant's, reached by two named pipes of its own
//! ([`rt_firmware::body::flash`]).
//!
//! An operation is a semihosting call or two, from the link's context; virtual time stands still
//! until the plant has answered, and then the driver waits for as long as the operation takes.
//! Slots interrupt it. Without the pipes (the firmware was started by hand) there is no flash.

use core::mem::MaybeUninit;
use core::sync::atomic::AtomicI32;

use rt_firmware::body::flash::{
    BodyFlash, ERASE_BYTES, ERASE_US, FlashRequest, FlashWire, MAX_PART_BYTES,
    REQUEST_HEADER_BYTES, WRITE_BYTES, WRITE_US, status_of,
};
use rt_firmware::store::flash_store::{self, FlashStore};

use crate::{clock, plant, post_mortem, settings};
use plant::{CLOSED, file};

/// Carries requests to the plant.
const REQUEST_PIPE: &core::ffi::CStr = c"flash-request";
/// Carries replies from the plant.
const REPLY_PIPE: &core::ffi::CStr = c"flash-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Bytes of the flash.
pub const BYTES: u32 = flash_store::flash_bytes(settings::BLOB_BYTES as u32, ERASE_BYTES as u32);

/// Milliseconds that it takes at most to keep a mission that is signed: its slot is erased and
/// written, and before it a table of records, three times if it is the first of all, and a half of
/// its journal; reading it back, checking it and the slots that run meanwhile take as long again.
pub const LONGEST_MS: u16 = {
    const fn written_us(bytes: u32) -> u32 {
        let bank_bytes = flash_store::bank_bytes(bytes, ERASE_BYTES as u32);
        bank_bytes / ERASE_BYTES as u32 * ERASE_US + bank_bytes / WRITE_BYTES as u32 * WRITE_US
    }
    let us =
        written_us(settings::BLOB_BYTES as u32) + 4 * written_us(flash_store::RECORD_BYTES as u32);
    (2 * us / 1_000) as u16
};

/// The flash, and what is kept in it.
pub type BoardStore = FlashStore<'static, BodyFlash<Wire>>;

/// The memory of what the board keeps.
pub struct StoreMemory {
    keep: MaybeUninit<BoardStore>,
    records: [u8; flash_store::RECORD_BYTES],
}

impl StoreMemory {
    /// Memory that nothing uses yet.
    #[allow(clippy::new_without_default, reason = "there is one, in a static")]
    pub const fn new() -> Self {
        StoreMemory {
            keep: MaybeUninit::uninit(),
            records: [0; flash_store::RECORD_BYTES],
        }
    }

    /// Opens the flash, which waits until the plant has opened its ends, and what is kept in it.
    /// None if there is none.
    // Not inlined: the app's first function should not keep what this needs of the stack.
    #[inline(never)]
    pub fn open(
        &'static mut self,
        default_mission: Option<&'static [u8]>,
    ) -> Option<&'static mut BoardStore> {
        plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE)?;
        let flash = BodyFlash::new(Wire, BYTES);
        let blob_bytes = settings::BLOB_BYTES as u32;
        let opened = FlashStore::open(flash, blob_bytes, default_mission, &mut self.records);
        let keep = opened.ok()?.over_resets(post_mortem::kept());
        Some(self.keep.write(keep))
    }
}

/// The pipes.
#[derive(Clone, Copy, Debug)]
pub struct Wire;

impl FlashWire for Wire {
    fn exchange(
        &mut self,
        request: &FlashRequest,
        written: &[u8],
        room: &mut [u8],
    ) -> Option<Result<(), embedded_storage::nor_flash::NorFlashErrorKind>> {
        let requests = file(&REQUESTS)?;
        let replies = file(&REPLIES)?;
        let mut message = [0; REQUEST_HEADER_BYTES + MAX_PART_BYTES];
        let bytes = request.encode().into_iter().chain(written.iter().copied());
        for (place, byte) in message.iter_mut().zip(bytes) {
            *place = byte;
        }
        plant::send(
            requests,
            message.get(..REQUEST_HEADER_BYTES + written.len())?,
        )?;
        let mut status = [0];
        plant::receive(replies, &mut status)?;
        let status = status_of(status[0]);
        if status.is_ok() {
            plant::receive(replies, room)?;
        }
        Some(status)
    }

    fn wait_us(&mut self, us: u32) {
        let end_us = clock::now_us() + u64::from(us);
        while clock::now_us() < end_us {
            core::hint::spin_loop();
        }
    }
}
