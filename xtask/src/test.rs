//! `cargo xtask test`: every check, in parts; what fails does not keep the rest from running.

use std::path::Path;
use std::time::Instant;

use crate::bench;
use crate::demo;
use crate::firmware::{
    self, BOARD_FOLDER, BOUND_BIN, DEFAULT_BIN, EXAMPLE_FIRMWARE_FOLDER, EXAMPLE_FOLDER, FAULTS_BIN,
};
use crate::form;
use crate::fuzz;
use crate::mutants;
use crate::process::{self, Failure, cargo};
use crate::python;
use crate::setup::{self, Choice, OTHER_TARGETS, PAGE_TARGET, Toolchain};
use crate::size;
use crate::studio;
use crate::tally::Tally;

/// Tells the example's tests where its firmware is.
const EXAMPLE_FIRMWARE_VARIABLE: &str = "ESM_ROBOT_FIRMWARE";

/// What the documentation must not have.
const RUSTDOC_FLAGS: &str = "-D warnings -D rustdoc::broken_intra_doc_links";

/// The parts of the checks, which can be asked for alone.
pub const PARTS: [&str; 4] = ["checks", "builds", "robots", "libraries"];

/// What is asked for.
#[derive(Clone, Copy)]
pub struct Selection<'a> {
    /// Of [`PARTS`]; all if there is none.
    pub parts: &'a [String],
    /// Leave out what needs firmware or an emulator.
    pub quick: bool,
    /// Which compiler builds firmware.
    pub toolchain: Choice,
}

/// Runs checks.
///
/// Of all of them two parts at a time run side by side, where one is mostly for the compiler, or
/// waits for emulators: the machine has two cores at least.
///
/// # Errors
/// [`Failure::Checks`] if one did not hold, [`Failure::Usage`] for an unknown part.
pub fn command(root: &Path, selection: Selection<'_>) -> Result<(), Failure> {
    if let Some(unknown) = (selection.parts.iter()).find(|part| !PARTS.contains(&part.as_str())) {
        let parts = PARTS.join(", ");
        let problem = format!("test has no part {unknown}; its parts are {parts}");
        return Err(Failure::Usage(problem));
    }
    if selection.quick && !selection.parts.is_empty() {
        let problem = "--quick leaves parts out by itself: give it, or the parts";
        return Err(Failure::Usage(problem.to_owned()));
    }
    let started = Instant::now();
    let mut tally = Tally::default();
    if selection.quick {
        checks(root, &mut tally);
        tally.tests(
            "tests of the libraries",
            root,
            &["--workspace", "--lib", "--bins"],
            None,
        );
    } else if selection.parts.is_empty() {
        all(root, selection.toolchain, &mut tally);
    } else {
        for part in selection.parts {
            match part.as_str() {
                "checks" => checks(root, &mut tally),
                "builds" => builds(root, selection.toolchain, &mut tally),
                "robots" => robots(root, &mut tally),
                _ => libraries(root, selection.toolchain, &mut tally),
            }
        }
    }
    println!("\nTook {:.0} s.", started.elapsed().as_secs_f32());
    tally.end()
}

/// Every part.
fn all(root: &Path, choice: Choice, tally: &mut Tally) {
    let mut toolchain = choice.name();
    tally.step("set-up", || {
        setup::emulator()?;
        // What was found is not looked for again.
        toolchain = setup::toolchain(choice)?.name();
        Ok(())
    });
    let beside = |part: &'static str| {
        let log = root.join(format!("target/test/{part}.log"));
        Tally::beside(part, &["--toolchain", toolchain], log)
    };
    let builds = beside("builds");
    checks(root, tally);
    tally.step("tests of the workspace: compiled", || {
        process::run(cargo(root).args(["test", "--workspace", "--no-run"]))
    });
    tally.join(builds);
    let libraries = beside("libraries");
    robots(root, tally);
    tally.join(libraries);
}

/// A second build compiles nothing. A build script that names a file that is not there would have
/// its package compiled at each call of `cargo run`.
fn built_already(root: &Path) -> Result<(), Failure> {
    let mut again = process::esm_build(root);
    again.args(["--message-format", "json"]);
    let told = process::printed(&mut again, true)?;
    let compiled: Vec<&str> = told
        .lines()
        .filter(|line| line.contains("\"fresh\":false"))
        .collect();
    if compiled.is_empty() {
        return Ok(());
    }
    println!("{}", compiled.join("\n"));
    Err(Failure::Content {
        path: root.join("host-tools"),
        problem: "is compiled at each call: which file makes it, `CARGO_LOG=cargo::core::compiler::fingerprint=info` tells",
    })
}

