//! What tasks log on the host board: lines of text, kept for the link of the board whose thread
//! logged them.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt::Write;

use log::{LevelFilter, Log, Metadata, Record};

/// Bytes kept for a link that does not ask for its log.
const LIMIT_BYTES: usize = 64 * 1024;

#[derive(Default)]
struct Kept {
    bytes: VecDeque<u8>,
    /// Where lines found no room: behind so many of the bytes that are kept, and how many lines.
    /// The first comes first.
    losses: VecDeque<(usize, u32)>,
    /// Lines that found no room before the bytes that were taken last, or where all that is kept
    /// begins.
    dropped: u32,
}

impl Kept {
    fn add(&mut self, line: &[u8]) {
        let at = self.bytes.len();
        if at + line.len() <= LIMIT_BYTES {
            self.bytes.extend(line);
            return;
        }
        match self.losses.back_mut() {
            Some((place, lines)) if *place == at => *lines = lines.wrapping_add(1),
            _ => self.losses.push_back((at, 1)),
        }
    }

    /// Takes bytes off, up to where lines are missing; answers how many.
    fn take(&mut self, room: &mut [u8]) -> usize {
        while let Some((_, lines)) = self.losses.pop_front_if(|(place, _)| *place == 0) {
            self.dropped = self.dropped.wrapping_add(lines);
        }
        let whole = self.losses.front().map_or(self.bytes.len(), |loss| loss.0);
        let count = room.len().min(whole).min(self.bytes.len());
        for (place, byte) in room.iter_mut().zip(self.bytes.drain(..count)) {
            *place = byte;
        }
        for (place, _) in &mut self.losses {
            *place -= count;
        }
        count
    }
}

thread_local! {
    /// A board is a thread: what it logs belongs to its own link.
    static KEPT: RefCell<Kept> = RefCell::default();
}

struct ToTheLink;

impl Log for ToTheLink {
    fn enabled(&self, _: &Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &Record<'_>) {
        let mut line = String::new();
        // Writing to a string does not fail.
        let _ = writeln!(
            line,
            "{:<5} {}",
            record.level().as_str().to_lowercase(),
            record.args()
        );
        KEPT.with_borrow_mut(|kept| kept.add(line.as_bytes()));
    }

    fn flush(&self) {}
}

/// Takes the log macros of this process over, where nobody has before.
pub fn install() {
    if log::set_logger(&ToTheLink).is_ok() {
        log::set_max_level(LevelFilter::Info);
    }
}

/// Takes bytes off this thread's log; answers how many.
pub fn take(room: &mut [u8]) -> usize {
    KEPT.with_borrow_mut(|kept| kept.take(room))
}

/// Lines of this thread's log that found no room and stood before the bytes that were taken last.
pub fn dropped() -> u32 {
    KEPT.with_borrow(|kept| kept.dropped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_without_room_are_counted_where_they_were() {
        let mut kept = Kept::default();
        let line = [b'a'; 1024];
        for _ in 0..LIMIT_BYTES / line.len() + 3 {
            kept.add(&line);
        }
        let mut room = [0; 1024];
        // There is room for one again.
        assert_eq!((kept.take(&mut room), kept.dropped), (1024, 0));
        kept.add(&[b'b'; 1024]);
        kept.add(&line);
        let mut taken = 0;
        while kept.take(&mut room) > 0 && room[0] == b'a' {
            assert_eq!(kept.dropped, 0);
            taken += room.len();
        }
        assert_eq!(
            (taken + 1024, room[0], kept.dropped),
            (LIMIT_BYTES, b'b', 3)
        );
        assert_eq!((kept.take(&mut room), kept.dropped), (0, 4));
        kept.add(&line);
        assert_eq!((kept.take(&mut room), kept.dropped), (1024, 4));
    }
}
