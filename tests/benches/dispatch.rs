//! Runs the dispatch benchmark's firmware in the emulator and prints what it measures: what
//! `cargo xtask bench dispatch` starts.
//!
//! Its arguments are `--board` with a name, and the firmwares, `bench_dispatch.rs` and, of the
//! default board, `bench_links.rs` of `boards/<name>/src/bin`. What it prints last are tables in
//! Markdown; with `--json`, one object is all that it prints.

use std::collections::BTreeMap;
use std::error::Error;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use esm_tests::benchmark::emulated::Emulated;
use esm_tests::benchmark::link_costs::{self, LinkCosts};
use esm_tests::command::root;
use esm_tests::exactness;
use esm_tests::random::Random;
use esm_tests::subject::build_file;
use host_tools::compile::{self, NameTable};
use host_tools::lang;
use host_tools::link_client::{StreamEvent, Streams};

/// Slots of the missions that are measured, the interpreter's included; the firmware has room for
/// the most of them.
const SLOTS: [usize; 3] = [8, 16, 64];
/// The CD player, whose macro steps are measured.
const PLAYER: &str = "tests/data/cd51.esm";
/// The one that the limits hold for.
const MAIN_SLOTS: usize = 16;
/// Time for the interpreter: an instruction takes long here, and a machine with 200 tasks many of
/// them.
const INTERPRETER_US: usize = 30_000;
/// From one slot to the next, in microseconds.
const DISTANCE_US: usize = 4_000;
/// Slots that have a task, at most: tasks take more of a blob than slots do.
const TASKS: usize = 60;
/// Slots from one with an enabled task to the next, as the firmware has it.
const DISTANCE_OF_TASKS: usize = 3;
/// Types of the enabled tasks, in the order in which slots have them, with their inputs and
/// outputs; as the firmware has them.
const KINDS: [(&str, &[&str], &[&str]); 3] = [
    ("Probe", &[], &[]),
    ("Two", &["from"], &["to"]),
    ("Four", &["first", "second"], &["to", "also"]),
];
/// Duration of such a slot, in microseconds.
const DURATION_US: usize = 3_500;
/// Activations whose start times are compared with what they should be.
const ACTIVATIONS: u64 = 1_000_000_000;
/// How long the emulator may take for a run.
const RUN_LIMIT: Duration = Duration::from_secs(60);

/// How many ports the tasks of [`KINDS`] have.
fn kinds_ports() -> [usize; KINDS.len()] {
    KINDS.map(|(_, inputs, outputs)| inputs.len() + outputs.len())
}

/// What runs in slot 0.
#[derive(Clone, Copy, PartialEq)]
enum Background {
    /// A task that calls nothing.
    Spin,
    /// A task that goes through the framework all the time.
    Call,
}

/// Least, most and mean of what was counted, in tenths of an instruction.
#[derive(Clone, Copy)]
struct Range {
    min: u32,
    max: u32,
    mean: u32,
    count: u32,
}

/// What a run of the firmware printed.
struct Measured {
    slots: usize,
    background: Background,
    rows: Vec<(String, Range)>,
    /// Bytes that the link sent and received in a second of the board's time.
    bytes_a_second: (u64, u64),
}

impl Measured {
    fn row(&self, name: &str) -> Option<Range> {
        let found = self.rows.iter().find(|(of, _)| of == name);
        found.map(|(_, range)| *range)
    }

    /// What a task with so many ports adds to its slot's handler and to the one before, in which it
    /// is made ready, in tenths of an instruction.
    fn task_adds(&self, ports: usize) -> Option<u32> {
        let measured = |name: String| self.row(&name).filter(|range| range.count > 0);
        let whole = measured("whole".to_owned())?;
        let before = measured(format!("before-{ports}"))?;
        let with = measured(format!("with-{ports}"))?;
        Some((before.mean + with.mean).saturating_sub(2 * whole.mean))
    }
}

/// What is measured.
struct Subject {
    /// QEMU's name of the board.
    machine: &'static str,
    firmware: PathBuf,
    /// The firmware with links, where the board has one.
    with_links: Option<PathBuf>,
}

/// What the arguments ask for.
struct Wanted {
    subject: Subject,
    json: bool,
}

