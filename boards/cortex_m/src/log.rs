//! The defmt logger: frames go into two rings in RAM, from which the link sends them when it can.
//!
//! Logging never waits for a wire and never delays a slot. The slot timer's handler has a ring of
//! its own, so that it needs no lock; all other contexts share the second, one frame at a time
//! inside a critical section (which the slot timer does not see). A frame that finds no room is
//! dropped whole and counted.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU8, AtomicU16, AtomicU32, Ordering};

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::VectActive;
use critical_section::RestoreState;
use defmt::{Encoder, Logger};

/// Bytes of each ring; a power of two, so that positions wrap without a division.
const RING_BYTES: usize = 256;
const _: () = assert!(RING_BYTES.is_power_of_two() && RING_BYTES < u16::MAX as usize / 2);

/// One producer, one consumer. Positions count bytes and wrap at 2^16.
struct Ring {
    bytes: [AtomicU8; RING_BYTES],
    /// Where the consumer reads next.
    head: AtomicU16,
    /// Where whole frames end; the consumer stops here.
    tail: AtomicU16,
    /// Where the frame that is being written ends.
    writing: AtomicU16,
    /// Set when the frame that is being written found no room.
    overflowed: AtomicU8,
    dropped_frames: AtomicU32,
    /// Of those, how many stood before what was read last.
    told_frames: AtomicU32,
    /// Where the first of the others was to begin.
    loss: AtomicU16,
}

impl Ring {
    const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; RING_BYTES],
            head: AtomicU16::new(0),
            tail: AtomicU16::new(0),
            writing: AtomicU16::new(0),
            overflowed: AtomicU8::new(0),
            dropped_frames: AtomicU32::new(0),
            told_frames: AtomicU32::new(0),
            loss: AtomicU16::new(0),
        }
    }

    fn byte(&self, position: u16) -> &AtomicU8 {
        &self.bytes[usize::from(position) % RING_BYTES]
    }

    fn begin_frame(&self) {
        self.writing
            .store(self.tail.load(Ordering::Relaxed), Ordering::Relaxed);
        self.overflowed.store(0, Ordering::Relaxed);
    }

    fn write(&self, bytes: &[u8]) {
        let mut writing = self.writing.load(Ordering::Relaxed);
        let used = writing.wrapping_sub(self.head.load(Ordering::Acquire));
        if usize::from(used) + bytes.len() > RING_BYTES {
            self.overflowed.store(1, Ordering::Relaxed);
            return;
        }
        for byte in bytes {
            self.byte(writing).store(*byte, Ordering::Relaxed);
            writing = writing.wrapping_add(1);
        }
        self.writing.store(writing, Ordering::Relaxed);
    }

    fn end_frame(&self) {
        if self.overflowed.load(Ordering::Relaxed) == 0 {
            let written = self.writing.load(Ordering::Relaxed);
            self.tail.store(written, Ordering::Release);
        } else {
            // Only the producer writes the count, so load and store suffice.
            let dropped = self.dropped_frames.load(Ordering::Relaxed);
            if dropped == self.told_frames.load(Ordering::Relaxed) {
                self.loss
                    .store(self.tail.load(Ordering::Relaxed), Ordering::Relaxed);
            }
            self.dropped_frames
                .store(dropped.wrapping_add(1), Ordering::Release);
        }
    }

    /// Moves bytes of whole frames into `buffer`, up to where frames are missing; returns how many.
    fn read(&self, buffer: &mut [u8]) -> usize {
        let head = self.head.load(Ordering::Relaxed);
        let mut ready = self.tail.load(Ordering::Acquire).wrapping_sub(head);
        let dropped = self.dropped_frames.load(Ordering::Acquire);
        if dropped != self.told_frames.load(Ordering::Relaxed) {
            let whole = self.loss.load(Ordering::Relaxed).wrapping_sub(head);
            // A place that was passed already lies behind: a frame was dropped while one before it
            // was told.
            if whole == 0 || usize::from(whole) > RING_BYTES {
                // Only the consumer writes this count.
                self.told_frames.store(dropped, Ordering::Relaxed);
            } else {
                ready = ready.min(whole);
            }
        }
        let mut read: u16 = 0;
        for (place, _) in buffer.iter_mut().zip(0..ready) {
            *place = self.byte(head.wrapping_add(read)).load(Ordering::Relaxed);
            read += 1;
        }
        self.head.store(head.wrapping_add(read), Ordering::Release);
        usize::from(read)
    }
}

