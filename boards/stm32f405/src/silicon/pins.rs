//! The pins of the chip, and what each of them is.

use core::convert::Infallible;

use embedded_hal::digital::{self, InputPin, OutputPin};

use crate::clock;
use crate::pac::{GPIOA, GPIOB, GPIOC, gpioa};

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
}

impl digital::ErrorType for Pin {
    type Error = Infallible;
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set_level(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set_level(true);
        Ok(())
    }
}

impl InputPin for Pin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.registers().idr().read().bits() & 1 << self.number != 0)
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|is_high| !is_high)
    }
}

/// Starts the clocks of the ports.
pub(crate) fn start_ports() {
    clock::rcc().ahb1enr().modify(|_, w| {
        w.gpioaen().enabled();
        w.gpioben().enabled().gpiocen().enabled()
    });
}
