//! A link of missions over a UART: the device of its dispatchers, and the interrupts that move its
//! bytes.
//!
//! Both interrupts, that of a timer and that of the UART, are above the slots. The timer's starts
//! the UART at the start of a frame, which no slot delays, and the UART's moves a byte: a chip has
//! a FIFO shorter than a slot. So the line is never silent within a frame, and no byte is lost.
//!
//! Frames are in buffers that go around: a dispatcher fills a free one, the interrupt sends it and
//! gives it back. What comes goes the other way. A frame is written into its buffer, and read from
//! it, where it lies.

use core::cmp::Reverse;
use core::marker::PhantomData;

use cortex_m::singleton;
use esm_link::frame::DELIMITER;
use esm_link::frames::receiver::{InFrames, MAX_STUFFED_BYTES, ReceiveError, receive};
use esm_link::frames::wire::{self, Header, MAX_WIRE_BYTES};
use heapless::Vec;
use heapless::spsc::{Consumer, Producer, Queue};
use rt_firmware::frames::{LinkDevice, RobotClock, Taken};

use crate::chip::Chip;
use crate::plant_frames;
use crate::sys_tick;

/// Frames that wait to be sent, and frames that have arrived and wait for their dispatcher, that
/// are there at once. For each there is a buffer.
pub const WAITING: usize = 8;
/// A queue holds one less than it has room for.
const PLACES: usize = WAITING + 1;

/// The UART and the timer of a link's frames.
pub trait FrameUart: Chip {
    /// Starts both with their interrupts, of a UART without FIFOs, and without a time set.
    fn start();

    /// Sets the rate of the line.
    fn set_rate(rate_bps: u32);

    /// Takes the UART's interrupt back.
    fn acknowledge();

    /// The byte that has arrived.
    fn receive() -> Option<u8>;

    /// Whether it takes a byte to be sent.
    fn can_send() -> bool;

    /// Gives it one; only where it [takes one](Self::can_send).
    fn send(byte: u8);

    /// Sets whether the interrupt comes where it takes the next byte. For one that has arrived it
    /// always comes.
    fn want_sent(sent: bool);

    /// Lets the timer's interrupt come after so many ticks of the clock.
    fn set_timer(ticks: u32);

    /// Takes the timer's interrupt back, and stops it.
    fn acknowledge_timer();

    /// Lets the timer's interrupt come at once, which takes over what is to be sent. From any
    /// context below it.
    fn call();
}

/// A frame as bytes of the wire.
struct Buffer {
    /// When it is to start, or when its last bit was there, by the clock.
    at_ticks: u64,
    /// When it is to start, by robot time.
    start_us: u64,
    length: u8,
    /// It had more bytes than a frame can have.
    is_too_long: bool,
    bytes: [u8; MAX_WIRE_BYTES],
}

impl Buffer {
    const EMPTY: Self = Buffer {
        at_ticks: 0,
        start_us: 0,
        length: 0,
        is_too_long: false,
        bytes: [0; MAX_WIRE_BYTES],
    };
}

type Owned = &'static mut Buffer;

/// Makes the two ends of a link, and starts what moves its bytes.
///
/// # Panics
/// Where it is called twice.
pub fn start<C: FrameUart>() -> (FrameLine<C>, FrameDevice<C>) {
    // One after the other, so that they do not stand on the stack first.
    let buffers = singleton!(: Vec<Buffer, { 2 * WAITING }> = Vec::new());
    let ready = singleton!(: Queue<Owned, PLACES> = Queue::new());
    let sent = singleton!(: Queue<Owned, PLACES> = Queue::new());
    let arrived = singleton!(: Queue<Owned, PLACES> = Queue::new());
    let read = singleton!(: Queue<Owned, PLACES> = Queue::new());
    let (Some(buffers), Some(ready), Some(sent), Some(arrived), Some(read)) =
        (buffers, ready, sent, arrived, read)
    else {
        panic!("the link's device is there once");
    };
    let (ready_in, ready_out) = ready.split();
    let (mut sent_in, sent_out) = sent.split();
    let (arrived_in, arrived_out) = arrived.split();
    let (mut read_in, read_out) = read.split();
    while buffers.push(Buffer::EMPTY).is_ok() {}
    let (to_send, to_receive) = buffers.split_at_mut(WAITING);
    for (to, buffers) in [(&mut sent_in, to_send), (&mut read_in, to_receive)] {
        for buffer in buffers {
            // There is a place for each.
            let _ = to.enqueue(buffer);
        }
    }
    C::start();
    let goes_by_plant = plant_frames::open();
    (
        FrameLine {
            ready: ready_out,
            sent: sent_in,
            arrived: arrived_in,
            read: read_out,
            waiting: Vec::new(),
            sending: None,
            arriving: None,
            goes_by_plant,
            chip: PhantomData,
        },
        FrameDevice {
            end: DeviceEnd {
                ready: ready_in,
                sent: sent_out,
                arrived: arrived_out,
                read: read_in,
                spare: None,
                next: None,
            },
            clock: RobotClock::default(),
            rate_bps: 0,
            is_new: false,
            goes_by_plant,
            chip: PhantomData,
        },
    )
}

