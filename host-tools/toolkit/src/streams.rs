//! Streams from the robot, put together again: whole trace records and log bytes, and a word where
//! something is missing.

use esm_link::message::{Channel, Stream};
use esm_link::recording::Recorded;
use esm_link::status_event::StatusEvent;
use esm_link::telemetry::Sample;
use esm_link::trace::{TraceError, TraceEvent};

/// Something that a stream brought.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StreamEvent {
    /// Whole trace records, one behind the other, to be read with [`TraceEvent::take`].
    Trace(Vec<u8>),
    /// Bytes of the log.
    Log(Vec<u8>),
    /// How the robot is, since that changed or a period is over.
    StatusEvent(StatusEvent),
    /// Whole records of a recording, one behind the other, to be read with [`Recorded::take`].
    Record(Vec<u8>),
    /// Values that were on nets of the mission at the same time.
    Values {
        /// Number of the request that asked for them: samples of one before may come behind its
        /// answer.
        number: u8,
        /// Nets whose values there was no room for.
        left_out: u8,
        /// Bit n: the nth of the nets that were asked for holds a value, which is here.
        has: u32,
        /// Nominal start of the macro step behind which they were read, in microseconds since the
        /// mission started.
        t_us: u64,
        /// Bits of all fields of all values, one behind the other.
        words: Vec<u32>,
    },
    /// The mission is another one than the one that values were asked of: no more will come.
    ValuesEnded {
        /// Number of the request that asked for them.
        number: u8,
    },
    /// So many lines of the log are missing here, for which the robot had no room. Those before and
    /// behind are whole.
    LinesLost(u32),
    /// Something did not come: the robot had no room for it, or the line lost it. A trace or
    /// recording with such a gap is not whole.
    Gap {
        /// Of which stream.
        channel: Channel,
        /// Records that the robot dropped, or parts that the line lost; of the log, parts alone.
        missing: u32,
    },
}

/// What a record of a stream has at most, in bytes: one that tells of all words of an interpreter,
/// of five bytes each, in more RAM than a robot of this kind has.
const MAX_RECORD_BYTES: usize = 64 * 1024;

/// What is kept at most of what streams brought until somebody fetches it, in bytes: more than a
/// line brings while a request is waited for as long as any is.
const MAX_WAITING_BYTES: usize = 4 * 1024 * 1024;

/// What an event takes beside its bytes.
const EVENT_BYTES: usize = 64;

/// What streams brought, until somebody fetches it. What there is no room for is told as missing.
#[derive(Debug, Default)]
pub struct Waiting {
    events: Vec<StreamEvent>,
    bytes: usize,
    /// Events that there was no room for, by their channel.
    left_out: Vec<(Channel, u32)>,
    is_full: bool,
}

impl Waiting {
    /// Keeps an event.
    pub fn push(&mut self, event: StreamEvent) {
        self.bytes += EVENT_BYTES + bytes_of(&event);
        self.is_full |= self.bytes > MAX_WAITING_BYTES;
        if !self.is_full {
            self.events.push(event);
            return;
        }
        let (channel, missing) = match event {
            StreamEvent::Trace(_) => (Channel::Trace, 1),
            StreamEvent::Log(_) | StreamEvent::LinesLost(_) => (Channel::Log, 1),
            StreamEvent::Record(_) => (Channel::Record, 1),
            StreamEvent::Values { .. } | StreamEvent::ValuesEnded { .. } => (Channel::Values, 1),
            StreamEvent::Gap { channel, missing } => (channel, missing),
            // The next ones tell how the robot is then.
            StreamEvent::StatusEvent(_) => return,
        };
        match self
            .left_out
            .iter_mut()
            .find(|(known, _)| *known == channel)
        {
            Some((_, count)) => *count = count.saturating_add(missing),
            None => self.left_out.push((channel, missing)),
        }
    }

    /// All of it.
    pub fn take(&mut self) -> Vec<StreamEvent> {
        let Waiting {
            mut events,
            left_out,
            ..
        } = std::mem::take(self);
        let gaps = left_out.into_iter();
        events.extend(gaps.map(|(channel, missing)| StreamEvent::Gap { channel, missing }));
        events
    }
}

/// What an event has to say, in bytes.
fn bytes_of(event: &StreamEvent) -> usize {
    match event {
        StreamEvent::Trace(bytes) | StreamEvent::Log(bytes) | StreamEvent::Record(bytes) => {
            bytes.len()
        }
        StreamEvent::Values { words, .. } => size_of_val(words.as_slice()),
        StreamEvent::StatusEvent(_)
        | StreamEvent::ValuesEnded { .. }
        | StreamEvent::LinesLost(_)
        | StreamEvent::Gap { .. } => 0,
    }
}

