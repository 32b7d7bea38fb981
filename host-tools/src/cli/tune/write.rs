//! What was found, written into a robot's file or into a mission.

use std::path::{Path, PathBuf};

use anyhow::anyhow;

use super::found::Found;
use super::numbers::{TASK, rounded, values_of};
use crate::clean::counted;
use crate::cli::exit::CommandError;
use crate::cli::robot_toml::RobotToml;
use crate::cli::{file, mission};
use crate::lang::Checked;

/// A file that the result goes into.
#[derive(Debug)]
pub enum Target {
    /// A robot's file.
    Robot(RobotToml),
    /// A mission without errors.
    Mission {
        /// Where it is.
        path: PathBuf,
        /// What it says.
        checked: Box<Checked>,
    },
}

/// Whether a path ends like this.
fn ends_in(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|end| end == extension)
}

impl Target {
    /// The file at a path, if it is one that the result can go into.
    ///
    /// # Errors
    /// It is none, or there are errors in it.
    pub fn of(path: &Path) -> Result<Self, CommandError> {
        if ends_in(path, "esm") {
            let checked = mission::read(path)?;
            let shown = path.display();
            return match checked.with_values(TASK, &[]) {
                Some(found) if found.states > 0 => Ok(Target::Mission {
                    path: path.to_owned(),
                    checked: Box::new(checked),
                }),
                Some(_) => Err(CommandError::Input(anyhow!(
                    "{shown} has no task state `{TASK}` whose gains could be written; those of other files that it uses are theirs"
                ))),
                None => Err(CommandError::Input(anyhow!(
                    "{shown} has errors: `esm check {shown}` says which"
                ))),
            };
        }
        if ends_in(path, "toml") {
            return RobotToml::read(path).map(Target::Robot);
        }
        Err(CommandError::Usage(anyhow!(
            "`--write {}`: give a robot's file, which ends in .toml, or a mission, which ends in .esm",
            path.display()
        )))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        match self {
            Target::Robot(file) => file.path(),
            Target::Mission { path, .. } => path,
        }
    }

    /// Writes what was found. Returns what a person is to know of it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, found: &Found) -> Result<String, CommandError> {
        match self {
            Target::Robot(file) => {
                let (full_speed_m_per_s, friction_power) = found.feed_forward();
                file.write_wheels(&[
                    ("full_speed_m_per_s", rounded(full_speed_m_per_s)),
                    ("friction_power", rounded(friction_power)),
                ])?;
                Ok(format!(
                    "{}: full speed and friction; they hold in the firmware that is built from it next",
                    file.path().display()
                ))
            }
            Target::Mission { path, checked } => {
                // It was found to have such states, and no errors.
                let Some(rewritten) = checked.with_values(TASK, &values_of(&found.gains)) else {
                    return Err(CommandError::Told);
                };
                file::write_whole(path, rewritten.text.as_bytes(), "mission")?;
                let states = counted(rewritten.states as u64, "task state");
                Ok(format!(
                    "{}: the gains, in {states} `{TASK}`",
                    path.display()
                ))
            }
        }
    }
}
