//! What somebody sees who types `cargo xtask demo` in a fresh checkout. Cargo, rustup, the emulator
//! and `esm` are scripts that take as long as they are told and write down when they are started.

#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod common;

use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use common::{Folder, xtask};

/// How long the scripts take which stand for builds and installations.
const BUILD_S: &str = "2";

/// Longer than anything here takes, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A fresh checkout with scripts for all that the demo starts; they note what they do in the file
/// `events`.
fn fresh(name: &str) -> Folder {
    let checkout = Folder::checkout(name);
    let script = |name: &str, text: &str| {
        let path = checkout.write(
            name,
            &format!("#!/bin/sh\ntop={}\n{text}", checkout.0.display()),
        );
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    };
    checkout.write("boards/lm3s6965/board.toml", "");
    script("tools/qemu-system-arm", "echo QEMU emulator version 0\n");
    script(
        "tools/rustup",
        &format!(
            "echo set-up begins >> $top/events; sleep {BUILD_S}; echo set-up done >> $top/events\n\
             echo thumbv7m-none-eabi\n"
        ),
    );
    script("esm", "echo \"esm $*\" >> $top/events\n");
    let elf = "target/firmware-build/thumbv7m-none-eabi/release";
    script(
        "tools/cargo",
        &format!(
            "case \"$*\" in\n\
             *host-tools*) echo command begins >> $top/events; echo Compiling esm >&2; sleep {BUILD_S}\n\
             \x20 mkdir -p $top/target/release; cp $top/esm $top/target/release/esm\n\
             \x20 echo command done >> $top/events;;\n\
             *rover*) sleep {BUILD_S}; mkdir -p $top/{elf}; echo > $top/{elf}/rover\n\
             \x20 echo firmware >> $top/events;;\n\
             esac\n"
        ),
    );
    checkout
}

fn demo(checkout: &Folder) -> Command {
    let tools = checkout.0.join("tools");
    let path = std::env::var("PATH").unwrap();
    let mut demo = xtask(&checkout.0, &["demo"]);
    demo.env("PATH", format!("{}:{path}", tools.display()))
        .env("CARGO", tools.join("cargo"))
        .env_remove("ESM_TOOLCHAIN")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    demo
}

/// What the scripts have noted.
fn events(checkout: &Folder) -> String {
    std::fs::read_to_string(checkout.0.join("events")).unwrap_or_default()
}

/// Ends a process when the test ends.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn it_says_at_once_what_it_does_and_something_moves_before_the_firmware_is_built() {
    let checkout = fresh("demo-moves");
    let mut child = Ended(demo(&checkout).spawn().unwrap());
    let mut out = BufReader::new(child.0.stdout.take().unwrap());
    let mut said = String::new();
    out.read_line(&mut said).unwrap();
    // However busy this machine is, the first line comes before the first build has ended.
    assert!(!events(&checkout).contains("command done"), "{said}");
    assert!(said.starts_with("1/4 The command esm"), "{said}");
    out.read_to_string(&mut said).unwrap();
    let mut errors = String::new();
    let mut err = child.0.stderr.take().unwrap();
    err.read_to_string(&mut errors).unwrap();
    assert!(child.0.wait().unwrap().success(), "{said}{errors}");
    // What cargo says is shown.
    assert!(errors.contains("Compiling esm"), "{errors}");
    let events = events(&checkout);
    let place = |what: &str| {
        let found = events.find(what);
        found.unwrap_or_else(|| panic!("no {what}: {events}"))
    };
    // Set-up goes on beside the first build, and the robot on the host board waits for that build
    // alone.
    assert!(place("command begins") < place("set-up done"), "{events}");
    assert!(
        place("esm run missions/patrol.esm --world") < place("firmware"),
        "{events}"
    );
    assert!(place("--board host") < place("firmware"), "{events}");
    assert!(place("firmware") < place("--then"), "{events}");
    for heading in [
        "2/4 ",
        "3/4 ",
        "4/4 ",
        "set-up: emulator and compiler for the board: done",
    ] {
        assert!(said.contains(heading), "no {heading}: {said}");
    }
}

#[test]
fn nothing_goes_on_after_it_has_been_ended() {
    let checkout = fresh("demo-ended");
    let mut child = Ended(demo(&checkout).spawn().unwrap());
    let begun = Instant::now();
    while events(&checkout).lines().count() < 2 {
        assert!(begun.elapsed() < PATIENCE, "it does not begin");
        std::thread::sleep(Duration::from_millis(10));
    }
    let process = child.0.id().to_string();
    let signal = Command::new("kill").args(["-TERM", &process]).status();
    assert!(signal.unwrap().success());
    assert!(!child.0.wait().unwrap().success());
    // What was started has ended, too: nobody writes down that it is done.
    std::thread::sleep(Duration::from_secs(4));
    assert!(!events(&checkout).contains("done"), "{}", events(&checkout));
}

#[test]
fn set_up_that_fails_is_told_with_all_that_it_said() {
    let checkout = fresh("demo-set-up");
    checkout.write("tools/rustup", "#!/bin/sh\nexit 1\n");
    // A system without packages and without another compiler.
    let mut demo = demo(&checkout);
    demo.env("ESM_TOOLCHAIN", "rustup");
    let output = demo.output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}{errors}");
    assert!(
        said.contains("rustup target add thumbv7m-none-eabi"),
        "{said}"
    );
    assert!(errors.contains("xtask setup"), "{errors}");
    // The robot on the host board has been seen by then.
    assert!(events(&checkout).contains("--board host"));
}

/// The aliases of `.cargo/config.toml` build for minutes the first time, and say so.
#[test]
fn no_alias_hides_what_cargo_builds() {
    let aliases = std::fs::read_to_string("../.cargo/config.toml").unwrap();
    for line in aliases.lines().filter(|line| line.contains(" = \"run ")) {
        assert!(!line.contains("--quiet") && !line.contains("-q "), "{line}");
    }
}
