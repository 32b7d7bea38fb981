//! The collection of wrong and right files in `cases/`: each says in comments what `esm check` must
//! find in it, and nothing else may be found.
//!
//! ```text
//!     initial -> Cruize;
//! //             ^ E002 ~ did you mean `Cruise`      the line above, the column of the first `^`; `~` and what message or hint must contain
//! // expect E001 7:5 ~ expected `;`                  the same by numbers, for places that no comment can stand under
//! // expect E001 7:*                                 any column
//! // as build                                        a machine is demanded, as `esm build` does
//! // with warnings                                   warnings are compared, too, as they are in a file that expects some
//! ```
//! A folder with a `main.esm` is one case, whose other files are there to be used by it; each of
//! them says what is found in itself.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use host_tools::lang::{self, Checked, Diagnostic, Severity};
use host_tools::time::work_limit;

/// How long start times are searched for. Every table of slots here is decided at once.
const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);

/// What a file says is found in it.
#[derive(Debug)]
struct Expectation {
    code: String,
    line: u32,
    /// None where any column will do.
    col: Option<u32>,
    /// What message and hint must contain.
    parts: Vec<String>,
}

/// Reads `CODE ~ part ~ part`.
fn code_and_parts(text: &str) -> (String, Vec<String>) {
    let mut parts = text.split(" ~ ").map(|part| part.trim().to_owned());
    (parts.next().unwrap_or_default(), parts.collect())
}

/// The expectations in the comments of a file. A comment that begins like one and is none is a
/// mistake of the case.
fn expectations(text: &str) -> Result<Vec<Expectation>, String> {
    let mut found = Vec::new();
    let mut line_above = 0;
    for (line, number) in text.lines().zip(1..) {
        let Some(comment) = line.trim_start().strip_prefix("//") else {
            line_above = number;
            continue;
        };
        let comment = comment.trim();
        let wrong = || format!("line {number} is no expectation: {line}");
        if comment.starts_with('^') {
            let col = line
                .chars()
                .position(|letter| letter == '^')
                .map(|col| col as u32 + 1);
            let (code, parts) = code_and_parts(comment.trim_start_matches('^'));
            let line = line_above;
            found.push(Expectation {
                code,
                line,
                col,
                parts,
            });
        } else if let Some(expected) = comment.strip_prefix("expect ") {
            let (head, parts) = code_and_parts(expected);
            let (code, place) = head.split_once(' ').ok_or_else(wrong)?;
            let (line, col) = place.split_once(':').ok_or_else(wrong)?;
            let line = line.parse().map_err(|_| wrong())?;
            let col = match col {
                "*" => None,
                col => Some(col.parse().map_err(|_| wrong())?),
            };
            let code = code.to_owned();
            found.push(Expectation {
                code,
                line,
                col,
                parts,
            });
        } else {
            line_above = number;
        }
    }
    let known = |code: &str| lang::Code::ALL.iter().any(|known| known.as_str() == code);
    match found.iter().find(|expectation| !known(&expectation.code)) {
        Some(expectation) => Err(format!("there is no code `{}`", expectation.code)),
        None => Ok(found),
    }
}

/// What `esm check` finds, or `esm build` where the file asks for that.
fn check(path: &Path) -> Result<Checked, String> {
    let mut checked = lang::load(path).map_err(|error| error.to_string())?;
    let as_build = checked
        .files
        .first()
        .is_some_and(|file| file.text.lines().any(|line| line == "// as build"));
    if as_build {
        checked.require_machine();
    }
    checked.lay_out(work_limit(LAY_OUT_LIMIT));
    Ok(checked)
}

/// How what was found differs from what was expected; nothing where they agree.
fn difference(path: &Path) -> Result<String, String> {
    let checked = check(path)?;
    let positions = lang::Positions::new(&checked.files);
    // By file, line and code; columns are compared below, so that a wrong one is told beside the
    // right one.
    let mut found: BTreeMap<u32, Vec<(&Diagnostic, lang::Position)>> = BTreeMap::new();
    for diagnostic in &checked.diagnostics {
        found
            .entry(diagnostic.span.file)
            .or_default()
            .push((diagnostic, positions.of(diagnostic.span)));
    }
    let mut told = String::new();
    let looks_at_warnings = checked.files.iter().any(|file| {
        file.text.lines().any(|line| line == "// with warnings")
            || expectations(&file.text)
                .is_ok_and(|found| found.iter().any(|found| found.code.starts_with('W')))
    });
    for (file, index) in checked.files.iter().zip(0..) {
        let mut found = found.remove(&index).unwrap_or_default();
        for expectation in expectations(&file.text)? {
            let Expectation {
                code,
                line,
                col,
                parts,
            } = &expectation;
            let at = found.iter().position(|(diagnostic, place)| {
                diagnostic.code.as_str() == code
                    && place.line == *line
                    && col.is_none_or(|col| place.col == col)
            });
            let Some(at) = at else {
                let col = col.map_or("*".to_owned(), |col| col.to_string());
                writeln!(told, "  not found: {code} {line}:{col} {parts:?}").unwrap();
                continue;
            };
            let (diagnostic, _) = found.remove(at);
            let text = diagnostic.text();
            for part in parts.iter().filter(|part| !text.contains(*part)) {
                writeln!(told, "  {code} {line} says `{text}`, not `{part}`").unwrap();
            }
        }
        for (diagnostic, place) in found {
            if diagnostic.severity() == Severity::Warning && !looks_at_warnings {
                continue;
            }
            let (code, lang::Position { line, col, .. }, text) =
                (diagnostic.code, place, diagnostic.text());
            writeln!(told, "  not expected: {code} {line}:{col} {text}").unwrap();
        }
    }
    Ok(told)
}

/// The cases in a folder and the folders inside it, by name.
fn cases(folder: &Path) -> Vec<PathBuf> {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    entries.sort();
    let main = folder.join("main.esm");
    if entries.contains(&main) {
        return vec![main];
    }
    let mut found = Vec::new();
    for entry in entries {
        if entry.is_dir() {
            found.extend(cases(&entry));
        } else if entry
            .extension()
            .is_some_and(|extension| extension == "esm")
        {
            found.push(entry);
        }
    }
    found
}

fn folder(name: &str) -> PathBuf {
    Path::new("cases").join(name)
}

/// Holds all cases of a folder against what they say, and tells all differences at once.
fn hold(name: &str, least: usize) {
    let folder = folder(name);
    let cases = cases(&folder);
    assert!(cases.len() >= least, "only {} cases in {name}", cases.len());
    let mut told = String::new();
    let mut differing = 0;
    for case in &cases {
        let difference = difference(case).unwrap_or_else(|cause| format!("  {cause}\n"));
        if !difference.is_empty() {
            differing += 1;
            writeln!(told, "{}", case.strip_prefix(&folder).unwrap().display()).unwrap();
            told += &difference;
        }
    }
    assert!(
        told.is_empty(),
        "{differing} of {} cases in {name} differ:\n{told}",
        cases.len()
    );
}

#[test]
fn wrong_files_are_told_what_is_wrong_and_nothing_else() {
    hold("wrong", 480);
}

#[test]
fn right_files_are_told_nothing() {
    hold("right", 20);
}