impl Wanted {
    fn from_arguments(arguments: impl Iterator<Item = OsString>) -> Result<Self, String> {
        let mut arguments = arguments;
        let mut machine = host_tools::qemu::machine();
        let mut files = Vec::new();
        let mut json = false;
        while let Some(argument) = arguments.next() {
            match argument.to_str() {
                // Cargo adds an option of its own.
                Some("--bench") => {}
                Some("--json") => json = true,
                Some("--board") => {
                    let name = arguments.next().unwrap_or_default();
                    let name = name.to_string_lossy();
                    machine = host_tools::qemu::machine_of(&name)
                        .ok_or_else(|| format!("QEMU emulates no board {name}"))?;
                }
                Some(option) if option.starts_with('-') => {
                    return Err(format!("there is no {option}, only --json and --board"));
                }
                _ => files.push(PathBuf::from(argument)),
            }
        }
        let mut files = files.into_iter();
        let firmware = files.next().ok_or("a firmware is needed")?;
        let subject = Subject {
            machine,
            firmware,
            with_links: files.next(),
        };
        Ok(Wanted { subject, json })
    }
}

fn main() -> ExitCode {
    let wanted = match Wanted::from_arguments(std::env::args_os().skip(1)) {
        Ok(wanted) => wanted,
        Err(problem) => {
            eprintln!("the benchmark of the dispatcher: {problem}: cargo xtask bench dispatch");
            return ExitCode::from(2);
        }
    };
    let ended = match wanted.json {
        false => bench(&wanted.subject),
        true => bench_json(&wanted.subject),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("the benchmark of the dispatcher: {error}");
            ExitCode::from(3)
        }
    }
}

/// Runs the firmware with each number of slots, beside each background; `each` hears of every run.
fn run_all(subject: &Subject, each: impl Fn(&Measured)) -> Result<Vec<Measured>, Box<dyn Error>> {
    let mut runs = Vec::new();
    for slots in SLOTS {
        for background in [Background::Spin, Background::Call] {
            let measured = run(subject, slots, background)?;
            each(&measured);
            runs.push(measured);
        }
    }
    Ok(runs)
}

/// Prints what programs want to know as one JSON object, in instructions.
fn bench_json(subject: &Subject) -> Result<(), Box<dyn Error>> {
    let runs = run_all(subject, |_| ())?;
    let mut told = json(&runs).ok_or("the firmware did not measure all")?;
    told["link"] = match &subject.with_links {
        Some(with_links) => link_json(&link_costs::measure(with_links)?),
        None => serde_json::Value::Null,
    };
    println!("{told}");
    Ok(())
}

/// What frames take, for programs.
fn link_json(costs: &LinkCosts) -> serde_json::Value {
    // As it is measured: in tenths.
    let tenths = |it: f64| libm::round(it * 10.0) / 10.0;
    serde_json::json!({
        "transmit": costs.transmit,
        "transmit_none": costs.transmit_none,
        "transmit_beyond": tenths(costs.transmit_beyond()),
        "receive": costs.receive,
        "receive_none": costs.receive_none,
        "receive_beyond": tenths(costs.receive_beyond()),
        "checksum": costs.checksum,
        "cobs_sent": costs.stuff,
        "cobs_received": costs.unstuff,
        "task": costs.task,
        "interrupts_sent": costs.sent,
        "interrupt_byte": costs.byte,
    })
}

/// The results for programs; none if one is missing.
fn json(runs: &[Measured]) -> Option<serde_json::Value> {
    let of = |tenths: u32| f64::from(tenths) / 10.0;
    let found = |name: &str| {
        let rows = runs.iter().filter_map(|run| run.row(name));
        rows.filter(|range| range.count > 0).collect::<Vec<_>>()
    };
    let starts = found("start");
    let check = found("verify-64");
    let (step, pulse) = (found("macro-step"), found("idle-pulse"));
    let quiet = || {
        let runs = runs.iter().filter(|run| run.background == Background::Spin);
        runs.filter_map(|run| Some((run, run.row("whole").filter(|range| range.count > 0)?)))
    };
    let (main, _) = quiet().find(|(run, _)| run.slots == MAIN_SLOTS)?;
    let adds = kinds_ports().map(|ports| Some((ports.to_string(), of(main.task_adds(ports)?))));
    Some(serde_json::json!({
        "start_min": of(starts.iter().map(|range| range.min).min()?),
        "start_max": of(starts.iter().map(|range| range.max).max()?),
        "dispatch": quiet()
            .map(|(run, whole)| (run.slots.to_string(), of(whole.mean)))
            .collect::<BTreeMap<_, _>>(),
        "task_adds": adds.into_iter().collect::<Option<BTreeMap<_, _>>>()?,
        "check_64_slots": check.first()?.max / 10,
        "macro_step": of(step.first()?.mean),
        "idle_pulse": of(pulse.first()?.mean),
    }))
}

