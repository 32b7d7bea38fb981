//! Recordings that come from outside as files.

use esm_toolkit::recording::file::FileEnd;
use esm_toolkit::recording::player::Recording;
use serde_json::Value;

use crate::looked;

/// Opens a recording; answers all that there is to see of it.
///
/// # Errors
/// It is none.
pub fn record(bytes: &[u8]) -> Result<Value, String> {
    let recording = Recording::read(bytes).map_err(|error| error.to_string())?;
    let is_whole = recording.end == FileEnd::Whole;
    let ended = looked::at(recording);
    let mut told = looked::all()?;
    told["ended"] = ended.into();
    told["whole"] = is_whole.into();
    Ok(told)
}