/// What is built optimised: the command, and firmware, with its sizes and lints.
fn builds(root: &Path, choice: Choice, tally: &mut Tally) {
    tally.step("the command esm, optimised", || {
        process::run(&mut process::esm_build(root))
    });
    tally.step("the command esm, built once more: nothing to do", || {
        built_already(root)
    });
    tally.step("esm-toolkit without an operating system", || {
        let toolchain = setup::page_toolchain(choice)?;
        process::run(
            toolchain
                .cargo(root)
                .args(["check", "--package", "esm-toolkit"])
                .args(["--target", PAGE_TARGET])
                .args(toolchain.std_from_source()),
        )
    });
    if has_component("clippy") {
        tally.step("lints of the studio's engine", || {
            let arguments = ["clippy", "--quiet", "--", "-D", "warnings"];
            process::run(
                cargo(&root.join(studio::ENGINE_FOLDER))
                    .args(arguments)
                    .env("CARGO_TARGET_DIR", root.join("target/studio")),
            )
        });
    }
    if let Some(toolchain) = compiler(choice, tally) {
        firmware_checks(root, &toolchain, tally);
    }
}

/// Tests of the whole that run beside the others: about half of the time that all take.
const BESIDE: [&str; 6] = [
    "faults",
    "hostile_host",
    "new_robot",
    "pico",
    "ports",
    "power_cuts",
];

/// Where tests of the whole stand, below the checkout: a file, or a folder, each.
const WHOLE_FOLDERS: [&str; 4] = [
    "tests/tests",
    "host-tools/tests",
    "robot-file/tests",
    "xtask/tests",
];

/// The names of the tests of the whole, but for those that run [`BESIDE`].
fn whole_tests(root: &Path) -> Vec<String> {
    let folders = WHOLE_FOLDERS.map(|folder| std::fs::read_dir(root.join(folder)));
    let entries = folders.into_iter().flatten().flatten().flatten();
    // What cargo takes for a test: a file of Rust, or a folder with a `main.rs`.
    let paths = entries.map(|entry| entry.path()).filter(|path| {
        path.extension().is_some_and(|it| it == "rs") || path.join("main.rs").is_file()
    });
    let names = paths.filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()));
    let mut names: Vec<String> = names
        .filter(|name| !BESIDE.contains(&name.as_str()))
        .collect();
    names.sort();
    // Two packages have tests of one name, which are asked for together.
    names.dedup();
    names
}

/// Runs tests of the whole, by their names.
fn whole<'a>(root: &Path, name: &str, tests: impl Iterator<Item = &'a str>, tally: &mut Tally) {
    let mut arguments = vec!["--workspace"];
    arguments.extend(tests.flat_map(|test| ["--test", test]));
    tally.tests(name, root, &arguments, None);
}

/// What drives robots, on the host and in the emulator: the demo, and the tests of the whole. Needs
/// what [`builds`] makes.
fn robots(root: &Path, tally: &mut Tally) {
    match python::find() {
        Some(python) => tally.step("the link's client in Python", || {
            python::test(root, &python, &root.join("target/release/esm"))
        }),
        None => tally.skip(
            "the link's client in Python",
            "there is no python3 with venv",
        ),
    }
    match python::find() {
        Some(_) => tally.step("the pico's drivers, at its pins", || {
            let built = |name| root.join(format!("target/firmware/{CHIP}/{PINS_BIN}{name}.elf"));
            python::test_pins(root, CHIP, &built(""), &built(&format!("-{SENSORS}")))
        }),
        None => tally.skip(
            "the pico's drivers, at its pins",
            "there is no python3 with venv",
        ),
    }
    match studio::prepare() {
        Ok(()) => {
            let esm = root.join("target/release/esm");
            tally.step(
                "the studio: fresh, and its traces are the command's",
                || studio::test_fresh(root, &esm),
            );
            tally.step("the studio's page, in a browser", || {
                studio::test_page(root, &esm)
            });
        }
        Err(missing) => tally.skip("the studio", &missing.to_string()),
    }
    tally.step("the demo, and its deepest stack", || {
        size::check_stack(root, size::LIMITS, &demo::drive(root)?.join("summary.json"))
    });
    // Its firmware was built to be measured.
    tally.step("the deepest stack without features", || {
        let folder = demo::drive_lean(root)?;
        size::check_stack(root, size::LEAN_LIMITS, &folder.join("summary.json"))
    });
    let tests = whole_tests(root);
    let tests = tests.iter().map(String::as_str);
    whole(root, "tests of the whole", tests, tally);
}

