//! Running other programs: told before, timed, and never left behind.

use std::ffi::OsStr;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Why a command of ours ended badly.
#[derive(Debug)]
pub enum Failure {
    /// The command line was wrong.
    Usage(String),
    /// The working directory is in no checkout.
    NoCheckout {
        /// The working directory.
        folder: PathBuf,
    },
    /// Something is missing that this program may not or cannot install.
    Missing {
        /// What is missing.
        what: String,
        /// The command that installs it, to be run by the user.
        command: String,
    },
    /// A program could not be started.
    Start {
        /// The program and its arguments.
        command: String,
        /// What the system says.
        cause: io::Error,
    },
    /// A program ended with another status than 0.
    Ended {
        /// The program and its arguments.
        command: String,
        /// How it ended.
        status: ExitStatus,
    },
    /// A program failed, or took too long.
    Within {
        /// The program and its arguments.
        command: String,
        /// How long it may take.
        limit: Duration,
    },
    /// A file could not be read or written.
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// A file does not hold what it should.
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A table of mutants does not fit the source or its tests.
    Mutant {
        /// The table and its line.
        place: String,
        /// What is wrong.
        problem: String,
    },
    /// Figures are not what was promised of them; the report says which.
    Promises,
    /// Checks did not hold; they were told one by one.
    Checks {
        /// How many.
        failed: usize,
    },
}

impl Failure {
    /// The exit status that tells of it: 1 where what was checked is not so, 2 where this program
    /// was called wrongly, 3 where something outside failed.
    pub fn status(&self) -> u8 {
        match self {
            Failure::Usage(_) => 2,
            Failure::NoCheckout { .. }
            | Failure::Missing { .. }
            | Failure::Start { .. }
            | Failure::Within { .. }
            | Failure::File { .. } => 3,
            Failure::Ended { status, .. } => match status.code() {
                Some(2) => 2,
                Some(3) => 3,
                _ => 1,
            },
            Failure::Content { .. }
            | Failure::Mutant { .. }
            | Failure::Promises
            | Failure::Checks { .. } => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Usage(problem) => to.write_str(problem),
            Failure::NoCheckout { folder } => write!(
                to,
                "{} is not inside a checkout of esm: no folder from there upwards has xtask/src/main.rs. \
                 Change to a checkout and run this again.",
                folder.display()
            ),
            Failure::Missing { what, command } => {
                write!(
                    to,
                    "{what} is missing. Install it with:\n\n    {command}\n\nand run this again."
                )
            }
            Failure::Start { command, cause } => write!(to, "cannot start `{command}`: {cause}"),
            Failure::Ended { command, status } => write!(to, "`{command}` failed ({status})"),
            Failure::Within { command, limit } => write!(
                to,
                "`{command}` failed, or took longer than {} s",
                limit.as_secs()
            ),
            Failure::File { path, cause } => write!(to, "{}: {cause}", path.display()),
            Failure::Content { path, problem } => write!(to, "{}: {problem}", path.display()),
            Failure::Mutant { place, problem } => write!(to, "{place}: {problem}"),
            Failure::Promises => to.write_str("a promise does not hold"),
            Failure::Checks { failed } => write!(to, "{failed} failed"),
        }
    }
}

/// A command for `program` that ends with this process, whatever ends it. (A terminal's Ctrl-C
/// reaches both by itself; `setpriv`, where it is installed, has the system end the child if only
/// this process is ended.)
pub fn command(program: impl AsRef<OsStr>) -> Command {
    if find_program("setpriv").is_none() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--pdeathsig", "TERM"]).arg(program);
    command
}

/// This program once more, in a process of its own.
///
/// # Errors
/// [`Failure::Start`] if the system does not say which it is.
pub fn this() -> Result<Command, Failure> {
    let this = std::env::current_exe().map_err(|cause| Failure::Start {
        command: "xtask".to_owned(),
        cause,
    })?;
    Ok(command(this))
}

/// The cargo that runs this program, for all that is built for the host.
pub fn host_cargo() -> String {
    std::env::var("CARGO").unwrap_or_else(|_| "cargo".into())
}

/// The host's cargo in `folder`.
pub fn cargo(folder: &Path) -> Command {
    let mut cargo = command(host_cargo());
    cargo.current_dir(folder);
    cargo
}

/// A build of the command `esm` as users have it, optimised.
pub fn esm_build(root: &Path) -> Command {
    const PROGRAM: [&str; 4] = ["--package", "host-tools", "--bin", "esm"];
    let mut build = cargo(root);
    build.args(["build", "--release"]).args(PROGRAM);
    build
}

/// The command as a person would type it.
pub fn shown(command: &Command) -> String {
    let mut words: Vec<_> = std::iter::once(command.get_program())
        .chain(command.get_args())
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    if words.starts_with(&["setpriv".into(), "--pdeathsig".into()]) {
        words.drain(..3);
    }
    words.join(" ")
}

/// Runs `command` with this process's terminal.
///
/// # Errors
/// [`Failure::Start`], [`Failure::Ended`].
pub fn run(command: &mut Command) -> Result<(), Failure> {
    let status = command.status().map_err(|cause| Failure::Start {
        command: shown(command),
        cause,
    })?;
    if status.success() {
        Ok(())
    } else {
        Err(Failure::Ended {
            command: shown(command),
            status,
        })
    }
}

