//! Files and places in them.

use std::path::PathBuf;

use crate::model::{SourceFile, Span};

/// Why the file that was asked for could not be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The operating system did not let us.
    #[error("cannot read `{path}`: {cause}", path = path.display())]
    Read {
        /// The file as it was named.
        path: PathBuf,
        /// What the system said.
        #[source]
        cause: std::io::Error,
    },
    /// A directory, a device, a pipe.
    #[error("`{path}` is not a file: name an `.esm` file", path = path.display())]
    NotAFile {
        /// The file as it was named.
        path: PathBuf,
    },
    /// Longer than a source file may be.
    #[error("`{path}` has {bytes} bytes, a source file has at most {MAX_FILE_BYTES}", path = path.display())]
    TooLong {
        /// The file as it was named.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
}

/// The longest file that is read. Generated files of 100,000 states have a tenth of it.
pub const MAX_FILE_BYTES: u64 = 64 << 20;

/// A place for people: line and column count from 1, columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Position {
    /// Index of the file in its set.
    pub file: u32,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub col: u32,
}

/// Turns byte offsets of a set of files into lines and columns. Making it reads each file once; a
/// query costs a binary search.
#[derive(Clone, Debug)]
pub struct Positions<'f> {
    files: &'f [SourceFile],
    lines: Vec<LineIndex>,
}

impl<'f> Positions<'f> {
    /// Reads the files' line breaks.
    pub fn new(files: &'f [SourceFile]) -> Self {
        Positions {
            files,
            lines: files
                .iter()
                .map(|file| LineIndex::new(&file.text))
                .collect(),
        }
    }

    /// Where the span starts. A span of no file of the set is placed at the start of its file.
    pub fn of(&self, span: Span) -> Position {
        let (line, col) = match (
            self.files.get(span.file as usize),
            self.lines.get(span.file as usize),
        ) {
            (Some(file), Some(lines)) => lines.line_and_col(&file.text, span.start as usize),
            _ => (1, 1),
        };
        Position {
            file: span.file,
            line,
            col,
        }
    }

    /// Path of the file in which the span lies, as people would write it.
    pub fn path(&self, span: Span) -> &'f str {
        self.files
            .get(span.file as usize)
            .map_or("", |file| file.path.as_str())
    }
}

/// How many bytes lie between two counts of characters: a column in a line of megabytes costs no
/// more to find than in a short one.
const BLOCK_BYTES: usize = 256;

/// Line starts of one text, and how many characters stand before each block of it.
#[derive(Clone, Debug)]
struct LineIndex {
    /// Byte offset at which each line starts.
    starts: Vec<u32>,
    /// Characters that start before byte `i * BLOCK_BYTES`.
    characters_before: Vec<u32>,
}

impl LineIndex {
    fn new(text: &str) -> Self {
        let mut starts = vec![0];
        let mut characters_before = Vec::with_capacity(text.len() / BLOCK_BYTES + 1);
        let mut characters = 0;
        for (offset, byte) in text.bytes().enumerate() {
            if offset % BLOCK_BYTES == 0 {
                characters_before.push(characters);
            }
            characters += u32::from(starts_character(byte));
            if byte == b'\n' {
                starts.push(offset as u32 + 1);
            }
        }
        LineIndex {
            starts,
            characters_before,
        }
    }

    /// Line and column of a byte offset; an offset beyond the end is the end.
    fn line_and_col(&self, text: &str, offset: usize) -> (u32, u32) {
        let offset = offset.min(text.len());
        // The first line starts at 0, so at least one start is not above any offset.
        let line = self
            .starts
            .partition_point(|&start| start as usize <= offset);
        let start = self
            .starts
            .get(line.saturating_sub(1))
            .map_or(0, |&start| start as usize);
        let col = self.characters(text, offset) - self.characters(text, start) + 1;
        (line as u32, col)
    }

    /// How many characters start before `offset`, which is at most the length of the text.
    fn characters(&self, text: &str, offset: usize) -> u32 {
        let block = (offset / BLOCK_BYTES).min(self.characters_before.len().saturating_sub(1));
        let before = self.characters_before.get(block).copied().unwrap_or(0);
        let rest = text
            .as_bytes()
            .get(block * BLOCK_BYTES..offset)
            .unwrap_or(&[]);
        before + rest.iter().filter(|&&byte| starts_character(byte)).count() as u32
    }
}

/// Whether a byte of UTF-8 is the first one of its character.
fn starts_character(byte: u8) -> bool {
    byte & 0xC0 != 0x80
}
