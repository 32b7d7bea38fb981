//! Sources on disk, as the front end and the language server take them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};

use esm_toolkit::lang::{self, Checked, LoadError, MAX_FILE_BYTES, Overlay, Store};
use esm_toolkit::language_server::Workspace;

use crate::files;
use crate::nearby::{is_nobodys_source, nearby};

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Store for Disk {
    fn identity(&self, path: &str) -> String {
        fs::canonicalize(path)
            .map(|path| path.to_string_lossy().into_owned())
            .unwrap_or_else(|_| path.to_owned())
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        let path = PathBuf::from(path);
        let failed = |cause| LoadError::Read {
            path: path.clone(),
            cause,
        };
        let metadata = fs::metadata(&path).map_err(failed)?;
        if !metadata.is_file() {
            return Err(LoadError::NotAFile { path });
        }
        if metadata.len() > MAX_FILE_BYTES {
            return Err(LoadError::TooLong {
                bytes: metadata.len(),
                path,
            });
        }
        files::read(&path, MAX_FILE_BYTES).map_err(failed)
    }

    fn nearby(&self, folder: &Path, path: &Path) -> Option<PathBuf> {
        let is_there = folder.join(path).exists();
        (!is_there).then(|| nearby(folder, path)).flatten()
    }
}

impl Workspace for Disk {
    fn is_file(&self, path: &Path) -> bool {
        path.is_file()
    }

    fn sources(&self, folders: &BTreeSet<PathBuf>, most: usize) -> (Vec<PathBuf>, bool) {
        let mut found = BTreeSet::new();
        let mut to_visit: VecDeque<PathBuf> = folders.iter().cloned().collect();
        let mut visited = BTreeSet::new();
        let mut entries_left = most;
        while let Some(folder) = to_visit.pop_front() {
            if !visited.insert(folder.clone()) {
                continue;
            }
            let Ok(entries) = fs::read_dir(&folder) else {
                continue;
            };
            for entry in entries.flatten() {
                if entries_left == 0 {
                    return (found.into_iter().collect(), false);
                }
                entries_left -= 1;
                let (path, name) = (entry.path(), entry.file_name());
                let name = name.to_string_lossy();
                let Ok(kind) = entry.file_type() else {
                    continue;
                };
                if is_nobodys_source(&name) {
                    continue;
                }
                // Links to folders are not followed, so the way down ends.
                if kind.is_dir() {
                    to_visit.push_back(path);
                } else if path.extension().is_some_and(|it| it == "esm") {
                    found.insert(path);
                }
            }
        }
        (found.into_iter().collect(), true)
    }
}

/// Reads a file with all that it uses, and checks the set.
///
/// # Errors
/// The file itself cannot be read. A file that it uses and that cannot be read is a diagnostic.
pub fn load(path: &Path) -> Result<Checked, LoadError> {
    lang::load_from(&path.to_string_lossy(), &Disk)
}

/// As [`load`], where texts that are open in an editor count instead of the files on disk. They are
/// given by [`identity`].
///
/// # Errors
/// The file itself cannot be read.
pub fn load_over(path: &Path, open: &BTreeMap<String, String>) -> Result<Checked, LoadError> {
    lang::load_from(&path.to_string_lossy(), &Overlay::new(&Disk, open))
}

/// What tells one file from another, however its path is written.
pub fn identity(path: &Path) -> String {
    Disk.identity(&path.to_string_lossy())
}

/// Reads one source file as it is, and nothing that it uses.
///
/// # Errors
/// It cannot be read, is no file, or is too long.
pub fn read_source(path: &Path) -> Result<Vec<u8>, LoadError> {
    Disk.read(&path.to_string_lossy())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_on_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("lib")).expect("a folder");
        fs::write(path("a.esm"), "use \"lib/b.esm\";\nuse \"lib\";").expect("a file");
        fs::write(path("lib/b.esm"), b"task T { }\nta\xFFsk U { }").expect("a file");
        let checked = load(&path("a.esm")).expect("a file");
        let places: Vec<_> = (checked.diagnostics.iter())
            .map(|found| {
                let position = checked.position(found.span);
                (
                    found.code.as_str(),
                    found.span.file,
                    position.line,
                    position.col,
                )
            })
            .collect();
        assert_eq!(places, [("E013", 0, 2, 1), ("E001", 1, 2, 3)]);
        assert!(checked.files[1].path.ends_with("lib/b.esm"));
        assert!(matches!(
            load(&path("none.esm")),
            Err(LoadError::Read { .. })
        ));
        assert!(matches!(
            load(&path("lib")),
            Err(LoadError::NotAFile { .. })
        ));
    }
}
