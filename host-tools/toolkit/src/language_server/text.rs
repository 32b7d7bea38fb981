//! Texts with lines: places as editors count them, and edits.

use lsp_types::{Position, Range};

/// In what an editor counts along a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Bytes.
    Utf8,
    /// Units of 16 bits: what an editor uses that says nothing else.
    Utf16,
    /// Characters.
    Utf32,
}

impl Encoding {
    /// How many units start with a byte.
    fn units(self, byte: u8) -> u32 {
        let starts_character = byte & 0xC0 != 0x80;
        match self {
            Encoding::Utf8 => 1,
            Encoding::Utf16 => u32::from(starts_character) + u32::from(byte >= 0xF0),
            Encoding::Utf32 => u32::from(starts_character),
        }
    }
}

/// How many bytes lie between two counts of units: a place in a line of megabytes costs no more
/// than in a short one.
const BLOCK_BYTES: usize = 256;

/// A text that knows where its lines start.
#[derive(Clone, Debug)]
pub(super) struct Text {
    text: String,
    encoding: Encoding,
    /// Byte at which each line starts.
    starts: Vec<usize>,
    /// Units before byte `i * BLOCK_BYTES`.
    units_before: Vec<u32>,
}

impl Text {
    pub(super) fn new(text: String, encoding: Encoding) -> Self {
        let bytes = text.as_bytes();
        let mut starts = vec![0];
        let mut units_before = Vec::with_capacity(bytes.len() / BLOCK_BYTES + 1);
        let mut units = 0;
        for (at, &byte) in bytes.iter().enumerate() {
            if at % BLOCK_BYTES == 0 {
                units_before.push(units);
            }
            units += encoding.units(byte);
            // For editors a carriage return alone ends a line too.
            if byte == b'\n' || byte == b'\r' && bytes.get(at + 1) != Some(&b'\n') {
                starts.push(at + 1);
            }
        }
        Text {
            text,
            encoding,
            starts,
            units_before,
        }
    }

    pub(super) fn as_str(&self) -> &str {
        &self.text
    }

    /// The place of a byte; one beyond the end is the end.
    pub(super) fn position(&self, offset: usize) -> Position {
        let offset = self.floor(offset.min(self.text.len()));
        let line = self.starts.partition_point(|&start| start <= offset) - 1;
        let start = self.starts.get(line).copied().unwrap_or(0);
        Position {
            line: line as u32,
            character: self.units(offset) - self.units(start),
        }
    }

    pub(super) fn range(&self, start: u32, end: u32) -> Range {
        Range {
            start: self.position(start as usize),
            end: self.position(end.max(start) as usize),
        }
    }

    /// The byte at a place; one beyond the end of its line is that end.
    pub(super) fn offset(&self, position: Position) -> usize {
        let line = position.line as usize;
        let Some(&start) = self.starts.get(line) else {
            return self.text.len();
        };
        let next = self
            .starts
            .get(line + 1)
            .copied()
            .unwrap_or(self.text.len());
        let content = self.text.get(start..next).unwrap_or("");
        let end = start + content.trim_end_matches(['\r', '\n']).len();
        let wanted = self.units(start).saturating_add(position.character);
        let block = self
            .units_before
            .partition_point(|&units| units <= wanted)
            .saturating_sub(1);
        let mut at = (block * BLOCK_BYTES).clamp(start, end);
        let mut units = self.units(at);
        for &byte in self.text.as_bytes().get(at..end).unwrap_or(&[]) {
            let unit = self.encoding.units(byte);
            if unit > 0 && units + unit > wanted {
                break;
            }
            units += unit;
            at += 1;
        }
        self.floor(at)
    }

    /// The text with a part replaced.
    pub(super) fn edited(&self, range: Range, new: &str) -> String {
        let (start, end) = (self.offset(range.start), self.offset(range.end));
        let (start, end) = (start.min(end), start.max(end));
        let (before, behind) = (self.text.get(..start), self.text.get(end..));
        [before.unwrap_or(""), new, behind.unwrap_or("")].concat()
    }

    /// The nearest start of a character, not above `at`.
    fn floor(&self, at: usize) -> usize {
        (0..=at)
            .rev()
            .find(|&at| self.text.is_char_boundary(at))
            .unwrap_or(0)
    }

    fn units(&self, offset: usize) -> u32 {
        let block = (offset / BLOCK_BYTES).min(self.units_before.len().saturating_sub(1));
        let before = self.units_before.get(block).copied().unwrap_or(0);
        let rest = self.text.as_bytes().get(block * BLOCK_BYTES..offset);
        let rest = rest.unwrap_or(&[]).iter();
        before + rest.map(|&byte| self.encoding.units(byte)).sum::<u32>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn places_are_counted_as_was_agreed() {
        let text = "a\r\nä😀b\n\rc";
        let cases = [
            (Encoding::Utf8, 0, (0, 0)),
            (Encoding::Utf16, 3, (1, 0)),
            (Encoding::Utf8, 9, (1, 6)),
            (Encoding::Utf16, 9, (1, 3)),
            (Encoding::Utf32, 9, (1, 2)),
            (Encoding::Utf16, 11, (2, 0)),
            (Encoding::Utf16, 12, (3, 0)),
            (Encoding::Utf16, 99, (3, 1)),
        ];
        for (encoding, offset, (line, character)) in cases {
            let text = Text::new(text.to_owned(), encoding);
            assert_eq!(
                text.position(offset),
                Position { line, character },
                "{encoding:?} {offset}"
            );
        }
        let text = Text::new(text.to_owned(), Encoding::Utf16);
        for ((line, character), offset) in [((0, 9), 1), ((1, 2), 5), ((1, 99), 10), ((9, 0), 13)] {
            assert_eq!(text.offset(Position { line, character }), offset);
        }
    }

    proptest! {
        #[test]
        fn a_place_leads_back_to_its_byte(
            text in "([aä😀€\n]|\r\n){0,400}",
            encoding in prop_oneof![Just(Encoding::Utf8), Just(Encoding::Utf16), Just(Encoding::Utf32)],
        ) {
            let lines = Text::new(text.clone(), encoding);
            for (offset, character) in text.char_indices() {
                // Nothing stands between the two ends of one line end.
                if character != '\n' || !text[..offset].ends_with('\r') {
                    prop_assert_eq!(lines.offset(lines.position(offset)), offset);
                }
            }
        }
    }
}
