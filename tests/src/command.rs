//! The project from outside: the command `esm` as a process of its own, and robots that it starts.
//!
//! Nothing here is skipped where something is missing: a test that cannot find its firmware or
//! emulator fails, and says what to do.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use host_tools::link_client::LinkClient;
use host_tools::qemu::firmware::checkout_around;
use host_tools::serial::port::Port;
use host_tools::serial::{self, ByteLink, DEFAULT_BAUD, OpenError};
use tempfile::TempDir;

use crate::subject;

/// How long a command may take before it counts as hung. The longest drives the emulated board for
/// 120 s of robot time.
const PATIENCE: Duration = Duration::from_secs(600);

/// How long something may take that is a matter of a second or two, before it counts as hung.
const END_PATIENCE: Duration = Duration::from_secs(120);

/// How often a running command is looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(10);

/// Keeps tests away from robots and boards that whoever runs them has plugged in.
pub const NOTHING_PLUGGED_IN: [(&str, &str); 2] =
    [("ESM_PORTS", "only"), ("ESM_BOOT_DRIVE", "/no/such/drive")];

/// The top of the checkout: where commands run.
pub fn root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let here = std::env::current_dir().expect("there is a folder that tests run in");
        checkout_around(&here).expect("tests run inside the checkout")
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
    make(&[
        "xtask",
        "firmware",
        "--bin",
        "rover",
        "--bin",
        "faults",
        "--bin",
        "bench_bound",
    ]);
    elf("lm3s6965", name)
}

/// The default firmware of the board of that name, which is not the default one; its emulator is
/// installed if need be. Never older than its source.
///
/// # Panics
/// As [`firmware`].
pub fn chip_firmware(board: &str) -> PathBuf {
    make(&["xtask", "emulator", "--board", board]);
    make(&["xtask", "firmware", "--board", board]);
    elf(board, "rover")
}

/// The firmware of that board with a feature that its default one lacks, such as `links`. Never
/// older than its source.
///
/// # Panics
/// As [`firmware`].
pub fn firmware_with(board: &str, feature: &str) -> PathBuf {
    make(&["xtask", "firmware", "--board", board, "--with", feature]);
    elf(board, &format!("rover-{feature}"))
}

/// The firmware of the example of a robot with a file of its own. Never older than its source.
///
/// # Panics
/// As [`firmware`].
pub fn example_of_a_file() -> PathBuf {
    make(&["xtask", "firmware", "--robot", "examples/my_pico"]);
    elf("pico", "my_pico")
}

/// The default firmware built without its features, never older than its source.
///
/// # Panics
/// As [`firmware`].
pub fn lean_firmware() -> PathBuf {
    make(&["xtask", "firmware", "--lean"]);
    elf("lm3s6965", "rover-lean")
}

/// Where `cargo xtask firmware` leaves a firmware.
fn elf(board: &str, name: &str) -> PathBuf {
    root().join(format!("target/firmware/{board}/{name}.elf"))
}

/// Runs cargo at the top of the checkout, once for the same arguments: the source does not change
/// while tests run.
fn make(arguments: &[&str]) {
    static MADE: Mutex<Vec<String>> = Mutex::new(Vec::new());
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    let words = arguments.join(" ");
    if made.contains(&words) {
        return;
    }
    let mut cargo = Command::new("cargo");
    cargo
        .args(arguments)
        .current_dir(root())
        .stdout(Stdio::null());
    let status = spawn(&mut cargo).and_then(|mut cargo| cargo.wait());
    assert!(
        status.is_ok_and(|status| status.success()),
        "`cargo {words}` fails: see above. `cargo xtask test` finds or installs all that the tests need"
    );
    made.push(words);
}

