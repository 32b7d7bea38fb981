//! The link inside the plant exchange: a board and a client that share one virtual time.
//!
//! The board swaps bytes at fixed times of its own clock ([`rt_firmware::body::line`]) and stands
//! still until it has an answer. The client's clock counts these swaps, and nothing else. While the
//! client thinks, no swap is answered; while it waits, for bytes or for time to pass, swaps go on
//! until what it waits for is there. So who comes first never depends on this machine, and two runs
//! are equal to the byte.
//!
//! The line's time begins with the board's first swap: whatever the client does before waits for
//! that. So it does not depend on this machine either which of the two comes first to the line.
//!
//! Each swap carries what a line of 115,200 baud carries in its time, in each direction, and what
//! is sent to an idle line does not come faster.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rt_firmware::body::line::{INTERVAL_US, LinePart, PART_BYTES};

use crate::serial::ByteLink;
use crate::serial::clock::{Clock, SimulatedTime};

/// How long the client waits on the wall for a board that swaps no bytes before it takes it for
/// hung.
pub const STANDSTILL_LIMIT: Duration = Duration::from_secs(30);

/// How often it looks meanwhile. A process that was suspended has looked once.
const LOOK_INTERVAL: Duration = Duration::from_secs(1);

/// Virtual time that a board may leave bytes untouched.
const UNTOUCHED_LIMIT: Duration = Duration::from_secs(5);

/// Makes a line: the board's end and the client's.
pub fn pair() -> (BoardEnd, ClientEnd) {
    let shared = Arc::new(Shared {
        state: Mutex::new(State {
            swaps: 0,
            to_board: VecDeque::new(),
            to_client: VecDeque::new(),
            wait: None,
            board_gone: false,
            client_gone: false,
        }),
        changed: Condvar::new(),
    });
    (
        BoardEnd {
            shared: Arc::clone(&shared),
        },
        ClientEnd { shared },
    )
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    /// Swaps so far: the line's time, in units of [`INTERVAL_US`].
    swaps: u64,
    to_board: VecDeque<u8>,
    to_client: VecDeque<u8>,
    /// What the client waits for; `None` while it thinks.
    wait: Option<Wait>,
    board_gone: bool,
    client_gone: bool,
}

/// What a client waits for.
#[derive(Clone, Copy, Debug)]
struct Wait {
    what: Awaited,
    /// The swap at which it ends in any case.
    until: u64,
}

#[derive(Clone, Copy, Debug)]
enum Awaited {
    /// Bytes from the board.
    Bytes,
    /// That the last of what was sent is on the wire.
    Sent,
    /// Nothing but that time passes.
    Time,
}

impl State {
    fn is_over(&self, wait: Wait) -> bool {
        let is_there = match wait.what {
            Awaited::Bytes => !self.to_client.is_empty(),
            Awaited::Sent => self.has_room(),
            Awaited::Time => false,
        };
        is_there || self.swaps >= wait.until
    }

    /// What was sent is gone, but for what the next swap takes.
    fn has_room(&self) -> bool {
        self.to_board.len() <= PART_BYTES
    }

    /// Moves bytes to the board into a message to it, as many as both take.
    fn fill(&mut self, part: &mut LinePart, room: usize) {
        while part.carried().len() < room && !part.is_full() {
            let Some(byte) = self.to_board.pop_front() else {
                break;
            };
            part.push(byte);
        }
    }
}

impl Shared {
    /// A thread that panicked while it held the lock left plain bytes behind: they are as good as
    /// before.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The line once its time has begun, with the board's first swap, or once the board is gone.
    fn begun(&self) -> io::Result<MutexGuard<'_, State>> {
        self.wait_while(self.lock(), |state| state.swaps == 0 && !state.board_gone)
    }

    /// Waits on the wall, as long as the board swaps bytes now and then.
    fn wait_while<'s>(
        &'s self,
        mut state: MutexGuard<'s, State>,
        goes_on: impl Fn(&State) -> bool,
    ) -> io::Result<MutexGuard<'s, State>> {
        let mut seen = state.swaps;
        let mut stood = Duration::ZERO;
        while goes_on(&state) {
            let (woken, timeout) = self
                .changed
                .wait_timeout(state, LOOK_INTERVAL)
                .unwrap_or_else(PoisonError::into_inner);
            state = woken;
            if state.swaps != seen {
                seen = state.swaps;
                stood = Duration::ZERO;
            } else if timeout.timed_out() {
                stood += LOOK_INTERVAL;
            }
            if stood >= STANDSTILL_LIMIT && goes_on(&state) {
                // The board finds a client that thinks.
                state.wait = None;
                return Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    "the board has swapped no bytes with its plant for too long; if its firmware cannot, give `--link uart`",
                ));
            }
        }
        Ok(state)
    }

    /// The client waits, for `time` at most. Answers how it is then.
    fn wait_for<'s>(
        &'s self,
        mut state: MutexGuard<'s, State>,
        what: Awaited,
        time: Duration,
    ) -> io::Result<MutexGuard<'s, State>> {
        let until = state.swaps.saturating_add(swaps_in(time));
        state.wait = Some(Wait { what, until });
        self.changed.notify_all();
        let mut state =
            self.wait_while(state, |state| state.wait.is_some() && !state.board_gone)?;
        state.wait = None;
        Ok(state)
    }
}

