//! How many sets of slots the search decides, and how long it takes: `cargo xtask bench schedule`.
//!
//! Each row of the table is a kind of set, a number of slots and a load. Times are processor time
//! of the one thread that searches, from slots to a checked answer. All but the times is the same
//! in each run, as long as no search reaches the limit.

use std::fmt;
use std::process::ExitCode;
use std::time::Duration;

use host_tools::schedule::instances::{Family, Kind, make};
use host_tools::schedule::{Outcome, solve};
use host_tools::time::work_limit;
use nix::time::{ClockId, clock_gettime};

const HELP: &str = "\
How many sets of slots the search decides, and how long it takes.

Usage: cargo xtask bench schedule [OPTIONS]

Options:
  --count <N>          Sets a row [default: 5]
  --limit <SECONDS>    How long each search may take [default: 1]
  --only <TEXT>        Rows that have this in their names, such as `planted` or `robot 500`
  --seed <N>           First seed [default: 0]
  --markdown           Table in Markdown
  --each               One line a set, too
  -h, --help           This text
";

/// A row: how its sets are made.
struct Row {
    kind: Kind,
    count: usize,
    percent: u32,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} {} %", self.kind, self.count, self.percent)
    }
}

/// All rows: small and full, large and less so.
fn rows() -> Vec<Row> {
    let families = [Family::Harmonic, Family::Automotive, Family::Robot];
    let sets = |kind: fn(Family) -> Kind, counts: &'static [usize], percents: &'static [u32]| {
        families.into_iter().flat_map(move |family| {
            counts.iter().flat_map(move |&count| {
                percents.iter().map(move |&percent| Row {
                    kind: kind(family),
                    count,
                    percent,
                })
            })
        })
    };
    let single = |kind, count, percent| Row {
        kind,
        count,
        percent,
    };
    let mut rows: Vec<Row> = Vec::new();
    rows.extend(sets(
        Kind::Random,
        &[10, 20, 50, 100, 200],
        &[70, 80, 90, 95],
    ));
    rows.extend(sets(
        Kind::Planted,
        &[10, 20, 50, 100, 200],
        &[90, 95, 98, 100],
    ));
    rows.extend([20, 60].map(|count| single(Kind::Link, count, 40)));
    rows.extend([40, 60, 80].map(|percent| single(Kind::Link, 500, percent)));
    rows.extend([20, 60, 200, 500].into_iter().flat_map(|count| {
        [90, 100].map(|percent| single(Kind::Planted(Family::Message), count, percent))
    }));
    rows.extend([45, 72].map(|count| single(Kind::Table, count, 30)));
    rows.extend(sets(Kind::Random, &[500, 2_000], &[83]));
    rows.extend(sets(Kind::Planted, &[500, 2_000], &[83]));
    rows
}

/// What is asked for on the command line.
struct Options {
    count: u64,
    limit: Duration,
    only: String,
    seed: u64,
    markdown: bool,
    each: bool,
}

