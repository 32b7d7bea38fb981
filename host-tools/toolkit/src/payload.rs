//! Values of data ports as the payloads of frames, for programs and people: what their fields are
//! is known from what a robot says of a type.

use serde_json::{Map, Value};
use thiserror::Error;

/// What an item of a field is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Item {
    Bool,
    I8,
    I16,
    I32,
    U8,
    U16,
    U32,
    F32,
}

impl Item {
    fn of(word: &str) -> Option<Self> {
        Some(match word {
            "bool" => Item::Bool,
            "i8" => Item::I8,
            "i16" => Item::I16,
            "i32" => Item::I32,
            "u8" => Item::U8,
            "u16" => Item::U16,
            "u32" => Item::U32,
            "f32" => Item::F32,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Item::Bool | Item::I8 | Item::U8 => 1,
            Item::I16 | Item::U16 => 2,
            Item::I32 | Item::U32 | Item::F32 => 4,
        }
    }

    /// Writes what a word says. None where it says no such value.
    fn write(self, word: &str, to: &mut Vec<u8>) -> Option<()> {
        match self {
            Item::Bool => to.push(u8::from(word.parse::<bool>().ok()?)),
            Item::I8 => to.extend(word.parse::<i8>().ok()?.to_le_bytes()),
            Item::I16 => to.extend(word.parse::<i16>().ok()?.to_le_bytes()),
            Item::I32 => to.extend(word.parse::<i32>().ok()?.to_le_bytes()),
            Item::U8 => to.extend(word.parse::<u8>().ok()?.to_le_bytes()),
            Item::U16 => to.extend(word.parse::<u16>().ok()?.to_le_bytes()),
            Item::U32 => to.extend(word.parse::<u32>().ok()?.to_le_bytes()),
            Item::F32 => to.extend(word.parse::<f32>().ok()?.to_le_bytes()),
        }
        Some(())
    }

    /// The value in so many bytes as it has. A number that is not finite is none.
    fn read(self, bytes: &[u8]) -> Value {
        let mut word = [0; 4];
        for (to, from) in word.iter_mut().zip(bytes) {
            *to = *from;
        }
        let [low, second, ..] = word;
        match self {
            Item::Bool => (low != 0).into(),
            Item::I8 => low.cast_signed().into(),
            Item::I16 => i16::from_le_bytes([low, second]).into(),
            Item::I32 => i32::from_le_bytes(word).into(),
            Item::U8 => low.into(),
            Item::U16 => u16::from_le_bytes([low, second]).into(),
            Item::U32 => u32::from_le_bytes(word).into(),
            Item::F32 => f32::from_le_bytes(word).into(),
        }
    }
}

/// A field of a value.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Field {
    /// Its name; empty where the value is a number itself.
    name: String,
    item: Item,
    /// How many items; none where it is no row.
    row: Option<usize>,
}

/// What the values of a type are made of.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Layout(Vec<Field>);

/// Why words are no value.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ValueError {
    /// There are more or fewer.
    #[error("{needed} values are needed, one behind the other ({fields}), and {found} are there")]
    Count {
        /// Of the type.
        needed: usize,
        /// That were given.
        found: usize,
        /// Names of the fields.
        fields: String,
    },
    /// One of them is another kind of value.
    #[error("`{word}` is no value of {field}")]
    Word {
        /// What was given.
        word: String,
        /// What was wanted.
        field: String,
    },
}

impl Layout {
    /// Reads what a robot says of a type: a line a field. None where that says something else.
    #[must_use]
    pub fn of(text: &str) -> Option<Self> {
        let field = |line: &str| {
            let (name, kind) = line.split_once(':')?;
            let row = kind.strip_prefix('[').and_then(|row| {
                let (item, count) = row.strip_suffix(']')?.split_once(';')?;
                Some((item, count.parse::<usize>().ok()?))
            });
            let (item, row) = match row {
                Some((item, count)) => (item, Some(count)),
                None => (kind, None),
            };
            Some(Field {
                name: name.to_owned(),
                item: Item::of(item)?,
                row,
            })
        };
        text.lines()
            .map(field)
            .collect::<Option<Vec<_>>>()
            .map(Layout)
    }

    /// Length of a payload.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let fields = self.0.iter();
        fields
            .map(|field| field.item.bytes() * field.row.unwrap_or(1))
            .sum()
    }

    /// The payload of the value that these words say: its items in their order.
    ///
    /// # Errors
    /// [`ValueError`]
    pub fn encode(&self, words: &str) -> Result<Vec<u8>, ValueError> {
        let words: Vec<&str> = words.split_whitespace().collect();
        let needed = self.0.iter().map(|field| field.row.unwrap_or(1)).sum();
        if words.len() != needed {
            let names = self.0.iter().map(|field| match field.row {
                Some(count) => format!("{count} of {}", field.name),
                None => field.name.clone(),
            });
            return Err(ValueError::Count {
                needed,
                found: words.len(),
                fields: names.collect::<Vec<_>>().join(", "),
            });
        }
        let mut words = words.into_iter();
        let mut payload = Vec::new();
        for field in &self.0 {
            for word in words.by_ref().take(field.row.unwrap_or(1)) {
                let written = field.item.write(word, &mut payload);
                written.ok_or_else(|| ValueError::Word {
                    word: word.to_owned(),
                    field: format!("{} ({:?})", field.name, field.item).to_lowercase(),
                })?;
            }
        }
        Ok(payload)
    }

    /// The value of a payload: an object with its fields, or the number that it is itself.
    #[must_use]
    pub fn decode(&self, payload: &[u8]) -> Value {
        let mut rest = payload;
        let mut next = |item: Item| {
            let (own, behind) = rest.split_at(item.bytes().min(rest.len()));
            rest = behind;
            item.read(own)
        };
        let mut object = Map::new();
        for field in &self.0 {
            let value = match field.row {
                Some(count) => (0..count).map(|_| next(field.item)).collect(),
                None => next(field.item),
            };
            if field.name.is_empty() {
                return value;
            }
            object.insert(field.name.clone(), value);
        }
        Value::Object(object)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_value_is_its_items_one_behind_the_other() {
        let layout = Layout::of("is_on:bool\nrange_m:[f32;2]\nhits:u16\nangle:[i8;3]").unwrap();
        assert_eq!(layout.bytes(), 1 + 8 + 2 + 3);
        let payload = layout.encode("true 1.5 -2 513 -1 2 3").unwrap();
        let expected = [1, 0, 0, 0xC0, 0x3F, 0, 0, 0, 0xC0, 1, 2, 0xFF, 2, 3];
        assert_eq!(payload, expected);
        let value =
            json!({"is_on": true, "range_m": [1.5, -2.0], "hits": 513, "angle": [-1, 2, 3]});
        assert_eq!(layout.decode(&payload), value);
        for (words, told) in [
            ("true 1.5", "7 values are needed"),
            ("true 1.5 -2 70000 -1 2 3", "`70000` is no value of hits"),
            ("1 1.5 -2 7 -1 2 3", "`1` is no value of is_on"),
        ] {
            let wrong = layout.encode(words).unwrap_err().to_string();
            assert!(wrong.contains(told), "{wrong}");
        }
        let number = Layout::of(":f32").unwrap();
        assert_eq!(number.decode(&number.encode("0.25").unwrap()), json!(0.25));
        assert_eq!(number.decode(&f32::NAN.to_le_bytes()), Value::Null);
        for wrong in ["x", "x:f64", "x:[f32;many]", "x:[f32]"] {
            assert_eq!(Layout::of(wrong), None, "{wrong}");
        }
    }
}
