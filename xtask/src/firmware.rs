//! Building firmware for the board.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::process::{self, Failure, make_folder};
use crate::setup::{self, BOARD_TARGET, Toolchain};

/// The default board: nothing else outside of `boards/` names one, but `memory.x`.
macro_rules! default_board {
    () => {
        "lm3s6965"
    };
}

/// The folder of the default board.
pub const BOARD_FOLDER: &str = concat!("boards/", default_board!());

/// What the default board runs.
pub const DEFAULT_BIN: &str = "rover";

/// The firmware with tasks that misbehave, for the tests.
pub const FAULTS_BIN: &str = "faults";

/// The firmware that counts instructions of macro steps, for a test and for
/// `cargo xtask bench bound`.
pub const BOUND_BIN: &str = "bench_bound";

/// The example of a robot outside the workspace, and its firmware.
pub const EXAMPLE_FOLDER: &str = "examples/my_robot";
/// See [`EXAMPLE_FOLDER`].
pub const EXAMPLE_FIRMWARE_FOLDER: &str = "examples/my_robot/firmware";
/// The profile of firmware that is to be run.
pub const RELEASE: &str = "release";

/// The profile of the firmware without features: everything is compiled for size.
pub const LEAN: &str = "lean";

/// The profile of the programs that the interpreter's size is measured with.
pub const SIZE: &str = "size";

/// The default board.
pub const DEFAULT_BOARD: &str = default_board!();

/// Where the finished firmware of each board goes, in a folder of the board's name, below the
/// checkout.
const FIRMWARE_FOLDER: &str = "target/firmware";

/// The default firmware without its features, below the checkout.
pub const LEAN_FILE: &str = concat!("target/firmware/", default_board!(), "/rover-lean.elf");

/// Where cargo builds it: one folder for the board and the example, which have most crates in
/// common.
pub const BUILD_FOLDER: &str = "target/firmware-build";

/// Builds the board's `bins` with a profile of its `Cargo.toml`; returns where each ELF file is.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build(
    root: &Path,
    toolchain: &Toolchain,
    profile: &str,
    bins: &[String],
) -> Result<Vec<PathBuf>, Failure> {
    let folder = root.join(BOARD_FOLDER);
    build_in(
        root,
        &folder,
        DEFAULT,
        toolchain,
        profile,
        bins,
        Features::Default,
    )
}

/// Builds `bins` for the board of that name; returns where each ELF file is.
///
/// # Errors
/// [`Failure`]: there is no such board, or what did not build.
pub fn build_for(
    root: &Path,
    board: &str,
    toolchain: &Toolchain,
    bins: &[String],
) -> Result<Vec<PathBuf>, Failure> {
    build_on(
        root,
        &root.join("boards").join(board),
        board,
        toolchain,
        bins,
    )
}

/// Builds the default firmware of the board of that name for a part of silicon, where what is built
/// without a word is for an emulator; returns where its ELF file is.
///
/// # Errors
/// [`Failure`]: there is no such board, its firmware is the same for both, or what did not build.
pub fn build_hardware(
    root: &Path,
    board: &str,
    toolchain: &Toolchain,
) -> Result<Vec<PathBuf>, Failure> {
    let folder = root.join("boards").join(board);
    let file = folder.join("board.toml");
    let target = setting(&folder, "target")?;
    let text = std::fs::read_to_string(&file).map_err(|cause| Failure::File {
        path: file.clone(),
        cause,
    })?;
    let Some(features) = quoted_in(&text, "hardware", "features") else {
        return Err(Failure::Usage(format!(
            "the board {board} has one firmware: leave --hardware out"
        )));
    };
    if target != BOARD_TARGET {
        setup::another_target(toolchain, &target)?;
    }
    let for_board = Board {
        name: board,
        target: &target,
    };
    let bins = [DEFAULT_BIN.to_owned()];
    let features = Features::Hardware(&features);
    build_in(
        root, &folder, for_board, toolchain, RELEASE, &bins, features,
    )
}

/// Builds `bins` of the crate in `folder` for the board of that name.
fn build_on(
    root: &Path,
    folder: &Path,
    board: &str,
    toolchain: &Toolchain,
    bins: &[String],
) -> Result<Vec<PathBuf>, Failure> {
    let target = setting(&root.join("boards").join(board), "target")?;
    if target != BOARD_TARGET {
        setup::another_target(toolchain, &target)?;
    }
    let for_board = Board {
        name: board,
        target: &target,
    };
    let features = Features::Default;
    build_in(root, folder, for_board, toolchain, RELEASE, bins, features)
}

