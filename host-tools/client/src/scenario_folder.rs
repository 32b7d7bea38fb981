//! The scenarios of a folder, each with its mission; goal files, too, which are named alike.
//!
//! A scenario belongs to the mission that its name begins with: `patrol.scenario` and
//! `patrol.halt.scenario` to `patrol.esm` beside them. One for which there is none beside it
//! belongs to the mission that its folder is named after: `patrol/halt.scenario` to `patrol.esm`
//! beside the folder.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Ending of scenarios.
pub const SCENARIO: &str = "scenario";
/// Ending of goal files.
pub const GOAL: &str = "goal";
/// Ending of missions.
const MISSION: &str = "esm";

/// A scenario or a goal file, and where its mission is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Case {
    /// The file.
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

/// All files with this ending in a folder and the folders in it, sorted by path. Hidden folders are
/// left out, and links to folders are not followed. A path that is itself a file is the only one.
///
/// # Errors
/// If a folder cannot be read.
pub fn cases(path: &Path, wanted: &str) -> Result<Vec<Case>, FolderError> {
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
            } else if path.is_file() && path.extension().is_some_and(|ending| ending == wanted) {
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

/// The files with this ending that belong to a mission, sorted by path: those beside it, and those
/// in the folder of its name.
///
/// # Errors
/// If a folder cannot be read.
pub fn of_mission(mission: &Path, wanted: &str) -> Result<Vec<PathBuf>, FolderError> {
    let folder = match mission.parent() {
        None => return Ok(Vec::new()),
        Some(here) if here.as_os_str().is_empty() => Path::new("."),
        Some(folder) => folder,
    };
    let failed = |cause| FolderError {
        folder: folder.to_owned(),
        cause,
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_file() && path.extension().is_some_and(|ending| ending == wanted) {
            found.push(path);
        }
    }
    let own = folder.join(mission.with_extension("").file_name().unwrap_or_default());
    if own.is_dir() {
        found.extend(cases(&own, wanted)?.into_iter().map(|case| case.scenario));
    }
    // A mission that is not there has nothing, and what belongs to no mission is not of this one.
    let identity = |path: PathBuf| fs::canonicalize(path).ok();
    let mission = identity(mission.to_owned());
    found.retain(|path| {
        let other = mission_of(path).and_then(identity);
        mission.is_some() && other == mission
    });
    found.sort();
    Ok(found)
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
        let found = cases(top, SCENARIO).unwrap();
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

    #[test]
    fn a_mission_finds_what_belongs_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let top = folder.path();
        fs::create_dir_all(top.join("guard/deep")).unwrap();
        for file in [
            "guard.esm",
            "guard.two.esm",
            "guard.goal",
            "guard.night.goal",
            "guard.two.goal",
            "guard.scenario",
            "other.goal",
            "guard/hall.goal",
            "guard/own.esm",
            "guard/own.goal",
            "guard/deep/far.goal",
        ] {
            fs::write(top.join(file), "").unwrap();
        }
        let found = of_mission(&top.join("guard.esm"), GOAL).unwrap();
        let relative =
            |path: &PathBuf| path.strip_prefix(top).unwrap().to_str().unwrap().to_owned();
        let found: Vec<_> = found.iter().map(relative).collect();
        assert_eq!(found, ["guard/hall.goal", "guard.goal", "guard.night.goal"]);
        assert!(
            of_mission(&top.join("guard/deep/none.esm"), GOAL)
                .unwrap()
                .is_empty()
        );
    }
}
