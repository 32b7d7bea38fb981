//! A node at the end of a link that is no robot: an operator's radio. It sends the `out` frames of
//! a mission's link at their times, and hears the `in` frames.
//!
//! It knows no line and no clock: whoever has both brings bytes and times, in microseconds since
//! the node began.

use esm_core::frames::LATE_PERIODS;
use esm_link::frames::configuration::Configuration;
use esm_link::frames::occurrences::Occurrences;
use esm_link::frames::receiver::{InFrame, InFrames, ReceiveError, Receiver};
use esm_link::frames::wire::{self, Header, MAX_WIRE_BYTES, OVERHEAD_BYTES};
use serde::Serialize;
use serde_json::{Map, Value};
use thiserror::Error;

use crate::host_run::WiredLink;
use crate::inspect::FrameRow;
use crate::payload::{Layout, ValueError};
use crate::system::partner::{Course, Point, configuration_of};

/// Arrivals that an age is worked out from.
const RECENT: usize = 64;
/// By how much of a period a frame may come early or late, where a computer with other things to do
/// looks for it.
const SHIFTS_A_PERIOD: u64 = 4;

/// Why a mission's link cannot be served.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NodeError {
    /// A type of values that is not known here.
    #[error(
        "frame `{frame}` carries a `{type_name}`, and no task of the robot has that type: build the command with the robot's tasks, as its own host program"
    )]
    UnknownType {
        /// The frame.
        frame: String,
        /// The type.
        type_name: String,
    },
    /// Another length of the payload than the type has.
    #[error("frame `{frame}` has a payload of {declared} bytes, and its values take {needed}")]
    Payload {
        /// The frame.
        frame: String,
        /// What the mission says.
        declared: usize,
        /// What the type takes.
        needed: usize,
    },
}

/// Why a line of the operator says nothing.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SayError {
    /// No such name.
    #[error("nothing that is sent is called `{name}`: there are {known}")]
    UnknownName {
        /// What was said.
        name: String,
        /// What could have been.
        known: String,
    },
    /// No value of a flag.
    #[error("`{name}` is a flag: say `{name} on` or `{name} off`")]
    Flag {
        /// Its name.
        name: String,
    },
    /// No value of the frame's type.
    #[error("`{name}`: {cause}; or say `{name} none`, and it is not sent")]
    Value {
        /// The frame.
        name: String,
        /// Why.
        cause: ValueError,
    },
}

/// A frame that is sent.
struct Sends {
    frame: FrameRow,
    configuration: Configuration,
    layout: Option<Layout>,
    /// None where there is no value to be sent.
    payload: Option<Vec<u8>>,
    /// Number of the next occurrence.
    next: u64,
    sent: u64,
}

impl Sends {
    fn start_us(&self) -> u64 {
        let first_us = u64::from(self.frame.start_us.unwrap_or(0));
        first_us.saturating_add(self.next.saturating_mul(self.period_us()))
    }

    fn period_us(&self) -> u64 {
        u64::from(self.frame.period_us.max(1))
    }
}

/// A frame that is received.
struct Hears {
    frame: FrameRow,
    configuration: Configuration,
    layout: Option<Layout>,
    occurrences: Occurrences,
    recent: Vec<Point>,
    received: u64,
    late: u64,
    is_late: bool,
    heard_us: u64,
}

impl Hears {
    fn period_us(&self) -> u64 {
        u64::from(self.frame.period_us.max(1))
    }

    fn late_us(&self) -> u64 {
        let late_us = self.frame.late_us.map(u64::from);
        late_us.unwrap_or(LATE_PERIODS * self.period_us())
    }

    /// How old a value is that has come now, in microseconds.
    fn age_us(&mut self, now_us: u64, number: u8, least_us: f64) -> f64 {
        let period_us = self.period_us();
        let most_us = period_us / SHIFTS_A_PERIOD;
        let last = self.recent.last();
        let next = last.and_then(|it| it.next(period_us, most_us, now_us, number));
        let point = next.unwrap_or_else(|| {
            self.recent.clear();
            Point::first(now_us, number)
        });
        if self.recent.len() == RECENT {
            self.recent.remove(0);
        }
        self.recent.push(point);
        let course = Course::of(&self.recent, period_us as f64, least_us);
        course.map_or(least_us, |course| course.age_us(&point, now_us))
    }
}

/// The frames that are received, by their identifiers.
struct Known<'n>(&'n [Hears]);