fn main() -> ExitCode {
    let options = match parse(std::env::args().skip(1)) {
        Ok(Some(options)) => options,
        Ok(None) => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        Err(problem) => {
            eprintln!("{problem}\n\n{HELP}");
            return ExitCode::from(2);
        }
    };
    println!("{}", header(options.markdown));
    let mut all = Tally::default();
    for row in rows() {
        if !row.to_string().contains(&options.only) {
            continue;
        }
        let mut tally = Tally::default();
        for seed in options.seed..options.seed.saturating_add(options.count) {
            tally.add(measure(&row, seed, &options));
        }
        println!(
            "{}",
            tally.line(
                &row.kind.to_string(),
                row.count,
                row.percent,
                options.markdown
            )
        );
        all.join(tally);
    }
    println!("{}", all.line("all", 0, 0, options.markdown));
    if all.wrong > 0 {
        eprintln!(
            "{} answers are wrong: planted sets have a schedule",
            all.wrong
        );
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}

/// `None` where help is asked for. `--bench`, which Cargo adds, says nothing.
fn parse(mut arguments: impl Iterator<Item = String>) -> Result<Option<Options>, String> {
    let mut options = Options {
        count: 5,
        limit: Duration::from_secs(1),
        only: String::new(),
        seed: 0,
        markdown: false,
        each: false,
    };
    while let Some(argument) = arguments.next() {
        let (name, mut given) = match argument.split_once('=') {
            Some((name, value)) => (name.to_owned(), Some(value.to_owned())),
            None => (argument, None),
        };
        let mut value = || {
            given
                .take()
                .or_else(|| arguments.next())
                .ok_or_else(|| format!("{name} needs a value"))
        };
        let number = |text: String| {
            text.parse()
                .map_err(|_| format!("{name} {text}: a number is expected"))
        };
        match name.as_str() {
            "--count" => options.count = number(value()?)?,
            "--seed" => options.seed = number(value()?)?,
            "--limit" => {
                let text = value()?;
                options.limit = text
                    .parse()
                    .ok()
                    .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
                    .ok_or_else(|| format!("--limit {text}: seconds are expected"))?;
            }
            "--only" => options.only = value()?,
            "--markdown" => options.markdown = true,
            "--each" => options.each = true,
            "--bench" => {}
            "-h" | "--help" => return Ok(None),
            _ => return Err(format!("unknown option {name}")),
        }
    }
    Ok(Some(options))
}

// ─── Measuring ───────────────────────────────────────────────────────────────────────────────────

/// An answer and the processor time that it took.
struct Measured {
    kind: Kind,
    outcome: Outcome,
    seconds: f64,
}

fn measure(row: &Row, seed: u64, options: &Options) -> Measured {
    let slots = make(row.kind, row.count, row.percent, seed);
    let begin = thread_seconds();
    let outcome = solve(&slots, work_limit(options.limit));
    let seconds = thread_seconds() - begin;
    if options.each {
        let answer = match &outcome {
            Outcome::Feasible(_) => "feasible".to_owned(),
            Outcome::Infeasible(reason) => format!("infeasible: {reason}"),
            Outcome::Undecided => "undecided".to_owned(),
        };
        println!("  {row} seed {seed}: {:.3} ms, {answer}", seconds * 1e3);
    }
    Measured {
        kind: row.kind,
        outcome,
        seconds,
    }
}

/// Processor time of this thread so far.
fn thread_seconds() -> f64 {
    clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID)
        .map_or(0.0, |time| Duration::from(time).as_secs_f64())
}

/// What came out of some sets.
#[derive(Default)]
struct Tally {
    feasible: u64,
    infeasible: u64,
    undecided: u64,
    /// Planted sets that were called infeasible.
    wrong: u64,
    seconds: Vec<f64>,
}

impl Tally {
    fn add(&mut self, measured: Measured) {
        match measured.outcome {
            Outcome::Feasible(_) => self.feasible += 1,
            Outcome::Infeasible(_) => {
                self.infeasible += 1;
                self.wrong += u64::from(measured.kind.is_feasible());
            }
            Outcome::Undecided => self.undecided += 1,
        }
        self.seconds.push(measured.seconds);
    }

    fn join(&mut self, other: Tally) {
        self.feasible += other.feasible;
        self.infeasible += other.infeasible;
        self.undecided += other.undecided;
        self.wrong += other.wrong;
        self.seconds.extend(other.seconds);
    }

    /// A line of the table. Of all rows together, `count` and `percent` are 0 and left out.
    fn line(&self, kind: &str, count: usize, percent: u32, markdown: bool) -> String {
        let mut seconds = self.seconds.clone();
        seconds.sort_by(f64::total_cmp);
        let median = seconds.get(seconds.len() / 2).copied().unwrap_or(0.0);
        let worst = seconds.last().copied().unwrap_or(0.0);
        let unless_zero = |number: u64| {
            if number == 0 {
                String::new()
            } else {
                number.to_string()
            }
        };
        let cells = [
            kind.to_owned(),
            unless_zero(count as u64),
            unless_zero(percent.into()),
            self.seconds.len().to_string(),
            self.feasible.to_string(),
            self.infeasible.to_string(),
            self.undecided.to_string(),
            format!("{:.3}", median * 1e3),
            format!("{:.3}", worst * 1e3),
        ];
        self::line(&cells, markdown)
    }
}

/// Names of the columns and their widths.
const COLUMNS: [(&str, usize); 9] = [
    ("kind", 18),
    ("slots", 5),
    ("load %", 6),
    ("sets", 4),
    ("feasible", 8),
    ("infeasible", 10),
    ("undecided", 9),
    ("median ms", 10),
    ("worst ms", 10),
];

fn header(markdown: bool) -> String {
    let names = COLUMNS.map(|(name, _)| name.to_owned());
    let names = line(&names, markdown);
    if markdown {
        format!("{names}\n|---|{}", "---:|".repeat(COLUMNS.len() - 1))
    } else {
        names
    }
}

fn line(cells: &[String; COLUMNS.len()], markdown: bool) -> String {
    if markdown {
        return format!("| {} |", cells.join(" | "));
    }
    let mut line = String::new();
    for (position, (cell, (_, width))) in cells.iter().zip(COLUMNS).enumerate() {
        line += &match position {
            0 => format!("{cell:<width$}"),
            _ => format!("  {cell:>width$}"),
        };
    }
    line
}
