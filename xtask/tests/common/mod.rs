//! Folders that look like a checkout, for as long as a test needs them.

use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder of its own for a test, which is removed at its end.
pub struct Folder(pub PathBuf);

impl Folder {
    /// Makes it, empty.
    pub fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("xtask-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        Folder(folder)
    }

    /// Makes it, with what the top of a checkout is known by.
    pub fn checkout(name: &str) -> Self {
        let folder = Folder::new(name);
        folder.write("xtask/src/main.rs", "");
        folder
    }

    /// Writes a file, and the folders above it.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The program `xtask`, in a folder.
pub fn xtask(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO_BIN_EXE_xtask").unwrap());
    command.args(arguments).current_dir(folder);
    command
}
