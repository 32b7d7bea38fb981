//! Ctrl-C, seen by whoever runs a loop: the loop ends in order, and with it everything that it started.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;
use std::{process, thread};

/// How often is looked whether the process is to end, by whoever does nothing else.
const LOOK_TIME: Duration = Duration::from_millis(20);

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

    /// Ends the process with this status if it is still there so long after it was asked to end, for work that cannot look in
    /// between: a single macro step of a mission that was made for that takes hours. What is to be put in order before is `last`.
    pub fn insist(self, grace: Duration, status: u8, last: impl FnOnce() + Send + 'static) {
        thread::spawn(move || {
            while !self.is_requested() {
                thread::sleep(LOOK_TIME);
            }
            thread::sleep(grace);
            last();
            process::exit(status.into());
        });
    }

    /// Whether the process is to end.
    pub fn is_requested(self) -> bool {
        is_requested()
    }
}

/// Whether the process is to end, for who does not know whether Ctrl-C was [taken over](Interrupt::take_over). If not, the system ends it.
pub fn is_requested() -> bool {
    REQUESTED.load(Relaxed)
}

/// Ends the command that runs as Ctrl-C does, or lets the next one run: for a program that has [commands run within it](crate::cli::execute).
pub fn request(is_requested: bool) {
    REQUESTED.store(is_requested, Relaxed);
}
