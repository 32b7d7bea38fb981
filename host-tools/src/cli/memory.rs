//! A recording that is kept in memory: of a drive that a command makes for itself.

use std::cell::RefCell;
use std::io::{self, Write};
use std::rc::Rc;

use anyhow::anyhow;

use super::exit::CommandError;
use crate::recording::player::Recording;

/// A recording that is kept in memory.
#[derive(Clone, Default)]
pub struct Recorded(Rc<RefCell<Vec<u8>>>);

impl Recorded {
    /// What was recorded.
    ///
    /// # Errors
    /// It is no recording.
    pub fn read(&self) -> Result<Recording, CommandError> {
        Recording::read(&self.0.borrow())
            .map_err(|error| CommandError::Input(anyhow!("what the robot told: {error}")))
    }
}

impl Write for Recorded {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
