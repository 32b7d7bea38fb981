//! A terminal or socket that is open here, as a link: read and written in short waits.

use std::io;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::termios::OptionalActions;

use super::byte_link::{ByteLink, WRITE_TIMEOUT};
use super::takeover::Holder;
use super::wire::Wire;
use crate::interrupt;

/// How long one wait lasts before it is looked whether the line was taken over, or Ctrl-C came.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

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
        Ok(WireLink {
            holder: None,
            wire: Arc::new(Wire::new(file)?),
        })
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

    fn set_rate(&mut self, baud: u32) -> io::Result<()> {
        let set = self.wire.at_once(|file| {
            let mut settings = match rustix::termios::tcgetattr(file) {
                // A socket, with an emulated line behind it.
                Err(Errno::NOTTY) => return Ok(()),
                settings => settings?,
            };
            settings.set_speed(baud)?;
            rustix::termios::tcsetattr(file, OptionalActions::Now, &settings)
        });
        set.map(|_| ())
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
