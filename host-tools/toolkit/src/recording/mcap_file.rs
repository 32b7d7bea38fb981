//! A recording as an MCAP file, which [Foxglove](https://foxglove.dev) and Lichtblick open.
//!
//! All messages are JSON, with JSON Schemas: each value says in the file itself what it is made of,
//! and so do those of tasks that this program does not know.
//!
//! | topic | schema | a message is |
//! |---|---|---|
//! | `/states/` and the path of a region | `esm.RegionState` | the state that became current in it; empty where the region is not active any more |
//! | `/transitions` | `foxglove.Log` | a transition that was taken, or a fault |
//! | `/values/`, the path of a state, `/` and the port that writes the net | `foxglove.PoseInFrame` | a pose, and its fields as they are on the net |
//! | the same | `esm.` and the name of the type | any other value: its fields as they are on the net |
//!
//! Times of messages are those of [`Told`], never those of a clock on a wall. Equal recordings give
//! equal bytes.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io::{self, Write};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use serde::Serialize;
use serde_json::{Map, json};
use thiserror::Error;

use super::player::Recording;
use super::samples::{BadSamples, Sample};
use super::told::{FaultThen, Told};
use crate::mission_hash::hash_text;
use crate::parameters::{ParameterType, Value};
use crate::values::{Field, Shape, Text, Watched};

/// The frame in which odometry tells poses: its origin is where the robot was switched on.
const ODOMETRY_FRAME: &str = "odometry";

/// Topic of transitions and faults.
const TRANSITIONS: &str = "/transitions";

/// Encoding of all messages.
const MESSAGE_ENCODING: &str = "json";
/// Encoding of all schemas.
const SCHEMA_ENCODING: &str = "jsonschema";

/// Channels of a file at most.
const MAX_CHANNELS: usize = 10_000;

/// How grave a message of a log is, in `foxglove.Log`.
const INFO: u8 = 2;
/// See [`INFO`].
const ERROR: u8 = 4;

/// Why a file could not be written.
#[derive(Debug, Error)]
pub enum McapFileError {
    /// The file.
    #[error("{0}")]
    File(#[from] io::Error),
    /// The recording has more than a file of this kind has room for.
    #[error("an MCAP file has no room for it: {0}")]
    Format(String),
    /// No mission has so many regions and nets.
    #[error(
        "the recording has more than {MAX_CHANNELS} regions and nets: record the run in shorter parts"
    )]
    TooManyChannels,
    /// The samples make no sense.
    #[error(transparent)]
    Samples(#[from] BadSamples),
}

/// A channel of a file, and what it holds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Channel {
    /// Its topic.
    pub topic: String,
    /// Name of the schema of its messages.
    pub schema: String,
    /// How many messages it has.
    pub messages: u64,
}

/// Writes what a recording tells. Answers the channels of the file, in the order of their ids.
///
/// # Errors
/// [`McapFileError`]: what was written until then is no whole file.
pub fn write(
    recording: &Recording,
    told: &Told,
    out: impl Write,
) -> Result<Vec<Channel>, McapFileError> {
    let program = concat!("esm ", env!("CARGO_PKG_VERSION"));
    let writer = WriteOptions::new()
        .compression(None)
        .library(program)
        // What is written may be a pipe.
        .disable_seeking(true)
        .create(NoSeek::new(out))?;
    let mut file = File {
        writer,
        channels: Vec::new(),
        ids: HashMap::new(),
    };
    file.writer.write_metadata(&metadata(recording))?;
    let mut changes = changes(told).into_iter().peekable();
    for sample in recording.samples() {
        let sample = sample?;
        let Some((t_us, _)) = told.place(&sample, recording) else {
            continue;
        };
        while let Some(change) = changes.next_if(|change| change.t_us() <= t_us) {
            file.change(&change, told)?;
        }
        file.sample(&sample, t_us)?;
    }
    for change in changes {
        file.change(&change, told)?;
    }
    file.writer.finish()?;
    Ok(file.channels)
}

/// Where a recording comes from.
fn metadata(recording: &Recording) -> Metadata {
    let head = &recording.head;
    let missions = (recording.missions.iter())
        .map(|mission| format!("{} {}", mission.name, hash_text(mission.verified.hash())));
    let mut metadata = BTreeMap::from([
        ("board".to_owned(), head.board.clone()),
        ("firmware".to_owned(), head.firmware.clone()),
        (
            "missions".to_owned(),
            missions.collect::<Vec<_>>().join(", "),
        ),
        ("recorded_by".to_owned(), head.program.clone()),
    ]);
    if let Some(seed) = head.seed {
        metadata.insert("seed".to_owned(), seed.to_string());
    }
    Metadata {
        name: "esm".to_owned(),
        metadata,
    }
}

