//! Ctrl-C, seen by whoever runs a loop: the loop ends in order, and with it everything that it
//! started.

use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use std::{process, thread};

/// How often is looked whether the process is to end, by whoever does nothing else.
const LOOK_TIME: Duration = Duration::from_millis(20);

/// How long a command may still talk to a robot after Ctrl-C: to end its streams, to take back what
/// it began. All that it waits for ends with this, so that the command ends within a second,
/// whatever comes on its line.
const FAREWELL: Duration = Duration::from_millis(600);

/// When it was requested.
static REQUESTED: Mutex<Option<Instant>> = Mutex::new(None);
static INSTALLED: OnceLock<Result<(), String>> = OnceLock::new();

/// The wish of the person at the terminal (or of the system, by SIGTERM or SIGHUP) that the process
/// end.
#[derive(Clone, Copy, Debug)]
pub struct Interrupt(());

impl Interrupt {
    /// Takes Ctrl-C over from the system for the rest of the process. A second call changes
    /// nothing.
    ///
    /// # Errors
    /// What the system says, where it does not allow that.
    pub fn take_over() -> Result<Self, std::io::Error> {
        INSTALLED
            .get_or_init(|| ctrlc::set_handler(|| request(true)).map_err(|error| error.to_string()))
            .clone()
            .map_err(std::io::Error::other)?;
        Ok(Interrupt(()))
    }

    /// Ends the process with this status if it is still there so long after it was asked to end,
    /// for work that cannot look in between: a single macro step of a mission that was made for
    /// that takes hours. What is to be put in order before is `last`.
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

/// Whether the process is to end, for who does not know whether Ctrl-C was [taken
/// over](Interrupt::take_over). If not, the system ends it.
pub fn is_requested() -> bool {
    requested_at().is_some()
}

/// Whether it was to end so long ago that nothing is waited for any more.
pub fn is_overdue() -> bool {
    requested_at().is_some_and(|requested| requested.elapsed() >= FAREWELL)
}

/// Ends the command that runs as Ctrl-C does, or lets the next one run: for a program that has
/// commands run within it, by `host_tools::cli::execute`.
pub fn request(is_requested: bool) {
    let mut requested = REQUESTED.lock().unwrap_or_else(PoisonError::into_inner);
    // The first counts.
    *requested = is_requested.then(|| requested.unwrap_or_else(Instant::now));
}

fn requested_at() -> Option<Instant> {
    *REQUESTED.lock().unwrap_or_else(PoisonError::into_inner)
}
