//! `cargo xtask test`: every check, one after another; what fails does not keep the rest from running.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::bench;
use crate::demo;
use crate::firmware::{
    self, BOARD_FOLDER, BOUND_BIN, DEFAULT_BIN, EXAMPLE_FIRMWARE_FOLDER, EXAMPLE_FOLDER, FAULTS_BIN,
};
use crate::fuzz;
use crate::process::{self, Failure, shown};
use crate::python;
use crate::setup::{self, Choice, SMALL_TARGET, Toolchain, host_cargo};
use crate::size;

/// Tells the example's tests where its firmware is.
const EXAMPLE_FIRMWARE_VARIABLE: &str = "ESM_MY_ROBOT_FIRMWARE";

/// What has been counted so far: a step is one, and each test of a test program is one.
#[derive(Default)]
struct Tally {
    passed: usize,
    failed: usize,
    failures: Vec<String>,
}

impl Tally {
    /// Runs one step and tells how it went.
    fn step(&mut self, name: &str, run: impl FnOnce() -> Result<(), Failure>) {
        println!("\n== {name}");
        let started = Instant::now();
        let result = run();
        let seconds = started.elapsed().as_secs_f32();
        match result {
            Ok(()) => {
                self.passed += 1;
                println!("== {name}: ok ({seconds:.0} s)");
            }
            Err(failure) => {
                self.failed += 1;
                println!("== {name}: FAILED ({seconds:.0} s): {failure}");
                self.failures.push(name.to_owned());
            }
        }
    }

    /// A step that is a run of `cargo test`, whose tests are counted each.
    fn tests(
        &mut self,
        name: &str,
        folder: &Path,
        arguments: &[&str],
        variable: Option<(&str, PathBuf)>,
    ) {
        let (mut passed, mut failed) = (0, 0);
        self.step(name, || {
            let mut cargo = cargo(folder);
            cargo
                .args(["test", "--no-fail-fast"])
                .args(arguments)
                .envs(variable)
                .stdout(Stdio::piped());
            let command = shown(&cargo);
            let start = |cause| Failure::Start {
                command: command.clone(),
                cause,
            };
            let mut child = cargo.spawn().map_err(start)?;
            for line in child
                .stdout
                .take()
                .into_iter()
                .flat_map(|out| BufReader::new(out).lines())
            {
                let line = line.map_err(start)?;
                println!("{line}");
                if let Some((now_passed, now_failed)) = counts(&line) {
                    passed += now_passed;
                    failed += now_failed;
                }
            }
            let status = child.wait().map_err(start)?;
            if status.success() {
                Ok(())
            } else {
                Err(Failure::Ended {
                    command: command.clone(),
                    status,
                })
            }
        });
        self.passed += passed;
        self.failed += failed;
    }

    /// A step that does not apply here.
    fn skip(&self, name: &str, reason: &str) {
        println!("\n== {name}: left out: {reason}");
    }
}

/// Runs every check; `quick` leaves out what needs firmware or an emulator.
///
/// # Errors
/// [`Failure::Checks`] if one did not hold.
pub fn command(root: &Path, choice: Choice, quick: bool) -> Result<(), Failure> {
    let started = Instant::now();
    let mut tally = Tally::default();
    host_checks(root, &mut tally);
    // One line for each: where it was planted, its name, what it breaks, and what noticed it.
    tally.tests(
        "planted bugs",
        root,
        &[
            "--package",
            "rt-firmware",
            "--package",
            "host-tools",
            "--features",
            "rt-firmware/keys,rt-firmware/black-box",
            "--lib",
            "planted_defect_of_the_",
            "--",
            "--nocapture",
            "--test-threads=1",
        ],
        None,
    );
    if quick {
        tally.tests(
            "tests of the libraries",
            root,
            &["--workspace", "--lib", "--bins"],
            None,
        );
    } else {
        let mut toolchain = None;
        tally.step("set-up", || {
            setup::emulator()?;
            toolchain = Some(setup::toolchain(choice)?);
            Ok(())
        });
        if let Some(toolchain) = &toolchain {
            firmware_checks(root, toolchain, &mut tally);
        }
        tally.step("the command esm, optimised", || {
            process::run(cargo(root).args([
                "build",
                "--release",
                "--package",
                "host-tools",
                "--bin",
                "esm",
            ]))
        });
        match python::find() {
            Some(python) => tally.step("the link's client in Python", || {
                python::test(root, &python, &root.join("target/release/esm"))
            }),
            None => tally.skip(
                "the link's client in Python",
                "there is no python3 with venv",
            ),
        }
        tally.step("the demo, and its deepest stack", || {
            size::check_stack(root, &demo::drive(root)?.join("summary.json"))
        });
        tally.tests("tests of the workspace", root, &["--workspace"], None);
        tally.tests(
            "the interpreter that is compiled for size",
            root,
            &[
                "--package",
                "esm-tests",
                "--features",
                "esm-core/small",
                "--test",
                "fuzzing",
                "--test",
                "differential",
            ],
            None,
        );
        let target = root.join(bench::MACHINES_TARGET);
        tally.tests(
            "tests of the machines that are compared",
            &root.join(bench::MACHINES_FOLDER),
            &[
                "--package",
                "bench-machines",
                "--target-dir",
                &target.to_string_lossy(),
            ],
            None,
        );
        if let Some(toolchain) = &toolchain {
            example_checks(root, toolchain, &mut tally);
        }
    }
    println!("\nTook {:.0} s.", started.elapsed().as_secs_f32());
    for failure in &tally.failures {
        println!("failed: {failure}");
    }
    println!("{} passed, {} failed", tally.passed, tally.failed);
    match tally.failed {
        0 => Ok(()),
        failed => Err(Failure::Checks { failed }),
    }
}

