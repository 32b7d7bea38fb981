//! From a source file to a verified blob, with everything said that is to be said about it.

use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use esm_core::Verified;

use super::console::Console;
use super::exit::CommandError;
use crate::compile;
use crate::lang::{self, Checked};
use crate::trace::directory::Directory;

/// How long commands that need start times, and no more, search for them.
pub const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);

/// Reads a file and all that it uses.
///
/// # Errors
/// If the file cannot be read; mistakes in it are diagnostics.
pub fn read(path: &Path) -> Result<Checked, CommandError> {
    lang::load(path).map_err(|error| CommandError::Input(error.into()))
}

/// Where diagnostics go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// To a person, on standard error.
    Person,
    /// To a program, as JSON Lines on standard output.
    Program,
}

/// Tells all diagnostics.
///
/// # Errors
/// If standard output cannot be written to.
pub fn tell(
    checked: &Checked,
    audience: Audience,
    console: &mut Console,
) -> Result<(), CommandError> {
    match audience {
        Audience::Program => console.text(&checked.json_lines()),
        Audience::Person if checked.diagnostics.is_empty() => Ok(()),
        Audience::Person => {
            let rendered = checked.render(console.colour_error());
            console.note(rendered.trim_end());
            Ok(())
        }
    }
}

/// Compiles the mission in a file. Warnings are told to the person; errors to whom is asked for.
///
/// # Errors
/// If the file cannot be read or has errors; these are told already.
pub fn compiled(
    path: &Path,
    audience: Audience,
    console: &mut Console,
) -> Result<Verified<Vec<u8>>, CommandError> {
    let mut checked = read(path)?;
    checked.require_machine();
    let schedule = checked.lay_out(LAY_OUT_LIMIT);
    // What a program reads from a command that succeeds is the command's answer alone.
    tell(
        &checked,
        if checked.has_errors() {
            audience
        } else {
            Audience::Person
        },
        console,
    )?;
    let (Some(model), Some(schedule)) = (&checked.model, schedule) else {
        return Err(CommandError::Told);
    };
    let blob = compile::compile(model, &schedule.starts_us)
        .map_err(|error| CommandError::Input(error.into()))?;
    esm_core::verify(blob).map_err(|(_, refusal)| {
        let defect =
            "the compiler made a blob that the verifier refuses, which is a defect of esm itself";
        CommandError::Input(anyhow!(
            "{defect}: please report the file and this reason: {refusal:?}"
        ))
    })
}

/// The names in a compiled mission.
///
/// # Errors
/// If it was built without them.
pub fn names(verified: &Verified<Vec<u8>>) -> Result<Directory, CommandError> {
    Directory::of(&verified.tables()).map_err(|error| CommandError::Input(error.into()))
}
