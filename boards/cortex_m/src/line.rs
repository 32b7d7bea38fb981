//! A line of the link: queues between the interrupt handler that moves its bytes and the link task,
//! so that neither waits for the wire.

use core::marker::PhantomData;
use core::mem;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use esm_link::frame::MAX_FRAME_BYTES;
#[cfg(feature = "keys")]
use esm_link::key_store::KeyStore;
use esm_link::message::MAX_CHUNK;
use esm_link::selftest::Measures;
use heapless::spsc::{Consumer, Producer, Queue};
#[cfg(feature = "store")]
use rt_firmware::mission_store::MissionStore;
use rt_firmware::{LinkPort, LinkSide, StopListener};

#[cfg(feature = "log")]
use crate::log;
use crate::stack;

pub use crate::wire::{LineRates, Wire};

/// Room for received bytes: a window of chunks with their frames, which a host sends without
/// waiting. So none is lost while the link is at something long, or waits for its time.
pub const RECEIVE_BYTES: usize = 768;
/// How old what is told of the stack may be, in microseconds. To measure it takes milliseconds, and
/// it is asked for with each status.
const STACK_AGE_US: u64 = 1_000_000;
/// Room for bytes to be transmitted: a few milliseconds of the wire, with what the FIFO holds; the
/// link keeps the rest of its frame.
pub const TRANSMIT_BYTES: usize = 40;

/// What a line needs of its board.
pub trait LineBoard: 'static {
    /// What missions and keys are kept in; any type where the firmware keeps none.
    type Store: BoardStore;
    /// Milliseconds that it takes at most to keep a mission that is signed.
    const FLASH_MS: u16;
    /// The rates of its line; none where it has one alone.
    const RATES: Option<LineRates> = None;

    /// Microseconds since the board started.
    fn now_us() -> u64;

    /// Lets the interrupt come that moves the line's bytes.
    fn call_line();

    /// Lets the slot timer's interrupt come.
    fn call_slots();

    /// What the board has measured of itself, but for its line.
    fn measures() -> Measures {
        Measures::default()
    }
}

/// The rate that a line is to have, in baud: its own unless a host tries another. Written by the
/// link, read by the line's interrupt.
static WANTED_BAUD: AtomicU32 = AtomicU32::new(0);
/// The rate that it has. Written by the line's interrupt, read by the link. Both are 0 where the
/// line has never had another one than its own.
static BAUD: AtomicU32 = AtomicU32::new(0);

/// What a board keeps missions in, and its key where it may have one.
#[cfg(all(feature = "store", feature = "keys"))]
pub trait BoardStore: MissionStore + KeyStore {}
#[cfg(all(feature = "store", feature = "keys"))]
impl<S: MissionStore + KeyStore> BoardStore for S {}

/// What a board keeps missions in.
#[cfg(all(feature = "store", not(feature = "keys")))]
pub trait BoardStore: MissionStore {}
#[cfg(all(feature = "store", not(feature = "keys")))]
impl<S: MissionStore> BoardStore for S {}

/// What stands for a store where there is none.
#[cfg(not(feature = "store"))]
pub trait BoardStore {}
#[cfg(not(feature = "store"))]
impl<S> BoardStore for S {}

/// Makes the two ends of a line of its queues. Where bytes come in, somebody listens for stops. The
/// link finds the missions that the board keeps at its end.
pub fn split<B: LineBoard>(
    received: &'static mut Queue<u8, RECEIVE_BYTES>,
    to_transmit: &'static mut Queue<u8, TRANSMIT_BYTES>,
    listener: StopListener<'static>,
    keep: Option<&'static mut B::Store>,
) -> (Line<B>, LinkEnd<B>) {
    const {
        let window_bytes = <LinkEnd<B> as LinkPort>::WINDOW_BYTES as usize;
        // A queue holds one byte less than it has room for.
        assert!(RECEIVE_BYTES > window_bytes / MAX_CHUNK * MAX_FRAME_BYTES);
    }
    let (received_in, received_out) = received.split();
    let (to_transmit_in, to_transmit_out) = to_transmit.split();
    (
        Line {
            received: received_in,
            to_transmit: to_transmit_out,
            listener,
            board: PhantomData,
        },
        LinkEnd {
            received: received_out,
            took: false,
            stack: None,
            to_transmit: to_transmit_in,
            rates: B::RATES,
            keep,
        },
    )
}

/// The interrupt handler's end.
pub struct Line<B> {
    received: Producer<'static, u8>,
    listener: StopListener<'static>,
    to_transmit: Consumer<'static, u8>,
    board: PhantomData<B>,
}

