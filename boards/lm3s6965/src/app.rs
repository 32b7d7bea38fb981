//! The RTIC app, as a macro.

/// Makes the firmware of a robot: see [`cortex_m_board::app!`], which says what may stand in it.
#[macro_export]
macro_rules! app {
    ($($firmware:tt)*) => {
        $crate::cortex_m_board::app! {
            board($crate);
            interrupts(
                slots: TIMER_0A,
                wire: UART0,
                plant_line: TIMER_1A,
                watchdog: WATCHDOG_TIMER_0,
                link: SSI0,
            );
            $($firmware)*
        }
    };
}
