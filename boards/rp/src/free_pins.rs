//! The pins before they have parts: each can be given once.

use crate::hal::gpio::bank0::{Gpio0, Gpio1, Gpio25};
use crate::hal::gpio::{self, DynPinId, FunctionNull, Pin, PullDown};

/// Pins that have no part yet.
pub(crate) struct FreePins([Option<FreePin>; 30]);

/// A pin that has no part yet.
type FreePin = Pin<DynPinId, FunctionNull, PullDown>;

/// The pins of the board's own parts.
pub(crate) struct OwnPins {
    /// UART 0, to the host.
    pub(crate) transmit: Pin<Gpio0, FunctionNull, PullDown>,
    /// UART 0, from the host.
    pub(crate) receive: Pin<Gpio1, FunctionNull, PullDown>,
    /// The LED.
    pub(crate) led: Pin<Gpio25, FunctionNull, PullDown>,
}

impl FreePins {
    /// Those that a robot may have, and those of the board itself.
    pub(crate) fn of(pins: gpio::Pins) -> (Self, OwnPins) {
        macro_rules! free {
            ($($number:literal: $pin:ident),* $(,)?) => {{
                let mut free = FreePins([const { None }; 30]);
                $(free.0[$number] = Some(pins.$pin.into_dyn_pin());)*
                free
            }};
        }
        let free = free!(
            2: gpio2, 3: gpio3, 4: gpio4, 5: gpio5, 6: gpio6, 7: gpio7, 8: gpio8, 9: gpio9,
            10: gpio10, 11: gpio11, 12: gpio12, 13: gpio13, 14: gpio14, 15: gpio15, 16: gpio16,
            17: gpio17, 18: gpio18, 19: gpio19, 20: gpio20, 21: gpio21, 22: gpio22, 26: gpio26,
            27: gpio27, 28: gpio28,
        );
        let own = OwnPins {
            transmit: pins.gpio0,
            receive: pins.gpio1,
            led: pins.gpio25,
        };
        (free, own)
    }

    /// Gives a pin to a part: see [`take!`].
    pub(crate) fn take(&mut self, pin: u8) -> FreePin {
        let free = self.0.get_mut(usize::from(pin)).and_then(Option::take);
        let Some(free) = free else {
            panic!("GP{pin} has another part, or is none of a robot's");
        };
        free
    }
}

/// Gives a pin to a part, with this function and pull.
///
/// # Panics
/// If another part has it: where a robot's file was checked, none has.
macro_rules! take {
    ($pins:expr, $pin:expr, $function:ty, $pull:ty) => {{
        let Ok(pin) = $pins.take($pin).try_into_function::<$function>() else {
            panic!("every pin of a robot's can be that");
        };
        pin.into_pull_type::<$pull>()
    }};
}
pub(crate) use take;
