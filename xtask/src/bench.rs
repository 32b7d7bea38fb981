//! `cargo xtask bench`: figures that are measured, not checked, unless `--gate` is asked for.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use crate::elf;
use crate::firmware;
use crate::interpreters;
use crate::process::{self, Failure};
use crate::setup::{self, Choice, Toolchain};
use crate::size;

const HELP: &str = "\
Measure and print tables.

Usage: cargo xtask bench [--write] [--gate]
       cargo xtask bench <NAME> [OPTIONS]

Without a name, the whole report, in some minutes: what an event takes, of compiled state machines and of the interpreter, on the host and on a Cortex-M4, with flash
and RAM; regions that have nothing to do, events that many see, deep machines, guards, checks, swaps; events a second on the host, other engines included that read a
chart when they start. What has been promised of these figures stands first. `schedule`, `dispatch`, `costs`, `behaviours`, `day`, `idle`, `link`, `record`, `walk` and `bound` are not in it.

Names:
  machines       The same report without engines in other languages
  interpreters   Events a second on the host, of compiled state machines and of engines that read a chart when they start
  schedule       What the search for schedules decides, and how fast; --help tells its options
  dispatch       What starting a slot takes on the emulated board, and a frame of a link, in instructions
  costs          What the runtime takes on a Cortex-M0, M3, M4F and M33: instructions, flash, RAM, stack
  behaviours     What a behaviour adds to a task on the emulated board, and what an activation takes of the slot that wheels, odometry and behaviours share
  day            Whether a robot is on time for 24 hours of virtual time, or for as many minutes as are told
  idle           How much of the time that slots leave reaches slot 0, on the emulated board
  link           How fast a mission of 4,096 bytes is uploaded to a robot that drives in the emulator, on a good line and on bad ones
  record         How many bytes a recording of each shipped mission takes for a transition, in 120 s of robot time or in as many as are told
  walk           What walking through the recording of an hour takes, forwards and backwards, or of as many minutes as are told
  bound          Whether a macro step ever takes more than its bound, on the emulated board

Options:
  --write    Keep the report in docs/benchmarks.md
  --gate     End with status 1 if a promise does not hold
  --json     Of `dispatch` and `costs`: print one JSON object, for programs
  --board <NAME>
             Of `dispatch`: on this board of QEMU, instead of the default one
  -h, --help This text

Emulator, valgrind and a compiler for the board are installed if they are missing. ESM_TOOLCHAIN=rustup|debian chooses the compiler. Packages of other engines come
from crates.io, npm and PyPI to target/benches/interpreters; where they cannot, or there is no Node or Python, their rows say so.

Examples:
  cargo xtask bench
  cargo xtask bench --gate
  cargo xtask bench --write
  cargo xtask bench dispatch
  cargo xtask bench dispatch --json
  cargo xtask bench dispatch --board stm32f405
";

/// A program of the default board, and a feature that the board lacks by default.
type Firmware = (&'static str, Option<&'static str>);

