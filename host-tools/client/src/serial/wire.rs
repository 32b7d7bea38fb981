//! A line that is open in this process: a terminal or a socket, read and written without blocking.
//!
//! Nothing here waits longer than it was asked to, and nothing that waits holds the line: another
//! process that wants to stop the robot gets it at any time ([`takeover`](super::takeover)).

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use thiserror::Error;

use super::takeover::Holder;
use super::{ByteLink, WRITE_TIMEOUT};
use crate::interrupt;

/// How long one wait lasts before it is looked whether the line was taken over, or Ctrl-C came.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

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
    fn at_once<T>(&self, act: impl FnOnce(&OwnedFd) -> Result<T, Errno>) -> io::Result<Option<T>> {
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
    fn wait(&self, wanted: PollFlags, time: Duration) -> io::Result<()> {
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

/// A line, as a [`ByteLink`].
pub(super) struct WireLink {
    /// Before the file, which it has a share in: a port that was closed can be opened again at
    /// once.
    holder: Option<Holder>,
    wire: Arc<Wire>,
}

impl WireLink {
    /// A line whose file is open.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn new(file: OwnedFd) -> io::Result<Self> {
        rustix::io::ioctl_fionbio(&file, true)?;
        let wire = Arc::new(Wire {
            file,
            is_taken: Mutex::new(false),
        });
        Ok(WireLink { holder: None, wire })
    }

    /// What `esm stop` can take over.
    pub(super) fn wire(&self) -> Arc<Wire> {
        Arc::clone(&self.wire)
    }

    /// From now on `esm stop` finds it by this.
    pub(super) fn keep(&mut self, holder: Holder) {
        self.holder = Some(holder);
    }
}

impl ByteLink for WireLink {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let begun = Instant::now();
        loop {
            let read = self
                .wire
                .at_once(|file| rustix::io::read(file, &mut *buffer));
            match read.map_err(ended)? {
                Some(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Some(count) => return Ok(count),
                None => {}
            }
            let left = timeout.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return Ok(0);
            }
            self.wire.wait(PollFlags::IN, left.min(LOOK_INTERVAL))?;
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let was_interrupted = interrupt::is_requested();
        let mut rest = bytes;
        // In looks and not by the clock: a process that was suspended has waited for one look.
        let mut stood = Duration::ZERO;
        loop {
            match self.try_send(rest)? {
                0 => {}
                count => {
                    rest = &rest[count..];
                    stood = Duration::ZERO;
                }
            }
            if rest.is_empty() {
                return Ok(());
            }
            if stood >= WRITE_TIMEOUT {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "it takes no bytes"));
            }
            if interrupt::is_requested() && (!was_interrupted || !stood.is_zero()) {
                return Err(io::ErrorKind::Interrupted.into());
            }
            self.wire.wait(PollFlags::OUT, LOOK_INTERVAL)?;
            stood += LOOK_INTERVAL;
        }
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let written = self.wire.at_once(|file| rustix::io::write(file, bytes));
        Ok(written?.unwrap_or(0))
    }
}

/// What a failed read means: the end of the line, where the system says in one of its ways that
/// nobody, or nothing, is there any more.
fn ended(error: io::Error) -> io::Error {
    let is_end = [
        Errno::IO,
        Errno::NXIO,
        Errno::NODEV,
        Errno::PIPE,
        Errno::CONNRESET,
    ]
    .iter()
    .any(|end| error.raw_os_error() == Some(end.raw_os_error()));
    if is_end {
        io::ErrorKind::UnexpectedEof.into()
    } else {
        error
    }
}
