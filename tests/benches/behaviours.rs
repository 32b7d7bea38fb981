//! `cargo xtask bench behaviours`: what a behaviour adds to a task, and what the slot takes that
//! wheels, odometry and behaviours share.
//!
//! Its arguments are two firmwares of the default board with behaviours:
//! `boards/lm3s6965/src/bin/bench_behaviours.rs`, which measures itself, and the rover, which
//! drives missions. With `--gate` it ends with status 1 where a limit does not hold.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use esm_tests::benchmark::emulated::Emulated;
use esm_tests::command::esm;
use host_tools::compile::{self, NameTable};
use host_tools::lang;

/// What a behaviour may add to a careful task, in instructions.
const MOST_ADDED: f64 = 100.0;
/// What an activation of the slot may take, in instructions.
const MOST_TOGETHER: f64 = 30_000.0;
/// What an instruction takes where the rover drives, in microseconds.
const INSTRUCTION_US: f64 = 0.064;

/// As the firmware has them.
const INTERPRETER_US: u32 = 15_000;
const DISTANCE_US: u32 = 4_000;
const PERIOD_US: u32 = 90_000;
const DURATION_US: u32 = 3_500;
/// What runs in each second slot: the regions in it, and the nets of their lists.
const KINDS: [&[(&str, &str)]; 8] = [
    &[],
    &[("Plain0", "PlainMove"), ("Owner", "Behaviours")],
    &[("Plain1", "PlainMove")],
    &[("Careful1", "CarefulMove")],
    &[("Go1", "Move"), ("Owner1", "Behaviours")],
    &[("Plain2", "PlainGoTo")],
    &[("Careful2", "CarefulGoTo")],
    &[("Go2", "GoTo"), ("Owner2", "Behaviours")],
];
/// Task types that the firmware has.
const TASK_TYPES: u8 = 9;
/// The lists: who owns each, and who is on it.
const LISTS: [(&str, &[&str]); 3] = [("Owner", &[]), ("Owner1", &["Go1"]), ("Owner2", &["Go2"])];
/// The laws: what they are called, and in the firmware.
const LAWS: [(&str, &str); 2] = [("`Move`", "move"), ("`GoTo`", "go-to")];

/// What drives in the emulator: what it is, and the command's arguments.
const DRIVES: [(&str, &[&str]); 4] = [
    (
        "`guard.esm`, `Move` and `TurnTo`, 60 s",
        &["missions/guard.esm", "--until", "60 s"],
    ),
    (
        "`by_hand.esm` with `square.script`, 45 s",
        &[
            "missions/by_hand.esm",
            "--world",
            "empty",
            "--until",
            "45 s",
            "--script",
            "missions/square.script",
        ],
    ),
    (
        "`errand.esm`, `FollowCorridor`, `PassDoor` and others, 270 s",
        &[
            "missions/errand.esm",
            "--world",
            "office_floor",
            "--until",
            "270 s",
        ],
    ),
    (
        "`by_hand.esm` with `doors.script`: `FollowCorridor`, a landmark watched beside it, 60 s",
        &[
            "missions/by_hand.esm",
            "--world",
            "corridor",
            "--until",
            "60 s",
            "--script",
            "missions/doors.script",
        ],
    ),
];
/// How long the emulator may take for the firmware that measures itself.
const RUN_LIMIT: Duration = Duration::from_secs(120);

fn main() -> ExitCode {
    // Cargo adds an option of its own.
    let arguments = std::env::args().skip(1).filter(|it| it != "--bench");
    let (options, files): (Vec<_>, Vec<_>) = arguments.partition(|it| it.starts_with('-'));
    if let Some(wrong) = options.iter().find(|option| *option != "--gate") {
        eprintln!("the benchmark of behaviours has no {wrong}, only --gate");
        return ExitCode::from(2);
    }
    let [measuring, rover] = files.as_slice() else {
        eprintln!("the benchmark of behaviours needs firmware: cargo xtask bench behaviours");
        return ExitCode::from(2);
    };
    let holds = measured(Path::new(measuring))
        .and_then(|measured| told_of_laws(&measured))
        .and_then(|laws_hold| Ok(told_of_drives(rover)? && laws_hold));
    match holds {
        Ok(holds) if !holds && !options.is_empty() => ExitCode::from(1),
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("the benchmark of behaviours: {error}");
            ExitCode::from(3)
        }
    }
}