/// What the program that measures must be given.
#[derive(Clone, Copy)]
enum Needs {
    /// Nothing: it holds what it measures, and is optimised itself.
    Nothing,
    /// These firmwares of the default board.
    Firmware(&'static [Firmware]),
    /// The same, and all that is measured is measured in the emulator.
    Emulated(&'static [Firmware]),
    /// The program of the cores, for each of them.
    Costs,
    /// The programs of the workspace in [`MACHINES_FOLDER`]. It makes their inputs and reads what
    /// they tell.
    Machines(Part),
}

/// What of the report is measured.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Whole,
    /// All but engines in other languages.
    Machines,
    /// Events a second on the host.
    Interpreters,
}

/// What can be measured, in which package the program for it is, and what that needs.
const BENCHES: [(&str, &str, Needs); 12] = [
    (REPORT, "esm-tests", Needs::Machines(Part::Machines)),
    (
        "interpreters",
        "esm-tests",
        Needs::Machines(Part::Interpreters),
    ),
    ("schedule", "host-tools", Needs::Nothing),
    (
        DISPATCH,
        "esm-tests",
        Needs::Firmware(&[(DISPATCH_BIN, None), ("bench_links", Some("links"))]),
    ),
    ("costs", "esm-tests", Needs::Costs),
    (
        "behaviours",
        "esm-tests",
        Needs::Emulated(&[
            ("bench_behaviours", Some("behaviours")),
            (firmware::DEFAULT_BIN, Some("behaviours")),
        ]),
    ),
    ("day", "esm-tests", Needs::Nothing),
    (
        "idle",
        "esm-tests",
        Needs::Firmware(&[("bench_idle", None)]),
    ),
    (
        "link",
        "esm-tests",
        Needs::Firmware(&[(firmware::DEFAULT_BIN, None)]),
    ),
    ("record", "esm-tests", Needs::Nothing),
    ("walk", "esm-tests", Needs::Nothing),
    (
        "bound",
        "esm-tests",
        Needs::Firmware(&[(firmware::BOUND_BIN, None)]),
    ),
];

/// What measures starting a slot, and its firmware, which several boards have.
const DISPATCH: &str = "dispatch";
const DISPATCH_BIN: &str = "bench_dispatch";

/// The program that measures the report.
const REPORT: &str = "machines";

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
    MACHINES_ALONE,
];
/// The one with the interpreter and without a mission.
const MACHINES_ALONE: &str = "esm_alone";
/// How all that is of the interpreter with checked reads is called.
const CHECKED: &str = "checked-";
/// The firmware of the default board that measures how missions follow one another.
const SWAP_BIN: &str = "bench_swap";
/// What the settings for speed and for size are called, and their profiles.
const MACHINES_PROFILES: [(&str, &str); 2] = [("fast", "release"), ("small", "small")];

/// Builds the program that measures what is named and runs it; all other arguments are its own.
///
/// # Errors
/// If there is no such program, or it fails.
pub fn command(root: &Path, arguments: impl Iterator<Item = String>) -> Result<(), Failure> {
    let mut arguments = arguments.peekable();
    if let Some("-h" | "--help" | "help") = arguments.peek().map(String::as_str) {
        print!("{HELP}");
        return Ok(());
    }
    let named = arguments.next_if(|argument| !argument.starts_with('-'));
    let (program, package, needs) = match named.as_deref() {
        None => (REPORT, "esm-tests", Needs::Machines(Part::Whole)),
        Some(name) => BENCHES
            .into_iter()
            .find(|(known, ..)| *known == name)
            .ok_or_else(|| {
                let names = BENCHES.map(|(name, ..)| name).join(", ");
                Failure::Usage(format!("bench {name}: there is {names}"))
            })?,
    };
    let mut program = program;
    let mut given = Vec::new();
    let mut profile = "bench";
    let arguments: Vec<String> = arguments.collect();
    match needs {
        Needs::Firmware(_) if program == DISPATCH && board_of(&arguments)?.is_some() => {
            setup::emulator()?;
            let toolchain = setup::toolchain(Choice::from_environment()?)?;
            let board = board_of(&arguments)?.unwrap_or_default().to_owned();
            if !firmware::is_of_qemu(root, &board) {
                let problem = format!("bench {DISPATCH}: QEMU emulates no board {board}");
                return Err(Failure::Usage(problem));
            }
            let bins = [DISPATCH_BIN.to_owned()];
            let files = firmware::build_for(root, &board, &toolchain, &bins)?;
            given.extend(files.into_iter().map(PathBuf::into_os_string));
            // What the host itself is measured for has nothing to do with the board.
            profile = "dev";
        }
        Needs::Nothing => {}
        Needs::Firmware(firmwares) | Needs::Emulated(firmwares) => {
            setup::emulator()?;
            let toolchain = setup::toolchain(Choice::from_environment()?)?;
            for &(bin, feature) in firmwares {
                let bins = [bin.to_owned()];
                let files = match feature {
                    None => firmware::build(root, &toolchain, firmware::RELEASE, &bins)?,
                    Some(feature) => {
                        let board = firmware::DEFAULT_BOARD;
                        firmware::build_with(root, board, feature, &toolchain, &bins)?
                    }
                };
                given.extend(files.into_iter().map(PathBuf::into_os_string));
            }
            if let Needs::Emulated(_) = needs {
                profile = "dev";
            }
        }
        Needs::Costs => {
            setup::emulator()?;
            let toolchain = setup::toolchain(Choice::from_environment()?)?;
            for (target, file) in firmware::build_costs(root, &toolchain)? {
                let (flash, ram) = size::of_file(&file)?;
                given.push(target.into());
                given.push(file.into());
                given.extend([flash, ram].map(|bytes| bytes.to_string().into()));
            }
            profile = "dev";
        }
        Needs::Machines(part) => {
            program = REPORT;
            // Before minutes are spent on building.
            let taken = part.options();
            if let Some(wrong) = arguments
                .iter()
                .find(|argument| !taken.contains(&argument.as_str()))
            {
                return Err(Failure::Usage(format!(
                    "bench {}: no {wrong}; --write and --gate are for the whole report, --gate for `machines`, too",
                    named.unwrap_or_default()
                )));
            }
            if part != Part::Machines {
                given.extend(interpreters(root));
            }
            if part == Part::Interpreters {
                println!(
                    "Building the machines that are compared (the first time takes minutes) …"
                );
                given.push(host_program(root, "")?);
                given.push("only=interpreters".into());
            } else {
                setup::emulator()?;
                setup::valgrind()?;
                let toolchain = setup::toolchain(Choice::from_environment()?)?;
                given.extend(machines(root, &toolchain)?);
            }
            profile = "dev";
        }
    }
    let program = built(root, profile, package, program)?;
    let mut measuring = process::command(program);
    measuring
        // Where cargo would start it.
        .current_dir(root.join(folder_of(package)))
        .arg("--bench")
        .args(given)
        .args(&arguments);
    match process::run(&mut measuring) {
        // What the gate is for; it has told what does not hold.
        Err(Failure::Ended { status, .. })
            if status.code() == Some(1)
                && arguments.iter().any(|argument| argument == "--gate") =>
        {
            Err(Failure::Promises)
        }
        result => result,
    }
}

