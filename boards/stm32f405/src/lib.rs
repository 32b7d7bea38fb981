//! The board STM32F405: a Cortex-M4F at 168 MHz with 1 MiB of flash and 128 KiB of RAM.
//!
//! The crate is what an RTIC app for this board is made of, and the app itself, as the
//! macro [`app!`]: a robot's firmware is its registry of tasks and one line.
//!
//! ```ignore
//! #![no_std]
//! #![no_main]
//!
//! stm32f405::app! {
//!     firmware: "my robot 1.0",
//!     robot: MyRobot = MyRobot::new,
//!     default_mission: include_bytes!("../stand_by.blob"),
//! }
//! ```
//!
//! Who runs at which priority, highest first:
//!
//! | priority | interrupt | does |
//! |---|---|---|
//! | 8 | TIM12, CAN 1 RX0, not in the emulator | frames of missions' links |
//! | 8 | TIM3, USART 2, in the emulator with the feature `links` | the same |
//! | 7 | TIM2 | the real-time side: slots, interpreter, real-time tasks |
//! | 3 | TIM7, in the emulator USART 1 | bytes between the wire and the queues; listens for stops |
//! | 3 | TIM5, in the emulator | the same, where the plant carries the link |
//! | 2 | CAN2 SCE (an unused vector, pended by software) | the link: requests, upload, trace and log streams |
//! | 0 | none: the idle loop | background tasks; sleep |
//!
//! Each may interrupt those below it. A critical section masks everything below the slot timer
//! ([`cortex_m_board::basepri`]), so nothing delays a slot. The sides share nothing but queues with
//! one reader and one writer.
//!
//! With the feature `emulation` the firmware is for QEMU's machine `netduinoplus2`, which has
//! neither clock tree nor pins of the chip: the body is the plant's. Without it, it is for a part
//! of silicon.
#![no_std]

pub mod clock;
#[cfg(all(feature = "store", feature = "emulation"))]
pub mod flash {
    //! The flash that missions are kept in: the plant's.
    cortex_m_board::plant_flash!(crate::Stm32f405, crate::settings::BLOB_BYTES);
}
#[cfg(not(feature = "store"))]
pub use cortex_m_board::no_flash as flash;
#[cfg(all(feature = "can", not(feature = "emulation")))]
pub use silicon::can as frames;
#[cfg(all(feature = "store", not(feature = "emulation")))]
pub use silicon::flash;
#[cfg(not(feature = "emulation"))]
pub use silicon::uart_dma as uart;
#[cfg(feature = "links")]
pub mod frames;
pub mod line;
pub mod post_mortem;
pub mod reset_cause;
#[cfg(not(feature = "emulation"))]
pub mod silicon;
pub mod slot_timer;
pub mod slots;
#[cfg(feature = "emulation")]
pub mod uart;
pub mod usart;
pub mod watchdog;

mod app;

use cortex_m_board::basepri::BelowTheSlots;
use cortex_m_board::sides::Start;
use cortex_m_board::{crash, stack};

use slots::SlotBoard;

#[cfg(feature = "emulation")]
pub use cortex_m_board::plant_board::PINS;

#[doc(hidden)]
pub use stm32f4::stm32f405 as pac;
#[doc(hidden)]
pub use {cortex_m, cortex_m_board, heapless, rt_firmware, rtic};

/// Name of the board, as it tells it over the link.
pub const NAME: &str = "stm32f405";

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
pub struct Stm32f405;

/// The robot's pins.
#[cfg(feature = "emulation")]
pub type Parts = rt_firmware::body::Parts<'static>;
/// The robot's pins.
#[cfg(not(feature = "emulation"))]
pub type Parts = silicon::parts::BoardRoverParts;

/// Brings up stack paint, clocks, serial line and body. To be called once, first of all, with
/// interrupts off.
pub fn start() -> Start<SlotBoard, Parts> {
    stack::paint();
    #[cfg(feature = "log")]
    cortex_m_board::log::start(pac::Interrupt::TIM2);
    clock::start();
    uart::start();
    #[cfg(not(feature = "emulation"))]
    let (board, parts) = silicon::start();
    #[cfg(feature = "emulation")]
    let (board, parts) = {
        use cortex_m_board::{last_exchange, plant, plant_board};
        plant::open();
        let board = SlotBoard::new(last_exchange::take());
        (board, plant_board::PINS.parts())
    };
    let reset = post_mortem::take();
    crash::log_reset(reset);
    Start {
        reset,
        board,
        parts,
    }
}
