//! The critical section: all interrupts masked but the slot timer's.
//!
//! The core has no BASEPRI, so they are masked one by one in the NVIC. The slot timer's handler may
//! therefore not enter one to share data with the rest, which it does not: it uses single-producer
//! queues and atomics.

use critical_section::{Impl, RawRestoreState, set_impl};

use crate::hal::pac::{Interrupt, NVIC};

/// All interrupts of the core that a section masks.
const MASKED: u32 = !(1 << Interrupt::TIMER_IRQ_0 as u32);

struct AllButTheSlotTimer;
set_impl!(AllButTheSlotTimer);

// SAFETY: on a single core, data that is shared between contexts other than the slot timer's
// handler cannot be reached by two at a time while their interrupts are masked; sections nest,
// since each release unmasks only what its own acquire has masked.
unsafe impl Impl for AllButTheSlotTimer {
    unsafe fn acquire() -> RawRestoreState {
        // SAFETY: reads a register, then masks interrupts, which `release` unmasks again.
        let enabled = unsafe {
            let nvic = &*NVIC::PTR;
            let enabled = nvic.iser[0].read() & MASKED;
            nvic.icer[0].write(enabled);
            enabled
        };
        // So that none comes after this that was pending before.
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        enabled
    }

    unsafe fn release(enabled: RawRestoreState) {
        // SAFETY: unmasks what `acquire` has masked; the caller pairs them.
        unsafe { (*NVIC::PTR).iser[0].write(enabled) }
    }
}