/// The interrupts' end.
pub struct FrameLine<C> {
    ready: Consumer<'static, Owned>,
    sent: Producer<'static, Owned>,
    arrived: Producer<'static, Owned>,
    read: Consumer<'static, Owned>,
    /// What is to be sent, the earliest last.
    waiting: Vec<Owned, WAITING>,
    /// What is being sent, and how many bytes of it the UART has.
    sending: Option<(Owned, u8)>,
    arriving: Option<Owned>,
    /// The plant carries the frames, and the UART nothing.
    goes_by_plant: bool,
    chip: PhantomData<C>,
}

impl<C: FrameUart> FrameLine<C> {
    /// Takes over what is to be sent, and starts what is due. To be called by the timer's
    /// interrupt.
    pub fn start_due(&mut self) {
        C::acknowledge_timer();
        while !self.waiting.is_full()
            && let Some(frame) = self.ready.dequeue()
        {
            // A dispatcher hands frames over in the order of its declarations.
            let earlier = |it: &Owned| Reverse(it.at_ticks) <= Reverse(frame.at_ticks);
            let place = self.waiting.partition_point(earlier);
            // As a rule none waits, and nothing is to be moved.
            let _ = match place == self.waiting.len() {
                true => self.waiting.push(frame),
                false => self.waiting.insert(place, frame),
            };
        }
        self.go_on();
    }

    /// Starts the frame that is due, or sets the timer to the next.
    fn go_on(&mut self) {
        while self.sending.is_none()
            && let Some(next) = self.waiting.last()
        {
            let ticks = next.at_ticks.saturating_sub(sys_tick::now_ticks());
            if ticks > 0 {
                return C::set_timer(u32::try_from(ticks).unwrap_or(u32::MAX));
            }
            let Some(frame) = self.waiting.pop() else {
                return;
            };
            if self.goes_by_plant {
                self.tell_plant(frame);
                continue;
            }
            self.sending = Some((frame, 0));
            C::want_sent(true);
            self.send();
        }
    }

    fn tell_plant(&mut self, frame: Owned) {
        let late_ticks = sys_tick::now_ticks().saturating_sub(frame.at_ticks);
        let late_ticks = u32::try_from(late_ticks).unwrap_or(u32::MAX);
        let late_ns = (late_ticks / C::TICKS_PER_US).saturating_mul(1_000)
            + late_ticks % C::TICKS_PER_US * 1_000 / C::TICKS_PER_US;
        let bytes = frame.bytes.get(..frame.length.into());
        // Where the plant went away, the slots notice.
        let _ = plant_frames::tell(frame.start_us, late_ns, bytes.unwrap_or_default());
        self.give_back(frame);
    }

    /// Moves a byte each way. To be called by the UART's interrupt.
    pub fn serve(&mut self) {
        C::acknowledge();
        if let Some(byte) = C::receive() {
            self.take(byte);
        }
        self.send();
        if self.sending.is_none() {
            self.go_on();
        }
    }

    fn send(&mut self) {
        let Some((frame, count)) = &mut self.sending else {
            return;
        };
        if !C::can_send() {
            return;
        }
        if let Some(byte) = frame.bytes.get(usize::from(*count)) {
            C::send(*byte);
            *count += 1;
        }
        if *count >= frame.length
            && let Some((frame, _)) = self.sending.take()
        {
            C::want_sent(false);
            self.give_back(frame);
        }
    }

    fn give_back(&mut self, frame: Owned) {
        // It was there before.
        let _ = self.sent.enqueue(frame);
    }

