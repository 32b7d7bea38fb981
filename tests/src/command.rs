//! The project from outside: the command `esm` as a process of its own, and robots that it starts.
//!
//! Nothing here is skipped where something is missing: a test that cannot find its firmware or emulator fails, and says what to do.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// How long a command may take before it counts as hung. The longest drives the emulated board for 120 s of robot time.
const PATIENCE: Duration = Duration::from_secs(240);

/// How long a command may take to end after it was asked to.
const END_PATIENCE: Duration = Duration::from_secs(20);

/// How often a running command is looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// The top of the checkout: where commands run.
pub fn root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        here.parent().unwrap_or(here).to_owned()
    })
}

/// The command `esm`, optimised, and never older than its source.
pub fn esm_binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        make(&[
            "build",
            "--quiet",
            "--release",
            "--package",
            "host-tools",
            "--bin",
            "esm",
        ]);
        let target = std::env::var_os("CARGO_TARGET_DIR");
        let target = target.map_or_else(|| root().join("target"), PathBuf::from);
        target.join("release/esm")
    })
}

/// The firmware of that name for the emulated board, never older than its source.
///
/// # Panics
/// If it does not build; what `cargo xtask firmware` said is above.
pub fn firmware(name: &str) -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    BUILT.get_or_init(|| {
        make(&[
            "xtask",
            "firmware",
            "--bin",
            "rover",
            "--bin",
            "faults",
            "--bin",
            "bench_bound",
        ])
    });
    root().join(format!("target/firmware/lm3s6965/{name}.elf"))
}

/// The default firmware built without its features, never older than its source.
///
/// # Panics
/// As [`firmware`].
pub fn lean_firmware() -> PathBuf {
    static BUILT: OnceLock<()> = OnceLock::new();
    BUILT.get_or_init(|| make(&["xtask", "firmware", "--lean"]));
    root().join("target/firmware/lm3s6965/rover-lean.elf")
}

/// Runs cargo at the top of the checkout.
fn make(arguments: &[&str]) {
    let status = Command::new("cargo")
        .args(arguments)
        .current_dir(root())
        .stdout(Stdio::null())
        .status();
    assert!(
        status.is_ok_and(|status| status.success()),
        "`cargo {}` fails: see above. `cargo xtask test` finds or installs all that the tests need",
        arguments.join(" ")
    );
}

/// A command that has ended.
#[derive(Debug)]
pub struct Done {
    /// Its exit status; none where a signal ended it.
    pub status: Option<i32>,
    /// What it wrote to standard output.
    pub out: String,
    /// What it wrote to standard error.
    pub err: String,
    /// How long it took.
    pub took: Duration,
}

impl Done {
    /// The command, which is to have succeeded.
    ///
    /// # Panics
    /// If its exit status is another than 0.
    #[track_caller]
    pub fn good(self) -> Self {
        assert_eq!(self.status, Some(0), "{self:#?}");
        self
    }

    /// The command, which is to have ended with this status.
    ///
    /// # Panics
    /// If it has another one.
    #[track_caller]
    pub fn ended(self, status: i32) -> Self {
        assert_eq!(self.status, Some(status), "{self:#?}");
        self
    }

    /// Standard output as one JSON value.
    ///
    /// # Panics
    /// If it is none.
    #[track_caller]
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {self:#?}"))
    }
}

/// Runs `esm` at the top of the checkout, to its end.
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn esm<S: AsRef<str>>(arguments: &[S]) -> Done {
    let mut command = Command::new(esm_binary());
    command.args(arguments.iter().map(AsRef::as_ref));
    command.current_dir(root());
    run(command)
}

/// [`esm`] with at most so much memory: a command that wants more fails. Comes with the processor time that it took, which other programs do not lengthen.
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn esm_within<S: AsRef<str>>(memory_mb: usize, arguments: &[S]) -> (Done, Duration) {
    let times = tempfile::NamedTempFile::new().expect("a file for the time");
    let mut command = Command::new("sh");
    // The shell counts in KiB.
    let limit = memory_mb * 1_024;
    command
        .args([
            "-c",
            &format!(
                "ulimit -v {limit}; \"$0\" \"$@\"; status=$?; times > \"$ESM_TIMES\"; exit $status"
            ),
        ])
        .arg(esm_binary())
        .args(arguments.iter().map(AsRef::as_ref))
        .env("ESM_TIMES", times.path())
        .current_dir(root());
    let done = run(command);
    let times = std::fs::read_to_string(times.path()).unwrap_or_default();
    // The shell's own time stands in the first line, that of its children in the second: for programs, and for the system.
    let of_children = times.lines().nth(1).unwrap_or_default();
    let took = of_children.split_whitespace().filter_map(|time| {
        let (minutes, seconds) = time.strip_suffix('s')?.split_once('m')?;
        Some(60.0 * minutes.parse::<f64>().ok()? + seconds.parse::<f64>().ok()?)
    });
    (done, Duration::from_secs_f64(took.sum()))
}

