//! A trace that is compared with an expected one, line by line as it comes, in memory that does not
//! grow with them.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use anyhow::Context;

use super::console::Console;
use super::difference;
use super::exit::CommandError;
use crate::clean::counted;
use crate::files;

/// How much is read of an expected line that is longer than the one that came.
const KEPT_BYTES: u64 = 64 << 10;

/// What is expected, and how far it is what came.
pub struct Expected<R> {
    source: R,
    /// Lines that came, and were as expected.
    lines: u64,
    /// What came of a line that has not ended.
    begun: Vec<u8>,
    /// What is expected in place of it; kept for its memory.
    line: Vec<u8>,
    /// What ended the comparison before the trace did.
    ended: Option<Result<Difference, io::Error>>,
}

/// Where two traces differ first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// In a line that both have.
    Line {
        /// Its number, from 1.
        number: u64,
        /// What was expected.
        expected: Vec<u8>,
        /// What came.
        found: Vec<u8>,
    },
    /// What is expected is shorter than what came.
    ExpectedEnds {
        /// Lines that both have.
        lines: u64,
        /// The line that came then.
        found: Vec<u8>,
    },
    /// What came is shorter than what is expected.
    FoundEnds {
        /// Lines that both have.
        lines: u64,
        /// The line that is expected then.
        expected: Vec<u8>,
    },
}

impl Difference {
    /// In words, for a person who has this file to compare with.
    pub fn told(&self, file: &Path) -> String {
        let file = file.display();
        let text = |line: &[u8]| String::from_utf8_lossy(line).into_owned();
        let of_lines = |expected: &[u8], found: &[u8]| {
            let lines = difference::of_lines(&text(expected), &text(found));
            lines.trim_end().to_owned()
        };
        match self {
            Difference::Line {
                number,
                expected,
                found,
            } => format!(
                "the replay is not what {file} says, first in line {number} (- there, + in the replay):\n{}",
                of_lines(expected, found)
            ),
            Difference::ExpectedEnds { lines, found } => format!(
                "the replay is longer than {file}, which has {}; then comes:\n{}",
                counted(*lines, "line"),
                of_lines(b"", found)
            ),
            Difference::FoundEnds { lines, expected } => format!(
                "the replay is shorter than {file}: it has {}; then would come:\n{}",
                counted(*lines, "line"),
                of_lines(expected, b"")
            ),
        }
    }
}

impl Expected<BufReader<File>> {
    /// Opens a trace to compare with.
    ///
    /// # Errors
    /// If it cannot be read: then the input has an error.
    pub fn open(path: &Path) -> Result<Self, CommandError> {
        let opened = files::open(path)
            .map(BufReader::new)
            .and_then(|mut source| {
                // A folder can be opened, and says so when it is read.
                source.fill_buf()?;
                Ok(source)
            });
        opened
            .map(Self::of)
            .with_context(|| unread(path))
            .map_err(CommandError::Input)
    }
}

/// Ends a comparison with this trace, and says where it differs first.
///
/// # Errors
/// [`CommandError::Told`] if it does; or the trace cannot be read to its end.
pub fn judge(
    expected: Expected<BufReader<File>>,
    path: &Path,
    console: &mut Console,
) -> Result<(), CommandError> {
    let compared = expected.finish().with_context(|| unread(path));
    match compared.map_err(CommandError::Input)? {
        Some(difference) => {
            console.note(&difference.told(path));
            Err(CommandError::Told)
        }
        None => Ok(()),
    }
}

/// What is said of a trace that cannot be read.
fn unread(path: &Path) -> String {
    format!("cannot read the trace {}", path.display())
}

impl<R: BufRead> Expected<R> {
    fn of(source: R) -> Self {
        Expected {
            source,
            lines: 0,
            begun: Vec::new(),
            line: Vec::new(),
            ended: None,
        }
    }

    /// Takes what came.
    pub fn take(&mut self, bytes: &[u8]) {
        for part in bytes.split_inclusive(|byte| *byte == b'\n') {
            if self.ended.is_some() {
                return;
            }
            self.begun.extend_from_slice(part);
            if part.ends_with(b"\n") {
                self.compare();
            }
        }
    }

    /// Where they differ first, if they do, at the end of what came.
    ///
    /// # Errors
    /// What the system says if the expected trace cannot be read to its end.
    pub fn finish(mut self) -> io::Result<Option<Difference>> {
        if self.ended.is_none() && !self.begun.is_empty() {
            self.compare();
        }
        if let Some(ended) = self.ended {
            return ended.map(Some);
        }
        self.line.clear();
        self.read(KEPT_BYTES)?;
        Ok((!self.line.is_empty()).then_some(Difference::FoundEnds {
            lines: self.lines,
            expected: self.line,
        }))
    }

