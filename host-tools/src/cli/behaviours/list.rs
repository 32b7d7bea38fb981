//! The list of behaviours of a robot: shown, and changed.

use std::fmt::Write as _;

use clap::Args;
use esm_link::behaviours::{BehaviourRequest, ListEntry, Origin, ScriptState, ScriptStatus};
use esm_link::features::Feature;
use serde::Serialize;

use crate::behaviour_words::state;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::robot::{Robot, RobotArgs};
use crate::cli::{mission, tasks};
use crate::link_client::RobotInfo;
use crate::link_client::behaviours::End;
use crate::model::Task;
use crate::script::{is_behaviour, read_line, signature_hash};

/// Shows what stands on a robot's list of behaviours, the head first, and how its script is
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm behaviours show --port /dev/ttyACM0
  esm behaviours show --port /dev/ttyACM0 --json")]
pub struct ShowArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Inserts a behaviour behind all others, or before them
///
/// It is a line as in a script: the name, parameters with commas between, and situations that are
/// watched beside it. It prints the key by which the others name it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm behaviours insert 'move speed_m_per_s = 0.1, outside_m = 1'
  esm behaviours insert --head 'turn_to angle_rad = 1.57'
  esm behaviours insert 'go_to x_m = 3 unless stuck after_s = 2 -> cancel'")]
pub struct InsertArgs {
    /// The behaviour, as a line of a script
    #[arg(value_name = "BEHAVIOUR")]
    pub behaviour: String,

    /// Before all others, which go on afterwards
    #[arg(long)]
    pub head: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// A behaviour on the list.
#[derive(Debug, Args)]
pub struct KeyArgs {
    /// Its key, as `esm behaviours show` prints it
    #[arg(value_name = "KEY")]
    pub behaviour: u16,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// What `show --json` prints.
#[derive(Debug, Serialize)]
struct Report {
    script: Option<ScriptReport>,
    behaviours: Vec<EntryReport>,
}

/// How a script is, in the form of its JSON.
#[derive(Clone, Debug, Serialize)]
pub struct ScriptReport {
    /// Names it: eight digits of a checksum.
    pub script: String,
    /// What it does: `runs`, `suspended`, `done`, `ended`.
    pub state: &'static str,
    /// How many steps it has.
    pub steps: u8,
    /// How many of them have ended.
    pub ended: u8,
}

/// A behaviour on the list, in the form of its JSON.
#[derive(Debug, Serialize)]
struct EntryReport {
    key: u16,
    name: String,
    state: &'static str,
    origin: &'static str,
    held: bool,
}

/// What `insert --json` prints.
#[derive(Debug, Serialize)]
struct Inserted<'n> {
    key: u16,
    name: &'n str,
}

/// How a script is; none where none was run.
pub fn script_report(status: ScriptStatus) -> Option<ScriptReport> {
    let state = match status.state {
        ScriptState::None => return None,
        ScriptState::Runs => "runs",
        ScriptState::Suspended => "suspended",
        ScriptState::Done => "done",
        ScriptState::Ended => "ended",
    };
    Some(ScriptReport {
        script: format!("{:08x}", status.script),
        state,
        steps: status.steps,
        ended: status.ended,
    })
}

/// Begins a session with a robot that has behaviours.
///
/// # Errors
/// There is no such robot, or it has none.
pub fn connect(
    args: &RobotArgs,
    console: &mut Console,
) -> Result<(Robot, RobotInfo), CommandError> {
    let (mut robot, info) = args.connect(console)?;
    robot.require(Feature::Behaviours)?;
    Ok((robot, info))
}

/// As [`connect`], and reads what the robot's tasks are.
///
/// # Errors
/// There is no such robot, it has no behaviours, or it does not say which.
pub fn connect_and_read(
    args: &RobotArgs,
    console: &mut Console,
) -> Result<(Robot, Vec<Task>), CommandError> {
    let (mut robot, info) = connect(args, console)?;
    let (text, _) = tasks::ask(&mut robot, &info)?;
    Ok((robot, tasks::declared_in(&text, console)?))
}

/// Runs `show`.
///
/// # Errors
/// What kept it from ending well.
pub(super) fn show(args: &ShowArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, tasks) = connect_and_read(&args.robot, console)?;
    let listed = robot.behaviour_list()?;
    let report = Report {
        script: script_report(listed.script),
        behaviours: (listed.entries.iter())
            .map(|entry| entry_report(entry, &tasks))
            .collect(),
    };
    if args.json {
        return console.json_line(&report);
    }
    let mut text = String::new();
    if report.behaviours.is_empty() {
        text.push_str("nobody is on the list: the robot stands still\n");
    }
    for entry in &report.behaviours {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:>5}  {:<16} {:<8} {}{}",
            entry.key,
            entry.name,
            entry.state,
            entry.origin,
            if entry.held {
                ", suspended by hand"
            } else {
                ""
            }
        );
    }
    if let Some(script) = &report.script {
        let _ = writeln!(text, "{}", script_line(script));
    }
    console.text(&text)
}

