//! Files that commands read and write.

use std::fmt;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};

use super::exit::CommandError;
use crate::files;
use crate::nearby::nearby;
use crate::pictures::scene::Scene;
use crate::recording::file::MARK;

/// Reads a whole input file that is no longer than `most_bytes`.
///
/// # Errors
/// If it cannot be read, is longer, or is no file: then the input has an error.
pub fn read(path: &Path, most_bytes: u64, what: &str) -> Result<Vec<u8>, CommandError> {
    files::read(path, most_bytes).map_err(|error| {
        CommandError::Input(anyhow!(
            "cannot read the {what} {}: {error}{}",
            path.display(),
            meant(path)
        ))
    })
}

/// `; did you mean …?` behind what is said of a file that is not there, where one nearby may have
/// been meant.
pub fn meant(path: &Path) -> String {
    if path.exists() {
        return String::new();
    }
    match nearby(Path::new(""), path) {
        Some(meant) => format!("; did you mean `{}`?", meant.display()),
        None => String::new(),
    }
}

/// Reads a whole input file of text.
///
/// # Errors
/// If it cannot be read, is too long or is not UTF-8: then the input has an error.
pub fn read_text(path: &Path, what: &str) -> Result<String, CommandError> {
    let bytes = read(path, files::MAX_TEXT_BYTES, what)?;
    let refusal = |_| {
        CommandError::Input(anyhow::anyhow!(
            "the {what} {} is no text: it is not UTF-8",
            path.display()
        ))
    };
    String::from_utf8(bytes).map_err(refusal)
}

/// The longest line of a table that is read. One of a tick log has some thirty bytes.
const MAX_LINE_BYTES: u64 = 64 << 10;

/// Hands on the lines of a table, one by one and with their ends, so that a long one takes no more
/// memory than a short one. What `take` says against a line is told with file and line.
///
/// # Errors
/// If the file cannot be read, has a line without end, or is no file, or if `take` fails: then the
/// input has an error.
pub fn each_line<E: fmt::Display>(
    path: &Path,
    what: &str,
    mut take: impl FnMut(&[u8]) -> Result<(), E>,
) -> Result<(), CommandError> {
    let unread = |error: io::Error| {
        CommandError::Input(anyhow!(
            "cannot read the {what} {}: {error}{}",
            path.display(),
            meant(path)
        ))
    };
    let mut table = BufReader::new(files::open(path).map_err(unread)?);
    let mut line = Vec::new();
    for number in 1_u64.. {
        line.clear();
        let limited = (&mut table)
            .take(MAX_LINE_BYTES)
            .read_until(b'\n', &mut line);
        let is_cut = limited.map_err(unread)? as u64 == MAX_LINE_BYTES && !line.ends_with(b"\n");
        let wrong = |error: &dyn fmt::Display| {
            CommandError::Input(anyhow!("{}:{number}: {error}", path.display()))
        };
        if is_cut {
            return Err(wrong(&format_args!(
                "it is longer than {MAX_LINE_BYTES} bytes: is this a {what}?"
            )));
        }
        if line.is_empty() {
            break;
        }
        take(&line).map_err(|error| wrong(&error))?;
    }
    Ok(())
}

/// Endings of files that people write.
const SOURCES: [&str; 4] = ["esm", "goal", "scenario", "world"];

/// Refuses an output in the place of something that cannot be had again: a file that the command
/// reads or keeps, any mission, goal, scenario or world, which a mission may use, and the recording
/// of a robot.
///
/// # Errors
/// If such a file is there: then the command line is wrong.
pub fn keep_sources<'i>(
    output: &Path,
    inputs: impl IntoIterator<Item = &'i Path>,
) -> Result<(), CommandError> {
    // What is not there or is no file cannot be lost.
    let Ok(target) = fs::canonicalize(output) else {
        return Ok(());
    };
    if !target.is_file() {
        return Ok(());
    }
    let is_input = |input: &Path| fs::canonicalize(input).is_ok_and(|input| input == target);
    let is_source = target
        .extension()
        .is_some_and(|ending| SOURCES.iter().any(|source| ending == *source));
    if is_source || inputs.into_iter().any(is_input) {
        return Err(CommandError::Usage(anyhow!(
            "{} would be overwritten, and it is no output: name another file",
            output.display()
        )));
    }
    if is_recording(&target) {
        return Err(CommandError::Usage(anyhow!(
            "{} holds a recording, and what a robot did cannot be had again: name another file, or remove that one",
            output.display()
        )));
    }
    Ok(())
}