/// The mean of what each kind takes in both handlers, in instructions, by its name in the firmware.
fn measured(firmware: &Path) -> Result<BTreeMap<String, f64>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let (mut board, mut client) = Emulated::start(firmware, folder.path())?;
    let declarations = (0..TASK_TYPES).map(|index| client.task_declaration(index));
    let declarations = declarations.collect::<Result<Vec<_>, _>>()?;
    client.upload(&mission(&declarations.concat())?, &mut |_| ())?;
    let deadline = Instant::now() + RUN_LIMIT;
    while board.runs()? {
        if Instant::now() > deadline {
            return Err("the firmware does not come to an end".into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let console = board.printed()?;
    let mut means = BTreeMap::new();
    for line in console.lines().filter(|line| !line.starts_with("Timer ")) {
        // Of this kind, when: least, most, mean in tenths, and how many.
        let words: Vec<&str> = line.split_whitespace().collect();
        let (&[name, _, _, mean, count], Some((_, kind))) = (&words[..], line.split_once('-'))
        else {
            return Err(format!("the firmware says:\n{console}").into());
        };
        if count == "0" {
            return Err(format!("the firmware has not measured {name}").into());
        }
        let kind = kind.split_whitespace().next().unwrap_or_default();
        *means.entry(kind.to_owned()).or_default() += mean.parse::<f64>()? / 10.0;
    }
    Ok(means)
}

/// The mission: the tasks of [`KINDS`], each with what feeds it.
fn mission(declarations: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut text = format!("interpreter slot 1;\n{declarations}\n");
    let slots = 2 + 2 * KINDS.len() as u32;
    let starts_us: Vec<u32> = (0..slots)
        .map(|slot| match slot {
            0 => 0,
            slot => INTERPRETER_US + slot * DISTANCE_US,
        })
        .collect();
    writeln!(
        text,
        "slot 1 period {PERIOD_US} us duration {INTERPRETER_US} us;"
    )?;
    for slot in 2..=slots {
        writeln!(
            text,
            "slot {slot} period {PERIOD_US} us duration {DURATION_US} us;"
        )?;
    }
    text.push_str(
        "machine Bench {\nregion feeds { task Source: Feed slot 2; initial -> Source; }\n",
    );
    let mut fed = Vec::new();
    for (kind, tasks) in KINDS.into_iter().enumerate() {
        for (name, task) in tasks {
            let slot = 4 + 2 * kind;
            writeln!(
                text,
                "region r{name} {{ task {name}: {task} slot {slot}; initial -> {name}; }}"
            )?;
            fed.push(*name);
        }
    }
    for port in ["pose", "ranges"] {
        let to: Vec<String> = fed.iter().map(|name| format!("{name}.{port}")).collect();
        writeln!(text, "path Source.{port} -> {};", to.join(", "))?;
    }
    for (owner, on_it) in LISTS {
        let to: Vec<String> = [&owner]
            .into_iter()
            .chain(on_it)
            .map(|name| format!("{name}.list"))
            .collect();
        writeln!(text, "path {owner}.made -> {};", to.join(", "))?;
    }
    text.push_str("region below { task Work: Spin; initial -> Work; Work -> Work on *; }\n}\n");
    let mut checked = lang::load_text("bench.esm", &text);
    checked.require_machine();
    if checked.has_errors() {
        return Err(checked.render(false).into());
    }
    let model = checked.model.ok_or("the front end gave no model")?;
    Ok(compile::compile_with(
        &model,
        &starts_us,
        NameTable::LeftOut,
    )?)
}

/// Prints what a behaviour adds. Whether all of it is within the limit.
fn told_of_laws(means: &BTreeMap<String, f64>) -> Result<bool, Box<dyn Error>> {
    let mean = |kind: &str| {
        let found = means.get(kind).copied();
        found.ok_or_else(|| format!("the firmware tells nothing of {kind}"))
    };
    let nothing = mean("nothing")?;
    // Behind another task, as a behaviour has it.
    let owner = mean("owner")? - mean("move-plain")?;
    println!(
        "| law | plain task | careful task | behaviour | adds to a careful task | to a plain one |\n\
         |---|---|---|---|---|---|"
    );
    let mut holds = true;
    for (law, kind) in LAWS {
        let of = |what: &str| Ok::<f64, String>(mean(&format!("{kind}-{what}"))? - nothing);
        let (plain, careful) = (of("plain")?, of("careful")?);
        let behaviour = of("behaviour")? - owner;
        println!(
            "| {law} | {plain:.0} | {careful:.0} | {behaviour:.0} | {:.0} | {:.0} |",
            behaviour - careful,
            behaviour - plain
        );
        holds &= behaviour - careful <= MOST_ADDED;
    }
    println!("\nThe owner of a list with nobody on it, behind another task, takes {owner:.0}.\n");
    Ok(holds)
}

/// Prints what the slot takes that all share. Whether all of it is within the limit.
fn told_of_drives(rover: &str) -> Result<bool, Box<dyn Error>> {
    println!("| wheels, odometry and behaviours, each 10 ms | mean | most |\n|---|---|---|");
    let mut holds = true;
    for (what, arguments) in DRIVES {
        let run = [&["run"], arguments, &["--firmware", rover]].concat();
        let shown = esm(&run).good().out;
        let times = slot_times(&shown, 2)
            .ok_or_else(|| format!("the run tells no times of slot 2:\n{shown}"))?;
        let [mean, most] = times.map(|us| us / INSTRUCTION_US);
        println!("| {what} | {mean:.0} | {most:.0} |");
        holds &= most <= MOST_TOGETHER;
    }
    Ok(holds)
}

/// The mean and the longest time of a slot in a run's summary, in microseconds.
fn slot_times(shown: &str, slot: u32) -> Option<[f64; 2]> {
    let mut lines = shown.lines();
    let line = lines.find(|line| line.trim_start().starts_with(&format!("slot {slot} ")))?;
    let (_, lasts) = line.split_once("lasts ")?;
    let (_, rest) = lasts.split_once(" to ")?;
    let (most, rest) = rest.split_once(", ")?;
    let (mean, _) = rest.split_once(" on average")?;
    Some([micros(mean)?, micros(most)?])
}

/// Microseconds, of a time as the command tells it.
fn micros(time: &str) -> Option<f64> {
    let (number, unit) = time.split_once(' ')?;
    let number: f64 = number.parse().ok()?;
    match unit {
        "ns" => Some(number / 1e3),
        "us" => Some(number),
        "ms" => Some(number * 1e3),
        _ => None,
    }
}
