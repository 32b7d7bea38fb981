//! The timer of a chip that says when the plant carries bytes of the link.

use crate::chip::Chip;

/// A timer of a chip, one shot, whose interrupt is the line's.
///
/// Set anew by its handler. An emulator may reload a periodic timer before it raises the interrupt;
/// while the processor sleeps, it may then let its time pass to the next timer first, or not, as
/// its own threads happen to meet.
pub trait LineTimer: Chip {
    /// Starts the timer's clock, with its interrupt on and no time set.
    fn start_line_timer();

    /// Takes the timer's interrupt back.
    fn acknowledge_line_timer();

    /// Lets the interrupt come after so many ticks of the clock.
    fn set_line_timer(ticks: u32);
}
