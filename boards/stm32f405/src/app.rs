//! The RTIC app, as a macro.

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[cfg(all(feature = "emulation", not(feature = "links")))]
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

/// Makes the firmware of a robot whose missions have a link: see [`cortex_m_board::app!`], which
/// says what may stand in it.
#[cfg(all(feature = "emulation", feature = "links"))]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(
                slots: TIM2,
                wire: USART1,
                plant_line: TIM5,
                frames: Line(TIM3, USART2),
                link: CAN2_SCE,
            );
            $($firmware)*
        }
    };
}

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[cfg(not(any(feature = "emulation", feature = "can")))]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(slots: TIM2, wire: TIM7, link: CAN2_SCE);
            $($firmware)*
        }
    };
}

/// Makes the firmware of a robot whose missions have a link: see [`cortex_m_board::app!`], which
/// says what may stand in it.
#[cfg(all(feature = "can", not(feature = "emulation")))]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(
                slots: TIM2,
                wire: TIM7,
                frames: Line(TIM8_BRK_TIM12, CAN1_RX0),
                link: CAN2_SCE,
            );
            $($firmware)*
        }
    };
}