/// The names of all boards.
///
/// # Errors
/// [`Failure::File`]: their folder cannot be read.
pub fn boards(root: &Path) -> Result<Vec<String>, Failure> {
    let folder = root.join("boards");
    let entries = std::fs::read_dir(&folder).map_err(|cause| Failure::File {
        path: folder.clone(),
        cause,
    })?;
    let boards = entries
        .flatten()
        .filter(|entry| entry.path().join("board.toml").is_file());
    let names = boards.filter_map(|entry| entry.file_name().into_string().ok());
    let mut names: Vec<String> = names.collect();
    names.sort();
    Ok(names)
}

/// Whether firmware is put onto the board: no emulator is all of it.
///
/// # Errors
/// [`Failure::File`]: its file cannot be read.
pub fn is_flashed(root: &Path, board: &str) -> Result<bool, Failure> {
    let path = root.join("boards").join(board).join("board.toml");
    let text = std::fs::read_to_string(&path).map_err(|cause| Failure::File { path, cause })?;
    Ok(text.contains("\n[flashing]\n"))
}

/// The text between quotes behind `key = ` in a file of settings.
pub fn quoted(text: &str, key: &str) -> Option<String> {
    let mut values = text.lines().filter_map(|line| line.split_once(" = "));
    let (_, value) = values.find(|(name, _)| *name == key)?;
    value.split('"').nth(1).map(str::to_owned)
}

/// The same in a section of the file.
fn quoted_in(text: &str, section: &str, key: &str) -> Option<String> {
    let (_, rest) = text.split_once(&format!("\n[{section}]\n"))?;
    quoted(rest.split("\n[").next()?, key)
}

/// A text of a board's `board.toml`.
fn setting(folder: &Path, key: &str) -> Result<String, Failure> {
    let file = folder.join("board.toml");
    let Ok(text) = std::fs::read_to_string(&file) else {
        return Err(Failure::Usage(format!(
            "there is no board {}: boards/ has a folder for each",
            folder.file_name().unwrap_or_default().display()
        )));
    };
    quoted(&text, key).ok_or(Failure::Content {
        path: file,
        problem: "lacks a setting that every board has",
    })
}

/// Builds the board's default firmware without its features; returns where its ELF file is.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build_lean(root: &Path, toolchain: &Toolchain) -> Result<Vec<PathBuf>, Failure> {
    build_in(
        root,
        &root.join(BOARD_FOLDER),
        DEFAULT,
        toolchain,
        LEAN,
        &[DEFAULT_BIN.to_owned()],
        Features::None,
    )
}

/// Builds the board's default firmware with a feature that it lacks by default; returns where its
/// ELF file is.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build_with(
    root: &Path,
    feature: &str,
    toolchain: &Toolchain,
) -> Result<Vec<PathBuf>, Failure> {
    build_in(
        root,
        &root.join(BOARD_FOLDER),
        DEFAULT,
        toolchain,
        RELEASE,
        &[DEFAULT_BIN.to_owned()],
        Features::With(feature),
    )
}

/// Builds the example's firmware; returns where its ELF file is.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build_example(root: &Path, toolchain: &Toolchain) -> Result<Vec<PathBuf>, Failure> {
    build_robot(root, &root.join(EXAMPLE_FOLDER), toolchain, &[])
}

/// What a robot measures and which pin is what, in the robot's folder.
const ROBOT_FILE: &str = "robot.toml";

/// Builds the firmware of a robot outside the workspace, as `esm new robot` makes one; returns
/// where each ELF file is. Its manifest names board and program. The robot's file, where there is
/// one, goes beside the firmware, for the emulator.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build_robot(
    root: &Path,
    robot: &Path,
    toolchain: &Toolchain,
    bins: &[String],
) -> Result<Vec<PathBuf>, Failure> {
    let folder = robot.join("firmware");
    let manifest = folder.join("Cargo.toml");
    let Ok(text) = std::fs::read_to_string(&manifest) else {
        return Err(Failure::Content {
            path: robot.to_owned(),
            problem: "is no robot with firmware: it has no firmware/Cargo.toml, as what `esm new robot` makes has",
        });
    };
    let section = |name: &str| text.split_once(name).map(|(_, section)| section);
    let board = section("[package.metadata.esm]\n").and_then(|it| quoted(it, "board"));
    let program = section("[[bin]]\n").and_then(|it| quoted(it, "name"));
    let (Some(board), Some(program)) = (board, program) else {
        return Err(Failure::Content {
            path: manifest,
            problem: "needs `[package.metadata.esm]` with `board = \"…\"`, and `[[bin]]` with `name = \"…\"`",
        });
    };
    let program = [program];
    let bins = if bins.is_empty() { &program } else { bins };
    let built = build_on(root, &folder, &board, toolchain, bins)?;
    let file = robot.join(ROBOT_FILE);
    if file.is_file() {
        for firmware in &built {
            let beside = firmware.with_extension("toml");
            std::fs::copy(&file, &beside).map_err(|cause| Failure::File {
                path: beside,
                cause,
            })?;
        }
    }
    Ok(built)
}