impl InFrames for Known<'_> {
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)> {
        let index = self.0.iter().position(|it| it.frame.id == identifier)?;
        let of = self.0.get(index)?;
        let frame = InFrame {
            identifier,
            payload_bytes: u8::try_from(of.frame.payload_bytes).ok()?,
            configuration: of.configuration,
        };
        Some((index, frame))
    }
}

/// What a node has to tell.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum NodeEvent {
    /// A frame has come.
    Frame {
        /// When, in milliseconds.
        t_ms: f64,
        /// Its name.
        frame: String,
        /// Number of the occurrence, modulo 256.
        number: u8,
        /// How many are missing before it.
        lost: u64,
        /// How old its value is, from the start of the frame on.
        age_ms: f64,
        /// Its value, or its flags by their names.
        value: Value,
    },
    /// Something else has come.
    Wrong {
        /// When.
        t_ms: f64,
        /// What is wrong with it.
        why: String,
    },
    /// None has come for longer than may be.
    Late {
        /// When that was noticed.
        t_ms: f64,
        /// The frame.
        frame: String,
        /// Since when.
        since_ms: f64,
    },
}

/// How much there was.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Of each frame that is sent.
    pub sent: Vec<SentCount>,
    /// Of each that is received.
    pub received: Vec<ReceivedCount>,
    /// What came with a wrong checksum or length.
    pub corrupt: u64,
    /// What is declared in another way at the other end.
    pub other_configuration: u64,
    /// What nobody here receives.
    pub unknown: u64,
}

/// How often a frame was sent.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SentCount {
    /// Its name.
    pub frame: String,
    /// How often.
    pub sent: u64,
}

/// How often a frame has come.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ReceivedCount {
    /// Its name.
    pub frame: String,
    /// How often.
    pub received: u64,
    /// Numbers that were left out.
    pub lost: u64,
    /// Numbers that came again.
    pub doubled: u64,
    /// How often none came for longer than its `late`.
    pub late: u64,
}

/// A node.
pub struct LinkNode {
    sends: Vec<Sends>,
    hears: Vec<Hears>,
    receiver: Receiver,
    byte_us: f64,
    corrupt: u64,
    other_configuration: u64,
    unknown: u64,
}

/// Milliseconds with three digits behind the point.
fn ms(us: f64) -> f64 {
    libm::round(us) / 1e3 + 0.0
}

impl LinkNode {
    /// The node of a mission's link. `fields_of` tells what the values of a type are made of.
    ///
    /// # Errors
    /// [`NodeError`]
    pub fn new(
        link: &WiredLink,
        fields_of: &dyn Fn(&str) -> Option<String>,
    ) -> Result<Self, NodeError> {
        let mut node = LinkNode {
            sends: Vec::new(),
            hears: Vec::new(),
            receiver: Receiver::new(),
            byte_us: f64::from(link.bits) * 1e6 / f64::from(link.rate_bps.max(1)),
            corrupt: 0,
            other_configuration: 0,
            unknown: 0,
        };
        for frame in &link.frames {
            let layout = match &frame.type_name {
                None => None,
                Some(type_name) => Some(layout_of(frame, type_name, fields_of)?),
            };
            // It comes from a blob.
            let Some(configuration) = configuration_of(frame) else {
                continue;
            };
            let frame = frame.clone();
            match frame.direction {
                "out" => node.sends.push(Sends {
                    // Flags are there from the beginning.
                    payload: layout.is_none().then(|| vec![0; frame.payload_bytes]),
                    frame,
                    configuration,
                    layout,
                    next: 0,
                    sent: 0,
                }),
                _ => node.hears.push(Hears {
                    frame,
                    configuration,
                    layout,
                    occurrences: Occurrences::new(),
                    recent: Vec::new(),
                    received: 0,
                    late: 0,
                    is_late: false,
                    heard_us: 0,
                }),
            }
        }
        Ok(node)
    }

