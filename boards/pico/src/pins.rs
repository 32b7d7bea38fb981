//! Which pin is what. This is the table that the wiring follows.
//!
//! | pin | part |
//! |---|---|
//! | GP0, GP1 | UART 0: TX, RX |
//! | GP2, GP3 | left motor's bridge: forwards, backwards |
//! | GP4, GP5 | right motor's bridge: forwards, backwards |
//! | GP6, GP7 | left encoder: A, B |
//! | GP8, GP9 | right encoder: A, B |
//! | GP10 to GP17 | sonars 0 to 7: trigger |
//! | GP18 | sonars 0 and 1: echo |
//! | GP19 | sonars 2 and 3: echo |
//! | GP20 | sonars 4 and 5: echo |
//! | GP21 | sonars 6 and 7: echo |
//! | GP22 | button of the emergency stop, to ground |
//! | GP25 | the board's LED: lit while a mission runs |
//! | GP26 | battery, behind a divider by three |
//! | GP27, GP28 | line sensors: left, right |
//!
//! Sonar 0 looks ahead, the others follow counter-clockwise, 45° apart. An HC-SR04 on 5 V answers
//! with 5 V: a divider (1 kΩ, 2 kΩ) makes 3.3 V of it, which is all that a pin bears.

use rp2040_hal::gpio::{
    self, FunctionPio0, FunctionPio1, FunctionUart, PullDown, PullNone, PullUp,
};
use rp2040_hal::pac::{ADC, PIO0, PIO1, PWM, RESETS, UART0};
use rp2040_hal::pio::{PIOExt, SM0, SM1};
use rp2040_hal::pwm::Slices;
use rt_firmware::body::SONARS;
use rt_firmware::rover::{Rover, RoverParts};

use crate::analog::{self, Input};
use crate::encoders::{self, Counter};
use crate::motors::{self, Direction, LeftPower, RightPower};
use crate::sonars::{self, Echo, EchoMachine, Trigger};
use crate::uart::Uart0;

/// Instructions that state machines execute in a second.
const PIO_HZ: u32 = 2_000_000;
/// What the system clock of 125 MHz is divided by for it: whole, and 256ths.
const PIO_DIVISOR: (u16, u8) = {
    let in_256ths = 125_000_000 / (PIO_HZ / 256);
    ((in_256ths / 256) as u16, (in_256ths % 256) as u8)
};

/// The rover's parts on this board.
pub type BoardRoverParts = RoverParts<
    LeftPower,
    Direction,
    RightPower,
    Direction,
    Counter<SM0>,
    Counter<SM1>,
    Trigger,
    Echo,
    Input,
>;

/// The rover on this board.
pub type BoardRover = Rover<
    LeftPower,
    Direction,
    RightPower,
    Direction,
    Counter<SM0>,
    Counter<SM1>,
    Trigger,
    Echo,
    Input,
>;

/// The input of the emergency stop's button: low while it is pressed.
pub type StopPin = gpio::Pin<gpio::bank0::Gpio22, gpio::FunctionSioInput, PullUp>;

/// The board's LED.
pub type Led = gpio::Pin<gpio::bank0::Gpio25, gpio::FunctionSioOutput, PullNone>;

/// What is connected to the board's pins.
pub struct Parts {
    /// Of the rover.
    pub rover: BoardRoverParts,
    /// The button of the emergency stop.
    pub stop_button: StopPin,
    /// The serial line.
    pub uart: Uart0,
}

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
    pub(crate) fn into_parts(
        self,
        pins: gpio::Pins,
        peripheral_hz: u32,
        resets: &mut RESETS,
    ) -> (Parts, Led) {
        let _serial = (
            pins.gpio0.into_function::<FunctionUart>(),
            pins.gpio1.into_function::<FunctionUart>(),
        );
        let slices = Slices::new(self.pwm, resets);
        let (mut left, mut right) = (slices.pwm1, slices.pwm2);
        left.channel_a.output_to(pins.gpio2);
        left.channel_b.output_to(pins.gpio3);
        right.channel_a.output_to(pins.gpio4);
        right.channel_b.output_to(pins.gpio5);
        let (left_pwm, left_direction) = motors::left(left);
        let (right_pwm, right_direction) = motors::right(right);

        let (mut pio0, counter_0, counter_1, ..) = self.pio0.split(resets);
        let Ok(count) = pio0.install(&encoders::program()) else {
            panic!("the program that counts encoders fits");
        };
        // SAFETY: a program may be shared by state machines as long as nobody takes it away.
        let shared = unsafe { count.share() };
        // Outputs of an encoder are often open collectors.
        let _encoders = (
            pins.gpio6.reconfigure::<FunctionPio0, PullUp>(),
            pins.gpio7.reconfigure::<FunctionPio0, PullUp>(),
            pins.gpio8.reconfigure::<FunctionPio0, PullUp>(),
            pins.gpio9.reconfigure::<FunctionPio0, PullUp>(),
        );

        let (mut pio1, echo_0, echo_1, echo_2, echo_3) = self.pio1.split(resets);
        let Ok(time) = pio1.install(&sonars::program()) else {
            panic!("the program that times echoes fits");
        };
        // SAFETY: as above.
        let another = || unsafe { time.share() };
        let _triggers = (
            pins.gpio10.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio11.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio12.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio13.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio14.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio15.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio16.reconfigure::<FunctionPio1, PullNone>(),
            pins.gpio17.reconfigure::<FunctionPio1, PullNone>(),
        );
        // Diodes leave a pin that no sonar drives to its resistor.
        let _echoes = (
            pins.gpio18.reconfigure::<FunctionPio1, PullDown>(),
            pins.gpio19.reconfigure::<FunctionPio1, PullDown>(),
            pins.gpio20.reconfigure::<FunctionPio1, PullDown>(),
            pins.gpio21.reconfigure::<FunctionPio1, PullDown>(),
        );
        let machines = [
            EchoMachine::new(another(), echo_0, [10, 11], 18, PIO_DIVISOR),
            EchoMachine::new(another(), echo_1, [12, 13], 19, PIO_DIVISOR),
            EchoMachine::new(another(), echo_2, [14, 15], 20, PIO_DIVISOR),
            EchoMachine::new(another(), echo_3, [16, 17], 21, PIO_DIVISOR),
        ];
        let sonar = |sonar: usize| {
            const FIRST_TRIGGER: u8 = 10;
            machines[sonar / 2].sonar(FIRST_TRIGGER + sonar as u8)
        };
        let sonar_triggers: [Trigger; SONARS] = core::array::from_fn(|place| sonar(place).0);
        let echo_timers: [Echo; SONARS] = core::array::from_fn(|place| sonar(place).1);

        analog::start(self.adc, resets);
        let _analog = (
            pins.gpio26.into_floating_disabled(),
            pins.gpio27.into_floating_disabled(),
            pins.gpio28.into_floating_disabled(),
        );
        let parts = Parts {
            rover: RoverParts {
                left_pwm,
                left_direction,
                right_pwm,
                right_direction,
                left_encoder: Counter::new(count, counter_0, 6, PIO_DIVISOR),
                right_encoder: Counter::new(shared, counter_1, 8, PIO_DIVISOR),
                sonar_triggers,
                echo_timers,
                battery: Input::new(Some(0)),
                line_sensors: [Input::new(Some(1)), Input::new(None), Input::new(Some(2))],
            },
            stop_button: pins.gpio22.reconfigure(),
            uart: Uart0::new(self.uart0, peripheral_hz, resets),
        };
        (parts, pins.gpio25.reconfigure())
    }
}