/// Where a board holds its drivers against registers that tests look at, in its folder: a workspace
/// of its own, which builds for the host.
const REGISTERS_FOLDER: &str = "registers";

/// Where they are built.
const REGISTERS_TARGET: &str = "target/registers";

/// Tests of what boards do to registers that no emulator has.
fn registers(root: &Path, tally: &mut Tally) {
    for board in boards(root, tally) {
        let folder = root.join("boards").join(&board).join(REGISTERS_FOLDER);
        let manifest = folder.join("Cargo.toml");
        if !manifest.is_file() {
            continue;
        }
        if has_component("clippy") {
            tally.step(
                &format!("lints of the drivers of {board}, for the host"),
                || {
                    process::run(
                        cargo(root)
                            .args(["clippy", "--quiet", "--all-targets", "--manifest-path"])
                            .arg(&manifest)
                            .arg("--target-dir")
                            .arg(root.join(REGISTERS_TARGET))
                            .args(["--", "-D", "warnings"]),
                    )
                },
            );
        }
        tally.tests(
            &format!("drivers of {board}, on registers that are looked at"),
            root,
            &[
                "--manifest-path",
                &manifest.to_string_lossy(),
                "--target-dir",
                &root.join(REGISTERS_TARGET).to_string_lossy(),
            ],
            None,
        );
    }
}

/// Tests of each library for itself, of the machines that the interpreter is compared with, and of
/// a robot outside the workspace.
fn libraries(root: &Path, choice: Choice, tally: &mut Tally) {
    tally.tests(
        "tests of the libraries",
        root,
        &["--workspace", "--lib", "--bins"],
        None,
    );
    tally.tests(
        "examples in the documentation",
        root,
        &["--workspace", "--doc"],
        None,
    );
    let target = root.join(bench::MACHINES_TARGET);
    tally.tests(
        "tests of the machines that are compared",
        &root.join(bench::MACHINES_FOLDER),
        &[
            "--package",
            "bench-machines",
            "--target-dir",
            &target.to_string_lossy(),
        ],
        None,
    );
    registers(root, tally);
    if let Some(toolchain) = compiler(choice, tally) {
        example_checks(root, &toolchain, tally);
    }
    whole(
        root,
        "tests of the whole that run beside",
        BESIDE.into_iter(),
        tally,
    );
}

/// The board whose chip has an emulator of its own.
const CHIP: &str = "pico";

/// Its firmware for tests at its pins.
const PINS_BIN: &str = "pins";

/// The feature that brings more sensors.
const SENSORS: &str = "sensors";

/// The example of a robot with a file of its own, on that board.
const FILE_EXAMPLE_FOLDER: &str = "examples/my_pico";
/// See [`FILE_EXAMPLE_FOLDER`].
const FILE_EXAMPLE_FIRMWARE_FOLDER: &str = "examples/my_pico/firmware";

/// Crates without a lock file: they are built as parts of others.
const UNLOCKED: [&str; 2] = ["esm", "boards/cortex_m"];

/// What a board's firmware has the libraries do.
const FIRMWARE_FEATURES: &str = "rt-firmware/all-tasks,rt-firmware/black-box,rt-firmware/defmt,rt-firmware/docs,\
     rt-firmware/keys,rt-firmware/news,rt-firmware/params,rt-firmware/record,rt-firmware/telemetry,rt-firmware/warm";

/// The workspaces that have a lock file, but for the boards'.
const LOCKED: [&str; 10] = [
    "",
    "boards/costs",
    "boards/rp",
    studio::ENGINE_FOLDER,
    FILE_EXAMPLE_FOLDER,
    FILE_EXAMPLE_FIRMWARE_FOLDER,
    EXAMPLE_FOLDER,
    EXAMPLE_FIRMWARE_FOLDER,
    fuzz::PACKAGE_FOLDER,
    bench::MACHINES_FOLDER,
];

