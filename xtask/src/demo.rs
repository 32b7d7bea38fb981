//! `cargo xtask demo`: the main job, from a clean checkout to pictures of what the robot did.

use std::path::{Path, PathBuf};

use crate::firmware::{self, DEFAULT_BIN};
use crate::process::{self, Beside, Failure, make_folder};
use crate::setup::{self, Choice};

/// Where the demo's pictures and traces go, below the checkout.
const DEMO_FOLDER: &str = "target/demo";

/// Where the pictures of the first run go, which needs no emulator.
const HOST_FOLDER: &str = "target/demo-host";

/// Where what is done beside says what it does.
const LOGS_FOLDER: &str = "target/demo-logs";

/// Builds all that is needed, drives the robot through two missions, and tells where the pictures
/// are.
///
/// # Errors
/// [`Failure`]: what is missing, does not build, or did not go well.
pub fn command(root: &Path, choice: Choice) -> Result<(), Failure> {
    // Whatever is not there yet takes minutes, the first time. What moves comes as early as it can:
    // for the robot on the host board the command is enough, which is built first and with both
    // cores.
    println!("1/4 The command esm (the first time takes minutes)");
    let beside = |what, words: &[&str]| {
        let log = root.join(LOGS_FOLDER).join(format!("{}.log", words[0]));
        let mut command = process::this()?;
        command.current_dir(root).args(words);
        command.args(["--toolchain", choice.name()]);
        Beside::start(what, &mut command, log)
    };
    let set_up = beside("set-up: emulator and compiler for the board", &["setup"])?;
    process::run(&mut process::esm_build(root))?;
    println!("2/4 The robot on the host board: its firmware as a program of this machine");
    drive_on_host(root)?;
    println!("3/4 Firmware for the emulated board (the first time takes minutes)");
    set_up.wait()?;
    let toolchain = setup::toolchain(choice)?;
    let bins = [DEFAULT_BIN.to_owned()];
    firmware::build(root, &toolchain, firmware::RELEASE, &bins)?;
    println!(
        "4/4 The robot in the emulator: 60 s of patrol through the office, then, while it moves, 60 s along the walls"
    );
    let folder = drive(root)?;
    println!("\nPictures and trace are in {}:", folder.display());
    let mut files: Vec<_> = std::fs::read_dir(&folder)
        .map_err(|cause| Failure::File {
            path: folder.clone(),
            cause,
        })?
        .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
        .collect();
    files.sort();
    for file in files {
        println!("    {DEMO_FOLDER}/{file}");
    }
    Ok(())
}

/// Drives the robot's firmware on the host board, through one mission.
fn drive_on_host(root: &Path) -> Result<(), Failure> {
    let more = ["--world", "missions/worlds/office.world", "--board", "host"];
    let folder = drive_into(root, HOST_FOLDER, &more, &["--until", "60 s"])?;
    println!("    Pictures and trace are in {}", folder.display());
    Ok(())
}

/// Drives the robot through the two missions, with what was built before; returns where the
/// pictures are.
///
/// # Errors
/// [`Failure::Ended`] if the run did not go well.
pub fn drive(root: &Path) -> Result<PathBuf, Failure> {
    let world = ["--world", "missions/worlds/office.world"];
    let then = "60 s missions/follow_wall.esm";
    let times = ["--until", "120 s", "--then", then];
    drive_into(root, DEMO_FOLDER, &world, &times)
}

/// Drives the firmware without features through two missions, over its UART, for it has no other
/// line; returns where the summary is.
///
/// # Errors
/// [`Failure::Ended`] if the run did not go well.
pub fn drive_lean(root: &Path) -> Result<PathBuf, Failure> {
    let board = ["--link", "uart", "--firmware", firmware::LEAN_FILE];
    let then = "10 s missions/follow_wall.esm";
    let times = ["--until", "20 s", "--then", then];
    drive_into(root, "target/demo-lean", &board, &times)
}

/// Drives from patrol on, on a board and for times; what comes of it goes into a folder below the
/// checkout.
fn drive_into(
    root: &Path,
    folder: &str,
    board: &[&str],
    times: &[&str],
) -> Result<PathBuf, Failure> {
    let out = root.join(folder);
    make_folder(&out)?;
    let mut esm = process::command(root.join("target/release/esm"));
    esm.current_dir(root)
        .args(["run", "missions/patrol.esm"])
        .args(board)
        .args(times)
        .args(["--out", folder]);
    println!("    {}", process::shown(&esm));
    process::run(&mut esm)?;
    Ok(out)
}
