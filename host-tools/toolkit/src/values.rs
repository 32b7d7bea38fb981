//! Values on nets of a mission: which nets there are, by name, what their values are made of, and
//! how a value is told.
//!
//! A net has no name of its own. It goes by the ports of task states that are on it: the path of
//! the state, a dot, the port.

use std::fmt;
use std::sync::Arc;

use esm_core::Verified;
use esm_core::signature::{Direction, Port};
use esm_link::telemetry::MAX_VALUE_WORDS;
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::parameters::{ParameterType, Value};
use crate::trace::directory::{Directory, NoDirectory};

/// A net of a mission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Net {
    /// Its index in the blob.
    pub index: u16,
    /// Its names: first those of the ports that write it.
    pub names: Vec<String>,
    /// Name of the type of its values.
    pub type_name: String,
}

impl Net {
    /// The first of its names.
    pub fn name(&self) -> &str {
        self.names.first().map_or("", String::as_str)
    }
}

/// The nets of a mission that something writes, in the order of their indices.
///
/// # Errors
/// The blob has no names.
pub fn nets_of<B>(blob: &Verified<B>) -> Result<Vec<Net>, NoDirectory>
where
    B: std::ops::Deref<Target = [u8]>,
{
    let tables = blob.tables();
    let directory = Directory::of(&tables)?;
    let mut written: Vec<Option<Net>> = vec![None; tables.net_count()];
    let mut readers: Vec<(usize, String)> = Vec::new();
    for (instance, state) in directory.task_states().iter().enumerate() {
        let (Some(state), Some(task), Some(place)) = (
            directory.state(*state),
            tables
                .task_state_of(instance)
                .and_then(|task_state| tables.task(task_state.task)),
            tables.task_instance(instance),
        ) else {
            continue;
        };
        let ports = task.signature.ports().filter_map(|port| match port {
            Port::Data {
                direction,
                name,
                type_name,
                ..
            } => Some((direction, name, type_name)),
            _ => None,
        });
        for (port, (direction, name, type_name)) in (0_u8..).zip(ports) {
            let Some(Some(net)) = tables.connection(place.first_connection + usize::from(port))
            else {
                continue;
            };
            let name = format!("{}.{}", state.path, String::from_utf8_lossy(name));
            if direction == Direction::In {
                readers.push((net, name));
                continue;
            }
            let (Some(entry), Ok(index)) = (written.get_mut(net), u16::try_from(net)) else {
                continue;
            };
            match entry {
                Some(net) => net.names.push(name),
                None => {
                    *entry = Some(Net {
                        index,
                        names: vec![name],
                        type_name: String::from_utf8_lossy(type_name).into_owned(),
                    });
                }
            }
        }
    }
    for (net, name) in readers {
        if let Some(Some(net)) = written.get_mut(net) {
            net.names.push(name);
        }
    }
    Ok(written.into_iter().flatten().collect())
}

/// A field of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name, which ends in its unit where it has one. A value that is a number itself has one
    /// field without a name. All fields of a row share it.
    pub name: Arc<str>,
    /// What it can be.
    pub kind: ParameterType,
    /// Where it stands in its word, and how many bits it has there. A word begins with the field
    /// that stands at 0.
    pub shift: u8,
    /// See [`shift`](Self::shift).
    pub bits: u8,
}

/// The most fields that a value has which can be told at all: beyond that, rows are not taken
/// apart. A mission's types have no more together.
pub const MAX_FIELDS: usize = 1 << 16;

/// Bits of a word of a sample.
const WORD_BITS: u8 = u32::BITS as u8;

/// Fields from what a robot says of them, a line each, with a row as so many fields of one name.
/// `None` where that says something else.
pub fn fields_of(text: &str) -> Option<Vec<Field>> {
    let mut fields = Vec::new();
    for line in text.lines() {
        let (name, kind) = line.split_once(':')?;
        let row = kind
            .strip_prefix('[')
            .and_then(|row| row.strip_suffix(']')?.split_once(';'));
        let (kind, count) = match row {
            Some((kind, count)) => (kind, count.parse::<usize>().ok()?),
            None => (kind, 1),
        };
        let (kind, bits_of_row) = match kind {
            "bool" => (ParameterType::Bool, WORD_BITS),
            "i8" => (ParameterType::I32, 8),
            "i16" => (ParameterType::I32, 16),
            "i32" => (ParameterType::I32, WORD_BITS),
            "u8" => (ParameterType::U32, 8),
            "u16" => (ParameterType::U32, 16),
            "u32" => (ParameterType::U32, WORD_BITS),
            "f32" => (ParameterType::F32, WORD_BITS),
            _ => return None,
        };
        if count > MAX_FIELDS - fields.len() {
            return None;
        }
        let name: Arc<str> = name.into();
        let bits = if row.is_some() {
            bits_of_row
        } else {
            WORD_BITS
        };
        let shifts = (0..WORD_BITS).step_by(usize::from(bits)).cycle();
        fields.extend(shifts.take(count).map(|shift| Field {
            name: name.clone(),
            kind,
            shift,
            bits,
        }));
    }
    Some(fields)
}

