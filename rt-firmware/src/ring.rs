//! A ring of records between one writer and one reader that never wait for each other.
//!
//! Records are written whole or not at all. Nothing here needs a critical section or a
//! compare-and-swap: each side stores its own position and loads the other's.

use core::sync::atomic::{AtomicU8, AtomicU32, AtomicUsize, Ordering};

use esm_link::recording::{STATE_HEADER_BYTES, STATE_WORD_BYTES};
use esm_link::trace::RecordSink;

/// Bytes before each record that tell its length.
const LENGTH_BYTES: usize = 2;

/// Storage of a ring with room for `N - 1` bytes, two of which go to each record's length.
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    ends: Ends,
}

/// What both sides look at.
struct Ends {
    /// Where the reader goes on.
    head: AtomicUsize,
    /// Where the writer goes on.
    tail: AtomicUsize,
    /// Records that found no room; wraps.
    dropped: AtomicU32,
}

impl Ends {
    #[expect(
        clippy::declare_interior_mutable_const,
        reason = "it is what each ring begins with, not a value to share"
    )]
    const AT_START: Ends = Ends {
        head: AtomicUsize::new(0),
        tail: AtomicUsize::new(0),
        dropped: AtomicU32::new(0),
    };
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Ring<N> {
    /// An empty ring.
    pub const fn new() -> Self {
        Ring {
            bytes: [const { AtomicU8::new(0) }; N],
            ends: Ends::AT_START,
        }
    }

    /// Its two sides.
    pub fn split(&mut self) -> (RingWriter<'_>, RingReader<'_>) {
        let Ring { bytes, ends } = &*self;
        sides(bytes, ends)
    }
}

/// Bytes of a [`RecordRing`] for each word of the interpreter's: one more than a word of it takes
/// at most, and so enough for all of them and what stands before them.
const RECORD_BYTES_PER_WORD: usize = STATE_WORD_BYTES + 1;

/// Storage of the ring of a recording: six bytes for each word that an interpreter may have, so
/// that all of its state fits, with `WORDS` of at least [`RecordRing::FEWEST_WORDS`].
pub struct RecordRing<const WORDS: usize> {
    bytes: [[AtomicU8; RECORD_BYTES_PER_WORD]; WORDS],
    ends: Ends,
}

impl<const WORDS: usize> RecordRing<WORDS> {
    /// Words below which the head of a state would not fit.
    pub const FEWEST_WORDS: usize = STATE_HEADER_BYTES + LENGTH_BYTES + 1;

    /// An empty ring.
    pub const fn new() -> Self {
        RecordRing {
            bytes: [const { [const { AtomicU8::new(0) }; RECORD_BYTES_PER_WORD] }; WORDS],
            ends: Ends::AT_START,
        }
    }

    /// Its two sides.
    pub fn split(&mut self) -> (RingWriter<'_>, RingReader<'_>) {
        let RecordRing { bytes, ends } = &*self;
        sides(bytes.as_flattened(), ends)
    }
}

impl<const WORDS: usize> Default for RecordRing<WORDS> {
    fn default() -> Self {
        Self::new()
    }
}

fn sides<'a>(bytes: &'a [AtomicU8], ends: &'a Ends) -> (RingWriter<'a>, RingReader<'a>) {
    (
        RingWriter { bytes, ends },
        RingReader {
            bytes,
            ends,
            rest: 0,
        },
    )
}

fn after(position: usize, capacity: usize) -> usize {
    if position + 1 < capacity {
        position + 1
    } else {
        0
    }
}

/// The side that writes.
pub struct RingWriter<'a> {
    bytes: &'a [AtomicU8],
    ends: &'a Ends,
}

