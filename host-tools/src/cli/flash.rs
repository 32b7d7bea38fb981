//! `esm flash`: a firmware onto a real board.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use clap::{Args, ValueEnum};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::ports::RobotReport;
use crate::boards::{self, Board, Firmware, Flashing};
use crate::files::MAX_FIRMWARE_BYTES;
use crate::flashing::drive::{self, Copied, DriveError, Places};
use crate::flashing::programs::{Program, ProgramError};
use crate::flashing::uf2::Image;
use crate::ports::{self, Asked, Behind, Question};
use crate::qemu::firmware::{self, FirmwareError};
use crate::run::interrupt::Interrupt;
use crate::serial;

/// How long a person has to bring the boot drive.
const DRIVE_WAIT: Duration = Duration::from_secs(30);

/// How long a robot may take to answer for the first time with its new firmware.
const ROBOT_WAIT: Duration = Duration::from_secs(10);

/// How often it is asked meanwhile.
const ASK_INTERVAL: Duration = Duration::from_millis(300);

/// Puts a firmware onto a board, and asks the robot who it is
///
/// Takes the first way that is there: the board's boot drive, `probe-rs` with a debug probe, or
/// `picotool`. The boot drive appears where the board's button, BOOTSEL on a Pico, is held while it
/// is plugged in. Missions that the robot keeps in its flash stay.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  cargo xtask firmware --board pico
  esm flash --board pico --wait
  esm flash --board pico --method probe-rs my_robot.elf
  esm flash --board pico --uf2 rover.uf2                 # only writes the file")]
pub struct FlashArgs {
    /// The firmware, an ELF file [default: what `cargo xtask firmware --board BOARD` builds]
    #[arg(value_name = "FILE")]
    pub file: Option<PathBuf>,

    /// The board
    #[arg(long, value_name = "BOARD", default_value = boards::DEFAULT)]
    pub board: String,

    /// How the firmware gets there [default: the first that is there]
    #[arg(long, value_name = "METHOD")]
    pub method: Option<Method>,

    /// Waits for the boot drive for 30 s; without it that is done only on a terminal
    #[arg(long)]
    pub wait: bool,

    /// Writes the firmware as a UF2 file to OUT, and does nothing else
    #[arg(long, value_name = "OUT", conflicts_with_all = ["method", "wait"])]
    pub uf2: Option<PathBuf>,

    /// Bits per second on the robot's line, when it is asked who it is
    #[arg(long, value_name = "RATE", default_value_t = serial::DEFAULT_BAUD, value_parser = clap::value_parser!(u32).range(300..))]
    pub baud: u32,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// How a firmware gets onto a board, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The drive as which its boot loader shows itself
    Drive,
    /// `probe-rs`, with a debug probe
    ProbeRs,
    /// `picotool`, over USB
    Picotool,
}

/// What was done, in the form of its JSON.
#[derive(Debug, Serialize)]
struct FlashReport {
    board: &'static str,
    firmware: String,
    /// Bytes of the UF2 file.
    uf2_bytes: usize,
    /// `null` where only a file was written.
    method: Option<Method>,
    /// The port of the robot that answered behind it, if one did.
    port: Option<String>,
    robot: Option<RobotReport>,
}

/// A way that is there.
enum Way {
    Drive(PathBuf),
    ProbeRs(Program),
    Picotool(Program),
}

