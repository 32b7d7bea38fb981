//! The pins, and the rover's parts at them ([`wiring`]).

use core::convert::Infallible;

use embedded_hal::digital::{self, InputPin};
use rt_firmware::body::SONARS;
use rt_firmware::rover::{ExtraParts, NoExtras, Rover, RoverParts};

use crate::analog::{self, Input};
use crate::encoders::{self, Counter};
use crate::motors::{self, Direction, Power};
use crate::pac::{GPIOA, GPIOB, GPIOC, gpioa};
use crate::sonars::{self, Echo, Trigger};
use crate::{parts, wiring};

/// The rover's parts on this board.
pub type BoardRoverParts =
    RoverParts<Power, Direction, Power, Direction, Counter, Counter, Trigger, Echo, Input>;

/// The rover on this board.
pub type BoardRover = Rover<
    Power,
    Direction,
    Power,
    Direction,
    Counter,
    Counter,
    Trigger,
    Echo,
    Input,
    SONARS,
    NoExtras,
>;

/// A port of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Port A.
    A,
    /// Port B.
    B,
    /// Port C.
    C,
}

/// A pin of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Its port.
    pub port: Port,
    /// Its number there, 0 to 15.
    pub number: u8,
}

/// What a pin is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Function {
    /// An input that the resistor of the chip pulls up.
    PulledUp,
    /// An output, low at first.
    Output,
    /// An analogue input.
    Analog,
    /// That of a part, by its number in the data sheet (table 9); low where nothing drives it.
    Part(u8),
    /// The same; high where nothing drives it.
    PulledUpPart(u8),
}

impl Pin {
    /// The registers of its port.
    fn registers(self) -> &'static gpioa::RegisterBlock {
        // All ports have the same registers (RM0090, 8.4); only their values after a reset differ.
        let registers: *const gpioa::RegisterBlock = match self.port {
            Port::A => GPIOA::PTR,
            Port::B => GPIOB::PTR.cast(),
            Port::C => GPIOC::PTR.cast(),
        };
        // SAFETY: the registers are there for the chip's whole life. Those that say what pins are
        // get written at the start, with interrupts off; levels by single stores.
        unsafe { &*registers }
    }

    /// Says what the pin is. To be called at the start, with interrupts off.
    pub fn set_function(self, function: Function) {
        const NO_PULL: u32 = 0;
        const PULL_UP: u32 = 1;
        const PULL_DOWN: u32 = 2;
        let (mode, pull, part) = match function {
            Function::PulledUp => (0, PULL_UP, 0),
            Function::Output => (1, NO_PULL, 0),
            Function::Part(part) => (2, PULL_DOWN, part),
            Function::PulledUpPart(part) => (2, PULL_UP, part),
            Function::Analog => (3, NO_PULL, 0),
        };
        let two_bits = |bits: u32, value: u32| {
            let shift = self.number * 2;
            bits & !(0b11 << shift) | value << shift
        };
        let four_bits = |bits: u32| {
            let shift = self.number % 8 * 4;
            bits & !(0b1111 << shift) | u32::from(part) << shift
        };
        let port = self.registers();
        self.set_level(false);
        // SAFETY: fields of this pin alone, with values that they take.
        unsafe {
            (port.pupdr()).modify(|r, w| w.bits(two_bits(r.bits(), pull)));
            match self.number {
                ..8 => port.afrl().modify(|r, w| w.bits(four_bits(r.bits()))),
                _ => port.afrh().modify(|r, w| w.bits(four_bits(r.bits()))),
            };
            (port.moder()).modify(|r, w| w.bits(two_bits(r.bits(), mode)));
        }
    }

    /// Sets the level of an output. From any context.
    pub fn set_level(self, is_high: bool) {
        let shift = self.number + if is_high { 0 } else { 16 };
        // SAFETY: a bit of this pin alone.
        (self.registers().bsrr()).write(|w| unsafe { w.bits(1 << shift) });
    }

    /// Whether an input is high.
    pub fn is_high(self) -> bool {
        self.registers().idr().read().bits() & 1 << self.number != 0
    }
}

/// Connects the link's pins.
pub(crate) fn connect_usart() {
    const USART_1: u8 = 7;
    start_ports();
    let [transmit, receive] = wiring::LINK;
    // High is silence, also where nothing is plugged in.
    transmit.set_function(Function::PulledUpPart(USART_1));
    receive.set_function(Function::PulledUpPart(USART_1));
}

/// Starts the clocks of the ports.
fn start_ports() {
    parts::rcc().ahb1enr().modify(|_, w| {
        w.gpioaen().enabled();
        w.gpioben().enabled().gpiocen().enabled()
    });
}

/// Starts all that is at the pins, but for the link. To be called once, with interrupts off.
pub(crate) fn start() -> (StopPin, BoardRoverParts) {
    start_ports();
    let [(left_pwm, left_direction), (right_pwm, right_direction)] = motors::start();
    let [left_encoder, right_encoder] = encoders::start();
    let (sonar_triggers, echo_timers) = sonars::start();
    let [battery, line_sensors @ ..] = analog::start();
    wiring::STOP_BUTTON.set_function(Function::PulledUp);
    let rover = RoverParts {
        left_pwm,
        left_direction,
        right_pwm,
        right_direction,
        left_encoder,
        right_encoder,
        sonar_triggers,
        echo_timers,
        array: None,
        battery,
        line_sensors,
        extras: ExtraParts::NONE,
    };
    (StopPin, rover)
}

/// The input of the emergency stop's button: low while it is pressed.
#[derive(Debug)]
pub struct StopPin;

impl digital::ErrorType for StopPin {
    type Error = Infallible;
}

impl InputPin for StopPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(wiring::STOP_BUTTON.is_high())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!wiring::STOP_BUTTON.is_high())
    }
}
