//! The file of a recording, byte by byte.
//!
//! Eight bytes begin it: `ESMREC`, and the [`VERSION`] as two bytes, the low one first. Then
//! frames, one behind the other:
//!
//! | bytes | is |
//! |---|---|
//! | 1 | kind |
//! | 4 | length of the content, the lowest byte first |
//! | … | content |
//! | 4 | CRC-32 of all before it in the frame, the lowest byte first |
//!
//! A number in a content is a LEB128 varint, a text its length as a number and its UTF-8 bytes.
//! Contents by kind:
//!
//! | kind | is | content |
//! |---|---|---|
//! | 1 | head, first and once | board, firmware, program that wrote it: texts; 0, or 1 and the seed of a simulated run as a number |
//! | 2 | mission | its name: text; its blob to the end of the content, which is known by its hash, the blob's last four bytes |
//! | 3 | records | whole records, with more macro steps in their counts than a robot's |
//! | 4 | gap | how many records or parts did not come: number |
//! | 5 | ends of background runs of a simulated run | three numbers each: which mission in the order of the run, slot activation, task instance |
//! | 6 | end | macro steps of the last mission that the recording holds, counted from its beginning: number |
//! | 7 | nets | which nets the samples behind it are of: see [`samples`](super::samples) |
//! | 8 | samples | values on those nets: see [`samples`](super::samples) |
//!
//! What is of another kind is passed over.

use std::io::{self, Write};

use esm_link::frame::checksum;
use thiserror::Error;

/// The form of files that this program writes. It reads those before it, too: in form 1 records are
/// as the robot sent them.
pub const VERSION: u16 = 2;

/// The first bytes of every recording.
pub const MARK: &[u8; 6] = b"ESMREC";

/// Bytes of a recording that is read at most: more than a day of ten samples of values a second.
pub const MAX_FILE_BYTES: u64 = 64 << 20;

/// Bytes of it that are no samples of values: they are in memory while it is run again, and take
/// some forty times as much there. Three weeks of a robot on patrol take so many.
pub const MAX_INPUT_BYTES: u64 = 16 << 20;

/// What recordings began with that an earlier program wrote as lines of JSON.
const JSON_MARK: &[u8] = b"{\"kind\":\"recording\"";

/// Content of a frame at most: more than any blob.
pub const MAX_CONTENT_BYTES: usize = 16 << 20;

const KIND_AND_LENGTH_BYTES: usize = 1 + 4;
const CHECKSUM_BYTES: usize = 4;

mod kind {
    pub const HEAD: u8 = 1;
    pub const MISSION: u8 = 2;
    pub const RECORDS: u8 = 3;
    pub const GAP: u8 = 4;
    pub const ENDS: u8 = 5;
    pub const END: u8 = 6;
    pub const NETS: u8 = 7;
    pub const SAMPLES: u8 = 8;
}

/// Where a recording comes from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Header {
    /// Name of the board.
    pub board: String,
    /// Name and version of its firmware.
    pub firmware: String,
    /// Name and version of the program that wrote the file.
    pub program: String,
    /// Seed of the noise in a simulated robot's body; `None` for a real one's.
    pub seed: Option<u64>,
}

/// The end of a run of a background task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BackgroundRunEnd {
    /// The mission's number in the order of the run, from 0.
    pub mission: u32,
    /// Number of the slot activation, counted from the mission's start, at which it was taken in.
    pub activation: u64,
    /// The task state.
    pub task_instance: u16,
}

/// A frame of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frame {
    /// Where it comes from.
    Header(Header),
    /// A mission that ran.
    Mission {
        /// Its name.
        name: String,
        /// Its blob.
        blob: Vec<u8>,
    },
    /// Whole records, to be read with [`esm_link::recording::Recorded::take_within`].
    Records(Vec<u8>),
    /// So many records or parts did not come.
    Gap(u32),
    /// Ends of background runs of a simulated run.
    Ends(Vec<BackgroundRunEnd>),
    /// How many macro steps of the last mission belong to the recording.
    End(u64),
    /// Which nets of a mission samples are of from here on.
    Nets(Vec<u8>),
    /// Values on those nets.
    Samples(Vec<u8>),
}

/// How a file that could be read ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileEnd {
    /// With its last frame.
    Whole,
    /// Within a frame that begins at this byte: the writing was broken off.
    Cut {
        /// The byte.
        at: usize,
    },
    /// With a frame that begins at this byte and was changed since it was written; what comes
    /// behind it is not read.
    Damaged {
        /// The byte.
        at: usize,
    },
}

/// Why a file is no recording.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum FileError {
    /// It does not begin as one.
    #[error("it is no recording")]
    NoRecording,
    /// An earlier program wrote it.
    #[error(
        "it is a recording of an earlier form, as lines of JSON, which does not hold what entered the interpreter; record the run again"
    )]
    Json,
    /// Another program wrote it.
    #[error(
        "the recording has form {found}, this program reads forms up to {VERSION}; record the run again, or read it with the program that wrote it"
    )]
    OtherVersion {
        /// The form that it has.
        found: u16,
    },
    /// It ends before it says where it comes from.
    #[error("the recording is empty")]
    Empty,
}