/// What `command` prints to standard output. The rest goes to this process's terminal, unless
/// `quiet`.
///
/// # Errors
/// [`Failure::Start`], [`Failure::Ended`].
pub fn printed(command: &mut Command, quiet: bool) -> Result<String, Failure> {
    let rest = if quiet {
        Stdio::null()
    } else {
        Stdio::inherit()
    };
    let output = command
        .stderr(rest)
        .output()
        .map_err(|cause| Failure::Start {
            command: shown(command),
            cause,
        })?;
    if output.status.success() {
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    } else {
        Err(Failure::Ended {
            command: shown(command),
            status: output.status,
        })
    }
}

/// What `command` prints to standard output; `None` if it cannot be started or fails.
pub fn output(command: &mut Command) -> Option<String> {
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Runs `command` for at most `limit`; whether it ended well in that time. One that did not end is
/// ended.
pub fn run_within(command: &mut Command, limit: Duration) -> bool {
    const LOOK_INTERVAL: Duration = Duration::from_millis(50);
    let Ok(mut child) = command.stdin(Stdio::null()).spawn() else {
        return false;
    };
    let deadline = Instant::now() + limit;
    while Instant::now() < deadline {
        match child.try_wait() {
            Ok(None) => std::thread::sleep(LOOK_INTERVAL),
            Ok(Some(status)) => return status.success(),
            Err(_) => break,
        }
    }
    let _ = child.kill();
    let _ = child.wait();
    false
}

/// A program that runs beside what is done meanwhile, and writes what it says to a file.
pub struct Beside {
    /// What it does, for whoever waits for it.
    what: &'static str,
    command: String,
    child: Child,
    log: PathBuf,
    started: Instant,
}

impl Beside {
    /// How often whoever waits is told that it goes on.
    const TELL_INTERVAL: Duration = Duration::from_secs(10);

    /// Starts `command`, which says what it says to the file `log`.
    ///
    /// # Errors
    /// [`Failure::File`], [`Failure::Start`].
    pub fn start(what: &'static str, command: &mut Command, log: PathBuf) -> Result<Self, Failure> {
        let child = spawn_into(command, &log)?;
        println!("    ({what}, meanwhile: {})", shown_path(&log));
        Ok(Beside {
            what,
            command: shown(command),
            child,
            log,
            started: Instant::now(),
        })
    }

    /// Waits for its end, and tells now and then how far it is; if it failed, all that it said.
    ///
    /// # Errors
    /// [`Failure::Ended`] if it ended badly.
    pub fn wait(mut self) -> Result<(), Failure> {
        const LOOK_INTERVAL: Duration = Duration::from_millis(50);
        let mut told = Instant::now();
        let status = loop {
            match self.child.try_wait() {
                Ok(None) => std::thread::sleep(LOOK_INTERVAL),
                Ok(Some(status)) => break status,
                Err(cause) => {
                    let command = self.command.clone();
                    return Err(Failure::Start { command, cause });
                }
            }
            if told.elapsed() >= Self::TELL_INTERVAL {
                told = Instant::now();
                println!("{}", self.progress());
            }
        };
        let seconds = self.started.elapsed().as_secs_f32();
        if status.success() {
            println!("    {}: done ({seconds:.0} s)", self.what);
            return Ok(());
        }
        print!("{}", self.said());
        Err(Failure::Ended {
            command: self.command.clone(),
            status,
        })
    }

    /// One line: what it does, for how long, and the last that it said.
    fn progress(&self) -> String {
        let said = self.said();
        let last = said.lines().map(str::trim).rfind(|line| !line.is_empty());
        let seconds = self.started.elapsed().as_secs_f32();
        let last = last.unwrap_or_default();
        format!("    {}: {seconds:.0} s, {last}", self.what)
    }

    fn said(&self) -> String {
        let said = std::fs::read(&self.log).unwrap_or_default();
        String::from_utf8_lossy(&said).into_owned()
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        // Asked, so that it ends what it has started itself. One that has ended is no reason to
        // fail.
        if let Ok(None) = self.child.try_wait() {
            let process = self.child.id().to_string();
            let _ = Command::new("kill").args(["-TERM", &process]).status();
            let _ = self.child.wait();
        }
    }
}

/// Starts `command` with what it says going to the file `log`, without a terminal to ask.
///
/// # Errors
/// [`Failure::File`], [`Failure::Start`].
pub fn spawn_into(command: &mut Command, log: &Path) -> Result<Child, Failure> {
    let of_log = |cause| Failure::File {
        path: log.to_owned(),
        cause,
    };
    if let Some(folder) = log.parent() {
        make_folder(folder)?;
    }
    let out = File::create(log).map_err(of_log)?;
    let errors = out.try_clone().map_err(of_log)?;
    command.stdin(Stdio::null()).stdout(out).stderr(errors);
    command.spawn().map_err(|cause| Failure::Start {
        command: shown(command),
        cause,
    })
}

/// A path as a person in the working directory would type it.
fn shown_path(path: &Path) -> String {
    let here = std::env::current_dir().unwrap_or_default();
    let path = path.strip_prefix(&here).unwrap_or(path);
    path.display().to_string()
}

/// Where `program` is on the search path; a link that leads nowhere is no program.
pub fn find_program(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|candidate| candidate.is_file())
}

/// Makes `folder` and those above it.
///
/// # Errors
/// [`Failure::File`].
pub fn make_folder(folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|cause| Failure::File {
        path: folder.to_owned(),
        cause,
    })
}
