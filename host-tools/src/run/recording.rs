//! Recordings: what entered a run from outside of virtual time, so that the host board can have the same run again.
//!
//! Two things do: when a task in slot 0 ended (it runs in the time that is left, and how much that is depends on the processor), and
//! when a mission took over from another (its bytes came over a line that has a time of its own). Everything else follows from the
//! missions, the world and the seed.
//!
//! A recording is JSON Lines: a head, then one object an entry, in the order in which they happened.
//!
//! ```text
//! {"kind":"recording","version":1,"seed":1,"missions":["a1b2c3d4"]}
//! {"kind":"end","mission":0,"occurrence":412,"task_instance":7}
//! {"kind":"mission","mission":1,"robot_us":60240000}
//! ```

use std::io::{self, BufRead, Write};

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The form of recordings that this program writes and reads.
pub const VERSION: u32 = 1;

/// What stands at the head of a recording.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename = "recording")]
pub struct Head {
    /// [`VERSION`].
    pub version: u32,
    /// The seed of the plant's noise.
    pub seed: u64,
    /// Hashes of the missions, in the order in which they ran.
    pub missions: Vec<String>,
}

/// Something that entered a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Entry {
    /// A run of a task in slot 0 ended.
    End {
        /// Index of the mission, 0 for the first.
        mission: u32,
        /// Number of the slot occurrence, counted from the mission's start, at which its end was taken in.
        occurrence: u64,
        /// The task state.
        task_instance: u16,
    },
    /// A mission took over from the one before.
    Mission {
        /// Index of the mission, 1 for the second.
        mission: u32,
        /// Robot time of its first macro step, in microseconds.
        robot_us: u64,
    },
}

/// A recording, whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recording {
    /// Its head.
    pub head: Head,
    /// What entered the run, in order.
    pub entries: Vec<Entry>,
}

/// Why a file is no recording.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// It cannot be read or written.
    #[error("the recording cannot be read: {0}")]
    Io(#[from] io::Error),
    /// A line is not what it should be.
    #[error("line {line} of the recording makes no sense: {cause}")]
    BadLine {
        /// Line, from 1.
        line: usize,
        /// What is wrong with it.
        cause: serde_json::Error,
    },
    /// It has no head.
    #[error("the recording is empty")]
    Empty,
    /// It was written by another version of this program.
    #[error(
        "the recording has form {found}, this program reads form {VERSION}; record the run again"
    )]
    OtherVersion {
        /// The form that it has.
        found: u32,
    },
}

impl Recording {
    /// Writes it as JSON Lines.
    ///
    /// # Errors
    /// Whatever `out` has.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        serde_json::to_writer(&mut out, &self.head)?;
        out.write_all(b"\n")?;
        for entry in &self.entries {
            serde_json::to_writer(&mut out, entry)?;
            out.write_all(b"\n")?;
        }
        out.flush()
    }

    /// Reads what [`Recording::write`] wrote.
    ///
    /// # Errors
    /// [`RecordingError`]: what is wrong, and where.
    pub fn read(input: impl BufRead) -> Result<Self, RecordingError> {
        let mut lines = input.lines().enumerate();
        let (_, head) = lines.next().ok_or(RecordingError::Empty)?;
        let bad = |line: usize| {
            move |cause| RecordingError::BadLine {
                line: line + 1,
                cause,
            }
        };
        let head: Head = serde_json::from_str(&head?).map_err(bad(0))?;
        if head.version != VERSION {
            return Err(RecordingError::OtherVersion {
                found: head.version,
            });
        }
        let mut entries = Vec::new();
        for (number, line) in lines {
            entries.push(serde_json::from_str(&line?).map_err(bad(number))?);
        }
        Ok(Recording { head, entries })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Recording {
        Recording {
            head: Head {
                version: VERSION,
                seed: 7,
                missions: vec!["a1b2c3d4".into(), "00000001".into()],
            },
            entries: vec![
                Entry::End {
                    mission: 0,
                    occurrence: 412,
                    task_instance: 7,
                },
                Entry::Mission {
                    mission: 1,
                    robot_us: 60_240_000,
                },
            ],
        }
    }

    #[test]
    fn what_was_written_is_read_again() {
        let mut bytes = Vec::new();
        sample().write(&mut bytes).unwrap();
        let text = String::from_utf8(bytes.clone()).unwrap();
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            [
                r#"{"kind":"recording","version":1,"seed":7,"missions":["a1b2c3d4","00000001"]}"#,
                r#"{"kind":"end","mission":0,"occurrence":412,"task_instance":7}"#,
                r#"{"kind":"mission","mission":1,"robot_us":60240000}"#,
            ]
        );
        assert_eq!(Recording::read(&bytes[..]).unwrap(), sample());
    }

    #[test]
    fn what_is_no_recording_is_told_with_its_line() {
        let head = r#"{"kind":"recording","version":1,"seed":7,"missions":[]}"#;
        let cases = [
            (String::new(), "the recording is empty"),
            ("{}".into(), "line 1 of the recording"),
            (
                format!("{head}\n{{\"kind\":\"end\"}}"),
                "line 2 of the recording",
            ),
            (format!("{head}\nnonsense"), "line 2 of the recording"),
            (head.replace(":1,", ":9,"), "the recording has form 9"),
        ];
        for (text, expected) in cases {
            let told = Recording::read(text.as_bytes()).unwrap_err().to_string();
            assert!(told.starts_with(expected), "{text:?}: {told}");
        }
    }
}
