//! The board lm3s6965evb: a Cortex-M3 with 256 KiB of flash and 64 KiB of RAM, as QEMU emulates it.
//!
//! The crate is what an RTIC app for this board is made of, and the app itself, as the
//! macro [`app!`]: a robot's firmware is its registry of tasks and one line.
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//!
//! lm3s6965::app! {
//!     firmware: "my robot 1.0",
//!     robot: MyRobot<'static> = MyRobot::new,
//!     emergency_stop: StopPin<'static> = lm3s6965::PINS.stop_button(),
//!     default_mission: include_bytes!("../stand_by.blob"),
//! }
//! ```
//!
//! Who runs at which priority, highest first:
//!
//! | priority | interrupt | does |
//! |---|---|---|
//! | 8 | watchdog | crash report of a firmware whose slots have stopped |
//! | 8 | timer 2, UART 1 | with the feature `links`: starts and bytes of frames (`frames`) |
//! | 7 | timer 0 | the real-time side: slots, interpreter, real-time tasks, exchange with the plant |
//! | 3 | UART 0 | bytes between the wire and the queues; listens for stops |
//! | 3 | timer 1 | the same, where the plant carries the link ([`cortex_m_board::plant_line`]) |
//! | 2 | SSI 0 (an unused vector, pended by software) | the link: requests, upload, trace and log streams |
//! | 0 | none: the idle loop | background tasks; sleep |
//!
//! A critical section masks everything below the slot timer ([`cortex_m_board::basepri`]), so
//! nothing delays a slot. The sides share nothing but queues with one reader and one writer.
//!
//! Nothing here names a robot: pins are an image ([`PINS`]) whose other end is the simulated plant
//! ([`plant`]).
#![no_std]

pub mod clock;
#[cfg(feature = "store")]
pub mod flash;
#[cfg(not(feature = "store"))]
pub use cortex_m_board::no_flash as flash;
#[cfg(feature = "links")]
pub mod frames;
pub mod line;
mod line_timer;
pub mod post_mortem;
pub mod registers;
pub mod reset_cause;
pub mod slot_timer;
pub mod slots;
pub mod uart;
pub mod watchdog;

mod app;

use cortex_m_board::basepri::BelowTheSlots;
#[cfg(feature = "log")]
use cortex_m_board::log;
use cortex_m_board::sides::Start;
use cortex_m_board::{crash, plant, stack};
use slots::SlotBoard;

pub use cortex_m_board::console;
pub use cortex_m_board::plant_board::PINS;

#[doc(hidden)]
pub use cortex_m_rt as rt;
#[doc(hidden)]
pub use {cortex_m, cortex_m_board, heapless, pac, rt_firmware, rtic};

/// Name of the board, as it tells it over the link.
pub const NAME: &str = "lm3s6965";

/// What `board.toml` says, as constants.
pub mod settings {
    include!(concat!(env!("OUT_DIR"), "/settings.rs"));
}

pub use settings::Memory;

#[cfg(feature = "log")]
defmt::timestamp!("{=u64:us}", clock::now_us());

critical_section::set_impl!(BelowTheSlots<{ pac::NVIC_PRIO_BITS }>);

/// The chip, for what [`cortex_m_board`] asks of it.
#[derive(Debug)]
pub struct Lm3s6965;

/// The robot's pins.
pub type Parts = rt_firmware::body::Parts<'static>;

/// Brings up stack paint, clock, serial line and the way to the plant. To be called once, first of
/// all, with interrupts off.
pub fn start() -> Start<SlotBoard, Parts> {
    stack::paint();
    #[cfg(feature = "log")]
    log::start(pac::Interrupt::TIMER_0A);
    clock::start();
    uart::start();
    plant::open();
    let (reset, plant_time_us) = post_mortem::take();
    crash::log_reset(reset);
    Start {
        reset,
        board: SlotBoard::new(plant_time_us),
        parts: PINS.parts(),
    }
}