impl<B: LineBoard> Line<B> {
    /// Takes a byte off the line, whether or not there is room for it: what waits there could be a
    /// stop.
    pub fn take(&mut self, byte: u8) {
        let is_kept = self.received.enqueue(byte).is_ok();
        if self.listener.hear(byte, is_kept) {
            B::call_slots();
        }
    }

    /// The next byte that is to be transmitted.
    pub fn next_to_transmit(&mut self) -> Option<u8> {
        self.to_transmit.dequeue()
    }

    /// Moves bytes between the wire and the queues, at most a FIFO of them each way. To be called
    /// by the wire's interrupt, which is pended by software too when the link has queued bytes.
    /// Bytes that find no room in the queue are lost, as on a bad line.
    ///
    /// Returns whether the link task has something to do: bytes came in, or the last that it queued
    /// went out.
    pub fn serve<W: Wire>(&mut self, wire: &mut W) -> bool {
        wire.acknowledge();
        let mut worth_a_look = false;
        for _ in 0..W::FIFO_BYTES {
            let Some(byte) = wire.receive() else { break };
            self.take(byte);
            worth_a_look = true;
        }
        if worth_a_look {
            wire.expect_more();
        }
        for _ in 0..W::FIFO_BYTES {
            if !wire.can_send() {
                break;
            }
            let Some(byte) = self.to_transmit.dequeue() else {
                break;
            };
            wire.send(byte);
            worth_a_look |= !self.to_transmit.ready();
        }
        wire.want_sent(self.to_transmit.ready());
        let wanted = WANTED_BAUD.load(Relaxed);
        if B::RATES.is_some()
            && wanted != BAUD.load(Relaxed)
            && !self.to_transmit.ready()
            && wire.is_silent()
        {
            wire.set_rate(wanted);
            BAUD.store(wanted, Relaxed);
        }
        // The part calls when a byte comes into an empty FIFO, and its call was taken back above:
        // what is still there must be called for.
        if wire.has_received() {
            B::call_line();
        }
        worth_a_look
    }
}

/// The link task's end.
pub struct LinkEnd<B: LineBoard> {
    received: Consumer<'static, u8>,
    to_transmit: Producer<'static, u8>,
    /// Whether bytes were taken since the handler was called last.
    took: bool,
    /// When the stack was measured last, and how much of it was in use.
    stack: Option<(u64, u32)>,
    /// The rates that its line can have.
    rates: Option<LineRates>,
    #[cfg_attr(not(feature = "store"), expect(dead_code, reason = "there is none"))]
    keep: Option<&'static mut B::Store>,
}

impl<B: LineBoard> LinkEnd<B> {
    /// Lets the link do all that it can do without waiting.
    pub fn serve(&mut self, link: &mut LinkSide<'_, '_>) {
        while link.poll(self) && self.to_transmit.ready() {}
        // Also where it took bytes: an interrupt that the part has not raised for those behind them
        // is made up for.
        let is_other_rate = WANTED_BAUD.load(Relaxed) != BAUD.load(Relaxed);
        if mem::take(&mut self.took) || !self.to_transmit.is_empty() || is_other_rate {
            B::call_line();
        }
    }

    /// Its line has no rate: something else carries the bytes.
    #[cfg(feature = "plant")]
    pub(crate) fn without_rate(&mut self) {
        self.rates = None;
    }
}

impl<B: LineBoard> LinkPort for LinkEnd<B> {
    const KEEPS_LOG: bool = cfg!(feature = "log");
    const FLASH_MS: u16 = B::FLASH_MS;

    fn now_us(&mut self) -> u64 {
        B::now_us()
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
        B::call_slots();
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
        let now_us = B::now_us();
        let (at_us, bytes) = match self.stack {
            Some((at_us, bytes)) if now_us - at_us < STACK_AGE_US => (at_us, bytes),
            _ => (now_us, stack::deepest_bytes()),
        };
        self.stack = Some((at_us, bytes));
        Some(bytes)
    }

    fn measures(&mut self) -> Measures {
        Measures {
            baud: self.rates.map(|rates| rates.own),
            ..B::measures()
        }
    }

    fn takes_line_rate(&mut self, baud: u32) -> bool {
        (self.rates).is_some_and(|rates| (rates.slowest..=rates.fastest).contains(&baud))
    }

    fn set_line_rate(&mut self, baud: Option<u32>) {
        if let Some(rates) = self.rates {
            WANTED_BAUD.store(baud.unwrap_or(rates.own), Relaxed);
            B::call_line();
        }
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
