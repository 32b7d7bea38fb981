//! Which files of the folders that an editor works in use which others: found out from their `use`
//! lines alone.
//!
//! A name that is declared in a file can be named by those files only that reach it by way of
//! `use`. So of a repository with thousands of
//! files every one is read, which is little work, and only those that matter are checked.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::Workspace;
use crate::lang::lexer::{Lexer, TokenKind as T};

/// How many files and folders are looked at, of all kinds. That many take about a second.
pub(super) const MAX_ENTRIES: usize = 200_000;

/// Who uses whom.
pub(super) struct UseIndex {
    /// By what tells files apart.
    files: BTreeMap<String, Indexed>,
    is_whole: bool,
}

/// A file that was read.
struct Indexed {
    path: PathBuf,
    /// The files that it uses, by what tells them apart.
    uses: Vec<String>,
}

impl UseIndex {
    /// Reads the `.esm` files in some folders and those that these use, open texts over those on
    /// disk.
    pub(super) fn of(
        folders: &BTreeSet<PathBuf>,
        workspace: &dyn Workspace,
        open: &BTreeMap<String, String>,
    ) -> Self {
        let (found, is_whole) = workspace.sources(folders, MAX_ENTRIES);
        let identity_of = |path: &Path| workspace.identity(&path.to_string_lossy());
        let mut index = UseIndex {
            files: BTreeMap::new(),
            is_whole,
        };
        let mut to_read: VecDeque<PathBuf> = found.into();
        while let Some(path) = to_read.pop_front() {
            let identity = identity_of(&path);
            if index.files.contains_key(&identity) {
                continue;
            }
            if index.files.len() >= MAX_ENTRIES {
                index.is_whole = false;
                break;
            }
            let used = match open.get(&identity) {
                Some(text) => used_paths(text),
                // A pipe would keep the reader waiting, and what cannot be read is read by nobody
                // else either.
                None if !workspace.is_file(&path) => Vec::new(),
                None => match workspace.read(&path.to_string_lossy()) {
                    Ok(bytes) => used_paths(&String::from_utf8_lossy(&bytes)),
                    Err(_) => Vec::new(),
                },
            };
            let folder = path.parent().unwrap_or(Path::new(""));
            let used: Vec<PathBuf> = used.iter().map(|path| folder.join(path)).collect();
            let uses = used.iter().map(|path| identity_of(path)).collect();
            to_read.extend(used.into_iter().filter(|path| workspace.is_file(path)));
            index.files.insert(identity, Indexed { path, uses });
        }
        index
    }

    /// Whether no file of the folders was left out.
    pub(super) fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// Files whose sets have a file, so that all files that reach it are in one of these sets:
    /// those that nobody uses, and one of each circle
    /// in which files use each other and nobody else does.
    pub(super) fn tops_above(&self, identity: &str) -> Vec<PathBuf> {
        let mut users: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        for (user, file) in &self.files {
            for used in file.uses.iter().filter(|used| *used != user) {
                users.entry(used).or_default().push(user);
            }
        }
        let users_of = |file: &str| users.get(file).map_or(&[][..], Vec::as_slice);
        let above = reached(identity, users_of);
        let uses_above = |file: &str| -> Vec<&str> {
            let file = self.files.get(file).map(|file| &file.uses);
            let uses = file.into_iter().flatten().map(String::as_str);
            uses.filter(|used| above.contains(used)).collect()
        };
        let mut covered: BTreeSet<&str> = BTreeSet::new();
        let mut tops = Vec::new();
        let unused = above.iter().filter(|file| users_of(file).is_empty());
        for &top in unused.chain(&above) {
            if covered.contains(top) {
                continue;
            }
            covered.extend(reached(top, uses_above));
            tops.extend(self.files.get(top).map(|file| file.path.clone()));
        }
        tops.sort();
        tops
    }
}

/// All that can be reached from a file, itself included.
fn reached<'f, L: AsRef<[&'f str]>>(
    from: &'f str,
    next: impl Fn(&'f str) -> L,
) -> BTreeSet<&'f str> {
    let mut reached = BTreeSet::from([from]);
    let mut to_visit = vec![from];
    while let Some(file) = to_visit.pop() {
        for &other in next(file).as_ref() {
            if reached.insert(other) {
                to_visit.push(other);
            }
        }
    }
    reached
}

/// The paths behind `use` in a text.
fn used_paths(text: &str) -> Vec<String> {
    if !text.contains("use") {
        return Vec::new();
    }
    let mut paths = Vec::new();
    let mut lexer = Lexer::new(text);
    let mut is_used = false;
    loop {
        let token = lexer.next_token();
        match token.kind {
            T::EndOfFile => return paths,
            T::Text if is_used => {
                let path = text.get(token.start as usize + 1..token.end as usize - 1);
                paths.push(path.unwrap_or_default().to_owned());
            }
            _ => {}
        }
        is_used = token.kind == T::Use;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stand_behind_use_alone() {
        let text = "use \"a.esm\"; // use \"b.esm\";\n task use \"c/d.esm\" \"e.esm\" use x;";
        assert_eq!(used_paths(text), ["a.esm", "c/d.esm"]);
        assert_eq!(used_paths("task T {}"), [] as [&str; 0]);
    }

    #[test]
    fn every_file_that_reaches_another_is_below_a_top() {
        // a -> b -> d, c -> d, e <-> f -> d, g alone.
        let index = |pairs: &[(&str, &[&str])]| UseIndex {
            files: pairs
                .iter()
                .map(|(name, uses)| {
                    let file = Indexed {
                        path: PathBuf::from(name),
                        uses: uses.iter().map(|it| (*it).to_owned()).collect(),
                    };
                    ((*name).to_owned(), file)
                })
                .collect(),
            is_whole: true,
        };
        let index = index(&[
            ("a", &["b"]),
            ("b", &["d"]),
            ("c", &["d", "missing"]),
            ("d", &[]),
            ("e", &["f"]),
            ("f", &["e", "d"]),
            ("g", &["g"]),
        ]);
        let tops = |file| {
            let tops = index.tops_above(file);
            tops.iter().map(|it| it.display().to_string()).collect()
        };
        let cases: [(&str, &[&str]); 6] = [
            ("d", &["a", "c", "e"]),
            ("b", &["a"]),
            ("a", &["a"]),
            ("f", &["e"]),
            ("g", &["g"]),
            ("missing", &["c"]),
        ];
        for (file, expected) in cases {
            let found: Vec<String> = tops(file);
            assert_eq!(found, expected, "{file}");
        }
    }
}
