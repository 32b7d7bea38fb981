//! A mission on its way to a robot: its blob, and the names in it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use esm_core::Verified;
use esm_link::message::LinkError;

use crate::link_client::error::refusal_with_names;
pub use esm_toolkit::mission_hash::hash_text;
use esm_toolkit::trace::directory::{Directory, NoDirectory};

/// A mission that a robot can be given.
#[derive(Clone, Debug)]
pub struct Mission {
    /// The file that it came from.
    pub file: PathBuf,
    /// Short name: the file's, without folder and ending.
    pub name: String,
    /// The blob.
    pub blob: Vec<u8>,
    /// The blob's hash.
    pub hash: u32,
    /// Whether its names are in the blob. Otherwise there are numbers in their place.
    pub has_names: bool,
    /// The names of everything in it.
    pub directory: Arc<Directory>,
    /// Names of the task types that it uses, in the blob's order.
    pub task_names: Vec<String>,
    /// Whether it has links to other processors.
    pub has_links: bool,
    /// Words of memory that its state takes on the robot.
    pub arena_words: usize,
}

impl Mission {
    /// Takes a mission that was compiled, or that a robot was asked for. `file` stands for it in
    /// messages.
    ///
    /// # Errors
    /// See [`NoDirectory`].
    pub fn new(file: &Path, verified: Verified<Vec<u8>>) -> Result<Self, NoDirectory> {
        let directory = Directory::of(&verified.tables())?;
        Ok(Self::with(file, verified, directory))
    }

    /// The same of a mission whose names may have been left out.
    ///
    /// # Errors
    /// [`NoDirectory::PathsTooLong`]
    pub fn named_or_numbered(
        file: &Path,
        verified: Verified<Vec<u8>>,
    ) -> Result<Self, NoDirectory> {
        let directory = Directory::named_or_numbered(&verified.tables())?;
        Ok(Self::with(file, verified, directory))
    }

    fn with(file: &Path, verified: Verified<Vec<u8>>, directory: Directory) -> Self {
        let tables = verified.tables();
        let task_names = tables
            .tasks()
            .map(|task| String::from_utf8_lossy(task.signature.name()).into_owned())
            .collect();
        let name = file
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        Mission {
            file: file.to_owned(),
            name,
            hash: verified.hash(),
            has_names: tables.names().is_some(),
            has_links: !tables.links().is_empty(),
            directory: Arc::new(directory),
            task_names,
            arena_words: verified.arena_words(),
            blob: verified.into_bytes(),
        }
    }

    /// A robot's refusal of this mission in words, with the mission's own names.
    pub fn refusal(&self, error: LinkError) -> String {
        let task_name = |index: usize| self.task_names.get(index).cloned();
        refusal_with_names(error, task_name)
    }

    /// The hash as it is shown.
    pub fn hash_text(&self) -> String {
        hash_text(self.hash)
    }
}