/// What [`fields_of`] reads as these fields.
pub fn text_of(fields: &[Field]) -> String {
    let mut text = String::new();
    for row in fields.chunk_by(|one, other| {
        (&one.name, one.kind, one.bits) == (&other.name, other.kind, other.bits)
    }) {
        let [first, ..] = row else { continue };
        let kind = match (first.kind, first.bits) {
            (ParameterType::I32, 8) => "i8",
            (ParameterType::I32, 16) => "i16",
            (ParameterType::U32, 8) => "u8",
            (ParameterType::U32, 16) => "u16",
            (kind, _) => kind.name(),
        };
        let line = match row.len() {
            1 if first.bits == WORD_BITS => format!("{}:{kind}\n", first.name),
            count => format!("{}:[{kind};{count}]\n", first.name),
        };
        text.push_str(&line);
    }
    text
}

/// Endings of fields' names, and the units that they stand for. The longest that fits counts.
const UNITS: &[(&str, &str)] = &[
    ("_rad_per_s", "rad/s"),
    ("_deg_per_s", "°/s"),
    ("_m_per_s2", "m/s²"),
    ("_mm_per_s", "mm/s"),
    ("_m_per_s", "m/s"),
    ("_percent", "%"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_mm", "mm"),
    ("_um", "µm"),
    ("_ms", "ms"),
    ("_cs", "cs"),
    ("_us", "µs"),
    ("_ns", "ns"),
    ("_hz", "Hz"),
    ("_mv", "mV"),
    ("_ma", "mA"),
    ("_m", "m"),
    ("_s", "s"),
    ("_v", "V"),
    ("_a", "A"),
    ("_w", "W"),
];

/// How many words these take in a sample. Integers of one row share words, four or two in each.
pub fn words_of(fields: &[Field]) -> usize {
    fields.iter().filter(|field| field.shift == 0).count()
}

impl Field {
    /// The value that stands for it in its word.
    fn value(&self, word: u32) -> Value {
        let unused = u32::from(WORD_BITS - self.bits);
        // To the upper end, and back: what was left of it is gone, and a sign is kept.
        let upper = word >> self.shift << unused;
        let bits = match self.kind {
            ParameterType::I32 => (upper.cast_signed() >> unused).cast_unsigned(),
            _ => upper >> unused,
        };
        self.kind.value(bits)
    }

    /// What it is, and its unit, which is nothing where its name tells none.
    pub fn label(&self) -> (&str, &'static str) {
        let known = UNITS
            .iter()
            .find_map(|(ending, unit)| Some((self.name.strip_suffix(ending)?, *unit)));
        known.unwrap_or((&self.name, ""))
    }
}

/// A net whose values are looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Watched {
    /// The net.
    pub net: Net,
    /// What its values are made of. Nets of the same type share it.
    pub fields: Arc<[Field]>,
}

/// What a value is, as far as pictures and other programs know it: by the names of its fields,
/// whatever its type is called. In the order in which they matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shape {
    /// Place and heading: `x_m`, `y_m`, `heading_rad`.
    Pose,
    /// Speed ahead and speed of turning: `forward_m_per_s`, `turn_rad_per_s`.
    Twist,
    /// Ranges of sensors: a row `range_m`, or `range_mm` of whole numbers.
    Ranges,
    /// Anything else.
    Other,
}

/// Names of the fields of a pose.
const POSE: [&str; 3] = ["x_m", "y_m", "heading_rad"];
/// Names of the fields of a twist.
const TWIST: [&str; 2] = ["forward_m_per_s", "turn_rad_per_s"];
/// Name of a row of ranges in metres.
const RANGES_M: &str = "range_m";
/// Name of a row of ranges in whole millimetres.
const RANGES_MM: &str = "range_mm";