fn bench(subject: &Subject) -> Result<(), Box<dyn Error>> {
    let runs = run_all(subject, |measured| println!("{}", told(measured)))?;
    println!("\n{}", table(&runs));
    if let Some(with_links) = &subject.with_links {
        println!("{}", link_table(&link_costs::measure(with_links)?));
    }
    let begun = Instant::now();
    let run = exactness::run(ACTIVATIONS);
    println!(
        "{} occurrences of 16 slots on the host, {} days of a robot's time, over {} wraps of 32 bits of microseconds and {} of ticks: {} wrong ({:.1} s).",
        run.activations,
        run.robot_s / 86_400,
        run.microsecond_wraps,
        run.tick_wraps,
        run.wrong,
        begun.elapsed().as_secs_f32()
    );
    if run.wrong > 0 {
        return Err("start times are not exact".into());
    }
    Ok(())
}

/// The mission: a slot for the interpreter and probes in others, [`DISTANCE_US`] apart.
fn mission(slots: usize, background: Background) -> Result<Vec<u8>, Box<dyn Error>> {
    let period_us = INTERPRETER_US + slots * DISTANCE_US;
    let mut text = String::from(
        "interpreter slot 1;\ntask Probe slot 2 { }\n\
         task Two slot 2 { in data from: Number optional; out data to: Number; in flag go; param gain: u32 = 1; }\n\
         task Four slot 2 { in data first: Number optional; in data second: Number optional; out data to: Number; out data also: Number; \
         in flag go; out flag odd; param gain: u32 = 1; param offset: u32 = 1; }\n\
         task Spin slot 0 { }\n\
         task Call slot 0 { out data number: Number; out flag odd; }\ntask Read slot 2 { in data number: Number; }\n",
    );
    writeln!(
        text,
        "slot 1 period {period_us} us duration {INTERPRETER_US} us;"
    )?;
    for slot in 2..=slots {
        writeln!(
            text,
            "slot {slot} period {period_us} us duration {DURATION_US} us;"
        )?;
    }
    text.push_str("machine Bench {\nevent Never;\n");
    // Outputs that nobody reads yet.
    let mut open = Vec::new();
    for slot in 2..=slots.min(1 + TASKS) {
        let index = slot - 2;
        if index % DISTANCE_OF_TASKS < DISTANCE_OF_TASKS - 1 {
            writeln!(
                text,
                "region r{slot} {{ state Off; task T{slot}: Probe slot {slot}; initial -> Off; Off -> T{slot} on Never; T{slot} -> Off on Never; }}"
            )?;
            continue;
        }
        let (task, inputs, outputs) = KINDS[index / DISTANCE_OF_TASKS % KINDS.len()];
        writeln!(
            text,
            "region r{slot} {{ task T{slot}: {task} slot {slot}; initial -> T{slot}; T{slot} -> T{slot} on *; }}"
        )?;
        for input in inputs {
            if let Some(output) = open.pop() {
                writeln!(text, "path {output} -> T{slot}.{input};")?;
            }
        }
        open.extend(outputs.iter().map(|output| format!("T{slot}.{output}")));
    }
    text.push_str(match background {
        Background::Spin => "region below { task Work: Spin; initial -> Work; Work -> Work on *; }\n",
        Background::Call => {
            "region below { task Work: Call; initial -> Work; Work -> Work on *; }\n\
             region reader { task Take: Read; initial -> Take; Take -> Take on *; }\npath Work.number -> Take.number;\n"
        }
    });
    text.push_str("}\n");
    let starts_us: Vec<u32> = (0..slots)
        .map(|slot| match slot {
            0 => 0,
            _ => (INTERPRETER_US + slot * DISTANCE_US) as u32,
        })
        .collect();
    compiled(&text, &starts_us, |_| ())
}