/// The board that `--board` names.
fn board_of(arguments: &[String]) -> Result<Option<&str>, Failure> {
    let Some(place) = arguments.iter().position(|it| it == "--board") else {
        return Ok(None);
    };
    let named = arguments.get(place + 1).map(String::as_str);
    named
        .filter(|name| !name.starts_with('-'))
        .map(Some)
        .ok_or_else(|| Failure::Usage(format!("bench {DISPATCH}: --board needs a name")))
}

impl Part {
    fn options(self) -> &'static [&'static str] {
        match self {
            Part::Whole => &["--write", "--gate"],
            Part::Machines => &["--gate"],
            Part::Interpreters => &[],
        }
    }
}

/// What separates the words of an engine: no path has it.
const BETWEEN: &str = "\u{1f}";

/// What the program that measures is told of the engines that read a chart when they start.
fn interpreters(root: &Path) -> impl Iterator<Item = OsString> {
    interpreters::prepare(root).into_iter().map(|engine| {
        let (key, rest) = match engine.program {
            Ok(program) => ("interpreting", program),
            Err(reason) => ("absent", vec![reason.into()]),
        };
        let mut argument = OsString::from(format!("{key}={}", engine.row));
        for word in [engine.name.into(), engine.by.into()]
            .into_iter()
            .chain(rest)
        {
            argument.push(BETWEEN);
            argument.push(word);
        }
        argument
    })
}

/// An argument with a name.
fn told(key: &str, value: &OsStr) -> OsString {
    let mut argument = OsString::from(format!("{key}="));
    argument.push(value);
    argument
}

/// Builds the program that is measured on the host: with `prefix` [`CHECKED`], the one whose reads
/// are checked.
fn host_program(root: &Path, prefix: &str) -> Result<OsString, Failure> {
    let mut target = root.join(MACHINES_TARGET);
    let mut cargo = process::command(process::host_cargo());
    cargo.current_dir(root.join(MACHINES_FOLDER)).args([
        "build",
        "--quiet",
        "--release",
        "--package",
        "bench-host",
    ]);
    if prefix == CHECKED {
        target.push(prefix);
        cargo.arg("--no-default-features");
    }
    process::run(cargo.arg("--target-dir").arg(&target))?;
    let program = target.join("release/bench-host");
    Ok(told(&format!("{prefix}host"), program.as_os_str()))
}

