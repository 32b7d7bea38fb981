//! Files on disk, for tests of what ships.

use std::fs;

use crate::lang::{LoadError, Store};

pub struct Disk;

impl Store for Disk {
    fn identity(&self, path: &str) -> String {
        fs::canonicalize(path).map_or_else(|_| path.to_owned(), |it| it.display().to_string())
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        fs::read(path).map_err(|cause| LoadError::Read {
            path: path.into(),
            cause,
        })
    }
}
