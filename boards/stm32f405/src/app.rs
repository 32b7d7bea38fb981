//! The RTIC app, as a macro.

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[cfg(feature = "emulation")]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(slots: TIM2, wire: USART1, plant_line: TIM5, link: CAN2_SCE);
            $($firmware)*
        }
    };
}

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[cfg(not(feature = "emulation"))]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(slots: TIM2, wire: USART1, link: CAN2_SCE);
            $($firmware)*
        }
    };
}
