//! A pseudo-terminal that other programs can open: the serial line of a robot that is emulated here.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use serialport::{SerialPort, TTYPort};

use super::ByteLink;

/// How long the pump of a direction waits before it looks whether it is to end.
const PUMP_WAIT: Duration = Duration::from_millis(20);

/// How long bytes from the robot wait for a reader that takes none, before they are dropped as on a wire.
const STUCK_READER_WAIT: Duration = Duration::from_millis(100);

const PUMP_BUFFER_BYTES: usize = 1024;

/// Joins `robot`'s line to a new pseudo-terminal for as long as this lives. Bytes for which nobody is there are dropped, as on a wire.
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
        let (master, slave) = TTYPort::pair()?;
        let path = slave.name().map(PathBuf::from).ok_or_else(|| {
            io::Error::new(io::ErrorKind::NotFound, "the pseudo-terminal has no name")
        })?;
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

/// Carries bytes both ways in one thread: towards the robot with a short wait, from it without one.
fn pump(mut master: TTYPort, mut robot: Box<dyn ByteLink>, stop: &AtomicBool) -> io::Result<()> {
    let mut buffer = [0; PUMP_BUFFER_BYTES];
    while !stop.load(Ordering::Relaxed) {
        let mut idle = true;
        match master.receive(&mut buffer, Duration::from_millis(1)) {
            Ok(0) => {}
            Ok(count) => {
                idle = false;
                robot.send(&buffer[..count])?;
            }
            // Nobody has it open. Not an end: the next client may come at any time.
            Err(_) => {}
        }
        let wait = if idle { PUMP_WAIT / 10 } else { Duration::ZERO };
        let count = robot.receive(&mut buffer, wait)?;
        if count > 0 {
            use std::io::Write;
            let _ = master.set_timeout(STUCK_READER_WAIT);
            let _ = master.write_all(&buffer[..count]);
        }
    }
    Ok(())
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
            // Said to nobody: in nobody's way, and dropped, but for what is still under way when somebody comes.
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
