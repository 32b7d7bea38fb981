//! `esm param`: parameters of the mission that a robot runs, read, changed and saved while it
//! drives.

use std::fmt::Write as _;

use anyhow::anyhow;
use clap::{Args, Subcommand};
use esm_link::features::Feature;
use esm_link::message::LinkError;
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::robot::{Robot, RobotArgs};
use crate::link_client::ParamBits;
use crate::nearest::nearest;
use crate::parameters::{Parameter, Value, parameters_of};
use crate::reading::ReadError;
use crate::run::mission::hash_text;

/// Reads, changes and saves parameters of the mission that a robot runs, while it drives
#[derive(Debug, Args)]
#[command(
    arg_required_else_help = true,
    subcommand_required = true,
    after_help = "\
Examples:
  esm param get --port /dev/ttyUSB0
  esm param get motion/Cruise.speed --port /dev/ttyUSB0
  esm param set motion/Cruise.speed 0.3 --port /dev/ttyUSB0
  esm param save --port /dev/ttyUSB0"
)]
pub struct ParamArgs {
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
    Get(GetArgs),
    Set(SetArgs),
    Save(SaveArgs),
}

/// Shows the values of parameters, and what the mission says and what was saved where they differ
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm param get --port /dev/ttyUSB0
  esm param get motion/Cruise.speed --port /dev/ttyUSB0 --json")]
pub struct GetArgs {
    /// The parameter: the path of its task state, a dot, its name. All of them without
    #[arg(value_name = "NAME")]
    pub name: Option<String>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object a parameter, for programs
    #[arg(long)]
    pub json: bool,
}

/// Gives a parameter another value, from the next macro step on
///
/// The value holds for all instances of the task state, until a mission starts or starts anew, or
/// beyond that if it is saved. The robot takes what is within the bounds that its firmware's task
/// declares.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm param set motion/Cruise.speed 0.3 --port /dev/ttyUSB0
  esm param set motion/Turn.angle -90 --port /dev/ttyUSB0")]
pub struct SetArgs {
    /// The parameter: the path of its task state, a dot, its name
    #[arg(value_name = "NAME")]
    pub name: String,

    /// Its new value
    #[arg(value_name = "VALUE", allow_hyphen_values = true)]
    pub value: String,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Keeps the values that differ now in the robot's flash, for the mission that runs
///
/// Each time that this mission starts from now on, it starts with them. They take the place of what
/// was saved before, for this mission or another. Where nothing differs, nothing is saved any more.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm param save --port /dev/ttyUSB0
  esm param save --port /dev/ttyUSB0 --json")]
pub struct SaveArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What was saved, in the form of its JSON.
#[derive(Debug, Serialize)]
struct SaveReport {
    /// Hash of the mission.
    mission: String,
    /// How many values.
    saved: u8,
}

/// A parameter, in the form of its JSON. Values are numbers or booleans.
#[derive(Debug, Serialize)]
struct ParamReport<'a> {
    /// Its names: one for each instance of its task state.
    names: &'a [String],
    #[serde(rename = "type")]
    kind: &'static str,
    /// The value that it has now.
    value: Value,
    /// The value that the mission gives it; `esm param get` says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    of_mission: Option<Value>,
    /// The value that was saved for it, if one was; `esm param get` says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    saved: Option<Value>,
    /// The value that it had before; `esm param set` says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    before: Option<Value>,
}

/// The mission that a robot runs, and its parameters.
struct Known {
    mission: u32,
    parameters: Vec<Parameter>,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &ParamArgs, console: &mut Console) -> Result<(), CommandError> {
    match &args.action {
        Action::Get(args) => get(args, console),
        Action::Set(args) => set(args, console),
        Action::Save(args) => save(args, console),
    }
}