/// How a script is, for a person.
pub fn script_line(script: &ScriptReport) -> String {
    let ScriptReport {
        script,
        state,
        steps,
        ended,
    } = script;
    // What a robot says may be anything.
    let step = ended.saturating_add(1);
    match *state {
        "runs" => format!("script {script}: step {step} of {steps}"),
        "suspended" => format!("script {script}: suspended in step {step} of {steps}"),
        "done" => format!("script {script}: done, all {steps} steps"),
        _ => format!("script {script}: ended in step {step} of {steps}"),
    }
}

fn entry_report(entry: &ListEntry, tasks: &[Task]) -> EntryReport {
    let of_firmware = || {
        let mut behaviours = tasks.iter().filter(|task| is_behaviour(task));
        let task = behaviours.find(|task| signature_hash(task) as u16 == entry.task);
        task.map_or_else(|| "?".to_owned(), |task| task.name.clone())
    };
    let (name, origin) = match entry.origin {
        Origin::Idle => ("IDLE".to_owned(), "safety"),
        Origin::Remote => ("REMOTE_CONTROL".to_owned(), "by hand"),
        Origin::Mission => (of_firmware(), "mission"),
        Origin::Link => (of_firmware(), "link"),
        Origin::Script => (of_firmware(), "script"),
    };
    EntryReport {
        key: entry.key,
        name,
        state: state(Some(entry.state)).unwrap_or("?"),
        origin,
        held: entry.is_held,
    }
}

/// Runs `insert`.
///
/// # Errors
/// What kept it from ending well.
pub(super) fn insert(args: &InsertArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, tasks) = connect_and_read(&args.robot, console)?;
    let reading = read_line("the command line", &args.behaviour, &tasks);
    let Some(step) = reading
        .script
        .and_then(|script| script.all.into_iter().next())
    else {
        mission::tell_found(&reading.files, &reading.diagnostics, console);
        return Err(CommandError::Told);
    };
    let end = if args.head { End::Head } else { End::Tail };
    let key = robot.insert_behaviour(end, step.call())?;
    if args.json {
        return console.json_line(&Inserted {
            key,
            name: &step.name,
        });
    }
    console.text(&format!("{key}: {}\n", step.name))
}

fn change(
    args: &KeyArgs,
    request: BehaviourRequest<'_>,
    done: &str,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (mut robot, _) = connect(&args.robot, console)?;
    robot.change_behaviours(request)?;
    console.text(&format!("{}: {done}\n", args.behaviour))
}

/// Runs `cancel`.
///
/// # Errors
/// What kept it from ending well.
pub(super) fn cancel(args: &KeyArgs, console: &mut Console) -> Result<(), CommandError> {
    let request = BehaviourRequest::Cancel {
        key: args.behaviour,
    };
    change(args, request, "off the list", console)
}

/// Runs `suspend`.
///
/// # Errors
/// What kept it from ending well.
pub(super) fn suspend(args: &KeyArgs, console: &mut Console) -> Result<(), CommandError> {
    let request = BehaviourRequest::Suspend {
        key: args.behaviour,
    };
    change(args, request, "suspended", console)
}

/// Runs `resume`.
///
/// # Errors
/// What kept it from ending well.
pub(super) fn resume(args: &KeyArgs, console: &mut Console) -> Result<(), CommandError> {
    let request = BehaviourRequest::Resume {
        key: args.behaviour,
    };
    change(args, request, "resumed", console)
}
