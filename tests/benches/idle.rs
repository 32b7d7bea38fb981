//! `cargo xtask bench idle`: how much of the time that slots leave reaches a task in slot 0 that
//! never sleeps.
//!
//! Its argument is the firmware, `boards/lm3s6965/src/bin/bench_idle.rs`, which measures and tells
//! in its log; it drives through the office in the emulator, with `tests/data/idle.esm`.

use std::path::Path;
use std::process::ExitCode;

use esm_tests::command::{esm, root};
use esm_tests::subject;

const MISSION: &str = "tests/data/idle.esm";
/// The firmware has told all it has measured before.
const UNTIL: &str = "13 s";

fn main() -> ExitCode {
    // Cargo adds an option of its own.
    let firmware = std::env::args()
        .skip(1)
        .find(|argument| argument != "--bench");
    let Some(firmware) = firmware else {
        eprintln!("the benchmark of idle time needs a firmware: cargo xtask bench idle");
        return ExitCode::from(2);
    };
    match measured(&firmware).and_then(|measured| table(&measured)) {
        Ok(table) => {
            print!("{table}");
            ExitCode::SUCCESS
        }
        Err(problem) => {
            eprintln!("the benchmark of idle time: {problem}");
            ExitCode::from(3)
        }
    }
}

/// Whose time it was, in ticks.
struct Times {
    own: f64,
    slots: f64,
    rest: f64,
}

impl Times {
    fn total(&self) -> f64 {
        self.own + self.slots + self.rest
    }
}

/// While the link slept, and while it worked.
struct Measured {
    quiet: Times,
    loud: Times,
}

fn measured(firmware: &str) -> Result<Measured, String> {
    let run = [
        "run",
        MISSION,
        "--world",
        "office",
        "--until",
        UNTIL,
        "--firmware",
        firmware,
    ];
    let shown = esm(&run).good().out;
    let times = |link: &str| {
        let line = shown
            .lines()
            .find_map(|line| line.split_once(&format!("idle: link {link}, ")));
        let (_, told) = line.ok_or_else(|| format!("the firmware told nothing:\n{shown}"))?;
        let numbers: Vec<f64> = told
            .split(", ")
            .filter_map(|part| part.rsplit(' ').next()?.parse().ok())
            .collect();
        match numbers[..] {
            [own, slots, rest] => Ok(Times { own, slots, rest }),
            _ => Err(format!("the firmware told {told}")),
        }
    };
    Ok(Measured {
        quiet: times("false")?,
        loud: times("true")?,
    })
}

fn table(measured: &Measured) -> Result<String, String> {
    let blob = subject::build_file(&root().join(Path::new(MISSION)))?.blob;
    let reserved: f64 = subject::verified(&blob)?
        .tables()
        .slots()
        .map(|slot| f64::from(slot.duration_us) / f64::from(slot.period_us))
        .sum();
    let Measured { quiet, loud } = measured;
    // While the link works, its turns follow those of the slots: what slots take themselves is
    // known from when it slept.
    let slots = quiet.slots / quiet.total();
    let row = |link: &str, times: &Times| {
        let own = times.own / times.total();
        format!(
            "| {link} | {:.1} % | {:.2} % |\n",
            100.0 * own,
            100.0 * own / (1.0 - slots)
        )
    };
    Ok(format!(
        "The schedule keeps {:.1} % of the time for slots; they and their dispatch take {:.1} %.\n\n\
         | link | time that slot 0 gets | share of what slots leave |\n|---|---|---|\n{}{}",
        100.0 * reserved,
        100.0 * slots,
        row("asleep", quiet),
        row("works", loud)
    ))
}
