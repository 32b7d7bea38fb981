//! Frames of a firmware's log, looked at before they are decoded.
//!
//! A frame may name any text of the firmware, and texts may stand in texts: `defmt-decoder` makes
//! room for as many elements as a frame says there are, and goes as deep as it says. It is meant
//! for frames of one's own firmware. What comes over a line may be anybody's, so that each frame is
//! walked through here in the same way, with nothing kept, and only one that is no larger than it
//! is long gets any further.

use std::collections::HashMap;

use defmt_parser::{Fragment, Parameter, ParserMode, Type, get_max_bitfield_range, parse};
use object::{File, Object, ObjectSection, ObjectSymbol};
use serde::Deserialize;

/// How deep texts may stand in texts.
const MAX_DEPTH: u32 = 32;

/// The texts of a firmware, by the numbers that frames name them by.
pub(super) struct Texts {
    texts: HashMap<u16, String>,
    /// What stands in front of each line.
    timestamp: Option<String>,
}

/// What the name of a symbol says, as far as it matters here.
#[derive(Deserialize)]
struct Symbol {
    tag: String,
    data: String,
}

impl Texts {
    /// Those of the firmware in an ELF file. None where it is no such file.
    pub(super) fn of(elf: &[u8]) -> Option<Self> {
        let elf = File::parse(elf).ok()?;
        let holds_texts = |name: &str| name == ".defmt" || name.starts_with(".defmt.");
        let mut texts = Texts {
            texts: HashMap::new(),
            timestamp: None,
        };
        for symbol in elf.symbols() {
            let section = symbol.section_index();
            let section = section.and_then(|index| elf.section_by_index(index).ok());
            if !section.is_some_and(|section| section.name().is_ok_and(holds_texts)) {
                continue;
            }
            // Those that are no JSON are marks of the linker.
            let name = symbol.name().unwrap_or_default();
            let Ok(Symbol { tag, data }) = serde_json::from_str(name) else {
                continue;
            };
            if tag == "defmt_timestamp" {
                texts.timestamp = Some(data);
            } else if let Ok(number) = u16::try_from(symbol.address()) {
                texts.texts.insert(number, data);
            }
        }
        Some(texts)
    }

    /// Whether a frame, without its end, can be decoded with no more than it brings.
    pub(super) fn admit(&self, frame: &[u8]) -> bool {
        let Some(bytes) = unpacked(frame) else {
            return false;
        };
        let mut walk = Walk {
            texts: self,
            elements_left: bytes.len(),
            rest: &bytes,
        };
        walk.frame().is_some()
    }
}

/// A frame's bytes without their encoding, which is reverse zero-compressing COBS: it is read from
/// its end.
fn unpacked(frame: &[u8]) -> Option<Vec<u8>> {
    const RUN: u8 = 7;
    const LONGEST_RUN: usize = 134;
    let mut bytes = Vec::new();
    let mut packed = frame.iter().rev().copied();
    while let Some(code) = packed.next() {
        match code {
            0 => return None,
            // Seven bytes, of which those with a bit are zero.
            0x01..=0x7f => {
                for bit in (0..RUN).rev() {
                    bytes.push(match code & 1 << bit {
                        0 => packed.next()?,
                        _ => 0,
                    });
                }
            }
            // A zero, and a run behind it.
            0x80..=0xfe => {
                bytes.push(0);
                for _ in 0..(code & 0x7f) + RUN {
                    bytes.push(packed.next()?);
                }
            }
            0xff => {
                for _ in 0..LONGEST_RUN {
                    bytes.push(packed.next()?);
                }
            }
        }
    }
    bytes.reverse();
    Some(bytes)
}

/// The way through a frame.
struct Walk<'w> {
    texts: &'w Texts,
    rest: &'w [u8],
    /// Elements of lists that may still come: none is shorter than nothing, and a list of nothings
    /// has no end.
    elements_left: usize,
}