/// What cannot be read cannot be known; whether it can be written will be seen.
fn is_recording(path: &Path) -> bool {
    let mut begins_with = [0; MARK.len()];
    File::open(path)
        .and_then(|mut file| file.read_exact(&mut begins_with))
        .is_ok_and(|()| begins_with == *MARK)
}

/// Refuses outputs of which two would be one file, of which only a mixture would stay.
///
/// # Errors
/// If two are one: then the command line is wrong.
pub fn keep_apart(outputs: &[&Path]) -> Result<(), CommandError> {
    for (index, output) in outputs.iter().enumerate() {
        // A device takes whatever comes.
        let is_other = output.exists() && !output.is_file();
        let others = outputs.iter().skip(index + 1);
        if !is_other && others.clone().any(|other| are_one(output, other)) {
            return Err(CommandError::Usage(anyhow!(
                "two things would be written to {}: name a file for each",
                output.display()
            )));
        }
    }
    Ok(())
}

/// Whether two outputs would be one file, however their names are written.
fn are_one(first: &Path, second: &Path) -> bool {
    place(first) == place(second)
}

/// Where a file is, or will be.
fn place(path: &Path) -> PathBuf {
    if let Ok(place) = fs::canonicalize(path) {
        return place;
    }
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    match (
        fs::canonicalize(folder.unwrap_or(Path::new("."))),
        path.file_name(),
    ) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

/// Opens an output that grows while a command runs.
///
/// # Errors
/// If it cannot be created: then the outside world has failed.
pub fn create(path: &Path, what: &str) -> Result<BufWriter<File>, CommandError> {
    let file = File::create(path).with_context(|| unwritten(path, what));
    Ok(BufWriter::new(file.map_err(CommandError::World)?))
}

/// Writes a picture in the format that the name of its file asks for: PNG, or else SVG.
///
/// # Errors
/// If it cannot be drawn, or as [`write_whole`].
pub fn write_picture(path: &Path, scene: &Scene) -> Result<(), CommandError> {
    let is_png = (path.extension()).is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    let bytes = match is_png {
        true => (scene.to_png()).map_err(|error| CommandError::Input(error.into()))?,
        false => scene.to_svg().into_bytes(),
    };
    write_whole(path, &bytes, "picture")
}

/// Writes a whole output file: it appears complete or not at all, and an old one stays where the
/// new one cannot be written.
///
/// # Errors
/// If it cannot be written: then the outside world has failed.
pub fn write_whole(path: &Path, bytes: &[u8], what: &str) -> Result<(), CommandError> {
    replace(path, bytes)
        .with_context(|| unwritten(path, what))
        .map_err(CommandError::World)
}

/// An output that is written part by part, and appears complete or not at all.
pub struct Draft {
    what: String,
    out: BufWriter<File>,
    /// Where it is until it is complete, and where it will be; none of a device or a pipe.
    places: Option<(PathBuf, PathBuf)>,
}

impl Draft {
    /// Begins one.
    ///
    /// # Errors
    /// If it cannot be written: then the outside world has failed.
    pub fn begin(path: &Path, what: &str) -> Result<Self, CommandError> {
        let what = unwritten(path, what);
        let begun = draft(path).with_context(|| what.clone());
        let (file, places) = begun.map_err(CommandError::World)?;
        let out = BufWriter::new(file);
        Ok(Draft { what, out, places })
    }

    /// Takes away what there is of it, whoever has it: for a process that ends at once.
    pub fn remover(&self) -> impl FnOnce() + Send + 'static {
        let draft = self.places.as_ref().map(|(draft, _)| draft.clone());
        move || {
            if let Some(draft) = draft {
                // There is nobody to tell. If it is complete it has another name.
                let _ = fs::remove_file(draft);
            }
        }
    }

    /// Puts it in its place.
    ///
    /// # Errors
    /// If it cannot be written: then the outside world has failed.
    pub fn finish(mut self) -> Result<(), CommandError> {
        let ended = self.out.flush().and_then(|()| match &self.places {
            Some((from, to)) => {
                self.out.get_ref().sync_all()?;
                fs::rename(from, to)
            }
            None => Ok(()),
        });
        if ended.is_ok() {
            self.places = None;
        }
        let ended = ended.with_context(|| self.what.clone());
        ended.map_err(CommandError::World)
    }
}

