//! `esm tasks`: what a firmware can do.

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;

use super::argument::Port;
use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience};
use super::robot::{self, LineArgs, Robot};
use super::shipped_docs::with_docs;
use super::stage;
use crate::behaviour_words::TaskNames;
use crate::host_board::RobotMaker;
use crate::lang;
use crate::link_client::{LinkClient, RobotInfo};
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::PlantSide;
use crate::model::{Model, Task};
use crate::plant::{BodyParameters, Plant};
use crate::run::board::{LinkWay, RunningBoard};
use crate::script::signature_hash;
use crate::task_page;

/// Prints a firmware's task declarations as `.esm`, so that nobody copies signatures by hand
///
/// Asks the robot at PORT, or else a board that is started for the question. With --page it writes
/// a page for people instead, with a picture of each task; it can make that from a FILE of
/// declarations, too.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm tasks -o rover_tasks.esm
  esm tasks --port /dev/ttyUSB0 -o rover_tasks.esm
  esm tasks --page docs missions/rover.esm")]
pub struct TasksArgs {
    /// Declarations to make the page from, instead of a robot's
    #[arg(value_name = "FILE", requires = "page", conflicts_with_all = ["port", "board"])]
    pub file: Option<PathBuf>,

    /// Where the declarations go, instead of to standard output; a file that is there is replaced
    /// when they are all here
    #[arg(short, long, value_name = "OUT", conflicts_with = "page")]
    pub output: Option<PathBuf>,

    /// Writes a page for people into this folder, `tasks.md`, and a picture of each task into
    /// `img/tasks` in it
    #[arg(long, value_name = "FOLDER")]
    pub page: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub asked: AskedArgs,
}

/// Whose declarations are wanted.
#[derive(Debug, Args)]
pub struct AskedArgs {
    /// Where the robot is: a serial line, unix:PATH or tcp:HOST:PORT
    #[arg(long, value_name = "PORT", conflicts_with = "board")]
    pub port: Option<Port>,

    /// The board to ask
    #[arg(long, value_name = "BOARD", default_value = crate::boards::DEFAULT)]
    pub board: String,

    /// The firmware to ask on an emulated board, instead of the one that the checkout builds
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub line: LineArgs,
}

/// Runs the command. `robot` is what the board `host` has.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(
    args: &TasksArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(), CommandError> {
    if let Some(file) = &args.file {
        let checked = mission::read(file)?;
        mission::tell(&checked, Audience::Person, console)?;
        let name = file
            .file_name()
            .unwrap_or(file.as_os_str())
            .to_string_lossy();
        return write_page(&checked, &name, args.page.as_deref(), console);
    }
    if let Some(output) = &args.output {
        keep_other_text(output)?;
    }
    let (text, origin) = declarations(&args.asked, robot, console)?;
    if args.page.is_none() {
        let [begins, ends] = MARK;
        let text = format!("{begins}{origin}{ends}\n{text}");
        return match &args.output {
            Some(path) => file::write_whole(path, text.as_bytes(), "declarations"),
            None => console
                .out()
                .write_all(text.as_bytes())
                .map_err(CommandError::from),
        };
    }
    let checked = lang::load_text("tasks.esm", &text);
    mission::tell(&checked, Audience::Person, console)?;
    write_page(&checked, &origin, args.page.as_deref(), console)
}

/// How the first line of what the command prints begins and ends.
const MARK: [&str; 2] = ["// The tasks of ", ", as `esm tasks` printed them."];

/// Refuses to write over a file in which a person has written something.
///
/// # Errors
/// If such a file is there: then the command line is wrong.
fn keep_other_text(output: &Path) -> Result<(), CommandError> {
    // What is not there or is no file cannot be lost.
    if !output.is_file() || lang::read_source(output).is_ok_and(|bytes| is_ours(&bytes)) {
        return Ok(());
    }
    Err(CommandError::Usage(anyhow!(
        "{} would be overwritten, and it holds more than `esm tasks` has written: name another file",
        output.display()
    )))
}