    /// Sets what is sent from now on: `NAME VALUE` of a frame or a flag. An empty line says
    /// nothing.
    ///
    /// # Errors
    /// [`SayError`]
    pub fn say(&mut self, line: &str) -> Result<(), SayError> {
        let line = line.trim();
        if line.is_empty() {
            return Ok(());
        }
        let (name, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let value = value.trim();
        for sends in &mut self.sends {
            match &sends.layout {
                Some(layout) if sends.frame.frame == name => {
                    sends.payload = match value {
                        "none" => None,
                        words => Some(layout.encode(words).map_err(|cause| SayError::Value {
                            name: name.to_owned(),
                            cause,
                        })?),
                    };
                    return Ok(());
                }
                Some(_) => {}
                None => {
                    let Some(bit) = sends.frame.flags.iter().position(|flag| flag == name) else {
                        continue;
                    };
                    let is_set = match value {
                        "on" => true,
                        "off" => false,
                        _ => {
                            let name = name.to_owned();
                            return Err(SayError::Flag { name });
                        }
                    };
                    let byte = sends.payload.as_mut().and_then(|it| it.get_mut(bit / 8));
                    if let Some(byte) = byte {
                        let mask = 1 << (bit % 8);
                        *byte = (*byte & !mask) | if is_set { mask } else { 0 };
                    }
                    return Ok(());
                }
            }
        }
        let known = self.sends.iter().flat_map(|sends| match sends.layout {
            Some(_) => vec![sends.frame.frame.clone()],
            None => sends.frame.flags.clone(),
        });
        let known: Vec<String> = known.collect();
        Err(SayError::UnknownName {
            name: name.to_owned(),
            known: known.join(", "),
        })
    }

    /// When the next frame starts.
    #[must_use]
    pub fn next_us(&self) -> Option<u64> {
        self.sends.iter().map(Sends::start_us).min()
    }

    /// The bytes of all frames that start by now. Whoever asks too late sends the newest occurrence
    /// alone; the others count as not sent.
    pub fn send(&mut self, now_us: u64) -> Vec<u8> {
        let mut bytes = Vec::new();
        for sends in &mut self.sends {
            let start_us = sends.start_us();
            if start_us > now_us {
                continue;
            }
            sends.next += (now_us - start_us) / sends.period_us();
            let header = Header {
                identifier: sends.frame.id,
                number: sends.next as u8,
                configuration: sends.configuration,
            };
            sends.next += 1;
            let mut frame = [0; MAX_WIRE_BYTES];
            let payload = sends.payload.as_deref();
            let length = payload.and_then(|it| wire::encode(header, it, &mut frame).ok());
            if let Some(frame) = length.and_then(|length| frame.get(..length)) {
                bytes.extend_from_slice(frame);
                sends.sent += 1;
            }
        }
        bytes
    }

    /// Takes bytes that have come.
    pub fn take(&mut self, bytes: &[u8], now_us: u64) -> Vec<NodeEvent> {
        let mut events = Vec::new();
        let mut rest = bytes;
        loop {
            let (index, number, payload) = match self.receiver.take(&mut rest, &Known(&self.hears))
            {
                None => return events,
                Some(Ok(arrived)) => (arrived.index, arrived.number, arrived.payload.to_vec()),
                Some(Err(error)) => {
                    match error {
                        ReceiveError::Configuration => self.other_configuration += 1,
                        ReceiveError::UnknownIdentifier => self.unknown += 1,
                        _ => self.corrupt += 1,
                    }
                    events.push(NodeEvent::Wrong {
                        t_ms: ms(now_us as f64),
                        why: error.to_string(),
                    });
                    continue;
                }
            };
            let Some(hears) = self.hears.get_mut(index) else {
                continue;
            };
            let before = hears.occurrences.missing();
            let is_late = now_us.saturating_sub(hears.heard_us) > hears.late_us();
            if !hears.occurrences.take(number, is_late) {
                continue;
            }
            let lost = hears.occurrences.missing() - before;
            hears.received += 1;
            (hears.heard_us, hears.is_late) = (now_us, false);
            let least_us = (payload.len() + OVERHEAD_BYTES) as f64 * self.byte_us;
            let age_us = hears.age_us(now_us, number, least_us);
            let value = match &hears.layout {
                Some(layout) => layout.decode(&payload),
                None => flags_in(&hears.frame.flags, &payload),
            };
            events.push(NodeEvent::Frame {
                t_ms: ms(now_us as f64),
                frame: hears.frame.frame.clone(),
                number,
                lost: lost.into(),
                age_ms: ms(age_us),
                value,
            });
        }
    }

    /// Looks which frames have not come for too long, and tells it once.
    pub fn look(&mut self, now_us: u64) -> Vec<NodeEvent> {
        let mut events = Vec::new();
        for hears in &mut self.hears {
            let waited_us = now_us.saturating_sub(hears.heard_us);
            if hears.is_late || waited_us <= hears.late_us() {
                continue;
            }
            hears.is_late = true;
            hears.late += 1;
            events.push(NodeEvent::Late {
                t_ms: ms(now_us as f64),
                frame: hears.frame.frame.clone(),
                since_ms: ms(hears.heard_us as f64),
            });
        }
        events
    }

    /// How much there was so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        let sent = self.sends.iter().map(|it| SentCount {
            frame: it.frame.frame.clone(),
            sent: it.sent,
        });
        let received = self.hears.iter().map(|it| ReceivedCount {
            frame: it.frame.frame.clone(),
            received: it.received,
            lost: it.occurrences.missing().into(),
            doubled: it.occurrences.repeated().into(),
            late: it.late,
        });
        Counts {
            sent: sent.collect(),
            received: received.collect(),
            corrupt: self.corrupt,
            other_configuration: self.other_configuration,
            unknown: self.unknown,
        }
    }
}

