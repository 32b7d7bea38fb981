//! A link between two threads of this process: what the host board's UART is made of.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::byte_link::{ByteLink, WRITE_TIMEOUT};

/// Bytes that one direction holds before the writer waits for the reader.
const CAPACITY_BYTES: usize = 64 * 1024;

/// How often a writer looks for room at least. A process that was suspended has looked once.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);

/// Makes a link; what one end sends, the other receives.
pub fn pair() -> (PipeEnd, PipeEnd) {
    let to = Arc::new(Direction::default());
    let fro = Arc::new(Direction::default());
    (
        PipeEnd {
            incoming: Arc::clone(&to),
            outgoing: Arc::clone(&fro),
        },
        PipeEnd {
            incoming: fro,
            outgoing: to,
        },
    )
}

/// One end of a link. Dropping it closes the link for the other.
pub struct PipeEnd {
    incoming: Arc<Direction>,
    outgoing: Arc<Direction>,
}

#[derive(Default)]
struct Direction {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    bytes: VecDeque<u8>,
    closed: bool,
}

impl Direction {
    /// A thread that panicked while it held the lock left plain bytes behind: they are as good as
    /// before.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

impl PipeEnd {
    /// Waits until there is room for a byte, at most so long.
    pub fn wait_for_room(&mut self, time: Duration) {
        let state = self.outgoing.lock();
        drop(
            self.outgoing
                .changed
                .wait_timeout_while(state, time, |state| {
                    state.bytes.len() >= CAPACITY_BYTES && !state.closed
                })
                .unwrap_or_else(PoisonError::into_inner),
        );
    }
}

impl ByteLink for PipeEnd {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let mut state = self.incoming.lock();
        if state.bytes.is_empty() && !state.closed && !timeout.is_zero() {
            state = self
                .incoming
                .changed
                .wait_timeout_while(state, timeout, |state| {
                    state.bytes.is_empty() && !state.closed
                })
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
        if state.bytes.is_empty() && state.closed {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let count = buffer.len().min(state.bytes.len());
        for (place, byte) in buffer.iter_mut().zip(state.bytes.drain(..count)) {
            *place = byte;
        }
        drop(state);
        self.incoming.changed.notify_all();
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut rest = bytes;
        let mut stood = Duration::ZERO;
        loop {
            let count = self.try_send(rest)?;
            rest = &rest[count..];
            if rest.is_empty() {
                return Ok(());
            }
            if count > 0 {
                stood = Duration::ZERO;
            } else if stood >= WRITE_TIMEOUT {
                return Err(io::ErrorKind::TimedOut.into());
            }
            self.wait_for_room(LOOK_INTERVAL);
            stood += LOOK_INTERVAL;
        }
    }

    fn try_send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.outgoing.lock();
        if state.closed {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        let count = bytes.len().min(CAPACITY_BYTES - state.bytes.len());
        state.bytes.extend(&bytes[..count]);
        drop(state);
        self.outgoing.changed.notify_all();
        Ok(count)
    }
}

impl Drop for PipeEnd {
    fn drop(&mut self) {
        self.incoming.close();
        self.outgoing.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_sent_is_received_also_after_the_sender_has_gone() {
        let (mut near, mut far) = pair();
        near.send(b"last words").unwrap();
        drop(near);
        let mut buffer = [0; 4];
        let mut heard = Vec::new();
        while let Ok(count) = far.receive(&mut buffer, Duration::ZERO) {
            heard.extend_from_slice(&buffer[..count]);
        }
        assert_eq!(heard, b"last words");
        assert_eq!(
            far.send(b"?").unwrap_err().kind(),
            io::ErrorKind::BrokenPipe
        );
    }

    #[test]
    fn a_writer_waits_for_a_slow_reader_and_loses_nothing() {
        let (mut near, mut far) = pair();
        let total = 3 * CAPACITY_BYTES + 7;
        let writer = std::thread::spawn(move || {
            let bytes: Vec<u8> = (0..total).map(|i| i as u8).collect();
            near.send(&bytes)
        });
        let mut buffer = [0; 1000];
        let mut heard = 0_usize;
        while let Ok(count) = far.receive(&mut buffer, Duration::from_secs(5)) {
            for &byte in &buffer[..count] {
                assert_eq!(byte, heard as u8);
                heard += 1;
            }
        }
        assert_eq!(heard, total);
        writer.join().unwrap().unwrap();
    }
}