/// What happened to a machine.
enum Happened<'t> {
    /// A region has another state.
    State {
        t_us: u64,
        mission: &'t str,
        region: &'t str,
        state: Option<&'t str>,
    },
    /// A transition, by its number.
    Transition { t_us: u64, number: usize },
    /// A fault.
    Fault(FaultThen),
}

impl Happened<'_> {
    fn t_us(&self) -> u64 {
        match self {
            Happened::State { t_us, .. } | Happened::Transition { t_us, .. } => *t_us,
            Happened::Fault(fault) => fault.t_us,
        }
    }
}

/// All that happened to machines, in the order of time.
fn changes(told: &Told) -> Vec<Happened<'_>> {
    let mut changes: Vec<Happened<'_>> = (told.transitions.iter().enumerate())
        .map(|(number, then)| Happened::Transition {
            t_us: then.t_us,
            number,
        })
        .collect();
    changes.extend(told.faults.iter().copied().map(Happened::Fault));
    let last_us = told.span_us.map_or(0, |(_, last_us)| last_us);
    // A region that another mission has, too, goes on there.
    let mut regions: BTreeMap<&str, Vec<(&str, &crate::pictures::StateSpan)>> = BTreeMap::new();
    for mission in &told.missions {
        for region in &mission.regions {
            let spans = region
                .spans
                .iter()
                .map(|span| (mission.name.as_str(), span));
            regions.entry(&region.path).or_default().extend(spans);
        }
    }
    for (region, spans) in regions {
        for (index, (mission, span)) in spans.iter().enumerate() {
            changes.push(Happened::State {
                t_us: span.start_us,
                mission,
                region,
                state: Some(&span.state),
            });
            let next_us = spans
                .get(index + 1)
                .map_or(last_us, |(_, next)| next.start_us);
            if next_us > span.end_us {
                changes.push(Happened::State {
                    t_us: span.end_us,
                    mission,
                    region,
                    state: None,
                });
            }
        }
    }
    changes.sort_by_key(Happened::t_us);
    changes
}

/// A time in the form of the well-known schemas.
#[derive(Clone, Copy, Serialize)]
struct Timestamp {
    sec: u64,
    nsec: u64,
}

impl Timestamp {
    fn of(t_us: u64) -> Self {
        Timestamp {
            sec: t_us / 1_000_000,
            nsec: t_us % 1_000_000 * 1_000,
        }
    }
}

#[derive(Serialize)]
struct RegionState<'t> {
    timestamp: Timestamp,
    mission: &'t str,
    state: &'t str,
}

#[derive(Serialize)]
struct Log<'t> {
    timestamp: Timestamp,
    level: u8,
    message: String,
    name: &'t str,
    file: &'static str,
    line: u32,
}

/// A value that is a number itself.
#[derive(Serialize)]
struct Number<'v> {
    timestamp: Timestamp,
    value: Option<&'v Value>,
}

/// A value of fields.
#[derive(Serialize)]
struct Fields<'v> {
    timestamp: Timestamp,
    #[serde(flatten)]
    fields: Text<'v>,
}

#[derive(Serialize)]
struct PoseInFrame<'v> {
    timestamp: Timestamp,
    frame_id: &'static str,
    pose: Pose,
    #[serde(flatten)]
    fields: Text<'v>,
}

#[derive(Serialize)]
struct Pose {
    position: Vector,
    orientation: Quaternion,
}

#[derive(Serialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Serialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

impl Pose {
    /// A pose on the floor, whose heading turns about the vertical axis.
    fn of(values: &[Value]) -> Option<Self> {
        let [
            Value::F32(x_m),
            Value::F32(y_m),
            Value::F32(heading_rad),
            ..,
        ] = values
        else {
            return None;
        };
        let half_rad = f64::from(*heading_rad) / 2.0;
        Some(Pose {
            position: Vector {
                x: (*x_m).into(),
                y: (*y_m).into(),
                z: 0.0,
            },
            orientation: Quaternion {
                x: 0.0,
                y: 0.0,
                z: libm::sin(half_rad),
                w: libm::cos(half_rad),
            },
        })
    }
}

