//! Recordings that come from outside: as a file, or from a robot that is connected.

use std::cell::RefCell;

use esm_toolkit::recording::file::{FileEnd, Frame};
use esm_toolkit::recording::player::Recording;
use serde_json::Value;

use crate::looked;

/// What has come of a robot.
#[derive(Default)]
struct Robot {
    bytes: Vec<u8>,
    /// What was told of it.
    told: looked::Known,
}

thread_local! {
    static ROBOT: RefCell<Robot> = RefCell::default();
}

/// Opens a recording; answers all that there is to see of it.
///
/// # Errors
/// It is none.
pub fn record(bytes: &[u8]) -> Result<Value, String> {
    let recording = Recording::read(bytes).map_err(|error| error.to_string())?;
    let is_whole = recording.end == FileEnd::Whole;
    let ended = looked::at(recording);
    let (mut told, _) = looked::all(&looked::Known::default())?;
    told["ended"] = ended.into();
    told["whole"] = is_whole.into();
    Ok(told)
}

/// Takes in what a robot has told. Answers what there is to see of it that was not told before, or
/// nothing before its recording begins.
///
/// # Errors
/// What has come makes no sense.
pub fn live(bytes: &[u8], steps: Option<u64>) -> Result<Value, String> {
    ROBOT.with_borrow_mut(|robot| {
        robot.bytes.extend_from_slice(bytes);
        let mut all = robot.bytes.clone();
        if let Some(steps) = steps {
            // What entered before them is there, as far as the robot has told.
            let end = Frame::End(steps);
            end.write(&mut all).map_err(|error| error.to_string())?;
        }
        if robot.bytes.is_empty() {
            return Ok(Value::Null);
        }
        let recording = Recording::read(&all).map_err(|error| error.to_string())?;
        if recording.stretches.is_empty() {
            return Ok(Value::Null);
        }
        looked::at_growing(recording);
        let (told, known) = looked::all(&robot.told)?;
        robot.told = known;
        Ok(told)
    })
}
