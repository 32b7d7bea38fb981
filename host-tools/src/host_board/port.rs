//! The host board's byte link.

use std::collections::VecDeque;
use std::io;
use std::time::{Duration, Instant};

use rt_firmware::body::line::{INTERVAL_US, LinePart, PART_BYTES};
use rt_firmware::link::key_safe::{KeyRecord, KeySafe, NotKept};
use rt_firmware::link::trial::MissionKeeper;
use rt_firmware::store::keep::Keep;
use rt_firmware::{LinkPort, StopListener};

use super::log_lines;
use crate::lockstep::line::BoardEnd;
use crate::plant::flash::Flash;
use crate::serial::ByteLink;
use crate::serial::pipe::PipeEnd;

/// Bytes taken from the pipe at once.
const READ_BYTES: usize = 4096;

/// Bytes on their way out before the pipe is written to.
const OUTGOING_LIMIT: usize = 64 * 1024;

/// Where the link's bytes go.
pub(super) enum Line {
    /// To whoever has the pipe's other end, as fast as both can.
    Pipe(PipeEnd),
    /// To a client that shares the board's virtual time, at the pace of a serial line.
    Plant(BoardEnd),
}

/// The link's bytes, and the log's.
pub(super) struct Port<'k> {
    line: Line,
    incoming: VecDeque<u8>,
    outgoing: VecDeque<u8>,
    listener: StopListener<'k>,
    /// A stop was heard since that was asked last.
    has_heard_stop: bool,
    now_us: u64,
    safe: Safe<'k>,
}

/// What the board keeps, and its clock.
struct Safe<'k> {
    keep: Option<Keep<'k, Flash>>,
    clock: SafeClock,
}

enum SafeClock {
    Wall {
        started: Instant,
    },
    /// The board's virtual time when it last swapped bytes.
    Virtual {
        now_us: u64,
    },
}

impl KeySafe for Safe<'_> {
    fn now_us(&mut self) -> u64 {
        match self.clock {
            SafeClock::Wall { started } => started.elapsed().as_micros() as u64,
            SafeClock::Virtual { now_us } => now_us,
        }
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
    pub(super) fn new(
        line: Line,
        keep: Option<Keep<'k, Flash>>,
        listener: StopListener<'k>,
    ) -> Self {
        let clock = match line {
            Line::Pipe(_) => SafeClock::Wall {
                started: Instant::now(),
            },
            Line::Plant(_) => SafeClock::Virtual { now_us: 0 },
        };
        Port {
            line,
            incoming: VecDeque::new(),
            outgoing: VecDeque::new(),
            listener,
            has_heard_stop: false,
            now_us: 0,
            safe: Safe { keep, clock },
        }
    }

    /// Whether a stop was heard since this was asked last.
    pub(super) fn has_heard_stop(&mut self) -> bool {
        std::mem::take(&mut self.has_heard_stop)
    }

    /// Takes bytes off the line.
    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.has_heard_stop |= self.listener.hear(*byte, true);
        }
        self.incoming.extend(bytes);
    }

    /// The board's clock says this.
    pub(super) fn set_clock(&mut self, now_us: u64) {
        self.now_us = now_us;
    }

    /// When the next bytes are swapped by the board's virtual time, where they are.
    pub(super) fn swaps_at_us(&self) -> Option<u64> {
        match self.safe.clock {
            SafeClock::Wall { .. } => None,
            SafeClock::Virtual { now_us } => Some(now_us + u64::from(INTERVAL_US)),
        }
    }

    /// Whether it takes a byte to be sent.
    pub(super) fn has_room(&self) -> bool {
        match self.line {
            Line::Pipe(_) => true,
            // What the next swap takes: a serial line has no room for more, and the link keeps the rest.
            Line::Plant(_) => self.outgoing.len() < PART_BYTES,
        }
    }

    /// Swaps bytes with the client at `now_us` of the board's virtual time.
    pub(super) fn swap(&mut self, at_us: u64) {
        if let (Line::Plant(line), SafeClock::Virtual { now_us }) =
            (&self.line, &mut self.safe.clock)
        {
            *now_us = at_us;
            let mut part = LinePart::new(PART_BYTES);
            while !part.is_full() {
                let Some(byte) = self.outgoing.pop_front() else {
                    break;
                };
                part.push(byte);
            }
            let part = line.swap(&part);
            self.take(part.carried());
        }
    }

    /// Brings out what was sent and takes in what has come by a pipe, waiting up to `timeout` for it.
    ///
    /// # Errors
    /// The other end has gone.
    pub(super) fn exchange(&mut self, timeout: Duration) -> io::Result<()> {
        let Line::Pipe(line) = &mut self.line else {
            return Ok(());
        };
        if !self.outgoing.is_empty() {
            line.send(self.outgoing.make_contiguous())?;
            self.outgoing.clear();
        }
        let mut bytes = [0; READ_BYTES];
        let count = line.receive(&mut bytes, timeout)?;
        self.take(&bytes[..count]);
        Ok(())
    }
}

impl LinkPort for Port<'_> {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        self.incoming.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        if !self.has_room() {
            return false;
        }
        if let Line::Pipe(line) = &mut self.line
            && self.outgoing.len() >= OUTGOING_LIMIT
        {
            // A reader that has gone is noticed at the next exchange.
            let _ = line.send(self.outgoing.make_contiguous());
            self.outgoing.clear();
        }
        self.outgoing.push_back(byte);
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
