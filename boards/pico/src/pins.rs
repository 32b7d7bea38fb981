//! Gives each pin its part, as a robot's [`Wiring`] says. The board's own are GP0 and GP1 (UART 0:
//! TX, RX) and GP25 (its LED, which is lit while a mission runs).

use core::convert::Infallible;

use embedded_hal::digital::{self, InputPin};
use rp2040_hal::gpio::{
    self, DynPinId, FunctionNull, FunctionSioInput, FunctionSioOutput, FunctionUart, Pin, PullDown,
    PullNone, PullUp,
};
use rp2040_hal::pac::{ADC, PIO0, PIO1, PWM, RESETS, UART0};
use rp2040_hal::pio::{SM0, SM1};
use rt_firmware::rover::{Rover, RoverParts};

use crate::analog::{self, Input};
use crate::encoders::{self, Counter};
use crate::motors::{self, Direction, Power};
use crate::sonars::{self, Echo, Trigger};
use crate::uart::Uart0;
use crate::wiring::{Button, Wiring};

/// What the system clock of 125 MHz is divided by for the PIO blocks, whole, and 256ths: a state
/// machine executes two instructions a microsecond.
pub(crate) const PIO_DIVISOR: (u16, u8) = {
    const PIO_HZ: u32 = 2_000_000;
    let in_256ths = 125_000_000 / (PIO_HZ / 256);
    ((in_256ths / 256) as u16, (in_256ths % 256) as u8)
};

/// The rover's parts on this board.
pub type BoardRoverParts<const SONARS: usize> = RoverParts<
    Power,
    Direction,
    Power,
    Direction,
    Counter<SM0>,
    Counter<SM1>,
    Trigger,
    Echo,
    Input,
    SONARS,
>;

/// The rover on this board.
pub type BoardRover<const SONARS: usize> = Rover<
    Power,
    Direction,
    Power,
    Direction,
    Counter<SM0>,
    Counter<SM1>,
    Trigger,
    Echo,
    Input,
    SONARS,
>;

/// The input of the emergency stop's button: low while it is pressed. One that is not connected is
/// pulled to where it is not pressed.
pub enum StopPin {
    /// To ground.
    PulledUp(Pin<DynPinId, FunctionSioInput, PullUp>),
    /// To the supply of 3.3 V.
    PulledDown(Pin<DynPinId, FunctionSioInput, PullDown>),
}

/// The board's LED.
pub type Led = Pin<gpio::bank0::Gpio25, FunctionSioOutput, PullNone>;

/// What is connected to the board's pins.
pub struct Parts<const SONARS: usize> {
    /// Of the rover.
    pub rover: BoardRoverParts<SONARS>,
    /// The button of the emergency stop.
    pub stop_button: StopPin,
    /// The serial line on pins.
    pub uart: Uart0,
}

/// Pins that have no part yet.
pub(crate) struct FreePins([Option<FreePin>; 30]);

/// A pin that has no part yet.
type FreePin = Pin<DynPinId, FunctionNull, PullDown>;

impl FreePins {
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

/// The chip's blocks that pins belong to.
pub(crate) struct Blocks {
    pub(crate) pwm: PWM,
    pub(crate) pio0: PIO0,
    pub(crate) pio1: PIO1,
    pub(crate) adc: ADC,
    pub(crate) uart0: UART0,
}

impl Blocks {
    /// Gives each pin its part.
    ///
    /// # Panics
    /// If two parts have one pin, or one that the chip has not.
    pub(crate) fn into_parts<const SONARS: usize>(
        self,
        wiring: &Wiring<SONARS>,
        pins: gpio::Pins,
        peripheral_hz: u32,
        resets: &mut RESETS,
    ) -> (Parts<SONARS>, Led) {
        let _serial = (
            pins.gpio0.into_function::<FunctionUart>(),
            // High is silence, also where nothing is plugged in.
            pins.gpio1.reconfigure::<FunctionUart, PullUp>(),
        );
        let led = pins.gpio25.reconfigure();
        macro_rules! free {
            ($($number:literal: $pin:ident),* $(,)?) => {{
                let mut free = FreePins([const { None }; 30]);
                $(free.0[$number] = Some(pins.$pin.into_dyn_pin());)*
                free
            }};
        }
        let mut free = free!(
            2: gpio2, 3: gpio3, 4: gpio4, 5: gpio5, 6: gpio6, 7: gpio7, 8: gpio8, 9: gpio9,
            10: gpio10, 11: gpio11, 12: gpio12, 13: gpio13, 14: gpio14, 15: gpio15, 16: gpio16,
            17: gpio17, 18: gpio18, 19: gpio19, 20: gpio20, 21: gpio21, 22: gpio22, 26: gpio26,
            27: gpio27, 28: gpio28,
        );
        let Wiring { left, right, .. } = wiring;
        let [(left_pwm, left_direction), (right_pwm, right_direction)] =
            motors::start([left.motor, right.motor], &mut free, self.pwm, resets);
        let (left_encoder, right_encoder) =
            encoders::start([left, right], &mut free, self.pio0, resets);
        let (sonar_triggers, echo_timers) =
            sonars::start(&wiring.sonars, &mut free, self.pio1, resets);
        analog::start(self.adc, resets);
        let parts = Parts {
            rover: RoverParts {
                left_pwm,
                left_direction,
                right_pwm,
                right_direction,
                left_encoder,
                right_encoder,
                sonar_triggers,
                echo_timers,
                battery: Input::new(Some(wiring.battery), &mut free),
                line_sensors: wiring.floor.map(|pin| Input::new(pin, &mut free)),
            },
            stop_button: StopPin::new(wiring.stop_button, &mut free),
            uart: Uart0::new(self.uart0, peripheral_hz, resets),
        };
        (parts, led)
    }
}

impl StopPin {
    fn new(button: Button, pins: &mut FreePins) -> Self {
        match button.is_pressed_high {
            true => StopPin::PulledDown(take!(pins, button.pin, FunctionSioInput, PullDown)),
            false => StopPin::PulledUp(take!(pins, button.pin, FunctionSioInput, PullUp)),
        }
    }
}

impl digital::ErrorType for StopPin {
    type Error = Infallible;
}

impl InputPin for StopPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        match self {
            StopPin::PulledUp(pin) => pin.is_high(),
            StopPin::PulledDown(pin) => pin.is_low(),
        }
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|is_high| !is_high)
    }
}
