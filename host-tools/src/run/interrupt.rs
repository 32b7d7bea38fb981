//! Ctrl-C, seen by whoever runs a loop: the loop ends in order, and with it everything that it started.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

static REQUESTED: AtomicBool = AtomicBool::new(false);
static INSTALLED: OnceLock<Result<(), String>> = OnceLock::new();

/// The wish of the person at the terminal (or of the system, by SIGTERM or SIGHUP) that the process end.
#[derive(Clone, Copy, Debug)]
pub struct Interrupt(());

impl Interrupt {
    /// Takes Ctrl-C over from the system for the rest of the process. A second call changes nothing.
    ///
    /// # Errors
    /// What the system says, where it does not allow that.
    pub fn take_over() -> Result<Self, std::io::Error> {
        INSTALLED
            .get_or_init(|| {
                ctrlc::set_handler(|| REQUESTED.store(true, Relaxed))
                    .map_err(|error| error.to_string())
            })
            .clone()
            .map_err(std::io::Error::other)?;
        Ok(Interrupt(()))
    }

    /// Whether the process is to end.
    pub fn is_requested(self) -> bool {
        REQUESTED.load(Relaxed)
    }
}