/// The first number on the line of the summary that has the word.
pub fn figure(summary: &str, word: &str) -> Option<f64> {
    summary
        .lines()
        .find(|line| line.contains(word))?
        .split(|c: char| !(c.is_ascii_digit() || c == '.'))
        .find_map(|number| number.parse().ok())
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

/// [`esm`] with these variables in its environment.
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn esm_in<S: AsRef<str>>(environment: &[(&str, &str)], arguments: &[S]) -> Done {
    Running::esm_in(environment, arguments).done()
}

/// [`esm`] with at most so much memory: a command that wants more fails. Comes with its processor
/// time, as [`esm_timed`].
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn esm_within<S: AsRef<str>>(memory_mb: usize, arguments: &[S]) -> (Done, Duration) {
    // The shell counts in KiB.
    esm_in_shell(&format!("ulimit -v {}; ", memory_mb * 1_024), arguments)
}

/// [`esm`], with the processor time that it and what it started took: other programs do not
/// lengthen that, nor does a machine that stands still for a while.
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn esm_timed<S: AsRef<str>>(arguments: &[S]) -> (Done, Duration) {
    esm_in_shell("", arguments)
}

#[track_caller]
fn esm_in_shell<S: AsRef<str>>(before: &str, arguments: &[S]) -> (Done, Duration) {
    let times = tempfile::NamedTempFile::new().expect("a file for the time");
    let mut command = Command::new("sh");
    let esm = "\"$0\" \"$@\"; status=$?; times > \"$ESM_TIMES\"; exit $status";
    command
        .args(["-c", &format!("{before}{esm}")])
        .arg(esm_binary())
        .args(arguments.iter().map(AsRef::as_ref))
        .env("ESM_TIMES", times.path())
        .current_dir(root());
    let done = run(command);
    let times = std::fs::read_to_string(times.path()).unwrap_or_default();
    // The shell's own time stands in the first line, that of its children in the second: for
    // programs, and for the system.
    let of_children = times.lines().nth(1).unwrap_or_default();
    let took = of_children.split_whitespace().filter_map(|time| {
        let (minutes, seconds) = time.strip_suffix('s')?.split_once('m')?;
        Some(60.0 * minutes.parse::<f64>().ok()? + seconds.parse::<f64>().ok()?)
    });
    (done, Duration::from_secs_f64(took.sum()))
}

/// Runs a line as a shell does, in a folder, to its end. The command `esm` is on its path, and
/// cargo takes what has been built in the checkout.
///
/// # Panics
/// If it cannot be started or does not end.
#[track_caller]
pub fn shell(line: &str, folder: &Path) -> Done {
    let commands = esm_binary().parent().expect("it is in a folder");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::iter::once(commands.to_owned()).chain(std::env::split_paths(&path));
    let target = std::env::var_os("CARGO_TARGET_DIR");
    let mut command = Command::new("sh");
    command
        .args(["-c", line])
        .current_dir(folder)
        .env(
            "PATH",
            std::env::join_paths(paths).expect("paths without `:`"),
        )
        .env(
            "CARGO_TARGET_DIR",
            target.unwrap_or_else(|| root().join("target").into()),
        );
    run(command)
}

/// Runs a command to its end, with its output kept.
#[track_caller]
fn run(command: Command) -> Done {
    Running::of(command).done()
}

/// A command that runs while the test goes on. Dropping it kills it.
pub struct Running {
    command: Command,
    child: Child,
    // Files and not pipes: nobody has to read them while it runs.
    folder: TempDir,
}

impl Running {
    /// Starts `esm` at the top of the checkout.
    ///
    /// # Panics
    /// If it cannot be started.
    #[track_caller]
    pub fn esm<S: AsRef<str>>(arguments: &[S]) -> Self {
        Self::esm_with_temporary(&std::env::temp_dir(), arguments)
    }

    /// The same, with another folder for what is there for the time of the run.
    ///
    /// # Panics
    /// If it cannot be started.
    #[track_caller]
    pub fn esm_with_temporary<S: AsRef<str>>(folder: &Path, arguments: &[S]) -> Self {
        let mut command = Command::new(esm_binary());
        command.args(arguments.iter().map(AsRef::as_ref));
        command.current_dir(root()).env("TMPDIR", folder);
        Self::of(command)
    }

    /// [`Running::esm`] with these variables in its environment.
    ///
    /// # Panics
    /// If it cannot be started.
    #[track_caller]
    pub fn esm_in<S: AsRef<str>>(environment: &[(&str, &str)], arguments: &[S]) -> Self {
        let mut command = Command::new(esm_binary());
        command.args(arguments.iter().map(AsRef::as_ref));
        command
            .current_dir(root())
            .envs(environment.iter().copied());
        Self::of(command)
    }

    #[track_caller]
    fn of(mut command: Command) -> Self {
        for (name, value) in NOTHING_PLUGGED_IN {
            if command.get_envs().all(|(set, _)| set != name) {
                command.env(name, value);
            }
        }
        let folder = tempfile::tempdir().expect("a folder for output");
        let create = |name| File::create(folder.path().join(name)).expect("a file for output");
        command
            .stdin(Stdio::null())
            .stdout(create("out"))
            .stderr(create("err"));
        let child = spawn(&mut command);
        Running {
            child: child.unwrap_or_else(|error| panic!("{command:?} does not start: {error}")),
            command,
            folder,
        }
    }

    /// What it has written to standard output so far.
    pub fn out(&self) -> String {
        self.said("out")
    }

    /// What it has written to standard error so far.
    pub fn err(&self) -> String {
        self.said("err")
    }

    fn said(&self, name: &str) -> String {
        let said = std::fs::read(self.folder.path().join(name)).unwrap_or_default();
        String::from_utf8_lossy(&said).into_owned()
    }

    /// Waits until something has come of it.
    ///
    /// # Panics
    /// If it ends before, or if that takes too long.
    #[track_caller]
    pub fn until(mut self, what: &str, is_there: impl Fn(&Self) -> bool) -> Self {
        let deadline = Instant::now() + END_PATIENCE;
        while !is_there(&self) {
            let ended = self.child.try_wait();
            let goes_on = matches!(ended, Ok(None)) && Instant::now() < deadline;
            assert!(
                goes_on,
                "waited in vain for: {what}; {:?} ({ended:?})\n{}\n{}",
                self.command,
                self.out(),
                self.err()
            );
            std::thread::sleep(LOOK_INTERVAL);
        }
        self
    }

    /// Waits for the end.
    ///
    /// # Panics
    /// If it does not end.
    #[track_caller]
    pub fn finished(self) -> Done {
        self.done()
    }

    /// Whether it runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Does what Ctrl-C does, and waits for the end.
    ///
    /// # Panics
    /// If it has ended before.
    #[track_caller]
    pub fn interrupted(mut self) -> Done {
        let early = self.child.try_wait();
        let status = interrupt(&mut self.child);
        let done = self.ended_with(status);
        assert!(
            matches!(early, Ok(None)),
            "{:?} ended by itself: {done:#?}",
            self.command
        );
        done
    }

    #[track_caller]
    fn done(mut self) -> Done {
        let status = ended(&mut self.child, PATIENCE);
        if status.is_none() {
            interrupt(&mut self.child);
        }
        let done = self.ended_with(status);
        assert!(
            status.is_some(),
            "{:?} does not end: {done:#?}",
            self.command
        );
        done
    }

    fn ended_with(&self, status: Option<ExitStatus>) -> Done {
        Done {
            status: status.and_then(|status| status.code()),
            out: self.out(),
            err: self.err(),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs `esm` until it has said `word` on standard error, then does what Ctrl-C does.
///
/// # Panics
/// If it ends before, says that in no long time, or cannot be started.
#[track_caller]
pub fn esm_until<S: AsRef<str>>(word: &str, arguments: &[S]) -> Done {
    let running = Running::esm(arguments);
    let said = running.until(word, |running| running.err().contains(word));
    said.interrupted()
}

/// Held while a process is started: until it is the other program, it has a copy of all that is
/// open here, and a port that is open somewhere cannot be opened again.
static STARTING: Mutex<()> = Mutex::new(());

/// Lets nobody start a process, or [`open`] a port, for as long as the answer lives.
pub fn starting() -> MutexGuard<'static, ()> {
    STARTING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Starts a process.
///
/// # Errors
/// What the system says.
pub fn spawn(command: &mut Command) -> io::Result<Child> {
    let _starting = starting();
    command.spawn()
}

/// Opens a port which processes that this one has started have open now and then, too.
///
/// # Errors
/// As [`serial::open`].
pub fn open(port: &Port, baud: u32) -> Result<Box<dyn ByteLink>, OpenError> {
    let _starting = starting();
    serial::open(port, baud)
}

/// Waits for the end of a process.
fn ended(child: &mut Child, patience: Duration) -> Option<ExitStatus> {
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
fn interrupt(child: &mut Child) -> Option<ExitStatus> {
    signal(child.id(), "-INT");
    let status = ended(child, END_PATIENCE);
    if status.is_none() {
        let _ = child.kill();
        let _ = child.wait();
    }
    status
}

/// Sends a process a signal, by its name as `kill` takes it.
pub fn signal(process: u32, name: &str) {
    let mut kill = Command::new("kill");
    let kill = spawn(kill.args([name, &process.to_string()]));
    // One that has just ended is no reason to fail.
    let _ = kill.and_then(|mut kill| kill.wait());
}

/// Two boards in real time are as many as two cores can emulate with time to spare; one leaves room
/// for what the test itself does.
static ONE_EMULATOR: Mutex<()> = Mutex::new(());

/// A robot that `esm board` has started. Dropping it ends it. One of them at a time is on the
/// emulated board.
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
    /// Starts a robot on a board (`host` or `lm3s6965`), with the given firmware or the board's
    /// own, in the office.
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
        let mut child = spawn(&mut command).expect("`esm board` starts");
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

    /// Begins a session in this process.
    ///
    /// # Panics
    /// If the robot does not answer.
    #[track_caller]
    pub fn connect(&self) -> LinkClient<Box<dyn ByteLink>> {
        let port = self.port.parse().expect("`esm board` says a port");
        let line = open(&port, DEFAULT_BAUD).expect("the port is free");
        let (client, _) = LinkClient::connect(line).expect("the robot answers");
        client
    }

    /// Gives it a mission without a trial, which `esm upload` does not do: it stays, however long
    /// this machine takes over anything, and however soon it fails.
    ///
    /// # Panics
    /// If the mission is none, or the robot does not take it.
    #[track_caller]
    pub fn give(&self, mission: &Path) {
        let built = subject::build_file(mission).expect("a mission");
        let given = self.connect().upload(&built.blob, &mut |_| ());
        given.expect("the robot takes it");
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
