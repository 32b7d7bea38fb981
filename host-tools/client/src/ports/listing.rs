//! The serial ports that are plugged in: those that the system lists, and those that the
//! environment names.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::{env, fs};

use serde::Serialize;
use serialport::{SerialPortType, UsbPortInfo};
use thiserror::Error;

use crate::serial;
use crate::serial::port::Port;

/// Names ports that the system does not list, such as pseudo-terminals of `esm board`: paths with a
/// colon between them.
pub const VARIABLE: &str = "ESM_PORTS";

/// The first item of [`VARIABLE`] where what the system lists does not count.
pub const ONLY: &str = "only";

/// As many ports are listed at most.
pub const MAX_PORTS: usize = 256;

/// Where Linux lists its terminals.
const TERMINALS: &str = "/sys/class/tty";

/// Why the ports cannot be listed.
#[derive(Debug, Error)]
pub enum ListError {
    /// The system does not say.
    #[error("the system does not list its serial ports: {cause}; `--port` names one")]
    System {
        /// What it says.
        cause: serialport::Error,
    },
    /// There are more than anyone could plug in.
    #[error("there are {there} serial ports, and {MAX_PORTS} are the most; `--port` names one")]
    TooMany {
        /// How many.
        there: usize,
    },
}

/// What a USB device says of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UsbDevice {
    /// Number of its vendor.
    pub vendor_id: u16,
    /// Number of the product.
    pub product_id: u16,
    /// Its serial number.
    pub serial_number: Option<String>,
    /// Name of the maker.
    pub maker: Option<String>,
    /// Name of the product.
    pub product: Option<String>,
}

impl From<UsbPortInfo> for UsbDevice {
    fn from(told: UsbPortInfo) -> Self {
        UsbDevice {
            vendor_id: told.vid,
            product_id: told.pid,
            serial_number: told.serial_number,
            maker: told.manufacturer,
            product: told.product,
        }
    }
}

/// A serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its path.
    pub path: PathBuf,
    /// What is plugged in, where that is a USB device.
    pub usb: Option<UsbDevice>,
    /// Whether the system has its console there.
    pub is_console: bool,
}

impl Listed {
    /// As `--port` takes it.
    pub fn port(&self) -> Port {
        Port::Tty(self.path.clone())
    }
}

/// The ports that are plugged in, by their paths.
///
/// # Errors
/// [`ListError`]
pub fn listed() -> Result<Vec<Listed>, ListError> {
    let named = env::var_os(VARIABLE).unwrap_or_default();
    let (named, is_all) = named_in(&named);
    let of_system = if is_all { Vec::new() } else { of_system()? };
    let consoles = fs::read_to_string(Path::new(TERMINALS).join("console/active"));
    joined(of_system, named, &consoles.unwrap_or_default())
}

/// The paths in a list with colons, and whether they are all that count.
fn named_in(list: &OsStr) -> (Vec<PathBuf>, bool) {
    let parts = list.as_bytes().split(|byte| *byte == b':');
    let mut paths: Vec<PathBuf> = parts
        .filter(|part| !part.is_empty())
        .map(|part| PathBuf::from(OsStr::from_bytes(part)))
        .collect();
    let is_all = paths.first().is_some_and(|path| path == Path::new(ONLY));
    if is_all {
        paths.remove(0);
    }
    (paths, is_all)
}

/// What the system lists.
fn of_system() -> Result<Vec<(PathBuf, Option<UsbDevice>)>, ListError> {
    // What lists them there counts on it.
    if cfg!(target_os = "linux") && !Path::new(TERMINALS).is_dir() {
        return Ok(Vec::new());
    }
    let ports = serialport::available_ports().map_err(|cause| ListError::System { cause })?;
    let ports = ports.into_iter().map(|port| {
        let usb = match port.port_type {
            SerialPortType::UsbPort(told) => Some(told.into()),
            _ => None,
        };
        (PathBuf::from(port.port_name), usb)
    });
    Ok(ports.filter(|(path, _)| is_there(path)).collect())
}

/// Whether there is hardware behind a port. Linux lists four or more of the first PCs', and macOS
/// each port twice, once by a name whose opening waits for a modem.
fn is_there(path: &Path) -> bool {
    /// The type of a port that nothing was found behind (`PORT_UNKNOWN`, `serial_core.h`).
    const NOTHING: &str = "0";
    let name = path.file_name().unwrap_or_default();
    if cfg!(target_os = "macos") {
        return !name.as_bytes().starts_with(b"tty.");
    }
    let found = fs::read_to_string(Path::new(TERMINALS).join(name).join("type"));
    found.map_or(true, |found| found.trim() != NOTHING)
}

/// Both in one list, by their paths, each port once.
fn joined(
    of_system: Vec<(PathBuf, Option<UsbDevice>)>,
    named: Vec<PathBuf>,
    consoles: &str,
) -> Result<Vec<Listed>, ListError> {
    let named = named.into_iter().map(|path| (path, None));
    let mut ports = BTreeMap::new();
    for (path, usb) in of_system.into_iter().chain(named) {
        // A port that is named twice, or by a link, is one. What is not there is told, too.
        let identity = serial::identity(&Port::Tty(path.clone()));
        let identity = identity.unwrap_or_else(|| path.display().to_string());
        ports.entry(identity).or_insert_with(|| {
            let name = path.file_name().unwrap_or_default();
            let is_console = consoles.split_whitespace().any(|console| console == name);
            Listed {
                path,
                usb,
                is_console,
            }
        });
    }
    if ports.len() > MAX_PORTS {
        return Err(ListError::TooMany { there: ports.len() });
    }
    let mut ports: Vec<Listed> = ports.into_values().collect();
    ports.sort_by(|one, other| one.path.cmp(&other.path));
    Ok(ports)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_adds_ports_or_names_all() {
        let paths = |paths: &[&str]| -> Vec<PathBuf> { paths.iter().map(PathBuf::from).collect() };
        for (list, expected, is_all) in [
            ("", &[][..], false),
            ("/dev/pts/7", &["/dev/pts/7"][..], false),
            ("/dev/pts/7::/a b:", &["/dev/pts/7", "/a b"][..], false),
            ("only", &[][..], true),
            ("only:/dev/pts/7", &["/dev/pts/7"][..], true),
            ("/dev/pts/7:only", &["/dev/pts/7", "only"][..], false),
        ] {
            let named = named_in(OsStr::new(list));
            assert_eq!(named, (paths(expected), is_all), "{list}");
        }
    }

    #[test]
    fn a_port_is_listed_once_and_the_console_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("robot");
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        let of_system = vec![
            ("/dev/null".into(), None),
            ("/no/such/ttyS0".into(), None),
            ("/no/such/ttyS1".into(), None),
        ];
        let ports = joined(of_system, vec![link, "/absent".into()], "tty0 ttyS0\n").unwrap();
        let told: Vec<_> = (ports.iter())
            .map(|port| (port.path.to_str().unwrap(), port.is_console))
            .collect();
        assert_eq!(
            told,
            [
                ("/absent", false),
                ("/dev/null", false),
                ("/no/such/ttyS0", true),
                ("/no/such/ttyS1", false)
            ]
        );
    }

    #[test]
    fn more_ports_than_the_most_are_refused() {
        let named = (0..=MAX_PORTS).map(|number| format!("/no/such/{number}").into());
        let refused = joined(Vec::new(), named.collect(), "").unwrap_err();
        assert!(refused.to_string().contains("257"), "{refused}");
    }
}
