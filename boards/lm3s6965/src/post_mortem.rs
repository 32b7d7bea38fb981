//! Why the firmware ended, and what happened last, kept in RAM that no start-up code clears, and
//! told after the reset.
//!
//! Everything that ends the firmware comes through [`end`]: motors off, reason kept, reset. A reset
//! that left no reason was the watchdog's own (interrupts were masked for good) or came from
//! outside: then the chip's own register says more.

use core::ptr;

use cortex_m_board::crash::{self, Uninit};
use esm_link::message::ResetReason;
use rt_firmware::body::{Actuators, Request};
use rt_firmware::retained_ram::CrashCause;

use crate::registers::system_control;
use crate::{plant, reset_cause};

pub use crash::kept;

/// What is kept of the way to the plant. Every bit pattern is valid, so reading what power-on left
/// there is harmless.
#[derive(Clone, Copy)]
#[repr(C)]
struct Exchanges {
    /// Tells whether the rest was written by this module.
    mark: u32,
    /// Sequence of the last exchange, so that the last word of a dying firmware is not a stale one.
    sequence: u32,
    plant_time_us: u64,
}

const MARK: u32 = 0x6576_6F53;

// Touched through `read` and `write` alone, with volatile accesses of plain words on a single core;
// a torn one can at worst tell a wrong time.
#[unsafe(link_section = ".uninit.post_mortem")]
static EXCHANGES: Uninit<Exchanges> = Uninit::new();

fn read() -> Exchanges {
    // SAFETY: the memory is RAM, aligned for `Exchanges`, every bit pattern of which is valid;
    // volatile keeps the compiler from reasoning about what it never saw written.
    unsafe { ptr::read_volatile(EXCHANGES.get()) }
}

fn write(exchanges: Exchanges) {
    // SAFETY: as for `read`; nobody holds a reference into it.
    unsafe { ptr::write_volatile(EXCHANGES.get(), exchanges) }
}

/// Value for PBORCTL with which a supply that sags resets the chip, and is told as that. After a
/// reset the register says that it shall be an interrupt, with the same times.
const RESET_ON_BROWN_OUT: u32 = 0x7FFF;

/// Why the firmware starts, and how far the plant's time had come. To be called once, at the start.
pub fn take() -> (ResetReason, u64) {
    let exchanges = read();
    let known = exchanges.mark == MARK;
    let plant_time_us = if known { exchanges.plant_time_us } else { 0 };
    write(Exchanges {
        mark: MARK,
        sequence: 0,
        plant_time_us,
    });
    let hardware = reset_cause::reason(system_control::RESC.read());
    // Each bit stays until it is cleared: the next reset is to be told from this one.
    system_control::RESC.write(0);
    system_control::PBORCTL.write(RESET_ON_BROWN_OUT);
    (kept().begin(hardware), plant_time_us)
}

/// Notes the last exchange, so that [`end`] can have one of its own.
pub fn note_exchange(request: &Request) {
    write(Exchanges {
        mark: MARK,
        sequence: request.sequence,
        plant_time_us: request.start_us,
    });
}

/// Ends the firmware: motors off, the reason kept, reset. From any context, also from one that
/// interrupted an exchange's bookkeeping.
pub fn end(cause: &CrashCause<'_>) -> ! {
    crash::end(cause, || {
        let exchanges = read();
        // A motor driver of a real board would be switched off at its enable pin here; this board's
        // pins are the plant's.
        let _ = plant::exchange(&Request {
            sequence: exchanges.sequence.wrapping_add(1),
            start_us: exchanges.plant_time_us,
            effect_us: exchanges.plant_time_us,
            actuators: Actuators::default(),
        });
    })
}

cortex_m_board::crash_handlers!(end);
