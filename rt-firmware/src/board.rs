//! What the real-time side asks of a board.

use embedded_hal::digital::InputPin;

use crate::drivers::StopButton;
use crate::frames::LinkDevice;
use esm_link::message::SafeReason;

/// A board's time, body and watchdog, as the slot timer's interrupt reaches them.
pub trait Board {
    /// Ticks of the clock in one microsecond: 1 to 65,535.
    const TICKS_PER_US: u32;

    /// How far ahead a mission starts that follows no other, in µs: longer than its tables take to
    /// be made, so that its first activation is on time.
    const START_LEAD_US: u32 = 5_000;

    /// Ticks since the board started. Never goes back and never wraps.
    fn now_ticks(&mut self) -> u64;

    /// The low half of [`now_ticks`](Self::now_ticks), for the time between two instants. A board
    /// that can tell it faster than the whole should.
    fn now_low_ticks(&mut self) -> u32 {
        self.now_ticks() as u32
    }

    /// Bits of [`count`](Self::count) that mean something, 32 at most. A round of it lasts longer
    /// than four times [`IDLE_POLL_US`](crate::realtime::IDLE_POLL_US), which is checked when the
    /// board is compiled, than any activation, and than any time for which something holds the
    /// timer's interrupt back: what is later than half a round must not look as if it was on time.
    const COUNT_BITS: u32 = u32::BITS;

    /// What [`now_low_ticks`](Self::now_low_ticks) tells, in its lowest
    /// [`COUNT_BITS`](Self::COUNT_BITS) alone: what a counter of the clock shows, without any
    /// arithmetic. Each activation asks for it.
    #[cfg_attr(feature = "speed", inline(always))]
    fn count(&mut self) -> u32 {
        self.now_low_ticks()
    }

    /// An activation of a slot begins; nothing of it was executed yet. This is where a simulated
    /// body is asked for its sensors.
    ///
    /// # Errors
    /// Why the robot must go to its safe state.
    fn begin_activation(&mut self, _occurrence: &ActivationStart) -> Result<(), SafeReason> {
        Ok(())
    }

    /// All are alive who should be: slots, link, slot 0 ([`supervision`](crate::supervision) says
    /// what of each). Called at least each 100 ms, with and without a mission; the watchdog's time
    /// must be longer than that, and longer than the longest activation.
    fn feed_watchdog(&mut self) {}

    /// Whether somebody presses the emergency stop: a button on a pin, if the board has one
    /// ([`WithStopButton`] gives it one). Asked before each activation of a slot, and at least each
    /// 20 ms; whoever lets go of it releases nothing.
    #[cfg_attr(feature = "speed", inline(always))]
    fn is_emergency_stop_pressed(&mut self) -> bool {
        false
    }

    /// What carries the frames of the mission's link with this index, if the board has so many.
    /// The links of a mission have those of the board in their order.
    fn link(&mut self, _index: usize) -> Option<&mut dyn LinkDevice> {
        None
    }

    /// Stops all that moves. Called when the robot stops, again in each activation of the
    /// interpreter's slot until it starts, and now and then while there is no mission. After an
    /// emergency stop it comes before each [`begin_activation`](Self::begin_activation).
    fn motors_off(&mut self);
}

/// A board with a button that stops the robot for an emergency, whatever its mission does and
/// whether or not a host is there.
///
/// The button is asked before the board's own
/// [`is_emergency_stop_pressed`](Board::is_emergency_stop_pressed); all else is the board's.
pub struct WithStopButton<B, P> {
    board: B,
    button: StopButton<P>,
}

impl<B: Board, P: InputPin> WithStopButton<B, P> {
    /// Gives a board a button on this input, which is low while it is pressed.
    pub const fn new(board: B, pin: P) -> Self {
        WithStopButton {
            board,
            button: StopButton::new(pin),
        }
    }

    /// The board without it.
    pub const fn board_mut(&mut self) -> &mut B {
        &mut self.board
    }
}

