//! The link's line: queues between the interrupt handler that moves its bytes, the UART's or that of [`plant_line`]'s timer, and the link task, so that
//! neither waits for the wire.

use core::mem;

use cortex_m::peripheral::NVIC;
use heapless::spsc::{Consumer, Producer, Queue};
use pac::Interrupt;
use rt_firmware::body::line::{LinePart, PART_BYTES};
#[cfg(feature = "keys")]
use rt_firmware::link::key_safe::{KeyRecord, KeySafe, NotKept, WriteError};
#[cfg(feature = "store")]
use rt_firmware::link::trial::MissionKeeper;
use rt_firmware::{LinkPort, LinkSide};

use crate::flash::{self, BoardKeep};
#[cfg(feature = "log")]
use crate::log;
use crate::{clock, plant_line, stack, uart};

/// Room for received bytes: what arrives at 115,200 baud while a blob is verified or a slot runs, several milliseconds.
pub const RECEIVE_BYTES: usize = 128;
/// Room for bytes to be transmitted: a few milliseconds of the wire, with what the FIFO holds; the link keeps the rest of its frame.
pub const TRANSMIT_BYTES: usize = 40;

// A queue holds one byte less than it has room for.
const _: () = assert!(TRANSMIT_BYTES > PART_BYTES && RECEIVE_BYTES > 2 * PART_BYTES);

/// Makes the two ends of a line of its queues, and lets the plant carry its bytes where that does. The link finds the missions that the board keeps at its end.
pub fn split(
    received: &'static mut Queue<u8, RECEIVE_BYTES>,
    to_transmit: &'static mut Queue<u8, TRANSMIT_BYTES>,
    keep: Option<&'static mut BoardKeep>,
) -> (Line, LinkEnd) {
    let (received_in, received_out) = received.split();
    let (to_transmit_in, to_transmit_out) = to_transmit.split();
    (
        Line {
            received: received_in,
            to_transmit: to_transmit_out,
            goes_by_plant: plant_line::start(),
        },
        LinkEnd {
            received: received_out,
            took: false,
            to_transmit: to_transmit_in,
            keep,
        },
    )
}

/// The interrupt handler's end.
pub struct Line {
    received: Producer<'static, u8>,
    to_transmit: Consumer<'static, u8>,
    /// The plant carries the bytes, and the UART none.
    goes_by_plant: bool,
}

impl Line {
    /// Swaps bytes with the plant. To be called by the interrupt of [`plant_line`]'s timer.
    ///
    /// Returns whether the link task has something to do.
    pub fn swap(&mut self) -> bool {
        plant_line::acknowledge();
        let mut part = LinePart::new(self.received.capacity() - self.received.len());
        while !part.is_full() {
            let Some(byte) = self.to_transmit.dequeue() else {
                break;
            };
            part.push(byte);
        }
        let answer = plant_line::swap(&part);
        let carried = answer.as_ref().map_or(&[][..], LinePart::carried);
        for &byte in carried {
            // There is room: the plant was told how much, and nobody else puts bytes in.
            let _ = self.received.enqueue(byte);
        }
        !carried.is_empty() || !part.carried().is_empty()
    }

    /// Moves bytes between the UART and the queues, at most a FIFO of them each way. To be called by the UART's interrupt, which is pended by
    /// software too when the link has queued or taken bytes. Bytes that find no room in the queue wait in the FIFO.
    ///
    /// Returns whether the link task has something to do: bytes came in, or the last that it queued went out.
    pub fn serve(&mut self) -> bool {
        if self.goes_by_plant {
            return false;
        }
        uart::acknowledge();
        let mut worth_a_look = false;
        for _ in 0..uart::FIFO_BYTES {
            if !self.received.ready() {
                break;
            }
            let Some(byte) = uart::receive() else { break };
            // There is room: nobody else puts bytes in.
            let _ = self.received.enqueue(byte);
            worth_a_look = true;
        }
        if worth_a_look {
            uart::expect_more();
        }
        for _ in 0..uart::FIFO_BYTES {
            if !uart::can_send() {
                break;
            }
            let Some(byte) = self.to_transmit.dequeue() else {
                break;
            };
            uart::send(byte);
            worth_a_look |= !self.to_transmit.ready();
        }
        let room = self.received.ready();
        uart::want_interrupts(room, self.to_transmit.ready());
        // The part calls when a byte comes into an empty FIFO, and its call was taken back above: what is still there must be called for.
        if room && uart::has_received() {
            NVIC::pend(Interrupt::UART0);
        }
        worth_a_look
    }
}

/// The link task's end.
pub struct LinkEnd {
    received: Consumer<'static, u8>,
    /// Whether bytes were taken since the handler was last told of room.
    took: bool,
    to_transmit: Producer<'static, u8>,
    #[cfg_attr(not(feature = "store"), expect(dead_code, reason = "there is none"))]
    keep: Option<&'static mut BoardKeep>,
}

impl LinkEnd {
    /// Lets the link do all that it can do without waiting.
    pub fn serve(&mut self, link: &mut LinkSide<'_, '_>) {
        while link.poll(self) && self.to_transmit.ready() {}
        // Comparing lengths would not do: the handler may have put in as many as were taken.
        if mem::take(&mut self.took) || !self.to_transmit.is_empty() {
            NVIC::pend(Interrupt::UART0);
        }
    }
}

impl LinkPort for LinkEnd {
    const KEEPS_LOG: bool = cfg!(feature = "log");
    const FLASH_MS: u16 = flash::LONGEST_MS;

    fn now_us(&mut self) -> u64 {
        clock::now_us()
    }

    fn receive(&mut self) -> Option<u8> {
        let byte = self.received.dequeue();
        self.took |= byte.is_some();
        byte
    }

    fn send(&mut self, byte: u8) -> bool {
        self.to_transmit.enqueue(byte).is_ok()
    }

    #[cfg(feature = "log")]
    fn read_log(&mut self, room: &mut [u8]) -> usize {
        log::read(room)
    }

    #[cfg(feature = "log")]
    fn log_dropped(&self) -> u32 {
        log::dropped_frames()
    }

    fn deepest_stack_bytes(&mut self) -> Option<u32> {
        Some(stack::deepest_bytes())
    }

    #[cfg(feature = "store")]
    fn keeper(&mut self) -> Option<&mut dyn MissionKeeper> {
        self.keep.as_mut().map(|keep| &mut **keep as _)
    }

    #[cfg(feature = "keys")]
    fn key_safe(&mut self) -> Option<&mut dyn KeySafe> {
        match self.keep {
            Some(_) => Some(self),
            None => None,
        }
    }
}

#[cfg(feature = "keys")]
impl KeySafe for LinkEnd {
    fn read(&mut self, record: KeyRecord, room: &mut [u8]) -> Result<usize, NotKept> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.read_of_key(record, room)
    }

    fn write(&mut self, record: KeyRecord, bytes: &[u8]) -> Result<(), WriteError> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.write_of_key(record, bytes)
    }

    fn remembered_key(&mut self, room: &mut [u8]) -> Result<usize, NotKept> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.remembered_key(room)
    }

    fn renew(&mut self, key: &[u8]) -> Result<(), WriteError> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.renew(key)
    }
}