/// A file that is written.
struct File<W: Write> {
    writer: Writer<NoSeek<W>>,
    channels: Vec<Channel>,
    /// Ids of channels, by topic and by what tells two of one topic apart; and their places.
    ids: HashMap<(String, Kind), (u16, usize)>,
}

/// What is on a channel.
#[derive(Clone, PartialEq, Eq, Hash)]
enum Kind {
    State,
    Log,
    /// Values of this type, with these fields.
    Value(String, String),
}

impl<W: Write> File<W> {
    fn change(&mut self, change: &Happened<'_>, told: &Told) -> Result<(), McapFileError> {
        let timestamp = Timestamp::of(change.t_us());
        let (level, message, name) = match change {
            Happened::State {
                t_us,
                mission,
                region,
                state,
            } => {
                let message = RegionState {
                    timestamp,
                    mission,
                    state: state.unwrap_or_default(),
                };
                let topic = format!("/states/{region}");
                return self.message(topic, Kind::State, state_schema, *t_us, &message);
            }
            Happened::Transition { number, .. } => {
                let Some((then, words)) = (told.transitions.get(*number))
                    .and_then(|then| Some((then, told.words(then)?)))
                else {
                    return Ok(());
                };
                let sent = match words.sent.as_slice() {
                    [] => String::new(),
                    sent => format!(", sends {}", sent.join(", ")),
                };
                let message = format!("{} -> {} on {}{sent}", words.from, words.to, words.event);
                (INFO, message, told.mission(then.run))
            }
            Happened::Fault(FaultThen { code, run, .. }) => {
                (ERROR, format!("fault: {code}"), told.mission(*run))
            }
        };
        let log = Log {
            timestamp,
            level,
            message,
            name,
            file: "",
            line: 0,
        };
        let topic = TRANSITIONS.to_owned();
        self.message(topic, Kind::Log, log_schema, change.t_us(), &log)
    }

    fn sample(&mut self, sample: &Sample, t_us: u64) -> Result<(), McapFileError> {
        let timestamp = Timestamp::of(t_us);
        for (watched, values) in sample.nets.iter().zip(&sample.values) {
            let Some(values) = values else { continue };
            let Watched { net, fields } = watched;
            let topic = format!("/values/{}", net.name().replace('.', "/"));
            let kind = Kind::Value(net.type_name.clone(), crate::values::text_of(fields));
            let text = Text { fields, values };
            let pose = match watched.shape() {
                Shape::Pose => Pose::of(values),
                _ => None,
            };
            let schema = || value_schema(watched);
            match (pose, &fields[..]) {
                (Some(pose), _) => {
                    let message = PoseInFrame {
                        timestamp,
                        frame_id: ODOMETRY_FRAME,
                        pose,
                        fields: text,
                    };
                    self.message(topic, kind, schema, t_us, &message)?;
                }
                (None, [field]) if field.name.is_empty() => {
                    let value = values.first();
                    self.message(topic, kind, schema, t_us, &Number { timestamp, value })?;
                }
                (None, _) => {
                    let message = Fields {
                        timestamp,
                        fields: text,
                    };
                    self.message(topic, kind, schema, t_us, &message)?;
                }
            }
        }
        Ok(())
    }

