//! Values that several commands take on the command line.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use thiserror::Error;

/// A span of robot time, written as in `.esm` files: `200 ms`, `60s`, `1500 us`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time {
    /// In microseconds.
    pub us: u64,
}

/// Why a text is no [`Time`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum TimeError {
    /// No digits at the start.
    #[error("a time starts with a whole number, as in `200 ms`")]
    NoNumber,
    /// A number without a unit.
    #[error("the unit is missing: write `us`, `ms` or `s` behind the number, as in `200 ms`")]
    NoUnit,
    /// Something else than a unit behind the number.
    #[error("the unit of a time is `us`, `ms` or `s`, as in `200 ms`")]
    UnknownUnit,
    /// More microseconds than 64 bits hold.
    #[error("that is more time than can be counted (the limit is 2^64 microseconds)")]
    TooLong,
}

/// Microseconds in one `unit` of the language, `None` for any other word.
pub fn unit_us(unit: &str) -> Option<u64> {
    match unit {
        "us" => Some(1),
        "ms" => Some(1_000),
        "s" => Some(1_000_000),
        _ => None,
    }
}

impl FromStr for Time {
    type Err = TimeError;

    fn from_str(text: &str) -> Result<Self, TimeError> {
        let text = text.trim();
        let digits_end = text
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(text.len());
        let (digits, unit) = text.split_at(digits_end);
        if digits.is_empty() {
            return Err(TimeError::NoNumber);
        }
        let unit = unit.trim_start();
        if unit.is_empty() {
            return Err(TimeError::NoUnit);
        }
        let unit_us = unit_us(unit).ok_or(TimeError::UnknownUnit)?;
        let number: u64 = digits.parse().map_err(|_| TimeError::TooLong)?;
        Ok(Time {
            us: number.checked_mul(unit_us).ok_or(TimeError::TooLong)?,
        })
    }
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.us {
            us if us % 1_000_000 == 0 => write!(f, "{} s", us / 1_000_000),
            us if us % 1_000 == 0 => write!(f, "{} ms", us / 1_000),
            us => write!(f, "{us} us"),
        }
    }
}

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
}

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
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_as_in_the_language() {
        let cases: [(&str, Result<u64, TimeError>); 14] = [
            ("1500 us", Ok(1_500)),
            ("200ms", Ok(200_000)),
            ("200 ms", Ok(200_000)),
            (" 60 \t s ", Ok(60_000_000)),
            ("0s", Ok(0)),
            ("18446744073709551615us", Ok(u64::MAX)),
            ("18446744073709551616us", Err(TimeError::TooLong)),
            ("18446744073709552 s", Err(TimeError::TooLong)),
            ("", Err(TimeError::NoNumber)),
            ("s", Err(TimeError::NoNumber)),
            ("-1 s", Err(TimeError::NoNumber)),
            ("60", Err(TimeError::NoUnit)),
            ("1.5 s", Err(TimeError::UnknownUnit)),
            ("1 min", Err(TimeError::UnknownUnit)),
        ];
        for (text, expected) in cases {
            assert_eq!(
                text.parse::<Time>().map(|time| time.us),
                expected,
                "{text:?}"
            );
        }
    }

    #[test]
    fn a_time_shown_reads_back_as_itself() {
        for us in [0, 1, 999, 1_000, 1_001, 1_500_000, 60_000_000, u64::MAX] {
            assert_eq!(Time { us }.to_string().parse(), Ok(Time { us }));
        }
    }

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
