//! The board Raspberry Pi Pico: an RP2040 with two Cortex-M0+ cores at 125 MHz, 264 KiB of RAM and
//! 2 MiB of flash.
//!
//! The crate is what an RTIC app for this board is made of, and the app itself, as the macro
//! [`app!`]: a robot's firmware is its registry of tasks and one line.
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//!
//! pico::app! {
//!     firmware: "my robot 1.0",
//!     wiring: WIRING,
//!     robot: MyRobot = MyRobot::new,
//!     default_mission: include_bytes!("../stand_by.blob"),
//! }
//! ```
//!
//! Who runs at which priority, highest first:
//!
//! | priority | interrupt | does |
//! |---|---|---|
//! | 4 | timer 0 | the real-time side: slots, interpreter, real-time tasks |
//! | 3 | UART 0, USB, SW 1 (as SW 0) | bytes between the wires and the queues; listens for stops |
//! | 2 | SW 0 (no part has it; pended by software) | the link: requests, upload, trace and log streams |
//! | 0 | none: the idle loop | background tasks; sleep |
//!
//! Each may interrupt those below it. A critical section masks everything but the slot timer
//! ([`critical`]), so nothing delays a slot. The sides share nothing but queues with one reader and
//! one writer. The watchdog has no interrupt of its own: it resets the chip ([`watchdog`]).
//!
//! All of this is core 0. Core 1 sleeps in the chip's boot ROM: what shares memory with the slots
//! could make them wait, and there is nothing yet that needs a second core.
//!
//! All code runs from RAM (`pico.x`), so that slots go on while the [`flash`] is erased and
//! written. Encoders and echoes are counted by the chip's PIO blocks, and no task waits for them:
//! [`encoders`], [`sonars`].
#![no_std]

pub mod analog;
pub mod clock;
pub mod crash;
pub mod critical;
pub mod encoders;
#[cfg(feature = "store")]
pub mod flash;
#[cfg(not(feature = "store"))]
pub use cortex_m_board::no_flash as flash;
mod free_pins;
pub mod line;
pub mod motors;
pub mod outputs;
pub mod pins;
pub mod slots;
pub mod sonars;
pub mod uart;
pub mod usb;
pub mod watchdog;
pub mod wiring;

mod app;

use core::mem::MaybeUninit;

use cortex_m_board::stack;
use esm_link::message::ResetReason;
use rp2040_hal::clocks::{ClocksManager, init_clocks_and_plls};
use rp2040_hal::gpio;
use rp2040_hal::pac::Peripherals;
use rp2040_hal::sio::Sio;
use rp2040_hal::usb::UsbBus;
use rp2040_hal::vector_table::VectorTable;
use usb_device::bus::UsbBusAllocator;

pub use pins::Parts;
use slots::SlotBoard;
use usb::Usb;
use wiring::Wiring;

#[doc(hidden)]
pub use cortex_m_board::put;
#[doc(hidden)]
pub use {cortex_m, cortex_m_board, heapless, rp2040_hal, rt_firmware, rtic, usb_device};

/// Name of the board, as it tells it over the link.
pub const NAME: &str = "pico";

/// What `board.toml` says, as constants.
pub mod settings {
    include!(concat!(env!("OUT_DIR"), "/settings.rs"));
}

pub use settings::Memory;

/// The second stage of the boot loader: how the flash of a Pico is read.
#[unsafe(link_section = ".boot2")]
#[unsafe(no_mangle)]
#[used]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

/// The crystal of a Pico.
const CRYSTAL_HZ: u32 = 12_000_000;

#[cfg(feature = "log")]
defmt::timestamp!("{=u64:us}", clock::now_us());

/// What the first code of the firmware finds out and makes.
pub struct Start<const SONARS: usize> {
    /// Why the firmware starts.
    pub reset: ResetReason,
    /// The board for the slot timer's handler.
    pub board: SlotBoard,
    /// The robot's pins.
    pub parts: Parts<SONARS>,
    /// USB, the other serial line.
    pub usb: Usb,
}

/// Brings up stack paint, clocks, serial line and pins. To be called once, first of all, with
/// interrupts off.
///
/// # Panics
/// If it is called again, the crystal does not swing, or two parts have one pin.
pub fn start<const SONARS: usize>(
    vectors: &'static mut VectorTable,
    usb_bus: &'static mut MaybeUninit<UsbBusAllocator<UsbBus>>,
    wiring: &Wiring<SONARS>,
) -> Start<SONARS> {
    stack::paint();
    #[cfg(feature = "log")]
    cortex_m_board::log::start(rp2040_hal::pac::Interrupt::TIMER_IRQ_0);
    let Some(mut chip) = Peripherals::take() else {
        panic!("the board is started once");
    };
    let reset = crash::take(&chip.VREG_AND_CHIP_RESET, &chip.WATCHDOG);
    let mut ppb = chip.PPB;
    vectors.init(&mut ppb);
    // SAFETY: the table was just filled with the one that is in use.
    unsafe { vectors.activate(&mut ppb) };
    let mut watchdog = rp2040_hal::Watchdog::new(chip.WATCHDOG);
    let clocks = init_clocks_and_plls(
        CRYSTAL_HZ,
        chip.XOSC,
        chip.CLOCKS,
        chip.PLL_SYS,
        chip.PLL_USB,
        &mut chip.RESETS,
        &mut watchdog,
    );
    let Ok(clocks) = clocks else {
        panic!("the crystal of {CRYSTAL_HZ} Hz does not swing");
    };
    clock::start(chip.TIMER, &mut chip.RESETS);
    let clock_hz = peripheral_hz(&clocks);
    let usb_bus = usb_bus.write(UsbBusAllocator::new(UsbBus::new(
        chip.USBCTRL_REGS,
        chip.USBCTRL_DPRAM,
        clocks.usb_clock,
        true,
        &mut chip.RESETS,
    )));
    let Some(usb) = Usb::new(usb_bus) else {
        panic!("the device has room for its texts");
    };
    let sio = Sio::new(chip.SIO);
    let pins = gpio::Pins::new(
        chip.IO_BANK0,
        chip.PADS_BANK0,
        sio.gpio_bank0,
        &mut chip.RESETS,
    );
    let (parts, led) = pins::Blocks {
        pwm: chip.PWM,
        pio0: chip.PIO0,
        pio1: chip.PIO1,
        adc: chip.ADC,
        uart0: chip.UART0,
    }
    .into_parts(wiring, pins, clock_hz, &mut chip.RESETS);
    crash::log_reset(reset);
    Start {
        reset,
        board: SlotBoard::new(watchdog, led),
        parts,
        usb,
    }
}

/// The clock of the peripherals in hertz.
fn peripheral_hz(clocks: &ClocksManager) -> u32 {
    use rp2040_hal::Clock;
    clocks.peripheral_clock.freq().to_Hz()
}
