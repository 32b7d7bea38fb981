//! `cargo xtask bench`: what a transition costs, of compiled state machines and of the interpreter,
//! measured in the same run.
//!
//! The programs that are measured are in `benches/`; who builds them tells their paths as
//! `KEY=VALUE`. The missions are made here. Everything is measured before anything is printed, and
//! nothing is printed if a machine did not do what the chart says.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use esm_tests::benchmark::charts::{self, Plan};
use esm_tests::benchmark::limits;
use esm_tests::benchmark::measured::{self, Measured};
use esm_tests::benchmark::report::{self, Engine, Interpreting, Report, Setting, Sizes};
use esm_tests::benchmark::swap;
use esm_tests::command::root;
use esm_tests::subject;
use host_tools::inspect;
use host_tools::run::interrupt::Interrupt;
use host_tools::trace::directory::Directory;

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

/// The settings that checked reads are measured in, too.
const FAST: &str = "M4 -O2";
const SMALL: &str = "M4 -Os";
const HOST: &str = "host";

/// Actions of one pass through the script, as the chart has them: start, open, close, store, stop,
/// pause, resume, stop and open, stopped again, next, previous.
const ACTIONS: [u32; 11] = [1, 2, 2, 1, 1, 2, 1, 0, 1, 20, 20];

/// Transitions of one pass of ours, from and to. A song starts when its disc does, with the next
/// pulse.
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

/// The command line.
#[derive(Default)]
struct Options {
    /// What was built, and where.
    values: BTreeMap<String, String>,
    /// Engines that read a chart when they start: the words of each, its row first.
    interpreting: Vec<Vec<String>>,
    /// Those that are not here: row, name, what runs it, reason.
    absent: Vec<Vec<String>>,
    /// Keep the report.
    write: bool,
    /// A promise that does not hold is a failure.
    gate: bool,
}

impl Options {
    fn value(&self, key: &str) -> Result<&str, String> {
        let value = self.values.get(key).map(String::as_str);
        value.ok_or_else(|| format!("{key}=… is missing"))
    }
}

fn main() -> ExitCode {
    let mut options = Options::default();
    for argument in std::env::args().skip(1) {
        match argument.split_once('=') {
            Some(("interpreting", value)) => options.interpreting.push(words(value)),
            Some(("absent", value)) => options.absent.push(words(value)),
            Some((key, value)) => {
                options.values.insert(key.to_owned(), value.to_owned());
            }
            None if argument == "--write" => options.write = true,
            None if argument == "--gate" => options.gate = true,
            // Cargo adds an option of its own.
            None if argument == "--bench" => {}
            None => {
                eprintln!(
                    "the benchmark of machines takes --write, to keep its report in {KEPT}, and --gate, to fail if a promise does not hold, and no {argument}"
                );
                return ExitCode::from(2);
            }
        }
    }
    if !options.values.contains_key("host") {
        eprintln!("the benchmark of machines needs its programs: cargo xtask bench");
        return ExitCode::from(2);
    }
    // The programs that measure end with it, and so this one with a word about it.
    let interrupted = Interrupt::take_over();
    let told = match options.values.get("only").map(String::as_str) {
        Some("interpreters") => bench_interpreters(&options).map(|()| 0),
        _ => bench(&options),
    };
    match told {
        Ok(broken) if options.gate && broken > 0 => ExitCode::FAILURE,
        Ok(_) => ExitCode::SUCCESS,
        Err(_) if interrupted.is_ok_and(Interrupt::is_requested) => {
            eprintln!(
                "the benchmark of machines: interrupted; what was kept of earlier ones is as it was"
            );
            ExitCode::from(3)
        }
        Err(problem) => {
            eprintln!("the benchmark of machines: {problem}");
            ExitCode::from(3)
        }
    }
}

/// What separates the words of an engine: no path has it.
const BETWEEN: char = '\u{1f}';

fn words(value: &str) -> Vec<String> {
    value.split(BETWEEN).map(str::to_owned).collect()
}

/// Measures events a second on the host, and tells them.
fn bench_interpreters(options: &Options) -> Result<(), String> {
    let plan = Plan::player_alone()?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let folder = folder.path();
    plan.write(folder).map_err(|error| error.to_string())?;
    let time = measured::nanoseconds(Path::new(options.value("host")?), folder)?;
    check_player(&time, &plan)?;
    let mut compiled = Vec::new();
    for (row, _, name) in &ENGINES[1..] {
        compiled.push((*row, versioned(name)?));
    }
    let table = report::speed(&time, &compiled, &interpreting(options)?);
    print!("{}", table.text());
    Ok(())
}

