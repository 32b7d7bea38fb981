//! The host board's byte link.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Duration;

use esm_link::key_store::KeyStore;
use rt_firmware::body::line::{INTERVAL_US, LinePart, PART_BYTES};
use rt_firmware::mission_store::MissionStore;
use rt_firmware::store::flash_store::FlashStore;
use rt_firmware::{LinkPort, StopListener};

use crate::flash::Flash;
use crate::lockstep::line::BoardEnd;
use crate::serial::ByteLink;
use crate::serial::pipe::PipeEnd;
use esm_toolkit::host_board::{HostPort, log_lines};

/// Bytes taken from the pipe at once.
const READ_BYTES: usize = 4096;

/// Bytes on their way out before the pipe is written to.
const OUTGOING_LIMIT: usize = 64 * 1024;

/// Bytes that have come and wait for the link at most. More stay in the pipe.
const INCOMING_LIMIT: usize = 64 * 1024;

/// How long a board whose client takes no bytes waits for that before it looks whether it is to
/// end.
const ROOM_WAIT: Duration = Duration::from_millis(20);

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
    /// The board's time when it last swapped bytes with the plant.
    swapped_at_us: u64,
    keep: Option<FlashStore<'k, Flash>>,
    /// The board is to end.
    stop: &'k AtomicBool,
}

impl<'k> Port<'k> {
    pub(super) fn new(
        line: Line,
        keep: Option<FlashStore<'k, Flash>>,
        listener: StopListener<'k>,
        stop: &'k AtomicBool,
    ) -> Self {
        Port {
            line,
            incoming: VecDeque::new(),
            outgoing: VecDeque::new(),
            listener,
            has_heard_stop: false,
            now_us: 0,
            swapped_at_us: 0,
            keep,
            stop,
        }
    }

    /// Takes bytes off the line.
    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.has_heard_stop |= self.listener.hear(*byte, true);
        }
        self.incoming.extend(bytes);
    }

    /// Brings out what was sent and takes in what has come by a pipe, waiting up to `timeout` for
    /// it.
    ///
    /// # Errors
    /// The other end has gone.
    pub(super) fn exchange(&mut self, timeout: Duration) -> io::Result<()> {
        self.bring_out()?;
        self.take_in(timeout)
    }

    /// Hands on what was sent. A client that takes nothing is waited for, so that nothing is lost
    /// to one that is slow; what it sends is taken in meanwhile, should it wait for that.
    ///
    /// # Errors
    /// The other end has gone, or the board is to end.
    fn bring_out(&mut self) -> io::Result<()> {
        while !self.outgoing.is_empty() {
            let Line::Pipe(line) = &mut self.line else {
                return Ok(());
            };
            let sent = line.try_send(self.outgoing.make_contiguous())?;
            self.outgoing.drain(..sent);
            if sent == 0 {
                if self.stop.load(Relaxed) {
                    return Err(io::ErrorKind::Interrupted.into());
                }
                line.wait_for_room(ROOM_WAIT);
                self.take_in(Duration::ZERO)?;
            }
        }
        Ok(())
    }

    /// Takes in what has come, waiting up to `timeout` for it.
    fn take_in(&mut self, timeout: Duration) -> io::Result<()> {
        let Line::Pipe(line) = &mut self.line else {
            return Ok(());
        };
        let mut bytes = [0; READ_BYTES];
        if self.incoming.len() + bytes.len() <= INCOMING_LIMIT {
            let count = line.receive(&mut bytes, timeout)?;
            self.take(&bytes[..count]);
        }
        Ok(())
    }
}

impl HostPort for Port<'_> {
    fn set_clock(&mut self, now_us: u64) {
        self.now_us = now_us;
    }

    fn has_room(&self) -> bool {
        match self.line {
            Line::Pipe(_) => true,
            // What the next swap takes: a serial line has no room for more, and the link keeps the
            // rest.
            Line::Plant(_) => self.outgoing.len() < PART_BYTES,
        }
    }

    fn has_heard_stop(&mut self) -> bool {
        std::mem::take(&mut self.has_heard_stop)
    }

    fn swaps_at_us(&self) -> Option<u64> {
        match self.line {
            Line::Pipe(_) => None,
            Line::Plant(_) => Some(self.swapped_at_us + u64::from(INTERVAL_US)),
        }
    }

    fn swap(&mut self, at_us: u64) {
        if let Line::Plant(line) = &self.line {
            self.swapped_at_us = at_us;
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
        if self.outgoing.len() >= OUTGOING_LIMIT && self.bring_out().is_err() {
            // A reader that has gone is noticed at the next exchange, and the board's end by who
            // runs it.
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

    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        self.keep.as_mut().map(|keep| keep as _)
    }

    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        self.keep.as_mut().map(|keep| keep as _)
    }
}
