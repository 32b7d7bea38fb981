//! Why the firmware ended, kept in RAM that no start-up code clears, and told after the reset.
//!
//! Everything that ends the firmware comes through [`end`]: motors off, reason kept, reset. A reset that left no reason was the watchdog's
//! own (interrupts were masked for good) or came from outside.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr;

use cortex_m::peripheral::SCB;
use cortex_m_rt::{ExceptionFrame, exception};
use rt_firmware::body::{Actuators, Request};
use rt_firmware::link::message::ResetReason;

use crate::plant;

/// What ended the firmware, or started it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Power was switched on: the RAM held nothing of ours.
    PowerOn,
    /// A panic, at this line of its file.
    Panic {
        /// The line.
        line: u32,
    },
    /// A fault of the core, at this address.
    HardFault {
        /// The program counter.
        address: u32,
    },
    /// The slot timer's handler did not return in time: a task never returned, or interrupts were masked for good.
    Watchdog,
}

impl From<Cause> for ResetReason {
    fn from(cause: Cause) -> Self {
        match cause {
            Cause::PowerOn => ResetReason::PowerOn,
            Cause::Panic { .. } => ResetReason::Panic,
            Cause::HardFault { .. } => ResetReason::CpuFault,
            Cause::Watchdog => ResetReason::Watchdog,
        }
    }
}

/// The kept words. Every bit pattern is valid, so reading what power-on left there is harmless.
#[derive(Clone, Copy)]
#[repr(C)]
struct Kept {
    /// Tells whether the rest was written by this module.
    mark: u32,
    code: u32,
    detail: u32,
    /// Sequence of the last exchange, so that the last word of a dying firmware is not a stale one.
    sequence: u32,
    plant_time_us: u64,
}

const MARK: u32 = 0x6576_6F52;

const NO_REASON: u32 = 0;
const PANIC: u32 = 1;
const HARD_FAULT: u32 = 2;
const WATCHDOG: u32 = 3;

struct KeptCell(UnsafeCell<MaybeUninit<Kept>>);
// SAFETY: it is touched through `read` and `write` below, with volatile accesses of plain words on a single core; a torn one can at worst
// tell a wrong reason.
unsafe impl Sync for KeptCell {}

#[unsafe(link_section = ".uninit.post_mortem")]
static KEPT: KeptCell = KeptCell(UnsafeCell::new(MaybeUninit::uninit()));

fn read() -> Kept {
    // SAFETY: the memory is RAM, aligned for `Kept`, every bit pattern of which is valid; volatile keeps the compiler from reasoning about what
    // it never saw written.
    unsafe { ptr::read_volatile(KEPT.0.get().cast::<Kept>()) }
}

fn write(kept: Kept) {
    // SAFETY: as for `read`; nobody holds a reference into it.
    unsafe { ptr::write_volatile(KEPT.0.get().cast::<Kept>(), kept) }
}

/// How the last run ended, and how far the plant's time had come. To be called once, at the start; it clears what was kept.
pub fn take() -> (Cause, u64) {
    let kept = read();
    let known = kept.mark == MARK;
    let plant_time_us = if known { kept.plant_time_us } else { 0 };
    write(Kept {
        mark: MARK,
        code: NO_REASON,
        detail: 0,
        sequence: 0,
        plant_time_us,
    });
    let cause = match (known, kept.code) {
        (false, _) => Cause::PowerOn,
        (true, PANIC) => Cause::Panic { line: kept.detail },
        (true, HARD_FAULT) => Cause::HardFault {
            address: kept.detail,
        },
        (true, _) => Cause::Watchdog,
    };
    (cause, plant_time_us)
}

/// Notes the last exchange, so that [`end`] can have one of its own.
pub fn note_exchange(request: &Request) {
    let mut kept = read();
    kept.sequence = request.sequence;
    kept.plant_time_us = request.start_us;
    write(kept);
}

/// Ends the firmware: motors off, `cause` kept, reset. From any context, also from one that interrupted an exchange's bookkeeping.
pub fn end(cause: Cause) -> ! {
    cortex_m::interrupt::disable();
    let (code, detail) = match cause {
        Cause::PowerOn => (NO_REASON, 0),
        Cause::Panic { line } => (PANIC, line),
        Cause::HardFault { address } => (HARD_FAULT, address),
        Cause::Watchdog => (WATCHDOG, 0),
    };
    let kept = read();
    write(Kept {
        code,
        detail,
        ..kept
    });
    // A motor driver of a real board would be switched off at its enable pin here; this board's pins are the plant's.
    let _ = plant::exchange(&Request {
        sequence: kept.sequence.wrapping_add(1),
        start_us: kept.plant_time_us,
        effect_us: kept.plant_time_us,
        actuators: Actuators::default(),
    });
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    // The message stays in the code's panic location; formatting it would cost kilobytes of flash.
    end(Cause::Panic {
        line: info.location().map_or(0, |location| location.line()),
    })
}

// SAFETY: the handler neither returns nor trusts the state that it interrupted.
#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    end(Cause::HardFault {
        address: frame.pc(),
    })
}
