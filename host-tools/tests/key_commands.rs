//! `esm key`, and the commands that need one, as processes: what they do to a robot, and that
//! nothing they print has the private part of a key.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use host_tools::host_board::{self, HostBoard};
use host_tools::keys::SigningKey;
use host_tools::link_client::LinkClient;
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::flash::Flash;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::run::board::Board;
use host_tools::serial::pty::PtyServer;
use host_tools::world::World;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// Runs `esm` in `home`, and keeps all that it says in `heard`.
fn esm(home: &Path, heard: &mut Vec<u8>, arguments: &[&str]) -> (i32, String, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(arguments)
        .current_dir("..")
        .env("XDG_CONFIG_HOME", home)
        .env_remove("ESM_KEY")
        .env("RUST_BACKTRACE", "full")
        .output()
        .unwrap();
    heard.extend(&stdout);
    heard.extend(&stderr);
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}

/// Base64 of some bytes, without what fills up its end.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks_exact(3) {
        let bits = chunk
            .iter()
            .fold(0u32, |bits, byte| bits << 8 | u32::from(*byte));
        for shift in [18, 12, 6, 0] {
            text.push(char::from(DIGITS[(bits >> shift) as usize & 63]));
        }
    }
    text
}

#[test]
fn base64_is_what_others_take_for_it() {
    assert_eq!(base64(b"foobar"), "Zm9vYmFy");
}

#[test]
fn a_key_locks_a_robot_and_is_printed_nowhere() {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(true), None);
    let (_board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
    let server = PtyServer::start(Box::new(line)).unwrap();
    let port = server.path().display().to_string();
    let home = tempfile::tempdir().unwrap();
    let other = home.path().join("other.key").display().to_string();
    let mut heard = Vec::new();
    let mut run = |arguments: &[&str]| {
        let mut all = arguments.to_vec();
        if arguments[0] != "key" || ["install", "remove"].contains(&arguments[1]) {
            all.extend(["--port", &port]);
        }
        esm(home.path(), &mut heard, &all)
    };
    const OPEN: &str = "this robot takes commands from anyone: `esm key install`\n";

    let (status, _, told) = run(&["key", "install"]);
    assert_eq!(status, 3);
    assert!(told.contains("`esm key new -o "), "{told}");
    assert_eq!(run(&["key", "new"]).0, 0);
    let (status, _, told) = run(&["key", "new"]);
    assert!(status == 3 && told.contains("already"), "{told}");
    assert_eq!(run(&["key", "new", "-o", &other]).0, 0);

    // Without a key everyone may. That is told where a mission is given, and not with each command.
    for arguments in [
        &["upload", "missions/patrol.esm"][..],
        &["status"],
        &["start"],
        &["stop"],
    ] {
        let (status, _, told) = run(arguments);
        assert_eq!(status, 0, "{arguments:?}: {told}");
        let is_told = arguments[0] == "upload";
        assert_eq!(told.contains(OPEN), is_told, "{arguments:?}: {told}");
    }
    let (status, told, _) = run(&["key", "install"]);
    assert!(status == 0 && told.starts_with("installed: "), "{told}");

    // With it: its owner may, and needs to say nothing.
    for (arguments, expected) in [
        (&["start"][..], 0),
        (&["upload", "missions/follow_wall.esm", "--json"], 0),
        (&["status", "--json"], 0),
        (&["start", "--key", &other], 1),
        (&["upload", "missions/patrol.esm", "--key", &other], 1),
        // Who names a key counts on it.
        (&["stop", "--key", &other], 1),
        (&["status", "--key", &other], 1),
        (&["start", "--key", "/nowhere"], 3),
        (&["key", "install", "--key", &other], 1),
        (&["key", "remove", "--key", &other], 1),
        (&["start"], 0),
        (&["key", "show"], 0),
        (&["key", "show", "--json", "--key", &other], 0),
        (&["key", "install"], 0),
    ] {
        let (status, said, told) = run(arguments);
        assert_eq!(status, expected, "{arguments:?}: {said}{told}");
        assert!(!told.contains(OPEN), "{arguments:?}: {told}");
    }
    // A key that others may read is none.
    let file = home.path().join("esm").join("key");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).unwrap();
    let (status, _, told) = run(&["start"]);
    assert!(status == 3 && told.contains("chmod 600"), "{told}");
    fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
    let present = file.display().to_string();
    let replace = ["key", "install", "--key", &other, "--present", &present];
    assert_eq!(run(&replace).0, 0);
    assert_eq!(run(&["start"]).0, 1);
    assert_eq!(run(&["key", "remove", "--key", &other]).0, 0);
    assert_eq!(run(&["start"]).0, 0);

    // All of that, and no part of a private key in it.
    for path in [&present, &other] {
        hold_no_key_of(Path::new(path), &heard);
    }
}

/// Asserts that no part of the private key in a file is in what was heard, in any form that it
/// might be printed in.
fn hold_no_key_of(path: &Path, heard: &[u8]) {
    let text = fs::read_to_string(path).unwrap();
    let hex = text.trim_end().strip_prefix("esm-key-1 ").unwrap();
    let private: Vec<u8> = hex
        .as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect();
    assert_eq!(private.len(), 32);
    assert!(
        !heard
            .windows(6)
            .any(|bytes| private.windows(6).any(|part| part == bytes)),
        "as it is"
    );
    let heard = String::from_utf8_lossy(heard).to_lowercase();
    for part in 0..3 {
        let in_base64 = base64(&private[part..]).to_lowercase();
        assert!(!heard.contains(&in_base64[..12]), "base64");
    }
    for start in (0..hex.len() - 12).step_by(2) {
        assert!(!heard.contains(&hex[start..start + 12]), "hex");
    }
    let printed = format!("{private:?}");
    assert!(!heard.contains(&printed[..30]), "a list");
}

