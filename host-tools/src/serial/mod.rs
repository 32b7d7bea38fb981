//! Bytes to and from a robot: serial lines, sockets, pseudo-terminals, and a pipe inside this process.
//!
//! Everything that carries bytes is a [`ByteLink`]. It knows nothing of frames; it may lose, double or corrupt bytes as wires do, and
//! the link client above lives with that.
//!
//! | module | what it holds |
//! |---|---|
//! | [`clock`] | by which time bytes come: the wall's, or a simulation's |
//! | [`port`] | what a person writes: a path, `unix:PATH`, `tcp:HOST:PORT` |
//! | [`noise`] | a bad line, repeatable |
//! | [`pacing`] | a link slowed down to the rate of a real line |
//! | [`pipe`] | a link between two threads of this process |
//! | [`pty`] | a pseudo-terminal that others can open, for serving an emulated robot |

pub mod clock;
pub mod noise;
pub mod pacing;
pub mod pipe;
pub mod port;
pub mod pty;

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use thiserror::Error;

use crate::run::interrupt;
use clock::Clock;
use pacing::Paced;
use port::Port;

/// The baud rate of a robot's line where none is named.
pub const DEFAULT_BAUD: u32 = 115_200;

/// How long a TCP connection may take to be made.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a write may wait for a line that takes nothing.
const WRITE_TIMEOUT: Duration = Duration::from_secs(30);

/// How long it may before it is looked whether anybody wants it still.
const WRITE_LOOK: Duration = Duration::from_millis(100);

/// The shortest wait that a socket or line can be asked for; zero means "for ever" to a socket.
const SHORTEST_WAIT: Duration = Duration::from_millis(1);

/// Carries bytes in both directions, without frames and without promises.
pub trait ByteLink: Send {
    /// Takes what has come, waiting up to `timeout` for the first byte. Answers how many bytes of `buffer` were filled; 0 where
    /// nothing came in time.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the other side has gone; what the system says otherwise.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Sends all of `bytes`.
    ///
    /// # Errors
    /// [`io::ErrorKind::TimedOut`] where the line takes nothing for seconds; what the system says otherwise.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// The clock by which bytes come, and by which the time of [`ByteLink::receive`] is meant. Whatever stands around another line has that line's.
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

    fn clock(&self) -> Clock {
        (**self).clock()
    }
}

/// Why a port could not be opened.
#[derive(Debug, Error)]
pub enum OpenError {
    /// Nothing of that name.
    #[error("there is no {port}; is the robot plugged in and switched on, or `esm board` running?")]
    Missing {
        /// The port asked for.
        port: Port,
    },
    /// Somebody else has it.
    #[error("{port} is in use by another program; close it there first")]
    Busy {
        /// The port asked for.
        port: Port,
    },
    /// The system forbids it.
    #[error(
        "no permission to open {port}; serial lines often ask for membership of the group `dialout`"
    )]
    Forbidden {
        /// The port asked for.
        port: Port,
    },
    /// Nobody listens behind the socket.
    #[error("nobody answers at {port}; is the robot, or `esm board`, running?")]
    Refused {
        /// The port asked for.
        port: Port,
    },
    /// There is something of that name, but nothing that a robot could be behind.
    #[error(
        "{port} is no serial line; name one, such as /dev/ttyUSB0, or unix:PATH, or tcp:HOST:PORT"
    )]
    NoLine {
        /// The port asked for.
        port: Port,
    },
    /// Anything else.
    #[error("cannot open {port}: {cause}")]
    System {
        /// The port asked for.
        port: Port,
        /// What the system says.
        cause: io::Error,
    },
}

/// Opens a port. Sockets are paced to `baud`, since an emulated UART behind one knows no rate; a serial line keeps it by itself.
///
/// # Errors
/// [`OpenError`]: what is wrong with the port, and what to do.
pub fn open(port: &Port, baud: u32) -> Result<Box<dyn ByteLink>, OpenError> {
    let system = |cause: io::Error| open_error(port, cause);
    match port {
        Port::Tty(path) => {
            let settings = serialport::new(path.to_string_lossy(), baud).timeout(SHORTEST_WAIT);
            let line = TTYPort::open(&settings).map_err(|error| tty_error(port, &error))?;
            // Half a frame from before is of no use to anybody.
            let _ = line.clear(serialport::ClearBuffer::Input);
            // A pseudo-terminal takes any rate and keeps none.
            Ok(Box::new(Paced::new(line, baud)))
        }
        Port::Unix(path) => {
            let socket = UnixStream::connect(path).map_err(system)?;
            socket.set_write_timeout(Some(WRITE_LOOK)).map_err(system)?;
            Ok(Box::new(Paced::new(socket, baud)))
        }
        // It keeps its rate by itself.
        Port::Own(line) => line.open().map_err(system),
        Port::Tcp { host, port: number } => {
            let socket = connect_tcp(host, *number).map_err(system)?;
            // A frame is small and wanted now.
            socket.set_nodelay(true).map_err(system)?;
            socket.set_write_timeout(Some(WRITE_LOOK)).map_err(system)?;
            Ok(Box::new(Paced::new(socket, baud)))
        }
    }
}

