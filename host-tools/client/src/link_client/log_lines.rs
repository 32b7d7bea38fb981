//! A robot's log as people read it.
//!
//! The firmware sends `defmt` frames, which hold numbers for the texts; the texts themselves stand
//! in the firmware's ELF file and never travel. The host board has no ELF file: it logs plain
//! lines.

use std::fmt;
use std::path::{Path, PathBuf};

use defmt_decoder::{DecodeError, Encoding, Table};
use thiserror::Error;

use super::log_frames::Texts;
use crate::files::{self, MAX_FIRMWARE_BYTES};

/// Longest frame that is waited for. Longer ones are noise.
const FRAME_LIMIT_BYTES: usize = 4096;

/// What is shown of a line at most, in bytes. A longer one is noise, or somebody's who has nothing
/// to say.
pub const MAX_LINE_BYTES: usize = 2048;

/// Ends each frame in the encoding that the firmware uses.
const FRAME_END: u8 = 0;

/// How grave a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// For whoever debugs the firmware.
    Trace,
    /// For whoever debugs a task.
    Debug,
    /// What the robot does.
    Info,
    /// What should not be.
    Warn,
    /// What must not be.
    Error,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Level::Trace => "trace",
            Level::Debug => "debug",
            Level::Info => "info",
            Level::Warn => "warn",
            Level::Error => "error",
        })
    }
}

/// One line of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogLine {
    /// How grave it is; `None` for a line that is printed whatever the level.
    pub level: Option<Level>,
    /// The time of the board's clock, which goes from when it was switched on, where it says one.
    pub timestamp: Option<String>,
    /// The text.
    pub text: String,
}

impl LogLine {
    /// The line without the board's time.
    pub fn words(&self) -> impl fmt::Display {
        fmt::from_fn(|f| {
            if let Some(level) = self.level {
                write!(f, "{level:<5} ")?;
            }
            f.write_str(&self.text)
        })
    }
}

/// With the board's time in front.
impl fmt::Display for LogLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(timestamp) = &self.timestamp {
            write!(f, "{timestamp} ")?;
        }
        self.words().fmt(f)
    }
}

/// Why a firmware's file cannot decode a log.
#[derive(Debug, Error)]
pub enum LogTableError {
    /// It cannot be read.
    #[error("cannot read the firmware at {}: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: std::io::Error,
    },
    /// It is no ELF file, or one of another version of `defmt`.
    #[error("{} holds no log texts that can be read ({cause:#}); the log needs the ELF file that was flashed, as it was linked", path.display())]
    BadElf {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        cause: anyhow::Error,
    },
    /// It has no `defmt` section, or one in an encoding that cannot find its way back after lost
    /// bytes.
    #[error("{} holds no log texts; the log needs the ELF file that was flashed", path.display())]
    NoTexts {
        /// The file.
        path: PathBuf,
    },
}

/// Makes lines of what a robot's log stream brings.
pub enum LogReader {
    /// A firmware's `defmt` frames. Boxed, since the texts of a firmware are many.
    Firmware(Box<LogDecoder>),
    /// The host board's plain lines.
    Text {
        /// The beginning of a line whose end has not come yet.
        pending: Vec<u8>,
        /// Something was lost, or cut: what comes up to the next end of a line is the rest of one.
        is_torn: bool,
    },
}

/// What stands behind the beginning of a line that is longer than [`MAX_LINE_BYTES`].
const CUT: &str = " … (cut: the line goes on)";

/// The beginning of what is written, as long as a line may be.
#[derive(Default)]
struct Beginning {
    text: String,
    is_cut: bool,
}

impl Beginning {
    fn of(shown: impl fmt::Display) -> String {
        use fmt::Write;
        let mut beginning = Beginning::default();
        // It ends where there is no more room.
        let _ = write!(beginning, "{shown}");
        if beginning.is_cut {
            beginning.text.push_str(CUT);
        }
        beginning.text
    }
}

impl fmt::Write for Beginning {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        let room = MAX_LINE_BYTES - self.text.len();
        let end = part.floor_char_boundary(room);
        self.text.push_str(part.get(..end).unwrap_or_default());
        self.is_cut = end < part.len();
        if self.is_cut { Err(fmt::Error) } else { Ok(()) }
    }
}