fn get(args: &GetArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect(console)?;
    robot.require(Feature::Params)?;
    let known = Known::read(&mut robot)?;
    let wanted = match &args.name {
        Some(name) => std::slice::from_ref(known.find(name)?),
        None => &known.parameters,
    };
    let width = (wanted.iter())
        .map(|parameter| parameter.name().chars().count())
        .max();
    let width = width.unwrap_or_default();
    for parameter in wanted {
        let kind = parameter.kind;
        let ParamBits {
            value,
            of_mission,
            saved,
        } = robot.param(known.mission, parameter.index)?;
        if args.json {
            console.json_line(&ParamReport {
                names: &parameter.names,
                kind: kind.name(),
                value: kind.value(value),
                of_mission: Some(kind.value(of_mission)),
                saved: saved.map(|saved| kind.value(saved)),
                before: None,
            })?;
            continue;
        }
        let mut row = format!("{:<width$}  {}", parameter.name(), kind.value(value));
        // Writing to a string cannot fail.
        let _ = match saved {
            Some(saved) if saved == value => write!(
                row,
                "  (saved; the mission says {})",
                kind.value(of_mission)
            ),
            Some(saved) => write!(
                row,
                "  (saved: {}; the mission says {})",
                kind.value(saved),
                kind.value(of_mission)
            ),
            None if value != of_mission => write!(
                row,
                "  (not saved; the mission says {})",
                kind.value(of_mission)
            ),
            None => Ok(()),
        };
        if let [_, others @ ..] = &parameter.names[..]
            && !others.is_empty()
        {
            let _ = write!(row, "  also {}", others.join(", "));
        }
        row.push('\n');
        console.text(&row)?;
    }
    Ok(())
}

fn set(args: &SetArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, _) = args.robot.connect(console)?;
    robot.require(Feature::Params)?;
    let known = Known::read(&mut robot)?;
    let parameter = known.find(&args.name)?;
    let kind = parameter.kind;
    let value = kind.parse(&args.value).ok_or_else(|| {
        CommandError::Input(anyhow!(
            "`{}` is no value of `{}`, which is of type {kind}",
            args.value,
            args.name
        ))
    })?;
    let before = robot
        .set_param(known.mission, parameter.index, value)
        .map_err(|error| match error.refusal() {
            Some(LinkError::ParamOutside { min, max }) => CommandError::Input(anyhow!(
                "{} is outside of what the robot's task takes for `{}`: {} to {}",
                kind.value(value),
                args.name,
                kind.value(min),
                kind.value(max)
            )),
            _ => error.into(),
        })?;
    if args.json {
        return console.json_line(&ParamReport {
            names: &parameter.names,
            kind: kind.name(),
            value: kind.value(value),
            of_mission: None,
            saved: None,
            before: Some(kind.value(before)),
        });
    }
    console.text(&format!(
        "{}: {} -> {}\n",
        args.name,
        kind.value(before),
        kind.value(value)
    ))
}

fn save(args: &SaveArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, info) = args.robot.connect(console)?;
    robot.require(Feature::Params)?;
    let mission = info.mission.ok_or_else(|| {
        CommandError::Input(anyhow!(
            "the robot has no mission; `esm upload` gives it one"
        ))
    })?;
    let saved = robot.save_params(mission)?;
    let mission = hash_text(mission);
    if args.json {
        return console.json_line(&SaveReport { mission, saved });
    }
    console.text(&match saved {
        0 => format!("nothing differs from mission {mission}: nothing is saved any more\n"),
        1 => format!("1 value saved: mission {mission} starts with it\n"),
        _ => format!("{saved} values saved: mission {mission} starts with them\n"),
    })
}

impl Known {
    fn read(robot: &mut Robot) -> Result<Self, CommandError> {
        let blob = robot.running_blob()?;
        let blob = esm_core::verify(blob).map_err(|(_, refusal)| ReadError::Blob(refusal))?;
        let parameters = parameters_of(&blob).map_err(|error| CommandError::Input(error.into()))?;
        Ok(Known {
            mission: blob.hash(),
            parameters,
        })
    }

    fn find(&self, name: &str) -> Result<&Parameter, CommandError> {
        let has_name = |parameter: &&Parameter| parameter.names.iter().any(|known| known == name);
        self.parameters.iter().find(has_name).ok_or_else(|| {
            let names = self
                .parameters
                .iter()
                .flat_map(|parameter| &parameter.names);
            let hint = match nearest(name, names.map(String::as_str)) {
                Some(near) => format!("did you mean `{near}`?"),
                None => "`esm param get` lists what it has".to_owned(),
            };
            CommandError::Input(anyhow!(
                "the mission that runs has no parameter `{name}`; {hint}"
            ))
        })
    }
}