impl Write for Draft {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Drop for Draft {
    fn drop(&mut self) {
        if let Some((draft, _)) = &self.places {
            // There is nobody to tell.
            let _ = fs::remove_file(draft);
        }
    }
}

/// Looks whether the folder of an output is there, before anything else is made.
///
/// # Errors
/// If it is not: then the outside world has failed.
pub fn has_folder(path: &Path, what: &str) -> Result<(), CommandError> {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.is_dir() => {
            Err(CommandError::World(anyhow!("{}", unwritten(path, what))))
        }
        _ => Ok(()),
    }
}

/// What is said of an output that could not be written.
fn unwritten(path: &Path, what: &str) -> String {
    let said = format!("cannot write the {what} {}", path.display());
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() && !folder.exists() => {
            format!(
                "{said}: make the folder {} first, or name another",
                folder.display()
            )
        }
        _ => said,
    }
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (mut file, places) = draft(path)?;
    let written = file.write_all(bytes);
    let Some((draft, target)) = places else {
        return written;
    };
    let written = written
        .and_then(|()| file.sync_all())
        .and_then(|()| fs::rename(&draft, &target));
    if written.is_err() {
        // The error that counts is the first.
        let _ = fs::remove_file(&draft);
    }
    written
}

/// What an output is written to, and, if it takes a name only when it is complete, the names before
/// and then.
fn draft(path: &Path) -> io::Result<(File, Option<(PathBuf, PathBuf)>)> {
    // A link keeps pointing to the file that it names, and a device or pipe is written to, never
    // replaced.
    let target = match fs::metadata(path) {
        Ok(found) if !found.is_file() => {
            return Ok((OpenOptions::new().write(true).open(path)?, None));
        }
        Ok(_) => fs::canonicalize(path)?,
        Err(_) => path.to_path_buf(),
    };
    let permissions = fs::metadata(&target).map(|found| found.permissions()).ok();
    if permissions.as_ref().is_some_and(Permissions::readonly) {
        return Err(io::Error::new(
            io::ErrorKind::PermissionDenied,
            "it may not be written to",
        ));
    }
    let (draft_path, draft) = draft_beside(&target)?;
    if let Some(Err(error)) = permissions.map(|it| draft.set_permissions(it)) {
        let _ = fs::remove_file(&draft_path);
        return Err(error);
    }
    Ok((draft, Some((draft_path, target))))
}

