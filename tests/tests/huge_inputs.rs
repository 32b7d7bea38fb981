//! Huge and hostile inputs, given to the command as files: each is answered in time and in memory
//! that are bounded.
//!
//! The ordinary test takes small ones.
//! `cargo test -p esm-tests --test huge_inputs -- --ignored --nocapture` takes them at full size,
//! 100,000 things or 10 MB, and prints what each command took; `ESM_SHAPE=words` chooses those with
//! these words in their name.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};
use std::time::Duration;

use esm_tests::command::{Done, esm_within};
use esm_tests::huge::{GARBAGE, MISSIONS, Shape};

/// Things in a mission, and bytes of garbage, at full size.
const THINGS: usize = 100_000;
const BYTES: usize = 10_000_000;

/// What any command may take at full size: memory,
const MEMORY_MB: usize = 1_024;

/// and processor time, for `check`, which others build on, and for any other command.
const CHECK_SECONDS: f32 = 3.5;
const SECONDS: f32 = 5.0;

/// How much smaller the inputs of the ordinary test are.
const SMALLER: usize = 250;

/// A file of a shape.
fn written(shape: &Shape, size: usize, folder: &Path) -> PathBuf {
    let path = folder.join("huge.esm");
    std::fs::write(&path, (shape.make)(size)).unwrap();
    path
}

/// What is done with each file: the command's words, in which `FILE`, `OUT` and `SCENARIO` stand
/// for paths.
const COMMANDS: [&[&str]; 8] = [
    &["check", "FILE"],
    &["check", "FILE", "--json"],
    &["build", "FILE", "-o", "OUT"],
    &["schedule", "FILE", "--limit", "1"],
    &["sim", "FILE", "SCENARIO"],
    &["inspect", "FILE"],
    &["fmt", "FILE", "--stdout"],
    &["draw", "FILE", "-o", "OUT"],
];

/// Runs a command with a file.
fn run(command: &[&str], file: &Path) -> (Done, Duration) {
    let scenario = file.with_file_name("short.scenario");
    std::fs::write(&scenario, "until 100 ms\n").unwrap();
    let out = file.with_file_name("out");
    let words: Vec<String> = command
        .iter()
        .map(|word| match *word {
            "FILE" => file.display().to_string(),
            "OUT" => out.display().to_string(),
            "SCENARIO" => scenario.display().to_string(),
            word => word.to_owned(),
        })
        .collect();
    esm_within(MEMORY_MB, &words)
}

/// What is wrong with how a command ended; nothing if all is well.
fn problem(command: &[&str], done: &Done, is_right: bool) -> Option<String> {
    let ends_well: &[i32] = match command[0] {
        // What is right for the language may be more than a limit allows, and what is no mission
        // may still have a schedule.
        "schedule" | "fmt" => &[0, 1],
        _ if is_right => &[0, 1],
        _ => &[1],
    };
    let status = done.status.unwrap_or(-1);
    if !ends_well.contains(&status) {
        let said: String = done.err.chars().take(600).collect();
        return Some(format!("exit status {status}\n{said}"));
    }
    let is_silent = done.err.is_empty() && done.out.is_empty();
    (status == 1 && is_silent).then(|| "it says nothing".to_owned())
}

/// Runs all commands with every shape; returns what went wrong, and prints what each took if asked.
fn measure(things: usize, bytes: usize, print: bool) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let mut problems = Vec::new();
    let shapes = MISSIONS.iter().map(|shape| (shape, things));
    let only = std::env::var("ESM_SHAPE").unwrap_or_default();
    for (shape, size) in shapes.chain(GARBAGE.iter().map(|shape| (shape, bytes))) {
        if !shape.name.contains(&only) {
            continue;
        }
        let file = written(shape, size, folder.path());
        let mut line = format!("{:50}", shape.name);
        for command in COMMANDS {
            let limit = if command[0] == "check" {
                CHECK_SECONDS
            } else {
                SECONDS
            };
            let (done, took) = run(command, &file);
            let took = took.as_secs_f32();
            line += &format!(" {took:5.2}");
            let problem = problem(command, &done, shape.is_right)
                .or_else(|| (took > limit).then(|| format!("{took:.1} s")));
            if let Some(problem) = problem {
                let command = command.join(" ");
                problems.push(format!("{}: `{command}`: {problem}", shape.name));
                line.push('!');
            }
        }
        if print {
            println!("{line}");
        }
    }
    problems
}

#[test]
fn large_inputs_are_answered_in_time() {
    let problems = measure(THINGS / SMALLER, BYTES / SMALLER, false);
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
#[ignore = "takes minutes, and prints figures"]
fn huge_inputs_are_answered_in_time() {
    let words: Vec<String> = COMMANDS.iter().map(|words| words.join(" ")).collect();
    println!("seconds of: {}", words.join(", "));
    let problems = measure(THINGS, BYTES, true);
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
