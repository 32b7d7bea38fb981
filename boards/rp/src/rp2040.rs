//! What the RP2040 has in another way than its successor: two cores of the kind Cortex-M0+, its
//! boot loader's second stage, and the names of some blocks.

use esm_link::message::ResetReason;
pub use rp2040_hal as hal;
use rp2040_hal::pac::{self, Interrupt, RESETS};

pub(crate) use pac::{TIMER, VREG_AND_CHIP_RESET as ChipReset, timer};

/// What the clocks are started with.
pub(crate) const SYSTEM_HZ: u32 = 125_000_000;
/// The interrupt of the slot timer.
pub(crate) const SLOT_TIMER: Interrupt = Interrupt::TIMER_IRQ_0;
/// An interrupt that no part has.
pub(crate) const CALL_USB: Interrupt = Interrupt::SW1_IRQ;
/// What the watchdog counts in a microsecond: it counts two at a time (RP2040-E1).
pub(crate) const WATCHDOG_COUNTS_PER_US: u32 = 2;
/// The product that the SDK of Raspberry Pi is for USB.
pub(crate) const USB_PRODUCT: u16 = 0x000A;

/// The second stage of the boot loader: how the flash is read.
#[unsafe(link_section = ".boot2")]
#[unsafe(no_mangle)]
#[used]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

/// The blocks that the chips have other names for: timer, cause of resets, USB and its memory.
macro_rules! own_blocks {
    ($chip:ident) => {
        (
            $chip.TIMER,
            $chip.VREG_AND_CHIP_RESET,
            $chip.USBCTRL_REGS,
            $chip.USBCTRL_DPRAM,
        )
    };
}
pub(crate) use own_blocks;

/// Brings the timer out of its reset.
pub(crate) fn release_timer(resets: &mut RESETS) {
    resets.reset().modify(|_, w| w.timer().clear_bit());
    while resets.reset_done().read().timer().bit_is_clear() {}
}

/// What the last reset of all of the chip was.
pub(crate) fn chip_reset(chip: &ChipReset) -> Option<ResetReason> {
    let cause = chip.chip_reset().read();
    if cause.had_run().bit_is_set() {
        Some(ResetReason::Pin)
    } else if cause.had_por().bit_is_set() {
        Some(ResetReason::PowerOn)
    } else {
        None
    }
}

/// Makes the firmware of a robot: see `app_of`.
#[macro_export]
macro_rules! app {
    (board($b:tt); $($firmware:tt)*) => {
        $crate::app_of! {
            board($b);
            interrupts(
                slots: TIMER_IRQ_0 = 4,
                wire: UART0_IRQ,
                usb: Usb(USBCTRL_IRQ, SW1_IRQ),
                link: SW0_IRQ,
            );
            $($firmware)*
        }
    };
}
