//! The named pipes between the emulated board and the plant, two for its pins, two for its flash,
//! two for its link where the plant carries that, and four for its frames where it is one of
//! several boards, and the threads that serve them.
//!
//! The firmware opens them by semihosting and blocks in them, which stops its virtual time: board
//! and plant run in lock step. The threads never wait for the link client, nor the client for them,
//! but where the plant carries the link: there, that is what makes runs repeat.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Duration;

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::stat::Mode;
use std::os::fd::AsFd;

use esm_toolkit::plant::Pulse;
use rt_firmware::body::line::{LinePart, MESSAGE_BYTES};
use rt_firmware::body::{REQUEST_BYTES, Reply, Request, SONARS};

use crate::lockstep::line::BoardEnd;

/// A pipe each way, by their names in the emulator's working directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Carries requests from the board.
    pub requests: &'static str,
    /// Carries replies to the board.
    pub replies: &'static str,
}

/// Exchanges of pins.
pub const PINS: Pair = Pair {
    requests: "plant-request",
    replies: "plant-reply",
};

/// Operations of the flash.
pub const FLASH: Pair = Pair {
    requests: "flash-request",
    replies: "flash-reply",
};

/// Bytes of the link.
pub const LINK: Pair = Pair {
    requests: "link-request",
    replies: "link-reply",
};

/// Frames that a board sends over its link: a message each, and an answer of one byte.
pub const FRAMES_OUT: Pair = Pair {
    requests: "frame-out-request",
    replies: "frame-out-reply",
};

/// Frames that have arrived at a board: a question with a time each, and an answer with a frame.
pub const FRAMES_IN: Pair = Pair {
    requests: "frame-in-request",
    replies: "frame-in-reply",
};

/// What sonars answer, for an emulator that gives their echoes to pins: a request is any byte, and
/// a reply says of each sonar in how many microseconds its echo rises, and for how many it is high
/// then; 0 where it is not. Numbers of 16 bits, little endian.
pub const PULSES: Pair = Pair {
    requests: "pulse-request",
    replies: "pulse-reply",
};

/// How often a wait looks whether the emulator has ended.
const LOOK_INTERVAL_MS: u16 = 20;

/// Makes these pipes in `folder`.
///
/// # Errors
/// What the system says.
pub fn make(folder: &Path, pairs: &[Pair]) -> io::Result<()> {
    for name in pairs.iter().flat_map(|pair| [pair.requests, pair.replies]) {
        nix::unistd::mkfifo(&folder.join(name), Mode::S_IRUSR | Mode::S_IWUSR)?;
    }
    Ok(())
}

/// Answers what the board asks by one pair of pipes, in a thread, until the board has closed them.
pub struct PipeServer {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl PipeServer {
    /// Starts to serve the pipes of the board's pins in `folder`; `answer` is the plant.
    ///
    /// # Errors
    /// What the system says of the pipe of requests or of the thread.
    pub fn start(
        folder: &Path,
        answer: impl FnMut(&Request) -> Reply + Send + 'static,
    ) -> io::Result<Self> {
        Self::start_pair(folder, PINS, |requests, replies| {
            exchange_pins(requests, replies, answer)
        })
    }

    /// Starts to serve a pair of pipes in `folder` with `serve`, which is given both as soon as the
    /// board has asked for something.
    ///
    /// # Errors
    /// What the system says of the pipe of requests or of the thread.
    pub fn start_pair(
        folder: &Path,
        pair: Pair,
        serve: impl FnOnce(File, File) -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        // Opened before the board starts, so that its own opening never waits.
        let requests = OpenOptions::new()
            .read(true)
            .custom_flags(OFlag::O_NONBLOCK.bits())
            .open(folder.join(pair.requests))?;
        let reply_path = folder.join(pair.replies);
        let stop = Arc::new(AtomicBool::new(false));
        let thread = std::thread::Builder::new()
            .name(pair.requests.into())
            .spawn({
                let stop = Arc::clone(&stop);
                move || match open_replies(&reply_path, &stop)? {
                    Some(replies) if wait_for_request(&requests, &stop)? => {
                        serve(requests, replies)
                    }
                    _ => Ok(()),
                }
            })?;
        Ok(PipeServer {
            stop,
            thread: Some(thread),
        })
    }

    /// Ends the thread; to be called when the emulator has ended, since a board that lives keeps
    /// the pipes open.
    pub fn stop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            // A broken pipe is how every run ends.
            let _ = thread.join();
        }
    }
}