/// A flash whose robot has the key in a file.
fn flash_with_key(home: &Path, key: &str) -> PathBuf {
    let path = home.join("robot.flash");
    let flash = Flash::open(
        &path,
        Board::Host {
            robot: host_board::rover,
        }
        .flash_bytes(),
    )
    .unwrap();
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
    let plant = PlantSide::new(plant, Pace::new(true), None).with_flash(Some(flash));
    let (_board, line) = HostBoard::start(host_board::rover, plant, None).unwrap();
    let (mut robot, _) = LinkClient::connect(line).unwrap();
    let key = SigningKey::read(Path::new(key)).unwrap();
    robot.install_key(&key).unwrap();
    path
}

#[test]
fn a_run_with_a_flash_that_has_a_key_is_signed_or_says_what_to_do() {
    let home = tempfile::tempdir().unwrap();
    let file = |name: &str| home.path().join(name).display().to_string();
    let (key, other) = (file("mine.key"), file("other.key"));
    let mut heard = vec![];
    for path in [&key, &other] {
        assert_eq!(
            esm(home.path(), &mut heard, &["key", "new", "-o", path]).0,
            0
        );
    }
    let flash = flash_with_key(home.path(), &key).display().to_string();
    let run = [
        "run",
        "missions/patrol.esm",
        "--board",
        "host",
        "--until",
        "2 s",
        "--flash",
        &flash,
    ];
    for (key, expected, words) in [
        (Some(&key), 0, ""),
        (Some(&other), 1, "`--key FILE` and ESM_KEY name another"),
        (None, 3, "`--key FILE` and ESM_KEY name another"),
        (Some(&key), 0, ""),
    ] {
        let mut arguments = run.to_vec();
        if let Some(key) = key {
            arguments.extend(["--key", key]);
        }
        let (status, _, told) = esm(home.path(), &mut heard, &arguments);
        assert_eq!(status, expected, "{key:?}: {told}");
        assert!(told.contains(words), "{key:?}: {told}");
    }
    for path in [&key, &other] {
        hold_no_key_of(Path::new(path), &heard);
    }
}

#[test]
fn a_panic_with_a_key_at_hand_says_nothing_of_it() {
    const VARIABLE: &str = "ESM_TEST_PANICS_WITH_KEY";
    if let Some(path) = std::env::var_os(VARIABLE) {
        let key = SigningKey::read(Path::new(&path)).unwrap();
        let message = [&b"message"[..]];
        let signature = key.sign(&message);
        panic!(
            "all that is at hand is printed: {:?}",
            (&key, signature.len())
        );
    }
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("a.key");
    let _ = SigningKey::create(&path).unwrap();
    let Output {
        stdout,
        stderr,
        status,
    } = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "a_panic_with_a_key_at_hand_says_nothing_of_it",
            "--nocapture",
        ])
        .env(VARIABLE, &path)
        .env("RUST_BACKTRACE", "full")
        .output()
        .unwrap();
    assert!(!status.success());
    let heard = [stdout, stderr].concat();
    let said = String::from_utf8_lossy(&heard);
    assert!(
        said.contains("all that is at hand") && said.contains("SigningKey("),
        "{said}"
    );
    hold_no_key_of(&path, &heard);
}

/// Sends Ctrl-C, and again where the first one came before the command listened: a program that is
/// started in the background may inherit that the system ignores it.
fn press_until_it_ends(child: &mut Child) {
    const PAUSE: Duration = Duration::from_secs(2);
    const LOOK: Duration = Duration::from_millis(10);
    loop {
        kill(Pid::from_raw(child.id() as i32), Signal::SIGINT).unwrap();
        let pressed = Instant::now();
        while pressed.elapsed() < PAUSE {
            if child.try_wait().unwrap().is_some() {
                return;
            }
            std::thread::sleep(LOOK);
        }
    }
}

#[test]
fn ctrl_c_in_a_signed_upload_says_nothing_of_the_key() {
    let home = tempfile::tempdir().unwrap();
    let key = home.path().join("mine.key");
    let _ = SigningKey::create(&key).unwrap();
    let name = key.display().to_string();
    let flash = flash_with_key(home.path(), &name).display().to_string();
    let mut heard = vec![];
    // In the upload, while a signature is on its way, as it happens; and in the run behind it, when
    // that has something to tell.
    for after_ms in [Some(5), Some(60), Some(150), None] {
        let mut child = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
            .args([
                "run",
                "missions/patrol.esm",
                "--board",
                "host",
                "--realtime",
                "--until",
                "60 s",
            ])
            .args(["--flash", &flash, "--key", &name])
            .current_dir("..")
            .env("RUST_BACKTRACE", "full")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        match after_ms {
            Some(ms) => std::thread::sleep(Duration::from_millis(ms)),
            None => {
                out.read_until(b'\n', &mut heard).unwrap();
            }
        }
        press_until_it_ends(&mut child);
        out.read_to_end(&mut heard).unwrap();
        heard.extend(child.wait_with_output().unwrap().stderr);
    }
    assert!(!heard.is_empty());
    let said = String::from_utf8_lossy(&heard);
    assert!(
        !said.contains(" 60.000 s"),
        "what happens is told when it happens, also where no terminal is: {said}"
    );
    hold_no_key_of(&key, &heard);
}
