//! `esm new robot`: a crate of the user's own.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;
use serde::Serialize;
use toml_edit::{DocumentMut, value};

use super::files::{self, NewFile, Report};
use super::framework;
use super::locks::{self, Rename};
use super::names::Name;
use crate::boards::{self, Board};
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;

/// Makes a robot of your own: a crate, anywhere
///
/// It has a driver, a task on it with a test, a registry, a mission with a scenario and a world, a
/// program for this computer, firmware for its board, and a file for CI. It builds as it is, and
/// its README says how it is tested, driven and flashed. The chapter "A robot of your own" of the
/// book explains each file.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm new robot my_robot
  esm new robot my_pico --board pico --path ~/robots/my_pico
  esm new robot my_robot --framework ~/esm

The framework is the checkout that --framework names, or else the one around the working directory, the one that this \
command was built in, or the one that `cargo install` has installed it from.

With --json one object: kind, name, folder, files (below that folder), changed, next.")]
pub struct NewRobotArgs {
    /// Its name, as a crate has it: small letters, digits and `_`
    #[arg(value_name = "NAME")]
    pub name: String,

    /// The board that its firmware is for; `host` is none
    #[arg(long, value_name = "B", default_value = boards::DEFAULT)]
    pub board: String,

    /// Its folder, which must not be there, or be empty [default: NAME]
    #[arg(long, value_name = "DIR")]
    pub path: Option<PathBuf>,

    /// The framework's checkout
    #[arg(long, value_name = "PATH")]
    pub framework: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// The name or the board is none, something is there already, or nobody knows where the framework
/// is.
pub fn execute(args: &NewRobotArgs, console: &mut Console) -> Result<(), CommandError> {
    let name = Name::new(&args.name).map_err(CommandError::Usage)?;
    let board = boards::find(&args.board).map_err(|error| CommandError::Usage(error.into()))?;
    if boards::all().any(|board| board.name == name.snake) {
        return Err(CommandError::Usage(anyhow!(
            "`{}` is a board: give the robot another name",
            name.snake
        )));
    }
    let here = std::env::current_dir()?;
    let framework = framework::find(args.framework.as_deref(), &here)?;
    let folder = args
        .path
        .clone()
        .unwrap_or_else(|| name.snake.clone().into());
    let mut entries = match std::fs::read_dir(&folder) {
        Ok(entries) => Some(entries),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        Err(error) => {
            return Err(CommandError::Usage(anyhow!(
                "{} can be no robot's folder: {error}",
                folder.display()
            )));
        }
    };
    if entries.as_mut().is_some_and(|it| it.next().is_some()) {
        return Err(CommandError::Usage(anyhow!(
            "{} is there already, and stays as it is: name another folder with --path",
            folder.display()
        )));
    }
    // By its whole name, so that what its README says works from anywhere.
    std::fs::create_dir_all(&folder).map_err(|error| {
        CommandError::World(anyhow!("cannot make {}: {error}", folder.display()))
    })?;
    let whole = folder.canonicalize()?;
    let place = Place {
        framework: text_of(&framework)?,
        folder: text_of(&whole)?,
    };
    let source = Framework::read(&framework, board)?;
    let new = robot_files(&name, board, &place, &source)?;
    files::write(&folder, &new)?;
    let mut next = vec![format!("cd {}", quoted(&folder.display().to_string()))];
    next.push("cargo test".to_owned());
    next.push(
        "cargo run -- run mission.esm --world room.world --board host --until '60 s'".to_owned(),
    );
    if board.firmware.is_some() {
        next.push("README.md says how its firmware is built, driven and flashed".to_owned());
    }
    Report {
        kind: "robot",
        name: &name.snake,
        folder: folder.display().to_string(),
        files: files::names(&new),
        changed: Vec::new(),
        next,
    }
    .tell(args.json, console)
}

/// A path as text, which files can have in them.
fn text_of(path: &Path) -> Result<String, CommandError> {
    let text = path
        .to_str()
        .filter(|text| !text.contains(['\n', '\r', '\'']));
    text.map(str::to_owned).ok_or_else(|| {
        CommandError::Usage(anyhow!(
            "{} has a letter that neither Cargo.toml nor a shell can be given: take another folder",
            path.display()
        ))
    })
}

/// A word of a command line.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+~".contains(c);
    match word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{word}'"),
    }
}