/// What needs no firmware: form, lints, documentation.
fn host_checks(root: &Path, tally: &mut Tally) {
    let rustfmt = has_component("fmt");
    let clippy = has_component("clippy");
    if rustfmt {
        for folder in [
            "",
            BOARD_FOLDER,
            EXAMPLE_FOLDER,
            EXAMPLE_FIRMWARE_FOLDER,
            fuzz::PACKAGE_FOLDER,
            bench::MACHINES_FOLDER,
        ] {
            let name = format!(
                "formatting of {}",
                if folder.is_empty() {
                    "the workspace"
                } else {
                    folder
                }
            );
            tally.step(&name, || {
                process::run(cargo(&root.join(folder)).args(["fmt", "--all", "--check"]))
            });
        }
    } else {
        tally.skip(
            "formatting",
            "this cargo has no `fmt` (rustup component add rustfmt)",
        );
    }
    if clippy {
        tally.step("lints of the workspace", || {
            process::run(cargo(root).args([
                "clippy",
                "--quiet",
                "--workspace",
                "--all-targets",
                "--",
                "-D",
                "warnings",
            ]))
        });
        tally.step("lints of the machines that are compared", || {
            let folder = root.join(bench::MACHINES_FOLDER);
            process::run(
                cargo(&folder)
                    .args(["clippy", "--quiet", "--all-targets"])
                    .args(["--package", "bench-machines", "--package", "bench-host"])
                    .arg("--target-dir")
                    .arg(root.join(bench::MACHINES_TARGET))
                    .args(["--", "-D", "warnings"]),
            )
        });
    } else {
        tally.skip(
            "lints",
            "this cargo has no `clippy` (rustup component add clippy)",
        );
    }
    tally.step("documentation without warnings", || {
        process::run(cargo(root).env("RUSTDOCFLAGS", "-D warnings").args([
            "doc",
            "--quiet",
            "--workspace",
            "--no-deps",
        ]))
    });
}

/// What is built for the board's core.
fn firmware_checks(root: &Path, toolchain: &Toolchain, tally: &mut Tally) {
    tally.step("firmware", || {
        firmware::build(
            root,
            toolchain,
            firmware::RELEASE,
            &[DEFAULT_BIN, FAULTS_BIN, BOUND_BIN].map(str::to_owned),
        )
        .map(drop)
    });
    tally.step("sizes", || size::command(root, toolchain, false));
    if toolchain.has_clippy() && has_component("clippy") {
        tally.step("lints of the firmware", || {
            firmware::lint(root, &root.join(BOARD_FOLDER), toolchain)
        });
    } else {
        tally.skip(
            "lints of the firmware",
            "the compiler for firmware has no clippy",
        );
    }
    tally.step(
        "a smaller core: esm-core and rt-firmware for thumbv6m",
        || {
            setup::small_target(toolchain)?;
            process::run(
                toolchain
                    .cargo(root)
                    .args(["check", "--package", "esm-core", "--package", "rt-firmware"])
                    .args(["--target", SMALL_TARGET])
                    .arg("--target-dir")
                    .arg(root.join(firmware::BUILD_FOLDER))
                    .args(toolchain.core_from_source()),
            )
        },
    );
}

/// A robot of a user's own, outside the workspace: its firmware, and its tests, which drive its mission on the host and in the emulator.
fn example_checks(root: &Path, toolchain: &Toolchain, tally: &mut Tally) {
    let mut firmware = None;
    tally.step("my_robot: firmware", || {
        firmware = firmware::build_example(root, toolchain)?.pop();
        Ok(())
    });
    let environment = firmware.map(|file| (EXAMPLE_FIRMWARE_VARIABLE, file));
    tally.tests(
        "my_robot: tests",
        &root.join(EXAMPLE_FOLDER),
        &["--target-dir", &root.join("target").to_string_lossy()],
        environment,
    );
}

/// The host's cargo in `folder`.
fn cargo(folder: &Path) -> Command {
    let mut cargo = process::command(host_cargo());
    cargo.current_dir(folder);
    cargo
}

/// Whether the host's cargo has the subcommand `name`.
fn has_component(name: &str) -> bool {
    process::output(process::command(host_cargo()).args([name, "--version"])).is_some()
}

/// Passed and failed tests of a test program's last line.
fn counts(line: &str) -> Option<(usize, usize)> {
    let line = line.strip_prefix("test result: ")?;
    let before = |word: &str| {
        line.split(word)
            .next()?
            .split_whitespace()
            .last()?
            .parse()
            .ok()
    };
    Some((before(" passed;")?, before(" failed;")?))
}

#[cfg(test)]
mod tests {
    use super::counts;

    #[test]
    fn the_last_line_of_a_test_program_is_counted() {
        for (line, expected) in [
            (
                "test result: ok. 12 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.01s",
                Some((12, 0)),
            ),
            (
                "test result: FAILED. 3 passed; 2 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.01s",
                Some((3, 2)),
            ),
            ("test result: unknown", None),
            ("running 3 tests", None),
        ] {
            assert_eq!(counts(line), expected, "{line}");
        }
    }
}
