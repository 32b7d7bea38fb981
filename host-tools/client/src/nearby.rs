//! The file that somebody may have meant who named one that is not there.

use std::fs;
use std::path::{Component, Path, PathBuf};

use esm_toolkit::nearest::nearest;

/// As many folders upwards are looked into.
const MAX_UPWARDS: usize = 3;

/// As many entries of a folder are looked at.
const MAX_ENTRIES: usize = 1_000;

/// The file that is probably meant by `asked`, seen from `folder`, where nothing is there: one
/// with a name spelt alike, one in a folder spelt alike, or one of the same name in a folder
/// nearby. It is given as seen from `folder`, too.
pub fn nearby(folder: &Path, asked: &Path) -> Option<PathBuf> {
    let name = asked.file_name()?.to_str()?;
    let at = asked.parent().unwrap_or(Path::new(""));
    let is_there = |path: &PathBuf| folder.join(path).is_file();
    spelt_alike(folder, asked, at, name)
        .or_else(|| folder_spelt_alike(folder, at).map(|at| at.join(name)))
        .filter(is_there)
        .or_else(|| in_a_folder_nearby(folder, at, name))
}

/// A file beside it with a name spelt alike and the same ending.
fn spelt_alike(folder: &Path, asked: &Path, at: &Path, name: &str) -> Option<PathBuf> {
    let names = entries(&folder.join(at), |kind| kind.is_file());
    let alike = names
        .iter()
        .map(String::as_str)
        .filter(|found| Path::new(found).extension() == asked.extension());
    nearest(name, alike).map(|found| at.join(found))
}

/// A folder with a name spelt alike.
fn folder_spelt_alike(folder: &Path, at: &Path) -> Option<PathBuf> {
    let name = at.file_name()?.to_str()?;
    let above = at.parent().unwrap_or(Path::new(""));
    let names = entries(&folder.join(above), |kind| kind.is_dir());
    nearest(name, names.iter().map(String::as_str)).map(|found| above.join(found))
}

/// A file of the same name in a folder above, or in a folder beside one of these.
fn in_a_folder_nearby(folder: &Path, at: &Path, name: &str) -> Option<PathBuf> {
    let mut place = at.to_owned();
    for _ in 0..=MAX_UPWARDS {
        let inside = entries(&folder.join(&place), |kind| kind.is_dir());
        let candidates = std::iter::once(place.join(name))
            .chain(inside.iter().map(|inside| place.join(inside).join(name)));
        for candidate in candidates {
            if folder.join(&candidate).is_file() {
                return Some(candidate);
            }
        }
        place = above(&place);
    }
    None
}

/// The folder above, as short as it can be written.
fn above(place: &Path) -> PathBuf {
    match place.components().next_back() {
        Some(Component::Normal(_)) => place.parent().unwrap_or(Path::new("")).to_owned(),
        Some(Component::RootDir | Component::Prefix(_)) => place.to_owned(),
        _ => place.join(".."),
    }
}

/// Whether a file or folder with a name is passed over where sources are looked for: what is
/// hidden, and what cargo and npm fill.
pub fn is_nobodys_source(name: &str) -> bool {
    name.starts_with('.') || ["target", "node_modules"].contains(&name)
}

/// Names in a folder, in order, of what may be somebody's source.
fn entries(folder: &Path, is_wanted: impl Fn(fs::FileType) -> bool) -> Vec<String> {
    let folder = if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    };
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut names: Vec<String> = entries
        .flatten()
        .take(MAX_ENTRIES)
        .filter(|entry| entry.file_type().is_ok_and(&is_wanted))
        .filter_map(|entry| entry.file_name().into_string().ok())
        .filter(|name| !is_nobodys_source(name))
        .collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_probably_meant_is_found_nearby() {
        let top = tempfile::tempdir().unwrap();
        for folder in ["missions/square", "missions/worlds", "target/missions"] {
            fs::create_dir_all(top.path().join(folder)).unwrap();
        }
        for file in [
            "missions/rover.esm",
            "missions/patrol.esm",
            "missions/worlds/office.world",
            "target/missions/lost.esm",
        ] {
            fs::write(top.path().join(file), "").unwrap();
        }
        for (folder, asked, expected) in [
            ("", "missions/patrl.esm", Some("missions/patrol.esm")),
            ("", "misions/patrol.esm", Some("missions/patrol.esm")),
            ("", "patrol.esm", Some("missions/patrol.esm")),
            ("missions", "missions/rover.esm", Some("rover.esm")),
            ("missions/square", "rover.esm", Some("../rover.esm")),
            ("missions/square", "../rovre.esm", Some("../rover.esm")),
            ("missions", "office.world", Some("worlds/office.world")),
            (
                "missions/square",
                "office.world",
                Some("../worlds/office.world"),
            ),
            // What cargo fills is nobody's source, and another ending another kind of file.
            ("", "lost.esm", None),
            ("missions", "patrol.world", None),
            ("", "none.esm", None),
            ("", "..", None),
            ("", "", None),
        ] {
            let found = nearby(&top.path().join(folder), Path::new(asked));
            let is_meant = found.as_deref() == expected.map(Path::new);
            assert!(is_meant, "{folder:?} {asked:?}: {found:?}");
        }
    }
}