/// Runs clippy on the crate in `folder` with warnings as errors.
///
/// # Errors
/// [`Failure::Ended`] if it found something.
pub fn lint(root: &Path, folder: &Path, toolchain: &Toolchain) -> Result<(), Failure> {
    // A firmware for a part of silicon has code that the others have not.
    let text = std::fs::read_to_string(folder.join("board.toml")).unwrap_or_default();
    let hardware = quoted_in(&text, "hardware", "features");
    for features in [None].into_iter().chain(hardware.map(Some)) {
        let mut cargo = toolchain.cargo(folder);
        cargo.args(["clippy", "--quiet", "--release"]);
        if let Some(features) = features {
            cargo.args(["--no-default-features", "--features", features.as_ref()]);
        }
        cargo
            .arg("--target-dir")
            .arg(root.join(BUILD_FOLDER))
            .args(["--", "-D", "warnings"]);
        process::run(&mut cargo)?;
    }
    Ok(())
}

/// Whether the board of that name is emulated by QEMU.
pub fn is_of_qemu(root: &Path, board: &str) -> bool {
    let text = std::fs::read_to_string(root.join("boards").join(board).join("board.toml"));
    let runner = text.ok().and_then(|it| quoted_in(&it, "runner", "command"));
    runner.is_some_and(|it| it.starts_with("qemu-"))
}

/// Whether the board of that name has a firmware of its own for a part of silicon.
pub fn has_hardware(root: &Path, board: &str) -> bool {
    let text = std::fs::read_to_string(root.join("boards").join(board).join("board.toml"));
    text.is_ok_and(|text| quoted_in(&text, "hardware", "features").is_some())
}

/// Which features of the board's a firmware is built with.
#[derive(Clone, Copy)]
enum Features<'a> {
    Default,
    None,
    /// The default ones and this one.
    With(&'a str),
    /// These, which are for a part of silicon.
    Hardware(&'a str),
}

impl Features<'_> {
    /// What tells the files of such a firmware from the others.
    fn suffix(self) -> String {
        match self {
            Features::Default => String::new(),
            Features::None => "-lean".to_owned(),
            Features::With(feature) => format!("-{feature}"),
            Features::Hardware(_) => "-hardware".to_owned(),
        }
    }
}

/// What a firmware is built for.
#[derive(Clone, Copy)]
struct Board<'a> {
    name: &'a str,
    target: &'a str,
}

/// The default board.
const DEFAULT: Board<'static> = Board {
    name: DEFAULT_BOARD,
    target: BOARD_TARGET,
};

fn build_in(
    root: &Path,
    folder: &Path,
    board: Board<'_>,
    toolchain: &Toolchain,
    profile: &str,
    bins: &[String],
    features: Features<'_>,
) -> Result<Vec<PathBuf>, Failure> {
    let started = Instant::now();
    eprintln!(
        "Building firmware {}{} in {} (the first time takes minutes) …",
        bins.join(", "),
        features.suffix(),
        folder.display()
    );
    let build_folder = root.join(BUILD_FOLDER);
    let mut cargo = toolchain.cargo(folder);
    cargo
        .args(["build", "--profile", profile, "--target-dir"])
        .arg(&build_folder);
    match features {
        Features::Default => {}
        Features::None => {
            cargo.arg("--no-default-features");
        }
        Features::With(feature) => {
            cargo.args(["--features", feature]);
        }
        Features::Hardware(features) => {
            cargo.args(["--no-default-features", "--features", features]);
        }
    }
    for bin in bins {
        cargo.args(["--bin", bin]);
    }
    process::run(&mut cargo)?;
    let to = root.join(FIRMWARE_FOLDER).join(board.name);
    make_folder(&to)?;
    let mut files = Vec::new();
    for bin in bins {
        let built = build_folder.join(board.target).join(profile).join(bin);
        let name = format!("{bin}{}.elf", features.suffix());
        let file = to.join(&name);
        // Renamed into place, so that an emulator that loads it just now gets a whole one.
        let whole = to.join(format!(".{name}.{}", std::process::id()));
        std::fs::copy(&built, &whole)
            .and_then(|_| std::fs::rename(&whole, &file))
            .map_err(|cause| Failure::File { path: built, cause })?;
        files.push(file);
    }
    eprintln!("Built in {:.0} s.", started.elapsed().as_secs_f32());
    Ok(files)
}
