//! `cargo xtask demo`: the main job, from a clean checkout to pictures of what the robot did.

use std::path::{Path, PathBuf};

use crate::firmware::{self, DEFAULT_BIN};
use crate::process::{self, Failure, make_folder};
use crate::setup::{self, Choice, host_cargo};

/// Where the demo's pictures and traces go, below the checkout.
const DEMO_FOLDER: &str = "target/demo";

/// Builds all that is needed, drives the robot through two missions, and tells where the pictures are.
///
/// # Errors
/// [`Failure`]: what is missing, does not build, or did not go well.
pub fn command(root: &Path, choice: Choice) -> Result<(), Failure> {
    println!("1/4 Set-up");
    setup::emulator()?;
    let toolchain = setup::toolchain(choice)?;
    println!("2/4 Firmware for the emulated board");
    firmware::build(
        root,
        &toolchain,
        firmware::RELEASE,
        &[DEFAULT_BIN.to_owned()],
    )?;
    println!("3/4 The command esm (the first time takes minutes)");
    let mut cargo = process::command(host_cargo());
    cargo.current_dir(root).args([
        "build",
        "--release",
        "--package",
        "host-tools",
        "--bin",
        "esm",
    ]);
    process::run(&mut cargo)?;
    println!(
        "4/4 The robot: 60 s of patrol through the office, then, while it moves, 60 s along the walls"
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

/// Drives the robot through the two missions, with what was built before; returns where the pictures are.
///
/// # Errors
/// [`Failure::Ended`] if the run did not go well.
pub fn drive(root: &Path) -> Result<PathBuf, Failure> {
    let world = ["--world", "missions/worlds/office.world"];
    let times = ["120 s", "60 s missions/follow_wall.esm"];
    drive_into(root, DEMO_FOLDER, times, &world)
}

/// Drives the firmware without features through two missions, over its UART, for it has no other line; returns where the summary is.
///
/// # Errors
/// [`Failure::Ended`] if the run did not go well.
pub fn drive_lean(root: &Path) -> Result<PathBuf, Failure> {
    let board = ["--link", "uart", "--firmware", firmware::LEAN_FILE];
    let times = ["20 s", "10 s missions/follow_wall.esm"];
    drive_into(root, "target/demo-lean", times, &board)
}

/// Drives from patrol on until a time and with another mission from a time on; what comes of it goes into a folder below the checkout.
fn drive_into(
    root: &Path,
    folder: &str,
    [until, then]: [&str; 2],
    more: &[&str],
) -> Result<PathBuf, Failure> {
    let out = root.join(folder);
    make_folder(&out)?;
    let mut esm = process::command(root.join("target/release/esm"));
    esm.current_dir(root)
        .args(["run", "missions/patrol.esm"])
        .args(more)
        .args(["--until", until, "--then", then])
        .args(["--out", folder]);
    println!("    {}", process::shown(&esm));
    process::run(&mut esm)?;
    Ok(out)
}
