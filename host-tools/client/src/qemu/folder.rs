//! The folder of a run, and what is left of runs whose program was killed.
//!
//! Who has a folder holds a lock on a file in it, which the system lets go of however the program
//! ends. So whoever makes the next folder knows which of the others nobody has any more, and
//! removes them.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use tempfile::TempDir;

/// What the folders' names begin with.
const PREFIX: &str = "esm-";

/// The file that is locked, and its name before it is.
const OWNER_FILE: &str = "owner";
const NEW_OWNER_FILE: &str = "new-owner";

/// A folder that is removed when this is dropped, or when the next one is made after this process
/// has ended without doing so.
pub struct RunFolder {
    // Removed before the lock is let go of.
    folder: TempDir,
    _owner: File,
}

impl RunFolder {
    /// Makes a folder below the system's temporary one, and removes those that nobody has any more.
    ///
    /// # Errors
    /// What the system says of the new one.
    pub fn new() -> io::Result<Self> {
        Self::below(&std::env::temp_dir())
    }

    /// The same in another place.
    ///
    /// # Errors
    /// What the system says of the new one.
    pub fn below(place: &Path) -> io::Result<Self> {
        let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(place)?;
        // Nobody finds it under its name before it is locked.
        let new = folder.path().join(NEW_OWNER_FILE);
        let owner = File::create(&new)?;
        owner.lock()?;
        fs::rename(new, folder.path().join(OWNER_FILE))?;
        // What cannot be looked at, or removed, is none of this run's concern.
        let _ = clear(place, fs::metadata(folder.path())?.uid());
        Ok(RunFolder {
            folder,
            _owner: owner,
        })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes the folders of this user that nobody has any more.
fn clear(place: &Path, user: u32) -> io::Result<()> {
    for entry in fs::read_dir(place)?.flatten() {
        let is_run = entry
            .file_name()
            .as_encoded_bytes()
            .starts_with(PREFIX.as_bytes());
        // Of the entry itself: a link leads to what is nobody's run.
        let is_own = |about: fs::Metadata| about.is_dir() && about.uid() == user;
        if !is_run || !entry.metadata().is_ok_and(is_own) {
            continue;
        }
        // A folder without the file is of something else.
        let Ok(owner) = File::open(entry.path().join(OWNER_FILE)) else {
            continue;
        };
        if owner.try_lock().is_ok() {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn what_a_killed_run_has_left_goes_with_the_next_one_and_nothing_else_does() {
        let place = tempfile::tempdir().unwrap();
        let alive = RunFolder::below(place.path()).unwrap();
        // As the system leaves it: without a lock, and with all that is in it.
        let RunFolder { folder, _owner } = RunFolder::below(place.path()).unwrap();
        fs::write(folder.path().join("console"), b"words").unwrap();
        let killed = folder.keep();
        drop(_owner);
        let other = place.path().join("esm-of-somebody");
        fs::create_dir(&other).unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        fs::write(elsewhere.path().join(OWNER_FILE), b"").unwrap();
        symlink(elsewhere.path(), place.path().join("esm-link")).unwrap();

        let next = RunFolder::below(place.path()).unwrap();
        assert!(!killed.exists());
        for stays in [alive.path(), next.path(), &other, elsewhere.path()] {
            assert!(stays.exists(), "{}", stays.display());
        }
        assert!(elsewhere.path().join(OWNER_FILE).exists());
        let path = next.path().to_owned();
        drop(next);
        assert!(!path.exists());
    }
}