fn compiled(
    text: &str,
    starts_us: &[u32],
    change: impl FnOnce(&mut host_tools::model::Model),
) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut checked = lang::load_text("bench.esm", text);
    checked.require_machine();
    if checked.has_errors() {
        return Err(checked.render(false).into());
    }
    let mut model = checked.model.ok_or("the front end gave no model")?;
    change(&mut model);
    // A mission of 200 tasks has no room for their names.
    Ok(compile::compile_with(
        &model,
        starts_us,
        NameTable::LeftOut,
    )?)
}

/// The name of a file, and what is in it.
type Checked = (&'static str, Vec<u8>);

/// Missions whose check is measured.
fn checked_missions() -> Result<Vec<Checked>, Box<dyn Error>> {
    const FRAME_US: u32 = 2_500;
    const MULTIPLES: [u32; 8] = [1, 2, 4, 5, 8, 10, 16, 20];
    let of = |slots: u32| {
        let mut text = String::from(
            "interpreter slot 1;\nmachine Empty { region r { state S; initial -> S; S -> S; } }\n",
        );
        for slot in 0..slots {
            let period_us = FRAME_US * MULTIPLES[slot as usize % MULTIPLES.len()];
            let _ = writeln!(
                text,
                "slot {} period {period_us} us duration 30 us;",
                slot + 1
            );
        }
        text
    };
    // Each slot keeps to its own part of the frame.
    let starts_us: Vec<u32> = (0..64).map(|slot| slot * 39).collect();
    // Slots without duration never overlap, whatever their periods: the check goes on to the end.
    let mut random = Random::new(1);
    let worst = compiled(&of(64), &[0; 64], |model| {
        for slot in &mut model.slots {
            slot.duration_us = 0;
            slot.period_us = (3_900_000_000 + random.below(100_000_000)) as u32;
        }
    })?;
    Ok(vec![
        ("slots-1.blob", compiled(&of(1), &starts_us[..1], |_| ())?),
        ("slots-64.blob", compiled(&of(64), &starts_us, |_| ())?),
        ("slots-64-worst.blob", worst),
    ])
}

/// Uploads a mission to the firmware and keeps the link busy until the firmware has told what it
/// measured.
fn run(
    subject: &Subject,
    slots: usize,
    background: Background,
) -> Result<Measured, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    if slots == MAIN_SLOTS && background == Background::Spin {
        for (name, blob) in checked_missions()? {
            fs::write(folder.path().join(name), blob)?;
        }
        let player = build_file(&root().join(PLAYER))?;
        fs::write(folder.path().join("cd51.blob"), player.blob)?;
    }
    let (mut board, mut client) =
        Emulated::start_on(subject.machine, &subject.firmware, folder.path(), &[])?;
    client.upload(&mission(slots, background)?, &mut |_| ())?;
    let deadline = Instant::now() + RUN_LIMIT;
    let mut received = 0;
    let mut slot = 0;
    let mut subscribed = false;
    while board.runs()? {
        if Instant::now() > deadline {
            return Err(format!(
                "the firmware does not come to an end: {:?}",
                client.status()
            )
            .into());
        }
        // While the firmware measures whole handlers, the link sleeps, and nothing of this is
        // answered. At the end the line goes away.
        subscribed = subscribed
            || client
                .subscribe(Streams {
                    trace: true,
                    log: true,
                    ..Streams::NONE
                })
                .is_ok();
        let _ = client.slot_counters(slot);
        slot = (slot + 1) % slots as u8;
        for event in client.take_events() {
            if let StreamEvent::Trace(bytes) | StreamEvent::Log(bytes) = event {
                received += bytes.len() as u64;
            }
        }
    }
    let console = board.printed()?;
    Ok(Measured {
        slots,
        background,
        rows: rows(&console).ok_or_else(|| format!("the firmware says:\n{console}"))?,
        bytes_a_second: (received / LOUD_S, client.counts().bytes_sent / LOUD_S),
    })
}

/// Seconds for which the link is busy, as the firmware counts them.
const LOUD_S: u64 = 8;

fn rows(console: &str) -> Option<Vec<(String, Range)>> {
    // The emulator itself remarks there that a timer was stopped.
    let lines = console.lines().filter(|line| !line.starts_with("Timer "));
    let rows = lines.map(|line| {
        let mut words = line.split_whitespace();
        let name = words.next()?.to_owned();
        let mut number = || words.next()?.parse().ok();
        let range = Range {
            min: number()?,
            max: number()?,
            mean: number()?,
            count: number()?,
        };
        Some((name, range))
    });
    rows.collect::<Option<Vec<_>>>()
        .filter(|rows| !rows.is_empty())
}