/// Builds the program that measures `name`; returns where it is. It is not cargo that runs it: a
/// failure of its own is told once.
fn built(root: &Path, profile: &str, package: &str, name: &str) -> Result<PathBuf, Failure> {
    let mut cargo = process::command(process::host_cargo());
    cargo
        .current_dir(root)
        .args(["bench", "--quiet", "--no-run", "--profile", profile])
        .args(["--package", package, "--bench", name])
        .args(["--message-format", "json-render-diagnostics"]);
    let messages = process::printed(&mut cargo, false)?;
    executable(&messages).ok_or(Failure::Content {
        path: root.join("Cargo.toml"),
        problem: "has no such benchmark",
    })
}

/// The folder of a package.
fn folder_of(package: &str) -> &str {
    match package {
        "esm-tests" => "tests",
        package => package,
    }
}

/// The one program that cargo's messages tell of.
fn executable(messages: &str) -> Option<PathBuf> {
    const KEY: &str = "\"executable\":\"";
    let (_, rest) = messages.rsplit_once(KEY)?;
    let (path, _) = rest.split_once('"')?;
    // As JSON has it; a path with other signs than these would have more of them.
    Some(PathBuf::from(path.replace("\\\\", "\\")))
}

/// Builds the machines that are compared, for the host and for the board; returns what the program
/// that runs them is told.
fn machines(root: &Path, toolchain: &Toolchain) -> Result<Vec<OsString>, Failure> {
    let folder = root.join(MACHINES_FOLDER);
    let target = root.join(MACHINES_TARGET);
    println!("Building the machines that are compared (the first time takes minutes) …");
    let mut arguments = vec![
        host_program(root, "")?,
        host_program(root, CHECKED)?,
        told("compiler", toolchain.rustc_version().as_ref()),
    ];
    let core = toolchain.measured_core();
    arguments.push(told("target", core.as_ref()));
    let swap = firmware::build(root, toolchain, firmware::RELEASE, &[SWAP_BIN.to_owned()])?;
    arguments.extend(swap.iter().map(|file| told("swap", file.as_os_str())));
    let engine = size::interpreter_flash(root, toolchain)?.to_string();
    arguments.push(told("engine-flash", engine.as_ref()));
    for (prefix, features, sized) in [
        ("", &[][..], &MACHINES_SIZED[..]),
        (CHECKED, &["--no-default-features"], &[MACHINES_ALONE]),
    ] {
        let target = match prefix {
            "" => target.clone(),
            prefix => target.join(prefix),
        };
        for (setting, profile) in MACHINES_PROFILES {
            process::run(
                toolchain
                    .cargo(&folder)
                    .args(["build", "--quiet", "--profile", profile])
                    .args(["--package", "bench-cortex-m4", "--target", core])
                    .args(features)
                    .args(toolchain.core_from_source())
                    .arg("--target-dir")
                    .arg(&target),
            )?;
            let programs = target.join(core).join(profile);
            for program in sized {
                let size = flash_bytes(&programs.join(program))?.to_string();
                let key = format!("flash-{prefix}{setting}-{program}");
                arguments.push(told(&key, size.as_ref()));
            }
            arguments.push(told(&format!("{prefix}{setting}"), programs.as_os_str()));
        }
    }
    Ok(arguments)
}

/// Bytes of flash that a program takes.
fn flash_bytes(path: &Path) -> Result<u32, Failure> {
    let bytes = std::fs::read(path).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })?;
    let image = elf::read(&bytes).ok_or_else(|| Failure::Content {
        path: path.to_owned(),
        problem: "is no firmware (32-bit little-endian ELF)",
    })?;
    Ok(image.flash_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_program_is_the_last_one_that_cargo_tells_of() {
        let messages = "{\"reason\":\"compiler-artifact\",\"executable\":null}\n\
                        {\"reason\":\"compiler-artifact\",\"executable\":\"/t/deps/a-1\",\"fresh\":true}\n\
                        {\"reason\":\"build-finished\",\"success\":true}\n";
        assert_eq!(executable(messages), Some(PathBuf::from("/t/deps/a-1")));
        assert_eq!(executable("{\"executable\":null}"), None);
        assert_eq!(executable(""), None);
    }

    #[test]
    fn what_is_asked_for_wrongly_is_told_before_anything_is_built() {
        for arguments in [&["nothing"][..], &["--wrong"], &["machines", "--quick"]] {
            let asked = arguments.iter().map(|argument| (*argument).to_owned());
            let result = command(Path::new("/nowhere"), asked);
            assert!(matches!(result, Err(Failure::Usage(_))), "{arguments:?}");
        }
    }
}
