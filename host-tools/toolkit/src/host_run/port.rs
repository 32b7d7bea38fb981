//! The board's end of a link without a line.

use std::collections::VecDeque;

use rt_firmware::{LinkPort, StopListener};

use crate::host_board::{HostPort, log_lines};

/// Bytes on their way to the board and from it, which take no time.
pub struct DirectPort<'m> {
    incoming: VecDeque<u8>,
    outgoing: Vec<u8>,
    listener: StopListener<'m>,
    has_heard_stop: bool,
    now_us: u64,
}

impl<'m> DirectPort<'m> {
    /// A link on which nothing was said yet.
    pub fn new(listener: StopListener<'m>) -> Self {
        DirectPort {
            incoming: VecDeque::new(),
            outgoing: Vec::new(),
            listener,
            has_heard_stop: false,
            now_us: 0,
        }
    }

    /// Bytes for the board.
    pub(super) fn give(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.has_heard_stop |= self.listener.hear(*byte, true);
        }
        self.incoming.extend(bytes);
    }

    /// What the board has sent.
    pub(super) fn take(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.outgoing)
    }
}

impl HostPort for DirectPort<'_> {
    fn set_clock(&mut self, now_us: u64) {
        self.now_us = now_us;
    }

    fn has_room(&self) -> bool {
        true
    }

    fn has_heard_stop(&mut self) -> bool {
        std::mem::take(&mut self.has_heard_stop)
    }
}

impl LinkPort for DirectPort<'_> {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        self.incoming.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        self.outgoing.push(byte);
        true
    }

    fn read_log(&mut self, room: &mut [u8]) -> usize {
        log_lines::take(room)
    }

    fn log_dropped(&self) -> u32 {
        log_lines::dropped()
    }
}
