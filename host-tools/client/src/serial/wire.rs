//! A line that is open in this process: a terminal or a socket, read and written without blocking.
//!
//! Nothing here waits longer than it was asked to, and nothing that waits holds the line: another
//! process that wants to stop the robot gets it at any time ([`takeover`](super::takeover)).

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use thiserror::Error;

/// `esm stop` has the line now: nothing comes from it here any more.
#[derive(Clone, Copy, Debug, Error)]
#[error("`esm stop` has taken the port over")]
pub struct TakenOver;

/// Whether a line ended since `esm stop` has taken it over.
pub fn is_taken_over(error: &io::Error) -> bool {
    let inner = error.get_ref();
    inner.is_some_and(|inner| inner.is::<TakenOver>())
}

/// The file behind a line, which is lent to `esm stop` at most once and for good.
pub(super) struct Wire {
    file: OwnedFd,
    /// Held for as long as one read or write without waiting takes.
    is_taken: Mutex<bool>,
}

impl Wire {
    /// A line whose file is open.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn new(file: OwnedFd) -> io::Result<Self> {
        rustix::io::ioctl_fionbio(&file, true)?;
        Ok(Wire {
            file,
            is_taken: Mutex::new(false),
        })
    }

    /// A thread that panicked while it held the lock left a plain value behind.
    fn lock(&self) -> MutexGuard<'_, bool> {
        self.is_taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends the use of the line here, and has `give` hand its file on. Should that fail, the use
    /// goes on.
    pub(super) fn hand_over(
        &self,
        give: impl FnOnce(&OwnedFd) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut is_taken = self.lock();
        let given = give(&self.file);
        *is_taken |= given.is_ok();
        given
    }

    /// Reads or writes once, without waiting. `None` where there is nothing to read, or no room.
    pub(super) fn at_once<T>(
        &self,
        act: impl FnOnce(&OwnedFd) -> Result<T, Errno>,
    ) -> io::Result<Option<T>> {
        let is_taken = self.lock();
        if *is_taken {
            return Err(io::Error::new(io::ErrorKind::ConnectionAborted, TakenOver));
        }
        match act(&self.file) {
            Ok(done) => Ok(Some(done)),
            Err(Errno::AGAIN | Errno::INTR) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Waits for what `wanted` says, at most so long.
    pub(super) fn wait(&self, wanted: PollFlags, time: Duration) -> io::Result<()> {
        wait_for(&self.file, wanted, time)
    }
}

/// Waits for what `wanted` says of a file, at most so long, or until a signal came.
pub(super) fn wait_for(file: impl AsFd, wanted: PollFlags, time: Duration) -> io::Result<()> {
    match poll(&mut [PollFd::new(&file, wanted)], Some(&timespec(time))) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// A time as the system takes it.
pub(super) fn timespec(time: Duration) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(time.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: time.subsec_nanos().into(),
    }
}