impl RingWriter<'_> {
    /// Bytes that may be written, lengths of records included.
    fn free_bytes(&self) -> usize {
        let start = self.ends.tail.load(Ordering::Relaxed);
        // Acquire: what the reader has read is free to be written over.
        let head = self.ends.head.load(Ordering::Acquire);
        let gap = if head > start {
            head - start
        } else {
            head + self.bytes.len() - start
        };
        // One byte stays free, or a full ring would look like an empty one.
        gap.saturating_sub(1)
    }

    /// Whether there is room for a record of so many bytes.
    pub fn has_room(&self, bytes: usize) -> bool {
        self.free_bytes() >= LENGTH_BYTES + bytes
    }

    /// Writes a record. Returns false, and counts it as dropped, if there is no room for it that
    /// leaves `reserve` bytes for others.
    pub fn record(&mut self, reserve: usize, write: impl FnOnce(&mut RecordWriter<'_>)) -> bool {
        let start = self.ends.tail.load(Ordering::Relaxed);
        let mut writer = RecordWriter {
            bytes: self.bytes,
            position: start,
            room: self.free_bytes().saturating_sub(reserve),
            len: 0,
            fits: true,
        };
        writer.put(0);
        writer.put(0);
        writer.len = 0;
        write(&mut writer);
        if !writer.fits {
            let dropped = self.ends.dropped.load(Ordering::Relaxed);
            self.ends
                .dropped
                .store(dropped.wrapping_add(1), Ordering::Relaxed);
            return false;
        }
        let [low, high] = writer.len.to_le_bytes();
        for (position, byte) in [(start, low), (after(start, self.bytes.len()), high)] {
            if let Some(place) = self.bytes.get(position) {
                place.store(byte, Ordering::Relaxed);
            }
        }
        // Release: the record is there before its end is.
        self.ends.tail.store(writer.position, Ordering::Release);
        true
    }
}

/// Takes the bytes of one record.
pub struct RecordWriter<'a> {
    bytes: &'a [AtomicU8],
    position: usize,
    /// Bytes that may still be written.
    room: usize,
    len: u16,
    fits: bool,
}

impl RecordSink for RecordWriter<'_> {
    fn put(&mut self, byte: u8) {
        let (Some(place), Some(len), Some(room)) = (
            self.bytes.get(self.position),
            self.len.checked_add(1),
            self.room.checked_sub(1),
        ) else {
            self.fits = false;
            return;
        };
        place.store(byte, Ordering::Relaxed);
        self.position = after(self.position, self.bytes.len());
        self.len = len;
        self.room = room;
    }
}

/// The side that reads.
pub struct RingReader<'a> {
    bytes: &'a [AtomicU8],
    ends: &'a Ends,
    /// Bytes of the current record that were not read yet.
    rest: u16,
}

/// What was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Number of bytes.
    pub len: usize,
    /// Whether they begin in the middle of a record.
    pub continues: bool,
}

