//! What `embedded-hal` 1.0 has no trait for: counters of encoders, timers of echoes, analogue
//! inputs.
//!
//! All three read a register that hardware keeps up to date, so none of them can fail or has to
//! wait.

/// The counter of a quadrature encoder, which wraps at both ends of its range.
pub trait EncoderCounter {
    /// Bits of the counter, 1 to 32. A wheel is followed as long as it turns by less than half of
    /// the counter's range between two looks.
    const BITS: u32 = u16::BITS;

    /// The count now, in its lowest 16 bits: up when the wheel turns forwards, down when it turns
    /// backwards.
    fn count(&mut self) -> u16;

    /// The count now, in all of its bits; a counter with more than 16 says them.
    fn wide_count(&mut self) -> u32 {
        self.count().into()
    }
}

/// What the timer at a sonar's echo pin has seen since the last trigger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EchoPulse {
    /// The pin has not gone high. So it is with a sonar that is dead or not there, and with one
    /// whose pin hangs at a level.
    None,
    /// The pin has gone high and still is, for so many microseconds so far.
    High {
        /// So far; stays at the greatest that it can hold.
        us: u16,
    },
    /// The pin has gone high and low again.
    Over {
        /// How long it was high, in microseconds; the greatest that it can hold stands for more,
        /// too.
        us: u16,
    },
}

/// The timer at a sonar's echo pin: a trigger clears it, the pin's rising edge starts it, its
/// falling edge stops it.
///
/// It says what the pin did, and judges nothing: what a pulse means is the [driver](super::Sonar)'s
/// to say.
pub trait EchoTimer {
    /// What the pin has done since the last trigger.
    fn pulse(&mut self) -> EchoPulse;
}

/// One input of an analogue-to-digital converter that converts by itself, over and over.
pub trait AnalogIn {
    /// The last conversion, `0..=full_scale()`.
    fn counts(&mut self) -> u16;

    /// Counts at the reference voltage.
    fn full_scale(&self) -> u16;
}