/// Where a robot stands, and where its framework does.
struct Place {
    /// The framework's checkout, seen from the robot's folder.
    framework: String,
    /// The robot's folder, seen from the framework's checkout.
    folder: String,
}

/// What a robot takes over from the framework.
struct Framework {
    /// How cargo builds for the board: `.cargo/config.toml` of its folder.
    cargo_config: Option<String>,
    /// What a robot's file begins with, where the board has one.
    robot_file: Option<String>,
    /// The lock files of an example: of the robot, and of its firmware.
    locks: [Option<String>; 2],
    /// The example's name.
    example: &'static str,
}

/// What a board's robot begins with, in the board's folder.
const ROBOT_FILE: &str = "new_robot.toml";

impl Framework {
    /// Reads what a robot on this board takes over.
    fn read(checkout: &Path, board: &Board) -> Result<Self, CommandError> {
        let read = |name: String| file::read_text(&checkout.join(name), "framework's");
        let has_pins = robot_file::has_pins(board.name);
        let example = match has_pins {
            true => "my_pico",
            false => "my_robot",
        };
        if board.firmware.is_some() {
            let manifest = read("esm/Cargo.toml".to_owned())?;
            if !manifest.contains(&format!("\n{} = [", board.name)) {
                return Err(CommandError::Input(anyhow!(
                    "the crate `esm` of {} does not hand on the board {board}: its Cargo.toml needs a feature `{board}`, \
                     and the dependency `{board}-board`, as it has those of the board {}",
                    checkout.display(),
                    boards::DEFAULT,
                    board = board.name
                )));
            }
        }
        let of_board = |name: &str| read(format!("boards/{}/{name}", board.name)).map(Some);
        Ok(Self {
            cargo_config: match board.firmware {
                Some(_) => of_board(".cargo/config.toml")?,
                None => None,
            },
            robot_file: match has_pins {
                true => of_board(ROBOT_FILE)?,
                false => None,
            },
            locks: [
                Some(read(format!("examples/{example}/Cargo.lock"))?),
                match board.firmware {
                    Some(_) => Some(read(format!("examples/{example}/firmware/Cargo.lock"))?),
                    None => None,
                },
            ],
            example,
        })
    }
}

/// The templates, and where what is made of each goes.
const TEMPLATES: [(&str, &str); 13] = [
    (
        "Cargo.toml",
        include_str!("../../../templates/robot/Cargo.toml.jinja"),
    ),
    (
        ".gitignore",
        include_str!("../../../templates/robot/gitignore"),
    ),
    (
        "README.md",
        include_str!("../../../templates/robot/README.md.jinja"),
    ),
    (
        ".github/workflows/ci.yml",
        include_str!("../../../templates/robot/github/ci.yml.jinja"),
    ),
    (
        "src/lib.rs",
        include_str!("../../../templates/robot/src/lib.rs.jinja"),
    ),
    (
        "src/lamp.rs",
        include_str!("../../../templates/robot/src/lamp.rs"),
    ),
    (
        "src/headlight.rs",
        include_str!("../../../templates/robot/src/headlight.rs"),
    ),
    (
        "tests/drives.rs",
        include_str!("../../../templates/robot/tests/drives.rs.jinja"),
    ),
    (
        "tests/headlight.rs",
        include_str!("../../../templates/robot/tests/headlight.rs.jinja"),
    ),
    (
        "mission.esm",
        include_str!("../../../templates/robot/mission.esm"),
    ),
    (
        "mission.lamp.scenario",
        include_str!("../../../templates/robot/mission.lamp.scenario"),
    ),
    (
        "room.world",
        include_str!("../../../templates/robot/room.world"),
    ),
    (
        "tasks.esm",
        include_str!("../../../templates/robot/tasks.esm"),
    ),
];