/// Whether a file is empty, or has the first line that this command writes and then tasks alone.
fn is_ours(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return false;
    };
    let [begins, ends] = MARK;
    let mark = text.lines().next().unwrap_or_default();
    let checked = lang::load_text("tasks.esm", text);
    let holds_tasks_alone = |model: &Model| model.containers.is_empty() && model.slots.is_empty();
    text.is_empty()
        || mark.starts_with(begins)
            && mark.ends_with(ends)
            && checked.model.as_ref().is_some_and(holds_tasks_alone)
}

/// What a robot declares, and which robot it is.
///
/// # Errors
/// If there is no such robot, or it does not say.
pub fn declarations(
    args: &AskedArgs,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<(String, String), CommandError> {
    if let Some(port) = &args.port {
        let (mut client, info) = robot::connect(port, args.line, console)?;
        return ask(&mut client, &info);
    }
    // A board by itself, in a world that it never drives in.
    let board = stage::board(&args.board, args.firmware.as_deref(), robot, console)?;
    let plant = Plant::new(stage::world(None, None)?, BodyParameters::default(), 0)
        .map_err(|error| CommandError::Input(error.into()))?;
    let plant = PlantSide::new(plant, Pace::new(false), None);
    let (_running, line) = RunningBoard::start(board, &plant, None, LinkWay::Uart)?;
    let (mut client, info) = LinkClient::connect(line)?;
    ask(&mut client, &info)
}

/// What a robot declares, and which robot it is.
///
/// # Errors
/// If it does not say.
pub fn ask(robot: &mut Robot, info: &RobotInfo) -> Result<(String, String), CommandError> {
    let mut text = String::new();
    for index in 0..info.task_types {
        let declaration = with_docs(&robot.task_declaration(index)?);
        let _ = writeln!(text, "\n{}", declaration.trim_end());
    }
    Ok((
        text,
        format!("{} on the board {}", info.firmware, info.board),
    ))
}

/// The names of a robot's task types, by the lower halves of their hashes.
///
/// # Errors
/// The robot does not say them.
pub fn names(
    robot: &mut Robot,
    info: &RobotInfo,
    console: &mut Console,
) -> Result<TaskNames, CommandError> {
    let (text, _) = ask(robot, info)?;
    let tasks = declared_in(&text, console)?;
    let name = |task: &Task| (signature_hash(task) as u16, task.name.clone());
    Ok(tasks.iter().map(name).collect())
}

/// The tasks that a firmware has declared in a text.
///
/// # Errors
/// If the text is none that a firmware says; that was told.
pub fn declared_in(text: &str, console: &mut Console) -> Result<Vec<Task>, CommandError> {
    let checked = lang::load_text("tasks.esm", text);
    mission::tell(&checked, Audience::Person, console)?;
    match checked.model {
        Some(model) => Ok(model.tasks),
        None => Err(CommandError::Told),
    }
}

fn write_page(
    checked: &lang::Checked,
    origin: &str,
    folder: Option<&Path>,
    console: &mut Console,
) -> Result<(), CommandError> {
    let (Some(page), Some(folder)) = (task_page::of(checked, origin), folder) else {
        return Err(CommandError::Told);
    };
    if page.pictures.is_empty() {
        return Err(CommandError::Input(anyhow!("{origin} declares no task")));
    }
    let pictures = folder.join(task_page::PICTURES);
    std::fs::create_dir_all(&pictures)
        .with_context(|| format!("cannot make the folder {}", pictures.display()))
        .map_err(CommandError::World)?;
    for (name, scene) in &page.pictures {
        file::write_whole(&pictures.join(name), scene.to_svg().as_bytes(), "picture")?;
    }
    let path = folder.join(task_page::PAGE);
    file::write_whole(&path, page.text.as_bytes(), "page")?;
    console.note(&format!(
        "{} tasks are in {}, their pictures in {}",
        page.pictures.len(),
        path.display(),
        pictures.display()
    ));
    Ok(())
}
