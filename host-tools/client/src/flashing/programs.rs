//! Programs of others that bring a firmware onto a board.

use std::env;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use thiserror::Error;

use crate::interrupt;

/// How long a program may take. A flash of 16 MiB is written within a minute or two.
const LONGEST_RUN: Duration = Duration::from_secs(300);

/// How often is looked whether it has ended, or Ctrl-C came.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);

/// How long it may take to end behind Ctrl-C, which it has heard, too.
const LAST_WAIT: Duration = Duration::from_millis(500);

/// What is told of what a program that failed has said: its last bytes.
const TOLD_BYTES: u64 = 2 << 10;

/// Why a program did not do what it was to do.
#[derive(Debug, Error)]
pub enum ProgramError {
    /// It is not there.
    #[error("there is no program `{program}` on the PATH; {how}")]
    Missing {
        /// Its name.
        program: &'static str,
        /// How to get it.
        how: &'static str,
    },
    /// The system cannot start it.
    #[error("`{line}` cannot be started: {cause}")]
    Start {
        /// Its command line.
        line: String,
        /// What the system says.
        cause: io::Error,
    },
    /// It failed.
    #[error("`{line}` failed ({status}){}", told(.said))]
    Failed {
        /// Its command line.
        line: String,
        /// How it ended.
        status: ExitStatus,
        /// The last that it said.
        said: String,
    },
    /// It does not end.
    #[error("`{line}` was ended: it took more than {} s", LONGEST_RUN.as_secs())]
    TooLong {
        /// Its command line.
        line: String,
    },
    /// Ctrl-C came.
    #[error(
        "interrupted; `{line}` was ended: the board may have a part of its firmware, flash it again"
    )]
    Interrupted {
        /// Its command line.
        line: String,
    },
}

fn told(said: &str) -> String {
    match said {
        "" => String::new(),
        said => format!("; it says:\n{said}"),
    }
}

/// A program on the `PATH`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    name: &'static str,
    path: PathBuf,
}

impl Program {
    /// The program of this name, if it is there.
    pub fn find(name: &'static str) -> Option<Self> {
        Self::find_in(name, &env::var_os("PATH")?)
    }

    fn find_in(name: &'static str, folders: &OsStr) -> Option<Self> {
        const EXECUTABLE: u32 = 0o111;
        let is_program = |path: &PathBuf| {
            fs::metadata(path)
                .is_ok_and(|found| found.is_file() && found.permissions().mode() & EXECUTABLE != 0)
        };
        let mut paths = env::split_paths(folders).map(|folder| folder.join(name));
        let path = paths.find(is_program)?;
        Some(Program { name, path })
    }

    /// Runs it to its end.
    ///
    /// # Errors
    /// [`ProgramError`]
    pub fn run(&self, arguments: &[&str], file: Option<&Path>) -> Result<(), ProgramError> {
        let mut line = [&[self.name], arguments].concat().join(" ");
        if let Some(file) = file {
            line += &format!(" {}", file.display());
        }
        let start = |cause| ProgramError::Start {
            line: line.clone(),
            cause,
        };
        // A file and not a pipe: nobody has to read it while the program runs.
        let mut output = tempfile::tempfile().map_err(start)?;
        let to = |output: &File| output.try_clone().map(Stdio::from);
        let mut child = Command::new(&self.path)
            .args(arguments)
            .args(file)
            .stdin(Stdio::null())
            .stdout(to(&output).map_err(start)?)
            .stderr(to(&output).map_err(start)?)
            .spawn()
            .map_err(start)?;
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().map_err(start)? {
                break status;
            }
            if interrupt::is_requested() {
                end(&mut child, LAST_WAIT);
                return Err(ProgramError::Interrupted { line });
            }
            if begun.elapsed() >= LONGEST_RUN {
                end(&mut child, Duration::ZERO);
                return Err(ProgramError::TooLong { line });
            }
            thread::sleep(LOOK_INTERVAL);
        };
        match status.success() {
            true => Ok(()),
            // Ctrl-C of a terminal ends the program, too.
            false if interrupt::is_requested() => Err(ProgramError::Interrupted { line }),
            false => Err(ProgramError::Failed {
                said: last_of(&mut output).unwrap_or_default(),
                line,
                status,
            }),
        }
    }
}

/// Ends a program that has so much time to end by itself.
fn end(child: &mut Child, grace: Duration) {
    let begun = Instant::now();
    while begun.elapsed() < grace && matches!(child.try_wait(), Ok(None)) {
        thread::sleep(LOOK_INTERVAL);
    }
    // One that has ended is no reason to fail.
    let _ = child.kill();
    let _ = child.wait();
}

/// The last lines that a program has said.
fn last_of(output: &mut File) -> io::Result<String> {
    let length = output.seek(SeekFrom::End(0))?;
    output.seek(SeekFrom::Start(length.saturating_sub(TOLD_BYTES)))?;
    let mut said = Vec::new();
    output.take(TOLD_BYTES).read_to_end(&mut said)?;
    Ok(String::from_utf8_lossy(&said).trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_fails_is_told_with_what_it_said() {
        let shell = Program::find("sh").unwrap();
        assert!(shell.run(&["-c", "exit 0"], None).is_ok());
        let failed = shell.run(&["-c", "echo no probe >&2; exit 7"], None);
        let told = failed.unwrap_err().to_string();
        assert!(
            told.contains("sh -c") && told.ends_with("no probe"),
            "{told}"
        );
    }

    #[test]
    fn a_file_that_is_no_program_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picotool");
        let found = || Program::find_in("picotool", folder.path().as_os_str());
        assert_eq!(found(), None);
        fs::write(&path, "#!/bin/sh\n").unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).unwrap();
        assert_eq!(found(), None);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(found().map(|program| program.path), Some(path));
    }
}