/// A ring and the encoder of the frame that is being written to it.
struct Channel {
    ring: Ring,
    encoder: UnsafeCell<Encoder>,
}

// SAFETY: the ring is made of atomics. The encoder is used between `acquire` and `release` alone,
// by one context at a time: the slot timer's handler is the only user of its channel and cannot
// interrupt itself, and the other channel is inside a critical section.
unsafe impl Sync for Channel {}

impl Channel {
    const fn new() -> Self {
        Self {
            ring: Ring::new(),
            encoder: UnsafeCell::new(Encoder::new()),
        }
    }

    /// # Safety
    /// Only the context that has acquired the logger may call this.
    unsafe fn with_encoder(&self, act: impl FnOnce(&mut Encoder, &Ring)) {
        // SAFETY: the caller is the channel's only user, and no call of this is inside another.
        act(unsafe { &mut *self.encoder.get() }, &self.ring);
    }
}

static SLOTS: Channel = Channel::new();
static OTHERS: Channel = Channel::new();

/// What the critical section around a frame of [`OTHERS`] has to restore.
struct Restore(UnsafeCell<RestoreState>);
// SAFETY: written after the critical section is entered and read before it is left.
unsafe impl Sync for Restore {}
static RESTORE: Restore = Restore(UnsafeCell::new(RestoreState::invalid()));

/// Number of the slot timer's interrupt.
static SLOT_TIMER: AtomicU8 = AtomicU8::new(u8::MAX);

/// Says which interrupt is the slot timer's. To be called before interrupts are on.
pub fn start(slot_timer: impl InterruptNumber) {
    SLOT_TIMER.store(slot_timer.number() as u8, Ordering::Relaxed);
}

/// Whether the slot timer's handler is running. A handler above it must not log: it could interrupt
/// a frame.
fn in_slot_context() -> bool {
    let irqn = SLOT_TIMER.load(Ordering::Relaxed);
    SCB::vect_active() == VectActive::Interrupt { irqn }
}

fn channel() -> &'static Channel {
    if in_slot_context() { &SLOTS } else { &OTHERS }
}

#[defmt::global_logger]
struct RingLogger;

// SAFETY: `acquire` gives the context sole use of its channel until `release`; see `Channel`.
unsafe impl Logger for RingLogger {
    fn acquire() {
        if !in_slot_context() {
            // SAFETY: `release` leaves the section; defmt pairs the two in one context.
            let restore = unsafe { critical_section::acquire() };
            // SAFETY: inside the critical section, so nobody else of this channel is here.
            unsafe { *RESTORE.0.get() = restore };
        }
        // SAFETY: acquired above.
        unsafe {
            channel().with_encoder(|encoder, ring| {
                ring.begin_frame();
                encoder.start_frame(|bytes| ring.write(bytes));
            });
        }
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: the caller has acquired the logger.
        unsafe {
            channel().with_encoder(|encoder, ring| {
                encoder.end_frame(|bytes| ring.write(bytes));
                ring.end_frame();
            });
        }
        if !in_slot_context() {
            // SAFETY: still inside the critical section of `acquire`, which this leaves.
            unsafe { critical_section::release(*RESTORE.0.get()) };
        }
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: the caller has acquired the logger.
        unsafe {
            channel().with_encoder(|encoder, ring| encoder.write(bytes, |bytes| ring.write(bytes)));
        }
    }
}

/// Moves encoded log bytes into `buffer`; returns how many. For the link task alone. Frames of the
/// two rings are never mixed: a ring is read on until its last whole frame is out.
pub fn read(buffer: &mut [u8]) -> usize {
    let read = SLOTS.ring.read(buffer);
    if read > 0 {
        return read;
    }
    OTHERS.ring.read(buffer)
}

/// Frames that found no room since the start and stood before what was read last.
pub fn dropped_frames() -> u32 {
    let dropped = |channel: &Channel| channel.ring.told_frames.load(Ordering::Relaxed);
    dropped(&SLOTS).wrapping_add(dropped(&OTHERS))
}
