//! The critical section: BASEPRI raised to just below the slot timer.
//!
//! So nothing but the slot timer's handler and the watchdog's runs inside one, and nothing ever
//! delays a slot. The price is that these two may not enter one to share data with the rest, which
//! they do not: they use single-producer queues and atomics.

use core::arch::asm;

use cortex_m::register::basepri;
use critical_section::{Impl, RawRestoreState, set_impl};

/// RTIC priority of the slot timer. Only the watchdog's last word is above.
pub const SLOT_PRIORITY: u8 = 7;

/// BASEPRI that masks every priority below [`SLOT_PRIORITY`].
const BELOW_THE_SLOT_TIMER: u8 =
    ((1 << pac::NVIC_PRIO_BITS) - (SLOT_PRIORITY - 1)) << (8 - pac::NVIC_PRIO_BITS);

struct Basepri;
set_impl!(Basepri);

// SAFETY: on a single core, data that is shared between contexts up to the priority below the slot
// timer's cannot be reached by two at a time while BASEPRI masks them; sections nest, since each
// release restores what its acquire found, and BASEPRI is never lowered.
unsafe impl Impl for Basepri {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        // A context above (the slot timer's, the watchdog's) has priorities of its own that this
        // value does not mask. SAFETY: BASEPRI is only raised here, and `release` restores it.
        unsafe {
            // `basepri_max` semantics: written only if it raises the mask.
            asm!("msr BASEPRI_MAX, {}", in(reg) u32::from(BELOW_THE_SLOT_TIMER));
        }
        cortex_m::asm::isb();
        before
    }

    unsafe fn release(before: RawRestoreState) {
        // SAFETY: restores what `acquire` found; the caller pairs them.
        unsafe { basepri::write(before) }
    }
}
