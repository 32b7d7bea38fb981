//! Numbers of a robot's file, changed where they stand: comments and all else stay.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use robot_file::Measured;
use toml_edit::{DocumentMut, value};

use super::exit::CommandError;
use super::file;

/// A robot's file, which has been read, and holds.
#[derive(Clone, Debug)]
pub struct RobotToml {
    path: PathBuf,
    document: Box<DocumentMut>,
    measured: Measured,
}

/// A number of the section `[wheels]`: its key, and what it becomes.
pub type Change = (&'static str, f64);

impl RobotToml {
    /// Reads a file.
    ///
    /// # Errors
    /// It cannot be read, or does not hold.
    pub fn read(path: &Path) -> Result<Self, CommandError> {
        let text = file::read_text(path, "robot's file")?;
        let robot =
            robot_file::check(path, &text).map_err(|error| CommandError::Input(error.into()))?;
        let document: DocumentMut = text
            .parse()
            .map_err(|error| CommandError::Input(anyhow!("{}: {error}", path.display())))?;
        Ok(Self {
            path: path.to_owned(),
            document: Box::new(document),
            measured: robot.measured(),
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it says.
    pub fn measured(&self) -> Measured {
        self.measured
    }

    /// Writes the file with these numbers in `[wheels]`.
    ///
    /// # Errors
    /// One of them cannot be: then the file stays as it is. Or it cannot be written.
    pub fn write_wheels(&self, changes: &[Change]) -> Result<(), CommandError> {
        let mut document = self.document.clone();
        for &(key, number) in changes {
            // A robot's file that holds has all of them.
            let wheels = document.get_mut("wheels");
            if let Some(item) = wheels.and_then(|wheels| wheels.get_mut(key)) {
                let decor = item.as_value().map(|value| value.decor().clone());
                *item = value(number);
                if let (Some(decor), Some(new)) = (decor, item.as_value_mut()) {
                    *new.decor_mut() = decor;
                }
            }
        }
        let text = document.to_string();
        robot_file::check(&self.path, &text).map_err(|error| {
            CommandError::Input(anyhow!(
                "{error}\nwhat was measured cannot be: the file stays as it is"
            ))
        })?;
        file::write_whole(&self.path, text.as_bytes(), "robot's file")
    }
}