    /// Adds a message to a channel, which is made where it is the first one.
    fn message(
        &mut self,
        topic: String,
        kind: Kind,
        schema: impl FnOnce() -> (String, serde_json::Value),
        t_us: u64,
        message: &impl Serialize,
    ) -> Result<(), McapFileError> {
        let key = (topic, kind);
        let (id, place) = match self.ids.get(&key) {
            Some(known) => *known,
            None if self.channels.len() == MAX_CHANNELS => {
                return Err(McapFileError::TooManyChannels);
            }
            None => {
                let (name, schema) = schema();
                let schema_id = (self.writer).add_schema(
                    &name,
                    SCHEMA_ENCODING,
                    schema.to_string().as_bytes(),
                )?;
                let id = (self.writer).add_channel(
                    schema_id,
                    &key.0,
                    MESSAGE_ENCODING,
                    &BTreeMap::new(),
                )?;
                let place = self.channels.len();
                self.channels.push(Channel {
                    topic: key.0.clone(),
                    schema: name,
                    messages: 0,
                });
                self.ids.insert(key, (id, place));
                (id, place)
            }
        };
        let sequence = match self.channels.get_mut(place) {
            Some(channel) => {
                channel.messages += 1;
                channel.messages as u32
            }
            None => 0,
        };
        let time_ns = t_us.saturating_mul(1_000);
        let header = MessageHeader {
            channel_id: id,
            sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        let bytes = serde_json::to_vec(message).map_err(io::Error::from)?;
        Ok(self.writer.write_to_known_channel(&header, &bytes)?)
    }
}

fn timestamp_schema() -> serde_json::Value {
    json!({
        "type": "object",
        "title": "time",
        "properties": {
            "sec": { "type": "integer", "minimum": 0 },
            "nsec": { "type": "integer", "minimum": 0, "maximum": 999_999_999 },
        },
    })
}

fn state_schema() -> (String, serde_json::Value) {
    let schema = json!({
        "title": "esm.RegionState",
        "description": "The state that became current in a region",
        "type": "object",
        "properties": {
            "timestamp": timestamp_schema(),
            "mission": { "type": "string", "description": "Name of the mission" },
            "state": {
                "type": "string",
                "description": "Name of the state; empty where the region is not active",
            },
        },
    });
    ("esm.RegionState".to_owned(), schema)
}

fn log_schema() -> (String, serde_json::Value) {
    let schema = json!({
        "title": "foxglove.Log",
        "type": "object",
        "properties": {
            "timestamp": timestamp_schema(),
            "level": { "type": "integer", "description": "2: transition, 4: fault" },
            "message": { "type": "string" },
            "name": { "type": "string", "description": "Name of the mission" },
            "file": { "type": "string" },
            "line": { "type": "integer", "minimum": 0 },
        },
    });
    ("foxglove.Log".to_owned(), schema)
}

/// The schema of values on a net.
fn value_schema(watched: &Watched) -> (String, serde_json::Value) {
    let mut properties = Map::new();
    properties.insert("timestamp".to_owned(), timestamp_schema());
    let name = match watched.shape() {
        Shape::Pose => {
            let number = json!({ "type": "number" });
            let vector = json!({ "x": number, "y": number, "z": number });
            let quaternion = json!({ "x": number, "y": number, "z": number, "w": number });
            properties.insert("frame_id".to_owned(), json!({ "type": "string" }));
            properties.insert(
                "pose".to_owned(),
                json!({
                    "type": "object",
                    "properties": {
                        "position": { "type": "object", "properties": vector },
                        "orientation": { "type": "object", "properties": quaternion },
                    },
                }),
            );
            Cow::Borrowed("foxglove.PoseInFrame")
        }
        _ => Cow::Owned(format!("esm.{}", watched.net.type_name)),
    };
    for row in watched.fields.chunk_by(|one, other| one.name == other.name) {
        let [first, ..] = row else { continue };
        let (name, schema) = match &*first.name {
            "" => ("value", number_schema(first)),
            name => (name, number_schema(first)),
        };
        let schema = match row.len() {
            1 => schema,
            count => json!({
                "type": "array",
                "items": schema,
                "minItems": count,
                "maxItems": count,
            }),
        };
        properties.insert(name.to_owned(), schema);
    }
    let schema = json!({ "title": name, "type": "object", "properties": properties });
    (name.into_owned(), schema)
}

fn number_schema(field: &Field) -> serde_json::Value {
    let kind = match field.kind {
        ParameterType::Bool => json!("boolean"),
        ParameterType::I32 | ParameterType::U32 => json!("integer"),
        // One that is not finite is null all the same. The viewers know no type of two kinds.
        ParameterType::F32 => json!("number"),
    };
    match field.label() {
        (_, "") => json!({ "type": kind }),
        (_, unit) => json!({ "type": kind, "description": unit }),
    }
}

impl From<McapError> for McapFileError {
    fn from(error: McapError) -> Self {
        match error {
            McapError::Io(error) => McapFileError::File(error),
            error => McapFileError::Format(error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::planted::{BLINK, FLOOD, Planted};
    use crate::values::{Net, fields_of};

    fn written(recording: &Recording) -> (Vec<u8>, Vec<Channel>) {
        let mut bytes = Vec::new();
        let (told, ended) = Told::of(recording);
        ended.unwrap();
        let channels = write(recording, &told, &mut bytes).unwrap();
        (bytes, channels)
    }

    /// Time, topic and content of each message, as another program reads them.
    fn messages(bytes: &[u8]) -> Vec<(u64, String, serde_json::Value)> {
        let messages = mcap::MessageStream::new(bytes).unwrap();
        let message = |message: Result<mcap::Message<'_>, McapError>| {
            let message = message.unwrap();
            let json = serde_json::from_slice(&message.data).unwrap();
            (message.log_time, message.channel.topic.clone(), json)
        };
        messages.map(message).collect()
    }

    #[test]
    fn states_and_transitions_are_told_in_the_order_of_time() {
        let planted = Planted::new().run(("blink", BLINK), 0, 0..8, &[]);
        let (bytes, channels) = written(&planted.recording());
        let messages = messages(&bytes);
        assert!(messages.is_sorted_by_key(|(time_ns, ..)| *time_ns));
        let states: Vec<_> = (messages.iter())
            .filter(|(_, topic, _)| topic == "/states/light")
            .map(|(time_ns, _, json)| (time_ns / 1_000_000, json["state"].as_str().unwrap()))
            .collect();
        assert_eq!(states, [(0, "On"), (60, "Off"), (120, "On")]);
        let log = messages.iter().find(|(_, topic, _)| topic == TRANSITIONS);
        let (_, _, json) = log.unwrap();
        assert_eq!(json["message"], "light/initial -> light/On on pulse");
        let counted: u64 = channels.iter().map(|channel| channel.messages).sum();
        assert_eq!(counted, messages.len() as u64);
    }

    #[test]
    fn a_region_that_is_not_active_any_more_has_no_state() {
        let first = Planted::new().run(("blink", BLINK), 0, 0..5, &[]);
        let both = first.run(("flood", FLOOD), 100_000, 0..5, &[]);
        let (bytes, _) = written(&both.recording());
        let light: Vec<_> = (messages(&bytes).into_iter())
            .filter(|(_, topic, _)| topic == "/states/light")
            .map(|(time_ns, _, json)| (time_ns / 1_000_000, json["state"].clone()))
            .collect();
        assert_eq!(light.last().unwrap(), &(100, json!("")));
    }

    #[test]
    fn a_fault_is_a_line_of_the_log_with_its_mission() {
        let reports = [(3, "set clock/Wait.near")];
        let planted = Planted::new().run(("flood", FLOOD), 0, 0..6, &reports);
        let (bytes, _) = written(&planted.recording());
        let log: Vec<_> = (messages(&bytes).into_iter())
            .filter(|(_, topic, json)| topic == TRANSITIONS && json["level"] == ERROR)
            .map(|(time_ns, _, json)| (time_ns / 1_000_000, json["name"].clone()))
            .collect();
        assert_eq!(log, [(30, json!("flood"))]);
    }

    #[test]
    fn equal_recordings_give_equal_bytes() {
        let planted = Planted::new().run(("blink", BLINK), 0, 0..200, &[]);
        let once = written(&planted.recording());
        for _ in 0..5 {
            assert!(written(&planted.recording()) == once);
        }
    }

    /// The readers of JSON Schemas in Foxglove and Lichtblick refuse a channel otherwise.
    #[test]
    fn each_property_of_a_schema_is_of_one_plain_type() {
        fn check(schema: &serde_json::Value, place: &str) {
            let kind = schema["type"].as_str();
            let kind = kind.unwrap_or_else(|| panic!("{place}: {schema}"));
            match kind {
                "object" => {
                    for (name, property) in schema["properties"].as_object().unwrap() {
                        check(property, &format!("{place}.{name}"));
                    }
                }
                "array" => check(&schema["items"], place),
                _ => assert!(
                    ["boolean", "string", "number", "integer"].contains(&kind),
                    "{place}: {kind}"
                ),
            }
        }
        let watched = |fields: &str| Watched {
            net: Net {
                index: 0,
                names: vec!["a".into()],
                type_name: "T".into(),
            },
            fields: fields_of(fields).unwrap().into(),
        };
        let mut schemas = vec![state_schema(), log_schema()];
        for fields in [
            "x_m:f32\ny_m:f32\nheading_rad:f32\n",
            ":u32\n",
            "range_m:[f32;8]\nage_cs:[u8;8]\ndead:u32\nlost:bool\nleft:i16\n",
        ] {
            schemas.push(value_schema(&watched(fields)));
        }
        let names: Vec<&str> = schemas.iter().map(|(name, _)| name.as_str()).collect();
        let expected = [
            "esm.RegionState",
            "foxglove.Log",
            "foxglove.PoseInFrame",
            "esm.T",
            "esm.T",
        ];
        assert_eq!(names, expected);
        for (name, schema) in &schemas {
            check(schema, name);
        }
    }
}
