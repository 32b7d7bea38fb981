//! The RTIC app, as a macro.

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[cfg(not(feature = "links"))]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::app_with! { [] $($firmware)* }
    };
}

/// Makes the firmware of a robot whose missions have a link: see [`cortex_m_board::app!`], which
/// says what may stand in it.
#[cfg(feature = "links")]
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::app_with! { [frames: Line(TIMER_2A, UART1),] $($firmware)* }
    };
}

/// What both have in common.
#[doc(hidden)]
#[macro_export]
macro_rules! app_with {
    ([$($frames:tt)*] $($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(
                slots: TIMER_0A,
                wire: UART0,
                plant_line: TIMER_1A,
                watchdog: WATCHDOG_TIMER_0,
                $($frames)*
                link: SSI0,
            );
            $($firmware)*
        }
    };
}
