//! What the RP2350 has in another way than its predecessor: two cores of the kind Cortex-M33, what
//! its boot ROM looks for in the flash, and the names of some blocks.

use cortex_m_board::basepri::BelowTheSlots;
use esm_link::message::ResetReason;
pub use rp235x_hal as hal;
use rp235x_hal::block::ImageDef;
use rp235x_hal::pac::{self, Interrupt, RESETS};

pub(crate) use pac::{POWMAN as ChipReset, TIMER0 as TIMER, timer0 as timer};

critical_section::set_impl!(BelowTheSlots<{ pac::NVIC_PRIO_BITS }>);

/// What the clocks are started with.
pub(crate) const SYSTEM_HZ: u32 = 150_000_000;
/// The interrupt of the slot timer.
pub(crate) const SLOT_TIMER: Interrupt = Interrupt::TIMER0_IRQ_0;
/// An interrupt that no part has.
pub(crate) const CALL_USB: Interrupt = Interrupt::SW1_IRQ;
/// What the watchdog counts in a microsecond.
pub(crate) const WATCHDOG_COUNTS_PER_US: u32 = 1;
/// The product that the SDK of Raspberry Pi is for USB.
pub(crate) const USB_PRODUCT: u16 = 0x0009;

/// What the boot ROM looks for in the first 4 KiB of the flash (data sheet of the RP2350, 5.9): a
/// program of the secure state, whose vectors are at the beginning.
#[unsafe(link_section = ".start_block")]
#[used]
static IMAGE: ImageDef = ImageDef::secure_exe();

/// The blocks that the chips have other names for: timer, cause of resets, USB and its memory.
macro_rules! own_blocks {
    ($chip:ident) => {
        ($chip.TIMER0, $chip.POWMAN, $chip.USB, $chip.USB_DPRAM)
    };
}
pub(crate) use own_blocks;

/// Brings the timer out of its reset.
pub(crate) fn release_timer(resets: &mut RESETS) {
    resets.reset().modify(|_, w| w.timer0().clear_bit());
    while resets.reset_done().read().timer0().bit_is_clear() {}
}

/// What the last reset of all of the chip was.
pub(crate) fn chip_reset(chip: &ChipReset) -> Option<ResetReason> {
    let cause = chip.chip_reset().read();
    if cause.had_run_low().bit_is_set() {
        Some(ResetReason::Pin)
    } else if cause.had_bor().bit_is_set() {
        Some(ResetReason::BrownOut)
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
                slots: TIMER0_IRQ_0 = 7,
                wire: UART0_IRQ,
                usb: Usb(USBCTRL_IRQ, SW1_IRQ),
                link: SW0_IRQ,
            );
            $($firmware)*
        }
    };
}
