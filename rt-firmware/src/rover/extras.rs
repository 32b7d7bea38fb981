//! Parts that not every rover has.

use core::convert::Infallible;
use core::fmt::Debug;

use embedded_hal::digital::{self, InputPin};

use crate::body::BUMPERS;

/// The types of HAL objects of parts that not every robot has. A board says them once, for all of
/// its robots.
pub trait Extras {
    /// Input of a bumper's switch, low while something pushes the bumper.
    type Bumper: InputPin + Send + Debug;
}

/// Nothing beside what every rover has.
#[derive(Clone, Copy, Debug)]
pub enum NoExtras {}

impl Extras for NoExtras {
    type Bumper = NoPin;
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

/// Parts that not every robot has, each if it is there. A firmware without the feature of one has
/// no task for it.
#[derive(Debug)]
pub struct ExtraParts<X: Extras> {
    /// Inputs of the bumpers' switches, left and right (feature `bumpers`).
    pub bumpers: Option<[X::Bumper; BUMPERS]>,
}

impl ExtraParts<NoExtras> {
    /// None of them is there.
    pub const NONE: Self = Self { bumpers: None };
}