/// Writes the first bytes of a file.
///
/// # Errors
/// Whatever `out` has.
pub fn write_mark(out: &mut impl Write) -> io::Result<()> {
    out.write_all(MARK)?;
    out.write_all(&VERSION.to_le_bytes())
}

pub(super) fn push_number(bytes: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        bytes.push(number as u8 | 0x80);
        number >>= 7;
    }
    bytes.push(number as u8);
}

pub(super) fn push_text(bytes: &mut Vec<u8>, text: &str) {
    push_number(bytes, text.len() as u64);
    bytes.extend_from_slice(text.as_bytes());
}

pub(super) fn take_number<N: TryFrom<u64>>(bytes: &mut &[u8]) -> Option<N> {
    let mut number = 0u64;
    for shift in (0..u64::BITS).step_by(7) {
        let (first, rest) = bytes.split_first()?;
        *bytes = rest;
        number |= u64::from(first & 0x7f) << shift;
        if first & 0x80 == 0 {
            return N::try_from(number).ok();
        }
    }
    None
}

pub(super) fn take_text(bytes: &mut &[u8]) -> Option<String> {
    let length = take_number::<usize>(bytes)?;
    let (text, rest) = bytes.split_at_checked(length)?;
    *bytes = rest;
    String::from_utf8(text.to_vec()).ok()
}

impl Frame {
    /// Writes it.
    ///
    /// # Errors
    /// Whatever `out` has; or that there is more in it than [`MAX_CONTENT_BYTES`].
    pub fn write(&self, out: &mut impl Write) -> io::Result<()> {
        let (kind, content) = self.content();
        let length = u32::try_from(content.len())
            .ok()
            .filter(|length| *length as usize <= MAX_CONTENT_BYTES)
            .ok_or_else(|| io::Error::other("a frame of the recording is too long"))?;
        let mut bytes = Vec::with_capacity(KIND_AND_LENGTH_BYTES + content.len() + CHECKSUM_BYTES);
        bytes.push(kind);
        bytes.extend_from_slice(&length.to_le_bytes());
        bytes.extend_from_slice(&content);
        let crc = checksum(&bytes);
        bytes.extend_from_slice(&crc.to_le_bytes());
        // At once, so that a program that is killed leaves as little as can be of a frame.
        out.write_all(&bytes)
    }

    fn content(&self) -> (u8, Vec<u8>) {
        let mut bytes = Vec::new();
        let kind = match self {
            Frame::Header(head) => {
                for text in [&head.board, &head.firmware, &head.program] {
                    push_text(&mut bytes, text);
                }
                bytes.push(u8::from(head.seed.is_some()));
                if let Some(seed) = head.seed {
                    push_number(&mut bytes, seed);
                }
                kind::HEAD
            }
            Frame::Mission { name, blob } => {
                push_text(&mut bytes, name);
                bytes.extend_from_slice(blob);
                kind::MISSION
            }
            Frame::Records(records) => return (kind::RECORDS, records.clone()),
            Frame::Nets(nets) => return (kind::NETS, nets.clone()),
            Frame::Samples(samples) => return (kind::SAMPLES, samples.clone()),
            Frame::Gap(missing) => {
                push_number(&mut bytes, u64::from(*missing));
                kind::GAP
            }
            Frame::Ends(ends) => {
                for end in ends {
                    push_number(&mut bytes, end.mission.into());
                    push_number(&mut bytes, end.activation);
                    push_number(&mut bytes, end.task_instance.into());
                }
                kind::ENDS
            }
            Frame::End(steps) => {
                push_number(&mut bytes, *steps);
                kind::END
            }
        };
        (kind, bytes)
    }

    /// The frame of a kind and a content; none if it is of an unknown kind.
    ///
    /// # Errors
    /// The content is none of its kind.
    fn read(kind: u8, content: &[u8]) -> Result<Option<Frame>, ()> {
        let mut rest = content;
        let frame = match kind {
            kind::HEAD => Self::read_head(&mut rest).map(Frame::Header),
            kind::MISSION => take_text(&mut rest).map(|name| {
                let blob = std::mem::take(&mut rest).to_vec();
                Frame::Mission { name, blob }
            }),
            kind::RECORDS => Some(Frame::Records(std::mem::take(&mut rest).to_vec())),
            kind::GAP => take_number(&mut rest).map(Frame::Gap),
            kind::ENDS => Self::read_ends(&mut rest).map(Frame::Ends),
            kind::END => take_number(&mut rest).map(Frame::End),
            kind::NETS => Some(Frame::Nets(std::mem::take(&mut rest).to_vec())),
            kind::SAMPLES => Some(Frame::Samples(std::mem::take(&mut rest).to_vec())),
            _ => return Ok(None),
        };
        match frame {
            Some(frame) if rest.is_empty() => Ok(Some(frame)),
            _ => Err(()),
        }
    }

