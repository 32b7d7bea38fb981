//! The scenarios of a folder, each with its mission.
//!
//! A scenario belongs to the mission that its name begins with: `patrol.scenario` and
//! `patrol.halt.scenario` to `patrol.esm` beside them. One for which there is none beside it
//! belongs to the mission that its folder is named after: `patrol/halt.scenario` to `patrol.esm`
//! beside the folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Ending of the files that are looked for.
pub const SCENARIO: &str = "scenario";
/// Ending of missions.
const MISSION: &str = "esm";

/// A scenario, and where its mission is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Case {
    /// The scenario's file.
    pub scenario: PathBuf,
    /// The mission's file; `None` where there is none that it belongs to.
    pub mission: Option<PathBuf>,
}

/// A folder that could not be read.
#[derive(Debug, thiserror::Error)]
#[error("cannot read the folder {}: {cause}", .folder.display())]
pub struct FolderError {
    /// The folder.
    pub folder: PathBuf,
    /// Why.
    #[source]
    pub cause: io::Error,
}

/// All scenarios in a folder and the folders in it, sorted by path. Hidden folders are left out,
/// and links to folders are not followed. A path that is itself a scenario is the only one.
///
/// # Errors
/// If a folder cannot be read.
pub fn cases(path: &Path) -> Result<Vec<Case>, FolderError> {
    if path.is_file() {
        let scenario = path.to_owned();
        let mission = mission_of(path);
        return Ok(vec![Case { scenario, mission }]);
    }
    let mut found = Vec::new();
    let mut open = vec![path.to_owned()];
    while let Some(folder) = open.pop() {
        let failed = |cause| FolderError {
            folder: folder.clone(),
            cause,
        };
        for entry in fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let kind = entry.file_type().map_err(failed)?;
            let path = entry.path();
            let is_hidden = entry.file_name().as_encoded_bytes().starts_with(b".");
            if kind.is_dir() && !is_hidden {
                open.push(path);
            } else if path.is_file() && path.extension().is_some_and(|ending| ending == SCENARIO) {
                found.push(path);
            }
        }
    }
    found.sort();
    let case = |scenario: PathBuf| Case {
        mission: mission_of(&scenario),
        scenario,
    };
    Ok(found.into_iter().map(case).collect())
}

/// The mission that a scenario belongs to, if there is one.
fn mission_of(scenario: &Path) -> Option<PathBuf> {
    candidates(scenario).into_iter().find(|path| path.is_file())
}

/// Where the mission of a scenario is looked for, the likeliest first.
pub fn candidates(scenario: &Path) -> Vec<PathBuf> {
    let mut candidates = Vec::new();
    let mut stem = scenario.with_extension("");
    // `a.b.scenario` can be one of `a.b.esm` too.
    loop {
        let mut file = stem.clone().into_os_string();
        file.push(".");
        file.push(MISSION);
        candidates.push(PathBuf::from(file));
        if stem.extension().is_none() {
            break;
        }
        stem.set_extension("");
    }
    // An absolute path, since `.` and `..` have no name.
    let folder = scenario.parent().and_then(|folder| match folder {
        here if here.as_os_str().is_empty() => fs::canonicalize(".").ok(),
        here if here.file_name().is_none() => fs::canonicalize(here).ok(),
        here => Some(here.to_owned()),
    });
    if let Some(folder) = folder.filter(|folder| folder.file_name().is_some()) {
        let mut file = folder.into_os_string();
        file.push(".");
        file.push(MISSION);
        candidates.push(PathBuf::from(file));
    }
    candidates
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenarios_find_their_missions() {
        let folder = tempfile::tempdir().unwrap();
        let top = folder.path();
        fs::create_dir_all(top.join("patrol/deep")).unwrap();
        fs::create_dir_all(top.join(".git")).unwrap();
        let files = [
            "patrol.esm",
            "patrol.v2.esm",
            "patrol.scenario",
            "patrol.halt.scenario",
            "patrol.v2.halt.scenario",
            "patrol/low.scenario",
            "patrol/own.esm",
            "patrol/own.scenario",
            "patrol/deep/lost.scenario",
            "alone.scenario",
            ".git/hidden.scenario",
            "notes.txt",
        ];
        for file in files {
            fs::write(top.join(file), "").unwrap();
        }
        let found = cases(top).unwrap();
        let relative = |path: &Path| path.strip_prefix(top).unwrap().to_str().unwrap().to_owned();
        let found: Vec<_> = found
            .iter()
            .map(|case| {
                (
                    relative(&case.scenario),
                    case.mission.as_deref().map(relative),
                )
            })
            .collect();
        let expected = [
            ("alone.scenario", None),
            ("patrol/deep/lost.scenario", None),
            ("patrol/low.scenario", Some("patrol.esm")),
            ("patrol/own.scenario", Some("patrol/own.esm")),
            ("patrol.halt.scenario", Some("patrol.esm")),
            ("patrol.scenario", Some("patrol.esm")),
            ("patrol.v2.halt.scenario", Some("patrol.v2.esm")),
        ];
        let expected =
            expected.map(|(scenario, mission)| (scenario.to_owned(), mission.map(str::to_owned)));
        assert_eq!(found, expected);
    }
}
