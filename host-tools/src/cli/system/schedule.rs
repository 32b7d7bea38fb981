//! `esm system schedule`: when the slots of all processors and the frames of all links start.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::loaded::Loaded;
use crate::cli::argument::Time;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;
use crate::cli::mission::Audience;
use crate::cli::schedule::chart::{self, Lane};
use crate::cli::schedule::task_names;
use crate::system::schedule::{GroupName, Placed, SystemSchedule};
use crate::system::schedule_picture;

/// Shows the slots of all processors and the frames of all links on one time axis, and their shares
///
/// Each mission is laid out by itself, as `esm schedule` does; here they are on plant time, each
/// from the start of its processor on. How far clocks drift is left out.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm system schedule robot.system
  esm system schedule robot.system -o robot_schedule.svg
  esm system schedule robot.system --json | jq '.links[].utilisation'

With --json: hyperperiod_us, processors: [processor, mission, origin_us, utilisation, \
slots: [id, names, start_us, period_us, duration_us]], links: [ends, medium, utilisation, \
directions: [from, to, origin_us, utilisation, frames: [id, names, start_us, period_us, duration_us]]].")]
pub struct ScheduleArgs {
    /// The system file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,

    /// Draws the schedules: a PNG if the name ends in .png, else an SVG
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// If the file cannot be read, something in the system has errors, or the picture cannot be
/// written.
pub fn execute(args: &ScheduleArgs, console: &mut Console) -> Result<(), CommandError> {
    let loaded = Loaded::load(&args.file)?;
    let has_errors = loaded.counts().0 > 0;
    let audience = match args.json && has_errors {
        true => Audience::Program,
        false => Audience::Person,
    };
    loaded.tell(audience, console)?;
    let Some(system) = loaded.system.as_ref().filter(|_| !has_errors) else {
        return Err(CommandError::Told);
    };
    if let Some(output) = &args.output {
        let missions = loaded.all_missions().map(|it| it.path.as_path());
        file::keep_sources(output, missions.chain([args.file.as_path()]))?;
    }
    let missions = loaded.missions.iter();
    let blobs: Vec<_> = (missions.map(|it| it.as_ref()?.blob.as_ref())).collect();
    let names: Vec<BTreeMap<u32, Vec<String>>> =
        loaded.models().into_iter().map(task_names).collect();
    let tasks = |processor: usize, slot: u32| -> Vec<String> {
        let of_slot = names.get(processor).and_then(|names| names.get(&slot));
        of_slot.cloned().unwrap_or_default()
    };
    let schedule = SystemSchedule::new(system, &blobs, &tasks);
    if args.json {
        console.json_line(&schedule)?;
    } else {
        tables(&schedule, console)?;
        let columns = console.columns();
        let timetable = schedule.timetable();
        console.text(&chart::of_lanes(
            &timetable,
            &lanes(&schedule),
            None,
            columns,
        ))?;
    }
    let Some(output) = &args.output else {
        return Ok(());
    };
    let name = args.file.file_name().unwrap_or(args.file.as_os_str());
    let title = format!("Schedule of {}", name.to_string_lossy());
    let scene = schedule_picture::draw(&schedule, &title);
    file::write_picture(output, &scene)
}

fn tables(schedule: &SystemSchedule, console: &mut Console) -> Result<(), CommandError> {
    let out = console.out();
    let time = |us: u64| Time { us }.to_string();
    for it in &schedule.processors {
        let percent = it.utilisation * 100.0;
        writeln!(
            out,
            "processor {} ({}), from {} on: slots take {percent:.1} %",
            it.processor,
            it.mission,
            time(it.origin_us)
        )?;
        table(["slot", "tasks"], &it.slots, out)?;
    }
    for link in &schedule.links {
        let [one, other] = &link.ends;
        let percent = link.utilisation * 100.0;
        let medium = link.medium;
        writeln!(
            out,
            "link {one} to {other} over {medium}: {percent:.1} % of its time is taken"
        )?;
        for sent in &link.directions {
            let percent = sent.utilisation * 100.0;
            writeln!(out, "  {} sends for {percent:.1} % of the time", sent.from)?;
            table(["id", "frame"], &sent.frames, out)?;
        }
    }
    Ok(())
}

/// Slots or frames with their times.
fn table(
    [number, names]: [&str; 2],
    placed: &[Placed],
    out: &mut dyn Write,
) -> Result<(), CommandError> {
    if placed.is_empty() {
        return Ok(());
    }
    writeln!(
        out,
        "{number:>6} {:>12} {:>12} {:>12}  {names}",
        "start", "period", "duration"
    )?;
    for it in placed {
        let [start, period, duration] = [it.start_us, it.period_us, it.duration_us]
            .map(|us| Time { us: us.into() }.to_string());
        let line = format!(
            "{:>6} {start:>12} {period:>12} {duration:>12}  {}",
            it.number,
            it.names.join(", ")
        );
        writeln!(out, "{}", line.trim_end())?;
    }
    Ok(())
}

/// The rows of the chart: one for each slot and frame, or for each processor and direction where
/// these are too many.
fn lanes(schedule: &SystemSchedule) -> Vec<Lane> {
    let all: usize = schedule.groups().map(|group| group.placed.len()).sum();
    let mut lanes = Vec::new();
    let mut next = 0;
    for group in schedule.groups() {
        let first = next;
        next += group.placed.len();
        let (name, what) = match group.heading {
            GroupName::Processor(name) => (name, "slots"),
            GroupName::Frames(from, _) => (from, "frames"),
        };
        if all > chart::MAX_ROWS {
            let label = format!("{name}: {} {what}", group.placed.len());
            lanes.push((label, (first..next).collect()));
            continue;
        }
        for (at, placed) in (first..).zip(group.placed) {
            let label = match group.heading {
                GroupName::Processor(_) => format!("{name} slot {}", placed.number),
                GroupName::Frames(..) => format!("{name} {}", placed.names.join(", ")),
            };
            lanes.push((label, vec![at]));
        }
    }
    lanes
}
