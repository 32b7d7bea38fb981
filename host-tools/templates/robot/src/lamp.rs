//! The driver of a lamp: it sits on an embedded-hal trait and names no chip, so it runs on any
//! board.

use embedded_hal::digital::{OutputPin, PinState};

/// A lamp behind a digital output; high is lit.
#[derive(Debug)]
pub struct Lamp<P> {
    pin: P,
    lit: bool,
}

impl<P: OutputPin> Lamp<P> {
    /// The lamp on this pin, dark.
    pub fn new(pin: P) -> Self {
        Self { pin, lit: false }
    }

    /// Lights the lamp or puts it out. Writes the pin each time, since the robot's safe state
    /// switches all outputs off behind the driver's back.
    ///
    /// # Errors
    /// What the pin says.
    pub fn set(&mut self, lit: bool) -> Result<(), P::Error> {
        self.pin.set_state(PinState::from(lit))?;
        self.lit = lit;
        Ok(())
    }

    /// Whether it was lit by the last [`set`](Self::set) that succeeded.
    pub fn is_lit(&self) -> bool {
        self.lit
    }
}
