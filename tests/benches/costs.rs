//! Runs one program on each core in the emulator, and prints what the runtime takes there: what
//! `cargo xtask bench costs` starts.
//!
//! Its arguments are four for each core: target, the program of `boards/costs` for it, and its
//! bytes of flash and of RAM. What it prints is a table in Markdown; with `--json`, one object is
//! all that it prints.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{ExitCode, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use esm_tests::benchmark::emulated::emulator;
use esm_tests::command::root;
use esm_tests::subject;
use host_tools::compile::{self, NameTable};
use host_tools::lang;
use serde_json::{Value, json};

/// Targets with their cores, and the machine of QEMU's that has each.
const CORES: [(&str, &str, &str); 4] = [
    ("thumbv6m-none-eabi", "Cortex-M0", "microbit"),
    ("thumbv7m-none-eabi", "Cortex-M3", "lm3s6965evb"),
    ("thumbv7em-none-eabihf", "Cortex-M4F", "mps2-an386"),
    ("thumbv8m.main-none-eabihf", "Cortex-M33", "mps2-an505"),
];
/// Nanoseconds that an instruction takes, as a power of two: more than ten ticks of each machine.
const SHIFT: u32 = 10;
/// How long the emulator may take for a run.
const RUN_LIMIT: Duration = Duration::from_secs(60);
/// The CD player, whose macro steps are measured.
const PLAYER: &str = "tests/data/cd51.esm";
/// Slots with a task, as the program has them.
const TASKS: usize = 7;
/// From one slot to the next, in microseconds.
const DISTANCE_US: usize = 1_000;
/// Periods of which the program executes the tasks, and the least that are measured.
const PERIODS: u32 = 32;

/// Ticks, and of how many occasions.
type Row = (u32, u32);

/// What the runtime takes on a core, in instructions and bytes.
struct Costs {
    core: &'static str,
    machine: &'static str,
    flash_bytes: u32,
    ram_bytes: u32,
    stack_bytes: u32,
    macro_step: f64,
    idle_pulse: f64,
    dispatch: f64,
    task: f64,
}

impl Costs {
    fn json(&self) -> Value {
        // As it is told in the table.
        let tenths = |it: f64| libm::round(it * 10.0) / 10.0;
        json!({
            "machine": self.machine,
            "flash_bytes": self.flash_bytes,
            "ram_bytes": self.ram_bytes,
            "stack_bytes": self.stack_bytes,
            "macro_step": tenths(self.macro_step),
            "idle_pulse": tenths(self.idle_pulse),
            "dispatch": tenths(self.dispatch),
            "task": tenths(self.task),
        })
    }
}

fn main() -> ExitCode {
    // Cargo adds an option of its own.
    let arguments = std::env::args()
        .skip(1)
        .filter(|argument| argument != "--bench");
    let (options, given): (Vec<_>, Vec<_>) =
        arguments.partition(|argument| argument.starts_with('-'));
    if let Some(wrong) = options.iter().find(|option| *option != "--json") {
        eprintln!("the benchmark of the cores has no {wrong}, only --json");
        return ExitCode::from(2);
    }
    let (cores, rest) = given.as_chunks::<4>();
    if cores.is_empty() || !rest.is_empty() {
        eprintln!("the benchmark of the cores needs a program for each: cargo xtask bench costs");
        return ExitCode::from(2);
    }
    let measured: Result<Vec<Costs>, _> = cores.iter().map(measure).collect();
    match measured {
        Ok(measured) if options.is_empty() => print!("{}", table(&measured)),
        Ok(measured) => {
            let cores = measured.iter().map(|of| (of.core, of.json()));
            println!("{}", json!(cores.collect::<BTreeMap<_, _>>()));
        }
        Err(error) => {
            eprintln!("the benchmark of the cores: {error}");
            return ExitCode::from(3);
        }
    }
    ExitCode::SUCCESS
}