    /// Compares a line that came whole with the next one that is expected.
    fn compare(&mut self) {
        self.line.clear();
        match self.differs() {
            Ok(false) => {
                self.lines += 1;
                self.begun.clear();
            }
            Ok(true) => {
                let found = std::mem::take(&mut self.begun);
                let expected = std::mem::take(&mut self.line);
                let lines = self.lines;
                self.ended = Some(Ok(match expected.is_empty() {
                    true => Difference::ExpectedEnds { lines, found },
                    false => Difference::Line {
                        number: lines + 1,
                        expected,
                        found,
                    },
                }));
            }
            Err(error) => self.ended = Some(Err(error)),
        }
    }

    fn differs(&mut self) -> io::Result<bool> {
        // No more than it takes to see whether they are equal.
        self.read(self.begun.len() as u64)?;
        if self.line == self.begun {
            return Ok(false);
        }
        if !self.line.ends_with(b"\n") {
            self.read(KEPT_BYTES)?;
        }
        Ok(true)
    }

    /// Reads on in what is expected, to the end of the line, at most so much.
    fn read(&mut self, most: u64) -> io::Result<()> {
        let mut source = (&mut self.source).take(most);
        source.read_until(b'\n', &mut self.line).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn difference(expected: &str, found: &str) -> Option<Difference> {
        // In parts of every length, as it may come.
        let all: Vec<_> = (1..=found.len().max(1))
            .map(|length| {
                let mut trace = Expected::of(expected.as_bytes());
                for part in found.as_bytes().chunks(length) {
                    trace.take(part);
                }
                trace.finish().unwrap()
            })
            .collect();
        assert!(all.iter().all(|it| *it == all[0]), "{all:?}");
        all.into_iter().next().flatten()
    }

    #[test]
    fn where_traces_differ_first() {
        let line = |number, expected: &str, found: &str| Difference::Line {
            number,
            expected: expected.into(),
            found: found.into(),
        };
        let longer = |lines, found: &str| Difference::ExpectedEnds {
            lines,
            found: found.into(),
        };
        let shorter = |lines, expected: &str| Difference::FoundEnds {
            lines,
            expected: expected.into(),
        };
        for (expected, found, differ) in [
            ("", "", None),
            ("a\nb\n", "a\nb\n", None),
            ("a\nb\n", "a\nc\n", Some(line(2, "b\n", "c\n"))),
            ("a\nb\nc\n", "a\nc\n", Some(line(2, "b\n", "c\n"))),
            ("a\n", "ab\n", Some(line(1, "a\n", "ab\n"))),
            ("ab\nc\n", "a\nc\n", Some(line(1, "ab\n", "a\n"))),
            ("a\nb\n", "a\n", Some(shorter(1, "b\n"))),
            ("a\n", "", Some(shorter(0, "a\n"))),
            ("a\n", "a\nb\nc\n", Some(longer(1, "b\n"))),
            ("", "a\n", Some(longer(0, "a\n"))),
            ("a", "a\n", Some(line(1, "a", "a\n"))),
        ] {
            assert_eq!(
                difference(expected, found),
                differ,
                "{expected:?} {found:?}"
            );
        }
    }

    #[test]
    fn an_expected_trace_of_any_length_takes_little_memory() {
        let line = b"{\"kind\":\"step\"}\n";
        let endless = std::iter::repeat_with(|| io::Cursor::new(*line));
        // Lines without an end, of which so many are asked for.
        struct Lines<I>(I, io::Cursor<[u8; 16]>);
        impl<I: Iterator<Item = io::Cursor<[u8; 16]>>> Read for Lines<I> {
            fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
                match self.1.read(bytes)? {
                    0 => {
                        self.1 = self.0.next().unwrap();
                        self.1.read(bytes)
                    }
                    length => Ok(length),
                }
            }
        }
        let mut trace = Expected::of(BufReader::new(Lines(endless, io::Cursor::new(*line))));
        for _ in 0..100_000 {
            trace.take(line);
        }
        assert_eq!(trace.lines, 100_000);
        assert!(trace.begun.capacity() + trace.line.capacity() <= 1 << 10);
        // A line that never ends.
        let mut trace = Expected::of(BufReader::new(io::repeat(b'x')));
        trace.take(line);
        let Ok(Some(Difference::Line { expected, .. })) = trace.finish() else {
            panic!("no difference");
        };
        assert!(expected.len() as u64 <= KEPT_BYTES + line.len() as u64);
    }
}