/// A plain line.
fn plain(text: impl fmt::Display) -> LogLine {
    LogLine {
        level: None,
        timestamp: None,
        text: Beginning::of(text),
    }
}

/// Passes over bytes up to the end of a line or frame whose beginning is lost.
fn behind(end: u8, bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().position(|byte| *byte == end);
    end.and_then(|end| bytes.get(end + 1..)).unwrap_or_default()
}

impl LogReader {
    /// For plain lines.
    pub fn text() -> Self {
        LogReader::Text {
            pending: Vec::new(),
            is_torn: false,
        }
    }

    /// For the `defmt` frames of the firmware at `path`.
    ///
    /// # Errors
    /// [`LogTableError`]: what is wrong with the file.
    pub fn firmware(path: &Path) -> Result<Self, LogTableError> {
        Ok(LogReader::Firmware(Box::new(LogDecoder::from_firmware(
            path,
        )?)))
    }

    /// Something between the bytes that came and those that will come is missing. What is left of
    /// the two lines around it is not shown as one.
    pub fn gap(&mut self) {
        match self {
            LogReader::Firmware(decoder) => decoder.gap(),
            LogReader::Text { pending, is_torn } => {
                pending.clear();
                *is_torn = true;
            }
        }
    }

    /// How many lines were complete and could not be read since this was asked last.
    pub fn take_unreadable(&mut self) -> u64 {
        match self {
            LogReader::Firmware(decoder) => std::mem::take(&mut decoder.bad_frames),
            LogReader::Text { .. } => 0,
        }
    }

    /// Takes bytes as they come and answers the lines that are complete.
    pub fn lines(&mut self, bytes: &[u8]) -> Vec<LogLine> {
        let (pending, is_torn) = match self {
            LogReader::Firmware(decoder) => return decoder.lines(bytes),
            LogReader::Text { pending, is_torn } => (pending, is_torn),
        };
        let bytes = if *is_torn {
            *is_torn = !bytes.contains(&b'\n');
            behind(b'\n', bytes)
        } else {
            bytes
        };
        pending.extend_from_slice(bytes);
        let end = pending.iter().rposition(|&byte| byte == b'\n');
        let rest = pending.split_off(end.map_or(0, |end| end + 1));
        let complete = std::mem::replace(pending, rest);
        let mut lines: Vec<LogLine> = (String::from_utf8_lossy(&complete).lines())
            .map(plain)
            .collect();
        if pending.len() > MAX_LINE_BYTES {
            lines.push(plain(String::from_utf8_lossy(pending)));
            pending.clear();
            *is_torn = true;
        }
        lines
    }
}

/// Makes lines of `defmt` frames, with the texts of one firmware.
pub struct LogDecoder {
    table: Table,
    /// The same texts, by which frames are looked at first.
    texts: Texts,
    /// Something was lost: what comes up to the next end of a frame is the rest of one.
    is_torn: bool,
    /// What came after the last end of a frame.
    pending: Vec<u8>,
    /// Frames that could not be read: lost bytes, or the texts of another firmware.
    bad_frames: u64,
}

impl LogDecoder {
    /// Takes the texts of the firmware at `path`.
    ///
    /// # Errors
    /// [`LogTableError`]: what is wrong with the file.
    pub fn from_firmware(path: &Path) -> Result<Self, LogTableError> {
        let elf =
            files::read(path, MAX_FIRMWARE_BYTES).map_err(|cause| LogTableError::Unreadable {
                path: path.to_owned(),
                cause,
            })?;
        let table = Table::parse(&elf).map_err(|cause| LogTableError::BadElf {
            path: path.to_owned(),
            cause,
        })?;
        match table.zip(Texts::of(&elf)) {
            Some((table, texts)) if table.encoding() == Encoding::Rzcobs => Ok(LogDecoder {
                table,
                texts,
                is_torn: false,
                pending: Vec::new(),
                bad_frames: 0,
            }),
            _ => Err(LogTableError::NoTexts {
                path: path.to_owned(),
            }),
        }
    }