impl<'w> Walk<'w> {
    fn bytes(&mut self, count: usize) -> Option<&'w [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn number<const BYTES: usize>(&mut self) -> Option<[u8; BYTES]> {
        self.bytes(BYTES)?.try_into().ok()
    }

    fn count(&mut self) -> Option<usize> {
        self.number()
            .map(|bytes| u32::from_le_bytes(bytes) as usize)
    }

    fn text(&mut self) -> Option<&'w str> {
        let number = u16::from_le_bytes(self.number()?);
        self.texts.texts.get(&number).map(String::as_str)
    }

    fn frame(&mut self) -> Option<()> {
        let line = self.text()?;
        if let Some(timestamp) = &self.texts.timestamp {
            self.arguments(timestamp, 0)?;
        }
        self.arguments(line, 0)
    }

    /// Passes over the arguments of a text.
    fn arguments(&mut self, text: &str, depth: u32) -> Option<()> {
        if depth > MAX_DEPTH {
            return None;
        }
        for parameter in parameters(text)? {
            self.argument(&parameter.ty, depth)?;
        }
        Some(())
    }

    fn argument(&mut self, kind: &Type, depth: u32) -> Option<()> {
        let fixed = match kind {
            Type::Bool | Type::I8 | Type::U8 => 1,
            Type::I16 | Type::U16 | Type::IStr => 2,
            Type::I32 | Type::U32 | Type::Isize | Type::Usize | Type::F32 | Type::Char => 4,
            Type::I64 | Type::U64 | Type::F64 => 8,
            Type::I128 | Type::U128 => 16,
            Type::U8Array(count) => *count,
            Type::BitField(bits) => {
                let bytes = bits.end.checked_sub(1)? / 8 - bits.start / 8 + 1;
                usize::from(bytes).next_power_of_two()
            }
            Type::Str | Type::U8Slice => self.count()?,
            Type::Debug | Type::Display => {
                const END: u8 = 0xff;
                self.rest.iter().position(|byte| *byte == END)? + 1
            }
            Type::Format => {
                let text = self.text()?;
                let text = self.variant(text)?;
                self.arguments(text, depth + 1)?;
                0
            }
            Type::FormatArray(count) => {
                self.elements(*count, depth)?;
                0
            }
            Type::FormatSlice => {
                let count = self.count()?;
                self.elements(count, depth)?;
                0
            }
            Type::FormatSequence => {
                while let [_, _, ..] = self.rest {
                    if self.rest.starts_with(&[0, 0]) {
                        break;
                    }
                    let text = self.text()?;
                    self.arguments(text, depth + 1)?;
                }
                2
            }
        };
        self.bytes(fixed).map(drop)
    }

    /// Of texts for the variants of an enum, the one that is meant.
    fn variant(&mut self, text: &'w str) -> Option<&'w str> {
        const SEPARATOR: char = '|';
        let place = match text.matches(SEPARATOR).count() {
            0 => return Some(text),
            count if count <= u8::MAX.into() => u8::from_le_bytes(self.number()?).into(),
            _ => u16::from_le_bytes(self.number()?).into(),
        };
        text.split(SEPARATOR).nth(place)
    }

    fn elements(&mut self, count: usize, depth: u32) -> Option<()> {
        let text = self.text()?;
        self.elements_left = self.elements_left.checked_sub(count)?;
        for _ in 0..count {
            let text = self.variant(text)?;
            self.arguments(text, depth + 1)?;
        }
        Some(())
    }
}

/// The parameters of a text in the order in which their arguments come: by their numbers, each
/// once, with all bits that are shown of a number in one.
fn parameters(text: &str) -> Option<Vec<Parameter>> {
    let fragments = parse(text, ParserMode::ForwardsCompatible).ok()?;
    let all = fragments.into_iter().filter_map(|fragment| match fragment {
        Fragment::Parameter(parameter) => Some(parameter),
        Fragment::Literal(_) => None,
    });
    let (bits, mut all): (Vec<_>, Vec<_>) =
        all.partition(|parameter| matches!(parameter.ty, Type::BitField(_)));
    for (place, parameter) in bits.iter().enumerate() {
        let of_same = |other: &&Parameter| other.index == parameter.index;
        if !bits.iter().take(place).any(|other| of_same(&other)) {
            let (start, end) = get_max_bitfield_range(bits.iter().filter(of_same))?;
            all.push(Parameter {
                ty: Type::BitField(start..end),
                ..parameter.clone()
            });
        }
    }
    all.sort_by_key(|parameter| parameter.index);
    all.dedup_by_key(|parameter| parameter.index);
    Some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(texts: &[&str]) -> Texts {
        let numbered = (1..)
            .zip(texts)
            .map(|(number, text)| (number, (*text).to_owned()));
        Texts {
            texts: numbered.collect(),
            timestamp: Some("{=u8}".to_owned()),
        }
    }

    /// Bytes in their encoding, in runs of seven where none is zero.
    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut packed = Vec::new();
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(7), 0);
        for run in bytes.chunks(7) {
            let mut code = 0;
            for (place, byte) in run.iter().enumerate() {
                match byte {
                    0 => code |= 1 << place,
                    byte => packed.push(*byte),
                }
            }
            // One whose bytes are all there has no code of its own.
            assert_ne!(code, 0, "the tests' frames have zeros");
            packed.push(code);
        }
        packed
    }

    #[test]
    fn frames_are_admitted_as_far_as_they_bring_what_they_say() {
        // The texts have the numbers 1 to 6, two bytes each; a timestamp of one byte follows.
        let texts = texts(&[
            "{=u32} {=[?]}",
            "{=?}",
            "A|B({=u8})",
            "x",
            "{0=0..4} {0=4..12}",
            "{=str}",
        ]);
        for (what, bytes, expected) in [
            ("a plain line", &[4, 0, 9][..], true),
            ("no such text", &[40, 0, 9], false),
            (
                "two elements",
                &[1, 0, 9, 1, 2, 3, 4, 2, 0, 0, 0, 3, 0, 0, 1, 7],
                true,
            ),
            (
                "four thousand million",
                &[1, 0, 9, 1, 2, 3, 4, 255, 255, 255, 255, 4, 0],
                false,
            ),
            (
                "a hundred nothings",
                &[1, 0, 9, 1, 2, 3, 4, 100, 0, 0, 0, 4, 0],
                false,
            ),
            ("no such variant", &[2, 0, 9, 3, 0, 2], false),
            ("a text in a text", &[2, 0, 9, 2, 0, 4, 0], true),
            ("bits of one number", &[5, 0, 9, 1, 1], true),
            ("a string", &[6, 0, 9, 2, 0, 0, 0, b'a', b'b'], true),
            (
                "a string without end",
                &[6, 0, 9, 200, 0, 0, 0, b'a', b'b'],
                false,
            ),
        ] {
            assert_eq!(texts.admit(&packed(bytes)), expected, "{what}");
        }
        let deep = [&[2, 0, 9][..], &[2, 0].repeat(3_000), &[4, 0]].concat();
        assert!(
            !texts.admit(&packed(&deep)),
            "three thousand texts in each other"
        );
        assert!(!texts.admit(&[0x81]) && !texts.admit(&[]), "no frame");
    }
}