/// Runs a command to its end, with its output kept.
#[track_caller]
fn run(mut command: Command) -> Done {
    // Files and not pipes: nobody has to read them while it runs.
    let folder = tempfile::tempdir().expect("a folder for output");
    let (out, err) = (folder.path().join("out"), folder.path().join("err"));
    let create = |path: &Path| File::create(path).expect("a file for output");
    command
        .stdin(Stdio::null())
        .stdout(create(&out))
        .stderr(create(&err));
    let started = Instant::now();
    let mut child = command
        .spawn()
        .unwrap_or_else(|error| panic!("{command:?} does not start: {error}"));
    let status = ended(&mut child, PATIENCE);
    let read = |path: &Path| {
        String::from_utf8_lossy(&std::fs::read(path).unwrap_or_default()).into_owned()
    };
    let Some(status) = status else {
        interrupt(&mut child);
        panic!("{command:?} does not end\n{}\n{}", read(&out), read(&err));
    };
    Done {
        status: status.code(),
        out: read(&out),
        err: read(&err),
        took: started.elapsed(),
    }
}

/// Runs `esm` for a time, then does what Ctrl-C does.
///
/// # Panics
/// If it ends before, or cannot be started.
#[track_caller]
pub fn esm_for<S: AsRef<str>>(time: Duration, arguments: &[S]) -> Done {
    let out = tempfile::NamedTempFile::new().expect("a file for output");
    let err = tempfile::NamedTempFile::new().expect("a file for output");
    let mut command = Command::new(esm_binary());
    command
        .args(arguments.iter().map(AsRef::as_ref))
        .current_dir(root())
        .stdin(Stdio::null())
        .stdout(out.reopen().expect("a file for output"))
        .stderr(err.reopen().expect("a file for output"));
    let started = Instant::now();
    let mut child = command.spawn().expect("`esm` starts");
    let early = ended(&mut child, time);
    let status = interrupt(&mut child);
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
    let done = Done {
        status: status.and_then(|status| status.code()),
        out: read(out.path()),
        err: read(err.path()),
        took: started.elapsed(),
    };
    assert!(early.is_none(), "{command:?} ended by itself: {done:#?}");
    done
}

/// Runs `esm` until it has said `word` on standard error, then does what Ctrl-C does.
///
/// # Panics
/// If it ends before, says that in no long time, or cannot be started.
#[track_caller]
pub fn esm_until<S: AsRef<str>>(word: &str, arguments: &[S]) -> Done {
    let out = tempfile::NamedTempFile::new().expect("a file for output");
    let err = tempfile::NamedTempFile::new().expect("a file for output");
    let read = |path: &Path| std::fs::read_to_string(path).unwrap_or_default();
    let started = Instant::now();
    let mut child = Command::new(esm_binary())
        .args(arguments.iter().map(AsRef::as_ref))
        .current_dir(root())
        .stdin(Stdio::null())
        .stdout(out.reopen().expect("a file for output"))
        .stderr(err.reopen().expect("a file for output"))
        .spawn()
        .expect("`esm` starts");
    let mut early = None;
    while early.is_none() && started.elapsed() < PATIENCE && !read(err.path()).contains(word) {
        early = ended(&mut child, LOOK_INTERVAL);
    }
    let status = interrupt(&mut child);
    let done = Done {
        status: status.and_then(|status| status.code()),
        out: read(out.path()),
        err: read(err.path()),
        took: started.elapsed(),
    };
    let said = done.err.contains(word);
    assert!(said && early.is_none(), "{early:?}, {word:?}: {done:#?}");
    done
}

/// Runs `esm` for a time, then kills it as `kill -9` does: it has no say in it.
///
/// # Panics
/// If it ends before, or cannot be started.
#[track_caller]
pub fn esm_killed_after<S: AsRef<str>>(time: Duration, arguments: &[S]) {
    let mut command = Command::new(esm_binary());
    command
        .args(arguments.iter().map(AsRef::as_ref))
        .current_dir(root())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut child = command.spawn().expect("`esm` starts");
    let early = ended(&mut child, time);
    let _ = child.kill();
    let _ = child.wait();
    assert!(early.is_none(), "{command:?} ended by itself: {early:?}");
}

