//! `esm schedule`: when each slot starts.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::pictures::{SlotPicture, SlotRow};
use crate::schedule::{self, Outcome, Report, SlotReport};

/// Lays out the time slots: when each one starts, or why there is no way
///
/// FILE needs no machine: slots alone are enough. The answer is a schedule, a proof that there is none, or, where the time given
/// ran out, that it is undecided; only a schedule makes the exit status 0.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm schedule missions/patrol.esm
  esm schedule slots.esm --limit 10 --json | jq .feasible
  esm schedule missions/patrol.esm --svg slots.svg

With --json: feasible (true, false, or null where undecided in time), hyperperiod_us, utilisation, slots: [slot, start_us, \
period_us, duration_us, growth_us], growth_factor, and reason and \
cure where the answer is no. It comes also where the answer is no.")]
pub struct ScheduleArgs {
    /// The file with the slots
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Draws the schedule over one hyperperiod
    #[arg(long, value_name = "OUT")]
    pub svg: Option<PathBuf>,

    /// How long the search may take, in seconds
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = seconds)]
    pub limit: Duration,
}

/// Runs the command.
///
/// # Errors
/// If the file has errors, no schedule exists or was found, or the picture cannot be written.
pub fn execute(args: &ScheduleArgs, console: &mut Console) -> Result<(), CommandError> {
    if let Some(path) = &args.svg {
        file::keep_sources(path, &[&args.file])?;
    }
    let mut checked = mission::read(&args.file)?;
    let searching = console.spinner("searching for a schedule");
    let outcome = match checked.solve_slots(args.limit) {
        // Some slots are wrong. What the others prove impossible stays so with them; anything else means nothing.
        None => Some(schedule::solve(checked.slots(), args.limit)).filter(is_infeasible),
        answer => answer,
    };
    searching.finish_and_clear();
    let Some(outcome) = outcome else {
        let audience = if args.json {
            Audience::Program
        } else {
            Audience::Person
        };
        mission::tell(&checked, audience, console)?;
        return Err(CommandError::Told);
    };
    // The answer is the report; why it is no is said to the person.
    mission::tell(&checked, Audience::Person, console)?;
    let report = schedule::report(checked.slots(), &outcome);
    if args.json {
        console.json_line(&report)?;
    } else {
        table(&report, console)?;
    }
    if checked.has_errors() {
        return Err(CommandError::Told);
    }
    if let Some(path) = &args.svg {
        let svg = picture(&args.file, &report).scene().to_svg();
        file::write_whole(path, svg.as_bytes(), "picture")?;
    }
    Ok(())
}

/// A time on the command line in seconds, fractions included.
fn seconds(text: &str) -> Result<Duration, String> {
    text.parse()
        .ok()
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "a number of seconds is expected, such as 10 or 0.5".to_owned())
}

fn is_infeasible(outcome: &Outcome) -> bool {
    matches!(outcome, Outcome::Infeasible(_))
}

fn table(report: &Report, console: &mut Console) -> Result<(), CommandError> {
    let out = console.out();
    if !report.slots.is_empty() {
        writeln!(
            out,
            "{:>6} {:>12} {:>12} {:>12} {:>12}",
            "slot", "start", "period", "duration", "may grow"
        )?;
    }
    for SlotReport {
        slot,
        start_us,
        period_us,
        duration_us,
        growth_us,
    } in &report.slots
    {
        let [start, period, duration, growth] = [*start_us, *period_us, *duration_us, *growth_us]
            .map(|us| Time { us: us.into() }.to_string());
        writeln!(
            out,
            "{slot:>6} {start:>12} {period:>12} {duration:>12} {growth:>12}"
        )?;
    }
    if let Some(factor) = report.growth_factor {
        // Rounded down: what is shown must fit.
        let percent = libm::floor((factor - 1.0) * 1_000.0) / 10.0;
        writeln!(
            out,
            "each may grow alone by as much; all together by {percent:.1} %"
        )?;
    }
    let hyperperiod = report
        .hyperperiod_us
        .map_or("too long to be counted".into(), |us| {
            Time { us }.to_string()
        });
    writeln!(
        out,
        "utilisation {:.1} %, hyperperiod {hyperperiod}",
        report.utilisation * 100.0
    )?;
    Ok(())
}

fn picture(file: &Path, report: &Report) -> SlotPicture {
    let row = |slot: &SlotReport| SlotRow {
        name: format!("slot {}", slot.slot),
        start_us: slot.start_us.into(),
        period_us: slot.period_us.into(),
        duration_us: slot.duration_us.into(),
    };
    SlotPicture {
        title: format!("Slots of {}", file.display()),
        slots: report.slots.iter().map(row).collect(),
        hyperperiod_us: report.hyperperiod_us.unwrap_or(u64::MAX),
    }
}
