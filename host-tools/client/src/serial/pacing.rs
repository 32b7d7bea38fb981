//! A link slowed down to the rate of a real line.
//!
//! An emulated UART takes bytes as fast as they come, and its receive buffer holds only a few. What
//! sends to one has to keep the rate that a wire would force upon it.

use std::io;
use std::time::{Duration, Instant};

use super::byte_link::{ByteLink, WRITE_TIMEOUT};
use super::clock::Clock;
use crate::interrupt;

/// Bits on the wire for one byte: start, eight of data, stop.
const BITS_PER_BYTE: u64 = 10;

/// Bytes handed on at once. A PL011 holds 16 of them before it drops any.
const BURST_BYTES: usize = 16;

/// How long a wait for the wire lasts before Ctrl-C is looked for.
const LONGEST_SLEEP: Duration = Duration::from_millis(50);

/// What one wait for a link that takes no bytes counts at most: a process that was suspended
/// meanwhile has not waited so long.
const LONGEST_COUNTED: Duration = Duration::from_secs(2);

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
            byte_time: byte_time(baud),
            line_free_at: Instant::now(),
        }
    }
}

/// How long a byte is on a line of so many bits a second.
fn byte_time(baud: u32) -> Duration {
    Duration::from_nanos(BITS_PER_BYTE * 1_000_000_000 / u64::from(baud.max(1)))
}

impl<L> Paced<L> {
    /// So many bytes go onto the wire now, or when it is free.
    fn count(&mut self, bytes: usize, now: Instant) {
        let burst_time = self.byte_time * BURST_BYTES as u32;
        let start = self
            .line_free_at
            .max(now.checked_sub(burst_time).unwrap_or(now));
        self.line_free_at = start + self.byte_time * bytes as u32;
    }
}

impl<L: ByteLink> ByteLink for Paced<L> {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.link.receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let was_interrupted = interrupt::is_requested();
        let mut waited = Duration::ZERO;
        for burst in bytes.chunks(BURST_BYTES) {
            while let Some(wait) = self.line_free_at.checked_duration_since(Instant::now()) {
                // At a low rate a frame takes seconds.
                if interrupt::is_requested() && !was_interrupted {
                    return Err(io::ErrorKind::Interrupted.into());
                }
                std::thread::sleep(wait.min(LONGEST_SLEEP));
            }
            if waited >= WRITE_TIMEOUT {
                return Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    "it takes bytes too slowly",
                ));
            }
            let now = Instant::now();
            // From when the line was free, not from when this thread woke up: sleeping too long
            // costs no rate, and a line that was idle has saved up nothing beyond one burst.
            self.count(burst.len(), now);
            self.link.send(burst)?;
            waited += now.elapsed().min(LONGEST_COUNTED);
        }
        Ok(())
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut sent = 0;
        for burst in bytes.chunks(BURST_BYTES) {
            let now = Instant::now();
            if self.line_free_at > now {
                break;
            }
            let count = self.link.try_send(burst)?;
            self.count(count, now);
            sent += count;
            if count < burst.len() {
                break;
            }
        }
        Ok(sent)
    }

    fn set_rate(&mut self, baud: u32) -> io::Result<()> {
        self.link.set_rate(baud)?;
        self.byte_time = byte_time(baud);
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
    fn another_rate_is_for_lines_that_have_one() {
        let mut paced = Paced::new(pipe::pair().0, 115_200);
        let kind = paced.set_rate(9_600).map_err(|error| error.kind());
        assert_eq!(kind, Err(io::ErrorKind::Unsupported));
    }

    #[test]
    fn a_paced_link_takes_the_time_of_the_wire() {
        let (near, mut far) = pipe::pair();
        let mut paced = Paced::new(near, 115_200);
        let bytes = [0x55; 1152];
        let started = Instant::now();
        paced.send(&bytes).unwrap();
        let took = started.elapsed();
        // 1152 bytes are a tenth of a second at 115,200 baud, less what the last burst need not
        // wait for.
        assert!(took >= Duration::from_millis(96), "{took:?}");
        let mut got = vec![0; 2000];
        assert_eq!(far.receive(&mut got, Duration::ZERO).unwrap(), bytes.len());
    }
}
