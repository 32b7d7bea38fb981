//! Bytes to and from a robot: serial lines, sockets, pseudo-terminals, and a pipe inside this
//! process.
//!
//! Everything that carries bytes is a [`ByteLink`]. It knows nothing of frames; it may lose, double
//! or corrupt bytes as wires do, and the link client above lives with that.
//!
//! | module | what it holds |
//! |---|---|
//! | [`clock`] | by which time bytes come: the wall's, or a simulation's |
//! | [`crystal`] | a simulated robot whose clock is not what it should be |
//! | [`port`] | what a person writes: a path, `unix:PATH`, `tcp:HOST:PORT` |
//! | [`noise`] | a bad line, repeatable |
//! | [`pacing`] | a link slowed down to the rate of a real line |
//! | [`pipe`] | a link between two threads of this process |
//! | [`pty`] | a pseudo-terminal that others can open, for serving an emulated robot |
//! | [`takeover`] | `esm stop` takes a port over from the process that has it |
//! | [`wire`] | a terminal or socket that is open here, read and written without blocking |

mod byte_link;
pub mod clock;
pub mod crystal;
pub mod noise;
pub mod pacing;
pub mod pipe;
pub mod port;
pub mod pty;
pub mod takeover;
pub mod wire;
mod wire_link;

use std::fs::File;
use std::io;
use std::net::TcpStream;
use std::os::fd::OwnedFd;
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketType};
use serialport::{SerialPort, TTYPort};
use thiserror::Error;

pub use byte_link::ByteLink;
use byte_link::SHORTEST_WAIT;
use pacing::Paced;
use port::Port;
use takeover::{Holder, NotServed};
use wire_link::WireLink;

/// The baud rate of a robot's line where none is named.
pub const DEFAULT_BAUD: u32 = 115_200;

/// How long a connection may take to be made.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// How long a stop waits for a port that is just being opened by somebody else.
const OPENING_WAIT: Duration = Duration::from_millis(50);

/// How often it looks meanwhile.
const OPENING_LOOK: Duration = Duration::from_millis(5);

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

/// A port that is open.
pub struct Opened {
    /// Its line.
    pub line: Box<dyn ByteLink>,
    /// Why `esm stop` cannot take it over from here, where that is so.
    pub not_served: Option<NotServed>,
}

/// Opens a port. Sockets are paced to `baud`, since an emulated UART behind one knows no rate; a
/// serial line keeps it by itself.
///
/// # Errors
/// [`OpenError`]: what is wrong with the port, and what to do.
pub fn open(port: &Port, baud: u32) -> Result<Box<dyn ByteLink>, OpenError> {
    open_served(port, baud).map(|opened| opened.line)
}

/// The same; says also whether `esm stop` can take the port over.
///
/// # Errors
/// As [`open`].
pub fn open_served(port: &Port, baud: u32) -> Result<Opened, OpenError> {
    let system = |cause: io::Error| open_error(port, cause);
    let file: OwnedFd = match port {
        // It keeps its rate by itself.
        Port::Own(line) => {
            return Ok(Opened {
                line: line.open().map_err(system)?,
                not_served: None,
            });
        }
        Port::Tty(path) => {
            // A process that this one has just begun shares its files, locks among them, for a
            // moment.
            let begun = Instant::now();
            loop {
                match open_tty(port, path, baud, Use::Alone) {
                    Err(OpenError::Busy { .. }) if begun.elapsed() < OPENING_WAIT => {
                        std::thread::sleep(OPENING_LOOK);
                    }
                    opened => break opened?.into(),
                }
            }
        }
        Port::Unix(path) => connect_unix(path).map_err(system)?.into(),
        Port::Tcp { host, port: number } => {
            let socket = connect_tcp(host, *number).map_err(system)?;
            // A frame is small and wanted now.
            socket.set_nodelay(true).map_err(system)?;
            socket.into()
        }
    };
    let mut line = WireLink::new(file).map_err(system)?;
    let served = takeover::identity(port)
        .map_err(NotServed::System)
        .and_then(|identity| Holder::begin(&identity, line.wire()));
    let not_served = match served {
        Ok(holder) => {
            if let Some(holder) = holder {
                line.keep(holder);
            }
            None
        }
        Err(why) => Some(why),
    };
    // A pseudo-terminal takes any rate and keeps none.
    let line = Box::new(Paced::new(line, baud));
    Ok(Opened { line, not_served })
}

