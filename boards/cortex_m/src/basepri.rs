//! The critical section of cores with BASEPRI (ARMv7-M): it is raised to just below the slot timer.
//!
//! So nothing but the slot timer's handler and what is above it runs inside one, and nothing ever
//! delays a slot. The price is that these may not enter one to share data with the rest, which they
//! do not: they use single-producer queues and atomics.

use core::arch::asm;

use cortex_m::register::basepri;
use critical_section::{Impl, RawRestoreState};

#[cfg(feature = "selftest")]
use crate::section_time;

/// RTIC priority of the slot timer. Only a watchdog's last word is above.
pub const SLOT_PRIORITY: u8 = 7;

/// The section, for a chip with so many bits of a priority: to be given to
/// `critical_section::set_impl`.
pub struct BelowTheSlots<const PRIORITY_BITS: u8>;

impl<const PRIORITY_BITS: u8> BelowTheSlots<PRIORITY_BITS> {
    /// BASEPRI that masks every priority below [`SLOT_PRIORITY`].
    const BASEPRI: u8 = ((1 << PRIORITY_BITS) - (SLOT_PRIORITY - 1)) << (8 - PRIORITY_BITS);
}

// SAFETY: on a single core, data that is shared between contexts up to the priority below the slot
// timer's cannot be reached by two at a time while BASEPRI masks them; sections nest, since each
// release restores what its acquire found, and BASEPRI is never lowered.
unsafe impl<const PRIORITY_BITS: u8> Impl for BelowTheSlots<PRIORITY_BITS> {
    unsafe fn acquire() -> RawRestoreState {
        let before = basepri::read();
        // A context above has priorities of its own that this value does not mask. SAFETY: BASEPRI
        // is only raised here, and `release` restores it.
        unsafe {
            // `basepri_max` semantics: written only if it raises the mask.
            asm!("msr BASEPRI_MAX, {}", in(reg) u32::from(Self::BASEPRI));
        }
        cortex_m::asm::isb();
        #[cfg(feature = "selftest")]
        if before == 0 {
            section_time::begin();
        }
        before
    }

    unsafe fn release(before: RawRestoreState) {
        #[cfg(feature = "selftest")]
        if before == 0 {
            section_time::end();
        }
        // SAFETY: restores what `acquire` found; the caller pairs them.
        unsafe { basepri::write(before) }
    }
}
