//! What boards with a chip of Raspberry Pi have in common, be it an RP2040 or an RP2350: a board's
//! crate is its settings, its memory and a line of [`board!`].
//!
//! Both chips have the same PIO, PWM, converter, UART, USB and timer, and HALs of one family, by
//! the same names. Where they differ stands in a file for each, `rp2040` and `rp2350`: the blocks'
//! names, the clock, the interrupts, what the boot ROM looks for, and why the chip was reset. The
//! RP2040's cores have no BASEPRI, so that its critical section masks interrupts one by one
//! (`nvic`).
//!
//! Who runs at which priority, highest first:
//!
//! | RP2040 | RP2350 | interrupt | does |
//! |---|---|---|---|
//! | 4 | 7 | the timer's first | the real-time side: slots, interpreter, real-time tasks |
//! | 3 | 3 | UART 0, USB, SW 1 | bytes between the wires and the queues; listens for stops |
//! | 2 | 2 | SW 0 (no part has it; pended by software) | the link: requests, upload, trace and log streams |
//! | 0 | 0 | none: the idle loop | background tasks; sleep |
//!
//! Each may interrupt those below it. A critical section masks everything but the slot timer, so
//! nothing delays a slot. The sides share nothing but queues with one reader and one writer. The
//! watchdog has no interrupt of its own: it resets the chip ([`watchdog`]).
//!
//! All of this is core 0. Core 1 sleeps in the chip's boot ROM: what shares memory with the slots
//! could make them wait, and there is nothing yet that needs a second core.
//!
//! All code runs from RAM (`rp.x`), so that slots go on while the `flash` is erased and written.
//! Encoders and echoes are counted by the chip's PIO blocks, and no task waits for them:
//! [`encoders`], [`sonars`].
#![no_std]

pub mod analog;
pub mod clock;
pub mod crash;
pub mod encoders;
#[cfg(feature = "store")]
pub mod flash;
mod free_pins;
#[cfg(feature = "i2c")]
pub mod i2c;
pub mod line;
pub mod motors;
#[cfg(feature = "rp2040")]
mod nvic;
pub mod outputs;
pub mod pins;
#[cfg(feature = "rp2040")]
mod rp2040;
#[cfg(feature = "rp2040")]
use rp2040 as chip;
#[cfg(feature = "rp2350")]
mod rp2350;
#[cfg(feature = "rp2350")]
use rp2350 as chip;
pub mod slots;
pub mod sonars;
pub mod uart;
pub mod usb;
pub mod watchdog;
pub mod wiring;

mod app;
mod board;

use cortex_m::singleton;
use cortex_m_board::sides::Start;
use cortex_m_board::stack;
use hal::clocks::{ClocksManager, init_clocks_and_plls};
use hal::gpio;
pub use hal::pac;
use hal::sio::Sio;
use hal::usb::UsbBus;
use hal::vector_table::VectorTable;
use usb_device::bus::UsbBusAllocator;

pub use pins::Parts;
use slots::{OwnParts, SlotBoard};
use wiring::Wiring;

/// The chip's HAL.
pub use chip::hal;
/// The clock's alarm starts the slots.
pub use clock as slot_timer;
#[doc(hidden)]
pub use {cortex_m, cortex_m_board, heapless, rt_firmware, rtic, usb_device};

/// The crystal of a Pico, and of its successor.
const CRYSTAL_HZ: u32 = 12_000_000;

#[cfg(feature = "log")]
defmt::timestamp!("{=u64:us}", clock::now_us());

/// Brings up stack paint, clocks, serial line and pins. To be called once, first of all, with
/// interrupts off. `product` is what the board is called on the bus.
///
/// # Panics
/// If it is called again, the crystal does not swing, or two parts have one pin.
pub fn start<const SONARS: usize>(
    product: &'static str,
    wiring: &Wiring<SONARS>,
) -> Start<SlotBoard, Parts<SONARS>> {
    stack::paint();
    #[cfg(feature = "log")]
    cortex_m_board::log::start(chip::SLOT_TIMER);
    let Some(mut chip) = pac::Peripherals::take() else {
        panic!("the board is started once");
    };
    let (timer, chip_reset, usb, usb_memory) = chip::own_blocks!(chip);
    let reset = crash::take(&chip_reset, &chip.WATCHDOG);
    let mut ppb = chip.PPB;
    static mut VECTORS: VectorTable = VectorTable::new();
    let vectors = &raw mut VECTORS;
    // SAFETY: it is reached here alone, once, since the blocks were taken above; it is filled with
    // the table that is in use.
    unsafe {
        let vectors = &mut *vectors;
        vectors.init(&mut ppb);
        vectors.activate(&mut ppb);
    }
    let mut watchdog = hal::Watchdog::new(chip.WATCHDOG);
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
    clock::release(timer, &mut chip.RESETS);
    let clock_hz = peripheral_hz(&clocks);
    let usb_bus = singleton!(: UsbBusAllocator<UsbBus> = UsbBusAllocator::new(UsbBus::new(
        usb,
        usb_memory,
        clocks.usb_clock,
        true,
        &mut chip.RESETS,
    )));
    let device = usb_bus.and_then(|bus| usb::Device::new(bus, usb::SERIAL_PORT, product));
    let Some(device) = device else {
        panic!("the device has room for its texts");
    };
    let sio = Sio::new(chip.SIO);
    let pins = gpio::Pins::new(
        chip.IO_BANK0,
        chip.PADS_BANK0,
        sio.gpio_bank0,
        &mut chip.RESETS,
    );
    let (parts, stop_button, led) = pins::Blocks {
        pwm: chip.PWM,
        pio0: chip.PIO0,
        pio1: chip.PIO1,
        adc: chip.ADC,
        uart0: chip.UART0,
    }
    .into_parts(wiring, pins, clock_hz, &mut chip.RESETS);
    crash::log_reset(reset);
    let own = OwnParts {
        led,
        usb: singleton!(: usb::Device = device),
    };
    Start {
        reset,
        board: SlotBoard::new(own, stop_button),
        parts,
    }
}

/// The clock of the peripherals in hertz.
fn peripheral_hz(clocks: &ClocksManager) -> u32 {
    use hal::Clock;
    clocks.peripheral_clock.freq().to_Hz()
}
