//! The host board's byte link.

use std::collections::VecDeque;
use std::io;
use std::time::{Duration, Instant};

use rt_firmware::LinkPort;
use rt_firmware::link::key_safe::{KeyRecord, KeySafe, NotKept};
use rt_firmware::link::trial::MissionKeeper;
use rt_firmware::store::keep::Keep;

use super::log_lines;
use crate::plant::flash::Flash;
use crate::serial::ByteLink;
use crate::serial::pipe::PipeEnd;

/// Bytes taken from the pipe at once.
const READ_BYTES: usize = 4096;

/// Bytes on their way out before the pipe is written to.
const OUTGOING_LIMIT: usize = 64 * 1024;

/// The link's bytes, and the log's.
pub(super) struct Port<'k> {
    line: PipeEnd,
    incoming: VecDeque<u8>,
    outgoing: Vec<u8>,
    safe: Safe<'k>,
}

/// What the board keeps, and its clock.
struct Safe<'k> {
    keep: Option<Keep<'k, Flash>>,
    started: Instant,
}

impl KeySafe for Safe<'_> {
    fn now_us(&mut self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    fn read(&mut self, record: KeyRecord, room: &mut [u8]) -> Result<usize, NotKept> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.records().read_of_key(record, room)
    }

    fn write(&mut self, record: KeyRecord, bytes: &[u8]) -> Result<(), NotKept> {
        let keep = self.keep.as_mut().ok_or(NotKept)?;
        keep.records().write_of_key(record, bytes)
    }
}

impl<'k> Port<'k> {
    pub(super) fn new(line: PipeEnd, keep: Option<Keep<'k, Flash>>) -> Self {
        Port {
            line,
            incoming: VecDeque::new(),
            outgoing: Vec::new(),
            safe: Safe {
                keep,
                started: Instant::now(),
            },
        }
    }

    /// Brings out what was sent and takes in what has come, waiting up to `timeout` for it.
    ///
    /// # Errors
    /// The other end has gone.
    pub(super) fn exchange(&mut self, timeout: Duration) -> io::Result<()> {
        if !self.outgoing.is_empty() {
            self.line.send(&self.outgoing)?;
            self.outgoing.clear();
        }
        let mut bytes = [0; READ_BYTES];
        let count = self.line.receive(&mut bytes, timeout)?;
        self.incoming.extend(&bytes[..count]);
        Ok(())
    }
}

impl LinkPort for Port<'_> {
    fn receive(&mut self) -> Option<u8> {
        self.incoming.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        if self.outgoing.len() >= OUTGOING_LIMIT {
            // A reader that has gone is noticed at the next exchange.
            let _ = self.line.send(&self.outgoing);
            self.outgoing.clear();
        }
        self.outgoing.push(byte);
        true
    }

    fn read_log(&mut self, room: &mut [u8]) -> usize {
        log_lines::take(room)
    }

    fn log_dropped(&self) -> u32 {
        log_lines::dropped()
    }

    fn key_safe(&mut self) -> Option<&mut dyn KeySafe> {
        match self.safe.keep {
            Some(_) => Some(&mut self.safe),
            None => None,
        }
    }

    fn keeper(&mut self) -> Option<&mut dyn MissionKeeper> {
        self.safe.keep.as_mut().map(|keep| keep as _)
    }
}
