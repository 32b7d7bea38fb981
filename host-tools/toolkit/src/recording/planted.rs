//! Recordings for tests: machines as text, and what their tasks reported.

use std::ops::Range;

use esm_core::Interpreter;
use esm_link::recording::{write_changes, write_quiet, write_started, write_state};
use esm_link::trace::RecordSink;

use super::condense::MAX_KEPT_QUIET;
use super::file::{self, Frame, Header};
#[cfg(test)]
use super::limits::Limits;
use super::player::Recording;
#[cfg(test)]
use super::player::RecordingError;
use crate::samples::directory_and_blob;
use crate::trace::directory::{Directory, StateKind};

/// A machine that blinks, without tasks.
pub const BLINK: &str = "
    interpreter slot 1;
    slot 1 period 20 ms duration 1 ms;
    machine Blink {
        region light {
            state On timeout 50 ms;
            state Off timeout 50 ms;
            initial -> On;
            On -> Off [timeout];
            Off -> On [timeout];
        }
    }";

/// A machine whose events cause each other for ever, once a flag is set.
pub const FLOOD: &str = "
    interpreter slot 1;
    slot 1 period 10 ms duration 1 ms;
    slot 2 period 10 ms duration 1 ms;
    task Drive slot 2 { out flag near; }
    machine Flood {
        event Tick;
        region clock {
            task Wait: Drive;
            state Ring;
            initial -> Wait;
            Wait -> Ring [.near] / send Tick;
            Ring -> Ring on Tick / send Tick;
        }
    }";

/// A recording that is put together.
pub struct Planted(Vec<u8>);

#[derive(Default)]
struct Bytes(Vec<u8>);

impl RecordSink for Bytes {
    fn put(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

impl Planted {
    /// An empty one.
    pub fn new() -> Self {
        let mut bytes = Vec::new();
        file::write_mark(&mut bytes).unwrap();
        Planted(bytes).with(&Frame::Header(Header::default()))
    }

    fn with(mut self, frame: &Frame) -> Self {
        frame.write(&mut self.0).unwrap();
        self
    }

    /// One that goes on behind these bytes.
    #[cfg(test)]
    pub(super) fn behind(bytes: Vec<u8>) -> Self {
        Planted(bytes)
    }

    /// Something is missing.
    pub fn gap(self) -> Self {
        self.with(&Frame::Gap(1))
    }

    /// These macro steps of a machine that started then. A report is what a scenario has behind its
    /// time: `set`, `clear` or `exit`, and a name.
    pub fn run(
        self,
        (name, machine): (&str, &str),
        start_us: u64,
        steps: Range<u64>,
        reports: &[(u64, &str)],
    ) -> Self {
        let (directory, blob) = directory_and_blob(machine);
        let verified = esm_core::verify(blob.as_slice()).unwrap();
        let hash = verified.hash();
        let mut arena = vec![0; verified.arena_words()];
        let mut robot = Interpreter::new(verified, &mut arena).unwrap();
        let mut sink = Bytes::default();
        for step in 0..steps.end {
            if step == steps.start && step == 0 {
                write_started(&mut sink, 0, false, hash, start_us);
            } else if step == steps.start {
                let words = robot.state_words();
                write_state(&mut sink, false, hash, start_us, &robot.progress(), words);
            }
            let before = robot.input_words().to_vec();
            for (_, report) in reports.iter().filter(|(at, _)| *at == step) {
                enter(&mut robot, &directory, report);
            }
            let pairs = before.iter().zip(robot.input_words()).enumerate();
            let bits: Vec<u32> = pairs
                .flat_map(|(word, (before, now))| {
                    let differs = before ^ now;
                    (0..32).filter_map(move |bit| {
                        (differs >> bit & 1 != 0).then_some(32 * word as u32 + bit)
                    })
                })
                .collect();
            if step < steps.start {
                // Nobody records yet.
            } else if bits.is_empty() {
                write_quiet(&mut sink, 1);
            } else {
                write_changes(&mut sink, 0, bits.into_iter());
            }
            let _ = robot.macro_step(&mut ());
        }
        let name = name.to_owned();
        self.with(&Frame::Mission { name, blob })
            .with(&Frame::Records(sink.0))
    }

    /// So many macro steps of a machine to which nothing happens, in as few bytes as a file may
    /// have for them.
    pub fn quiet(self, (name, machine): (&str, &str), steps: u64) -> Self {
        let (_, blob) = directory_and_blob(machine);
        let hash = esm_core::verify(blob.as_slice()).unwrap().hash();
        let mut sink = Bytes::default();
        write_started(&mut sink, 0, false, hash, 0);
        for _ in 0..steps / u64::from(MAX_KEPT_QUIET) {
            write_quiet(&mut sink, MAX_KEPT_QUIET);
        }
        write_quiet(&mut sink, (steps % u64::from(MAX_KEPT_QUIET)) as u32);
        let name = name.to_owned();
        self.with(&Frame::Mission { name, blob })
            .with(&Frame::Records(sink.0))
    }

    #[cfg(test)]
    pub(super) fn recording_within(&self, limits: Limits) -> Result<Recording, RecordingError> {
        Recording::read_within(&self.0, limits)
    }

    /// It, read.
    pub fn recording(&self) -> Recording {
        Recording::read(&self.0).unwrap()
    }
}

fn enter(robot: &mut Interpreter<'_, &[u8]>, directory: &Directory, report: &str) {
    let (verb, name) = report.split_once(' ').unwrap();
    let (path, flag) = name.split_once('.').unwrap_or((name, ""));
    let state = directory.state(directory.find(path).unwrap()).unwrap();
    let StateKind::Task { instance } = state.kind else {
        panic!("{report}: no task");
    };
    let place = state.flags.iter().position(|entry| entry.name == flag);
    match verb {
        "set" | "clear" => robot.set_flag(instance, place.unwrap(), verb == "set"),
        "exit" => robot.report_exit(instance),
        other => panic!("{other}"),
    }
}
