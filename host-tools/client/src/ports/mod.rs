//! Serial ports that are plugged in, and the robots behind them.
//!
//! A port says nothing of what is behind it. So each is asked as a robot is: whoever answers is
//! one. What other programs have is left alone.

pub mod listing;

use std::fmt;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use esm_link::message::Mode;
use thiserror::Error;

use crate::interrupt;
use crate::link_client::{ClientError, LinkClient, RobotInfo};
use crate::reading::Reader;
use crate::serial::clock::Clock;
use crate::serial::port::Port;
use crate::serial::{self, ByteLink, OpenError};

pub use listing::{ListError, Listed, UsbDevice, VARIABLE, listed};

/// How long a port may take to answer. A robot answers within milliseconds; one whose processor is
/// busy, or whose line is bad, gets some more questions.
const ASK_TIME: Duration = Duration::from_millis(900);

/// How long a port may take in all: opening some lets a radio connect first.
const LONGEST_ASK: Duration = Duration::from_millis(1_200);

/// As many ports are asked at once.
const AT_ONCE: usize = 32;

/// How often Ctrl-C is looked for meanwhile.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// What a robot is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// Who it is: a matter of milliseconds.
    Who,
    /// Also what its mission is called, which is read for that.
    WhoAndWhat,
}

/// What is behind a port.
#[derive(Debug)]
pub enum Behind {
    /// A robot.
    Robot {
        /// What it says of itself.
        info: Box<RobotInfo>,
        /// Whether it runs, where it said so in time.
        mode: Option<Mode>,
        /// Name of the machine that it runs, where it was [asked](Question::WhoAndWhat) and sent
        /// its mission in time.
        machine: Option<String>,
    },
    /// A robot that this program cannot talk to.
    OtherVersion(ClientError),
    /// Another program has the port. What is behind it was not asked.
    InUse {
        /// Whether that is a command of this user's, which a stop takes the port over from.
        by_esm: bool,
    },
    /// The system's console, which was not asked.
    Console,
    /// Something that does not open.
    Unopened(OpenError),
    /// No robot, or none that hears what is asked.
    NoRobot {
        /// Whether anything came.
        has_spoken: bool,
    },
}

impl Behind {
    /// Whether a command that is given no port may be meant for this one.
    fn may_be_meant(&self) -> bool {
        match self {
            Behind::Robot { .. } | Behind::OtherVersion(_) => true,
            Behind::InUse { by_esm } => *by_esm,
            Behind::Console | Behind::Unopened(_) | Behind::NoRobot { .. } => false,
        }
    }
}

/// What it is, in a line, with what to do.
impl fmt::Display for Behind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Behind::Robot { info, .. } => {
                write!(f, "a robot: board {}, firmware {}", info.board, info.firmware)
            }
            Behind::OtherVersion(error) => write!(f, "{error}"),
            Behind::InUse { by_esm: true } => f.write_str("in use by another esm command"),
            Behind::InUse { by_esm: false } => f.write_str("in use by another program"),
            Behind::Console => f.write_str("the console of this computer, which is not asked"),
            Behind::Unopened(error) => write!(f, "{error}"),
            Behind::NoRobot { has_spoken: true } => f.write_str(
                "no robot: what comes from there is no answer; is it another device, or has the line another rate (--baud)?",
            ),
            Behind::NoRobot { has_spoken: false } => f.write_str(
                "no robot: nothing answers; is it switched on, are its wires crossed (TX to RX), does its firmware run?",
            ),
        }
    }
}

/// A port that was asked.
#[derive(Debug)]
pub struct Asked {
    /// The port.
    pub listed: Listed,
    /// What is behind it.
    pub behind: Behind,
}

impl fmt::Display for Asked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.listed.path.display().to_string();
        let told = self.behind.to_string();
        // Some sentences have the port in them.
        match told.contains(&path) {
            true => f.write_str(&told),
            false => write!(f, "{path}: {told}"),
        }
    }
}

