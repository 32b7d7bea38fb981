//! The link's line: queues between the interrupt handler that moves its bytes, the UART's or that
//! of [`plant_line`]'s timer, and the link task, so that neither waits for the wire.

use core::mem;

use cortex_m::peripheral::NVIC;
use esm_link::frame::MAX_FRAME_BYTES;
#[cfg(feature = "keys")]
use esm_link::key_store::KeyStore;
use esm_link::message::MAX_CHUNK;
use heapless::spsc::{Consumer, Producer, Queue};
use pac::Interrupt;
use rt_firmware::body::line::{LinePart, PART_BYTES};
#[cfg(feature = "store")]
use rt_firmware::mission_store::MissionStore;
use rt_firmware::{LinkPort, LinkSide, StopListener};

use crate::flash::{self, BoardStore};
#[cfg(feature = "log")]
use crate::log;
use crate::{clock, plant_line, slot_timer, stack, uart};

/// Room for received bytes: a window of chunks with their frames, which a host sends without
/// waiting. So none is lost while the link is at something long, or waits for its time.
pub const RECEIVE_BYTES: usize = 768;
/// How old what is told of the stack may be, in microseconds. To measure it takes milliseconds, and
/// it is asked for with each status.
const STACK_AGE_US: u64 = 1_000_000;
/// Room for bytes to be transmitted: a few milliseconds of the wire, with what the FIFO holds; the
/// link keeps the rest of its frame.
pub const TRANSMIT_BYTES: usize = 40;

// A queue holds one byte less than it has room for.
const _: () = assert!(TRANSMIT_BYTES > PART_BYTES);
const _: () = assert!(RECEIVE_BYTES > LinkEnd::WINDOW_BYTES as usize / MAX_CHUNK * MAX_FRAME_BYTES);

/// Makes the two ends of a line of its queues, and lets the plant carry its bytes where that does.
/// Where bytes come in, somebody listens for stops. The link finds the missions that the board
/// keeps at its end.
pub fn split(
    received: &'static mut Queue<u8, RECEIVE_BYTES>,
    to_transmit: &'static mut Queue<u8, TRANSMIT_BYTES>,
    listener: StopListener<'static>,
    keep: Option<&'static mut BoardStore>,
) -> (Line, LinkEnd) {
    let (received_in, received_out) = received.split();
    let (to_transmit_in, to_transmit_out) = to_transmit.split();
    (
        Line {
            received: received_in,
            to_transmit: to_transmit_out,
            listener,
            goes_by_plant: plant_line::start(),
        },
        LinkEnd {
            received: received_out,
            took: false,
            stack: None,
            to_transmit: to_transmit_in,
            keep,
        },
    )
}

/// The interrupt handler's end.
pub struct Line {
    received: Producer<'static, u8>,
    listener: StopListener<'static>,
    to_transmit: Consumer<'static, u8>,
    /// The plant carries the bytes, and the UART none.
    goes_by_plant: bool,
}

impl Line {
    /// Takes a byte off the line, whether or not there is room for it: what waits there could be a
    /// stop.
    fn take(&mut self, byte: u8) {
        let is_kept = self.received.enqueue(byte).is_ok();
        if self.listener.hear(byte, is_kept) {
            slot_timer::call();
        }
    }

    /// Swaps bytes with the plant. To be called by the interrupt of [`plant_line`]'s timer.
    ///
    /// Returns whether the link task has something to do.
    pub fn swap(&mut self) -> bool {
        plant_line::acknowledge();
        let mut part = LinePart::new(PART_BYTES);
        while !part.is_full() {
            let Some(byte) = self.to_transmit.dequeue() else {
                break;
            };
            part.push(byte);
        }
        let answer = plant_line::swap(&part);
        let carried = answer.as_ref().map_or(&[][..], LinePart::carried);
        for &byte in carried {
            self.take(byte);
        }
        !carried.is_empty() || !part.carried().is_empty()
    }

    /// Moves bytes between the UART and the queues, at most a FIFO of them each way. To be called
    /// by the UART's interrupt, which is pended by software too when the link has queued bytes.
    /// Bytes that find no room in the queue are lost, as on a bad line.
    ///
    /// Returns whether the link task has something to do: bytes came in, or the last that it queued
    /// went out.
    pub fn serve(&mut self) -> bool {
        if self.goes_by_plant {
            return false;
        }
        uart::acknowledge();
        let mut worth_a_look = false;
        for _ in 0..uart::FIFO_BYTES {
            let Some(byte) = uart::receive() else { break };
            self.take(byte);
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
        uart::want_sent(self.to_transmit.ready());
        // The part calls when a byte comes into an empty FIFO, and its call was taken back above:
        // what is still there must be called for.
        if uart::has_received() {
            NVIC::pend(Interrupt::UART0);
        }
        worth_a_look
    }
}

/// The link task's end.
pub struct LinkEnd {
    received: Consumer<'static, u8>,
    to_transmit: Producer<'static, u8>,
    /// Whether bytes were taken since the handler was called last.
    took: bool,
    /// When the stack was measured last, and how much of it was in use.
    stack: Option<(u64, u32)>,
    #[cfg_attr(not(feature = "store"), expect(dead_code, reason = "there is none"))]
    keep: Option<&'static mut BoardStore>,
}

impl LinkEnd {
    /// Lets the link do all that it can do without waiting.
    pub fn serve(&mut self, link: &mut LinkSide<'_, '_>) {
        while link.poll(self) && self.to_transmit.ready() {}
        // Also where it took bytes: an interrupt that the part has not raised for those behind them
        // is made up for.
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

    fn wake_real_time(&mut self) {
        slot_timer::call();
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
        let now_us = clock::now_us();
        let (at_us, bytes) = match self.stack {
            Some((at_us, bytes)) if now_us - at_us < STACK_AGE_US => (at_us, bytes),
            _ => (now_us, stack::deepest_bytes()),
        };
        self.stack = Some((at_us, bytes));
        Some(bytes)
    }

    #[cfg(feature = "store")]
    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        self.keep.as_mut().map(|keep| &mut **keep as _)
    }

    #[cfg(feature = "keys")]
    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        self.keep.as_mut().map(|keep| &mut **keep as _)
    }
}
