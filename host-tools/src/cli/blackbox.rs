//! `esm blackbox`: what happened last on a robot.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use esm_link::black_box::{Event, Record};
use esm_link::features::Feature;
use esm_link::message::LinkError;

use super::console::Console;
use super::exit::CommandError;
use super::robot::{Robot, RobotArgs};
use super::{stage, tasks};
use crate::behaviour_words::TaskNames;
use crate::black_box::entries;
use crate::link_client::ClientError;
use crate::run::mission::{Mission, hash_text};
use crate::trace::directory::Directory;

/// Shows what happened last on a robot, from a recorder that survives a reset: states, faults,
/// overruns, missions, resets
///
/// The newest comes last. Times are in seconds of robot time, which begins anew with each start of
/// the robot. States have their names where the mission is the one that runs, or is given.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm blackbox --port /dev/ttyUSB0
  esm blackbox --port /dev/ttyUSB0 --mission missions/patrol.esm
  esm blackbox --port /dev/ttyUSB0 --json | jq 'select(.what == \"ended\")'")]
pub struct BlackBoxArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// A mission that ran, for the names of its states; may be given several times
    #[arg(long, value_name = "FILE")]
    pub mission: Vec<PathBuf>,

    /// One JSON object a record and line, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &BlackBoxArgs, console: &mut Console) -> Result<(), CommandError> {
    let mut missions = BTreeMap::new();
    let mut given = Vec::new();
    for file in &args.mission {
        let mission = stage::mission(file, console)?.mission;
        given.push((file, mission.hash));
        missions.insert(mission.hash, mission.directory);
    }
    let (mut robot, info) = args.robot.connect(console)?;
    robot.require(Feature::BlackBox)?;
    let records = robot.black_box()?;
    let is_wanted = |hash: u32| {
        let is_its_start =
            |event: Event| matches!(event, Event::Mission { hash: started } if started == hash);
        records.iter().any(|record| is_its_start(record.event))
    };
    let running = robot.status()?.mission;
    if let Some(hash) = running.filter(|hash| is_wanted(*hash) && !missions.contains_key(hash))
        && let Some(directory) = names_of_running(&mut robot, hash)?
    {
        missions.insert(hash, directory);
    }
    if !args.json && !records.is_empty() {
        console.note("times are robot time, from the first macro step after each start");
    }
    let tasks = if records
        .iter()
        .any(|record| record.event.is_about_behaviours())
    {
        tasks::names(&mut robot, &info, console)?
    } else {
        TaskNames::new()
    };
    for entry in entries(&records, &missions, &tasks) {
        if args.json {
            console.json_line(&entry)?;
        } else {
            writeln!(console.out(), "{entry}")?;
        }
    }
    if records.is_empty() {
        console.note("the robot has written nothing down");
    }
    for told in unnamed(&records, &missions) {
        console.note(&told);
    }
    for (file, hash) in given.into_iter().filter(|(_, hash)| !is_wanted(*hash)) {
        console.note(&format!(
            "{} is mission {} as it is now, and of that nothing is written down",
            file.display(),
            hash_text(hash)
        ));
    }
    Ok(())
}

/// What is said of records that are told by numbers, for want of the mission that they are of.
fn unnamed(records: &[Record], missions: &BTreeMap<u32, Arc<Directory>>) -> Vec<String> {
    let mut missing: Vec<Option<u32>> = Vec::new();
    let mut running = None;
    for record in records {
        match record.event {
            Event::Mission { hash } => running = Some(hash),
            Event::Started(_) => running = None,
            Event::Transition { .. } | Event::Overrun { .. } => {
                let is_known = running.is_some_and(|hash| missions.contains_key(&hash));
                if !is_known && !missing.contains(&running) {
                    missing.push(running);
                }
            }
            _ => {}
        }
    }
    let told = missing.into_iter().map(|mission| match mission {
        Some(hash) => format!(
            "mission {} is not on the robot any more, so that its states are told by numbers: `--mission FILE` takes its source as it was, or its blob",
            hash_text(hash)
        ),
        None => "what is told by numbers before the first start of a mission is of one whose start is not written down any more".to_owned(),
    });
    told.collect()
}

/// The names of the mission that runs; none where it has none, or is another one by now.
fn names_of_running(robot: &mut Robot, hash: u32) -> Result<Option<Arc<Directory>>, CommandError> {
    let blob = match robot.running_blob() {
        Ok(blob) => blob,
        Err(ClientError::Refused {
            error: LinkError::NoMission,
            ..
        }) => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let mission = esm_core::verify(blob)
        .ok()
        .filter(|verified| verified.hash() == hash)
        .and_then(|verified| Mission::new(Path::new("running"), verified).ok());
    Ok(mission.map(|mission| mission.directory))
}