impl<B: Board, P: InputPin> Board for WithStopButton<B, P> {
    const TICKS_PER_US: u32 = B::TICKS_PER_US;
    const START_LEAD_US: u32 = B::START_LEAD_US;
    const COUNT_BITS: u32 = B::COUNT_BITS;

    #[cfg_attr(feature = "speed", inline(always))]
    fn count(&mut self) -> u32 {
        self.board.count()
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn now_ticks(&mut self) -> u64 {
        self.board.now_ticks()
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn now_low_ticks(&mut self) -> u32 {
        self.board.now_low_ticks()
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        self.board.begin_activation(activation)
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn feed_watchdog(&mut self) {
        self.board.feed_watchdog();
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn is_emergency_stop_pressed(&mut self) -> bool {
        let WithStopButton { board, button } = self;
        button.is_pressed(|| board.now_low_ticks(), B::TICKS_PER_US)
            || board.is_emergency_stop_pressed()
    }

    fn link(&mut self, index: usize) -> Option<&mut dyn LinkDevice> {
        self.board.link(index)
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn motors_off(&mut self) {
        self.board.motors_off();
    }
}

/// The beginning of an activation. Times are nominal, in microseconds since the first macro step of
/// the first mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ActivationStart {
    /// Index of the slot in the running mission's blob.
    pub slot: usize,
    /// Activations of all slots since the mission started, before this one.
    pub number: u64,
    /// Start of this activation.
    pub start_us: u64,
    /// The same on the board's clock, in ticks since the board started.
    pub start_ticks: u64,
    /// End of the activation before, which is when what its tasks wrote takes effect; equal to
    /// `start_us` in the first one.
    pub previous_end_us: u64,
    /// Whether this slot runs the interpreter.
    pub interpreter: bool,
}

/// Ticks in whole microseconds, of which each has `ticks_per_us`: 1 to 65,535.
///
/// Small cores divide 32 bits in hardware, and 64 bits in a library routine of a kilobyte: what
/// does not fit is divided by schoolbook, 16 bits at a time.
pub fn microseconds(ticks: u64, ticks_per_us: u32) -> u64 {
    const DIGIT_BITS: u32 = u16::BITS;
    let divisor = ticks_per_us.clamp(1, u32::from(u16::MAX));
    if let Ok(ticks) = u32::try_from(ticks) {
        return u64::from(ticks / divisor);
    }
    let mut quotient = 0;
    let mut rest = 0;
    for digit in (0..u64::BITS / DIGIT_BITS).rev() {
        // Less than the divisor before the digit is appended, so that it fits.
        let part = rest << DIGIT_BITS | u32::from((ticks >> (digit * DIGIT_BITS)) as u16);
        quotient = quotient << DIGIT_BITS | u64::from(part / divisor);
        rest = part % divisor;
    }
    quotient
}

/// Ticks from one [`count`](Board::count) to another, less than a round later.
#[cfg_attr(feature = "speed", inline(always))]
pub(crate) fn ticks_between<B: Board>(first: u32, last: u32) -> u32 {
    last.wrapping_sub(first) & (u32::MAX >> (u32::BITS - B::COUNT_BITS))
}

/// So many microseconds in ticks of this board's clock.
#[cfg_attr(feature = "speed", inline(always))]
pub fn ticks<B: Board>(us: impl Into<u64>) -> u64 {
    us.into() * u64::from(B::TICKS_PER_US)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn ticks_become_whole_microseconds(ticks: u64, shift in 0..64u32, ticks_per_us in 1..=65_535u32) {
            let ticks = ticks >> shift;
            prop_assert_eq!(microseconds(ticks, ticks_per_us), ticks / u64::from(ticks_per_us));
        }
    }

    #[test]
    fn the_greatest_numbers_are_divided_too() {
        for ticks_per_us in [1, 2, 50, 65_534, 65_535] {
            let expected = u64::MAX / u64::from(ticks_per_us);
            assert_eq!(microseconds(u64::MAX, ticks_per_us), expected);
        }
    }
}
