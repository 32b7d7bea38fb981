//! Changes of the text that mend what is wrong: each one does so, for every wrong file that there
//! is and for what people write who know
//! other tools.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use esm_tests::guesses::{GUESSES, MISSION};
use host_tools::lang::{self, Checked, Code, Diagnostic, Fix, Severity};
use host_tools::time::work_limit;

/// How long start times are searched for.
const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);

type Files = Vec<(String, String)>;

fn check(files: &Files) -> Checked {
    let texts: Vec<(&str, &str)> = files
        .iter()
        .map(|(path, text)| (path.as_str(), text.as_str()))
        .collect();
    let mut checked = lang::load_texts(&texts);
    checked.lay_out(work_limit(LAY_OUT_LIMIT));
    checked
}

/// The files with a fix applied, from the last edit to the first.
fn mended(checked: &Checked, fix: &Fix) -> Files {
    let mut files: Files = checked
        .files
        .iter()
        .map(|file| (file.path.clone(), file.text.clone()))
        .collect();
    assert!(!fix.title.is_empty() && !fix.edits.is_empty(), "{fix:?}");
    for pair in fix.edits.windows(2) {
        let (first, second) = (pair[0].span, pair[1].span);
        assert!(
            first.file < second.file || first.end <= second.start,
            "places in order, that do not overlap: {fix:?}"
        );
    }
    for edit in fix.edits.iter().rev() {
        let text = &mut files[edit.span.file as usize].1;
        text.replace_range(edit.span.start as usize..edit.span.end as usize, &edit.text);
    }
    files
}

/// What tells one diagnostic from another, whatever moved.
fn told(checked: &Checked) -> Vec<(&'static str, String)> {
    let mut told: Vec<_> = checked
        .diagnostics
        .iter()
        .map(|found| (found.code.as_str(), found.message.clone()))
        .collect();
    told.sort();
    told
}

fn count(checked: &Checked, of: &Diagnostic) -> usize {
    let same = |found: &&Diagnostic| found.code == of.code && found.message == of.message;
    checked.diagnostics.iter().filter(same).count()
}

#[test]
fn each_guess_is_told_how_it_is_written_and_one_change_makes_it_so() {
    let right = check(&vec![("mission.esm".into(), MISSION.into())]);
    let errors = right.diagnostics.iter();
    let errors = errors.filter(|it| it.severity() == Severity::Error);
    assert_eq!(errors.count(), 0, "{}", right.render(false));
    let nothing = told(&right);
    let mut wrong = String::new();
    for guess in GUESSES {
        let checked = check(&vec![("mission.esm".into(), guess.text())]);
        let new = checked.diagnostics.iter();
        let new: Vec<&Diagnostic> = new
            .filter(|it| !nothing.contains(&(it.code.as_str(), it.message.clone())))
            .collect();
        let text = checked.render(false);
        let Some(found) = new.iter().find(|it| it.text().contains(guess.told)) else {
            writeln!(
                wrong,
                "─── {}\n  is not told `{}`:\n{text}",
                guess.wrong, guess.told
            )
            .unwrap();
            continue;
        };
        if !guess.has_fix {
            continue;
        }
        // Some are two mistakes, each with its own change.
        let mut files: Files = vec![("mission.esm".into(), guess.text())];
        let mut left = Some((*found).clone());
        for _ in 0..3 {
            let Some(fix) = left.as_ref().and_then(|it| it.fixes.first()) else {
                break;
            };
            files = mended(&check(&files), fix);
            let now = check(&files);
            left = now
                .diagnostics
                .iter()
                .find(|it| !nothing.contains(&(it.code.as_str(), it.message.clone())))
                .cloned();
        }
        if left.is_some() {
            let after = &files[0].1;
            let now = check(&files).render(false);
            writeln!(wrong, "─── {}\n{text}is not mended:\n{now}", guess.wrong).unwrap();
            let changed = after
                .lines()
                .zip(guess.text().lines().map(str::to_owned).collect::<Vec<_>>());
            for (new, old) in changed.filter(|(new, old)| new != old).take(3) {
                writeln!(wrong, "  {old}\n  became {new}").unwrap();
            }
        }
        let errors = new.iter().filter(|it| it.severity() == Severity::Error);
        let messages: BTreeSet<&str> = errors.map(|it| it.message.as_str()).collect();
        if messages.len() > 2 {
            writeln!(wrong, "─── {}\n  costs a page:\n{text}", guess.wrong).unwrap();
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

/// The files of the cases in a folder: each alone, or a folder with a `main.esm`.
fn cases(folder: &Path, found: &mut Vec<Vec<PathBuf>>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    entries.sort();
    let main = folder.join("main.esm");
    if entries.contains(&main) {
        let others = entries
            .into_iter()
            .filter(|path| path != &main && path.is_file());
        found.push([main.clone()].into_iter().chain(others).collect());
        return;
    }
    for entry in entries {
        if entry.is_dir() {
            cases(&entry, found);
        } else if entry.extension().is_some_and(|it| it == "esm") {
            found.push(vec![entry]);
        }
    }
}

#[test]
fn each_change_makes_go_away_what_it_is_for() {
    let folder = Path::new("cases/wrong");
    let mut all = Vec::new();
    cases(folder, &mut all);
    let (mut wrong, mut fixes) = (String::new(), 0);
    let mut fixed = BTreeSet::new();
    for case in &all {
        let mut checked = match lang::load(&case[0]) {
            Ok(checked) => checked,
            Err(cause) => panic!("{}: {cause}", case[0].display()),
        };
        checked.lay_out(work_limit(LAY_OUT_LIMIT));
        let on_disk = |path: &str| fs::read(path).is_ok_and(|it| std::str::from_utf8(&it).is_ok());
        if !checked.files.iter().all(|file| on_disk(&file.path)) {
            continue;
        }
        for found in checked.diagnostics.iter() {
            for fix in &found.fixes {
                fixes += 1;
                fixed.insert(found.code.as_str());
                let after = check(&mended(&checked, fix));
                if count(&after, found) >= count(&checked, found) {
                    let name = case[0].strip_prefix(folder).unwrap().display();
                    writeln!(
                        wrong,
                        "─── {name}: {} {}\n  {fix:?}\n{}",
                        found.code,
                        found.text(),
                        after.render(false)
                    )
                    .unwrap();
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
    assert!(fixes > 240, "{fixes}");
    let page = fs::read_to_string(esm_tests::command::root().join("docs/src/editor.md")).unwrap();
    for code in Code::ALL {
        let row = page
            .lines()
            .find_map(|line| line.strip_prefix(&format!("| {code} | ")));
        let row = row.unwrap_or_else(|| panic!("the book says nothing of fixes for {code}"));
        let has_none = row.starts_with("none: ");
        assert_eq!(fixed.contains(code.as_str()), !has_none, "{code}: {row}");
    }
}
