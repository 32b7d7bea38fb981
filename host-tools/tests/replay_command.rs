//! `esm replay` as a process: how it ends where the recording is not what was written, or where
//! nobody waits for its end.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use esm_link::recording::{write_quiet, write_started};
use esm_link::trace::RecordSink;
use host_tools::compile::NameTable;
use host_tools::fit::compile_to_fit;
use host_tools::lang;
use host_tools::recording::MAX_KEPT_QUIET;
use host_tools::recording::file::{Frame, Header, write_mark};
use host_tools::time::work_limit;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

#[derive(Default)]
struct Bytes(Vec<u8>);

impl RecordSink for Bytes {
    fn put(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

/// A recording of patrol to which nothing happens, of about so many macro steps.
fn recording(path: &Path, steps: u32) {
    let mission = Path::new("../missions/patrol.esm");
    recording_of(mission, path, steps);
}

/// A recording of a mission to which nothing happens, of about so many macro steps.
fn recording_of(mission: &Path, path: &Path, steps: u32) {
    let mut checked = lang::load(mission).unwrap();
    let schedule = checked
        .lay_out(work_limit(Duration::from_secs(60)))
        .unwrap();
    let blob = compile_to_fit(&mut checked, &schedule, None, NameTable::Kept).unwrap();
    let blob = blob.unwrap().into_bytes();
    let hash = esm_core::verify(blob.as_slice()).unwrap().hash();
    let mut records = Bytes::default();
    write_started(&mut records, 0, true, hash, 0);
    let times = steps.div_ceil(MAX_KEPT_QUIET);
    for _ in 0..times {
        write_quiet(&mut records, MAX_KEPT_QUIET);
    }
    let mut bytes = Vec::new();
    write_mark(&mut bytes).unwrap();
    for frame in [
        Frame::Header(Header::default()),
        Frame::Mission {
            name: "patrol".into(),
            blob,
        },
        Frame::Records(records.0),
        Frame::End(u64::from(times * MAX_KEPT_QUIET)),
    ] {
        frame.write(&mut bytes).unwrap();
    }
    fs::write(path, bytes).unwrap();
}

/// A mission whose first macro step is not over before anybody has lost patience: 250 times an
/// event comes, and each time each of 2,000 states looks at each of its 4,000 guards, all of which
/// are false.
fn endless(path: &Path) {
    let guards = "S -> S on Look [.a and not .b and .c or .b and not .a and .d];\n".repeat(4_000);
    let looks = (0..2_000).map(|place| format!("super L{place}: Looks;\n"));
    let regions: String = (looks.zip(0..))
        .map(|(state, place)| format!("region r{place} {{ {state} initial -> L{place}; }}\n"))
        .collect();
    let sends = vec!["send Look"; 250].join(", ");
    let text = format!(
        "interpreter slot 1;
        queue 255;
        slot 1 period 1 s duration 1 s;
        task Flags slot 0 {{ out flag a; out flag b; out flag c; out flag d; }}
        container Looks {{
            in event Look;
            region all {{ task S: Flags; initial -> S; {guards} }}
        }}
        machine Endless {{
            event Look;
            region source {{ state Begin; state Over; initial -> Begin; Begin -> Over / {sends}; }}
            {regions}
        }}"
    );
    fs::write(path, text).unwrap();
}

fn esm(arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap());
    command.arg("replay").args(arguments).stdin(Stdio::null());
    command
}

fn said(output: &Output) -> (i32, String, String) {
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let status = output.status.code().unwrap();
    (status, text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_recording_that_was_changed_is_bad_input_after_all_before_the_change_was_replayed() {
    const CHANGED: &str = "the recording was changed since it was written";
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed.rec");
    recording(&path, 2_000);
    let mut bytes = fs::read(&path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    fs::write(&path, &bytes).unwrap();
    let path = path.to_str().unwrap();
    let trace = folder.path().join("trace.jsonl");
    let trace = trace.to_str().unwrap();
    for also in [&[][..], &["--over-gaps"]] {
        let told = |arguments: &[&str]| {
            let arguments = [&[path], arguments, also].concat();
            said(&esm(&arguments).output().unwrap())
        };
        let (status, out, err) = told(&["--json", "--trace", trace]);
        assert_eq!(status, 1, "{out}{err}");
        assert_eq!(err.matches("was changed").count(), 1, "{err}");
        let report: serde_json::Value = serde_json::from_str(&out).unwrap();
        assert_eq!(report["file"], "damaged", "{report}");
        assert!(
            report["error"].as_str().unwrap().starts_with(CHANGED),
            "{report}"
        );
        assert_eq!(report["macro_steps"], 2 * MAX_KEPT_QUIET, "{report}");
        let steps = fs::read_to_string(trace).unwrap();
        assert!(steps.lines().count() >= 2 * MAX_KEPT_QUIET as usize);

        let (status, out, err) = told(&[]);
        assert_eq!(status, 1, "{out}{err}");
        assert!(out.contains("replayed 2048 macro steps"), "{out}");
        assert!(err.contains(CHANGED), "{err}");

        let (status, out, err) = told(&["--step"]);
        assert_eq!(status, 1, "{out}{err}");
        assert!(err.contains(CHANGED), "{err}");
    }
}

#[test]
fn an_interrupted_replay_leaves_no_part_of_a_trace() {
    const PATIENCE: Duration = Duration::from_secs(60);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.rec");
    recording(&path, 90_000_000);
    let trace = folder.path().join("trace.jsonl");
    fs::write(&trace, "before\n").unwrap();
    let parts = || -> Vec<PathBuf> {
        let files = fs::read_dir(folder.path()).unwrap();
        let files = files.map(|file| file.unwrap().path());
        files
            .filter(|file| file.extension().is_some_and(|end| end == "part"))
            .collect()
    };
    let arguments = [path.to_str().unwrap(), "--trace", trace.to_str().unwrap()];
    let mut command = esm(&arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let begun = Instant::now();
    let is_written = || {
        let part = parts().first().and_then(|part| fs::metadata(part).ok());
        part.is_some_and(|part| part.len() > 0)
    };
    while !is_written() {
        let is_early = begun.elapsed() < PATIENCE && child.try_wait().unwrap().is_none();
        assert!(is_early, "it writes nothing");
        thread::sleep(Duration::from_millis(5));
    }
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(parts(), Vec::<PathBuf>::new());
    assert_eq!(fs::read_to_string(&trace).unwrap(), "before\n");
    let (status, out, err) = said(&output);
    assert_eq!(status, 3, "{out}{err}");
    assert!(err.contains("interrupted"), "{err}");
}

#[test]
fn a_replay_of_more_macro_steps_than_may_be_says_so_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("quiet.rec");
    recording(&path, 100_000_001);
    for also in [&[][..], &["--json"], &["--step", "--plain"]] {
        let arguments = [&[path.to_str().unwrap()], also].concat();
        let (status, out, err) = said(&esm(&arguments).output().unwrap());
        assert_eq!(status, 1, "{out}{err}");
        assert!(err.contains("more than 100000000 macro steps"), "{err}");
    }
}

#[test]
fn a_replay_ends_when_it_is_interrupted_in_a_macro_step_without_end() {
    let folder = tempfile::tempdir().unwrap();
    let (mission, path) = (
        folder.path().join("endless.esm"),
        folder.path().join("endless.rec"),
    );
    endless(&mission);
    recording_of(&mission, &path, 2_048);
    let trace = folder.path().join("trace.jsonl");
    let arguments = [path.to_str().unwrap(), "--trace", trace.to_str().unwrap()];
    let mut command = esm(&arguments);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let parts = || {
        let files = fs::read_dir(folder.path()).unwrap();
        let names = files.map(|file| file.unwrap().path());
        names
            .filter(|name| name.extension().is_some_and(|end| end == "part"))
            .count()
    };
    while parts() == 0 {
        assert!(child.try_wait().unwrap().is_none(), "it has ended");
        thread::sleep(Duration::from_millis(5));
    }
    // Until it is in the macro step.
    thread::sleep(Duration::from_secs(1));
    assert!(
        child.try_wait().unwrap().is_none(),
        "the macro step is too short"
    );
    kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
    let (status, out, err) = said(&child.wait_with_output().unwrap());
    assert_eq!(status, 3, "{out}{err}");
    assert!(
        err.contains("interrupted") && err.contains("as it was"),
        "{err}"
    );
    assert_eq!(parts(), 0);
    assert!(!trace.exists());
}
