//! The folder of a system's recordings: one of each processor, and what joins them.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use serde::{Deserialize, Serialize};

use crate::cli::exit::CommandError;
use crate::cli::file;
use crate::cli::run::read_recording;
use crate::host_run::Ended;
use crate::medium::PS_IN_US;
use crate::medium::clock::Clock;
use crate::recording::player::Recording;
use crate::system::declaration::{MAX_PROCESSORS, MAX_RESETS, System};
use crate::system::lock_step::Member;

/// The file that joins them.
const INDEX: &str = "system.json";

/// What it says.
#[derive(Serialize, Deserialize)]
struct Index {
    processors: Vec<IndexEntry>,
}

/// What it says of a processor.
#[derive(Serialize, Deserialize)]
struct IndexEntry {
    processor: String,
    /// The recording's file, in the same folder.
    recording: String,
    drift_ppb: i32,
    start_us: u64,
}

/// The recording of a processor.
pub struct Recorded {
    /// The processor's name.
    pub processor: String,
    /// Its clock.
    pub clock: Clock,
    /// What entered its interpreter.
    pub recording: Recording,
}

/// The file of a processor's recording, behind so many resets.
fn recording_name(processor: &str, resets: usize) -> String {
    match resets {
        0 => format!("{processor}.rec"),
        _ => format!("{processor}.{resets}.rec"),
    }
}

fn place(folder: &Path, processor: &str) -> PathBuf {
    folder.join(recording_name(processor, 0))
}

/// Makes the folder, if it is not there. One with recordings is left as it is.
///
/// # Errors
/// If it cannot be made, or holds recordings.
pub fn make_folder(folder: &Path, system: &System) -> Result<(), CommandError> {
    for processor in &system.processors {
        file::keep_sources(&place(folder, &processor.name.text), [])?;
    }
    match fs::create_dir(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists || !folder.is_dir() => {
            Err(CommandError::World(anyhow!(
                "cannot make the folder {} for recordings: {error}",
                folder.display()
            )))
        }
        _ => Ok(()),
    }
}

/// Writes the recordings of all processors whose missions have started; of one that was reset, one
/// for each time that it was there.
///
/// # Errors
/// If they cannot be written.
pub fn write(
    folder: &Path,
    system: &System,
    lives: &[(usize, Member)],
    ended: &[Option<Ended>],
) -> Result<(), CommandError> {
    let mut processors: Vec<IndexEntry> = Vec::new();
    for ((index, member), ended) in lives.iter().zip(ended) {
        let (Some(processor), Some(ended)) = (system.processors.get(*index), ended) else {
            continue;
        };
        let name = &processor.name.text;
        let resets = processors.iter().filter(|it| it.processor == *name).count();
        let recording = recording_name(name, resets);
        file::write_whole(&folder.join(&recording), &ended.recording, "recording")?;
        processors.push(IndexEntry {
            processor: name.clone(),
            recording,
            drift_ppb: processor.drift_ppb,
            start_us: member.life.clock.plant_ps(0) / PS_IN_US,
        });
    }
    let index = serde_json::to_string_pretty(&Index { processors });
    let index = index.map_err(|error| CommandError::World(error.into()))?;
    let text = format!("{index}\n");
    file::write_whole(&folder.join(INDEX), text.as_bytes(), "list of recordings")
}

/// Reads the recordings in a folder.
///
/// # Errors
/// If they cannot be read.
pub fn read(folder: &Path) -> Result<Vec<Recorded>, CommandError> {
    let path = folder.join(INDEX);
    let text = file::read_text(&path, "list of recordings")?;
    let wrong = |why: String| {
        CommandError::Input(anyhow!(
            "{} is no list of recordings: {why}; `esm system run … --record DIR` writes one",
            path.display()
        ))
    };
    let index: Index = serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))?;
    if index.processors.len() > MAX_PROCESSORS * (MAX_RESETS + 1) {
        return Err(wrong(format!(
            "it has more than {MAX_PROCESSORS} processors with {MAX_RESETS} resets each"
        )));
    }
    let read = |entry: IndexEntry| {
        if Path::new(&entry.recording).file_name() != Some(entry.recording.as_ref()) {
            return Err(wrong(format!("`{}` is no file's name", entry.recording)));
        }
        let Some(start_ps) = entry.start_us.checked_mul(PS_IN_US) else {
            return Err(wrong(format!("`{}` starts too late", entry.processor)));
        };
        Ok(Recorded {
            recording: read_recording(&folder.join(&entry.recording))?,
            clock: Clock::new(start_ps, entry.drift_ppb),
            processor: entry.processor,
        })
    };
    index.processors.into_iter().map(read).collect()
}
