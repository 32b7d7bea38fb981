//! The page's files, and the missions that it opens.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;

/// The missions and worlds that ship, by their paths in the page.
const SHIPPED: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/missions.rs"));

/// What the page is made of: built by `cargo xtask studio`, which CI holds against its sources.
const PAGE: &[(&str, &str, &[u8])] = &[
    (
        "index.html",
        "text/html; charset=utf-8",
        include_bytes!("../../../shipped/studio/index.html"),
    ),
    (
        "studio.css",
        "text/css; charset=utf-8",
        include_bytes!("../../../shipped/studio/studio.css"),
    ),
    (
        "studio.js",
        "text/javascript; charset=utf-8",
        include_bytes!("../../../shipped/studio/studio.js"),
    ),
    (
        "worker.js",
        "text/javascript; charset=utf-8",
        include_bytes!("../../../shipped/studio/worker.js"),
    ),
    (
        "licenses.txt",
        "text/plain; charset=utf-8",
        include_bytes!("../../../shipped/studio/licenses.txt"),
    ),
    // Packed as it is: the page unpacks it itself, so that any server will do.
    (
        "engine.wasm.gz",
        "application/octet-stream",
        include_bytes!("../../../shipped/studio/engine.wasm.gz"),
    ),
];

/// Where the page finds missions and worlds.
const CATALOGUE: &str = "files.json";

/// Texts that a person has opened, by their paths in the page.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Opened {
    /// All of them.
    pub files: BTreeMap<String, String>,
    /// The one to be shown at first.
    pub first: Option<String>,
}

/// What the page opens.
#[derive(Serialize)]
struct Catalogue<'a> {
    files: BTreeMap<&'a str, &'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    open: Option<&'a str>,
    /// Whether the command is connected to a robot.
    live: bool,
}

/// The page, with what it opens.
#[derive(Clone, Debug)]
pub struct Site {
    catalogue: Vec<u8>,
}

impl Site {
    /// The page with the missions that ship, and these; and whether it shows a robot that is
    /// connected.
    ///
    /// # Errors
    /// What cannot be JSON: nothing, for all of it is text.
    pub fn with(opened: &Opened, live: bool) -> Result<Self, serde_json::Error> {
        let shipped = SHIPPED.iter().copied();
        let own = (opened.files.iter()).map(|(path, text)| (path.as_str(), text.as_str()));
        let catalogue = Catalogue {
            files: shipped.chain(own).collect(),
            open: opened.first.as_deref(),
            live,
        };
        Ok(Site {
            catalogue: serde_json::to_vec(&catalogue)?,
        })
    }

    /// Its files: name, type, bytes.
    pub fn files(&self) -> impl Iterator<Item = (&str, &str, &[u8])> {
        let catalogue = (CATALOGUE, "application/json", self.catalogue.as_slice());
        PAGE.iter().copied().chain([catalogue])
    }

    /// The file of a name: its type and its bytes. The first of them has no name, too.
    pub fn file(&self, name: &str) -> Option<(&str, &[u8])> {
        let name = if name.is_empty() { "index.html" } else { name };
        let mut files = self.files();
        let found = files.find(|file| file.0 == name)?;
        Some((found.1, found.2))
    }
}

/// The paths in the page of files on disk: below the folder that they have in common.
pub fn paths_in_page(files: &[PathBuf]) -> Vec<String> {
    let mut common: Option<&Path> = None;
    for file in files {
        let folder = file.parent().unwrap_or(file);
        common = Some(match common {
            None => folder,
            Some(before) => (before.ancestors())
                .find(|above| folder.starts_with(above))
                .unwrap_or(before),
        });
    }
    let common = common.unwrap_or(Path::new(""));
    let below = |file: &PathBuf| {
        let rest = file.strip_prefix(common).unwrap_or(file);
        let parts: Vec<_> = rest.iter().map(|part| part.to_string_lossy()).collect();
        format!("/disk/{}", parts.join("/"))
    };
    files.iter().map(below).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_keep_their_places_to_each_other() {
        let paths = |files: &[&str]| {
            let files: Vec<PathBuf> = files.iter().map(PathBuf::from).collect();
            paths_in_page(&files)
        };
        assert_eq!(paths(&["/a/b/c.esm"]), ["/disk/c.esm"]);
        assert_eq!(
            paths(&["/a/b/c.esm", "/a/d.esm", "/a/b/e/f.esm"]),
            ["/disk/b/c.esm", "/disk/d.esm", "/disk/b/e/f.esm"]
        );
        assert_eq!(paths(&[]), [] as [&str; 0]);
    }

    #[test]
    fn the_page_has_the_shipped_missions_and_what_was_opened() {
        let opened = Opened {
            files: BTreeMap::from([("/disk/a.esm".to_owned(), "machine A { }".to_owned())]),
            first: Some("/disk/a.esm".to_owned()),
        };
        let site = Site::with(&opened, false).unwrap();
        let (kind, bytes) = site.file(CATALOGUE).unwrap();
        assert_eq!(kind, "application/json");
        let read: serde_json::Value = serde_json::from_slice(bytes).unwrap();
        assert_eq!(read["open"], "/disk/a.esm");
        assert_eq!(read["live"], false);
        assert_eq!(read["files"]["/disk/a.esm"], "machine A { }");
        let patrol = read["files"]["/missions/patrol.esm"].as_str().unwrap();
        assert!(patrol.contains("machine Patrol"));
        assert!(read["files"]["/missions/worlds/office.world"].is_string());
        assert_eq!(site.file(""), site.file("index.html"));
        assert_eq!(site.file("../Cargo.toml"), None);
    }
}