/// Puts the parts of one stream together.
#[derive(Debug)]
pub struct Assembler {
    channel: Channel,
    next_part: Option<u8>,
    dropped: u32,
    /// The beginning of a record whose end has not come yet.
    pending: Vec<u8>,
    /// After a gap, bytes mean nothing until a part begins with a new record.
    in_step: bool,
}

impl Assembler {
    /// Of a channel of which nothing has come yet.
    pub fn new(channel: Channel) -> Self {
        Assembler {
            channel,
            next_part: None,
            dropped: 0,
            pending: Vec::new(),
            in_step: false,
        }
    }

    /// Takes the next part that came and adds what is complete to `events`.
    pub fn take(&mut self, part: &Stream<'_>, events: &mut Waiting) {
        let lost_parts = match self.next_part {
            Some(expected) => u32::from(part.seq.wrapping_sub(expected)),
            None => {
                // What was dropped before this client listened is none of its business.
                self.dropped = part.dropped;
                0
            }
        };
        let dropped = part.dropped.wrapping_sub(self.dropped);
        let missing = match self.channel {
            Channel::Log => lost_parts,
            _ => lost_parts.saturating_add(dropped),
        };
        self.next_part = Some(part.seq.wrapping_add(1));
        self.dropped = part.dropped;
        if missing > 0 {
            events.push(StreamEvent::Gap {
                channel: self.channel,
                missing,
            });
        }
        if lost_parts > 0 {
            self.in_step = false;
        }
        if self.channel == Channel::Log && dropped > 0 {
            events.push(StreamEvent::LinesLost(dropped));
        }
        match self.channel {
            // The frames of the log know their own edges.
            Channel::Log => events.push(StreamEvent::Log(part.bytes.to_vec())),
            Channel::Trace | Channel::Record => self.take_records(part, events),
            Channel::Values => events.push(sample(part.bytes)),
        }
    }

    fn take_records(&mut self, part: &Stream<'_>, events: &mut Waiting) {
        if !part.continues {
            self.pending.clear();
            self.in_step = true;
        } else if !self.in_step {
            return;
        }
        self.pending.extend_from_slice(part.bytes);
        let mut rest = self.pending.as_slice();
        let mut whole = 0;
        loop {
            match take_one(self.channel, &mut rest) {
                Ok(()) => whole = self.pending.len() - rest.len(),
                Err(TraceError::Incomplete) if self.pending.len() - whole <= MAX_RECORD_BYTES => {
                    break;
                }
                Err(TraceError::Incomplete | TraceError::Unknown) => {
                    events.push(StreamEvent::Gap {
                        channel: self.channel,
                        missing: 1,
                    });
                    self.in_step = false;
                    self.pending.truncate(whole);
                    break;
                }
            }
        }
        let rest = self.pending.split_off(whole);
        let records = std::mem::replace(&mut self.pending, rest);
        if !records.is_empty() {
            events.push(match self.channel {
                Channel::Record => StreamEvent::Record(records),
                _ => StreamEvent::Trace(records),
            });
        }
    }
}

/// What a part with values says.
fn sample(bytes: &[u8]) -> StreamEvent {
    match Sample::of(bytes) {
        Some(Sample::Values {
            number,
            left_out,
            has,
            t_us,
            words,
        }) => StreamEvent::Values {
            number,
            left_out,
            has,
            t_us,
            words: words.iter().map(|word| u32::from_le_bytes(*word)).collect(),
        },
        Some(Sample::Ended { number }) => StreamEvent::ValuesEnded { number },
        // Of a robot that knows more than this program.
        None => StreamEvent::Gap {
            channel: Channel::Values,
            missing: 1,
        },
    }
}

