//! The drive of a robot at a port.

use std::fs;
use std::io;
use std::time::Duration;

use anyhow::{Context, anyhow};
use esm_link::message::Mode;

use super::tune_mission::NAME;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::own_drive::ROVER;
use crate::cli::recorder::Recorder;
use crate::cli::robot::{self, Robot, RobotArgs};
use crate::cli::run::read_recording;
use crate::cli::status::mode_words;
use crate::cli::upload::{self, OnTrial, UploadArgs};
use crate::link_client::Streams;
use crate::reading::Reader;
use crate::recording::player::Recording;
use crate::run::interrupt::Interrupt;

/// How long a wait for the robot's next words may last before it is looked whether it is there.
const LISTEN_TIME: Duration = Duration::from_millis(100);
/// How often it is asked whether the drive is over.
const ASK_TIME: Duration = Duration::from_secs(1);
/// Far more than the drive takes.
const LONGEST: Duration = Duration::from_secs(180);

/// Gives the robot the mission, and records what it does until it has finished.
///
/// # Errors
/// What is wrong with the port, the robot, or the drive. The robot is stopped where it is not over.
pub fn drive(
    args: &RobotArgs,
    mission: &str,
    console: &mut Console,
) -> Result<Recording, CommandError> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(NAME);
    let beside = folder.path().join("rover.esm");
    for (path, text) in [(&path, mission), (&beside, ROVER)] {
        fs::write(path, text)
            .with_context(|| format!("cannot write {}", path.display()))
            .map_err(CommandError::World)?;
    }
    // What an upload tells on standard output is not what this command is asked for.
    let mut aside = Console::without_output();
    upload::execute(
        &UploadArgs {
            file: path,
            no_gap: false,
            warm: false,
            diff: false,
            trial: None,
            record: None,
            on_trial: OnTrial::default(),
            json: false,
            robot: args.clone(),
        },
        &mut aside,
    )?;
    let record = folder.path().join("tune.rec");
    let interrupt = Interrupt::take_over()?;
    let (mut robot, info) = args.connect_quietly()?;
    let mode = robot.status()?.mode;
    if mode != Mode::Running {
        return Err(CommandError::Input(anyhow!(
            "the robot does not drive, it is {}: `esm status` says more",
            mode_words(mode).0
        )));
    }
    console.note("the robot drives: Ctrl-C stops it");
    // The drive has its own limit.
    robot.limit_waits(None);
    robot.stop_when(Some(Box::new(move || interrupt.is_requested())));
    let begun = Recorder::begin(&record, &mut robot, &info, Streams::NONE, &[]);
    let driven = begun.and_then(|mut recorder| {
        recorder.keep_values(Duration::ZERO);
        listen(&mut robot, &mut recorder, interrupt, console).map(|()| recorder)
    });
    robot::end_soon(&mut robot);
    match driven {
        Ok(recorder) => {
            // Where it is recorded nobody will look.
            let mut nowhere = Console::onto(io::sink(), io::sink());
            recorder.finish(&mut robot, Ok(()), &mut nowhere)?;
            read_recording(&record)
        }
        Err(error) => {
            // It is to stand, whatever else is the matter.
            robot::hold_out(&mut robot);
            match robot.stop() {
                Ok(()) => console.note("the robot was stopped"),
                Err(error) => console.note(&format!(
                    "the robot could not be stopped ({error}): use its button, or switch it off"
                )),
            }
            if interrupt.is_requested() {
                return Err(CommandError::World(anyhow!(
                    "ended by Ctrl-C before the drive was over"
                )));
            }
            Err(error)
        }
    }
}

/// Listens until the mission has finished.
fn listen(
    robot: &mut Robot,
    recorder: &mut Recorder,
    interrupt: Interrupt,
    console: &mut Console,
) -> Result<(), CommandError> {
    let clock = robot.clock().clone();
    let began = clock.now();
    let mut asked = began;
    let mut reader = Reader::default();
    loop {
        robot.attend(LISTEN_TIME)?;
        if interrupt.is_requested() {
            return Err(CommandError::World(anyhow!("ended by Ctrl-C")));
        }
        for event in robot.take_events() {
            recorder.take(robot, &event, console)?;
        }
        recorder.look_after(robot, console)?;
        if clock.since(began) > LONGEST {
            return Err(CommandError::World(anyhow!(
                "the drive was not over after {} s: do its wheels turn? `esm top` shows what it does",
                LONGEST.as_secs()
            )));
        }
        if clock.since(asked) < ASK_TIME {
            continue;
        }
        asked = clock.now();
        let status = robot.status()?;
        if status.mode != Mode::Running {
            return Err(CommandError::Input(anyhow!(
                "the robot does not drive any more: `esm status` says why"
            )));
        }
        if let Some(hash) = status.mission
            && reader.has_finished(robot, hash)?
        {
            return Ok(());
        }
    }
}
