//! A recording that is kept in memory.

use std::cell::{Ref, RefCell};
use std::io::{self, Write};
use std::rc::Rc;

use esm_toolkit::recording::player::{Recording, RecordingError};

/// A recording that is kept in memory: one handle is [`record`](super::drive::Plan::record) of a
/// run, another one has it when the run is over.
#[derive(Clone, Debug, Default)]
pub struct InMemory(Rc<RefCell<Vec<u8>>>);

impl InMemory {
    /// Its bytes, as they would stand in a file.
    pub fn bytes(&self) -> Ref<'_, [u8]> {
        Ref::map(self.0.borrow(), Vec::as_slice)
    }

    /// What was recorded.
    ///
    /// # Errors
    /// If it is no recording.
    pub fn read(&self) -> Result<Recording, RecordingError> {
        Recording::read(&self.bytes())
    }
}

impl Write for InMemory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
