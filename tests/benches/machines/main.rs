//! `cargo xtask bench machines`: what a transition costs, of compiled state machines and of the interpreter, measured in the same run.
//!
//! The programs that are measured are in `benches/`; who builds them tells their paths as `KEY=VALUE`. The missions are made here. Everything is
//! measured before anything is printed, and nothing is printed if a machine did not do what the chart says.

mod charts;
mod measured;
mod report;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use charts::Plan;
use esm_tests::command::root;
use esm_tests::subject;
use host_tools::trace::directory::Directory;
use measured::Measured;
use report::{Engine, Report, Setting};

/// Where the report is kept.
const KEPT: &str = "docs/benchmarks.md";

/// The engines, by the names of their rows and of their programs.
const ENGINES: [(&str, &str, &str); 5] = [
    ("nothing", "empty", "nothing: the harness itself"),
    ("by-hand", "by_hand", "`match` by hand"),
    ("rust-fsm", "rust_fsm", "rust-fsm"),
    ("statig", "statig", "statig"),
    ("smlang", "smlang", "smlang"),
];

/// Actions of one pass through the script, as the chart has them: start, open, close, store, stop, pause, resume, stop and open, stopped again, next, previous.
const ACTIONS: [u32; 11] = [1, 2, 2, 1, 1, 2, 1, 0, 1, 20, 20];

/// Transitions of one pass of ours, from and to. A song starts when its disc does, with the next pulse.
const TRANSITIONS: [(&str, &str, u32); 16] = [
    ("Empty", "Open", 1),
    ("Empty", "Stopped", 1),
    ("Open", "Empty", 2),
    ("Stopped", "Playing", 1),
    ("Stopped", "Open", 1),
    ("Stopped", "Stopped", 1),
    ("Playing", "Paused", 2),
    ("Paused", "Playing", 1),
    ("Paused", "Stopped", 1),
    ("initial", "One", 2),
    ("One", "Two", 10),
    ("Two", "Three", 10),
    ("Three", "Two", 10),
    ("Two", "One", 10),
    ("Panel", "Panel", EVENTS),
    ("Playing", "Stopped", 0),
];

/// Events of a pass.
const EVENTS: u32 = 51;

fn main() -> ExitCode {
    let mut values = BTreeMap::new();
    let mut write = false;
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some((key, value)) => {
                values.insert(key.to_owned(), value.to_owned());
            }
            None if argument == "--write" => write = true,
            // Cargo adds an option of its own.
            None if argument == "--bench" => {}
            None => {
                eprintln!(
                    "the benchmark of machines takes --write, to keep its report in {KEPT}, and no {argument}"
                );
                return ExitCode::from(2);
            }
        }
    }
    if !values.contains_key("host") {
        eprintln!("the benchmark of machines needs its programs: cargo xtask bench machines");
        return ExitCode::from(2);
    }
    match bench(&values, write) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("the benchmark of machines: {problem}");
            ExitCode::from(3)
        }
    }
}

fn bench(values: &BTreeMap<String, String>, write: bool) -> Result<(), String> {
    let value = |key: &str| {
        let value = values.get(key).map(String::as_str);
        value.ok_or_else(|| format!("{key}=… is missing"))
    };
    let plan = Plan::whole()?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let folder = folder.path();
    plan.write(folder).map_err(|error| error.to_string())?;

    let host = PathBuf::from(value("host")?);
    let host_count = measured::host_instructions(&host, folder)?;
    let host_time = measured::nanoseconds(&host, folder)?;
    let fast = setting(Path::new(value("fast")?), folder)?;
    let small = setting(Path::new(value("small")?), folder)?;
    for (where_, measured) in [
        ("host", &host_count),
        ("host, timed", &host_time),
        ("board, for speed", &fast.0),
        ("board, for size", &small.0),
    ] {
        check(measured, &plan).map_err(|problem| format!("{where_}: {problem}"))?;
    }

    let flash = |setting: &str, program: &str| {
        let key = format!("flash-{setting}-{program}");
        value(&key)?
            .parse::<u32>()
            .map_err(|error| format!("{key}: {error}"))
    };
    let mut engines = Vec::new();
    for (row, program, name) in ENGINES {
        engines.push(Engine {
            row,
            name: versioned(name)?,
            flash: [flash("fast", program)?, flash("small", program)?],
            ram: fast.1.get(program).copied(),
        });
    }
    let player = subject::verified(&plan.blobs[0])?;
    let report = Report {
        date: said(Command::new("date").args(["-u", "+%-d %B %Y"])),
        compiler: value("compiler")?.to_owned(),
        emulator: first_line(&said(Command::new(host_tools::qemu::QEMU).arg("--version"))),
        valgrind: said(Command::new("valgrind").arg("--version")),
        settings: [
            Setting {
                name: "M4 -O2",
                measured: fast.0,
            },
            Setting {
                name: "M4 -Os",
                measured: small.0,
            },
            Setting {
                name: "host",
                measured: host_count,
            },
            Setting {
                name: "host ns",
                measured: host_time,
            },
        ],
        engines,
        interpreter_flash: [flash("fast", "esm_alone")?, flash("small", "esm_alone")?],
        player_blob: plan.blobs[0].len(),
        player_ram: player.ram_bytes(),
        interpreter_ram: fast.1.get("esm").copied().unwrap_or(0),
        events: EVENTS,
    };
    print!("{}", report.text());
    if write {
        let file = root().join(KEPT);
        fs::write(&file, report.markdown())
            .map_err(|error| format!("{}: {error}", file.display()))?;
        println!("\nKept in {}.", file.display());
    }
    Ok(())
}