impl Field {
    /// The range in metres that this value of it is: not finite where it is none, or is not known,
    /// which is 0.
    pub fn range_m(&self, value: &Value) -> f32 {
        let range_m = match (&*self.name, value) {
            (RANGES_M, Value::F32(range_m)) => *range_m,
            (RANGES_MM, Value::U32(range_mm)) => *range_mm as f32 / 1e3,
            _ => f32::NAN,
        };
        if range_m > 0.0 { range_m } else { f32::NAN }
    }

    /// Whether it is one of a row of ranges.
    pub fn is_range(&self) -> bool {
        match &*self.name {
            RANGES_M => self.kind == ParameterType::F32,
            RANGES_MM => self.kind == ParameterType::U32,
            _ => false,
        }
    }
}

impl Watched {
    /// Name of the number at a place of its values: that of the net, that of the field, and where
    /// it stands in a row of several.
    pub fn name_of(&self, place: usize) -> String {
        let net = self.net.name();
        let Some(field) = self.fields.get(place) else {
            return net.to_owned();
        };
        let is_of_row = |other: &&Field| other.name == field.name;
        let (label, _) = field.label();
        match self.fields.iter().filter(is_of_row).count() {
            1 => format!("{net} {label}"),
            _ => {
                let number = self.fields.iter().take(place).filter(is_of_row).count();
                format!("{net} {label} {number}")
            }
        }
    }

    /// What its values are.
    pub fn shape(&self) -> Shape {
        let is =
            |field: &Field, name: &str| *field.name == *name && field.kind == ParameterType::F32;
        let are = |names: &[&str]| {
            let mut pairs = self.fields.iter().zip(names);
            names.len() <= self.fields.len() && pairs.all(|(field, name)| is(field, name))
        };
        if are(&POSE) {
            Shape::Pose
        } else if are(&TWIST) {
            Shape::Twist
        } else if self.fields.iter().any(Field::is_range) {
            Shape::Ranges
        } else {
            Shape::Other
        }
    }
}

/// The nets that a recording keeps samples of, in as many words as one has: poses, twists and
/// ranges before others. And how many have no room.
pub fn kept(nets: &[Watched]) -> (Vec<Watched>, usize) {
    let mut nets: Vec<&Watched> = nets.iter().collect();
    nets.retain(|watched| words_of(&watched.fields) > 0);
    nets.sort_by_key(|watched| watched.shape());
    let all = nets.len();
    let mut room = MAX_VALUE_WORDS;
    nets.retain(|watched| {
        let left = room.checked_sub(words_of(&watched.fields));
        room = left.unwrap_or(room);
        left.is_some()
    });
    (nets.iter().copied().cloned().collect(), all - nets.len())
}

/// What asks a robot what values on a net of the mission of this hash are made of, from a byte of
/// the text on, as [`Ask`](esm_link::telemetry::Ask) reads it.
pub fn ask_for_fields(mission: u32, net: u16, offset: u16) -> Vec<u8> {
    numbers_of(0, mission, &[net, offset])
}

/// What asks a robot for values on these nets of the mission of this hash, each so many
/// milliseconds at most.
pub fn ask_for_values(mission: u32, period_ms: u16, nets: &[u16]) -> Vec<u8> {
    numbers_of(1, mission, &[&[period_ms], nets].concat())
}

fn numbers_of(what: u16, mission: u32, numbers: &[u16]) -> Vec<u8> {
    let mission = [mission as u16, (mission >> u16::BITS) as u16];
    let all = [&[what], &mission[..], numbers].concat();
    all.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// The values of a sample: of each of these nets, none where its bit of `has` is not set. Where
/// words are missing, so are the last values.
pub fn values_in(
    nets: &[Watched],
    has: u32,
    mut words: impl Iterator<Item = u32>,
) -> Vec<Option<Vec<Value>>> {
    let values = (0_u32..).zip(nets).map(|(place, watched)| {
        let holds = has.checked_shr(place).is_some_and(|bits| bits & 1 != 0);
        holds.then(|| {
            let mut word = None;
            let value = |field: &Field| {
                if field.shift == 0 {
                    word = words.next();
                }
                word.map(|word| field.value(word))
            };
            watched.fields.iter().map_while(value).collect()
        })
    });
    values.collect()
}

/// A value for a person: its fields with their units, numbers with three digits behind the point.
pub struct Text<'a> {
    /// What it is made of.
    pub fields: &'a [Field],
    /// Its fields.
    pub values: &'a [Value],
}

