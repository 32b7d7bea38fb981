//! `esm new task`, `esm new behaviour` and `esm new mission`: parts of a robot that there is.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;

use super::crate_of_robot::{Entry, LIBRARY, RobotCrate, entered};
use super::files::{self, NewFile, Report};
use super::names::Name;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;

/// Adds a task with its test to the robot around the working directory
///
/// The task is `src/NAME.rs`, its test `tests/NAME.rs`. It is entered in the registry in
/// `src/lib.rs`, where that is laid out as `esm new robot` does it; otherwise the lines to add are
/// printed.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm new task watch_ahead

With --json one object: kind, name, folder, files (below that folder), changed, next.")]
pub struct NewTaskArgs {
    #[command(flatten)]
    part: PartArgs,
}

/// Adds a behaviour with its test and a mission to the robot around the working directory
///
/// A behaviour is a task with a law of control, which takes its turn on the robot's list. It is
/// `src/NAME.rs`, the test of its law `tests/NAME.rs`, and `NAME.esm` a mission in which it drives
/// the robot, where that has sonars, odometry and wheels. It is entered in the registry as a task
/// is, with the owner of the list, `Behaviours`, where the robot has none yet.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm new behaviour come_near

With --json one object: kind, name, folder, files (below that folder), changed, next.")]
pub struct NewBehaviourArgs {
    #[command(flatten)]
    part: PartArgs,
}

/// Adds a mission with a scenario to the robot around the working directory
///
/// The mission is `NAME.esm`, beside the declarations that it uses: `tasks.esm` of the robot.
/// `esm test` runs the scenario.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm new mission explore

With --json one object: kind, name, folder, files (below that folder), changed, next.")]
pub struct NewMissionArgs {
    #[command(flatten)]
    part: PartArgs,
}

/// What each part is asked for with.
#[derive(Debug, Args)]
pub struct PartArgs {
    /// Its name: small letters, digits and `_`
    #[arg(value_name = "NAME")]
    pub name: String,

    /// The robot's folder [default: the one around the working directory]
    #[arg(long, value_name = "DIR")]
    pub robot: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// What the templates have places for.
#[derive(Serialize)]
struct Values<'a> {
    name: &'a str,
    r#type: &'a str,
    robot: &'a str,
}

/// Declarations of a robot's tasks, beside its missions.
const DECLARATIONS: &str = "tasks.esm";

/// What writes them anew.
const DECLARE: &str = "cargo run -- tasks --board host -o tasks.esm";

/// Adds a task.
///
/// # Errors
/// What kept it from ending well.
pub fn task(args: &NewTaskArgs, console: &mut Console) -> Result<(), CommandError> {
    let templates = [
        include_str!("../../../templates/task/task.rs.jinja"),
        include_str!("../../../templates/task/test.rs.jinja"),
    ];
    add("task", &args.part, templates, None, &[], console)
}

/// Adds a behaviour.
///
/// # Errors
/// What kept it from ending well.
pub fn behaviour(args: &NewBehaviourArgs, console: &mut Console) -> Result<(), CommandError> {
    let templates = [
        include_str!("../../../templates/behaviour/behaviour.rs.jinja"),
        include_str!("../../../templates/behaviour/test.rs.jinja"),
    ];
    let owner = Entry {
        module: None,
        field: "behaviours",
        task: "esm::rt_firmware::behaviours::Behaviours",
    };
    let mission = include_str!("../../../templates/behaviour/mission.esm.jinja");
    add(
        "behaviour",
        &args.part,
        templates,
        Some(mission),
        &[owner],
        console,
    )
}