/// Connects to the first address of `host` that answers.
fn connect_tcp(host: &str, port: u16) -> io::Result<TcpStream> {
    use std::net::ToSocketAddrs;
    let mut last = io::Error::from(io::ErrorKind::NotFound);
    for address in (host, port).to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(socket) => return Ok(socket),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn open_error(port: &Port, cause: io::Error) -> OpenError {
    let port = port.clone();
    match cause.kind() {
        io::ErrorKind::NotFound => OpenError::Missing { port },
        io::ErrorKind::PermissionDenied => OpenError::Forbidden { port },
        io::ErrorKind::ConnectionRefused | io::ErrorKind::TimedOut => OpenError::Refused { port },
        io::ErrorKind::ResourceBusy | io::ErrorKind::WouldBlock => OpenError::Busy { port },
        _ => OpenError::System { port, cause },
    }
}

/// The `serialport` crate folds what the system says into kinds of its own and keeps the sentence; a look at the file tells which
/// of them it was.
fn tty_error(port: &Port, error: &serialport::Error) -> OpenError {
    let cause = match error.kind() {
        serialport::ErrorKind::Io(kind) => io::Error::new(kind, error.to_string()),
        serialport::ErrorKind::NoDevice | serialport::ErrorKind::InvalidInput => {
            let Port::Tty(path) = port else {
                return OpenError::Missing { port: port.clone() };
            };
            match std::fs::metadata(path) {
                Err(missing) => missing,
                Ok(_) if error.kind() == serialport::ErrorKind::NoDevice => {
                    io::Error::from(io::ErrorKind::ResourceBusy)
                }
                Ok(_) => io::Error::other(error.to_string()),
            }
        }
        serialport::ErrorKind::Unknown if is_no_terminal(port, error) => {
            return OpenError::NoLine { port: port.clone() };
        }
        serialport::ErrorKind::Unknown => io::Error::other(error.to_string()),
    };
    open_error(port, cause)
}

/// Whether a failure without a kind means that the port is something else than a terminal: a directory, a plain file, `/dev/null`.
fn is_no_terminal(port: &Port, error: &serialport::Error) -> bool {
    let Port::Tty(path) = port else {
        return false;
    };
    path.is_dir() || error.to_string() == nix::errno::Errno::ENOTTY.desc()
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

/// Writes all of it to a line whose writes wait for [`WRITE_LOOK`] at most.
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
}

impl ByteLink for TcpStream {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.set_read_timeout(Some(timeout.max(SHORTEST_WAIT)))?;
        received(self.read(buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        write_patiently(self, bytes)
    }
}

impl ByteLink for TTYPort {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.set_timeout(timeout.max(SHORTEST_WAIT))?;
        received(self.read(buffer))
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.set_timeout(WRITE_LOOK)?;
        write_patiently(self, bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_opened_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("plain");
        std::fs::write(&file, b"").unwrap();
        let gone = folder.path().join("gone");
        let orphan = folder.path().join("orphan");
        drop(std::os::unix::net::UnixListener::bind(&orphan).unwrap());
        type Expected = fn(&OpenError) -> bool;
        let cases: [(String, Expected); 6] = [
            (gone.display().to_string(), |e| {
                matches!(e, OpenError::Missing { .. })
            }),
            (format!("unix:{}", gone.display()), |e| {
                matches!(e, OpenError::Missing { .. })
            }),
            (format!("unix:{}", orphan.display()), |e| {
                matches!(e, OpenError::Refused { .. })
            }),
            (file.display().to_string(), |e| {
                matches!(e, OpenError::NoLine { .. })
            }),
            (folder.path().display().to_string(), |e| {
                matches!(e, OpenError::NoLine { .. })
            }),
            ("/dev/null".into(), |e| {
                matches!(e, OpenError::NoLine { .. })
            }),
        ];
        for (name, expected) in cases {
            let error = open(&name.parse().unwrap(), DEFAULT_BAUD).err().unwrap();
            assert!(expected(&error), "{name}: {error}");
        }
    }

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
