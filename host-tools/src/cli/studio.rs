//! `esm studio`: the page in which missions are written, seen and run.

mod live;
mod server;
mod site;

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;
use serde_json::json;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::{file, mission};
use crate::lang::MAX_FILE_BYTES;
use crate::language_server::Workspace;
use crate::run::interrupt::Interrupt;
use esm_client::sources::Disk;
use live::Live;
use server::Listener;
use site::{Opened, Site, paths_in_page};

/// Files of a folder that are looked at.
const MOST_FILES: usize = 10_000;

/// Opens the studio: writes, draws, runs and explains missions in a page of the browser
///
/// The page is a part of this command and needs nothing else: no network, no installation. It runs
/// the same code as `esm run --board host`, and its traces are the same. Only this computer can
/// reach it, and only with the address that is printed. Ctrl-C ends it; what was written in the
/// page stays in the browser. With a port the page shows what the robot there does, while it does
/// it; the robot does nothing else for that.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm studio                               with the missions that ship
  esm studio missions/patrol.esm           with a mission, and all that it uses
  esm studio my_robot/                     with all missions and worlds of a folder
  esm studio --port /dev/ttyUSB0           shows what the robot at a port does, and why
  esm studio --write site/                 the files of the page, for any static web server")]
pub struct StudioArgs {
    /// A mission, or a folder of missions and worlds, to open in it
    #[arg(value_name = "FILE|DIR")]
    pub path: Option<PathBuf>,

    /// The port of this computer at which the page is; any that is free, for 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port_number: u16,

    /// Does not open the browser
    #[arg(long)]
    pub no_open: bool,

    /// Writes the files of the page into this folder instead, for a static web server
    #[arg(long, value_name = "DIR", conflicts_with_all = ["port_number", "no_open", "port"])]
    pub write: Option<PathBuf>,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// The firmware of a robot that is connected, whose file holds the texts of its log: then the
    /// log is shown, too
    #[arg(long, value_name = "ELF", env = "ESM_FIRMWARE")]
    pub firmware: Option<PathBuf>,

    /// Prints the address as a JSON object, for programs, and does not open the browser
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// If what is to be opened cannot be read, or the port is taken.
pub fn execute(args: &StudioArgs, console: &mut Console) -> Result<(), CommandError> {
    let opened = match &args.path {
        Some(path) if path.is_dir() => of_folder(path)?,
        Some(path) => of_file(path)?,
        None => Opened::default(),
    };
    let is_live = args.robot.port.is_some();
    let site = Site::with(&opened, is_live).map_err(|error| CommandError::World(error.into()))?;
    if let Some(folder) = &args.write {
        return write(&site, folder, args.json, console);
    }
    let interrupt = Interrupt::take_over()?;
    let listener = Listener::bind(args.port_number)
        .with_context(|| {
            let port = args.port_number;
            format!("cannot listen at port {port}: name another with --port-number, or none")
        })
        .map_err(CommandError::World)?;
    let live = match is_live {
        true => Some(Live::connect(
            &args.robot,
            args.firmware.as_deref(),
            console,
        )?),
        false => None,
    };
    let address = listener.address();
    if args.json {
        console.json_line(&json!({ "address": address }))?;
    } else {
        writeln!(
            console.out(),
            "the studio is at {address}\nCtrl-C ends it; what was written in the page stays in the browser"
        )?;
    }
    console.flush()?;
    if !args.no_open
        && !args.json
        && let Err(error) = open::that_detached(&address)
    {
        console.note(&format!(
            "no browser could be started ({error}): open the address in one"
        ));
    }
    let is_requested = || interrupt.is_requested();
    match live {
        None => Ok(listener.serve(&site, None, is_requested)?),
        Some(live) => live.follow(&listener, &site, is_requested),
    }
}

/// A mission, with all that it uses.
fn of_file(path: &Path) -> Result<Opened, CommandError> {
    let checked = mission::read(path)?;
    let mut places = Vec::new();
    for file in &checked.files {
        places.push(place_of(Path::new(&file.path))?);
    }
    let paths = paths_in_page(&places);
    Ok(Opened {
        first: paths.first().cloned(),
        files: (paths.into_iter())
            .zip(checked.files.iter().map(|file| file.text.clone()))
            .collect(),
    })
}

/// All missions and worlds of a folder.
fn of_folder(folder: &Path) -> Result<Opened, CommandError> {
    let folder = place_of(folder)?;
    let (mut places, _) = Disk.sources(&BTreeSet::from([folder.clone()]), MOST_FILES);
    for folder in [folder.clone(), folder.join("worlds")] {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let found = entries.map(|entry| entry.path());
        let mut worlds: Vec<PathBuf> = found
            .filter(|path| path.extension().is_some_and(|it| it == "world"))
            .collect();
        worlds.sort();
        places.extend(worlds);
    }
    if places.is_empty() {
        return Err(CommandError::Input(anyhow!(
            "there is neither a mission nor a world in {}: name a folder with .esm files",
            folder.display()
        )));
    }
    let paths = paths_in_page(&places);
    let mut opened = Opened {
        first: paths.iter().find(|path| path.ends_with(".esm")).cloned(),
        ..Opened::default()
    };
    for (place, path) in places.iter().zip(paths) {
        let bytes = file::read(place, MAX_FILE_BYTES, "file")?;
        // What is no text is shown as far as it is.
        opened
            .files
            .insert(path, String::from_utf8_lossy(&bytes).into_owned());
    }
    Ok(opened)
}

fn place_of(path: &Path) -> Result<PathBuf, CommandError> {
    fs::canonicalize(path)
        .with_context(|| format!("cannot open {}", path.display()))
        .map_err(CommandError::Input)
}

fn write(
    site: &Site,
    folder: &Path,
    for_program: bool,
    console: &mut Console,
) -> Result<(), CommandError> {
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the directory {}", folder.display()))
        .map_err(CommandError::World)?;
    let mut names = Vec::new();
    for (name, _, bytes) in site.files() {
        file::write_whole(&folder.join(name), bytes, "page")?;
        names.push(name);
    }
    if for_program {
        return console.json_line(&json!({ "folder": folder, "files": names }));
    }
    console.note(&format!(
        "the page is in {}: a static web server can serve it",
        folder.display()
    ));
    Ok(())
}
