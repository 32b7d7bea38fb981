//! `esm schedule`: when each slot starts, what is free, and which tasks share a slot.

pub(super) mod chart;
mod tasks;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use clap::Args;
use serde::Serialize;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use crate::lang::Checked;
use crate::lang::analysis::sharing::{self, SlotTasks};
use crate::model::{Model, SlotRef, StateKind};
use crate::pictures::SlotPicture;
use crate::schedule::{self, Limit, LinkReport, Outcome, Report, SlotReport, SnapReport};
use crate::time::{wall_limit, work_limit};
use crate::timetable::Timetable;
use crate::trace_events;

/// Lays out the time slots and the frames of links: when each one starts, or why there is no way
///
/// FILE needs no machine: slots alone are enough. The answer is a schedule, a proof that there is
/// none, or, where the time given ran out, that it is undecided; only a schedule makes the exit
/// status 0. Below the table come a chart of a hyperperiod, or of its busiest window, and what
/// tasks that can be active together take of each slot.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm schedule missions/patrol.esm
  esm schedule slots.esm --limit 10 --json | jq .feasible
  esm schedule missions/patrol.esm --svg slots.svg
  esm schedule missions/patrol.esm --perfetto slots.json     open it in ui.perfetto.dev
  esm schedule slots.esm --snap
  esm schedule slots.esm --snap 3 --json | jq .snap

With --json: feasible (true, false, or null where undecided in time), hyperperiod_us, utilisation, slots: [slot, start_us, \
period_us, duration_us, growth_us], growth_factor, tasks: [slot, duration_us, worst_us, together, tasks, left_out, without_wcet], \
links: [link, utilisation, feasible, frames: [frame, id, start_us, period_us, duration_us]], and reason and cure where the answer is no; with --snap also snap: [harmonic, hyperperiod_us, utilisation, total_percent, \
changes: [slot, period_us, new_period_us, percent]]. It comes also where the answer is no.")]
pub struct ScheduleArgs {
    /// The file with the slots
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Draws the schedule: a row for each slot, what is free, and how the slots are packed; a PNG
    /// if the name ends in .png, else an SVG
    #[arg(long, value_name = "OUT")]
    pub svg: Option<PathBuf>,

    /// Writes the schedule as a trace in Chrome's format, for ui.perfetto.dev
    #[arg(long, value_name = "OUT")]
    pub perfetto: Option<PathBuf>,

    /// Proposes changes of rates that make the slots easy to lay out; no period changes by more
    /// than so many percent
    #[arg(long, value_name = "PERCENT", num_args = 0..=1, default_missing_value = "10", value_parser = percent)]
    pub snap: Option<u32>,

    /// How long the search may last, in seconds on the wall clock [default: 5 s of processor time,
    /// so that a busy machine finds what an idle one does]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub limit: Option<Duration>,
}

/// Runs the command.
///
/// # Errors
/// If the file has errors, no schedule exists or was found, or the picture cannot be written.
pub fn execute(args: &ScheduleArgs, console: &mut Console) -> Result<(), CommandError> {
    let outputs = [args.svg.as_deref(), args.perfetto.as_deref()];
    let outputs: Vec<&Path> = outputs.into_iter().flatten().collect();
    for output in &outputs {
        file::keep_sources(output, [args.file.as_path()])?;
    }
    file::keep_apart(&outputs)?;
    let mut checked = mission::read(&args.file)?;
    // Asked for before the search, which takes the model away where it finds no schedule.
    let (tasks, spare) = checked
        .model
        .as_ref()
        .map_or_else(Default::default, |model| {
            let spare = if args.json {
                Vec::new()
            } else {
                sharing::spare_slots(model)
            };
            (sharing::of_model(model), spare)
        });
    let task_names = task_names(checked.model.as_ref());
    let searching = console.spinner("searching for a schedule");
    let limit = args
        .limit
        .map_or_else(|| work_limit(mission::LAY_OUT_LIMIT), wall_limit);
    let outcome = match checked.solve_slots(limit) {
        // Some slots are wrong. What the others prove impossible stays so with them; anything else
        // means nothing.
        None => Some(schedule::solve(checked.slots(), limit)).filter(is_infeasible),
        answer => answer,
    };
    let links = links(&mut checked, limit);
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
    let mut report = schedule::report(checked.slots(), &outcome);
    report.snap = args.snap.map(|percent| {
        let snaps = schedule::snap(checked.slots(), percent);
        snaps.iter().map(schedule::snap_report).collect()
    });
    let timetable = Timetable::of_report(&report);
    if args.json {
        console.json_line(&Answer {
            report: &report,
            tasks: &tasks,
            links: &links,
        })?;
    } else {
        table(&report, console)?;
        links
            .iter()
            .try_for_each(|link| link_table(link, console))?;
        let columns = console.columns();
        console.text(&chart::chart(&timetable, columns))?;
        console.text(&tasks::table(&tasks, columns.max(tasks::LEAST_COLUMNS)))?;
        console.text(&tasks::hints(&spare))?;
        if let (Some(percent), Some(snaps)) = (args.snap, &report.snap) {
            proposals(percent, snaps, console)?;
        } else if checked.has_errors() {
            let file = args.file.display();
            writeln!(
                console.out(),
                "hint: `esm schedule {file} --snap` looks for small changes of rates that have a schedule"
            )?;
        }
    }
    if checked.has_errors() {
        return Err(CommandError::Told);
    }
    // The same from wherever it is called.
    let name = args
        .file
        .file_name()
        .unwrap_or(args.file.as_os_str())
        .to_string_lossy();
    if let Some(path) = &args.perfetto {
        let trace = trace_events::to_json(&name, &timetable, &task_names)
            .context("the trace cannot be written as JSON")
            .map_err(CommandError::Input)?;
        file::write_whole(path, trace.as_bytes(), "trace")?;
    }
    if let Some(path) = &args.svg {
        let picture = SlotPicture {
            title: format!("Slots of {name}"),
            timetable,
            tasks: task_names,
        };
        file::write_picture(path, &picture.scene())?;
    }
    Ok(())
}