/// Swaps in a time, begun ones included.
fn swaps_in(time: Duration) -> u64 {
    u64::try_from(time.as_micros().div_ceil(u128::from(INTERVAL_US))).unwrap_or(u64::MAX)
}

impl SimulatedTime for Shared {
    fn elapsed(&self) -> Duration {
        // The first swap is where time begins.
        let swaps = self.lock().swaps.saturating_sub(1);
        Duration::from_micros(swaps.saturating_mul(INTERVAL_US.into()))
    }

    fn pause(&self, time: Duration) {
        // A board that is gone lets no time pass, which whoever waits notices at the next byte.
        let waited = (self.begun()).and_then(|state| self.wait_for(state, Awaited::Time, time));
        drop(waited);
    }
}

/// The board's end, whose copies are the same end. [`BoardEnd::close`] ends the line.
#[derive(Clone)]
pub struct BoardEnd {
    shared: Arc<Shared>,
}

impl BoardEnd {
    /// One swap: takes what the board sends, lets the client do what it does with that, and answers
    /// what is for the board.
    pub fn swap(&self, from_board: &LinePart) -> LinePart {
        let room = from_board.room();
        let mut answer = LinePart::new(0);
        let mut state = self.shared.lock();
        state.swaps += 1;
        if state.swaps == 1 {
            self.shared.changed.notify_all();
        }
        state.to_client.extend(from_board.carried());
        state.fill(&mut answer, room);
        if state.wait.is_some_and(|wait| state.is_over(wait)) {
            state.wait = None;
            self.shared.changed.notify_all();
        }
        while state.wait.is_none() && !state.client_gone && !state.board_gone {
            state = (self.shared.changed.wait(state)).unwrap_or_else(PoisonError::into_inner);
        }
        // The client may have sent something that still goes with this one.
        state.fill(&mut answer, room);
        answer
    }

    /// Ends the line, and a swap that waits for the client.
    pub fn close(&self) {
        self.shared.lock().board_gone = true;
        self.shared.changed.notify_all();
    }
}

/// The client's end. Dropping it lets the board go on alone.
pub struct ClientEnd {
    shared: Arc<Shared>,
}

