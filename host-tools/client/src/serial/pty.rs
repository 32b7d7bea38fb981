//! A pseudo-terminal that other programs can open: the serial line of a robot that is emulated
//! here.

use std::ffi::OsString;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::ByteLink;

/// How long the pump waits for the robot's bytes before it looks for the client's.
const PUMP_WAIT: Duration = Duration::from_millis(2);

/// How long bytes from the robot wait for a reader that takes none, before they are dropped as on a
/// wire.
const STUCK_READER_WAIT: Duration = Duration::from_millis(100);

const PUMP_BUFFER_BYTES: usize = 1024;

/// Bytes from the robot that wait for their reader at most.
const TO_CLIENT_BYTES: usize = 64 * 1024;

/// Joins `robot`'s line to a new pseudo-terminal for as long as this lives. Bytes for which nobody
/// is there are dropped, as on a wire.
pub struct PtyServer {
    path: PathBuf,
    stop: Arc<AtomicBool>,
    pump: Option<JoinHandle<io::Result<()>>>,
}

impl PtyServer {
    /// Makes the pseudo-terminal and starts to carry bytes.
    ///
    /// # Errors
    /// What the system says, where it has no pseudo-terminal to give.
    pub fn start(robot: Box<dyn ByteLink>) -> io::Result<Self> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        rustix::io::fcntl_setfd(&master, rustix::io::FdFlags::CLOEXEC)?;
        rustix::io::ioctl_fionbio(&master, true)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        let path = PathBuf::from(OsString::from_vec(
            ptsname(&master, Vec::new())?.into_bytes(),
        ));
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave = rustix::fs::open(&path, flags, Mode::empty())?;
        let mut settings = tcgetattr(&slave)?;
        settings.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &settings)?;
        // Kept open here, the line would keep a dead client's claim to it for ever.
        drop(slave);
        let stop = Arc::new(AtomicBool::new(false));
        let pump = std::thread::Builder::new().name("pty".into()).spawn({
            let stop = Arc::clone(&stop);
            move || pump(master, robot, &stop)
        })?;
        Ok(PtyServer {
            path,
            stop,
            pump: Some(pump),
        })
    }

    /// The port that others open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the robot's end has closed.
    pub fn has_ended(&self) -> bool {
        self.pump.as_ref().is_none_or(JoinHandle::is_finished)
    }
}

impl Drop for PtyServer {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(pump) = self.pump.take() {
            // What ended it is of no interest any more.
            let _ = pump.join();
        }
    }
}

/// Carries bytes both ways in one thread, which waits for the robot's next byte alone, and not for
/// long. Where the robot takes nothing, the client waits as on a line with flow control; where the
/// client takes nothing, bytes are lost.
fn pump(master: OwnedFd, mut robot: Box<dyn ByteLink>, stop: &AtomicBool) -> io::Result<()> {
    let mut buffer = [0; PUMP_BUFFER_BYTES];
    let mut to_robot = Vec::new();
    let mut to_client = ToClient::default();
    while !stop.load(Ordering::Relaxed) {
        if to_robot.is_empty() {
            // An error: nobody has it open. Not an end: the next client may come at any time.
            let count = rustix::io::read(&master, &mut buffer).unwrap_or(0);
            to_robot.extend_from_slice(&buffer[..count]);
        }
        let sent = robot.try_send(&to_robot)?;
        to_robot.drain(..sent);
        let is_idle = sent == 0 && to_client.bytes.is_empty();
        let wait = if is_idle || !to_robot.is_empty() || to_client.is_stuck() {
            PUMP_WAIT
        } else {
            Duration::ZERO
        };
        let count = robot.receive(&mut buffer, wait)?;
        to_client.take(&buffer[..count]);
        to_client.write(&master);
    }
    Ok(())
}

/// Bytes from the robot on their way to its client.
#[derive(Default)]
struct ToClient {
    bytes: Vec<u8>,
    /// Since when the client has taken none.
    stuck_since: Option<Instant>,
}

impl ToClient {
    /// What has no room is lost.
    fn take(&mut self, bytes: &[u8]) {
        let room = TO_CLIENT_BYTES - self.bytes.len();
        self.bytes
            .extend_from_slice(&bytes[..bytes.len().min(room)]);
    }

    fn is_stuck(&self) -> bool {
        self.stuck_since.is_some()
    }

    /// Hands on what the client takes at once. What it has not taken for a while is lost.
    fn write(&mut self, master: &OwnedFd) {
        while !self.bytes.is_empty() {
            match rustix::io::write(master, &self.bytes) {
                Ok(count @ 1..) => {
                    self.bytes.drain(..count);
                    self.stuck_since = None;
                }
                Ok(0) | Err(Errno::AGAIN | Errno::INTR) => {
                    let since = *self.stuck_since.get_or_insert_with(Instant::now);
                    if since.elapsed() < STUCK_READER_WAIT {
                        return;
                    }
                    self.bytes.clear();
                }
                // There is no client.
                Err(_) => self.bytes.clear(),
            }
        }
        self.stuck_since = None;
    }
}

#[cfg(test)]
mod tests {
    use super::super::{DEFAULT_BAUD, open, pipe};
    use super::*;
    use crate::serial::port::Port;

    /// Longer than this machine takes over anything.
    const LONG: Duration = Duration::from_secs(60);

    /// What comes up to these bytes.
    fn heard_up_to(link: &mut dyn ByteLink, last: &[u8]) -> Vec<u8> {
        let mut buffer = [0; 64];
        let mut heard = Vec::new();
        while !heard.ends_with(last) {
            let count = link.receive(&mut buffer, LONG).unwrap();
            assert!(count > 0, "{last:?} did not come, but {heard:?}");
            heard.extend_from_slice(&buffer[..count]);
        }
        heard
    }

    #[test]
    fn clients_come_and_go_and_the_robot_stays() {
        let (robot, mut far) = pipe::pair();
        let server = PtyServer::start(Box::new(robot)).unwrap();
        let port = Port::Tty(server.path().to_owned());
        for round in 0..3_u8 {
            // Said to nobody: in nobody's way, and dropped, but for what is still under way when
            // somebody comes.
            far.send(b"anyone?").unwrap();
            let mut client = open(&port, DEFAULT_BAUD).unwrap();
            let sent = [0, round, 0x0d, 0xff];
            client.send(&sent).unwrap();
            assert_eq!(heard_up_to(&mut far, &sent), sent);
            let answer = [0x0a, round];
            far.send(&answer).unwrap();
            let heard = heard_up_to(&mut client, &answer);
            let before = heard.strip_suffix(&answer).unwrap();
            assert!(b"anyone?".ends_with(before), "round {round}: {before:?}");
        }
        assert!(!server.has_ended());
        drop(far);
        let deadline = std::time::Instant::now() + LONG;
        while !server.has_ended() && std::time::Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(server.has_ended(), "the robot's end has closed");
    }
}
