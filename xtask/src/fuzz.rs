//! `cargo xtask fuzz`: the functions of `esm_tests::fuzzing` under libFuzzer, which looks for
//! inputs that reach new code.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::process::{
    self, Failure, command, find_program, host_cargo, make_folder, output, shown,
};
use crate::setup;

/// The package with the targets, below the checkout: one file each.
pub const PACKAGE_FOLDER: &str = "fuzz";
const TARGETS_FOLDER: &str = "fuzz/fuzz_targets";
const SEEDS_FOLDER: &str = "fuzz/corpus";
const DICTIONARY: &str = "fuzz/esm.dict";

/// What fuzzing makes: programs, inputs that reached something new, inputs that went wrong.
const BUILD_FOLDER: &str = "target/fuzz/build";
const INPUTS_FOLDER: &str = "target/fuzz/inputs";
const FINDINGS_FOLDER: &str = "target/fuzz/findings";

/// How long each target runs if nothing is said.
pub const DEFAULT_MINUTES: u32 = 5;

/// An input may be this long, take this long and this much memory; one that takes more is a
/// finding.
const MAX_INPUT_BYTES: u32 = 8_192;
const INPUT_LIMIT_SECONDS: u32 = 20;
const MEMORY_LIMIT_MB: u32 = 2_048;

/// How often what goes on is told.
const TELL_INTERVAL: Duration = Duration::from_secs(20);

/// What libFuzzer said of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Run {
    executions: u64,
    executions_a_second: u64,
    /// Edges of the program's flow that were reached.
    coverage: u64,
    memory_mb: u64,
    finding: Option<PathBuf>,
}

impl Run {
    /// Takes what a line of libFuzzer's says. Returns whether it is one that says how far it has
    /// come.
    fn take(&mut self, line: &str) -> bool {
        if let Some((_, path)) = line.split_once("Test unit written to ") {
            self.finding = Some(PathBuf::from(path.trim()));
        }
        let after = |name: &str| {
            let (_, rest) = line.split_once(name)?;
            let digits = rest.trim_start().split(|c: char| !c.is_ascii_digit());
            digits.into_iter().next()?.parse().ok()
        };
        for (name, number) in [
            ("stat::number_of_executed_units:", &mut self.executions),
            ("stat::average_exec_per_sec:", &mut self.executions_a_second),
            ("stat::peak_rss_mb:", &mut self.memory_mb),
            (" cov: ", &mut self.coverage),
        ] {
            *number = after(name).unwrap_or(*number);
        }
        line.starts_with('#') && line.contains(" cov: ")
    }
}

/// Runs the targets of these names, or all, one after another.
///
/// # Errors
/// [`Failure::Checks`] if an input went wrong; what is missing or does not build.
pub fn command_line(root: &Path, names: &[String], minutes: u32) -> Result<(), Failure> {
    let all = targets(root)?;
    if let Some(unknown) = names.iter().find(|name| !all.contains(name)) {
        return Err(Failure::Usage(format!(
            "there is no fuzz target {unknown}, only {}",
            all.join(", ")
        )));
    }
    let chosen = if names.is_empty() { &all[..] } else { names };
    tools()?;
    let mut runs = Vec::new();
    for target in chosen {
        println!("\n== {target}: {minutes} min");
        build(root, target)?;
        let run = fuzz(root, target, minutes)?;
        tell(target, &run);
        runs.push(run);
    }
    println!();
    for (target, run) in chosen.iter().zip(&runs) {
        println!(
            "{target:12} {:>10} executions, {:>6}/s, {:>6} edges, {:>5} MB, {}",
            run.executions,
            run.executions_a_second,
            run.coverage,
            run.memory_mb,
            if run.finding.is_some() {
                "1 FINDING"
            } else {
                "no finding"
            }
        );
    }
    match runs.iter().filter(|run| run.finding.is_some()).count() {
        0 => Ok(()),
        failed => Err(Failure::Checks { failed }),
    }
}

/// The names of all targets, in order.
fn targets(root: &Path) -> Result<Vec<String>, Failure> {
    let folder = root.join(TARGETS_FOLDER);
    let entries = std::fs::read_dir(&folder).map_err(|cause| Failure::File {
        path: folder.clone(),
        cause,
    })?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    Ok(names)
}

/// Finds or installs what fuzzing needs beyond cargo: libFuzzer comes as C++ source, and
/// `cargo-fuzz` builds with the right flags.
fn tools() -> Result<(), Failure> {
    if find_program("c++").is_none() {
        setup::install("a C++ compiler for libFuzzer", &["g++"])?;
    }
    if output(command(host_cargo()).args(["fuzz", "--version"])).is_none() {
        println!("Installing cargo-fuzz: `cargo install cargo-fuzz --locked` …");
        process::run(command(host_cargo()).args(["install", "cargo-fuzz", "--locked"]))?;
    }
    let version = output(command(host_cargo()).args(["fuzz", "--version"])).unwrap_or_default();
    println!("Fuzzer: {}, libFuzzer, no sanitizer", version.trim());
    Ok(())
}

