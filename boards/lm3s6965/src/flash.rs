//! The flash that missions are kept in: the plant's, reached by two named pipes of its own
//! ([`rt_firmware::body::flash`]).
//!
//! An operation is a semihosting call or two, from the link's context; virtual time stands still
//! until the plant has answered, and then the driver waits for as long as the operation takes.
//! Slots interrupt it. Without the pipes (the firmware was started by hand) there is no flash.

use core::sync::atomic::AtomicI32;

use cortex_m_board::store::{self, FlashTimes};
use rt_firmware::body::flash::{
    BodyFlash, ERASE_BYTES, ERASE_US, FlashRequest, FlashWire, MAX_PART_BYTES,
    REQUEST_HEADER_BYTES, WRITE_BYTES, WRITE_US, status_of,
};
use rt_firmware::store::flash_store::{self, FlashStore};

use crate::{clock, plant, settings};
use plant::{CLOSED, file};

/// Carries requests to the plant.
const REQUEST_PIPE: &core::ffi::CStr = c"flash-request";
/// Carries replies from the plant.
const REPLY_PIPE: &core::ffi::CStr = c"flash-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Bytes of the flash.
pub const BYTES: u32 = flash_store::flash_bytes(settings::BLOB_BYTES as u32, ERASE_BYTES as u32);

/// Milliseconds that it takes at most to keep a mission that is signed.
pub const LONGEST_MS: u16 = FlashTimes {
    erase_bytes: ERASE_BYTES as u32,
    erase_us: ERASE_US,
    write_bytes: WRITE_BYTES as u32,
    write_us: WRITE_US,
}
.longest_ms(settings::BLOB_BYTES as u32);

/// The flash, and what is kept in it.
pub type BoardStore = FlashStore<'static, BodyFlash<Wire>>;
/// The memory of what the board keeps.
pub type StoreMemory = store::StoreMemory<BodyFlash<Wire>>;

/// Opens the flash, which waits until the plant has opened its ends, and what is kept in it. None
/// if there is none.
// Not inlined: the app's first function should not keep what this needs of the stack.
#[inline(never)]
pub fn open(
    memory: &'static mut StoreMemory,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore> {
    plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE)?;
    let flash = BodyFlash::new(Wire, BYTES);
    memory.open(flash, settings::BLOB_BYTES as u32, default_mission)
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