    fn take(&mut self, byte: u8) {
        if self.arriving.is_none() {
            self.arriving = self.read.dequeue().map(|buffer| {
                (buffer.length, buffer.is_too_long) = (0, false);
                buffer
            });
        }
        // Without one, all have arrived and none was received: what comes is lost.
        let Some(buffer) = &mut self.arriving else {
            return;
        };
        if byte != DELIMITER {
            let place = buffer.bytes.get_mut(usize::from(buffer.length));
            match place.filter(|_| usize::from(buffer.length) < MAX_STUFFED_BYTES) {
                Some(place) => {
                    *place = byte;
                    buffer.length += 1;
                }
                None => buffer.is_too_long = true,
            }
        } else if buffer.length > 0
            && let Some(buffer) = self.arriving.take()
        {
            buffer.at_ticks = sys_tick::now_ticks();
            let _ = self.arrived.enqueue(buffer);
        }
    }
}

/// The dispatchers' end.
pub struct FrameDevice<C> {
    end: DeviceEnd,
    clock: RobotClock,
    rate_bps: u32,
    /// There are frames of which the interrupt does not know yet.
    is_new: bool,
    goes_by_plant: bool,
    chip: PhantomData<C>,
}

/// The dispatchers' ends of the queues, for any chip.
struct DeviceEnd {
    ready: Producer<'static, Owned>,
    sent: Consumer<'static, Owned>,
    arrived: Consumer<'static, Owned>,
    read: Producer<'static, Owned>,
    /// A buffer for whose frame there were no bytes.
    spare: Option<Owned>,
    /// What has arrived, and later than it was asked for.
    next: Option<Owned>,
}

impl DeviceEnd {
    /// Fills a buffer, and hands it over. False if there is none.
    fn send(
        &mut self,
        start: (u64, u64),
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let Some(buffer) = self.spare.take().or_else(|| self.sent.dequeue()) else {
            return false;
        };
        let Ok(length) = wire::encode_with(header, payload_bytes, &mut buffer.bytes, write) else {
            self.spare = Some(buffer);
            return false;
        };
        buffer.length = length as u8;
        (buffer.start_us, buffer.at_ticks) = start;
        self.ready.enqueue(buffer).is_ok()
    }

    /// Gives what had arrived at this time.
    fn receive(
        &mut self,
        clock: &RobotClock,
        ticks_per_us: u32,
        until_us: u64,
        frames: &dyn InFrames,
        take: Taken<'_>,
    ) {
        // What arrives meanwhile is later.
        for _ in 0..=WAITING {
            let Some(buffer) = self.next.take().or_else(|| self.arrived.dequeue()) else {
                return;
            };
            let Some(at_us) = clock.us_by(until_us, buffer.at_ticks, ticks_per_us) else {
                self.next = Some(buffer);
                return;
            };
            let bytes = buffer.bytes.get_mut(..buffer.length.into());
            match bytes.filter(|_| !buffer.is_too_long) {
                Some(bytes) => take(receive(bytes, frames), at_us),
                None => take(Err(ReceiveError::TooLong), at_us),
            }
            let _ = self.read.enqueue(buffer);
        }
    }
}

impl<C: Chip> FrameDevice<C> {
    /// Takes over how robot time goes with the clock: an activation starts at this time by the one
    /// and by the other.
    #[inline(always)]
    pub fn note(&mut self, start_us: u64, start_ticks: u64) {
        self.clock.note(start_us, start_ticks, C::TICKS_PER_US);
    }

    /// Takes what the plant says that had arrived.
    fn receive_by_plant(&self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        // As many as there would be buffers for.
        for _ in 0..WAITING {
            let Some(mut message) = plant_frames::ask(until_us) else {
                return;
            };
            let at_us = message.at_us();
            match message.carried() {
                Some(bytes) => take(receive(bytes, frames), at_us),
                None => take(Err(ReceiveError::TooLong), at_us),
            }
        }
    }
}

impl<C: FrameUart> LinkDevice for FrameDevice<C> {
    fn set_rate(&mut self, rate_bps: u32) {
        if rate_bps != self.rate_bps {
            self.rate_bps = rate_bps;
            C::set_rate(rate_bps);
        }
    }

    fn send(
        &mut self,
        start_us: u64,
        header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let start = (start_us, self.clock.ticks(start_us, C::TICKS_PER_US));
        let is_sent = self.end.send(start, header, payload_bytes, write);
        self.is_new |= is_sent;
        is_sent
    }

    fn start_sending(&mut self) {
        if core::mem::take(&mut self.is_new) {
            C::call();
        }
    }

    fn receive(&mut self, until_us: u64, frames: &dyn InFrames, take: Taken<'_>) {
        if self.goes_by_plant {
            return self.receive_by_plant(until_us, frames, take);
        }
        let FrameDevice { end, clock, .. } = self;
        end.receive(clock, C::TICKS_PER_US, until_us, frames, take);
    }
}