/// Measures compiled machines and the CD player once more, ten times each.
fn player_again(time: &mut Measured, host: &Path) -> Result<(), String> {
    let plan = Plan::player_alone()?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    plan.write(folder.path())
        .map_err(|error| error.to_string())?;
    let again = measured::nanoseconds(host, folder.path())?;
    check_player(&again, &plan)?;
    time.again(again);
    Ok(())
}

/// Measures the engines that read a chart when they start.
fn interpreting(options: &Options) -> Result<Vec<Interpreting>, String> {
    let mut engines = Vec::new();
    for words in &options.interpreting {
        let [row, name, by, program, arguments @ ..] = &words[..] else {
            return Err(format!("{words:?} is no engine"));
        };
        eprintln!("Measuring {name} …");
        let output = measured::output(Command::new(program).args(arguments))?;
        let measured = Measured::timed(&String::from_utf8_lossy(&output.stdout))
            .map_err(|problem| format!("{name}: {problem}"))?;
        check_actions(&measured, row)?;
        engines.push(Interpreting {
            row: row.clone(),
            name: name.clone(),
            by: by.clone(),
            measured: Ok(measured),
        });
    }
    for words in &options.absent {
        let [row, name, by, reason] = &words[..] else {
            return Err(format!("{words:?} is no engine"));
        };
        engines.push(Interpreting {
            row: row.clone(),
            name: name.clone(),
            by: by.clone(),
            measured: Err(reason.clone()),
        });
    }
    Ok(engines)
}