/// `cargo fuzz` for a target. The sanitizers look for what only `unsafe` code can do wrong, and
/// cost half the speed: there is none here. Watching what is compared with what costs as much
/// again; a dictionary, decisions, and repaired magic and CRC lead past the comparisons that chance
/// would not.
fn cargo_fuzz(root: &Path, verb: &str, target: &str) -> Command {
    let mut cargo = command(host_cargo());
    // The variable lets a stable compiler take the flags for coverage counters, should it count
    // them as unstable.
    cargo
        .current_dir(root)
        .env("RUSTC_BOOTSTRAP", "1")
        .args(["fuzz", verb, "--sanitizer", "none", "--no-trace-compares"])
        .args(["--fuzz-dir", PACKAGE_FOLDER])
        .args(["--target-dir", BUILD_FOLDER])
        .arg(target);
    cargo
}

fn build(root: &Path, target: &str) -> Result<(), Failure> {
    println!("Building it (the first time takes minutes) …");
    process::run(&mut cargo_fuzz(root, "build", target))
}

fn fuzz(root: &Path, target: &str, minutes: u32) -> Result<Run, Failure> {
    let inputs = Path::new(INPUTS_FOLDER).join(target);
    let seeds = Path::new(SEEDS_FOLDER).join(target);
    let findings = Path::new(FINDINGS_FOLDER).join(target);
    make_folder(&root.join(&inputs))?;
    make_folder(&root.join(&findings))?;
    let mut cargo = cargo_fuzz(root, "run", target);
    cargo
        // What is found goes to the first folder; the seeds in the second stay as they are.
        .args([&inputs, &seeds])
        .arg("--")
        .arg(format!("-max_total_time={}", minutes * 60))
        .arg(format!("-max_len={MAX_INPUT_BYTES}"))
        .arg(format!("-timeout={INPUT_LIMIT_SECONDS}"))
        .arg(format!("-rss_limit_mb={MEMORY_LIMIT_MB}"))
        .arg(format!("-artifact_prefix={}/", findings.display()))
        .args(["-print_final_stats=1", "-reload=0"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    if target == "front_end" {
        cargo.arg(format!("-dict={DICTIONARY}"));
    }
    println!("    {}", shown(&cargo));
    let start = |cause| Failure::Start {
        command: format!("cargo fuzz run {target}"),
        cause,
    };
    let mut child = cargo.spawn().map_err(start)?;
    let mut run = Run::default();
    let mut told = Instant::now();
    let mut is_ending = false;
    for line in child
        .stderr
        .take()
        .into_iter()
        .flat_map(|from| BufReader::new(from).split(b'\n'))
    {
        // A panic's message can quote an input that is no text.
        let line = line.map_err(start)?;
        let line = String::from_utf8_lossy(&line);
        let is_progress = run.take(&line);
        is_ending |= line.contains("panicked at") || line.contains("ERROR: libFuzzer");
        if is_ending || (is_progress && told.elapsed() >= TELL_INTERVAL) {
            println!("{line}");
            told = Instant::now();
        }
    }
    let status = child.wait().map_err(start)?;
    if !status.success() && run.finding.is_none() {
        return Err(Failure::Ended {
            command: format!("cargo fuzz run {target}"),
            status,
        });
    }
    Ok(run)
}

fn tell(target: &str, run: &Run) {
    let Some(finding) = &run.finding else {
        return;
    };
    println!(
        "\n{target}: a finding, for the reason above. Run it again, with cargo alone:\n    ESM_FUZZ_FILE=$PWD/{} cargo test -p esm-tests --test fuzzing {target}",
        finding.display()
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_fuzzer_says_is_read() {
        let mut run = Run::default();
        let is_progress = [
            "INFO: Seed: 1",
            "#4096\tpulse  cov: 1234 ft: 5678 corp: 12/34Kb lim: 4096 exec/s: 2048 rss: 96Mb",
            "stat::number_of_executed_units: 81920",
            "stat::average_exec_per_sec:     4096",
            "stat::peak_rss_mb:              123",
            "artifact_prefix='a/'; Test unit written to a/crash-0",
        ]
        .map(|line| run.take(line));
        assert_eq!(is_progress, [false, true, false, false, false, false]);
        let expected = Run {
            executions: 81_920,
            executions_a_second: 4_096,
            coverage: 1_234,
            memory_mb: 123,
            finding: Some(PathBuf::from("a/crash-0")),
        };
        assert_eq!(run, expected);
    }
}
