//! A bumper: a plate before the body, and a contact switch behind it.

use embedded_hal::digital::InputPin;

/// How long the input must be high until the bumper counts as free again, in microseconds. Contacts
/// bounce for less than 10 ms (Ganssle, "A Guide to Debouncing", 2008), and a robot that is pushed
/// back and forth closes its switch again and again; both are one touch.
pub const FREE_AFTER_US: u32 = 50_000;

/// A switch that pulls its input low while something pushes the bumper; a resistor holds it high
/// otherwise. An input that cannot be read counts as low.
///
/// The first look that finds it low is a touch: a switch that is open never reads low because it
/// bounces, and who touches something must not wait for a second look. Only the end of a touch
/// waits.
#[derive(Debug)]
pub struct Bumper<P> {
    pin: P,
    is_touched: bool,
    /// For how long the input has been high since the touch, in microseconds.
    high_us: u32,
}

impl<P: InputPin> Bumper<P> {
    /// A bumper that nothing has touched yet.
    pub const fn new(pin: P) -> Self {
        Self {
            pin,
            is_touched: false,
            high_us: 0,
        }
    }

    /// Whether something pushes it. The last look was `passed_us` microseconds ago.
    pub fn is_touched(&mut self, passed_us: u32) -> bool {
        if let Ok(true) = self.pin.is_high() {
            self.high_us = self.high_us.saturating_add(passed_us);
            self.is_touched &= self.high_us < FREE_AFTER_US;
        } else {
            self.is_touched = true;
            self.high_us = 0;
        }
        self.is_touched
    }
}

#[cfg(test)]
mod tests {
    use embedded_hal_mock::eh1::digital::{Mock, State, Transaction};

    use super::super::test_wire::{HIGH, LOW, Wire};
    use super::*;

    #[test]
    fn a_touch_begins_at_once_and_ends_when_the_contact_has_come_to_rest() {
        let mut bumper = Bumper::new(Wire(HIGH));
        for (level, passed_us, expected) in [
            (HIGH, 20_000, false),
            (LOW, 20_000, true),
            (HIGH, 1_000, true),
            (LOW, 1_000, true),
            (HIGH, 20_000, true),
            (HIGH, 20_000, true),
            (HIGH, 9_999, true),
            (HIGH, 1, false),
            // What cannot be read is no free way.
            (None, 20_000, true),
            (HIGH, u32::MAX, false),
            (HIGH, u32::MAX, false),
        ] {
            bumper.pin = Wire(level);
            assert_eq!(bumper.is_touched(passed_us), expected, "{level:?}");
        }
    }

    /// Ganssle, "A Guide to Debouncing" (2008): of 18 switches the worst bounced for 6.2 ms, one
    /// for 157 ms. Looks 10 ms apart see a contact that bounces as any mixture of levels.
    #[test]
    fn a_contact_that_bounces_for_40_ms_is_one_touch() {
        let levels = [1, 1, 0, 1, 0, 1, 0, 0, 0, 1, 0, 1, 1, 1, 1, 1, 1];
        let touched = [0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0];
        let level = |&it: &u8| if it == 1 { State::High } else { State::Low };
        let looks: std::vec::Vec<_> = (levels.iter().map(level).map(Transaction::get)).collect();
        let mut pin = Mock::new(&looks);
        let mut bumper = Bumper::new(pin.clone());
        assert_eq!(levels.map(|_| u8::from(bumper.is_touched(10_000))), touched);
        pin.done();
    }
}
