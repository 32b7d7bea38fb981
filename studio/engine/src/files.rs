//! The page's files, by absolute path.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Component, Path, PathBuf};

use esm_toolkit::lang::{LoadError, Store};
use esm_toolkit::language_server::Workspace;

/// The files.
#[derive(Default)]
pub struct Files(RefCell<BTreeMap<String, String>>);

impl Files {
    /// Files without any.
    pub const fn new() -> Self {
        Files(RefCell::new(BTreeMap::new()))
    }

    /// These, and no others.
    pub fn replace(&self, files: BTreeMap<String, String>) {
        let plain = |(path, text): (String, String)| (self.identity(&path), text);
        *self.0.borrow_mut() = files.into_iter().map(plain).collect();
    }
}

impl Store for Files {
    fn identity(&self, path: &str) -> String {
        let mut parts: Vec<&str> = Vec::new();
        for component in Path::new(path).components() {
            match component {
                Component::Normal(part) => parts.push(part.to_str().unwrap_or_default()),
                Component::ParentDir => drop(parts.pop()),
                Component::RootDir | Component::CurDir | Component::Prefix(_) => {}
            }
        }
        format!("/{}", parts.join("/"))
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        let files = self.0.borrow();
        match files.get(&self.identity(path)) {
            Some(text) => Ok(text.as_bytes().to_vec()),
            None => Err(LoadError::Read {
                path: PathBuf::from(path),
                cause: io::Error::from(io::ErrorKind::NotFound),
            }),
        }
    }
}

impl Workspace for Files {
    fn is_file(&self, path: &Path) -> bool {
        let path = self.identity(&path.to_string_lossy());
        self.0.borrow().contains_key(&path)
    }

    fn sources(&self, folders: &BTreeSet<PathBuf>, most: usize) -> (Vec<PathBuf>, bool) {
        let files = self.0.borrow();
        let is_within = |path: &Path| folders.iter().any(|folder| path.starts_with(folder));
        let sources: Vec<PathBuf> = (files.keys())
            .map(PathBuf::from)
            .filter(|path| path.extension().is_some_and(|it| it == "esm") && is_within(path))
            .collect();
        let all = sources.len() <= most;
        (sources.into_iter().take(most).collect(), all)
    }
}
