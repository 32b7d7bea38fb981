//! What the chip says of its last reset.

use esm_link::message::ResetReason;

/// Bits of the register RESC: each stays set until it is cleared by software or by a power-on, so
/// that several may be.
const EXTERNAL: u32 = 1 << 0;
const POWER_ON: u32 = 1 << 1;
const BROWN_OUT: u32 = 1 << 2;
const WATCHDOG: u32 = 1 << 3;
const SOFTWARE: u32 = 1 << 4;

/// The reason that the register tells; `None` if it tells nothing, as an emulator that does not
/// model it.
///
/// A supply that comes on slowly sets power-on and brown-out, and one that sags sets brown-out
/// alone. What the firmware did itself comes last: it leaves words of its own.
pub fn reason(resc: u32) -> Option<ResetReason> {
    [
        (POWER_ON, ResetReason::PowerOn),
        (BROWN_OUT, ResetReason::BrownOut),
        (WATCHDOG, ResetReason::Watchdog),
        (EXTERNAL, ResetReason::Pin),
        (SOFTWARE, ResetReason::Software),
    ]
    .into_iter()
    .find_map(|(bit, reason)| (resc & bit != 0).then_some(reason))
}
