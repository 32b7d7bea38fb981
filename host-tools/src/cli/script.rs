//! `esm script`: behaviours a line, sent as one and done one after the other.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::{Args, Subcommand};
use esm_link::behaviours::{BehaviourRequest, ScriptState, ScriptStatus};
use esm_link::features::Feature;
use serde::Serialize;

use super::behaviours::list::{
    ScriptReport, connect, connect_and_read, script_line, script_report,
};
use super::console::Console;
use super::exit::CommandError;
use super::mission;
use super::robot::{Robot, RobotArgs};
use super::tasks::{self, AskedArgs};
use crate::host_board::RobotMaker;
use crate::lang::{self, LoadError};
use crate::model::Task;
use crate::script::{Script, read};

/// Checks a script of behaviours, and lets a robot do it
///
/// A line is a behaviour with its parameters, and situations that are watched beside it. The book
/// says more, under `Behaviours and situations`. The mission that runs must have a task state
/// `Behaviours` whose region is active, such as `missions/by_hand.esm` has.
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    subcommand_required = true,
    after_help = "\
Examples:
  esm script check missions/square.script --board host
  esm script run missions/square.script --port /dev/ttyACM0
  esm script run missions/square.script --keep --port /dev/ttyACM0
  esm script show
  esm script suspend
  esm script resume
  esm script end
  esm script remove"
)]
pub struct ScriptArgs {
    /// What to do.
    #[command(subcommand)]
    pub action: Action,
}

/// What to do.
#[derive(Debug, Subcommand)]
#[allow(
    missing_docs,
    reason = "each variant carries the documentation of its arguments"
)]
pub enum Action {
    Check(CheckArgs),
    Run(RunArgs),
    /// Says how the script is
    #[command(after_help = "Example:\n  esm script show --port /dev/ttyACM0 --json")]
    Show(OnRobotArgs),
    /// Suspends the script: the robot stands still in its step's turn, and no step follows
    #[command(after_help = "Example:\n  esm script suspend --port /dev/ttyACM0")]
    Suspend(OnRobotArgs),
    /// Lets a script that was suspended go on where it was
    #[command(after_help = "Example:\n  esm script resume --port /dev/ttyACM0")]
    Resume(OnRobotArgs),
    /// Ends the script: its step leaves the list
    #[command(after_help = "Example:\n  esm script end --port /dev/ttyACM0")]
    End(OnRobotArgs),
    /// Removes the script that the robot keeps in its flash; what runs goes on
    #[command(after_help = "Example:\n  esm script remove --port /dev/ttyACM0")]
    Remove(OnRobotArgs),
}

/// Checks a script against what a firmware declares
///
/// Asks the robot at PORT, or else a board that is started for the question.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm script check missions/square.script --board host
  esm script check missions/square.script --port /dev/ttyACM0 --json")]
pub struct CheckArgs {
    /// The script
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub asked: AskedArgs,

    /// One JSON object a mistake, for programs
    #[arg(long)]
    pub json: bool,
}

/// Sends a script to a robot, which does it in place of the one before
///
/// It is checked first. What was sent begins when all of it is there; until then the one before
/// goes on. With `--keep` the robot keeps it in its flash, in place of the one that it kept before:
/// each time that it starts with the mission that runs now, it does the script from its beginning.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm script run missions/square.script --port /dev/ttyACM0
  esm script run missions/square.script --keep --port /dev/ttyACM0")]
