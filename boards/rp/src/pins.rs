//! Gives each pin its part, as a robot's [`Wiring`] says. The board's own are GP0 and GP1 (UART 0:
//! TX, RX) and GP25 (its LED, which is lit while a mission runs).

use core::convert::Infallible;

use crate::hal::gpio::{
    self, DynPinId, FunctionSioInput, FunctionSioOutput, FunctionUart, Pin, PullDown, PullNone,
    PullUp,
};
use crate::hal::pac::{ADC, PIO0, PIO1, PWM, RESETS, UART0};
use crate::hal::pio::{SM0, SM1};
use embedded_hal::digital::{self, InputPin};
use rt_firmware::robot_parts::{PartTypes, PartsOf, RobotParts};
use rt_firmware::rover::{ExtraParts, Extras, Rover, RoverParts};

use crate::analog::{self, Input};
use crate::encoders::{self, Counter};
use crate::free_pins::{FreePins, take};
use crate::motors::{self, Direction, Power};
use crate::outputs::Output;
use crate::sonars::{self, Echo, Trigger};
use crate::uart;
use crate::wiring::{Button, Wiring};

/// The types of this board's parts.
#[derive(Clone, Copy)]
pub struct BoardParts;

impl PartTypes for BoardParts {
    type Pwm = Power;
    type Direction = Direction;
    type LeftEncoder = Counter<SM0>;
    type RightEncoder = Counter<SM1>;
    type Trigger = Trigger;
    type EchoTimer = Echo;
    type Analog = Input;
    type Output = Output;
    type Extras = BoardExtras;
}

/// The types of parts that not every robot has. A firmware without the feature of one has none.
#[derive(Debug)]
pub enum BoardExtras {}

impl Extras for BoardExtras {
    #[cfg(feature = "bumpers")]
    type Bumper = SwitchPin;
    #[cfg(not(feature = "bumpers"))]
    type Bumper = rt_firmware::rover::NoPin;
    #[cfg(feature = "imu")]
    type ImuBus = crate::i2c::Bus;
    #[cfg(not(feature = "imu"))]
    type ImuBus = rt_firmware::rover::NoBus;
}

/// The rover's parts on this board.
pub type BoardRoverParts<const SONARS: usize> = PartsOf<BoardParts, SONARS>;

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
    BoardExtras,
>;

/// The input of a button or of a contact switch: low while it is pressed. One that is not connected
/// is pulled to where it is not pressed.
pub enum SwitchPin {
    /// To ground.
    PulledUp(Pin<DynPinId, FunctionSioInput, PullUp>),
    /// To the supply of 3.3 V.
    PulledDown(Pin<DynPinId, FunctionSioInput, PullDown>),
}

/// The board's LED.
pub type Led = Pin<gpio::bank0::Gpio25, FunctionSioOutput, PullNone>;

/// What is connected to the board's pins, of the robot: the rover's parts, and outputs for drivers
/// of its own.
pub type Parts<const SONARS: usize> = RobotParts<BoardParts, SONARS>;

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
    ) -> (Parts<SONARS>, SwitchPin, Led) {
        let (mut free, own) = FreePins::of(pins);
        let _serial = (
            own.transmit.into_function::<FunctionUart>(),
            // High is silence, also where nothing is plugged in.
            own.receive.reconfigure::<FunctionUart, PullUp>(),
        );
        let led = own.led.reconfigure();
        let Wiring { left, right, .. } = wiring;
        let [(left_pwm, left_direction), (right_pwm, right_direction)] =
            motors::start([left.motor, right.motor], &mut free, self.pwm, resets);
        let (left_encoder, right_encoder) =
            encoders::start([left, right], &mut free, self.pio0, resets);
        #[cfg(feature = "i2c")]
        let bus = wiring.i2c.map(|pins| crate::i2c::start(pins, &mut free));
        let (sonar_triggers, echo_timers) = sonars::start(
            &wiring.sonars,
            &mut free,
            self.pio1,
            #[cfg(feature = "ranges")]
            bus,
            resets,
        );
        analog::start(self.adc, resets);
        let stop_button = SwitchPin::new(wiring.stop_button, &mut free);
        uart::start(self.uart0, peripheral_hz, resets);
        let parts = RobotParts {
            rover: RoverParts {
                left_pwm,
                left_direction,
                right_pwm,
                right_direction,
                left_encoder,
                right_encoder,
                sonar_triggers,
                echo_timers,
                array: None,
                battery: Input::new(Some(wiring.battery), &mut free),
                line_sensors: wiring.floor.map(|pin| Input::new(pin, &mut free)),
                extras: ExtraParts {
                    #[cfg(feature = "bumpers")]
                    bumpers: (wiring.bumpers)
                        .map(|pair| pair.map(|switch| SwitchPin::new(switch, &mut free))),
                    #[cfg(not(feature = "bumpers"))]
                    bumpers: None,
                    #[cfg(feature = "imu")]
                    imu: wiring.has_gyro.then_some(bus).flatten(),
                    #[cfg(not(feature = "imu"))]
                    imu: None,
                },
            },
            outputs: wiring.outputs.map(|pin| Output::new(pin, &mut free)),
        };
        (parts, stop_button, led)
    }
}

impl SwitchPin {
    fn new(button: Button, pins: &mut FreePins) -> Self {
        match button.is_pressed_high {
            true => SwitchPin::PulledDown(take!(pins, button.pin, FunctionSioInput, PullDown)),
            false => SwitchPin::PulledUp(take!(pins, button.pin, FunctionSioInput, PullUp)),
        }
    }
}

/// A robot prints what it is made of; a pin has nothing to say.
#[cfg(feature = "bumpers")]
impl core::fmt::Debug for SwitchPin {
    fn fmt(&self, to: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        to.write_str("SwitchPin")
    }
}

impl digital::ErrorType for SwitchPin {
    type Error = Infallible;
}

impl InputPin for SwitchPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        match self {
            SwitchPin::PulledUp(pin) => pin.is_high(),
            SwitchPin::PulledDown(pin) => pin.is_low(),
        }
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|is_high| !is_high)
    }
}
