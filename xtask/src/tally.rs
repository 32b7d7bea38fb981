//! What was checked, and how it went: steps with their times, tests counted one by one, and parts
//! that run beside in a process of their own.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::Instant;

use crate::process::{self, Failure, cargo, shown};

/// What has been counted so far: a step is one, and each test of a test program is one.
#[derive(Default)]
pub struct Tally {
    passed: usize,
    failed: usize,
    failures: Vec<String>,
}

impl Tally {
    /// Runs one step and tells how it went.
    pub fn step(&mut self, name: &str, run: impl FnOnce() -> Result<(), Failure>) {
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
    pub fn tests(
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
    pub fn skip(&self, name: &str, reason: &str) {
        println!("\n== {name}: left out: {reason}");
    }

    /// Starts the part `part` of the checks in a process of its own, which writes what it says to
    /// `log`. [`Tally::join`] must be called for it.
    ///
    /// # Errors
    /// [`Failure::File`], [`Failure::Start`].
    pub fn beside(part: &'static str, options: &[&str], log: PathBuf) -> Result<Beside, Failure> {
        let mut command = process::this()?;
        command.args(["test", part]).args(options);
        let child = process::spawn_into(&mut command, &log)?;
        println!(
            "\n== {part}: begins beside what follows, into {}",
            log.display()
        );
        Ok(Beside { part, child, log })
    }

    /// Waits for a part that was started beside, prints what it said, and counts what it counted.
    pub fn join(&mut self, beside: Result<Beside, Failure>) {
        let mut beside = match beside {
            Ok(beside) => beside,
            Err(failure) => return self.step("a part beside", || Err(failure)),
        };
        let status = beside.child.wait();
        let said = std::fs::read(&beside.log).unwrap_or_default();
        let said = String::from_utf8_lossy(&said);
        println!("\n== {}: what it said meanwhile", beside.part);
        print!("{said}");
        let lines: Vec<&str> = said.lines().collect();
        // Behind the totals nothing comes but that something failed.
        let end = lines.iter().rposition(|line| totals(line).is_some());
        let counted = end.and_then(|end| totals(lines[end]));
        let (passed, failed) = counted.unwrap_or_default();
        self.passed += passed;
        self.failed += failed;
        let before = lines[..end.unwrap_or(0)].iter().rev();
        let failures = before.map_while(|line| line.strip_prefix(FAILED));
        self.failures.extend(failures.map(str::to_owned));
        // A part that counted failures ends so. One that ends so without any has broken down,
        // whatever it had counted.
        let is_good = status.as_ref().is_ok_and(|status| status.success());
        if counted.is_none() || (failed == 0 && !is_good) {
            self.step(beside.part, || {
                let command = format!("cargo xtask test {}", beside.part);
                Err(match status {
                    Ok(status) => Failure::Ended { command, status },
                    Err(cause) => Failure::Start { command, cause },
                })
            });
        }
    }

    /// Prints what failed, and the totals as the last line.
    ///
    /// # Errors
    /// [`Failure::Checks`] if something failed.
    pub fn end(&self) -> Result<(), Failure> {
        for failure in &self.failures {
            println!("{FAILED}{failure}");
        }
        println!("{} passed, {} failed", self.passed, self.failed);
        match self.failed {
            0 => Ok(()),
            failed => Err(Failure::Checks { failed }),
        }
    }
}

/// What stands before each step that failed, behind all of them.
const FAILED: &str = "failed: ";

/// A part of the checks that runs in a process of its own.
pub struct Beside {
    part: &'static str,
    child: Child,
    log: PathBuf,
}

/// Passed and failed checks of the last line of a part.
fn totals(line: &str) -> Option<(usize, usize)> {
    let (passed, rest) = line.split_once(" passed, ")?;
    let failed = rest.strip_suffix(" failed")?;
    Some((passed.parse().ok()?, failed.parse().ok()?))
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
    use super::{Beside, Tally, counts, totals};
    use std::fs::File;
    use std::path::Path;
    use std::process::Command;

    /// A part that says this and ends with that status.
    fn part(folder: &Path, said: &str, status: &str) -> Beside {
        let log = folder.join("part.log");
        let child = Command::new("sh")
            .args(["-c", "printf %b \"$0\"; exit $1", said, status])
            .stdout(File::create(&log).unwrap())
            .spawn()
            .unwrap();
        Beside {
            part: "part",
            child,
            log,
        }
    }

    #[test]
    fn a_part_that_breaks_down_has_failed_whatever_it_counted() {
        let folder = std::env::temp_dir().join(format!("xtask-tally-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        for (said, status, passed, failures) in [
            ("3 passed, 0 failed\\n", "0", 3, &[][..]),
            ("3 passed, 0 failed\\n", "101", 3, &["part"]),
            ("failed: lints\\n3 passed, 1 failed\\n", "1", 3, &["lints"]),
            ("", "0", 0, &["part"]),
            ("thread 'main' panicked\\n", "101", 0, &["part"]),
        ] {
            let mut tally = Tally::default();
            tally.join(Ok(part(&folder, said, status)));
            assert_eq!(tally.passed, passed, "{said:?} {status}");
            assert_eq!(tally.failures, failures, "{said:?} {status}");
            assert_eq!(tally.failed, failures.len(), "{said:?} {status}");
            assert_eq!(
                tally.end().is_ok(),
                failures.is_empty(),
                "{said:?} {status}"
            );
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn the_last_line_of_a_part_is_counted() {
        assert_eq!(totals("12 passed, 3 failed"), Some((12, 3)));
        for line in [
            "",
            "12 passed",
            "xtask: 3 failed",
            "x passed, 3 failed",
            "1 passed, 2 failed.",
        ] {
            assert_eq!(totals(line), None, "{line}");
        }
    }

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