/// Instructions, of tenths.
fn instructions(tenths: u32) -> String {
    format!("{}.{}", tenths / 10, tenths % 10)
}

fn told(run: &Measured) -> String {
    let mut text = format!(
        "{} slots, slot 0 {}, link {} bytes/s of streams out, {} bytes/s in",
        run.slots,
        match run.background {
            Background::Spin => "spinning",
            Background::Call => "calling the framework",
        },
        run.bytes_a_second.0,
        run.bytes_a_second.1,
    );
    for (name, range) in run.rows.iter().filter(|(_, range)| range.count > 0) {
        let _ = write!(
            text,
            "\n    {name}: {} to {}, mean {}, of {}",
            instructions(range.min),
            instructions(range.max),
            instructions(range.mean),
            range.count
        );
    }
    text
}

/// What frames take, for the book.
fn link_table(costs: &LinkCosts) -> String {
    let mut text = String::from("| a frame of 16 bytes over a link | instructions |\n|---|---|\n");
    for (says, instructions) in [
        ("`transmit` with a frame adds to its slot", costs.transmit),
        ("without one", costs.transmit_none),
        ("`receive` with a frame adds to its slot", costs.receive),
        ("without one", costs.receive_none),
        ("any task adds", costs.task),
        ("checksum", costs.checksum),
        ("COBS of a frame that is sent", costs.stuff),
        ("COBS of one that is received", costs.unstuff),
        (
            "sending a frame beyond checksum and COBS",
            costs.transmit_beyond(),
        ),
        (
            "receiving one beyond checksum and COBS",
            costs.receive_beyond(),
        ),
        ("interrupts that send its 26 bytes", costs.sent),
        ("interrupt that receives a byte", costs.byte),
    ] {
        let _ = writeln!(text, "| {says} | {instructions:.1} |");
    }
    text
}

/// The results for the book.
fn table(runs: &[Measured]) -> String {
    let mut text = String::from(
        "| slots | slot 0 | start of the task, instructions | spread |\n|---|---|---|---|\n",
    );
    for run in runs {
        let Some(start) = run.row("start") else {
            continue;
        };
        let _ = writeln!(
            text,
            "| {} | {} | {} to {} | ±{} |",
            run.slots,
            match run.background {
                Background::Spin => "spins",
                Background::Call => "calls the framework",
            },
            instructions(start.min),
            instructions(start.max),
            instructions((start.max - start.min).div_ceil(2)),
        );
    }
    text.push_str(
        "\n| slots | dispatch: least | mean | most | a task of 0 ports adds | 2 ports | 4 ports |\n|---|---|---|---|---|---|---|\n",
    );
    for run in runs {
        let Some(whole) = run.row("whole").filter(|range| range.count > 0) else {
            continue;
        };
        let _ = write!(
            text,
            "| {} | {} | {} | {} |",
            run.slots,
            instructions(whole.min),
            instructions(whole.mean),
            instructions(whole.max)
        );
        for ports in kinds_ports() {
            let _ = match run.task_adds(ports) {
                Some(adds) => write!(text, " {} |", instructions(adds)),
                None => write!(text, " |"),
            };
        }
        text.push('\n');
    }
    text.push_str("\n| check of a mission on the board | instructions |\n|---|---|\n");
    for (name, says) in [
        ("verify-1", "1 slot"),
        ("verify-64", "64 slots"),
        (
            "verify-64-worst",
            "64 slots with periods of 3,900 to 4,000 s without a common factor",
        ),
    ] {
        if let Some(range) = runs.iter().find_map(|run| run.row(name)) {
            let _ = writeln!(text, "| {says} | {} |", range.max / 10);
        }
    }
    text.push_str("\n| interpreter, CD player | least | mean | most |\n|---|---|---|---|\n");
    for (name, says) in [
        (
            "macro-step",
            "macro step, from a task's flag through event to transition",
        ),
        ("idle-pulse", "pulse with nothing to do"),
    ] {
        if let Some(range) = runs.iter().find_map(|run| run.row(name)) {
            let _ = writeln!(
                text,
                "| {says} | {} | {} | {} |",
                instructions(range.min),
                instructions(range.mean),
                instructions(range.max)
            );
        }
    }
    text
}