/// What the programs of one setting tell, and the bytes of RAM that each one's machine takes.
fn setting(
    programs: &Path,
    folder: &Path,
) -> Result<(Measured, BTreeMap<&'static str, u32>), String> {
    let mut all = Measured::default();
    let mut ram = BTreeMap::new();
    for program in ENGINES
        .map(|(_, program, _)| program)
        .into_iter()
        .chain(["esm"])
    {
        let measured = measured::board_instructions(&programs.join(program), folder)
            .map_err(|problem| format!("{program}: {problem}"))?;
        if let Some([bytes]) = measured.told("ram") {
            ram.insert(program, *bytes);
        }
        all = all.and(measured);
    }
    Ok((all, ram))
}

/// Whether each machine did what its chart says.
fn check(measured: &Measured, plan: &Plan) -> Result<(), String> {
    for (row, ..) in &ENGINES[1..] {
        let row = format!("cd51-{row}");
        let counts = measured.told(&row).unwrap_or_default();
        if counts != ACTIONS {
            return Err(format!("{row}: actions {counts:?}, expected {ACTIONS:?}"));
        }
    }
    let player = subject::verified(&plan.blobs[0])?;
    let directory = Directory::of(&player.tables()).map_err(|error| error.to_string())?;
    let counts = measured.told("cd51-esm").unwrap_or_default();
    let mut taken: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    for (transition, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let words = (0..directory.regions().len())
            .find_map(|region| directory.transition(region, transition))
            .ok_or_else(|| format!("transition {transition} was counted and does not exist"))?;
        *taken.entry((last(words.from), last(words.to))).or_default() += count;
    }
    let expected: BTreeMap<(&str, &str), u32> = TRANSITIONS
        .into_iter()
        .filter(|(.., count)| *count > 0)
        .map(|(from, to, count)| ((from, to), count))
        .collect();
    if taken != expected {
        return Err(format!(
            "cd51-esm: transitions {taken:?}, expected {expected:?}"
        ));
    }
    for (row, _) in charts::GUARDS {
        took(measured, row, 0)?;
    }
    for regions in charts::REGIONS {
        for depth in charts::DEPTHS {
            for transitions in charts::TRANSITIONS {
                let row = format!("{regions}-{depth}-{transitions}");
                took(measured, &format!("still-{row}"), 0)?;
                took(measured, &format!("stirred-{row}"), 0)?;
            }
        }
        // The panel's own transition, and one in each region that waits for the event.
        took(measured, &format!("unheard-{regions}"), 1)?;
        took(measured, &format!("storm-{regions}"), 1 + regions as u32)?;
    }
    for level in 1..=charts::LEVELS {
        took(measured, &format!("deep-{level}"), 2)?;
    }
    Ok(())
}

/// Whether that many transitions were taken in what was measured.
fn took(measured: &Measured, row: &str, transitions: u32) -> Result<(), String> {
    match measured.told(row) {
        Some([taken]) if *taken == transitions => Ok(()),
        taken => Err(format!(
            "{row}: {taken:?} transitions, expected {transitions}"
        )),
    }
}

/// The last word of a path.
fn last(path: &str) -> &str {
    path.rsplit(['.', '/']).next().unwrap_or(path)
}

/// The name of an engine with the version that was measured, where it has one.
fn versioned(name: &str) -> Result<String, String> {
    let lock = root().join("benches/Cargo.lock");
    let lock = fs::read_to_string(&lock).map_err(|error| format!("{}: {error}", lock.display()))?;
    let head = format!("name = \"{name}\"\nversion = \"");
    Ok(
        match lock
            .split_once(&head)
            .and_then(|(_, rest)| rest.split('"').next())
        {
            Some(version) => format!("{name} {version}"),
            None => name.to_owned(),
        },
    )
}

fn said(command: &mut Command) -> String {
    let output = command
        .output()
        .map(|output| output.stdout)
        .unwrap_or_default();
    String::from_utf8_lossy(&output).trim().to_owned()
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().to_owned()
}
