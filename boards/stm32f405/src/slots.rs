//! The board as the real-time side sees it.

#[cfg(feature = "emulation")]
mod emulated {
    use cortex_m_board::plant_board::{PlantBoard, PlantChip};

    use crate::{Stm32f405, clock, watchdog};

    /// Time, body and pins for the slot timer's handler.
    pub type SlotBoard = PlantBoard<Stm32f405>;

    impl PlantChip for Stm32f405 {
        const TICKS_PER_US: u32 = clock::TICKS_PER_US;

        fn feed_watchdog() {
            watchdog::feed();
        }
    }
}

#[cfg(feature = "emulation")]
pub use emulated::SlotBoard;

#[cfg(not(feature = "emulation"))]
mod silicon {
    use cortex_m_board::sys_tick;
    use rt_firmware::{Board, WithStopButton};

    use crate::{clock, motors, pins, watchdog};

    /// Time, motors, watchdog and the button of the emergency stop for the slot timer's handler.
    pub type SlotBoard = WithStopButton<Chip, pins::StopPin>;

    /// Time, motors and watchdog.
    pub struct Chip;

    impl Board for Chip {
        const TICKS_PER_US: u32 = clock::TICKS_PER_US;
        const COUNT_BITS: u32 = sys_tick::BITS;

        fn now_ticks(&mut self) -> u64 {
            sys_tick::advance()
        }

        #[inline(always)]
        fn now_low_ticks(&mut self) -> u32 {
            sys_tick::low_ticks()
        }

        #[inline(always)]
        fn count(&mut self) -> u32 {
            sys_tick::count()
        }

        fn feed_watchdog(&mut self) {
            watchdog::feed();
        }

        fn motors_off(&mut self) {
            motors::all_off();
        }
    }
}

#[cfg(not(feature = "emulation"))]
pub use silicon::{Chip, SlotBoard};
