//! A recording of a robot that a command makes while it does something else.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::anyhow;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::robot::{Robot, has_lost_robot};
use crate::link_client::{ClientError, RobotInfo, StreamEvent, Streams};
use crate::recording::live::{LiveError, LiveRecording, Noted};
use crate::run::mission::{Mission, hash_text};

/// A recording in a file.
pub struct Recorder {
    path: PathBuf,
    recording: LiveRecording<BufWriter<File>>,
    /// Why it has ended, while the command goes on.
    broken: Option<CommandError>,
}

impl Recorder {
    /// Begins a recording with all that the robot's machine is now. Missions that are `known` need
    /// not be read from the robot.
    ///
    /// # Errors
    /// What is wrong with the robot, its line or the file.
    pub fn begin(
        path: &Path,
        robot: &mut Robot,
        info: &RobotInfo,
        streams: Streams,
        known: &[&Mission],
    ) -> Result<Self, CommandError> {
        let create = || file::create(path, "recording").map_err(Begun::Not);
        let begun = LiveRecording::begin(robot, info, streams, known, create);
        let recording = begun.map_err(|error| {
            let error = match error {
                Begun::Not(error) => error,
                Begun::Live(error @ LiveError::Client(_)) => return failed(error, path),
                Begun::Live(error) => failed(error, path),
            };
            // It need not speak to nobody.
            let _ = robot.subscribe(Streams::NONE);
            error
        })?;
        Ok(Recorder {
            path: path.to_owned(),
            recording,
            broken: None,
        })
    }

    /// Keeps values on the nets, too, in samples that are so far apart at least.
    pub fn keep_values(&mut self, period: Duration) {
        self.recording.keep_values(period);
    }

    /// Takes an event of the robot's streams, and says what is missing.
    ///
    /// # Errors
    /// What is wrong with the robot, its line or the file.
    pub fn take(
        &mut self,
        robot: &mut Robot,
        event: &StreamEvent,
        console: &mut Console,
    ) -> Result<(), CommandError> {
        let noted = self.recording.take(robot, event);
        tell(noted.map_err(|error| failed(error, &self.path))?, console);
        Ok(())
    }

    /// Asks for what is missing, and for values. To be called each time that events were looked
    /// for.
    ///
    /// # Errors
    /// What is wrong with the robot, its line or the file.
    pub fn look_after(
        &mut self,
        robot: &mut Robot,
        console: &mut Console,
    ) -> Result<(), CommandError> {
        let looked = (self.recording.look_after(robot))
            .and_then(|()| self.recording.look_after_values(robot));
        tell(looked.map_err(|error| failed(error, &self.path))?, console);
        Ok(())
    }

    /// Takes all that came, and asks for what is missing, while something else matters more: if the
    /// recording cannot go on, that is said, and told at the end.
    ///
    /// # Errors
    /// What is wrong with the robot or its line.
    pub fn keep_up(&mut self, robot: &mut Robot, console: &mut Console) -> Result<(), ClientError> {
        if self.broken.is_some() {
            robot.take_events();
            return Ok(());
        }
        let kept = (robot.take_events().iter())
            .try_for_each(|event| {
                let noted = self.recording.take(robot, event)?;
                tell(noted, console);
                Ok(())
            })
            .and_then(|()| self.recording.look_after(robot));
        self.unless_broken(kept, console)
    }

    /// Takes a mission that the robot is about to be given, and waits until all is there that was
    /// asked for, so that its beginning follows from that. As [`Recorder::keep_up`].
    ///
    /// # Errors
    /// What is wrong with the robot or its line.
    pub fn expect(
        &mut self,
        mission: &Mission,
        robot: &mut Robot,
        console: &mut Console,
    ) -> Result<(), ClientError> {
        self.keep_up(robot, console)?;
        if self.broken.is_some() {
            return Ok(());
        }
        let settled = self.recording.mission(mission);
        let settled = settled.and_then(|()| self.recording.settle(robot));
        self.unless_broken(settled, console)
    }

    fn unless_broken(
        &mut self,
        kept: Result<(), LiveError>,
        console: &mut Console,
    ) -> Result<(), ClientError> {
        let Err(error) = kept else { return Ok(()) };
        if let LiveError::Client(error) = error {
            return Err(error);
        }
        let error = failed(error, &self.path);
        console.note(&format!("{error}; the rest is done without it"));
        self.broken = Some(error);
        Ok(())
    }

    /// Ends the recording, with what the robot has still to say where all went well, and says what
    /// it holds. What came is in the file, whatever has ended it.
    ///
    /// # Errors
    /// What had ended it before; or what is wrong with the file.
    pub fn finish<T>(
        self,
        robot: &mut Robot,
        ended: Result<T, CommandError>,
        console: &mut Console,
    ) -> Result<T, CommandError> {
        let Recorder {
            path,
            recording,
            broken,
        } = self;
        // What came first counts.
        let ended = ended.and_then(|done| broken.map_or(Ok(done), Err));
        let so_far = recording.counts();
        let written = match &ended {
            // Who has lost the robot need not ask it.
            Err(error) if has_lost_robot(error) => recording
                .break_off(&robot.take_events())
                .map(|(out, counts)| (out, counts, None)),
            _ => recording.finish(robot),
        };
        match written {
            Ok((_, counts, lost)) => {
                let path = path.display();
                console.note(&format!("recorded in {path}: {counts}"));
                if let Some(lost) = lost {
                    console.note(&format!("the last of it may be missing: {lost}"));
                }
                if ended.is_err() && counts.steps > 0 {
                    console.note(&format!("`esm replay {path}` has it again up to there"));
                }
                ended
            }
            Err(error) => {
                console.note(&format!(
                    "{} macro steps came, of which the last are missing in the recording; `esm replay {}` has again those that are there",
                    so_far.steps,
                    path.display()
                ));
                ended.and(Err(failed(LiveError::File(error), &path)))
            }
        }
    }
}

/// Says what is missing in a recording.
fn tell(noted: Option<Noted>, console: &mut Console) {
    match noted {
        Some(Noted::Gap(missing)) => console.note(&format!(
            "the recording has a gap: {missing} records or parts did not come"
        )),
        Some(Noted::DeadlineMiss(hash)) => console.note(&format!(
            "the mission {} ran for too short a time to be read: what it did cannot be replayed",
            hash_text(hash)
        )),
        Some(Noted::NoValues(why)) => console.note(&why),
        None => {}
    }
}

/// Why a recording did not begin.
enum Begun {
    Not(CommandError),
    Live(LiveError),
}

impl From<LiveError> for Begun {
    fn from(error: LiveError) -> Self {
        Begun::Live(error)
    }
}

/// What ended a recording in that file, as the end of the command.
pub(super) fn failed(error: LiveError, path: &Path) -> CommandError {
    match error {
        LiveError::Client(error) => error.into(),
        LiveError::File(cause) => CommandError::World(anyhow!(
            "cannot write the recording {}: {cause}",
            path.display()
        )),
        LiveError::BadMission { .. } | LiveError::NoNames { .. } => {
            CommandError::Input(error.into())
        }
    }
}