/// The program for the host, whose file has the robot's name.
const HOST: &str = include_str!("../../../templates/robot/src/bin/host.rs.jinja");

/// Those of a firmware.
const FIRMWARE: [(&str, &str); 2] = [
    (
        "firmware/Cargo.toml",
        include_str!("../../../templates/robot/firmware/Cargo.toml.jinja"),
    ),
    (
        "firmware/src/main.rs",
        include_str!("../../../templates/robot/firmware/src/main.rs.jinja"),
    ),
];

/// What turns a robot's file into constants.
const BUILD: &str = include_str!("../../../templates/robot/firmware/build.rs");

/// What the templates have places for.
#[derive(Serialize)]
struct Values<'a> {
    name: &'a str,
    r#type: &'a str,
    board: &'a str,
    has_firmware: bool,
    is_emulated: bool,
    has_pins: bool,
    /// As a word of a command line.
    framework: String,
    /// As a word of a command line.
    folder: String,
    /// As a word of a command line.
    firmware: String,
    /// As a value of TOML.
    esm_path: String,
    /// As a value of TOML, seen from the folder of the firmware.
    robot_file_path: String,
}

/// All files of a robot.
fn robot_files(
    name: &Name,
    board: &Board,
    place: &Place,
    framework: &Framework,
) -> Result<Vec<NewFile>, CommandError> {
    let at = |path: &str| format!("{}/{path}", place.framework);
    let toml = |path: &str| value(path).to_string().trim().to_owned();
    let from_firmware = match Path::new(&place.framework).is_absolute() {
        true => at("robot-file"),
        false => format!("../{}", at("robot-file")),
    };
    let values = Values {
        name: &name.snake,
        r#type: &name.camel,
        board: board.name,
        has_firmware: board.firmware.is_some(),
        is_emulated: board
            .firmware
            .is_some_and(|firmware| firmware.is_emulated()),
        has_pins: framework.robot_file.is_some(),
        framework: quoted(&place.framework),
        folder: quoted(&place.folder),
        firmware: quoted(&at(&format!(
            "target/firmware/{}/{}.elf",
            board.name, name.snake
        ))),
        esm_path: toml(&at("esm")),
        robot_file_path: toml(&from_firmware),
    };
    let host = format!("src/bin/{}.rs", name.snake);
    let mut new = Vec::new();
    for (path, template) in TEMPLATES.into_iter().chain([(host.as_str(), HOST)]) {
        new.push(NewFile::of_template(path, template, &values)?);
    }
    if let Some(config) = &framework.cargo_config {
        for (path, template) in FIRMWARE {
            new.push(NewFile::of_template(path, template, &values)?);
        }
        new.push(NewFile::new("firmware/.cargo/config.toml", config.as_str()));
    }
    if let Some(text) = &framework.robot_file {
        new.push(NewFile::new("firmware/build.rs", BUILD));
        new.push(NewFile::new("robot.toml", robot_file(text, name)?));
    }
    let paths = ["Cargo.lock", "firmware/Cargo.lock"];
    for (path, lock) in paths.into_iter().zip(&framework.locks) {
        if let Some(lock) = lock {
            let rename = Rename {
                from: framework.example,
                to: &name.snake,
            };
            new.push(NewFile::new(path, locks::renamed(lock, rename)));
        }
    }
    Ok(new)
}

