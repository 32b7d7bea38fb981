//! What was found, written into a robot's file or into a mission.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use toml_edit::{DocumentMut, value};

use super::found::Found;
use super::numbers::{TASK, rounded, values_of};
use crate::clean::counted;
use crate::cli::exit::CommandError;
use crate::cli::{file, mission};
use crate::lang::Checked;

/// A file that the result goes into.
#[derive(Debug)]
pub enum Target {
    /// A robot's file, which has been read, and holds.
    Robot {
        /// Where it is.
        path: PathBuf,
        /// What it says.
        document: Box<DocumentMut>,
    },
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
            let text = file::read_text(path, "robot's file")?;
            robot_file::read(path).map_err(|error| CommandError::Input(error.into()))?;
            let document: DocumentMut = text
                .parse()
                .map_err(|error| CommandError::Input(anyhow!("{}: {error}", path.display())))?;
            return Ok(Target::Robot {
                path: path.to_owned(),
                document: Box::new(document),
            });
        }
        Err(CommandError::Usage(anyhow!(
            "`--write {}`: give a robot's file, which ends in .toml, or a mission, which ends in .esm",
            path.display()
        )))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        match self {
            Target::Robot { path, .. } | Target::Mission { path, .. } => path,
        }
    }

    /// Writes what was found. Returns what a person is to know of it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, found: &Found) -> Result<String, CommandError> {
        match self {
            Target::Robot { path, document } => {
                let mut document = document.clone();
                let (full_speed_m_per_s, friction_power) = found.feed_forward();
                for (key, number) in [
                    ("full_speed_m_per_s", full_speed_m_per_s),
                    ("friction_power", friction_power),
                ] {
                    let place = document
                        .get_mut("wheels")
                        .and_then(|wheels| wheels.get_mut(key));
                    // A robot's file that holds has both.
                    if let Some(item) = place {
                        let decor = item.as_value().map(|value| value.decor().clone());
                        *item = value(rounded(number));
                        if let (Some(decor), Some(new)) = (decor, item.as_value_mut()) {
                            *new.decor_mut() = decor;
                        }
                    }
                }
                file::write_whole(path, document.to_string().as_bytes(), "robot's file")?;
                Ok(format!(
                    "{}: full speed and friction; they hold in the firmware that is built from it next",
                    path.display()
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
