//! New files: made of templates, and written only where nothing is.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior, Value};
use serde::Serialize;

use crate::cli::console::Console;
use crate::cli::exit::CommandError;

/// A file that is to be there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NewFile {
    /// Its path, below the folder of what is new.
    pub path: PathBuf,
    /// What is in it.
    pub text: String,
}

impl NewFile {
    /// A file of a template, in whose places stands what `values` say.
    ///
    /// # Errors
    /// The template has a place that nothing is said of: a defect of this command.
    pub fn of_template(
        path: impl Into<PathBuf>,
        template: &str,
        values: impl Serialize,
    ) -> Result<Self, CommandError> {
        let path = path.into();
        let broken = |error: minijinja::Error| {
            CommandError::World(anyhow!(
                "the template of {} is broken, a defect of this command: {error}",
                path.display()
            ))
        };
        let mut syntax = SyntaxConfig::builder();
        syntax.keep_trailing_newline(true);
        let mut environment = Environment::empty();
        environment.set_syntax(syntax.build().map_err(broken)?);
        environment.set_undefined_behavior(UndefinedBehavior::Strict);
        let values = Value::from(Serde(values));
        let text = environment.render_str(template, values).map_err(broken)?;
        Ok(Self { path, text })
    }

    /// A file with this text.
    pub fn new(path: impl Into<PathBuf>, text: impl Into<String>) -> Self {
        Self {
            path: path.into(),
            text: text.into(),
        }
    }
}

/// Writes files below a folder, and the folders that they stand in; none, if one of them is there.
///
/// # Errors
/// One is there already, or cannot be written.
pub fn write(folder: &Path, files: &[NewFile]) -> Result<(), CommandError> {
    for file in files {
        let path = folder.join(&file.path);
        if path.symlink_metadata().is_ok() {
            return Err(CommandError::Usage(anyhow!(
                "{} is there already, and stays as it is: take another name",
                path.display()
            )));
        }
    }
    for file in files {
        let path = folder.join(&file.path);
        let failed =
            |error| CommandError::World(anyhow!("cannot write {}: {error}", path.display()));
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(failed)?;
        }
        let new = std::fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&path);
        new.and_then(|mut new| new.write_all(file.text.as_bytes()))
            .map_err(failed)?;
    }
    Ok(())
}

/// What has been done, for programs.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    /// What is new: `robot`, `task`, `behaviour`, `mission` or `board`.
    pub kind: &'a str,
    /// Its name.
    pub name: &'a str,
    /// The folder that the files are in.
    pub folder: String,
    /// The files that were written, below that folder.
    pub files: Vec<String>,
    /// The files that were there, and have lines more.
    pub changed: Vec<String>,
    /// What is left to do, a step each.
    pub next: Vec<String>,
}

impl Report<'_> {
    /// Says what has been done.
    ///
    /// # Errors
    /// The output cannot be written to.
    pub fn tell(&self, json: bool, console: &mut Console) -> Result<(), CommandError> {
        if json {
            return console.json_line(self);
        }
        let mut text = format!("{} {}, in {}:\n", self.kind, self.name, self.folder);
        for file in &self.files {
            text += &format!("  {file}\n");
        }
        for file in &self.changed {
            text += &format!("  {file} (lines added)\n");
        }
        if !self.next.is_empty() {
            text += "next:\n";
        }
        for step in &self.next {
            text += &format!("  {step}\n");
        }
        console.text(&text)
    }
}

/// The paths of files, as texts.
pub fn names(files: &[NewFile]) -> Vec<String> {
    let name = |file: &NewFile| file.path.display().to_string();
    files.iter().map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_written_over_and_nothing_by_halves() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("b"), "mine").unwrap();
        let files = [NewFile::new("c/a", "new"), NewFile::new("b", "new")];
        let error = write(folder.path(), &files).unwrap_err();
        assert_eq!(error.status() as u8, 2);
        assert!(!at("c").exists());
        assert_eq!(std::fs::read_to_string(at("b")).unwrap(), "mine");
        write(folder.path(), &files[..1]).unwrap();
        assert_eq!(std::fs::read_to_string(at("c/a")).unwrap(), "new");
    }

    #[test]
    fn a_place_that_nothing_is_said_of_is_an_error() {
        assert!(NewFile::of_template("a", "{{ what }}", ()).is_err());
    }
}