impl Drop for PipeServer {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Answers what sonars do, until the board has closed its end.
///
/// # Errors
/// What the system says.
pub fn tell_pulses(
    mut requests: File,
    mut replies: File,
    mut pulses: impl FnMut() -> [Option<Pulse>; SONARS],
) -> io::Result<()> {
    let mut request = [0];
    while requests.read(&mut request)? > 0 {
        let numbers = pulses().into_iter().flat_map(|pulse| {
            let pulse = pulse.unwrap_or_default();
            [pulse.rises_in_us, pulse.width_us]
        });
        let reply: Vec<u8> = numbers.flat_map(u16::to_le_bytes).collect();
        replies.write_all(&reply)?;
    }
    Ok(())
}

/// Opens the pipe of replies as soon as the board reads from it; `None` where the emulator ended
/// before.
fn open_replies(path: &Path, stop: &AtomicBool) -> io::Result<Option<File>> {
    while !stop.load(Relaxed) {
        let opened = OpenOptions::new()
            .write(true)
            .custom_flags(OFlag::O_NONBLOCK.bits())
            .open(path);
        match opened {
            Ok(replies) => {
                set_blocking(&replies)?;
                return Ok(Some(replies));
            }
            // Nobody has it open for reading yet.
            Err(error) if error.raw_os_error() == Some(nix::errno::Errno::ENXIO as i32) => {
                std::thread::sleep(Duration::from_millis(1));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(None)
}

/// Waits for the first request: before the board has opened its end, a read would see the end of
/// the file.
fn wait_for_request(requests: &File, stop: &AtomicBool) -> io::Result<bool> {
    while !stop.load(Relaxed) {
        let mut watched = [PollFd::new(requests.as_fd(), PollFlags::POLLIN)];
        poll(&mut watched, PollTimeout::from(LOOK_INTERVAL_MS))?;
        if watched[0]
            .revents()
            .is_some_and(|seen| seen.contains(PollFlags::POLLIN))
        {
            set_blocking(requests)?;
            return Ok(true);
        }
        if watched[0]
            .revents()
            .is_some_and(|seen| seen.contains(PollFlags::POLLHUP))
        {
            // The board has closed it again without a word; the poll does not wait any more.
            std::thread::sleep(Duration::from_millis(u64::from(LOOK_INTERVAL_MS)));
        }
    }
    Ok(false)
}

fn set_blocking(file: &File) -> io::Result<()> {
    let flags = OFlag::from_bits_retain(fcntl(file, FcntlArg::F_GETFL)?);
    fcntl(file, FcntlArg::F_SETFL(flags - OFlag::O_NONBLOCK))?;
    Ok(())
}

/// Swaps bytes of the link until the board has closed its pipes.
///
/// # Errors
/// What the system says.
pub fn swap_link(mut requests: File, mut replies: File, line: &BoardEnd) -> io::Result<()> {
    let mut message = [0; MESSAGE_BYTES];
    loop {
        match requests.read_exact(&mut message) {
            Ok(()) => {
                replies.write_all(line.swap(&LinePart::from_bytes(message)).as_bytes())?;
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

fn exchange_pins(
    requests: File,
    replies: File,
    mut answer: impl FnMut(&Request) -> Reply,
) -> io::Result<()> {
    answer_all(requests, replies, |message: &[u8; REQUEST_BYTES]| {
        answer(&Request::decode(message)).encode()
    })
}

/// Answers messages until the board has closed its pipes.
///
/// # Errors
/// What the system says.
pub fn answer_all<const ASKED: usize, const ANSWERED: usize>(
    mut requests: File,
    mut replies: File,
    mut answer: impl FnMut(&[u8; ASKED]) -> [u8; ANSWERED],
) -> io::Result<()> {
    let mut message = [0; ASKED];
    loop {
        match requests.read_exact(&mut message) {
            Ok(()) => replies.write_all(&answer(&message))?,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rt_firmware::body::{REPLY_BYTES, Sensors};

    #[test]
    fn a_board_gets_an_answer_to_each_request() {
        let folder = tempfile::tempdir().unwrap();
        make(folder.path(), &[PINS]).unwrap();
        let mut server = PipeServer::start(folder.path(), |request| Reply {
            sequence: request.sequence,
            sensors: Sensors {
                left_count: request.start_us as u16,
                ..Sensors::default()
            },
        })
        .unwrap();
        let mut to_plant = OpenOptions::new()
            .write(true)
            .open(folder.path().join(PINS.requests))
            .unwrap();
        let mut from_plant = File::open(folder.path().join(PINS.replies)).unwrap();
        for sequence in 0..100 {
            let request = Request {
                sequence,
                start_us: u64::from(sequence) * 7,
                ..Request::default()
            };
            to_plant.write_all(&request.encode()).unwrap();
            let mut reply = [0; REPLY_BYTES];
            from_plant.read_exact(&mut reply).unwrap();
            let reply = Reply::decode(&reply);
            assert_eq!(reply.sequence, sequence);
            assert_eq!(u32::from(reply.sensors.left_count), sequence * 7);
        }
        drop(to_plant);
        server.stop();
    }

    #[test]
    fn a_board_that_never_opens_its_pipes_keeps_nobody_waiting() {
        let folder = tempfile::tempdir().unwrap();
        make(folder.path(), &[PINS]).unwrap();
        let mut server = PipeServer::start(folder.path(), |_| Reply::default()).unwrap();
        server.stop();
    }
}
