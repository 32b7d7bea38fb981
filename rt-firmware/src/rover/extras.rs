//! Parts that not every rover has.

use core::convert::Infallible;
use core::fmt::Debug;

use embedded_hal::digital::{self, InputPin};
use embedded_hal::i2c::{self, I2c, Operation};

use crate::body::BUMPERS;

/// The types of HAL objects of parts that not every robot has. A board says them once, for all of
/// its robots.
pub trait Extras {
    /// Input of a bumper's switch, low while something pushes the bumper.
    type Bumper: InputPin + Send + Debug;

    /// Bus of the inertial measurement unit.
    type ImuBus: I2c + Send + Debug;
}

/// Nothing beside what every rover has.
#[derive(Clone, Copy, Debug)]
pub enum NoExtras {}

impl Extras for NoExtras {
    type Bumper = NoPin;
    type ImuBus = NoBus;
}

/// A pin that is not there.
#[derive(Clone, Copy, Debug)]
pub enum NoPin {}

impl digital::ErrorType for NoPin {
    type Error = Infallible;
}

impl InputPin for NoPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        match *self {}
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        match *self {}
    }
}

/// A bus that is not there.
#[derive(Clone, Copy, Debug)]
pub enum NoBus {}

impl i2c::ErrorType for NoBus {
    type Error = Infallible;
}

impl I2c for NoBus {
    fn transaction(&mut self, _: u8, _: &mut [Operation<'_>]) -> Result<(), Infallible> {
        match *self {}
    }
}

/// Parts that not every robot has, each if it is there. A firmware without the feature of one has
/// no task for it.
#[derive(Debug)]
pub struct ExtraParts<X: Extras> {
    /// Inputs of the bumpers' switches, left and right (feature `bumpers`).
    pub bumpers: Option<[X::Bumper; BUMPERS]>,
    /// Bus of the inertial measurement unit (feature `imu`).
    pub imu: Option<X::ImuBus>,
}

impl ExtraParts<NoExtras> {
    /// None of them is there.
    pub const NONE: Self = Self {
        bumpers: None,
        imu: None,
    };
}
