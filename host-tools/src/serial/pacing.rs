//! A link slowed down to the rate of a real line.
//!
//! An emulated UART takes bytes as fast as they come, and its receive buffer holds only a few. What sends to one has to keep the rate
//! that a wire would force upon it.

use std::io;
use std::time::{Duration, Instant};

use super::ByteLink;
use super::clock::Clock;

/// Bits on the wire for one byte: start, eight of data, stop.
const BITS_PER_BYTE: u64 = 10;

/// Bytes handed on at once. A PL011 holds 16 of them before it drops any.
const BURST_BYTES: usize = 16;

/// Sends no faster than a line of some baud rate would; receives as the link below does.
pub struct Paced<L> {
    link: L,
    byte_time: Duration,
    line_free_at: Instant,
}

impl<L: ByteLink> Paced<L> {
    /// Slows `link` down to `baud` bits a second.
    pub fn new(link: L, baud: u32) -> Self {
        Paced {
            link,
            byte_time: Duration::from_nanos(BITS_PER_BYTE * 1_000_000_000 / u64::from(baud.max(1))),
            line_free_at: Instant::now(),
        }
    }
}

impl<L: ByteLink> ByteLink for Paced<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.link.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        for burst in bytes.chunks(BURST_BYTES) {
            let now = Instant::now();
            if let Some(wait) = self.line_free_at.checked_duration_since(now) {
                std::thread::sleep(wait);
            }
            // From when the line was free, not from when this thread woke up: sleeping too long costs no rate, and a line that
            // was idle has saved up nothing beyond one burst.
            let burst_time = self.byte_time * BURST_BYTES as u32;
            let start = self
                .line_free_at
                .max(now.checked_sub(burst_time).unwrap_or(now));
            self.line_free_at = start + self.byte_time * burst.len() as u32;
            self.link.send(burst)?;
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        self.link.clock()
    }
}

#[cfg(test)]
mod tests {
    use super::super::pipe;
    use super::*;

    #[test]
    fn a_paced_link_takes_the_time_of_the_wire() {
        let (near, mut far) = pipe::pair();
        let mut paced = Paced::new(near, 115_200);
        let bytes = [0x55; 1152];
        let started = Instant::now();
        paced.send(&bytes).unwrap();
        let took = started.elapsed();
        // 1152 bytes are a tenth of a second at 115,200 baud, less what the last burst need not wait for.
        assert!(took >= Duration::from_millis(96), "{took:?}");
        let mut got = vec![0; 2000];
        assert_eq!(far.receive(&mut got, Duration::ZERO).unwrap(), bytes.len());
    }
}