/// The boards that there are.
fn boards(root: &Path, tally: &mut Tally) -> Vec<String> {
    let mut boards = Vec::new();
    tally.step("folders of the boards", || {
        boards = firmware::boards(root)?;
        Ok(())
    });
    boards
}

/// What needs no firmware: form, lints, documentation, and whether the tests notice mutants.
fn checks(root: &Path, tally: &mut Tally) {
    tally.step("lines that are too wide", || form::command(root, false));
    let folders = boards(root, tally).into_iter().flat_map(|board| {
        let own = format!("boards/{board}");
        let registers = format!("{own}/{REGISTERS_FOLDER}");
        let is_there = root.join(&registers).join("Cargo.toml").is_file();
        [own].into_iter().chain(is_there.then_some(registers))
    });
    let locked: Vec<String> = (LOCKED.into_iter().map(str::to_owned))
        .chain(folders)
        .collect();
    tally.step("lock files name what is built", || {
        // What a user builds is what was tested, and a build leaves the checkout as it was.
        locked.iter().try_for_each(|folder| {
            let arguments = ["update", "--workspace", "--locked", "--quiet"];
            process::run(cargo(&root.join(folder)).args(arguments))
        })
    });
    let rustfmt = has_component("fmt");
    let clippy = has_component("clippy");
    if rustfmt {
        let unlocked = UNLOCKED.map(str::to_owned);
        for folder in locked.into_iter().chain(unlocked) {
            let name = format!(
                "formatting of {}",
                if folder.is_empty() {
                    "the workspace"
                } else {
                    &folder
                }
            );
            tally.step(&name, || {
                process::run(cargo(&root.join(&folder)).args(["fmt", "--all", "--check"]))
            });
        }
    } else {
        tally.skip(
            "formatting",
            "this cargo has no `fmt` (rustup component add rustfmt)",
        );
    }
    if clippy {
        tally.step("lints of the workspace", || {
            process::run(cargo(root).args([
                "clippy",
                "--quiet",
                "--workspace",
                "--all-targets",
                "--",
                "-D",
                "warnings",
            ]))
        });
        tally.step("lints of the machines that are compared", || {
            let folder = root.join(bench::MACHINES_FOLDER);
            process::run(
                cargo(&folder)
                    .args(["clippy", "--quiet", "--all-targets"])
                    .args(["--package", "bench-machines", "--package", "bench-host"])
                    .arg("--target-dir")
                    .arg(root.join(bench::MACHINES_TARGET))
                    .args(["--", "-D", "warnings"]),
            )
        });
    } else {
        tally.skip(
            "lints",
            "this cargo has no `clippy` (rustup component add clippy)",
        );
    }
    tally.step("documentation without warnings", || {
        process::run(cargo(root).env("RUSTDOCFLAGS", RUSTDOC_FLAGS).args([
            "doc",
            "--quiet",
            "--workspace",
            "--no-deps",
        ]))
    });
    // One line for each: its package, its name, what it breaks, and what noticed it.
    tally.step("mutants", || mutants::command(root, &[]));
    // Those that are not in tables yet.
    tally.tests(
        "planted bugs",
        root,
        &[
            "--workspace",
            "--lib",
            "planted_defect_of_the_",
            "--",
            "--nocapture",
            "--test-threads=1",
        ],
        None,
    );
}