    fn read_head(rest: &mut &[u8]) -> Option<Header> {
        Some(Header {
            board: take_text(rest)?,
            firmware: take_text(rest)?,
            program: take_text(rest)?,
            seed: match take_number::<u8>(rest)? {
                0 => None,
                1 => Some(take_number(rest)?),
                _ => return None,
            },
        })
    }

    fn read_ends(rest: &mut &[u8]) -> Option<Vec<BackgroundRunEnd>> {
        let mut ends = Vec::new();
        while !rest.is_empty() {
            ends.push(BackgroundRunEnd {
                mission: take_number(rest)?,
                activation: take_number(rest)?,
                task_instance: take_number(rest)?,
            });
        }
        Some(ends)
    }
}

/// The frames of a file, the head among them as the first, and how the file ends.
///
/// # Errors
/// [`FileError`]: it is no recording, or none that this program reads.
pub fn read(bytes: &[u8]) -> Result<(Vec<Frame>, FileEnd), FileError> {
    let Some((mark, rest)) = bytes.split_first_chunk::<6>() else {
        return Err(FileError::NoRecording);
    };
    if mark != MARK {
        return Err(if bytes.starts_with(JSON_MARK) {
            FileError::Json
        } else {
            FileError::NoRecording
        });
    }
    let Some((version, mut rest)) = rest.split_first_chunk::<2>() else {
        return Err(FileError::Empty);
    };
    let found = u16::from_le_bytes(*version);
    if !(1..=VERSION).contains(&found) {
        return Err(FileError::OtherVersion { found });
    }
    let mut frames = Vec::new();
    let end = loop {
        let at = bytes.len() - rest.len();
        if rest.is_empty() {
            break FileEnd::Whole;
        }
        match take_frame(&mut rest) {
            Ok(Some(frame)) => {
                if frames.is_empty() && !matches!(frame, Frame::Header(_)) {
                    break FileEnd::Damaged { at };
                }
                frames.push(frame);
            }
            Ok(None) => {}
            Err(Corrupt::Cut) => break FileEnd::Cut { at },
            Err(Corrupt::Damaged) => break FileEnd::Damaged { at },
        }
    };
    if frames.is_empty() {
        return Err(FileError::Empty);
    }
    Ok((frames, end))
}

enum Corrupt {
    Cut,
    Damaged,
}

/// What became of a frame that ends behind the file: it was broken off, or a bit of its length was
/// changed.
fn cut_or_damaged(frame: &[u8]) -> Corrupt {
    let Some(([kind, length @ ..], _)) = frame.split_first_chunk::<KIND_AND_LENGTH_BYTES>() else {
        return Corrupt::Cut;
    };
    let is_whole_with = |length: u32| {
        let checked_and_crc = frame.split_at_checked(KIND_AND_LENGTH_BYTES + length as usize);
        checked_and_crc.is_some_and(|(checked, behind)| {
            let mut as_written = vec![*kind];
            as_written.extend_from_slice(&length.to_le_bytes());
            as_written.extend(checked.iter().skip(KIND_AND_LENGTH_BYTES));
            behind.first_chunk() == Some(&checksum(&as_written).to_le_bytes())
        })
    };
    let length = u32::from_le_bytes(*length);
    let mut changed = (0..=MAX_CONTENT_BYTES.ilog2()).map(|bit| length ^ 1 << bit);
    if changed.any(is_whole_with) {
        Corrupt::Damaged
    } else {
        Corrupt::Cut
    }
}

fn take_frame(rest: &mut &[u8]) -> Result<Option<Frame>, Corrupt> {
    let whole = *rest;
    let Some(([kind, length @ ..], _)) = whole.split_first_chunk::<KIND_AND_LENGTH_BYTES>() else {
        return Err(Corrupt::Cut);
    };
    let length = u32::from_le_bytes(*length) as usize;
    if length > MAX_CONTENT_BYTES {
        return Err(Corrupt::Damaged);
    }
    let (Some((checked, behind)), Some(content)) = (
        whole.split_at_checked(KIND_AND_LENGTH_BYTES + length),
        whole.get(KIND_AND_LENGTH_BYTES..KIND_AND_LENGTH_BYTES + length),
    ) else {
        return Err(cut_or_damaged(whole));
    };
    let Some((crc, behind)) = behind.split_first_chunk::<CHECKSUM_BYTES>() else {
        return Err(cut_or_damaged(whole));
    };
    if u32::from_le_bytes(*crc) != checksum(checked) {
        return Err(Corrupt::Damaged);
    }
    *rest = behind;
    Frame::read(*kind, content).map_err(|()| Corrupt::Damaged)
}
