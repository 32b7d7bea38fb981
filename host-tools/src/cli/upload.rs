//! `esm upload`: a new mission for a robot that is on.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::anyhow;
use clap::Args;
use rt_firmware::link::message::{Capacities, LinkError};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::robot::{Robot, RobotArgs};
use super::stage;
use crate::inspect::refusal::Explained;
use crate::link_client::RobotInfo;
use crate::run::mission::Mission;
use crate::schedule::handover::{Handover, SlotTable};

/// Gives a robot that is on a new mission
///
/// Compiles FILE if it is a source, checks it against what the robot says of itself, uploads it while the old mission runs, and
/// lets the robot switch between two macro steps. A robot that refuses the blob says why and drives on with what it has.
///
/// Slots that the running mission has, too, keep their start, so that they go on without a gap. Where that is impossible, as few move as need
/// to; which, and the one longer gap of each, is said before anything is sent. The starts in a blob are what they are.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm upload missions/patrol.esm --port /dev/ttyUSB0
  esm upload patrol.blob --port tcp:robot.local:4000
  esm upload missions/patrol.esm --port /dev/ttyUSB0 --no-gap --json")]
pub struct UploadArgs {
    /// The mission, or a blob that `esm build` made of it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Sends nothing where a slot that both missions have cannot go on as it runs
    #[arg(long)]
    pub no_gap: bool,

    /// For programs: what was sent, and what becomes of the slots that both missions have
    #[arg(long)]
    pub json: bool,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// What was done, in the form of its JSON.
#[derive(Serialize)]
struct Uploaded {
    /// The mission's file.
    file: String,
    /// Hash of its blob, in hex.
    hash: String,
    /// Size of its blob.
    bytes: usize,
    /// Time that the upload took, in seconds.
    upload_s: f64,
    #[serde(flatten)]
    handover: Handover,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &UploadArgs, console: &mut Console) -> Result<(), CommandError> {
    let mut staged = stage::mission(&args.file, console)?;
    let (mut robot, info) = args.robot.connect()?;
    let handover = match running_slots(&mut robot)? {
        Some(running) => staged.follow(&running, args.no_gap, console)?,
        None => Handover::default(),
    };
    let mission = &staged.mission;
    check_room(mission, &info)?;
    let bar = console.progress(
        &format!("uploading {}", mission.name),
        mission.blob.len() as u64,
    );
    let started = Instant::now();
    let uploaded = robot.upload(&mission.blob, &mut |bytes| bar.set_position(bytes as u64));
    bar.finish_and_clear();
    match uploaded {
        Ok(_) => {
            let upload_s = started.elapsed().as_secs_f64();
            if args.json {
                return console.json_line(&Uploaded {
                    file: mission.file.display().to_string(),
                    hash: mission.hash_text(),
                    bytes: mission.blob.len(),
                    upload_s,
                    handover,
                });
            }
            writeln!(
                console.out(),
                "{} ({}) runs: {} bytes in {upload_s:.2} s",
                mission.file.display(),
                mission.hash_text(),
                mission.blob.len()
            )?;
            Ok(())
        }
        Err(error) => Err(match error.refusal() {
            Some(refusal) => CommandError::Input(anyhow!(
                "the robot refused {}: {}; it goes on with what it had",
                mission.file.display(),
                mission.refusal(refusal)
            )),
            None => error.into(),
        }),
    }
}

/// The slots of the mission that runs on the robot, if one does.
fn running_slots(robot: &mut Robot) -> Result<Option<SlotTable>, CommandError> {
    let blob = match robot.running_blob() {
        Ok(blob) => blob,
        Err(error) if error.refusal() == Some(LinkError::NoMission) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let verified = esm_core::verify(blob).map_err(|(_, refusal)| {
        CommandError::World(anyhow!(
            "the robot's running mission cannot be read: {}",
            Explained(refusal)
        ))
    })?;
    Ok(Some(SlotTable::of(&verified.tables())))
}

/// Compares the mission with what the robot says of itself, before anything is sent.
fn check_room(mission: &Mission, info: &RobotInfo) -> Result<(), CommandError> {
    let Capacities {
        blob_bytes,
        arena_words,
        task_instances,
        ..
    } = info.capacities;
    let needs = [
        ("bytes", mission.blob.len(), blob_bytes),
        (
            "words of memory for its state",
            mission.arena_words,
            arena_words,
        ),
        (
            "task states",
            mission.directory.task_states().len(),
            u32::from(task_instances),
        ),
    ];
    for (what, needed, available) in needs {
        if needed > available as usize {
            return Err(CommandError::Input(anyhow!(
                "{} needs {needed} {what}, the robot ({} on {}) has room for {available}; nothing was sent",
                mission.file.display(),
                info.firmware,
                info.board
            )));
        }
    }
    Ok(())
}