impl fmt::Display for Text<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut at = 0;
        while let Some(field) = self.fields.get(at) {
            let (label, unit) = field.label();
            if at > 0 {
                f.write_str("  ")?;
            }
            f.write_str(label)?;
            let row = self.row_from(at);
            for (place, value) in row.iter().enumerate() {
                if place > 0 || !label.is_empty() {
                    f.write_str(" ")?;
                }
                match value {
                    Value::F32(value) => write!(f, "{value:.3}")?,
                    value => write!(f, "{value}")?,
                }
            }
            if !unit.is_empty() {
                write!(f, " {unit}")?;
            }
            at += row.len().max(1);
        }
        Ok(())
    }
}

impl Text<'_> {
    /// The values of the fields from this one on that go by the same name: a row, which is named
    /// once.
    fn row_from(&self, at: usize) -> &[Value] {
        let fields = self.fields.get(at..).unwrap_or_default();
        let name = fields.first().map(|field| &field.name);
        let count = (fields.iter())
            .take_while(|other| Some(&other.name) == name)
            .count();
        self.values.get(at..at + count).unwrap_or_default()
    }
}

/// A value for a program: an object of its fields, in which a row is an array; of a value that is a
/// number itself, the number.
impl Serialize for Text<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if let ([field], [value]) = (self.fields, self.values)
            && field.name.is_empty()
        {
            return value.serialize(serializer);
        }
        let mut map = serializer.serialize_map(None)?;
        let mut at = 0;
        while let Some(field) = self.fields.get(at) {
            let row = self.row_from(at);
            match row {
                [value] => map.serialize_entry(&*field.name, value)?,
                values => map.serialize_entry(&*field.name, values)?,
            }
            at += row.len().max(1);
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(text: &str) -> Vec<Field> {
        fields_of(text).unwrap()
    }

    #[test]
    fn a_robot_that_tells_of_endless_rows_is_told_to_be_wrong() {
        for said in [
            "x:[u32;18446744073709551615]\n",
            "a:u8\nx:[u32;18446744073709551615]\n",
            "x:[u32;65537]\n",
            "x:[f32;65536]\ny:f32\n",
            "x:[u32;-1]\n",
        ] {
            assert_eq!(fields_of(said), None, "{said}");
        }
        let most = fields_of("x:[u32;65536]\n").unwrap();
        assert_eq!(most.len(), MAX_FIELDS);
        assert!(
            Arc::ptr_eq(&most[0].name, &most[MAX_FIELDS - 1].name),
            "no name is held twice"
        );
    }

    #[test]
    fn nets_go_by_the_ports_that_are_on_them_writers_first() {
        let source = "
            interpreter slot 1;
            slot 1 period 10 ms duration 1 ms;
            task Eye slot 1 { in data seen: u32 optional; out data scan: Scan; out data seen2: u32; }
            task Go slot 1 { in data scan: Scan; out data done: u32; }
            machine M {
                region a { task E: Eye; initial -> E; }
                region b { task G: Go; task H: Go; initial -> G; G -> H on pulse; }
                path E.scan -> G.scan, H.scan;
                path G.done, H.done -> E.seen;
            }";
        let checked = crate::lang::load_text("m.esm", source);
        assert!(!checked.has_errors(), "{:?}", checked.diagnostics);
        let blob = crate::compile::compile(&checked.model.unwrap(), &[0]).unwrap();
        let blob = esm_core::verify(blob).unwrap();
        let nets: Vec<_> = nets_of(&blob)
            .unwrap()
            .into_iter()
            .map(|net| (net.names.join(" "), net.type_name))
            .collect();
        let net = |names: &str, kind: &str| (names.to_owned(), kind.to_owned());
        assert!(
            nets.contains(&net("a/E.scan b/G.scan b/H.scan", "Scan")),
            "{nets:?}"
        );
        assert!(
            nets.contains(&net("b/G.done b/H.done a/E.seen", "u32")),
            "{nets:?}"
        );
    }

    #[test]
    fn values_are_told_with_their_units_and_rows_once() {
        use Value::{Bool, F32, I32, U32};
        type Case<'a> = (&'a str, &'a [Value], &'a str, &'a str);
        let cases: &[Case<'_>] = &[
            (
                "x_m:f32\nheading_rad:f32\n",
                &[F32(0.5), F32(-1.25)],
                "x 0.500 m  heading -1.250 rad",
                r#"{"x_m":0.5,"heading_rad":-1.25}"#,
            ),
            (
                "range_m:[f32;3]\n",
                &[F32(4.0), F32(1.0), F32(4.0)],
                "range 4.000 1.000 4.000 m",
                r#"{"range_m":[4.0,1.0,4.0]}"#,
            ),
            (
                "left_um:i16\ndark_sensors:u8\nlost:bool\n",
                &[I32(-3), U32(2), Bool(true)],
                "left -3 µm  dark_sensors 2  lost true",
                r#"{"left_um":-3,"dark_sensors":2,"lost":true}"#,
            ),
            (":u32\n", &[U32(7)], "7", "7"),
        ];
        for (said, values, text, json) in cases {
            let fields = fields(said);
            let told = Text {
                fields: &fields,
                values,
            };
            assert_eq!(told.to_string(), *text);
            assert_eq!(serde_json::to_string(&told).unwrap(), *json);
        }
        assert_eq!(fields_of("x_m f32\n"), None);
        assert_eq!(fields_of("x_m:f64\n"), None);
        assert_eq!(fields_of("x_m:[f32;N]\n"), None);
        assert_eq!(fields_of("x_m:[f32;99999999]\n"), None);
        assert_eq!(fields_of(""), Some(Vec::new()));
    }

    #[test]
    fn fields_are_written_as_they_are_read() {
        for text in [
            "",
            ":u32\n",
            "x_m:f32\ny_m:f32\nheading_rad:f32\n",
            "range_m:[f32;8]\nage_cs:[u8;8]\ndead:u32\n",
            "a:[i8;1]\nb:[i16;3]\nc:[u16;2]\nd:bool\ne:[bool;2]\n",
        ] {
            assert_eq!(text_of(&fields(text)), text);
        }
        // A number that is alone in its word is read the same, whatever its size was.
        assert_eq!(fields(&text_of(&fields("a:i8\n"))), fields("a:i8\n"));
    }

    #[test]
    fn ranges_are_told_in_metres_and_what_is_not_known_is_no_number() {
        for (text, value, expected_m) in [
            ("range_m:[f32;2]\n", Value::F32(1.5), Some(1.5)),
            ("range_m:[f32;2]\n", Value::F32(0.0), None),
            ("range_mm:[u16;24]\n", Value::U32(900), Some(0.9)),
            ("range_mm:[u16;24]\n", Value::U32(0), None),
            ("x_m:f32\n", Value::F32(1.5), None),
            ("range_m:[u8;2]\n", Value::U32(1), None),
        ] {
            let field = &fields(text)[0];
            let range_m = field.range_m(&value);
            assert_eq!(range_m.is_finite().then_some(range_m), expected_m, "{text}");
        }
        let shape = |text: &str| {
            let net = Net {
                index: 0,
                names: Vec::new(),
                type_name: "T".into(),
            };
            let fields = fields(text).into();
            Watched { net, fields }.shape()
        };
        assert_eq!(shape("dead:u32\nrange_m:[f32;8]\n"), Shape::Ranges);
        assert_eq!(shape("range_mm:[u16;24]\n"), Shape::Ranges);
        assert_eq!(shape("range_m:[u8;2]\n"), Shape::Other);
    }

    #[test]
    fn rows_of_small_integers_share_words() {
        let fields = fields("a:[u8;5]\nb:[i16;3]\nc:u8\n");
        assert_eq!((fields.len(), words_of(&fields)), (9, 5));
        let mut words = [0x0403_0201, 5, 0x0002_FFFF, 3, 7].into_iter();
        let mut word = 0;
        let values: Vec<Value> = (fields.iter())
            .map(|field| {
                if field.shift == 0 {
                    word = words.next().unwrap();
                }
                field.value(word)
            })
            .collect();
        let row = [1, 2, 3, 4, 5].map(Value::U32).into_iter();
        let signed = [-1, 2, 3].map(Value::I32);
        let expected: Vec<Value> = row.chain(signed).chain([Value::U32(7)]).collect();
        assert_eq!(values, expected);
    }
}