/// What is built for the board's core.
fn firmware_checks(root: &Path, toolchain: &Toolchain, tally: &mut Tally) {
    tally.step("firmware", || {
        firmware::build(
            root,
            toolchain,
            firmware::RELEASE,
            &[DEFAULT_BIN, FAULTS_BIN, BOUND_BIN].map(str::to_owned),
        )
        .map(drop)
    });
    tally.step("sizes", || size::command(root, toolchain, false));
    if toolchain.has_clippy() && has_component("clippy") {
        tally.step("lints of the firmware", || {
            firmware::lint(root, &root.join(BOARD_FOLDER), toolchain)
        });
    } else {
        tally.skip(
            "lints of the firmware",
            "the compiler for firmware has no clippy",
        );
    }
    tally.step("firmware for tests at the pico's pins", || {
        let pins = [PINS_BIN.to_owned()];
        firmware::build_for(root, CHIP, toolchain, &pins)?;
        firmware::build_with(root, CHIP, SENSORS, toolchain, &pins).map(drop)
    });
    if toolchain.has_clippy() && has_component("clippy") {
        tally.step("lints of my_pico's firmware", || {
            firmware::lint(root, &root.join(FILE_EXAMPLE_FIRMWARE_FOLDER), toolchain)
        });
    }
    for board in boards(root, tally) {
        if board == firmware::DEFAULT_BOARD {
            continue;
        }
        tally.step(&format!("firmware of the {board}, and its sizes"), || {
            // Built for the emulator and for a part of silicon, where these are two.
            size::of_board(root, &board, toolchain, false)
        });
        if toolchain.has_clippy() && has_component("clippy") {
            tally.step(&format!("lints of the {board}'s firmware"), || {
                firmware::lint(root, &root.join("boards").join(&board), toolchain)
            });
        }
    }
    if has_component("clippy") {
        tally.step("lints of what boards of one family share", || {
            firmware::lint_shared(root, toolchain)
        });
    }
    tally.step("my_pico: firmware", || {
        let folder = root.join(FILE_EXAMPLE_FOLDER);
        firmware::build_robot(root, &folder, toolchain, &[]).map(drop)
    });
    for target in OTHER_TARGETS {
        tally.step(&format!("libraries of the firmware for {target}"), || {
            let toolchain = setup::another_target(toolchain, target)?;
            let packages = ["esm-core", "esm-link", "rt-firmware"];
            process::run(
                toolchain
                    .cargo(root)
                    .arg("check")
                    .args(packages.iter().flat_map(|name| ["--package", name]))
                    .args(["--features", FIRMWARE_FEATURES, "--target", target])
                    .arg("--target-dir")
                    .arg(root.join(firmware::BUILD_FOLDER))
                    .args(toolchain.core_from_source()),
            )
        });
    }
}

/// The example of a robot outside the workspace, as `esm new robot` writes it: its firmware is
/// built, and its tests are run, which drive its mission on the host and in the emulator.
fn example_checks(root: &Path, toolchain: &Toolchain, tally: &mut Tally) {
    let mut firmware = None;
    tally.step("my_robot: firmware", || {
        firmware = firmware::build_example(root, toolchain)?.pop();
        Ok(())
    });
    if has_component("clippy") {
        tally.step("my_robot: lints", || {
            let mut cargo = cargo(&root.join(EXAMPLE_FOLDER));
            cargo.args(["clippy", "--quiet", "--all-targets", "--target-dir"]);
            process::run(
                cargo
                    .arg(root.join("target"))
                    .args(["--", "-D", "warnings"]),
            )
        });
    }
    let environment = firmware.map(|file| (EXAMPLE_FIRMWARE_VARIABLE, file));
    for example in [EXAMPLE_FOLDER, FILE_EXAMPLE_FOLDER] {
        tally.tests(
            &format!("{example}: tests"),
            &root.join(example),
            &["--target-dir", &root.join("target").to_string_lossy()],
            environment.clone(),
        );
    }
}

/// The compiler for firmware; a step that failed if there is none.
fn compiler(choice: Choice, tally: &mut Tally) -> Option<Toolchain> {
    match setup::toolchain(choice) {
        Ok(toolchain) => Some(toolchain),
        Err(failure) => {
            tally.step("compiler for firmware", || Err(failure));
            None
        }
    }
}

/// Whether the host's cargo has the subcommand `name`.
fn has_component(name: &str) -> bool {
    process::output(process::command(process::host_cargo()).args([name, "--version"])).is_some()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{BESIDE, WHOLE_FOLDERS, whole_tests};

    /// Tests that no part runs would pass for ever.
    #[test]
    fn every_package_has_its_tests_run() {
        let root = Path::new("..");
        let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
        let (_, members) = manifest.split_once("members = [").unwrap();
        let (members, _) = members.split_once(']').unwrap();
        for member in members.split('"').skip(1).step_by(2) {
            let folder = format!("{member}/tests");
            assert!(
                !root.join(&folder).is_dir() || WHOLE_FOLDERS.contains(&&*folder),
                "{folder} is not in WHOLE_FOLDERS"
            );
        }
        let names = whole_tests(root);
        assert!(names.contains(&"files".to_owned()) && names.contains(&"book".to_owned()));
        assert!(
            BESIDE
                .iter()
                .all(|name| !names.contains(&(*name).to_owned()))
        );
    }
}