/// Opens a port to stop the robot behind it, whoever has it: takes it over from another process of
/// this user; beside one that does not answer, or is another user's, it uses a serial line all the
/// same.
///
/// # Errors
/// As [`open`]; [`OpenError::Busy`] only where another program has locked the line.
pub fn open_to_stop(port: &Port, baud: u32) -> Result<Opened, OpenError> {
    let taken = takeover::identity(port).ok();
    if let Some(file) = taken.and_then(|identity| takeover::take(&identity)) {
        let mut line = WireLink::new(file).map_err(|cause| open_error(port, cause))?;
        // Whoever had it may have tried another rate.
        line.set_rate(baud)
            .map_err(|cause| open_error(port, cause))?;
        return Ok(Opened {
            line: Box::new(Paced::new(line, baud)),
            not_served: None,
        });
    }
    match open_served(port, baud) {
        Err(OpenError::Busy { .. }) => {}
        opened => return opened,
    }
    let Port::Tty(path) = port else {
        return Err(OpenError::Busy { port: port.clone() });
    };
    let begun = Instant::now();
    let file = loop {
        match open_tty(port, path, baud, Use::Beside) {
            Err(OpenError::Busy { .. }) if begun.elapsed() < OPENING_WAIT => {
                std::thread::sleep(OPENING_LOOK);
            }
            opened => break opened?,
        }
    };
    let line = WireLink::new(file.into()).map_err(|cause| open_error(port, cause))?;
    Ok(Opened {
        line: Box::new(Paced::new(line, baud)),
        not_served: None,
    })
}

/// Opens a serial line that nobody has, and leaves one alone that somebody has: it is not set up
/// anew, and nothing is written to it.
///
/// # Errors
/// As [`open`]; [`OpenError::Busy`] where another program has locked the line.
pub fn open_if_free(port: &Port, baud: u32) -> Result<Box<dyn ByteLink>, OpenError> {
    let Port::Tty(path) = port else {
        return open(port, baud);
    };
    let look = open_file(port, path)?;
    let begun = Instant::now();
    loop {
        match look.try_lock() {
            Ok(()) => break,
            Err(std::fs::TryLockError::WouldBlock) if begun.elapsed() < OPENING_WAIT => {
                std::thread::sleep(OPENING_LOOK);
            }
            Err(std::fs::TryLockError::WouldBlock) => {
                return Err(OpenError::Busy { port: port.clone() });
            }
            Err(std::fs::TryLockError::Error(cause)) => return Err(open_error(port, cause)),
        }
    }
    look.unlock().map_err(|cause| open_error(port, cause))?;
    // Open up to the end: a line that is closed in between may reset the board behind it twice.
    open(port, baud)
}

/// Whether another process of this user has a port open by this library, so that a stop can take
/// it over.
pub fn is_used_by_esm(port: &Port) -> bool {
    takeover::identity(port).is_ok_and(|identity| takeover::is_served(&identity))
}

/// What a port is, however it is named. None of what is not there.
pub fn identity(port: &Port) -> Option<String> {
    takeover::identity(port).ok()
}

/// Who else may use a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// Nobody who heeds locks.
    Alone,
    /// Whoever uses it already.
    Beside,
}

/// Opens a serial line and sets it up.
fn open_tty(port: &Port, path: &Path, baud: u32, used: Use) -> Result<File, OpenError> {
    let settings = serialport::new(path.to_string_lossy(), baud)
        .timeout(SHORTEST_WAIT)
        .exclusive(used == Use::Alone);
    let mut line = TTYPort::open(&settings).map_err(|error| tty_error(port, &error))?;
    // The kernel would let nobody else open it, a stop among them. A shared lock keeps those away
    // who want the line alone.
    line.set_exclusive(false)
        .map_err(|error| tty_error(port, &error))?;
    // Half a frame from before is of no use to anybody.
    let _ = line.clear(serialport::ClearBuffer::Input);
    let file = open_file(port, path)?;
    match file.try_lock_shared() {
        Ok(()) => Ok(file),
        Err(std::fs::TryLockError::WouldBlock) => Err(OpenError::Busy { port: port.clone() }),
        Err(std::fs::TryLockError::Error(cause)) => Err(open_error(port, cause)),
    }
}

/// Opens the file of a serial line, without waiting.
fn open_file(port: &Port, path: &Path) -> Result<File, OpenError> {
    let flags = OFlags::NOCTTY | OFlags::NONBLOCK;
    File::options()
        .read(true)
        .write(true)
        .custom_flags(flags.bits() as i32)
        .open(path)
        .map_err(|cause| open_error(port, cause))
}

/// Connects to a Unix socket. One whose server accepts nobody would keep a blocking call for ever.
fn connect_unix(path: &Path) -> io::Result<UnixStream> {
    let socket = rustix::net::socket(AddressFamily::UNIX, SocketType::STREAM, None)?;
    rustix::io::fcntl_setfd(&socket, rustix::io::FdFlags::CLOEXEC)?;
    rustix::io::ioctl_fionbio(&socket, true)?;
    let address = SocketAddrUnix::new(path)?;
    let begun = Instant::now();
    loop {
        match rustix::net::connect(&socket, &address) {
            Ok(()) => return Ok(socket.into()),
            Err(Errno::AGAIN) if begun.elapsed() < CONNECT_TIMEOUT => {
                std::thread::sleep(OPENING_LOOK);
            }
            Err(error) => return Err(error.into()),
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

/// The `serialport` crate folds what the system says into kinds of its own and keeps the sentence;
/// a look at the file tells which of them it was.
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

/// Whether a failure without a kind means that the port is something else than a terminal: a
/// directory, a plain file, `/dev/null`.
fn is_no_terminal(port: &Port, error: &serialport::Error) -> bool {
    let Port::Tty(path) = port else {
        return false;
    };
    path.is_dir() || error.to_string() == nix::errno::Errno::ENOTTY.desc()
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
}
