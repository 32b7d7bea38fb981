//! An input for tests, whose level a test says.

use embedded_hal::digital::{self, Error, ErrorKind, InputPin};

/// An input whose level is told before each look; none cannot be read.
pub struct Wire(pub Option<bool>);

/// It cannot be read.
#[derive(Debug)]
pub struct Broken;

impl Error for Broken {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl digital::ErrorType for Wire {
    type Error = Broken;
}

impl InputPin for Wire {
    fn is_high(&mut self) -> Result<bool, Broken> {
        self.0.ok_or(Broken)
    }

    fn is_low(&mut self) -> Result<bool, Broken> {
        self.is_high().map(|high| !high)
    }
}

/// High, and read.
pub const HIGH: Option<bool> = Some(true);
/// Low, and read.
pub const LOW: Option<bool> = Some(false);