fn layout_of(
    frame: &FrameRow,
    type_name: &str,
    fields_of: &dyn Fn(&str) -> Option<String>,
) -> Result<Layout, NodeError> {
    let layout = fields_of(type_name).and_then(|text| Layout::of(&text));
    let layout = layout.ok_or_else(|| NodeError::UnknownType {
        frame: frame.frame.clone(),
        type_name: type_name.to_owned(),
    })?;
    match layout.bytes() {
        needed if needed == frame.payload_bytes => Ok(layout),
        needed => Err(NodeError::Payload {
            frame: frame.frame.clone(),
            declared: frame.payload_bytes,
            needed,
        }),
    }
}

/// Flags of a payload, by their names.
fn flags_in(names: &[String], payload: &[u8]) -> Value {
    let flags = names.iter().enumerate().map(|(bit, name)| {
        let byte = payload.get(bit / 8).copied().unwrap_or(0);
        (name.clone(), Value::Bool(byte >> (bit % 8) & 1 != 0))
    });
    Value::Object(flags.collect::<Map<_, _>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_link::frames::configuration::Content;
    use serde_json::json;

    const PERIOD_US: u32 = 50_000;

    fn frame(name: &str, id: u16, direction: &'static str, flags: &[&str]) -> FrameRow {
        let (content, payload_bytes) = match flags {
            [] => (Content::Value("Twist"), 8),
            flags => (Content::Flags(flags.len() as u16), 1),
        };
        FrameRow {
            frame: name.to_owned(),
            id,
            direction,
            type_name: flags.is_empty().then(|| "Twist".to_owned()),
            flags: flags.iter().map(|it| (*it).to_owned()).collect(),
            payload_bytes: payload_bytes.into(),
            period_us: PERIOD_US,
            start_us: (direction == "out").then_some(u32::from(id) * 5_000),
            late_us: None,
            configuration: format!(
                "{:016x}",
                Configuration::of(id, content, payload_bytes, PERIOD_US).hash()
            ),
        }
    }

    fn link(frames: Vec<FrameRow>) -> WiredLink {
        WiredLink {
            rate_bps: 115_200,
            bits: 10,
            frames,
            ..WiredLink::default()
        }
    }

    fn twist(type_name: &str) -> Option<String> {
        (type_name == "Twist").then(|| "forward_m_per_s:f32\nturn_rad_per_s:f32".to_owned())
    }

    /// An operator's node, and one that is the other end of it.
    fn both() -> (LinkNode, LinkNode) {
        let ways = |of_twist, of_flags| {
            let frames = vec![
                frame("twist", 1, of_twist, &[]),
                frame("lamps", 2, of_flags, &["left", "right"]),
            ];
            LinkNode::new(&link(frames), &twist).unwrap()
        };
        (ways("out", "in"), ways("in", "out"))
    }

    #[test]
    fn values_and_flags_cross_at_their_times_and_are_told_with_number_and_age() {
        let (mut operator, mut robot) = both();
        assert_eq!(
            (operator.next_us(), robot.next_us()),
            (Some(5_000), Some(10_000))
        );
        // No value, no frame; and its number is left out.
        assert!(operator.send(5_000).is_empty());
        operator.say("twist 0.25 -0.5").unwrap();
        robot.say("right on").unwrap();
        for nth in 1..40_u64 {
            let now_us = nth * u64::from(PERIOD_US) + 5_000;
            assert_eq!(operator.next_us(), Some(now_us));
            let bytes = operator.send(now_us);
            let heard = robot.take(&bytes, now_us + 2_000);
            let value = json!({"forward_m_per_s": 0.25, "turn_rad_per_s": -0.5});
            let [
                NodeEvent::Frame {
                    number,
                    lost,
                    age_ms,
                    value: told,
                    ..
                },
            ] = &heard[..]
            else {
                panic!("{heard:?}");
            };
            assert_eq!((u64::from(*number), *lost, told), (nth, 0, &value));
            // 18 bytes of the line.
            assert!((age_ms - 1.563).abs() < 0.01, "{age_ms}");
        }
        let heard = operator.take(&robot.send(10_000), 12_000);
        let lamps = json!({"left": false, "right": true});
        assert!(
            matches!(&heard[..], [NodeEvent::Frame { value, .. }] if *value == lamps),
            "{heard:?}"
        );
        robot.say("right off").unwrap();
        let heard = operator.take(&robot.send(60_000), 63_000);
        assert!(matches!(&heard[..], [NodeEvent::Frame { value, .. }] if value["right"] == false));
        // One that came late is older.
        let bytes = operator.send(41 * u64::from(PERIOD_US) + 5_000);
        let heard = robot.take(&bytes, 41 * u64::from(PERIOD_US) + 5_000 + 9_000);
        let [
            NodeEvent::Frame {
                lost: 1, age_ms, ..
            },
        ] = &heard[..]
        else {
            panic!("{heard:?}");
        };
        assert!((8.0..9.0).contains(age_ms), "{age_ms}");
        operator.say("twist none").unwrap();
        assert!(operator.send(10_000_000).is_empty());
    }

    #[test]
    fn a_partner_that_falls_silent_is_told_once_and_what_is_wrong_is_counted() {
        let (mut operator, mut robot) = both();
        operator.say("twist 1 2").unwrap();
        let bytes = operator.send(5_000);
        robot.take(&bytes, 6_000);
        assert_eq!(robot.look(156_000), []);
        let late = NodeEvent::Late {
            t_ms: 156.001,
            frame: "twist".to_owned(),
            since_ms: 6.0,
        };
        assert_eq!(robot.look(156_001), [late]);
        assert_eq!(robot.look(900_000), []);
        let mut spoiled = operator.send(905_000);
        spoiled[7] ^= 0x10;
        assert!(matches!(
            &robot.take(&spoiled, 906_000)[..],
            [NodeEvent::Wrong { .. }]
        ));
        let again = operator.send(955_000);
        assert_eq!(robot.take(&again, 956_000).len(), 1);
        // The same once more is dropped.
        assert_eq!(robot.take(&again, 956_100), []);
        let counts = robot.counts();
        let received = ReceivedCount {
            frame: "twist".to_owned(),
            received: 2,
            lost: 18,
            doubled: 1,
            late: 1,
        };
        assert_eq!((counts.received, counts.corrupt), (vec![received], 1));
        let mut other = frame("twist", 1, "in", &[]);
        other.configuration = "0123456789abcdef".to_owned();
        let mut strange = LinkNode::new(&link(vec![other]), &twist).unwrap();
        strange.take(&again, 0);
        assert_eq!(strange.counts().other_configuration, 1);
        strange.take(&robot.send(1_000_000), 0);
        assert_eq!(strange.counts().unknown, 1);
    }

    #[test]
    fn what_says_nothing_is_told_with_what_could_be_said() {
        let (mut operator, mut robot) = both();
        for (line, words) in [
            ("twists 1 2", "there are twist"),
            ("twist 1", "2 values are needed"),
            ("twist a b", "no value of forward_m_per_s"),
        ] {
            let wrong = operator.say(line).unwrap_err().to_string();
            assert!(wrong.contains(words), "{wrong}");
        }
        let wrong = robot.say("left up").unwrap_err().to_string();
        assert!(wrong.contains("`left on` or `left off`"), "{wrong}");
        assert_eq!(robot.say("  "), Ok(()));
        for (bytes, fields) in [(8, None), (9, twist("Twist"))] {
            let frame = FrameRow {
                payload_bytes: bytes,
                ..frame("twist", 1, "out", &[])
            };
            assert!(LinkNode::new(&link(vec![frame]), &|_| fields.clone()).is_err());
        }
    }
}
