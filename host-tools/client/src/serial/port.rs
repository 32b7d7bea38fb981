//! The name of a port: how a person says where a robot is reached.

use std::fmt;
use std::io;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use thiserror::Error;

use super::ByteLink;

/// Where a robot is reached.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Port {
    /// A serial line or a pseudo-terminal: its path.
    Tty(PathBuf),
    /// `unix:PATH`: a Unix socket.
    Unix(PathBuf),
    /// `tcp:HOST:PORT`: a TCP socket.
    Tcp {
        /// Name or address; an IPv6 address without its brackets.
        host: String,
        /// TCP port.
        port: u16,
    },
    /// A line of somebody's own, that no name stands for.
    Own(OwnLine),
}

/// What opens a line that this program knows nothing of: for a program that has commands run within
/// it.
#[derive(Clone)]
pub struct OwnLine {
    open: Arc<dyn Fn() -> io::Result<Box<dyn ByteLink>> + Send + Sync>,
}

impl OwnLine {
    /// A line that is opened like this.
    pub fn new(open: impl Fn() -> io::Result<Box<dyn ByteLink>> + Send + Sync + 'static) -> Self {
        OwnLine {
            open: Arc::new(open),
        }
    }

    /// Opens it.
    ///
    /// # Errors
    /// Whatever keeps it from being opened.
    pub fn open(&self) -> io::Result<Box<dyn ByteLink>> {
        (self.open)()
    }
}

impl fmt::Debug for OwnLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("OwnLine")
    }
}

/// The same line.
impl PartialEq for OwnLine {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.open, &other.open)
    }
}

impl Eq for OwnLine {}

/// Why a text is no [`Port`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum PortError {
    /// Nothing, or nothing behind the prefix.
    #[error("name a port: a serial line such as /dev/ttyUSB0, unix:PATH or tcp:HOST:PORT")]
    Empty,
    /// `tcp:` without a usable host and number.
    #[error("a TCP port is written tcp:HOST:PORT, as in tcp:localhost:4000")]
    BadTcp,
}

impl FromStr for Port {
    type Err = PortError;

    fn from_str(text: &str) -> Result<Self, PortError> {
        if let Some(path) = text.strip_prefix("unix:") {
            return if path.is_empty() {
                Err(PortError::Empty)
            } else {
                Ok(Port::Unix(path.into()))
            };
        }
        if let Some(address) = text.strip_prefix("tcp:") {
            let (host, port) = address.rsplit_once(':').ok_or(PortError::BadTcp)?;
            let host = host
                .strip_prefix('[')
                .and_then(|host| host.strip_suffix(']'))
                .unwrap_or(host);
            let port = port.parse().map_err(|_| PortError::BadTcp)?;
            return if host.is_empty() {
                Err(PortError::BadTcp)
            } else {
                Ok(Port::Tcp {
                    host: host.to_owned(),
                    port,
                })
            };
        }
        if text.is_empty() {
            Err(PortError::Empty)
        } else {
            Ok(Port::Tty(text.into()))
        }
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Port::Tty(path) => write!(f, "{}", path.display()),
            Port::Unix(path) => write!(f, "unix:{}", path.display()),
            Port::Tcp { host, port } if host.contains(':') => write!(f, "tcp:[{host}]:{port}"),
            Port::Tcp { host, port } => write!(f, "tcp:{host}:{port}"),
            Port::Own(_) => f.write_str("a line of its own"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_are_told_apart_by_their_prefix() {
        let tcp = |host: &str, port| {
            Ok(Port::Tcp {
                host: host.into(),
                port,
            })
        };
        let cases = [
            ("/dev/ttyUSB0", Ok(Port::Tty("/dev/ttyUSB0".into()))),
            ("COM3", Ok(Port::Tty("COM3".into()))),
            ("unix:/tmp/uart0", Ok(Port::Unix("/tmp/uart0".into()))),
            ("tcp:localhost:4000", tcp("localhost", 4000)),
            ("tcp:[::1]:4000", tcp("::1", 4000)),
            ("", Err(PortError::Empty)),
            ("unix:", Err(PortError::Empty)),
            ("tcp:localhost", Err(PortError::BadTcp)),
            ("tcp::4000", Err(PortError::BadTcp)),
            ("tcp:localhost:70000", Err(PortError::BadTcp)),
        ];
        for (text, expected) in cases {
            let parsed: Result<Port, PortError> = text.parse();
            assert_eq!(parsed, expected, "{text:?}");
            if let Ok(port) = parsed {
                assert_eq!(port.to_string(), text, "shown as it was written");
            }
        }
    }
}