impl ByteLink for ClientEnd {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let mut state = self.shared.begun()?;
        if state.to_client.is_empty() && !state.board_gone && !timeout.is_zero() {
            state = self.shared.wait_for(state, Awaited::Bytes, timeout)?;
        }
        if state.to_client.is_empty() && state.board_gone {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let count = buffer.len().min(state.to_client.len());
        for (place, byte) in buffer.iter_mut().zip(state.to_client.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut state = self.shared.begun()?;
        state.to_board.extend(bytes);
        while !state.has_room() && !state.board_gone {
            let before = state.to_board.len();
            state = self
                .shared
                .wait_for(state, Awaited::Sent, UNTOUCHED_LIMIT)?;
            if state.to_board.len() == before {
                return Err(io::ErrorKind::TimedOut.into());
            }
        }
        if state.board_gone {
            return Err(io::ErrorKind::BrokenPipe.into());
        }
        Ok(())
    }

    fn clock(&self) -> Clock {
        Clock::simulated(Arc::clone(&self.shared) as _)
    }
}

impl Drop for ClientEnd {
    fn drop(&mut self) {
        self.shared.lock().client_gone = true;
        self.shared.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serial::noise::{Noise, Noisy};

    /// A board that sends back what it got, and takes `room` bytes at once, until its client is
    /// gone. Answers how many swaps carried so many bytes.
    fn echo(end: BoardEnd, room: usize) -> std::thread::JoinHandle<Vec<usize>> {
        std::thread::spawn(move || {
            let mut carried = Vec::new();
            let mut next = LinePart::new(room);
            while !end.shared.lock().client_gone {
                let answer = end.swap(&next);
                carried.push(answer.carried().len());
                next = LinePart::new(room);
                for &byte in answer.carried() {
                    assert!(next.push(byte));
                }
            }
            carried
        })
    }

    fn listened(link: &mut impl ByteLink, bytes: usize) -> Vec<u8> {
        let mut heard = Vec::new();
        let mut buffer = [0; 256];
        while heard.len() < bytes {
            let count = link.receive(&mut buffer, Duration::from_secs(1)).unwrap();
            assert!(count > 0, "{} bytes came", heard.len());
            heard.extend_from_slice(&buffer[..count]);
        }
        heard
    }

    #[test]
    fn bytes_come_at_the_pace_of_the_line_however_fast_this_machine_is() {
        for (room, baud) in [(PART_BYTES, 115_200.0), (PART_BYTES / 2, 57_600.0)] {
            let (board, mut client) = pair();
            let board = echo(board, room);
            let clock = client.clock();
            let begun = clock.now();
            let bytes: Vec<u8> = (0..2304).map(|i| i as u8).collect();
            client.send(&bytes).unwrap();
            assert_eq!(listened(&mut client, bytes.len()), bytes);
            let took = clock.since(begun).as_secs_f64();
            drop(client);
            assert!(board.join().unwrap().iter().all(|carried| *carried <= room));
            let on_the_wire = 2304.0 * 10.0 / baud;
            // There and back again: one swap more than the wire takes, and one for the answer.
            let late = took - on_the_wire;
            let swap = f64::from(INTERVAL_US) / 1e6;
            assert!((0.0..3.0 * swap).contains(&late), "{late} s late");
        }
    }

    #[test]
    fn waits_last_as_many_swaps_as_their_time_has_and_no_wall_clock_ends_them() {
        let (board, mut client) = pair();
        let board = echo(board, PART_BYTES);
        let clock = client.clock();
        let begun = clock.now();
        let wall = std::time::Instant::now();
        // An hour of silence, and an hour of doing nothing.
        let hour = Duration::from_secs(3600);
        assert_eq!(client.receive(&mut [0; 8], hour).unwrap(), 0);
        clock.pause(hour);
        assert_eq!(clock.since(begun), 2 * hour);
        assert!(wall.elapsed() < hour);
        // A client that thinks for long finds the line as it left it.
        let before = clock.now();
        std::thread::sleep(Duration::from_millis(50));
        assert_eq!(clock.now(), before);
        drop(client);
        board.join().unwrap();
    }

    #[test]
    fn noise_spoils_the_same_bytes_at_the_same_times_in_each_run() {
        let run = || {
            let (board, client) = pair();
            let board = echo(board, PART_BYTES);
            let mut client = Noisy::new(client, Noise::of_each(Noise::WHOLE / 50), 9);
            let clock = client.clock();
            let begun = clock.now();
            let mut heard = Vec::new();
            for round in 0..200_u32 {
                client.send(&round.to_le_bytes().repeat(7)).unwrap();
                let mut buffer = [0; 64];
                let wait = Duration::from_millis(u64::from(round % 9));
                let count = client.receive(&mut buffer, wait).unwrap();
                heard.push((clock.since(begun), buffer[..count].to_vec()));
            }
            drop(client);
            board.join().unwrap();
            heard
        };
        assert_eq!(run(), run());
    }

    #[test]
    fn an_end_that_goes_keeps_the_other_waiting_for_nothing() {
        let (board, mut client) = pair();
        board.close();
        let error = client.receive(&mut [0; 8], Duration::from_secs(1));
        assert_eq!(error.unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        let error = client.send(&[0; 8]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::BrokenPipe);
        let (board, client) = pair();
        drop(client);
        assert!(board.swap(&LinePart::new(PART_BYTES)).carried().is_empty());
    }

    #[test]
    fn a_board_that_takes_no_bytes_is_told_from_a_slow_one() {
        let (board, mut client) = pair();
        let board = echo(board, 0);
        let error = client.send(&[0; 100]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert_eq!(client.shared.elapsed(), UNTOUCHED_LIMIT);
        drop(client);
        board.join().unwrap();
    }
}
