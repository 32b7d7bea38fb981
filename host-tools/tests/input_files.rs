//! Files that commands read: what is no file, or has no end, is told at once, whichever command is
//! to read it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// How long a command may take to say what is wrong: a matter of milliseconds.
const PATIENCE: Duration = Duration::from_secs(20);

/// The most memory that a command may have, in KiB. The whole file is read where it is one.
const MOST_MEMORY_KIB: u64 = 2 << 20;

/// Commands, with `{}` in the place of the file and `@` in that of a folder to write to.
const COMMANDS: [&str; 31] = [
    "check {}",
    "fmt {}",
    "fmt --check {}",
    "build {} -o @/out",
    "bound {}",
    "draw {} -o @/out.svg",
    "inspect {}",
    "diff {} missions/patrol.esm",
    "diff missions/patrol.esm {}",
    "schedule {}",
    "sim {} missions/patrol/drive.scenario",
    "sim missions/patrol.esm {}",
    "test {}",
    "run {} --board host --until 1s",
    "run missions/patrol.esm --board host --until 1s --world {}",
    "run missions/patrol.esm --board host --until 1s --flash {}",
    "run missions/patrol.esm --board host --replay {}",
    "run missions/patrol.esm --board lm3s6965 --until 1s --firmware {}",
    "bench missions {} --until 1s --seeds 1",
    "bench missions missions/patrol.esm --until 1s --seeds 1 --world {}",
    "board --board host --world {}",
    "board --board host --flash {}",
    "board --board lm3s6965 --firmware {}",
    "replay {}",
    "replay {} --step",
    "replay {} --expect missions/patrol.esm",
    "odometry {} --ticks-per-rev 1440 --wheel-radius-mm 32.3 --base-mm 160",
    "umbmark {} --side-mm 1000 --base-mm 160",
    "upload {} --port unix:@/nobody",
    "key show --key {}",
    "tasks --board lm3s6965 --firmware {}",
];

/// What is no file, by a name that says how it is told.
fn not_files(folder: &Path) -> [(String, &'static str); 4] {
    let pipe = folder.join("pipe.esm");
    let mode = nix::sys::stat::Mode::S_IRUSR | nix::sys::stat::Mode::S_IWUSR;
    nix::unistd::mkfifo(&pipe, mode).unwrap();
    let link = folder.join("link.esm");
    std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    [
        ("/dev/zero".into(), "a device"),
        ("/dev/tty".into(), "a device"),
        (text(&link), "a device"),
        (text(&pipe), "a pipe"),
    ]
}

/// Runs a command to its end, which is to come soon. Answers its exit status and what it said on
/// standard error.
#[track_caller]
fn esm(arguments: &str, folder: &Path) -> (Option<i32>, String) {
    let err = folder.join("err");
    // The shell counts in KiB.
    let mut command = Command::new("sh");
    command
        .args([
            "-c",
            &format!("ulimit -v {MOST_MEMORY_KIB}; exec \"$0\" \"$@\""),
        ])
        .arg(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(arguments.split_whitespace())
        .current_dir("..")
        .env_remove("ESM_KEY")
        .env_remove("ESM_FIRMWARE")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&err).unwrap());
    let mut child = Killed(command.spawn().unwrap());
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.0.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < PATIENCE, "esm {arguments} does not end");
        sleep(Duration::from_millis(2));
    };
    (status.code(), std::fs::read_to_string(err).unwrap())
}

/// A process that is killed in the end.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs all commands with something in the place of their file, each of which is to say one of
/// these things of it and to fail.
#[track_caller]
fn assert_told(path: &str, told: &[&str], folder: &Path) {
    let place = folder.to_str().unwrap();
    let mut wrong = Vec::new();
    for command in COMMANDS {
        let arguments = command.replace("{}", path).replace('@', place);
        let (status, err) = esm(&arguments, folder);
        let is_told = told.iter().any(|told| err.contains(told));
        if !is_told || !matches!(status, Some(1..=3)) {
            wrong.push(format!("esm {arguments}: {status:?} {err}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// What `esm test` says, which takes folders, too.
const NO_SCENARIO: &str = "is neither a folder nor a scenario";

#[test]
fn what_is_no_file_is_told_by_each_command_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    for (path, what) in not_files(folder.path()) {
        let told = [what, "is not a file", NO_SCENARIO];
        assert_told(&path, &told, folder.path());
    }
    // A scenario in a folder, and a mission that another one uses.
    let [scenario, user] = ["pipe.scenario", "user.esm"].map(|name| folder.path().join(name));
    fs::rename(folder.path().join("pipe.esm"), &scenario).unwrap();
    let (status, err) = esm(&format!("test {}", scenario.display()), folder.path());
    assert!(
        status == Some(1) && err.contains("a pipe"),
        "{status:?} {err}"
    );
    fs::write(&user, "use \"pipe.scenario\"\n").unwrap();
    let (status, err) = esm(&format!("check {}", user.display()), folder.path());
    assert!(
        status == Some(1) && err.contains("not a file"),
        "{status:?} {err}"
    );
}

#[test]
fn a_file_that_is_too_long_is_told_with_its_limit() {
    let folder = tempfile::tempdir().unwrap();
    let long = folder.path().join("long.esm");
    // With holes: it takes no room.
    let file = File::create(&long).unwrap();
    file.set_len(64 << 30).unwrap();
    // A key that others may read is told as such.
    file.set_permissions(fs::Permissions::from_mode(0o600))
        .unwrap();
    let told = [
        "longer than",
        "at most",
        "is no key",
        "is no flash",
        NO_SCENARIO,
    ];
    assert_told(long.to_str().unwrap(), &told, folder.path());
}