/// What `--json` tells.
#[derive(Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    report: &'a Report,
    tasks: &'a [SlotTasks],
    links: &'a [LinkReport],
}

/// What each link sends, and when.
fn links(checked: &mut Checked, limit: Limit) -> Vec<LinkReport> {
    let outcomes = checked.solve_links(limit);
    let reported = checked.links().iter().enumerate().map(|(index, link)| {
        let known = outcomes.as_ref().and_then(|outcomes| outcomes.get(index));
        // Something is wrong with links or frames. What the others prove impossible stays so.
        let outcome = known.cloned().unwrap_or_else(|| {
            Some(schedule::solve(&link.frames, limit))
                .filter(is_infeasible)
                .unwrap_or(Outcome::Undecided)
        });
        schedule::link_report(&link.link, &link.names, &link.frames, &outcome)
    });
    reported.collect()
}

fn link_table(link: &LinkReport, console: &mut Console) -> Result<(), CommandError> {
    let out = console.out();
    let name = &link.link;
    let percent = link.utilisation * 100.0;
    writeln!(out, "\nlink {name}: {percent:.1} % of its time is taken")?;
    let Some(width) = link.frames.iter().map(|frame| frame.frame.len()).max() else {
        return Ok(());
    };
    let width = width.max("frame".len());
    writeln!(
        out,
        "{:>width$} {:>5} {:>12} {:>12} {:>12}",
        "frame", "id", "start", "period", "duration"
    )?;
    for frame in &link.frames {
        let [start, period, duration] = [frame.start_us, frame.period_us, frame.duration_us]
            .map(|us| Time { us: us.into() }.to_string());
        writeln!(
            out,
            "{:>width$} {:>5} {start:>12} {period:>12} {duration:>12}",
            frame.frame, frame.id
        )?;
    }
    Ok(())
}

/// Names of the tasks that states put into each slot, by its number, each once and in the order of
/// their declarations.
pub(super) fn task_names(model: Option<&Model>) -> BTreeMap<u32, Vec<String>> {
    let mut names = BTreeMap::new();
    let Some(model) = model else { return names };
    let mut used: BTreeSet<(usize, usize)> = BTreeSet::new();
    let states = model
        .containers
        .iter()
        .flat_map(|it| &it.regions)
        .flat_map(|it| &it.states);
    for state in states {
        if let StateKind::Task {
            task,
            slot: SlotRef::Slot(slot),
            ..
        } = state.kind
        {
            used.insert((slot, task));
        }
    }
    for (slot, task) in used {
        if let (Some(slot), Some(task)) = (model.slots.get(slot), model.tasks.get(task)) {
            names
                .entry(slot.number)
                .or_insert_with(Vec::new)
                .push(task.name.clone());
        }
    }
    names
}

/// The percentage behind `--snap`, which may be left out: then what stands there can be the file.
fn percent(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(percent) if (1..=schedule::MAX_SNAP_PERCENT).contains(&percent) => Ok(percent),
        _ => Err(format!(
            "a whole number of percent from 1 to {} is expected; without one, name FILE before --snap",
            schedule::MAX_SNAP_PERCENT
        )),
    }
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
        let alone = if report.slots.iter().all(|slot| slot.growth_us == 0) {
            "no slot may last longer, not even one alone"
        } else {
            "one slot alone may last longer by what stands under `may grow`"
        };
        let together = if percent > 0.0 {
            format!("all at once by {percent:.1} % each")
        } else {
            "all at once may not, not even by 0.1 % each".to_owned()
        };
        // Two lines: what a person reads is a hundred columns wide.
        writeln!(out, "with these starts {alone};\n{together}")?;
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

fn proposals(
    percent: u32,
    snaps: &[SnapReport],
    console: &mut Console,
) -> Result<(), CommandError> {
    let out = console.out();
    if snaps.is_empty() {
        writeln!(
            out,
            "\nno change of rates by at most {percent} % was found that makes the slots easy"
        )?;
    }
    for snap in snaps {
        let kind = if snap.harmonic {
            "each period divides the next"
        } else {
            "there is a schedule"
        };
        let hyperperiod = snap
            .hyperperiod_us
            .map_or("too long to be counted".into(), |us| {
                Time { us }.to_string()
            });
        if snap.changes.is_empty() {
            writeln!(
                out,
                "\nrates as they are: {kind}, hyperperiod {hyperperiod}"
            )?;
            continue;
        }
        writeln!(
            out,
            "\nrates changed by {:.1} % in all: {kind}, hyperperiod {hyperperiod}, utilisation {:.1} %",
            snap.total_percent,
            snap.utilisation * 100.0
        )?;
        for change in &snap.changes {
            let [from, to] = [change.period_us, change.new_period_us]
                .map(|us| Time { us: us.into() }.to_string());
            writeln!(
                out,
                "{:>6} {from:>12} -> {to:>12} {:>+7.1} %",
                change.slot, change.percent
            )?;
        }
    }
    Ok(())
}