/// Waits for the end of a process.
fn ended(child: &mut Child, patience: Duration) -> Option<std::process::ExitStatus> {
    let deadline = Instant::now() + patience;
    while Instant::now() < deadline {
        if let Ok(Some(status)) = child.try_wait() {
            return Some(status);
        }
        std::thread::sleep(LOOK_INTERVAL);
    }
    None
}

/// Does what Ctrl-C does, and takes care that the process ends.
fn interrupt(child: &mut Child) -> Option<std::process::ExitStatus> {
    let _ = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    let status = ended(child, END_PATIENCE);
    if status.is_none() {
        let _ = child.kill();
        let _ = child.wait();
    }
    status
}

/// Two boards in real time are as many as two cores can emulate with time to spare; one leaves room for what the test itself does.
static ONE_EMULATOR: Mutex<()> = Mutex::new(());

/// A robot that `esm board` has started. Dropping it ends it. One of them at a time is on the emulated board.
pub struct Robot {
    child: Child,
    /// Where `esm board --estop` reads.
    keys: Option<ChildStdin>,
    port: String,
    /// Kept open: a command whose reader has gone may end.
    _out: BufReader<ChildStdout>,
    _emulator: Option<MutexGuard<'static, ()>>,
}

impl Robot {
    /// Starts a robot on a board (`host` or `lm3s6965`), with the given firmware or the board's own, in the office.
    ///
    /// # Panics
    /// If it does not say its port.
    pub fn start(board: &str, firmware: Option<&Path>) -> Self {
        Self::start_with(board, firmware, &[])
    }

    /// The same, with further arguments of `esm board`.
    ///
    /// # Panics
    /// If it does not say its port.
    pub fn start_with(board: &str, firmware: Option<&Path>, arguments: &[&str]) -> Self {
        // A test that failed meanwhile is no reason to fail, too.
        let emulator =
            (board != "host").then(|| ONE_EMULATOR.lock().unwrap_or_else(PoisonError::into_inner));
        let mut command = Command::new(esm_binary());
        command
            .current_dir(root())
            .args(["board", "--board", board])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        if board != "host" {
            let own = self::firmware("rover");
            command.arg("--firmware").arg(firmware.unwrap_or(&own));
        }
        let mut child = command.spawn().expect("`esm board` starts");
        let mut line = String::new();
        let out = child.stdout.take().expect("standard output is piped");
        let mut out = BufReader::new(out);
        out.read_line(&mut line)
            .expect("standard output can be read");
        let port = line
            .strip_prefix("the robot is at ")
            .and_then(|rest| rest.split(';').next())
            .unwrap_or_else(|| panic!("`esm board` says no port, but `{line}`"))
            .to_owned();
        Robot {
            keys: child.stdin.take(),
            child,
            port,
            _out: out,
            _emulator: emulator,
        }
    }

    /// Its port, as `--port` takes it.
    pub fn port(&self) -> &str {
        &self.port
    }

    /// Presses the Enter key of its terminal.
    ///
    /// # Panics
    /// If it has ended.
    pub fn press_enter(&mut self) {
        let keys = self.keys.as_mut().expect("standard input is piped");
        keys.write_all(b"\n").expect("the board reads");
    }

    /// Runs `esm` with arguments and the robot's port.
    #[track_caller]
    pub fn esm(&self, arguments: &[&str]) -> Done {
        esm(&[arguments, &["--port", &self.port]].concat())
    }

    /// What `esm status --json` says.
    #[track_caller]
    pub fn status(&self) -> serde_json::Value {
        self.esm(&["status", "--json"]).good().json()
    }

    /// Asks for the status until it is as wanted, and gives it.
    ///
    /// # Panics
    /// If that takes too long.
    #[track_caller]
    pub fn status_when(
        &self,
        what: &str,
        wanted: impl Fn(&serde_json::Value) -> bool,
    ) -> serde_json::Value {
        let deadline = Instant::now() + END_PATIENCE;
        loop {
            let status = self.status();
            if wanted(&status) {
                return status;
            }
            assert!(
                Instant::now() < deadline,
                "waited in vain for: {what}; the robot says {status:#}"
            );
            std::thread::sleep(LOOK_INTERVAL * 10);
        }
    }

    /// Ends it as Ctrl-C does; gives its exit status.
    pub fn end(mut self) -> Option<i32> {
        interrupt(&mut self.child).and_then(|status| status.code())
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        match self.child.try_wait() {
            Ok(None) => {
                interrupt(&mut self.child);
            }
            // Whatever the test waited for, this is the reason.
            ended => eprintln!("`esm board` has ended by itself: {ended:?}"),
        }
    }
}
