//! Which missions a bench drives where: from what it is given on the command line to
//! [courses](Course).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};

use crate::bench::{Course, Sent};
use crate::cli::argument::Time;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::{by_hand, file, stage};
use crate::goal::{Goal, GoalFile};
use crate::run::mission::Mission;
use crate::scenario::suite::{self, Case, FolderError};

/// Where missions are looked for when none is named.
const MISSIONS: &str = "missions";

/// What the command line says of goals.
pub struct Asked<'a> {
    /// Missions, goal files, folders of them; none for the folder `missions`.
    pub paths: &'a [PathBuf],
    /// The world, instead of those of goal files.
    pub world: Option<&'a Path>,
    /// The end, instead of those of goal files.
    pub until: Option<Time>,
    /// The goal, instead of those of goal files.
    pub goal: Option<Goal>,
    /// The script, instead of those of goal files.
    pub script: Option<&'a Path>,
}

/// A course before anything of it is read.
struct Planned {
    mission: PathBuf,
    /// Where its goal stands; none where the command line says all of it.
    goal_file: Option<PathBuf>,
}

/// The courses that are asked for, at least one.
///
/// # Errors
/// If there is none, or something of one cannot be read or has errors.
pub fn courses(asked: &Asked<'_>, console: &mut Console) -> Result<Vec<Course>, CommandError> {
    let default = [PathBuf::from(MISSIONS)];
    let paths = match asked.paths {
        [] => default.as_slice(),
        paths => paths,
    };
    let mut planned = Vec::new();
    for path in paths {
        if asked.paths.is_empty() && !path.is_dir() {
            return Err(CommandError::Input(anyhow!(
                "there is no folder `{MISSIONS}` here: name missions, goal files, or a folder of them"
            )));
        }
        planned.extend(asked.planned(path)?);
    }
    // Each mission is compiled once.
    let mut missions: BTreeMap<PathBuf, Mission> = BTreeMap::new();
    let mut courses = Vec::new();
    for Planned { mission, goal_file } in planned {
        let said = goal_file.as_deref().map(read).transpose()?;
        let world_name = match (asked.world, &said) {
            (Some(world), _) => world.to_owned(),
            (None, Some(said)) => PathBuf::from(&said.world),
            (None, None) => PathBuf::from(stage::DEFAULT_WORLD),
        };
        let world = stage::world(Some(&world_name), Some(&mission))?;
        let until = asked.until.or(said.as_ref().map(|said| said.until));
        let until = until.ok_or_else(|| {
            CommandError::Usage(anyhow!(
                "nobody says when a run of {} ends: give it with `--until '60 s'`",
                mission.display()
            ))
        })?;
        if until.us == 0 {
            return Err(CommandError::Usage(anyhow!(
                "a run takes time: give its end, as in `--until '60 s'`"
            )));
        }
        if !missions.contains_key(&mission) {
            let staged = stage::mission(&mission, console)?;
            missions.insert(mission.clone(), staged.mission);
        }
        // As a goal file names it, it stands beside the mission.
        let named = said.as_ref().and_then(|said| said.script.as_deref());
        let script = asked.script.map(Path::to_owned);
        let script = script.or_else(|| named.map(|file| mission.with_file_name(file)));
        let script = (script.map(|file| sent(file, &mission, console))).transpose()?;
        courses.push(Course {
            mission: missions[&mission].clone(),
            world_name: world_name.display().to_string(),
            world,
            until_us: until.us,
            goal: asked.goal.or(said.map(|said| said.goal)),
            script,
        });
    }
    Ok(courses)
}

impl Asked<'_> {
    /// Whether goal files are left aside.
    fn is_told_here(&self) -> bool {
        self.world.is_some() || self.goal.is_some() || self.script.is_some()
    }

    /// What a path stands for.
    fn planned(&self, path: &Path) -> Result<Vec<Planned>, CommandError> {
        let shown = path.display();
        let is_goal_file = path.extension().is_some_and(|ending| ending == suite::GOAL);
        if self.is_told_here() && (path.is_dir() || is_goal_file) {
            return Err(CommandError::Usage(anyhow!(
                "`--world`, `--goal` and `--script` are for missions that are named, and {shown} is none: name one, as in `missions/guard.esm`"
            )));
        }
        if path.is_dir() || is_goal_file {
            let cases = suite::cases(path, suite::GOAL)?;
            if cases.is_empty() && is_goal_file {
                // Reading it says what is wrong.
                read(path)?;
            }
            if cases.is_empty() {
                return Err(CommandError::Input(anyhow!(
                    "{shown} has no goal files: a file `NAME.goal` beside a mission `NAME.esm`, or one in a folder `NAME` beside it"
                )));
            }
            return cases.into_iter().map(of_its_mission).collect();
        }
        // Of one that is not there it is told when it is read.
        let own = match self.is_told_here() || !path.is_file() {
            true => Vec::new(),
            false => suite::of_mission(path, suite::GOAL)?,
        };
        let planned = |goal_file| Planned {
            mission: path.to_owned(),
            goal_file,
        };
        if own.is_empty() {
            return Ok(vec![planned(None)]);
        }
        Ok(own.into_iter().map(|file| planned(Some(file))).collect())
    }
}

fn of_its_mission(case: Case) -> Result<Planned, CommandError> {
    let goal_file = case.scenario;
    let Some(mission) = case.mission else {
        let candidates = suite::candidates(&goal_file);
        let candidates: Vec<_> = (candidates.iter())
            .map(|path| path.display().to_string())
            .collect();
        return Err(CommandError::Input(anyhow!(
            "{} has no mission: there is none of {}",
            goal_file.display(),
            candidates.join(", ")
        )));
    };
    Ok(Planned {
        mission,
        goal_file: Some(goal_file),
    })
}

/// What a mission is sent that has been compiled.
fn sent(file: PathBuf, mission: &Path, console: &mut Console) -> Result<Sent, CommandError> {
    Ok(Sent {
        script: by_hand::script_for(&file, mission, console)?,
        at_us: by_hand::SCRIPT_AT_US,
        file,
    })
}

/// What a goal file says.
fn read(path: &Path) -> Result<GoalFile, CommandError> {
    let text = file::read_text(path, "goal file")?;
    (text.parse::<GoalFile>())
        .with_context(|| path.display().to_string())
        .map_err(CommandError::Input)
}

impl From<FolderError> for CommandError {
    fn from(error: FolderError) -> Self {
        CommandError::Input(error.into())
    }
}
