//! What the chip says of its last reset.

use esm_link::message::ResetReason;

/// Bits of the register RCC_CSR: each stays set until it is cleared by software or by a power-on,
/// so that several may be.
const BROWN_OUT: u32 = 1 << 25;
const PIN: u32 = 1 << 26;
const POWER_ON: u32 = 1 << 27;
const SOFTWARE: u32 = 1 << 28;
const WATCHDOG: u32 = 1 << 29;

/// The reason that the register tells; `None` if it tells nothing, as an emulator that does not
/// model it.
///
/// A power-on sets brown-out, too, and each reset pulls the pin, which so comes last.
pub fn reason(csr: u32) -> Option<ResetReason> {
    [
        (POWER_ON, ResetReason::PowerOn),
        (BROWN_OUT, ResetReason::BrownOut),
        (WATCHDOG, ResetReason::Watchdog),
        (SOFTWARE, ResetReason::Software),
        (PIN, ResetReason::Pin),
    ]
    .into_iter()
    .find_map(|(bit, reason)| (csr & bit != 0).then_some(reason))
}