/// A new file in the same directory, so that renaming it is one step of the file system.
fn draft_beside(target: &Path) -> io::Result<(PathBuf, File)> {
    let name = target
        .file_name()
        .ok_or(io::ErrorKind::InvalidInput)?
        .to_string_lossy();
    let draft_path = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let draft = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .open(&draft_path)?;
    Ok((draft_path, draft))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(directory: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(directory)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn lines_are_handed_on_one_by_one_and_a_wrong_one_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("table.csv");
        let long = "1".repeat(MAX_LINE_BYTES as usize);
        for (text, taken, said) in [
            ("a\r\nb\n", "a\r\n|b\n|", None),
            ("a\n\nb", "a\n|\n|b|", None),
            ("", "", None),
            ("a\nwrong\nb", "a\n|", Some("table.csv:2: no")),
            (
                &format!("a\n{long}"),
                "a\n|",
                Some("table.csv:2: it is longer than 65536"),
            ),
        ] {
            fs::write(&path, text).unwrap();
            let mut lines = String::new();
            let ended = each_line(&path, "table", |line| {
                let line = std::str::from_utf8(line).unwrap();
                if line.starts_with("wrong") {
                    return Err("no");
                }
                lines += &format!("{line}|");
                Ok(())
            });
            assert_eq!(lines, taken, "{text}");
            let error = ended.err().map(|error| error.to_string());
            assert_eq!(error.is_some(), said.is_some(), "{error:?}");
            assert!(error.is_none_or(|error| error.contains(said.unwrap())));
        }
    }

    #[test]
    fn a_file_is_replaced_whole_and_nothing_else_stays() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("out.blob");
        for content in [&b"first, and longer"[..], b"second"] {
            write_whole(&path, content, "blob").unwrap();
            assert_eq!(fs::read(&path).unwrap(), content);
            assert_eq!(names_in(directory.path()), ["out.blob"]);
        }
    }

    #[test]
    fn a_link_keeps_pointing_to_its_file() {
        let directory = tempfile::tempdir().unwrap();
        let (file, link) = (directory.path().join("file"), directory.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, b"new", "blob").unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
    }

    #[test]
    fn permissions_stay_and_are_heeded() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        for (mode, is_written) in [(0o600, true), (0o755, true), (0o444, false)] {
            fs::write(&path, "old").unwrap();
            fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
            assert_eq!(write_whole(&path, b"new", "blob").is_ok(), is_written);
            let found = fs::metadata(&path).unwrap().permissions().mode() & 0o777;
            assert_eq!(found, mode);
            assert_eq!(names_in(directory.path()), ["file"]);
        }
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }

    #[test]
    fn sources_are_no_outputs() {
        let directory = tempfile::tempdir().unwrap();
        let at = |name: &str| directory.path().join(name);
        for name in [
            "read.esm",
            "used.esm",
            "a.scenario",
            "a.goal",
            "mission",
            "old.blob",
        ] {
            fs::write(at(name), "").unwrap();
        }
        std::os::unix::fs::symlink(at("mission"), at("link")).unwrap();
        for (output, is_kept) in [
            ("read.esm", true),
            ("used.esm", true),
            ("a.scenario", true),
            ("a.goal", true),
            ("mission", true),
            ("link", true),
            ("old.blob", false),
            ("new.blob", false),
            ("new.esm", false),
            ("", false),
        ] {
            let found = keep_sources(&at(output), [&*at("read.esm"), &at("mission")]);
            assert_eq!(found.is_err(), is_kept, "{output}");
        }
        let null = Path::new("/dev/null");
        assert!(keep_sources(null, [null]).is_ok());
    }

    #[test]
    fn a_device_is_written_to_and_not_replaced() {
        write_whole(Path::new("/dev/null"), b"gone", "blob").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }

    #[test]
    fn one_file_has_many_names() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("sub")).unwrap();
        let [out, around, other, within] =
            ["out", "sub/../out", "other", "sub/out"].map(|name| folder.path().join(name));
        for is_there in [false, true] {
            assert!(are_one(&out, &around), "{is_there}");
            assert!(
                !are_one(&out, &other) && !are_one(&out, &within),
                "{is_there}"
            );
            fs::write(&out, "").unwrap();
        }
        assert!(are_one(Path::new("./x.svg"), Path::new("x.svg")));
    }

    #[test]
    fn a_place_that_does_not_exist_is_the_worlds_failure_and_said() {
        let error = write_whole(Path::new("/nowhere/out.blob"), b"", "blob").unwrap_err();
        assert_eq!(error.status(), super::super::exit::ExitStatus::WorldFailed);
        assert!(
            error
                .to_string()
                .starts_with("cannot write the blob /nowhere/out.blob"),
            "{error}"
        );
    }
}
