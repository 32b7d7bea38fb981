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
    let toolchain = &for_target(toolchain, &target)?;
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

/// The compiler for a board's target.
fn for_target(toolchain: &Toolchain, target: &str) -> Result<Toolchain, Failure> {
    match target {
        BOARD_TARGET => Ok(toolchain.clone()),
        other => setup::another_target(toolchain, other),
    }
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
    let toolchain = &for_target(toolchain, &target)?;
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

/// Builds `bins` of the board of that name with a feature that they lack by default; returns where
/// each ELF file is. Where the board names `features` of it, they take the place of the default
/// ones; what it names as `fast` is compiled for speed. A robot's file of the feature's name goes
/// beside the firmware, for the emulator.
///
/// # Errors
/// [`Failure`]: there is no such board, or what did not build.
pub fn build_with(
    root: &Path,
    board: &str,
    feature: &str,
    toolchain: &Toolchain,
    bins: &[String],
) -> Result<Vec<PathBuf>, Failure> {
    let folder = root.join("boards").join(board);
    let target = setting(&folder, "target")?;
    let toolchain = &for_target(toolchain, &target)?;
    let for_board = Board {
        name: board,
        target: &target,
    };
    let built = build_in(
        root,
        &folder,
        for_board,
        toolchain,
        RELEASE,
        bins,
        Features::With(feature),
    )?;
    put_beside(&folder.join(feature).with_extension("toml"), &built)?;
    Ok(built)
}

/// The program that measures what the runtime takes on each core, and where it is.
const COSTS_FOLDER: &str = "boards/costs";
/// See [`COSTS_FOLDER`].
const COSTS_BIN: &str = "costs";
/// The cores that it is built for: Cortex-M0, M3, M4F and M33.
const COSTS_TARGETS: [&str; 4] = [
    "thumbv6m-none-eabi",
    "thumbv7m-none-eabi",
    "thumbv7em-none-eabihf",
    "thumbv8m.main-none-eabihf",
];

/// Builds the program that measures what the runtime takes, for each core; returns each target, and
/// where its ELF file is.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn build_costs(
    root: &Path,
    toolchain: &Toolchain,
) -> Result<Vec<(&'static str, PathBuf)>, Failure> {
    let build_folder = root.join(BUILD_FOLDER);
    let build = |target: &'static str| {
        eprintln!("Building {COSTS_BIN} for {target} …");
        let toolchain = for_target(toolchain, target)?;
        let mut cargo = toolchain.cargo(&root.join(COSTS_FOLDER));
        cargo
            .args(["build", "--quiet", "--profile", RELEASE, "--target", target])
            .arg("--target-dir")
            .arg(&build_folder);
        process::run(&mut cargo)?;
        let file = build_folder.join(target).join(RELEASE).join(COSTS_BIN);
        Ok((target, file))
    };
    COSTS_TARGETS.into_iter().map(build).collect()
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
    put_beside(&robot.join(ROBOT_FILE), &built)?;
    Ok(built)
}

/// Copies a robot's file, if there is one, to where the emulator looks for it.
fn put_beside(file: &Path, built: &[PathBuf]) -> Result<(), Failure> {
    if file.is_file() {
        for firmware in built {
            let beside = firmware.with_extension("toml");
            std::fs::copy(file, &beside).map_err(|cause| Failure::File {
                path: beside,
                cause,
            })?;
        }
    }
    Ok(())
}

/// Runs clippy on the crate in `folder` with warnings as errors.
///
/// # Errors
/// [`Failure::Ended`] if it found something.
pub fn lint(root: &Path, folder: &Path, toolchain: &Toolchain) -> Result<(), Failure> {
    // A firmware for a part of silicon has code that the others have not.
    let text = std::fs::read_to_string(folder.join("board.toml")).unwrap_or_default();
    let hardware = quoted_in(&text, "hardware", "features");
    let toolchain = &match quoted(&text, "target") {
        Some(target) => for_target(toolchain, &target)?,
        None => toolchain.clone(),
    };
    if !toolchain.has_clippy() {
        eprintln!(
            "No lints of {}: its compiler has no clippy",
            folder.display()
        );
        return Ok(());
    }
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

/// Runs clippy on what boards share with others of their family, for the chip of each, with
/// warnings as errors. It is no part of a board's workspace, whose lints are of that alone.
///
/// # Errors
/// [`Failure::Ended`] if it found something.
pub fn lint_shared(root: &Path, toolchain: &Toolchain) -> Result<(), Failure> {
    for board in boards(root)? {
        let own = root.join("boards").join(&board);
        let text = std::fs::read_to_string(own.join("board.toml")).unwrap_or_default();
        let shared = ["folder", "features"].map(|key| quoted_in(&text, "shared", key));
        let [Some(folder), Some(features)] = shared else {
            continue;
        };
        let target = setting(&own, "target")?;
        let toolchain = for_target(toolchain, &target)?;
        if !toolchain.has_clippy() {
            eprintln!("No lints of {folder} for {target}: its compiler has no clippy");
            continue;
        }
        let mut cargo = toolchain.cargo(&root.join(folder));
        cargo
            .args(["clippy", "--quiet", "--release", "--target", &target])
            .args(["--features", &features, "--target-dir"])
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

/// What tells the firmware for a part of silicon from the one for its emulator.
pub const HARDWARE_SUFFIX: &str = "-hardware";

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
            Features::Hardware(_) => HARDWARE_SUFFIX.to_owned(),
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

/// A setting of cargo's: the places that a firmware tells when it panics do not begin with the
/// folders of this machine. So a firmware is the same, byte for byte, wherever it was built.
fn short_paths(root: &Path, target: &str) -> String {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(PathBuf::from(std::env::var_os("HOME")?).join(".cargo")));
    let crates = home.map(|home| home.join("registry").join("src"));
    let flags = [Some(root.to_path_buf()), crates]
        .into_iter()
        .flatten()
        .map(|folder| format!("{:?}", format!("--remap-path-prefix={}=", folder.display())));
    let flags = flags.collect::<Vec<_>>().join(", ");
    format!("target.{target}.rustflags=[{flags}]")
}

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
        .args(["--config", &short_paths(root, board.target)])
        .args(["build", "--profile", profile, "--target-dir"])
        .arg(&build_folder);
    match features {
        Features::Default => {}
        Features::None => {
            cargo.arg("--no-default-features");
        }
        Features::With(feature) => {
            let text = std::fs::read_to_string(folder.join("board.toml")).unwrap_or_default();
            match quoted_in(&text, feature, "features") {
                Some(instead) => cargo.args(["--no-default-features", "--features", &instead]),
                None => cargo.args(["--features", feature]),
            };
            let fast = quoted_in(&text, feature, "fast").unwrap_or_default();
            for package in fast.split_whitespace() {
                let setting = format!("profile.{profile}.package.{package}.opt-level=3");
                cargo.args(["--config", &setting]);
            }
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