/// Why it is not clear which robot is meant.
#[derive(Debug, Error)]
pub enum FindError {
    /// The ports are not known.
    #[error(transparent)]
    List(#[from] ListError),
    /// There is no port.
    #[error(
        "no robot is plugged in: there is no serial port; plug it in, or name its port with `--port`, also that of `esm board`"
    )]
    NoPort,
    /// None of the ports has a robot.
    #[error("no robot answers; `--port` names a port{}", list(.asked))]
    NoRobot {
        /// The ports.
        asked: Vec<Asked>,
    },
    /// Several may be meant.
    #[error("more than one robot may be meant; `--port` says which{}", list(.asked))]
    Several {
        /// The ports.
        asked: Vec<Asked>,
    },
    /// Ctrl-C came.
    #[error("interrupted while ports were asked for robots")]
    Interrupted,
}

/// A line for each port.
fn list(asked: &[Asked]) -> String {
    asked.iter().map(|port| format!("\n  {port}")).collect()
}

/// The one port that is meant where none is named: that of the only robot. A port that another
/// `esm` command has counts as one with a robot.
///
/// # Errors
/// [`FindError`]
pub fn find_robot(baud: u32) -> Result<Asked, FindError> {
    only_one(ask_all(listed()?, baud, Question::Who)?)
}

fn only_one(mut asked: Vec<Asked>) -> Result<Asked, FindError> {
    let meant = |port: &Asked| port.behind.may_be_meant();
    match asked.iter().filter(|port| meant(port)).count() {
        1 => {
            let place = asked.iter().position(meant).unwrap_or_default();
            Ok(asked.swap_remove(place))
        }
        0 if asked.is_empty() => Err(FindError::NoPort),
        0 => Err(FindError::NoRobot { asked }),
        _ => Err(FindError::Several { asked }),
    }
}

/// Asks all ports who is behind them, at once and not for long.
///
/// # Errors
/// [`FindError::Interrupted`]
pub fn ask_all(ports: Vec<Listed>, baud: u32, question: Question) -> Result<Vec<Asked>, FindError> {
    let mut asked = Vec::with_capacity(ports.len());
    let mut ports = ports.into_iter().peekable();
    while ports.peek().is_some() {
        let some = ports.by_ref().take(AT_ONCE).collect();
        asked.extend(ask_some(some, baud, question)?);
    }
    Ok(asked)
}