pub struct RunArgs {
    /// The script
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Keep it in the robot's flash: it is done again after a loss of power
    #[arg(long)]
    pub keep: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// A robot.
#[derive(Debug, Args)]
pub struct OnRobotArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What `--json` prints of a script.
#[derive(Debug, Serialize)]
struct State {
    #[serde(flatten)]
    script: ScriptReport,
    kept: Option<KeptReport>,
}

/// The same where none was run.
#[derive(Debug, Serialize)]
struct NoScript {
    script: Option<String>,
    kept: Option<KeptReport>,
}

/// The script that the robot keeps in its flash.
#[derive(Debug, Serialize)]
struct KeptReport {
    script: String,
    steps: u8,
    /// It is for the mission that runs.
    starts: bool,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &ScriptArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    match &args.action {
        Action::Check(args) => check(args, robot, console),
        Action::Run(args) => run(args, console),
        Action::Show(args) => {
            let (mut robot, _) = connect(&args.robot, console)?;
            tell_state(&mut robot, args.json, console)
        }
        Action::Suspend(args) => change(args, BehaviourRequest::SuspendScript, console),
        Action::Resume(args) => change(args, BehaviourRequest::ResumeScript, console),
        Action::End(args) => change(args, BehaviourRequest::EndScript, console),
        Action::Remove(args) => {
            let (mut robot, _) = connect(&args.robot, console)?;
            robot.require(Feature::Store)?;
            robot.remove_script()?;
            tell_state(&mut robot, args.json, console)
        }
    }
}

fn check(args: &CheckArgs, robot: RobotMaker, console: &mut Console) -> Result<(), CommandError> {
    // A file that is not there is told before a board is started.
    let text = text_of(&args.file)?;
    let (declared, _) = tasks::declarations(&args.asked, robot, console)?;
    let tasks = tasks::declared_in(&declared, console)?;
    let script = checked(&args.file, &text, &tasks, args.json, console)?;
    if !args.json {
        let inserted = script.all.len() - script.steps;
        console.text(&format!(
            "{}: {} steps{}\n",
            args.file.display(),
            script.steps,
            match inserted {
                0 => String::new(),
                _ => format!(", and {inserted} that situations insert"),
            }
        ))?;
    }
    Ok(())
}

/// The text of a script.
///
/// # Errors
/// If the file cannot be read.
pub fn text_of(file: &Path) -> Result<String, CommandError> {
    mission::refuse_blob(file)?;
    let bytes = lang::read_source(file).map_err(|error| match error {
        LoadError::NotAFile { path } => {
            CommandError::Input(anyhow!("`{}` is not a file: name a script", path.display()))
        }
        other => mission::unread(file, &other),
    })?;
    String::from_utf8(bytes)
        .with_context(|| format!("{} is no text", file.display()))
        .map_err(CommandError::Input)
}

/// A script for a firmware with these tasks. Mistakes are told.
///
/// # Errors
/// If there are any.
pub fn checked(
    file: &Path,
    text: &str,
    tasks: &[Task],
    json: bool,
    console: &mut Console,
) -> Result<Script, CommandError> {
    let reading = read(&file.display().to_string(), text, tasks);
    if let Some(script) = reading.script {
        return Ok(script);
    }
    if json {
        console.text(&lang::json_messages(&reading.files, &reading.diagnostics))?;
    } else {
        mission::tell_found(&reading.files, &reading.diagnostics, console);
    }
    Err(CommandError::Told)
}

fn run(args: &RunArgs, console: &mut Console) -> Result<(), CommandError> {
    let text = text_of(&args.file)?;
    let (mut robot, tasks) = connect_and_read(&args.robot, console)?;
    if args.keep {
        robot.require(Feature::Store)?;
    }
    let script = checked(&args.file, &text, &tasks, args.json, console)?;
    robot.run_script(&script)?;
    if args.keep {
        robot.keep_script(&script)?;
    }
    tell_state(&mut robot, args.json, console)
}

fn change(
    args: &OnRobotArgs,
    request: BehaviourRequest<'_>,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (mut robot, _) = connect(&args.robot, console)?;
    robot.change_behaviours(request)?;
    tell_state(&mut robot, args.json, console)
}

fn tell_state(robot: &mut Robot, json: bool, console: &mut Console) -> Result<(), CommandError> {
    let status = robot.behaviour_list()?.script;
    // A robot without a flash keeps none.
    let kept = match robot.built_in()?.features.has(Feature::Store) {
        true => kept_report(robot.kept_script()?),
        false => None,
    };
    match (script_report(status), json) {
        (Some(script), true) => console.json_line(&State { script, kept }),
        (None, true) => console.json_line(&NoScript { script: None, kept }),
        (Some(report), false) => {
            console.text(&format!("{}\n{}", script_line(&report), kept_line(kept)))
        }
        (None, false) => console.text(&format!("no script was run\n{}", kept_line(kept))),
    }
}

/// The script that is kept; none where there is none.
fn kept_report(kept: ScriptStatus) -> Option<KeptReport> {
    (kept.state != ScriptState::None).then(|| KeptReport {
        script: format!("{:08x}", kept.script),
        steps: kept.steps,
        starts: kept.state == ScriptState::Runs,
    })
}

fn kept_line(kept: Option<KeptReport>) -> String {
    kept.map_or_else(String::new, |kept| {
        format!(
            "kept: script {} of {} steps, which {}\n",
            kept.script,
            kept.steps,
            if kept.starts {
                "starts with the mission that runs, each time that the robot does"
            } else {
                "starts with another mission, and not with the one that runs"
            }
        )
    })
}
