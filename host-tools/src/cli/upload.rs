//! `esm upload`: a new mission for a robot that is on.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::anyhow;
use clap::Args;
use rt_firmware::link::message::Capacities;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::stage;
use crate::link_client::RobotInfo;
use crate::run::mission::Mission;

/// Gives a robot that is on a new mission
///
/// Compiles FILE if it is a source, checks it against what the robot says of itself, uploads it while the old mission runs, and
/// lets the robot switch between two macro steps. A robot that refuses the blob says why and drives on with what it has.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm upload missions/patrol.esm --port /dev/ttyUSB0
  esm upload patrol.blob --port tcp:robot.local:4000")]
pub struct UploadArgs {
    /// The mission, or a blob that `esm build` made of it
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &UploadArgs, console: &mut Console) -> Result<(), CommandError> {
    let mission = stage::mission(&args.file, console)?;
    let (mut robot, info) = args.robot.connect()?;
    check_room(&mission, &info)?;
    let bar = console.progress(
        &format!("uploading {}", mission.name),
        mission.blob.len() as u64,
    );
    let started = Instant::now();
    let uploaded = robot.upload(&mission.blob, &mut |bytes| bar.set_position(bytes as u64));
    bar.finish_and_clear();
    match uploaded {
        Ok(_) => {
            let seconds = started.elapsed().as_secs_f64();
            writeln!(
                console.out(),
                "{} ({}) runs: {} bytes in {seconds:.2} s",
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