    /// Something between the bytes that came and those that will come is missing. The two pieces of
    /// a frame are not to be read as one.
    pub fn gap(&mut self) {
        self.pending.clear();
        self.is_torn = true;
    }

    /// Takes bytes as they come and answers the lines that are complete. What is no frame is
    /// counted and passed over.
    pub fn lines(&mut self, bytes: &[u8]) -> Vec<LogLine> {
        let bytes = if self.is_torn {
            self.is_torn = !bytes.contains(&FRAME_END);
            behind(FRAME_END, bytes)
        } else {
            bytes
        };
        self.pending.extend_from_slice(bytes);
        let Some(last_end) = self.pending.iter().rposition(|&byte| byte == FRAME_END) else {
            if self.pending.len() > FRAME_LIMIT_BYTES {
                self.pending.clear();
                self.bad_frames += 1;
            }
            return Vec::new();
        };
        let rest = self.pending.split_off(last_end + 1);
        let complete = std::mem::replace(&mut self.pending, rest);
        let mut lines = Vec::new();
        for frame in complete.split_inclusive(|byte| *byte == FRAME_END) {
            let Some(packed @ [_, ..]) = frame.strip_suffix(&[FRAME_END]) else {
                continue;
            };
            if packed.len() > FRAME_LIMIT_BYTES || !self.texts.admit(packed) {
                self.bad_frames += 1;
                continue;
            }
            let mut decoder = self.table.new_stream_decoder();
            decoder.received(frame);
            match decoder.decode() {
                Ok(frame) => lines.push(LogLine {
                    level: frame.level().map(|level| match level.as_str() {
                        "trace" => Level::Trace,
                        "debug" => Level::Debug,
                        "info" => Level::Info,
                        "warn" => Level::Warn,
                        _ => Level::Error,
                    }),
                    timestamp: frame.display_timestamp().map(Beginning::of),
                    text: Beginning::of(frame.display_message()),
                }),
                Err(DecodeError::UnexpectedEof | DecodeError::Malformed) => self.bad_frames += 1,
            }
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_lines_are_cut_where_they_end() {
        let mut log = LogReader::text();
        let mut texts = |bytes: &[u8]| -> Vec<String> {
            log.lines(bytes).iter().map(LogLine::to_string).collect()
        };
        assert_eq!(texts(b"one\ntw"), ["one"]);
        assert!(texts(b"").is_empty());
        assert_eq!(texts(b"o\nthree\n"), ["two", "three"]);
    }

    #[test]
    fn a_line_without_end_is_cut_where_one_can_see_it_and_the_next_one_is_whole() {
        let mut log = LogReader::text();
        let mut texts = Vec::new();
        let mut pending_most = 0;
        for _ in 0..100 {
            texts.extend(log.lines(&[b'a'; 96]));
            if let LogReader::Text { pending, .. } = &log {
                pending_most = pending_most.max(pending.len());
            }
        }
        texts.extend(log.lines(b"its end\nnext\n"));
        let cut = "a".repeat(MAX_LINE_BYTES) + CUT;
        let texts: Vec<_> = texts.iter().map(|it| &it.text[..]).collect();
        assert_eq!(texts, [&cut[..], "next"]);
        assert!(pending_most <= MAX_LINE_BYTES);
        let at_once = ["ü".repeat(3000).as_bytes(), b"\nnext\n"].concat();
        let texts = log.lines(&at_once);
        assert_eq!(texts[0].text, "ü".repeat(MAX_LINE_BYTES / 2) + CUT);
        assert_eq!(texts[1].text, "next");
    }

    #[test]
    fn pieces_of_two_lines_around_a_loss_are_not_one() {
        let mut log = LogReader::text();
        assert!(log.lines(b"the beginning").is_empty());
        log.gap();
        assert!(log.lines(b" of the end").is_empty());
        let lines = log.lines(b" of it\nwhole\n");
        assert_eq!(
            lines.iter().map(|it| &it.text[..]).collect::<Vec<_>>(),
            ["whole"]
        );
    }
}
