//! What carries bytes, and a socket that does.

use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::net::SendFlags;

use super::clock::Clock;
use crate::interrupt;

/// How long a write may wait for a line that takes nothing: as long as an answer is waited for.
pub(super) const WRITE_TIMEOUT: Duration = Duration::from_secs(6);

/// The shortest wait that a socket or line can be asked for; zero means "for ever" to a socket.
pub(super) const SHORTEST_WAIT: Duration = Duration::from_millis(1);

/// Carries bytes in both directions, without frames and without promises.
pub trait ByteLink: Send {
    /// Takes what has come, waiting up to `timeout` for the first byte. Answers how many bytes of
    /// `buffer` were filled; 0 where nothing came in time.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the other side has gone; what the system says
    /// otherwise.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`io::ErrorKind::TimedOut`] where the line takes nothing for seconds; what the system says
    /// otherwise.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Sends as much of `bytes` as the line takes at once, and answers how much that was. A link
    /// that has no bounds of its own takes all of them.
    ///
    /// # Errors
    /// As [`ByteLink::send`], but for the time.
    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.send(bytes)?;
        Ok(bytes.len())
    }

    /// Gives the line another rate, in baud. What stands for a wire and has none takes it for the
    /// pace of what is sent.
    ///
    /// # Errors
    /// [`io::ErrorKind::Unsupported`] where something else carries the bytes; what the system says
    /// otherwise.
    fn set_rate(&mut self, baud: u32) -> io::Result<()> {
        let _ = baud;
        Err(io::ErrorKind::Unsupported.into())
    }

    /// The clock by which bytes come, and by which the time of [`ByteLink::receive`] is meant.
    /// Whatever stands around another line has that line's.
    fn clock(&self) -> Clock {
        Clock::wall()
    }
}

impl<L: ByteLink + ?Sized> ByteLink for Box<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        (**self).receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        (**self).send(bytes)
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        (**self).try_send(bytes)
    }

    fn set_rate(&mut self, baud: u32) -> io::Result<()> {
        (**self).set_rate(baud)
    }

    fn clock(&self) -> Clock {
        (**self).clock()
    }
}

/// What a read answered, as a [`ByteLink`] tells it. `closed` is what zero bytes stand for.
fn received(read: io::Result<usize>) -> io::Result<usize> {
    match read {
        Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
        Ok(count) => Ok(count),
        Err(error) => match error.kind() {
            io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted => {
                Ok(0)
            }
            io::ErrorKind::BrokenPipe | io::ErrorKind::ConnectionReset => {
                Err(io::ErrorKind::UnexpectedEof.into())
            }
            _ => Err(error),
        },
    }
}

/// Writes all of it to a line whose writes wait for a short time each.
fn write_patiently(line: &mut impl Write, mut bytes: &[u8]) -> io::Result<()> {
    let mut begun = Instant::now();
    while !bytes.is_empty() {
        match line.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => {
                bytes = bytes.get(count..).unwrap_or_default();
                begun = Instant::now();
            }
            Err(error) => match error.kind() {
                io::ErrorKind::WouldBlock
                | io::ErrorKind::TimedOut
                | io::ErrorKind::Interrupted => {
                    if interrupt::is_requested() {
                        return Err(io::Error::other("interrupted, and it takes nothing"));
                    }
                    if begun.elapsed() >= WRITE_TIMEOUT {
                        return Err(io::ErrorKind::TimedOut.into());
                    }
                }
                _ => return Err(error),
            },
        }
    }
    Ok(())
}

impl ByteLink for UnixStream {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.set_read_timeout(Some(timeout.max(SHORTEST_WAIT)))?;
        received(self.read(buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        write_patiently(self, bytes)
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match rustix::net::send(&*self, bytes, SendFlags::DONTWAIT) {
            Ok(count) => Ok(count),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(error) => Err(error.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_whose_other_end_is_gone_says_so() {
        let (mut here, there) = UnixStream::pair().unwrap();
        let mut buffer = [0; 4];
        assert_eq!(here.receive(&mut buffer, Duration::ZERO).unwrap(), 0);
        drop(there);
        let error = here.receive(&mut buffer, Duration::ZERO).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof);
    }
}
