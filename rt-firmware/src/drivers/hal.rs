//! What `embedded-hal` 1.0 has no trait for: counters of encoders, timers of echoes, analogue inputs.
//!
//! All three read a register that hardware keeps up to date, so none of them can fail or has to wait.

/// The counter of a quadrature encoder.
pub trait EncoderCounter {
    /// The count now: up when the wheel turns forwards, down when it turns backwards, wrapping at both ends of `u16`.
    fn count(&mut self) -> u16;
}

/// The timer between a sonar's trigger and its echo.
pub trait EchoTimer {
    /// Time from trigger to echo of the last finished ping, in microseconds; `None` if no echo came back. A ping in flight
    /// changes nothing until its echo comes or its time is over.
    fn echo_us(&mut self) -> Option<u16>;
}

/// One input of an analogue-to-digital converter that converts by itself, over and over.
pub trait AnalogIn {
    /// The last conversion, `0..=full_scale()`.
    fn counts(&mut self) -> u16;

    /// Counts at the reference voltage.
    fn full_scale(&self) -> u16;
}
