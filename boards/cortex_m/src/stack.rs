//! How deep the stack went: it is painted at the start, and what has lost its paint was used.

use core::arch::asm;
use core::ptr;

const PAINT: u32 = 0xA110_CA7E;

unsafe extern "C" {
    /// Where the stack starts; it grows downwards. Set by the linker script of cortex-m-rt.
    static _stack_start: u32;
    /// The lowest address that the stack may use.
    static _stack_end: u32;
}

/// Addresses of the stack's lowest word and of the word above its highest.
fn bounds() -> (usize, usize) {
    (
        (&raw const _stack_end).addr(),
        (&raw const _stack_start).addr(),
    )
}

/// Paints the part of the stack that is not in use yet. To be called once, early, with interrupts
/// off.
pub fn paint() {
    let (mut address, _) = bounds();
    let top: usize;
    // SAFETY: reads the stack pointer, changes nothing.
    unsafe { asm!("mov {}, sp", out(reg) top, options(nomem, nostack, preserves_flags)) };
    while address < top {
        // SAFETY: the words between the end of the stack and the stack pointer belong to nobody:
        // the linker script puts no data there, and no interrupt, which would use them, is on yet.
        unsafe { ptr::write_volatile(address as *mut u32, PAINT) };
        address += size_of::<u32>();
    }
}

/// The most bytes of stack that were in use since [`paint`]. Takes a time that grows with what was
/// not used: some milliseconds.
pub fn deepest_bytes() -> u32 {
    let (mut address, start) = bounds();
    while address < start {
        // SAFETY: an aligned word inside the stack's memory; it may change while it is read, so it
        // is read volatile, and any value will do.
        if unsafe { ptr::read_volatile(address as *const u32) } != PAINT {
            break;
        }
        address += size_of::<u32>();
    }
    (start - address) as u32
}