/// Measures and tells; how many promises do not hold.
fn bench(options: &Options) -> Result<usize, String> {
    let plan = Plan::whole()?;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let folder = folder.path();
    plan.write(folder).map_err(|error| error.to_string())?;

    let host = PathBuf::from(options.value("host")?);
    eprintln!("Measuring on the host …");
    let host_count = measured::host_instructions(&host, folder)?;
    let mut host_time = measured::nanoseconds(&host, folder)?;
    eprintln!("Measuring in the emulator …");
    let fast = setting(Path::new(options.value("fast")?), folder)?;
    let small = setting(Path::new(options.value("small")?), folder)?;
    for (where_, measured) in [
        ("host", &host_count),
        ("host, timed", &host_time),
        ("board, for speed", &fast.0),
        ("board, for size", &small.0),
    ] {
        check(measured, &plan).map_err(|problem| format!("{where_}: {problem}"))?;
    }

    // The player once more, when others who use the machine may be done.
    player_again(&mut host_time, &host)?;
    eprintln!("Measuring checked reads …");
    let rows: Vec<&str> = report::CHECKED
        .iter()
        .flat_map(|(_, row, less)| [*row, *less])
        .collect();
    let few = tempfile::tempdir().map_err(|error| error.to_string())?;
    let few = few.path();
    plan.only(&rows)
        .write(few)
        .map_err(|error| error.to_string())?;
    let checked_host = measured::host_instructions(Path::new(options.value("checked-host")?), few)?;
    let on_board = |key: &str| {
        let programs = Path::new(options.value(key)?);
        measured::board_instructions(&programs.join("esm"), few)
    };
    // The harness is the same.
    let checked = [
        Setting {
            name: FAST,
            measured: fast.0.clone().and(on_board("checked-fast")?),
        },
        Setting {
            name: SMALL,
            measured: small.0.clone().and(on_board("checked-small")?),
        },
        Setting {
            name: HOST,
            measured: checked_host,
        },
    ];
    for Setting { name, measured } in &checked {
        for row in &rows {
            if measured.told(row) != fast.0.told(row) {
                return Err(format!(
                    "{name}, {row}: with checked reads it does something else"
                ));
            }
        }
    }

    eprintln!("Swapping missions in the emulator …");
    let swaps = swap::measure(Path::new(options.value("swap")?))?;
    let interpreting = interpreting(options)?;
    player_again(&mut host_time, &host)?;

    let flash = |setting: &str, program: &str| {
        let key = format!("flash-{setting}-{program}");
        options
            .value(&key)?
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
    let player = subject::verified(plan.player())?;
    let sizes = Sizes {
        transition: transitions()?,
        region: region_bytes()?,
        flash: options
            .values
            .get("engine-flash")
            .and_then(|bytes| bytes.parse().ok()),
        player_blob: plan.player().len(),
        player_ram: player.ram_bytes(),
        interpreter_ram: fast.1.get("esm").copied().unwrap_or(0),
        interpreter: [flash("fast", "esm_alone")?, flash("small", "esm_alone")?],
    };
    let report = Report {
        date: said(Command::new("date").args(["-u", "+%-d %B %Y"])),
        compiler: options.value("compiler")?.to_owned(),
        target: options.value("target")?.to_owned(),
        emulator: first_line(&said(Command::new(host_tools::qemu::QEMU).arg("--version"))),
        valgrind: said(Command::new("valgrind").arg("--version")),
        left_out: String::new(),
        settings: [
            Setting {
                name: FAST,
                measured: fast.0,
            },
            Setting {
                name: SMALL,
                measured: small.0,
            },
            Setting {
                name: HOST,
                measured: host_count,
            },
            Setting {
                name: "host ns",
                measured: host_time,
            },
        ],
        checked,
        checked_interpreter: [
            flash("checked-fast", "esm_alone")?,
            flash("checked-small", "esm_alone")?,
        ],
        engines,
        interpreting,
        swaps,
        sizes,
        events: EVENTS,
    };
    print!("{}", report.text());
    if options.write {
        let file = root().join(KEPT);
        fs::write(&file, report.markdown())
            .map_err(|error| format!("{}: {error}", file.display()))?;
        println!("\nKept in {KEPT}.");
    }
    let promises = report.promises();
    let broken = limits::broken(&promises);
    println!(
        "\n{} of {} promises hold.",
        promises.len() - broken,
        promises.len()
    );
    Ok(broken)
}

/// Bytes of a transition, guards and actions included: of the player first, then of the missions
/// that are shipped.
fn transitions() -> Result<Vec<(String, f64)>, String> {
    let shipped = charts::SHIPPED.map(|name| (format!("`{name}.esm`"), charts::shipped(name)));
    let player = ("the CD player".to_owned(), root().join(charts::PLAYER));
    std::iter::once(player)
        .chain(shipped)
        .map(|(name, path)| {
            let verified = subject::verified(&subject::build_file(&path)?.blob)?;
            Ok((name, inspect::Report::of(&verified).bytes_per_transition))
        })
        .collect()
}

/// Bytes of RAM that a region takes, flags aside: what the machines of many and of few have between
/// them.
fn region_bytes() -> Result<f64, String> {
    let [fewer, .., more] = charts::REGIONS;
    let of = |regions: usize| {
        let blob = subject::build(&charts::storm(regions))?.blob;
        Ok::<_, String>(subject::verified(&blob)?.ram_bytes())
    };
    Ok((of(more)? - of(fewer)?) as f64 / (more - fewer) as f64)
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
    check_player(measured, plan)?;
    for row in charts::guard_rows() {
        took(measured, row, 0)?;
    }
    took(measured, "stirred-none", 0)?;
    took(measured, "unheard-none", 1)?;
    for (regions, depth, transitions) in charts::shapes() {
        let row = format!("{regions}-{depth}-{transitions}");
        took(measured, &format!("still-{row}"), 0)?;
        took(measured, &format!("stirred-{row}"), 0)?;
        // The panel's own transition.
        took(measured, &format!("unheard-{row}"), 1)?;
    }
    for regions in charts::REGIONS {
        // The panel's own transition, and one in each region.
        took(measured, &format!("storm-{regions}"), 1 + regions as u32)?;
    }
    for level in 1..=charts::LEVELS {
        took(measured, &format!("deep-{level}"), 2)?;
    }
    Ok(())
}

/// Whether each player did what the chart says.
fn check_player(measured: &Measured, plan: &Plan) -> Result<(), String> {
    for (row, ..) in &ENGINES[1..] {
        check_actions(measured, row)?;
    }
    let player = subject::verified(plan.player())?;
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
    Ok(())
}

/// Whether an engine performed the chart's actions.
fn check_actions(measured: &Measured, row: &str) -> Result<(), String> {
    let row = format!("cd51-{row}");
    let counts = measured.told(&row).unwrap_or_default();
    if counts == ACTIONS {
        Ok(())
    } else {
        Err(format!("{row}: actions {counts:?}, expected {ACTIONS:?}"))
    }
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
