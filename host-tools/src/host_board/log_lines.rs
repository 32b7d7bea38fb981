//! What tasks log on the host board: lines of text, kept for the link of the board whose thread logged them.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt::Write;

use log::{LevelFilter, Log, Metadata, Record};

/// Bytes kept for a link that does not ask for its log.
const LIMIT_BYTES: usize = 64 * 1024;

#[derive(Default)]
struct Kept {
    bytes: VecDeque<u8>,
    dropped: u32,
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
        KEPT.with_borrow_mut(|kept| {
            if kept.bytes.len() + line.len() > LIMIT_BYTES {
                kept.dropped = kept.dropped.wrapping_add(line.len() as u32);
            } else {
                kept.bytes.extend(line.as_bytes());
            }
        });
    }

    fn flush(&self) {}
}

/// Takes the log macros of this process over, where nobody has before.
pub(super) fn install() {
    if log::set_logger(&ToTheLink).is_ok() {
        log::set_max_level(LevelFilter::Info);
    }
}

/// Takes bytes off this thread's log; answers how many.
pub(super) fn take(room: &mut [u8]) -> usize {
    KEPT.with_borrow_mut(|kept| {
        let count = room.len().min(kept.bytes.len());
        for (place, byte) in room.iter_mut().zip(kept.bytes.drain(..count)) {
            *place = byte;
        }
        count
    })
}

/// Bytes of this thread's log that found no room.
pub(super) fn dropped() -> u32 {
    KEPT.with_borrow(|kept| kept.dropped)
}