/// Adds a task of templates: its file and that of its test, and a mission for it, where the robot
/// has the tasks that the mission takes. What it `needs` is entered in the registry, too, where it
/// is not there yet.
fn add(
    kind: &str,
    args: &PartArgs,
    [task, test]: [&str; 2],
    mission: Option<&str>,
    needs: &[Entry<'_>],
    console: &mut Console,
) -> Result<(), CommandError> {
    let name = Name::new(&args.name).map_err(CommandError::Usage)?;
    let robot = robot_of(args)?;
    has_not(&robot, &name)?;
    let values = Values {
        name: &name.snake,
        r#type: &name.camel,
        robot: &robot.name,
    };
    let mut new = vec![
        NewFile::of_template(format!("src/{}.rs", name.snake), task, &values)?,
        NewFile::of_template(format!("tests/{}.rs", name.snake), test, &values)?,
    ];
    let declared = declarations(&robot)?;
    let mission = mission.filter(|_| lacking(&declared, &OF_BEHAVIOUR).is_empty());
    if let Some(mission) = mission {
        let file = format!("{}.esm", name.snake);
        new.push(NewFile::of_template(file, mission, &values)?);
    }
    let type_path = format!("{}::{}", name.snake, name.camel);
    let own = Entry {
        module: Some(&name.snake),
        field: &name.snake,
        task: &type_path,
    };
    let lacks = |need: &&Entry<'_>| !robot.library.contains(&format!("{}: ", need.field));
    let mut entries: Vec<&Entry<'_>> = needs.iter().filter(lacks).collect();
    entries.push(&own);
    let with_all = (entries.iter()).try_fold(robot.library.clone(), |text, it| entered(&text, it));
    files::write(&robot.folder, &new)?;
    let (changed, mut next) = match with_all {
        Some(text) => {
            file::write_whole(
                &robot.folder.join(LIBRARY),
                text.as_bytes(),
                "robot's library",
            )?;
            (vec![LIBRARY.to_owned()], Vec::new())
        }
        None => {
            let by_hand = entries.iter().flat_map(|entry| entry.by_hand());
            (Vec::new(), by_hand.collect())
        }
    };
    next.push(format!("cargo test --test {}", name.snake));
    next.push(format!("{DECLARE}     # so that missions know it"));
    if mission.is_some() {
        next.push(drive(&name));
    }
    let report = Report {
        kind,
        name: &name.snake,
        folder: robot.folder.display().to_string(),
        files: files::names(&new),
        changed,
        next,
    };
    report.tell(args.json, console)
}

/// The robot that a part is added to.
fn robot_of(args: &PartArgs) -> Result<RobotCrate, CommandError> {
    RobotCrate::find(args.robot.as_deref().unwrap_or(Path::new(".")))
}

/// What a robot has declared of its tasks, for its missions; nothing where it has no such file.
fn declarations(robot: &RobotCrate) -> Result<String, CommandError> {
    let file = robot.folder.join(DECLARATIONS);
    match file.is_file() {
        true => file::read_text(&file, "declarations"),
        false => Ok(String::new()),
    }
}

/// Those of these tasks that are not declared.
fn lacking<'a>(declared: &str, tasks: &[&'a str]) -> Vec<&'a str> {
    let lacks = |task: &&&str| {
        let begins = format!("task {task} ");
        !declared.lines().any(|line| line.starts_with(&begins))
    };
    tasks.iter().filter(lacks).copied().collect()
}

/// What drives a mission of the robot.
fn drive(name: &Name) -> String {
    let file = &name.snake;
    format!("cargo run -- run {file}.esm --board host --until '60 s'")
}

/// Refuses a name that the robot has: of a module, or of a task that its missions know.
fn has_not(robot: &RobotCrate, name: &Name) -> Result<(), CommandError> {
    let declared = declarations(robot)?;
    let module = format!("mod {};", name.snake);
    let is_module = (robot.library.lines()).any(|line| line.trim_end().ends_with(&module));
    let task = format!("task {} ", name.camel);
    let is_task = declared.lines().any(|line| line.starts_with(&task));
    match is_module || is_task || name.snake == robot.name {
        true => Err(CommandError::Usage(anyhow!(
            "the robot {} has a `{}` already: take another name",
            robot.name,
            match is_task {
                true => &name.camel,
                false => &name.snake,
            }
        ))),
        false => Ok(()),
    }
}

/// Tasks that the template of a mission makes states of.
const OF_MISSION: [&str; 5] = ["SonarRing", "Odometry", "Cruise", "Turn", "WheelSpeed"];

/// The same for the mission of a behaviour, beside that and the owner of the list.
const OF_BEHAVIOUR: [&str; 3] = ["SonarRing", "Odometry", "WheelSpeed"];

/// Adds a mission.
///
/// # Errors
/// What kept it from ending well.
pub fn mission(args: &NewMissionArgs, console: &mut Console) -> Result<(), CommandError> {
    let args = &args.part;
    let name = Name::new(&args.name).map_err(CommandError::Usage)?;
    let robot = robot_of(args)?;
    let declared = file::read_text(&robot.folder.join(DECLARATIONS), "declarations")
        .map_err(|error| with_remedy(error, &format!("`{DECLARE}` writes them")))?;
    let lacking = lacking(&declared, &OF_MISSION);
    if !lacking.is_empty() {
        return Err(CommandError::Input(anyhow!(
            "a new mission begins with tasks that {DECLARATIONS} does not declare: {}; write yours from the robot's own \
             mission instead",
            lacking.join(", ")
        )));
    }
    let values = Values {
        name: &name.snake,
        r#type: &name.camel,
        robot: &robot.name,
    };
    let new = [
        NewFile::of_template(
            format!("{}.esm", name.snake),
            include_str!("../../../templates/mission/mission.esm.jinja"),
            &values,
        )?,
        NewFile::of_template(
            format!("{}.scenario", name.snake),
            include_str!("../../../templates/mission/mission.scenario.jinja"),
            &values,
        )?,
    ];
    files::write(&robot.folder, &new)?;
    let report = Report {
        kind: "mission",
        name: &name.snake,
        folder: robot.folder.display().to_string(),
        files: files::names(&new),
        changed: Vec::new(),
        next: vec!["esm test .".to_owned(), drive(&name)],
    };
    report.tell(args.json, console)
}

/// An error of the input, with what to do about it.
fn with_remedy(error: CommandError, remedy: &str) -> CommandError {
    match error {
        CommandError::Input(error) => CommandError::Input(anyhow!("{error}; {remedy}")),
        error => error,
    }
}