impl RingReader<'_> {
    /// Reads as many whole records as fit, or a part of one that is longer than `room`.
    pub fn read(&mut self, room: &mut [u8]) -> Part {
        // Acquire: the records before this end are there.
        let tail = self.ends.tail.load(Ordering::Acquire);
        let mut head = self.ends.head.load(Ordering::Relaxed);
        let continues = self.rest > 0;
        let mut len = 0;
        while self.rest > 0 || head != tail {
            if self.rest == 0 {
                let body = self.skip(head, LENGTH_BYTES);
                let record = u16::from_le_bytes([self.byte(head), self.byte(self.skip(head, 1))]);
                if len > 0 && usize::from(record) > room.len() - len {
                    break;
                }
                head = body;
                self.rest = record;
            }
            let Some(free) = room.get_mut(len..).filter(|free| !free.is_empty()) else {
                break;
            };
            for place in free.iter_mut().take(usize::from(self.rest)) {
                *place = self.byte(head);
                head = after(head, self.bytes.len());
                len += 1;
                self.rest -= 1;
            }
            if self.rest > 0 {
                break;
            }
        }
        // Release: the bytes were read before their room is given back.
        self.ends.head.store(head, Ordering::Release);
        Part { len, continues }
    }

    /// Passes over all that was written and not read.
    pub fn clear(&mut self) {
        self.rest = 0;
        let tail = self.ends.tail.load(Ordering::Acquire);
        self.ends.head.store(tail, Ordering::Release);
    }

    /// Whether all that was written has been read.
    pub fn is_empty(&self) -> bool {
        self.rest == 0
            && self.ends.head.load(Ordering::Relaxed) == self.ends.tail.load(Ordering::Acquire)
    }

    /// Records that found no room so far; wraps.
    pub fn dropped(&self) -> u32 {
        self.ends.dropped.load(Ordering::Relaxed)
    }

    fn byte(&self, position: usize) -> u8 {
        self.bytes
            .get(position)
            .map_or(0, |byte| byte.load(Ordering::Relaxed))
    }

    fn skip(&self, mut position: usize, bytes: usize) -> usize {
        for _ in 0..bytes {
            position = after(position, self.bytes.len());
        }
        position
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    fn put(writer: &mut RingWriter<'_>, record: &[u8]) -> bool {
        writer.record(0, |sink| record.iter().for_each(|byte| sink.put(*byte)))
    }

    fn read(reader: &mut RingReader<'_>, room: usize) -> (Vec<u8>, bool) {
        let mut bytes = std::vec![0; room];
        let part = reader.read(&mut bytes);
        bytes.truncate(part.len);
        (bytes, part.continues)
    }

    #[test]
    fn records_come_out_whole_and_in_order() {
        let mut ring = Ring::<16>::new();
        let (mut writer, mut reader) = ring.split();
        for round in 0..50u8 {
            assert!(put(&mut writer, &[round, 1, 2]));
            assert!(put(&mut writer, &[round, 3]));
            assert_eq!(read(&mut reader, 4), (std::vec![round, 1, 2], false));
            assert_eq!(read(&mut reader, 4), (std::vec![round, 3], false));
            assert_eq!(read(&mut reader, 4), (std::vec![], false));
        }
        assert_eq!(reader.dropped(), 0);
    }

    #[test]
    fn several_records_are_read_at_once_if_they_fit() {
        let mut ring = Ring::<16>::new();
        let (mut writer, mut reader) = ring.split();
        put(&mut writer, &[1, 1, 1]);
        put(&mut writer, &[2, 2]);
        assert_eq!(read(&mut reader, 10), (std::vec![1, 1, 1, 2, 2], false));
    }

    #[test]
    fn a_record_without_room_is_dropped_and_counted() {
        let mut ring = Ring::<8>::new();
        let (mut writer, mut reader) = ring.split();
        assert!(put(&mut writer, &[1, 2, 3]));
        assert!(!put(&mut writer, &[4]));
        assert!(!put(&mut writer, &[5]));
        assert_eq!(reader.dropped(), 2);
        assert_eq!(read(&mut reader, 8).0, [1, 2, 3]);
        assert!(
            put(&mut writer, &[6, 6, 6, 6, 6]),
            "seven bytes are the greatest that fits"
        );
        assert!(!put(&mut writer, &[]));
        assert_eq!(read(&mut reader, 8).0, [6; 5]);
    }

    #[test]
    fn a_reserve_is_left_to_others() {
        let mut ring = Ring::<16>::new();
        let (mut writer, mut reader) = ring.split();
        let mut ordinary = 0;
        while writer.record(6, |sink| sink.put(1)) {
            ordinary += 1;
        }
        assert_eq!(ordinary, 3, "of 15 bytes, 6 are left");
        assert!(put(&mut writer, &[2, 2, 2, 2]));
        assert!(!put(&mut writer, &[]));
        assert_eq!(read(&mut reader, 16).0, [1, 1, 1, 2, 2, 2, 2]);
    }

    #[test]
    fn a_long_record_comes_in_parts() {
        let mut ring = Ring::<32>::new();
        let (mut writer, mut reader) = ring.split();
        put(&mut writer, &[1, 2, 3, 4, 5, 6, 7]);
        put(&mut writer, &[8]);
        assert_eq!(read(&mut reader, 3), (std::vec![1, 2, 3], false));
        assert_eq!(read(&mut reader, 3), (std::vec![4, 5, 6], true));
        assert_eq!(read(&mut reader, 3), (std::vec![7, 8], true));
        assert_eq!(read(&mut reader, 3), (std::vec![], false));
    }

    #[test]
    fn two_threads_pass_records_on() {
        let mut ring = Ring::<64>::new();
        let (mut writer, mut reader) = ring.split();
        const RECORDS: u32 = 2_000;
        std::thread::scope(|threads| {
            threads.spawn(move || {
                for number in 0..RECORDS {
                    while !put(&mut writer, &number.to_le_bytes()) {
                        std::thread::yield_now();
                    }
                }
            });
            let mut expected = 0u32;
            while expected < RECORDS {
                let (bytes, _) = read(&mut reader, 10);
                for record in bytes.chunks(4) {
                    assert_eq!(record, expected.to_le_bytes());
                    expected += 1;
                }
                std::thread::yield_now();
            }
        });
    }
}