/// Measures one core.
fn measure([target, program, flash, ram]: &[String; 4]) -> Result<Costs, Box<dyn Error>> {
    let core = CORES.into_iter().find(|(of, ..)| of == target);
    let (_, core, machine) = core.ok_or_else(|| format!("nobody knows a machine for {target}"))?;
    let player = subject::build_file(&root().join(PLAYER))?.blob;
    let without = run(machine, Path::new(program), &player, &mission(false)?)?;
    let with = run(machine, Path::new(program), &player, &mission(true)?)?;
    let of = |rows: &BTreeMap<String, Row>, name: &str| {
        let row = rows.get(name).copied().filter(|(_, count)| *count > 0);
        row.ok_or_else(|| format!("{machine} did not measure {name}"))
    };
    let instructions = |rows: &BTreeMap<String, Row>, name: &str| {
        let ((ticks, count), (thousand, _)) = (of(rows, name)?, of(rows, "thousand")?);
        if thousand == 0 {
            return Err(format!("the clock of {machine} stands still"));
        }
        Ok(f64::from(ticks) * 1_000.0 / f64::from(count) / f64::from(thousand))
    };
    // A task that is not executed, or is where it is off, costs something else.
    for (rows, enabled) in [(&without, false), (&with, true)] {
        let (_, slots) = of(rows, "slot")?;
        let (executed, _) = of(rows, "executed")?;
        if slots < (PERIODS - 1) * TASKS as u32 || (executed >= slots) != enabled {
            return Err(
                format!("{machine}: {executed} tasks were executed in {slots} slots").into(),
            );
        }
    }
    let dispatch = instructions(&without, "slot")?;
    Ok(Costs {
        core,
        machine,
        flash_bytes: flash.parse()?,
        ram_bytes: ram.parse()?,
        stack_bytes: of(&with, "stack")?.0,
        macro_step: instructions(&with, "macro-step")?,
        idle_pulse: instructions(&with, "idle-pulse")?,
        dispatch,
        task: instructions(&with, "slot")? - dispatch,
    })
}

/// A mission with a slot for the interpreter and one for each task, all of which are enabled, or
/// none.
fn mission(enabled: bool) -> Result<Vec<u8>, Box<dyn Error>> {
    let slots = TASKS + 1;
    let period_us = (slots + 1) * DISTANCE_US;
    let mut text = String::from("interpreter slot 1;\ntask Probe slot 2 { }\n");
    for slot in 1..=slots {
        writeln!(text, "slot {slot} period {period_us} us duration 500 us;")?;
    }
    text.push_str("machine Costs {\n");
    if !enabled {
        text.push_str("event Never;\n");
    }
    for slot in 2..=slots {
        let task = format!("task T{slot}: Probe slot {slot};");
        let states = match enabled {
            true => format!("{task} initial -> T{slot}; T{slot} -> T{slot} on *;"),
            false => format!(
                "state Off; {task} initial -> Off; Off -> T{slot} on Never; T{slot} -> Off on Never;"
            ),
        };
        writeln!(text, "region r{slot} {{ {states} }}")?;
    }
    text.push_str("}\n");
    let starts_us: Vec<u32> = (0..slots).map(|slot| (slot * DISTANCE_US) as u32).collect();
    compiled(&text, &starts_us)
}

/// A blob without names, for which there is no room.
fn compiled(text: &str, starts_us: &[u32]) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut checked = lang::load_text("costs.esm", text);
    checked.require_machine();
    if checked.has_errors() {
        return Err(checked.render(false).into());
    }
    let model = checked.model.ok_or("the front end gave no model")?;
    let blob = compile::compile_with(&model, starts_us, NameTable::LeftOut)?;
    Ok(blob)
}

/// Runs the program with a mission; returns what it told.
fn run(
    machine: &str,
    program: &Path,
    player: &[u8],
    mission: &[u8],
) -> Result<BTreeMap<String, Row>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("cd51.blob"), player)?;
    fs::write(folder.path().join("mission.blob"), mission)?;
    let console = folder.path().join("console");
    let out = fs::File::create(&console)?;
    let mut emulator = emulator(machine, SHIFT, &program.canonicalize()?, folder.path())
        .args(["-serial", "null"])
        .stdin(Stdio::null())
        .stdout(out.try_clone()?)
        .stderr(out)
        .spawn()?;
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = emulator.try_wait()? {
            break status;
        }
        if begun.elapsed() > RUN_LIMIT {
            emulator.kill()?;
            emulator.wait()?;
            return Err(format!("the program does not come to an end on {machine}").into());
        }
        thread::sleep(Duration::from_millis(5));
    };
    let told = fs::read_to_string(console)?;
    if !status.success() {
        return Err(format!("the program on {machine} ends with {status}: {told}").into());
    }
    let row = |line: &str| {
        let mut words = line.split(' ');
        let name = words.next()?.to_owned();
        let ticks = words.next()?.parse().ok()?;
        let count = words.next()?.parse().ok()?;
        Some((name, (ticks, count)))
    };
    // The emulator itself remarks there that a timer was stopped.
    Ok(told.lines().filter_map(row).collect())
}

/// The results for the book.
fn table(measured: &[Costs]) -> String {
    let mut text = String::from(
        "| core | in QEMU's | flash | RAM | stack | macro step | idle pulse | dispatch | a task adds |\n\
         |---|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for of in measured {
        let _ = writeln!(
            text,
            "| {} | `{}` | {} | {} | {} | {:.1} | {:.1} | {:.1} | {:.1} |",
            of.core,
            of.machine,
            of.flash_bytes,
            of.ram_bytes,
            of.stack_bytes,
            of.macro_step,
            of.idle_pulse,
            of.dispatch,
            of.task
        );
    }
    text
}
