//! Files that commands read and write.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;

use super::exit::CommandError;

/// Reads a whole input file.
///
/// # Errors
/// If it cannot be read: then the input has an error.
pub fn read(path: &Path, what: &str) -> Result<Vec<u8>, CommandError> {
    fs::read(path)
        .with_context(|| format!("cannot read the {what} {}", path.display()))
        .map_err(CommandError::Input)
}

/// Reads a whole input file of text.
///
/// # Errors
/// If it cannot be read or is not UTF-8: then the input has an error.
pub fn read_text(path: &Path, what: &str) -> Result<String, CommandError> {
    let bytes = read(path, what)?;
    let refusal = |_| {
        CommandError::Input(anyhow::anyhow!(
            "the {what} {} is no text: it is not UTF-8",
            path.display()
        ))
    };
    String::from_utf8(bytes).map_err(refusal)
}

/// Opens an output that grows while a command runs.
///
/// # Errors
/// If it cannot be created: then the outside world has failed.
pub fn create(path: &Path, what: &str) -> Result<BufWriter<File>, CommandError> {
    let file =
        File::create(path).with_context(|| format!("cannot write the {what} {}", path.display()));
    Ok(BufWriter::new(file.map_err(CommandError::World)?))
}

/// Writes a whole output file: it appears complete or not at all, and an old one stays where the new one cannot be written.
///
/// # Errors
/// If it cannot be written: then the outside world has failed.
pub fn write_whole(path: &Path, bytes: &[u8], what: &str) -> Result<(), CommandError> {
    replace(path, bytes)
        .with_context(|| format!("cannot write the {what} {}", path.display()))
        .map_err(CommandError::World)
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A link keeps pointing to the file that it names, and a device or pipe is written to, never replaced.
    let target = match fs::metadata(path) {
        Ok(found) if !found.is_file() => return fs::write(path, bytes),
        Ok(_) => fs::canonicalize(path)?,
        Err(_) => path.to_path_buf(),
    };
    let (draft_path, mut draft) = draft_beside(&target)?;
    let written = draft
        .write_all(bytes)
        .and_then(|()| draft.sync_all())
        .and_then(|()| fs::rename(&draft_path, &target));
    if written.is_err() {
        // The error that counts is the first.
        let _ = fs::remove_file(&draft_path);
    }
    written
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
    fn a_device_is_written_to_and_not_replaced() {
        write_whole(Path::new("/dev/null"), b"gone", "blob").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
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
