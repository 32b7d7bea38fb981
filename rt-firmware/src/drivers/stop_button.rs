//! The button of an emergency stop.

use embedded_hal::digital::InputPin;

/// How long the input must be low at each look before the button counts as pressed, in µs: contacts
/// bounce, and wires catch what a motor sends out. A little less than 5 ms, so that looks that are
/// nominally 5 ms apart are far enough apart on every board.
pub const STOP_DEBOUNCE_US: u32 = 4_900;

/// A button that pulls its input low while it is pressed; a resistor holds it high otherwise. An
/// input that cannot be read counts as low.
///
/// Whoever asks must do so more often than the clock's ticks wrap. What is pressed stays so until
/// the input is high again; that a stop stays latched is not the button's business.
///
/// ```
/// use rt_firmware::body::{PinImage, Sensors};
/// use rt_firmware::drivers::StopButton;
///
/// let pins = PinImage::new();
/// let mut button = StopButton::new(pins.stop_button());
/// // On a clock of one tick a microsecond.
/// assert!(!button.is_pressed(|| 0, 1));
/// pins.set_sensors(&Sensors { stop_is_low: true, ..Sensors::default() });
/// assert!(!button.is_pressed(|| 5_000, 1));
/// assert!(button.is_pressed(|| 10_000, 1));
/// ```
#[derive(Debug)]
pub struct StopButton<P> {
    pin: P,
    contact: Contact,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contact {
    Open,
    /// Low at each look since the clock said this.
    Closing(u32),
    Closed,
}

impl<P: InputPin> StopButton<P> {
    /// A button that was not pressed yet.
    pub const fn new(pin: P) -> Self {
        StopButton {
            pin,
            contact: Contact::Open,
        }
    }

    /// Whether it is pressed. `now_ticks` is asked for the low half of a clock whose microsecond
    /// has `ticks_per_us` ticks, and only if the input is low.
    // Inlined, so that a slot of a robot whose button nobody presses takes a load and a store
    // longer.
    #[inline(always)]
    pub fn is_pressed(&mut self, now_ticks: impl FnOnce() -> u32, ticks_per_us: u32) -> bool {
        if let Ok(false) = self.pin.is_low() {
            self.contact = Contact::Open;
            return false;
        }
        self.is_held(now_ticks(), ticks_per_us)
    }

    #[cold]
    #[inline(never)]
    fn is_held(&mut self, now_ticks: u32, ticks_per_us: u32) -> bool {
        match self.contact {
            Contact::Open => self.contact = Contact::Closing(now_ticks),
            Contact::Closing(since) => {
                let debounce_ticks = STOP_DEBOUNCE_US.saturating_mul(ticks_per_us);
                if now_ticks.wrapping_sub(since) >= debounce_ticks {
                    self.contact = Contact::Closed;
                }
            }
            Contact::Closed => {}
        }
        self.contact == Contact::Closed
    }
}

#[cfg(test)]
mod tests {
    use core::convert::Infallible;

    use embedded_hal::digital;

    use super::super::test_wire::{HIGH, LOW, Wire};
    use super::*;

    #[test]
    fn a_level_that_holds_is_a_press_and_one_that_bounces_is_none() {
        const TICKS_PER_US: u32 = 50;
        // At each look: µs, level, whether it is pressed.
        let looks = [
            (0, HIGH, false),
            (1_000, LOW, false),
            (2_000, HIGH, false),
            (3_000, LOW, false),
            (3_100, LOW, false),
            (7_800, LOW, false),
            (7_900, LOW, true),
            // For longer than the clock takes to go round: 86 s.
            (50_000_000, LOW, true),
            (89_000_000, LOW, true),
            (89_001_000, HIGH, false),
            // One that cannot be read stops the robot.
            (89_002_000, None, false),
            (89_012_000, None, true),
            (89_013_000, HIGH, false),
        ];
        for begins_us in [0, 85_890_000] {
            let mut button = StopButton::new(Wire(HIGH));
            for (at_us, level, expected) in looks {
                button.pin = Wire(level);
                let ticks = (begins_us + at_us) * u64::from(TICKS_PER_US);
                let pressed = button.is_pressed(|| ticks as u32, TICKS_PER_US);
                assert_eq!(pressed, expected, "{at_us} us after {begins_us} us");
            }
        }
    }

    #[test]
    fn the_clock_is_not_looked_at_while_nobody_presses() {
        struct Up;
        impl digital::ErrorType for Up {
            type Error = Infallible;
        }
        impl InputPin for Up {
            fn is_high(&mut self) -> Result<bool, Infallible> {
                Ok(true)
            }
            fn is_low(&mut self) -> Result<bool, Infallible> {
                Ok(false)
            }
        }
        let mut button = StopButton::new(Up);
        assert!(!button.is_pressed(|| panic!("asked for the time"), 1));
    }
}
