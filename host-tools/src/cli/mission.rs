//! From a source file to a verified blob, with everything said that is to be said about it.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use esm_core::Verified;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use crate::boards::Board;
use crate::clean::counted;
use crate::compile::{CompileError, NameTable};
use crate::fit;
use crate::lang::{self, Checked, Code, Diagnostic, Folded, LoadError};
use crate::model::SourceFile;
use crate::schedule::LaidOut;
use crate::time::work_limit;
use crate::trace::directory::Directory;

/// How a blob begins, so that it is told from a source.
pub const BLOB_MARK: &[u8; 4] = b"ESM2";

/// How long commands that need start times, and no more, search for them: as long as `esm schedule`
/// does where nothing else is asked for.
pub const LAY_OUT_LIMIT: Duration = Duration::from_secs(5);

/// Reads a file and all that it uses.
///
/// # Errors
/// If the file cannot be read; mistakes in it are diagnostics.
pub fn read(path: &Path) -> Result<Checked, CommandError> {
    refuse_blob(path)?;
    lang::load(path).map_err(|error| unread(path, &error))
}

/// Why a source is not read, with the file that may have been meant.
pub fn unread(path: &Path, error: &LoadError) -> CommandError {
    CommandError::Input(anyhow!("{error}{}", file::meant(path)))
}

/// Says so where a blob is given in the place of a source.
///
/// # Errors
/// If the file is a blob.
pub fn refuse_blob(path: &Path) -> Result<(), CommandError> {
    if is_blob(path) {
        return Err(CommandError::Input(anyhow!(
            "{} is a blob, and what is wanted here is the source that it was built from; `esm inspect` shows what is in a blob",
            path.display()
        )));
    }
    Ok(())
}

/// Whether the file begins as a blob does. One that cannot be read does not; whoever reads it next
/// says why.
fn is_blob(path: &Path) -> bool {
    let mut beginning = [0; BLOB_MARK.len()];
    // Looked at only where that cannot wait: what a pipe gives can be read but once.
    path.is_file()
        && File::open(path)
            .and_then(|mut file| file.read_exact(&mut beginning))
            .is_ok_and(|()| beginning == *BLOB_MARK)
}

/// Where diagnostics go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// To a person, on standard error.
    Person,
    /// To a program, as JSON Lines on standard output.
    Program,
}

/// Tells all diagnostics. For a person without what is unused in other files than the one asked
/// for: `esm check` counts that.
///
/// # Errors
/// If standard output cannot be written to.
pub fn tell(
    checked: &Checked,
    audience: Audience,
    console: &mut Console,
) -> Result<(), CommandError> {
    match audience {
        Audience::Program => {
            (console.json_out()).write_all(checked.json_lines().as_bytes())?;
            Ok(())
        }
        Audience::Person => {
            let Folded {
                text, first_code, ..
            } = checked.render_folded(console.colour_error());
            tell_person(&text, first_code, console);
            Ok(())
        }
    }
}

/// Tells a person how much is unused in other files than the one asked for. Gives how much that is.
pub fn tell_unused(checked: &Checked, console: &mut Console) -> usize {
    let mut all = 0;
    for (path, count) in checked.render_folded(false).unused {
        let declarations = counted(count as u64, "declaration");
        console.note(&format!(
            "{path}: {declarations} not used by this mission (W107; `esm check --all` shows them)"
        ));
        all += count;
    }
    all
}

/// Tells a person what was found in some files that are no mission.
pub fn tell_found(files: &[SourceFile], diagnostics: &[Diagnostic], console: &mut Console) {
    let text = lang::messages(files, diagnostics, console.colour_error());
    tell_person(
        &text,
        diagnostics.iter().map(|found| found.code).min(),
        console,
    );
}

/// Tells a person all diagnostics, those of libraries included.
pub fn tell_all(checked: &Checked, console: &mut Console) {
    let text = checked.render(console.colour_error());
    let first_code = checked.diagnostics.iter().map(|found| found.code).min();
    tell_person(&text, first_code, console);
}

/// Tells messages, and once where more is said: of a code that was just seen.
fn tell_person(messages: &str, first_code: Option<Code>, console: &mut Console) {
    if let Some(code) = first_code {
        console.coloured(messages.trim_end());
        console.note(&format!("\n`esm explain {code}` says more about a code."));
    }
}

/// Compiles the mission in a file, for a board if one is given. Warnings are told to the person;
/// errors to whom is asked for.
///
/// # Errors
/// If the file cannot be read or has errors; these are told already.
pub fn compiled(
    path: &Path,
    board: Option<&Board>,
    names: NameTable,
    audience: Audience,
    console: &mut Console,
) -> Result<Verified<Vec<u8>>, CommandError> {
    compiled_from(path, board, names, audience, console).map(|(_, blob)| blob)
}

/// As [`compiled`], with what it was compiled from.
///
/// # Errors
/// See [`compiled`].
pub fn compiled_from(
    path: &Path,
    board: Option<&Board>,
    names: NameTable,
    audience: Audience,
    console: &mut Console,
) -> Result<(Checked, Verified<Vec<u8>>), CommandError> {
    let mut checked = read(path)?;
    checked.require_machine();
    let blob = lay_out_and_compile(&mut checked, board, names)?;
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
    blob.map(|blob| (checked, blob)).ok_or(CommandError::Told)
}

/// The passes behind the language: a schedule for the slots (E011), then the blob, if there is a
/// machine and all else is right (E012). What is wrong is added to `checked`.
///
/// # Errors
/// If the machine has nothing to run, or this program has a defect.
pub fn lay_out_and_compile(
    checked: &mut Checked,
    board: Option<&Board>,
    names: NameTable,
) -> Result<Option<Verified<Vec<u8>>>, CommandError> {
    let Some(schedule) = checked.lay_out(work_limit(LAY_OUT_LIMIT)) else {
        return Ok(None);
    };
    if checked
        .model
        .as_ref()
        .is_none_or(|model| model.machine.is_none())
    {
        return Ok(None);
    }
    compile(checked, &schedule, board, names)
}

/// The blob of files that are right, with these start times; none where it does not fit (E012).
///
/// # Errors
/// See [`lay_out_and_compile`].
pub fn compile(
    checked: &mut Checked,
    schedule: &LaidOut,
    board: Option<&Board>,
    names: NameTable,
) -> Result<Option<Verified<Vec<u8>>>, CommandError> {
    fit::compile_to_fit(checked, schedule, board, names).map_err(|reason| match reason {
        nothing @ CompileError::NothingToRun { .. } => CommandError::Input(nothing.into()),
        defect => CommandError::Input(anyhow!(
            "no blob could be made of files without errors, which is a defect of esm itself: please report them and this reason: {defect}"
        )),
    })
}

/// The names in a compiled mission.
///
/// # Errors
/// If it was built without them.
pub fn names(verified: &Verified<Vec<u8>>) -> Result<Directory, CommandError> {
    Directory::of(&verified.tables()).map_err(|error| CommandError::Input(error.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blob_where_a_source_belongs_is_recognised() {
        let folder = tempfile::tempdir().unwrap();
        let cases: [(&str, &[u8], bool); 4] = [
            ("blob", b"ESM2\n and more", true),
            ("source", b"machine M { }", false),
            ("short", b"ES", false),
            ("empty", b"", false),
        ];
        for (name, bytes, expected) in cases {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(is_blob(&path), expected, "{name}");
        }
        assert!(!is_blob(folder.path()));
        assert!(!is_blob(&folder.path().join("gone")));
    }
}