impl Way {
    fn method(&self) -> Method {
        match self {
            Way::Drive(_) => Method::Drive,
            Way::ProbeRs(_) => Method::ProbeRs,
            Way::Picotool(_) => Method::Picotool,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &FlashArgs, console: &mut Console) -> Result<(), CommandError> {
    let board = boards::find(&args.board).map_err(|unknown| CommandError::Usage(unknown.into()))?;
    let (Some(parts), Some(flashing)) = (board.firmware, board.flashing) else {
        return Err(CommandError::Usage(anyhow!(
            "the board {} is {}: there is nothing to flash; `--board` names one that a firmware can be put onto: {}",
            board.name,
            match board.firmware {
                Some(_) => "an emulator's",
                None => "a part of this command",
            },
            boards::flashable()
        )));
    };
    Interrupt::take_over()?;
    let path = find(board, args.file.as_deref(), console)?;
    let image = image(board, parts, &path)?;
    let uf2 = image.to_uf2(flashing.uf2_family);
    let mut report = FlashReport {
        board: board.name,
        firmware: path.display().to_string(),
        uf2_bytes: uf2.len(),
        method: None,
        port: None,
        robot: None,
    };
    if let Some(output) = &args.uf2 {
        file::keep_sources(output, [path.as_path()])?;
        file::write_whole(output, &uf2, "UF2 file")?;
        return tell(&report, args.json, console, |out| {
            let (blocks, output) = (image.blocks(), output.display());
            writeln!(out, "{output}: {blocks} blocks, {} KiB", uf2.len() >> 10)
        });
    }
    let way = choose(args, &flashing, console)?;
    report.method = Some(way.method());
    flash(&way, &path, &uf2, &flashing, console)?;
    let robot = answering(board, args.baud, console)?;
    if let Some(robot) = &robot {
        report.port = Some(robot.listed.port().to_string());
        report.robot = RobotReport::of(&robot.behind);
    }
    tell(&report, args.json, console, |out| match &robot {
        Some(robot) => writeln!(out, "flashed, and it runs: {robot}"),
        None => writeln!(out, "flashed; nobody knows yet whether it runs"),
    })
}

fn tell(
    report: &FlashReport,
    json: bool,
    console: &mut Console,
    words: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), CommandError> {
    if json {
        return console.json_line(report);
    }
    words(console.out())?;
    Ok(())
}

/// The firmware that was named, or that of the checkout, which is built if need be.
fn find(
    board: &'static Board,
    named: Option<&Path>,
    console: &mut Console,
) -> Result<PathBuf, CommandError> {
    let here = std::env::current_dir()?;
    let found = firmware::find(board, named, &here, |told| console.note(told));
    found.map_err(|error| match error {
        FirmwareError::NoCheckout { board, builder } => CommandError::World(anyhow!(
            "no firmware for the board {board}: name its ELF file, or run esm inside a checkout, where `{builder}` builds it"
        )),
        error => error.into(),
    })
}

/// What goes into the board's flash.
fn image(board: &'static Board, parts: Firmware, path: &Path) -> Result<Image, CommandError> {
    firmware::check(board, path)?;
    let bytes = file::read(path, MAX_FIRMWARE_BYTES, "firmware")?;
    Image::of_elf(&bytes, parts.flash)
        .with_context(|| {
            let (path, board) = (path.display(), board.name);
            format!("{path} is no firmware for the board {board}")
        })
        .map_err(CommandError::Input)
}

/// The way that was asked for, or else the first that is there.
fn choose(args: &FlashArgs, board: &Flashing, console: &mut Console) -> Result<Way, CommandError> {
    let places = Places::of_environment();
    let is_wanted = |method| args.method.is_none_or(|wanted| wanted == method);
    if is_wanted(Method::Drive)
        && let Some(drive) = places.find(board)?
    {
        return Ok(Way::Drive(drive));
    }
    for (method, name, how, way) in [
        (
            Method::ProbeRs,
            "probe-rs",
            "`cargo install --locked probe-rs-tools` installs it",
            Way::ProbeRs as fn(Program) -> Way,
        ),
        (
            Method::Picotool,
            "picotool",
            "it is at https://github.com/raspberrypi/picotool",
            Way::Picotool,
        ),
    ] {
        if !is_wanted(method) {
            continue;
        }
        match Program::find(name) {
            Some(program) => return Ok(way(program)),
            None if args.method.is_some() => {
                return Err(ProgramError::Missing { program: name, how }.into());
            }
            None => {}
        }
    }
    let wait = if args.wait || console.has_person() {
        console.note(&format!(
            "hold {} on the board and plug it in by USB: its drive is waited for, {} s at most …",
            board.boot_button,
            DRIVE_WAIT.as_secs()
        ));
        DRIVE_WAIT
    } else {
        Duration::ZERO
    };
    Ok(Way::Drive(places.await_drive(board, wait)?))
}

/// Brings the firmware onto the board, and lets it start.
fn flash(
    way: &Way,
    path: &Path,
    uf2: &[u8],
    board: &Flashing,
    console: &mut Console,
) -> Result<(), CommandError> {
    match way {
        Way::Drive(folder) => {
            console.note(&format!("copying to the boot drive {} …", folder.display()));
            if drive::copy(uf2, folder, board)? == Copied::Unconfirmed {
                console.note(
                    "the board restarted before the system had confirmed all of the copy: should the robot not answer, flash it again",
                );
            }
        }
        Way::ProbeRs(program) => {
            console.note("writing with probe-rs and a debug probe …");
            let chip = ["--chip", board.probe_rs_chip];
            let spinner = console.spinner("probe-rs");
            let done = program
                .run(&[&["download"], &chip[..]].concat(), Some(path))
                .and_then(|()| program.run(&[&["reset"], &chip[..]].concat(), None));
            spinner.finish_and_clear();
            done.map_err(with_other_ways)?;
        }
        Way::Picotool(program) => {
            console.note("writing with picotool …");
            // It tells formats by the endings of names.
            let file = tempfile::Builder::new().suffix(".uf2").tempfile()?;
            std::fs::write(file.path(), uf2)?;
            let spinner = console.spinner("picotool");
            let done = program.run(&["load", "-x"], Some(file.path()));
            spinner.finish_and_clear();
            done.map_err(with_other_ways)?;
        }
    }
    Ok(())
}

/// What failed may have been chosen only since it was there.
fn with_other_ways(error: ProgramError) -> CommandError {
    match error {
        ProgramError::Failed { .. } => CommandError::World(anyhow!(
            "{error}\n`--method drive`, `probe-rs` or `picotool` names another way"
        )),
        error => error.into(),
    }
}

/// The robot that answers with its new firmware, if it is clear which one that is. Otherwise it is
/// told why not.
fn answering(
    board: &Board,
    baud: u32,
    console: &mut Console,
) -> Result<Option<Asked>, CommandError> {
    let spinner = console.spinner("waiting for the robot");
    let begun = Instant::now();
    let robots = loop {
        let listed = ports::listed().map_err(ports::FindError::List)?;
        let asked = ports::ask_all(listed, baud, Question::Who);
        let mut robots = asked.map_err(|_| {
            CommandError::World(anyhow!(
                "interrupted; the board is flashed, and whether it runs is not known"
            ))
        })?;
        robots.retain(|port| matches!(port.behind, Behind::Robot { .. }));
        let is_it = |port: &Asked| match &port.behind {
            Behind::Robot { info, .. } => info.board == board.name,
            _ => false,
        };
        if robots.iter().filter(|port| is_it(port)).count() == 1 {
            spinner.finish_and_clear();
            return Ok(robots.into_iter().find(is_it));
        }
        if begun.elapsed() >= ROBOT_WAIT {
            break robots;
        }
        thread::sleep(ASK_INTERVAL);
    };
    spinner.finish_and_clear();
    let within = ROBOT_WAIT.as_secs();
    console.note(&match robots.as_slice() {
        [] => format!(
            "no robot answered at any port within {within} s: is its line plugged in? `esm ports` asks again"
        ),
        [other] => format!(
            "the only robot that answered within {within} s is another one than the board {}: {other}",
            board.name
        ),
        several => several.iter().fold(
            "several robots answer, and which one was flashed is not known:".to_owned(),
            |told, port| told + &format!("\n  {port}"),
        ),
    });
    Ok(None)
}

impl From<DriveError> for CommandError {
    fn from(error: DriveError) -> Self {
        CommandError::World(error.into())
    }
}

impl From<ProgramError> for CommandError {
    fn from(error: ProgramError) -> Self {
        CommandError::World(error.into())
    }
}