/// Asks so many ports at once. Who does not answer in time is not waited for.
fn ask_some(ports: Vec<Listed>, baud: u32, question: Question) -> Result<Vec<Asked>, FindError> {
    let begun = Instant::now();
    let (tell, told) = mpsc::channel();
    let mut found: Vec<Option<Behind>> = Vec::new();
    for (index, listed) in ports.iter().cloned().enumerate() {
        let teller = tell.clone();
        let thread = std::thread::Builder::new().name("ask a port".into());
        let started = thread.spawn({
            let listed = listed.clone();
            // Where nobody listens any more, it is too late.
            move || drop(teller.send((index, ask(&listed, baud, question))))
        });
        let port = listed.port();
        found.push(started.err().map(|cause| unopened(port, cause)));
    }
    drop(tell);
    while begun.elapsed() < LONGEST_ASK {
        match told.recv_timeout(LOOK_INTERVAL) {
            Ok((index, behind)) => {
                if let Some(place) = found.get_mut(index) {
                    *place = Some(behind);
                }
            }
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if interrupt::is_requested() {
            return Err(FindError::Interrupted);
        }
    }
    let asked = ports.into_iter().zip(found);
    let asked = asked.map(|(listed, behind)| {
        let too_late = || io::Error::new(io::ErrorKind::TimedOut, "it does not open in time");
        let behind = behind.unwrap_or_else(|| unopened(listed.port(), too_late()));
        Asked { listed, behind }
    });
    Ok(asked.collect())
}

fn unopened(port: Port, cause: io::Error) -> Behind {
    Behind::Unopened(OpenError::System { port, cause })
}

/// Asks one port.
fn ask(listed: &Listed, baud: u32, question: Question) -> Behind {
    if listed.is_console {
        return Behind::Console;
    }
    let port = listed.port();
    let link = match serial::open_if_free(&port, baud) {
        Ok(link) => link,
        Err(OpenError::Busy { .. }) => {
            return Behind::InUse {
                by_esm: serial::is_used_by_esm(&port),
            };
        }
        Err(error) => return Behind::Unopened(error),
    };
    let has_spoken = Arc::new(AtomicBool::new(false));
    let link = Overheard {
        link,
        has_spoken: Arc::clone(&has_spoken),
    };
    let until = Box::new(interrupt::is_requested);
    match LinkClient::connect_within(link, Some(ASK_TIME), Some(until)) {
        Ok((mut robot, info)) => {
            let mode = robot.status().ok().map(|status| status.mode);
            let mission = info.mission.filter(|_| question == Question::WhoAndWhat);
            let machine = mission.and_then(|mission| {
                let read = Reader::default().machine(&mut robot, mission);
                read.ok().flatten()
            });
            Behind::Robot {
                info: Box::new(info),
                mode,
                machine,
            }
        }
        Err(error @ ClientError::OtherVersion { .. }) => Behind::OtherVersion(error),
        // A stop has taken the port over: somebody knows that there is a robot.
        Err(ClientError::Line(error)) if serial::wire::is_taken_over(&error) => {
            Behind::InUse { by_esm: true }
        }
        Err(_) => Behind::NoRobot {
            has_spoken: has_spoken.load(Ordering::Relaxed),
        },
    }
}

/// A line that says whether anything came.
struct Overheard {
    link: Box<dyn ByteLink>,
    has_spoken: Arc<AtomicBool>,
}

impl ByteLink for Overheard {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let count = self.link.receive(buffer, timeout)?;
        if count > 0 {
            self.has_spoken.store(true, Ordering::Relaxed);
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.link.send(bytes)
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.link.try_send(bytes)
    }

    fn clock(&self) -> Clock {
        self.link.clock()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(name: &str, behind: Behind) -> Asked {
        Asked {
            listed: Listed {
                path: name.into(),
                usb: None,
                is_console: false,
            },
            behind,
        }
    }

    fn other_version() -> Behind {
        Behind::OtherVersion(ClientError::OtherVersion { robot: 9_999 })
    }

    const SILENT: Behind = Behind::NoRobot { has_spoken: false };
    const BY_ESM: Behind = Behind::InUse { by_esm: true };
    const BY_OTHERS: Behind = Behind::InUse { by_esm: false };

    #[test]
    fn a_port_is_taken_only_where_no_other_may_be_meant() {
        let found = only_one(vec![
            asked("/a", SILENT),
            asked("/b", BY_OTHERS),
            asked("/c", other_version()),
            asked("/d", Behind::Console),
        ]);
        assert_eq!(found.unwrap().listed.path.to_str(), Some("/c"));
        let found = only_one(vec![asked("/a", BY_ESM)]);
        assert_eq!(found.unwrap().listed.path.to_str(), Some("/a"));
        let several = only_one(vec![
            asked("/a", SILENT),
            asked("/b", BY_ESM),
            asked("/c", other_version()),
        ]);
        let told = several.unwrap_err().to_string();
        assert_eq!(told.lines().count(), 4, "{told}");
        for port in ["/a: no robot", "/b: in use", "/c: the robot speaks"] {
            assert!(told.contains(port), "{told}");
        }
    }

    #[test]
    fn where_there_is_no_robot_all_ports_are_told() {
        assert!(matches!(only_one(Vec::new()), Err(FindError::NoPort)));
        let none = only_one(vec![asked("/a", SILENT), asked("/b", BY_OTHERS)]);
        let told = none.unwrap_err().to_string();
        assert!(told.contains("/a: no robot: nothing answers"), "{told}");
        assert!(told.contains("/b: in use by another program"), "{told}");
    }

    #[test]
    fn what_does_not_open_is_told_with_its_port_once() {
        let port = Port::Tty("/no/such/port".into());
        let told = asked(
            "/no/such/port",
            Behind::Unopened(OpenError::Missing { port }),
        );
        assert_eq!(told.to_string().matches("/no/such/port").count(), 1);
    }
}