/// The robot's file that its board begins with, with its name.
fn robot_file(text: &str, name: &Name) -> Result<String, CommandError> {
    let mut file: DocumentMut = text
        .parse()
        .map_err(|error| CommandError::Input(anyhow!("{ROBOT_FILE} of the board: {error}")))?;
    let named = file.get_mut("name").and_then(|item| item.as_value_mut());
    let named = named.ok_or_else(|| {
        CommandError::Input(anyhow!("{ROBOT_FILE} of the board has no `name = \"…\"`"))
    })?;
    // What stands behind it stays: a comment says what the name is for.
    let decor = named.decor().clone();
    *named = name.snake.as_str().into();
    *named.decor_mut() = decor;
    Ok(file.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The framework, seen from here.
    const CHECKOUT: &str = "..";

    /// A robot that stands in the examples.
    fn example(name: &str, board: &str) -> Vec<NewFile> {
        let board = boards::find(board).unwrap();
        let place = Place {
            framework: "../..".to_owned(),
            folder: format!("examples/{name}"),
        };
        let framework = Framework::read(Path::new(CHECKOUT), board).unwrap();
        robot_files(&Name::new(name).unwrap(), board, &place, &framework).unwrap()
    }

    /// The book explains the examples, so it explains what the command writes.
    #[test]
    fn the_examples_are_what_the_command_writes() {
        let is_blessed = std::env::var_os("ESM_BLESS").is_some();
        for (name, board) in [("my_robot", boards::DEFAULT), ("my_pico", "pico")] {
            for file in example(name, board) {
                let path = Path::new(CHECKOUT)
                    .join("examples")
                    .join(name)
                    .join(&file.path);
                if is_blessed {
                    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
                    std::fs::write(&path, &file.text).unwrap();
                }
                let kept = std::fs::read_to_string(&path).unwrap_or_default();
                assert_eq!(
                    kept,
                    file.text,
                    "{}: change the template, and then `ESM_BLESS=1 cargo test -p host-tools --lib the_examples_are`",
                    path.display()
                );
            }
        }
    }

    #[test]
    fn each_board_gets_what_it_needs_and_nothing_of_another() {
        for board in boards::all() {
            let framework = Framework::read(Path::new(CHECKOUT), board).unwrap();
            let place = Place {
                framework: "/home/me/my esm".to_owned(),
                folder: "/home/me/rob".to_owned(),
            };
            let name = Name::new("rob").unwrap();
            let files = robot_files(&name, board, &place, &framework).unwrap();
            let text = |path: &str| {
                let mut found = files.iter().filter(|file| file.path == Path::new(path));
                found.next().map(|file| file.text.as_str())
            };
            for file in &files {
                assert!(!file.text.contains("my_robot"), "{}", file.path.display());
                assert!(!file.text.contains("my_pico"), "{}", file.path.display());
                for other in
                    boards::all().filter(|other| *other != board && **other != boards::HOST)
                {
                    let is_source = file.path.extension().is_some_and(|it| it == "rs");
                    // The name of one begins with that of another.
                    let is_inside = |letter: char| letter.is_alphanumeric() || letter == '_';
                    let mut words = file.text.split(|letter| !is_inside(letter));
                    assert!(
                        !is_source || words.all(|word| word != other.name),
                        "{}",
                        file.path.display()
                    );
                }
            }
            assert_eq!(
                text("firmware/src/main.rs").is_some(),
                board.firmware.is_some()
            );
            let has_pins = robot_file::has_pins(board.name);
            assert_eq!(text("robot.toml").is_some(), has_pins);
            if let Some(file) = text("robot.toml") {
                let robot = robot_file::check(Path::new("robot.toml"), file).unwrap();
                assert_eq!((robot.name(), robot.board()), ("rob", board.name));
            }
            let manifest = text("Cargo.toml").unwrap();
            assert!(
                manifest.contains("path = \"/home/me/my esm/esm\""),
                "{manifest}"
            );
            let readme = text("README.md").unwrap();
            let builds = "(cd '/home/me/my esm' && cargo xtask firmware --robot /home/me/rob)";
            assert_eq!(
                readme.contains(builds),
                board.firmware.is_some(),
                "{readme}"
            );
        }
    }
}
