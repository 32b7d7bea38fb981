//! What a board brings of its chip, where the time is [`sys_tick`](crate::sys_tick)'s.

/// A chip.
pub trait Chip: 'static {
    /// Ticks of SysTick in a microsecond.
    const TICKS_PER_US: u32;

    /// Starts the watchdog's count anew.
    fn feed_watchdog();
}

/// A chip with motors of its own.
pub trait MotorChip: Chip {
    /// Takes the power of all motors. From any context.
    fn motors_off();
}
