//! The flash that missions are kept in: the plant's, reached by two named pipes of its own
//! ([`rt_firmware::body::flash`]).
//!
//! An operation is a semihosting call or two, from the link's context; virtual time stands still
//! until the plant has answered, and then the driver waits for as long as the operation takes.
//! Slots interrupt it. Without the pipes (the firmware was started by hand) there is no flash.

use core::marker::PhantomData;
use core::sync::atomic::AtomicI32;

use rt_firmware::board::microseconds;
use rt_firmware::body::flash::{
    BodyFlash, ERASE_BYTES, ERASE_US, FlashRequest, FlashWire, MAX_PART_BYTES,
    REQUEST_HEADER_BYTES, WRITE_BYTES, WRITE_US, status_of,
};
use rt_firmware::store::flash_store::{self, FlashStore};

use crate::chip::Chip;
use crate::plant::{self, CLOSED, file};
use crate::store::{self, FlashTimes};
use crate::sys_tick;

/// Carries requests to the plant.
const REQUEST_PIPE: &core::ffi::CStr = c"flash-request";
/// Carries replies from the plant.
const REPLY_PIPE: &core::ffi::CStr = c"flash-reply";

static REQUESTS: AtomicI32 = AtomicI32::new(CLOSED);
static REPLIES: AtomicI32 = AtomicI32::new(CLOSED);

/// Milliseconds that it takes at most to keep a mission of so many bytes that is signed.
pub const fn longest_ms(blob_bytes: usize) -> u16 {
    let times = FlashTimes {
        erase_bytes: ERASE_BYTES as u32,
        erase_us: ERASE_US,
        write_bytes: WRITE_BYTES as u32,
        write_us: WRITE_US,
    };
    times.longest_ms(blob_bytes as u32)
}

/// The flash, and what is kept in it.
pub type BoardStore<C> = FlashStore<'static, BodyFlash<Wire<C>>>;
/// The memory of what the board keeps.
pub type StoreMemory<C> = store::StoreMemory<BodyFlash<Wire<C>>>;

/// Opens the flash for missions of so many bytes, which waits until the plant has opened its ends,
/// and what is kept in it. None if there is none.
// Not inlined: the app's first function should not keep what this needs of the stack.
#[inline(never)]
pub fn open<C: Chip>(
    memory: &'static mut StoreMemory<C>,
    blob_bytes: usize,
    default_mission: Option<&'static [u8]>,
) -> Option<&'static mut BoardStore<C>> {
    plant::open_pair(&REQUESTS, REQUEST_PIPE, &REPLIES, REPLY_PIPE)?;
    let flash = BodyFlash::new(
        Wire(PhantomData),
        flash_store::flash_bytes_with_script(blob_bytes as u32, ERASE_BYTES as u32),
    );
    memory.open(flash, blob_bytes as u32, default_mission)
}

/// The pipes.
#[derive(Debug)]
pub struct Wire<C>(PhantomData<C>);

impl<C> Clone for Wire<C> {
    fn clone(&self) -> Self {
        Wire(PhantomData)
    }
}

impl<C: Chip> FlashWire for Wire<C> {
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
        let now_us = || microseconds(sys_tick::now_ticks(), C::TICKS_PER_US);
        let end_us = now_us() + u64::from(us);
        while now_us() < end_us {
            core::hint::spin_loop();
        }
    }
}

/// Names what a board's module `flash` has, for missions of so many bytes.
#[macro_export]
macro_rules! plant_flash {
    ($chip:ty, $blob_bytes:expr) => {
        /// Milliseconds that it takes at most to keep a mission that is signed.
        pub const LONGEST_MS: u16 = $crate::plant_flash::longest_ms($blob_bytes);

        /// The flash, and what is kept in it.
        pub type BoardStore = $crate::plant_flash::BoardStore<$chip>;
        /// The memory of what the board keeps.
        pub type StoreMemory = $crate::plant_flash::StoreMemory<$chip>;

        /// Opens what is kept in the flash.
        pub fn open(
            memory: &'static mut StoreMemory,
            default_mission: Option<&'static [u8]>,
        ) -> Option<&'static mut BoardStore> {
            $crate::plant_flash::open(memory, $blob_bytes, default_mission)
        }
    };
}