/// Takes a record of a channel that has some off its bytes.
fn take_one(channel: Channel, bytes: &mut &[u8]) -> Result<(), TraceError> {
    match channel {
        Channel::Record => Recorded::take(bytes).map(drop),
        _ => TraceEvent::take(bytes).map(drop),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_link::trace::RecordSink;

    struct Bytes(Vec<u8>);

    impl RecordSink for Bytes {
        fn put(&mut self, byte: u8) {
            self.0.push(byte);
        }
    }

    fn record(micro_steps: u8) -> Vec<u8> {
        let mut bytes = Bytes(Vec::new());
        TraceEvent::Same { micro_steps }.write(&mut bytes);
        bytes.0
    }

    fn part(seq: u8, continues: bool, dropped: u32, bytes: &[u8]) -> Stream<'_> {
        Stream {
            channel: Channel::Trace,
            seq,
            continues,
            dropped,
            bytes,
        }
    }

    #[test]
    fn records_are_put_together_and_gaps_are_told() {
        use StreamEvent::{Gap, Trace};
        let gap = |missing| Gap {
            channel: Channel::Trace,
            missing,
        };
        let (one, two) = (record(1), record(2));
        let cut = [&one[..], &two[..1]].concat();
        type Case<'a> = (&'a str, Vec<Stream<'a>>, Vec<StreamEvent>);
        let cases: [Case<'_>; 5] = [
            (
                "a record over two parts",
                vec![part(7, false, 3, &cut), part(8, true, 3, &two[1..])],
                vec![Trace(one.clone()), Trace(two.clone())],
            ),
            (
                "a part lost between",
                vec![part(7, false, 0, &cut), part(9, false, 0, &one)],
                vec![Trace(one.clone()), gap(1), Trace(one.clone())],
            ),
            (
                "after a loss, the end of a record whose beginning is gone",
                vec![
                    part(7, false, 0, &one),
                    part(9, true, 0, &two[1..]),
                    part(10, false, 0, &two),
                ],
                vec![Trace(one.clone()), gap(1), Trace(two.clone())],
            ),
            (
                "records dropped by the robot",
                vec![part(255, false, 3, &one), part(0, false, 5, &two)],
                vec![Trace(one.clone()), gap(2), Trace(two.clone())],
            ),
            (
                "bytes that are no record",
                vec![part(0, false, 0, &[0xee, 0]), part(1, false, 0, &two)],
                vec![gap(1), Trace(two.clone())],
            ),
        ];
        for (what, parts, expected) in cases {
            let mut assembler = Assembler::new(Channel::Trace);
            let mut events = Waiting::default();
            for part in &parts {
                assembler.take(part, &mut events);
            }
            assert_eq!(events.take(), expected, "{what}");
        }
    }

    #[test]
    fn lines_that_the_robot_dropped_are_told_where_they_were_and_tear_no_line() {
        use StreamEvent::{Gap, LinesLost, Log};
        let log = |seq, dropped, bytes| Stream {
            channel: Channel::Log,
            ..part(seq, false, dropped, bytes)
        };
        let mut assembler = Assembler::new(Channel::Log);
        let mut events = Waiting::default();
        let parts = [
            // What was dropped before the first line that is there.
            log(3, 7, &b"a\n"[..]),
            log(4, 19, b"b\n"),
            log(6, 20, b"c\n"),
        ];
        for part in &parts {
            assembler.take(part, &mut events);
        }
        let lines = |text: &str| Log(text.as_bytes().to_vec());
        let gap = Gap {
            channel: Channel::Log,
            missing: 1,
        };
        let expected = [
            lines("a\n"),
            LinesLost(12),
            lines("b\n"),
            gap,
            LinesLost(1),
            lines("c\n"),
        ];
        assert_eq!(events.take(), expected);
    }

    #[test]
    fn a_record_without_end_is_given_up() {
        let mut assembler = Assembler::new(Channel::Trace);
        let mut events = Waiting::default();
        // A step that tells of more states than ever come.
        let step = [1, 1, 0, 0, 0];
        let head: Vec<u8> = (0..=u8::MAX)
            .map(|kind| [&[kind][..], &step].concat())
            .find(|bytes| {
                let taken = TraceEvent::take(&mut &bytes[..]);
                matches!(taken, Ok(TraceEvent::Step { .. }))
            })
            .map(|bytes| [bytes[0], 1, 1, 0xff, 0xff, 0x03].to_vec())
            .unwrap();
        assembler.take(&part(0, false, 0, &head), &mut events);
        let most = MAX_RECORD_BYTES / 96 + 2;
        for number in 0..most * 2 {
            assembler.take(
                &part((number as u8).wrapping_add(1), true, 0, &[1; 96]),
                &mut events,
            );
            assert!(assembler.pending.len() <= MAX_RECORD_BYTES + 96);
        }
        let told = events.take();
        let gap = StreamEvent::Gap {
            channel: Channel::Trace,
            missing: 1,
        };
        assert_eq!(told, [gap], "once");
    }

    #[test]
    fn what_nobody_fetches_is_kept_up_to_a_limit_and_then_told_as_missing() {
        let mut waiting = Waiting::default();
        const EVENTS: usize = 100_000;
        for _ in 0..EVENTS {
            waiting.push(StreamEvent::Log(vec![7; 96]));
        }
        let kept = MAX_WAITING_BYTES / (96 + EVENT_BYTES);
        let told = waiting.take();
        assert_eq!(told.len(), kept + 1);
        let gap = StreamEvent::Gap {
            channel: Channel::Log,
            missing: (EVENTS - kept) as u32,
        };
        assert_eq!(told.last(), Some(&gap));
        waiting.push(StreamEvent::Log(vec![7; 96]));
        assert_eq!(waiting.take().len(), 1, "there is room again");
    }
}
