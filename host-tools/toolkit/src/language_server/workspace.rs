//! Where an editor's files lie.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::lang::Store;

/// Where an editor's files lie.
pub trait Workspace: Store {
    /// Whether there is a file of that name.
    fn is_file(&self, path: &Path) -> bool;
    /// The `.esm` files in some folders and those in them, in order, and whether these are all: at
    /// most `most` files and folders of all kinds are looked at.
    fn sources(&self, folders: &BTreeSet<PathBuf>, most: usize) -> (Vec<PathBuf>, bool);
}
