//! `cargo xtask bench`: figures that are measured, not checked.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::elf;
use crate::firmware;
use crate::process::{self, Failure};
use crate::setup::{self, BOARD_TARGET, Choice, Toolchain};

/// What the program that measures must be given.
#[derive(Clone, Copy)]
enum Needs {
    /// Nothing: it holds what it measures, and is optimised itself.
    Nothing,
    /// This firmware of the default board.
    Firmware(&'static str),
    /// The programs of the workspace in [`MACHINES_FOLDER`]. It makes their inputs and reads what they tell.
    Machines,
}

/// What can be measured, in which package the program for it is, and what that needs.
const BENCHES: [(&str, &str, Needs); 5] = [
    ("machines", "esm-tests", Needs::Machines),
    ("schedule", "host-tools", Needs::Nothing),
    ("dispatch", "esm-tests", Needs::Firmware("bench_dispatch")),
    ("day", "esm-tests", Needs::Nothing),
    ("idle", "esm-tests", Needs::Firmware("bench_idle")),
];

/// The workspace of the machines that are compared.
pub const MACHINES_FOLDER: &str = "benches";
/// Where they are built.
pub const MACHINES_TARGET: &str = "target/benches";
/// The programs for the board whose sizes are told; the one beside them is only run.
const MACHINES_SIZED: [&str; 6] = [
    "empty",
    "by_hand",
    "rust_fsm",
    "statig",
    "smlang",
    "esm_alone",
];
/// What the settings for speed and for size are called, and their profiles.
const MACHINES_PROFILES: [(&str, &str); 2] = [("fast", "release"), ("small", "small")];

/// Builds the program that measures `name` and runs it; all other arguments are its own.
///
/// # Errors
/// If there is no such program, or it fails.
pub fn command(root: &Path, mut arguments: impl Iterator<Item = String>) -> Result<(), Failure> {
    let names = BENCHES.map(|(name, ..)| name).join(", ");
    let name = arguments
        .next()
        .ok_or_else(|| Failure::Usage(format!("bench needs to know what to measure: {names}")))?;
    let (name, package, needs) = BENCHES
        .into_iter()
        .find(|(known, ..)| *known == name)
        .ok_or_else(|| Failure::Usage(format!("bench {name}: there is {names}")))?;
    let mut given = Vec::new();
    let mut profile = "bench";
    match needs {
        Needs::Nothing => {}
        Needs::Firmware(bin) => {
            setup::emulator()?;
            let toolchain = setup::toolchain(Choice::from_environment()?)?;
            let files = firmware::build(root, &toolchain, firmware::RELEASE, &[bin.to_owned()])?;
            given.extend(files.into_iter().map(PathBuf::into_os_string));
        }
        Needs::Machines => {
            setup::emulator()?;
            setup::valgrind()?;
            let toolchain = setup::toolchain(Choice::from_environment()?)?;
            given.extend(machines(root, &toolchain)?);
            profile = "dev";
        }
    }
    process::run(
        Command::new(setup::host_cargo())
            .current_dir(root)
            .args(["bench", "--quiet", "--profile", profile])
            .args(["--package", package, "--bench", name, "--"])
            .args(given)
            .args(arguments),
    )
}

/// Builds the machines that are compared, for the host and for the board; returns what the program that runs them is told.
fn machines(root: &Path, toolchain: &Toolchain) -> Result<Vec<OsString>, Failure> {
    let folder = root.join(MACHINES_FOLDER);
    let target = root.join(MACHINES_TARGET);
    println!("Building the machines that are compared (the first time takes minutes) …");
    process::run(
        Command::new(setup::host_cargo())
            .current_dir(&folder)
            .args([
                "build",
                "--quiet",
                "--release",
                "--package",
                "bench-host",
                "--target-dir",
            ])
            .arg(&target),
    )?;
    let told = |key: &str, value: &OsStr| {
        let mut argument = OsString::from(format!("{key}="));
        argument.push(value);
        argument
    };
    let mut arguments = vec![
        told("host", target.join("release/bench-host").as_os_str()),
        told("compiler", toolchain.rustc_version().as_ref()),
    ];
    for (setting, profile) in MACHINES_PROFILES {
        process::run(
            toolchain
                .cargo(&folder)
                .args(["build", "--quiet", "--profile", profile])
                .args(["--package", "bench-cortex-m4", "--target", BOARD_TARGET])
                .args(toolchain.core_from_source())
                .arg("--target-dir")
                .arg(&target),
        )?;
        let programs = target.join(BOARD_TARGET).join(profile);
        for program in MACHINES_SIZED {
            let path = programs.join(program);
            let bytes = std::fs::read(&path).map_err(|cause| Failure::File {
                path: path.clone(),
                cause,
            })?;
            let image = elf::read(&bytes).ok_or(Failure::Content {
                path,
                problem: "is no firmware (32-bit little-endian ELF)",
            })?;
            let size = image.flash_bytes().to_string();
            arguments.push(told(&format!("flash-{setting}-{program}"), size.as_ref()));
        }
        arguments.push(told(setting, programs.as_os_str()));
    }
    Ok(arguments)
}
