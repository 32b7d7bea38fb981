//! What is kept of the way to the plant across a reset, and the last exchange of a firmware that
//! ends.

use core::ptr;

use rt_firmware::body::{Actuators, Request};

use crate::crash::Uninit;
use crate::plant;

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
#[unsafe(link_section = ".uninit.last_exchange")]
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

/// How far the plant's time had come when the firmware ended. To be called once, at the start.
pub fn take() -> u64 {
    let exchanges = read();
    let known = exchanges.mark == MARK;
    let plant_time_us = if known { exchanges.plant_time_us } else { 0 };
    write(Exchanges {
        mark: MARK,
        sequence: 0,
        plant_time_us,
    });
    plant_time_us
}

/// Notes an exchange, so that [`motors_off`] can have one of its own.
pub fn note(request: &Request) {
    write(Exchanges {
        mark: MARK,
        sequence: request.sequence,
        plant_time_us: request.start_us,
    });
}

/// Tells the plant that the motors are off, where the firmware ends. From any context, also from
/// one that interrupted an exchange's bookkeeping.
pub fn motors_off() {
    let exchanges = read();
    // A motor driver of a real board would be switched off at its enable pin here; these pins are
    // the plant's.
    let _ = plant::exchange(&Request {
        sequence: exchanges.sequence.wrapping_add(1),
        start_us: exchanges.plant_time_us,
        effect_us: exchanges.plant_time_us,
        actuators: Actuators::default(),
    });
}
