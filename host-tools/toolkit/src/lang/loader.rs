//! Which files belong to a set: the one that was asked for, and all that they `use`.

use std::collections::{BTreeMap, HashMap};
use std::path::{Component, Path, PathBuf};

use crate::model::{SourceFile, Span};

use super::diagnostic::{Code, Diagnostic, Fix, Sink};
use super::parser;
use super::source::LoadError;
use super::tree::{File, Use};

/// Where files come from.
pub trait Store {
    /// What tells one file from another, however it is named.
    fn identity(&self, path: &str) -> String;
    /// The whole file.
    ///
    /// # Errors
    /// It cannot be read, is no file, or is too long.
    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError>;
    /// Where `path`, seen from a folder, names no file: the path of one that may have been meant.
    fn nearby(&self, _folder: &Path, _path: &Path) -> Option<PathBuf> {
        None
    }
}

/// Files under texts that somebody has open and has perhaps not saved.
#[derive(Clone, Copy)]
pub struct Overlay<'t> {
    below: &'t dyn Store,
    /// By [`Store::identity`].
    open: &'t BTreeMap<String, String>,
}

impl<'t> Overlay<'t> {
    /// Texts that are `open`, by [`Store::identity`], over the files `below`.
    pub fn new(below: &'t dyn Store, open: &'t BTreeMap<String, String>) -> Self {
        Overlay { below, open }
    }
}

impl Store for Overlay<'_> {
    fn identity(&self, path: &str) -> String {
        self.below.identity(path)
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        match self.open.get(&self.identity(path)) {
            Some(text) => Ok(text.as_bytes().to_vec()),
            None => self.below.read(path),
        }
    }

    fn nearby(&self, folder: &Path, path: &Path) -> Option<PathBuf> {
        self.below.nearby(folder, path)
    }
}

/// Files in memory, by path.
pub(super) struct Memory<'t> {
    files: HashMap<String, &'t [u8]>,
}

impl<'t> Memory<'t> {
    pub(super) fn new(files: &[(&str, &'t [u8])]) -> Self {
        Memory {
            files: files
                .iter()
                .map(|&(path, bytes)| (plain(Path::new(path)), bytes))
                .collect(),
        }
    }
}

impl Store for Memory<'_> {
    fn identity(&self, path: &str) -> String {
        plain(Path::new(path))
    }

    fn read(&self, path: &str) -> Result<Vec<u8>, LoadError> {
        match self.files.get(&plain(Path::new(path))) {
            Some(bytes) => Ok(bytes.to_vec()),
            None => Err(LoadError::Read {
                path: PathBuf::from(path),
                cause: std::io::ErrorKind::NotFound.into(),
            }),
        }
    }
}

/// A set of files with their trees.
#[derive(Default)]
pub(super) struct Set {
    pub(super) files: Vec<SourceFile>,
    pub(super) trees: Vec<File>,
    /// Whether a file of the set could not be read, or not rightly.
    pub(super) lacks_files: bool,
}

/// A file whose `use` are being followed.
struct Open {
    file: usize,
    next_use: usize,
}

/// Reads a file and all that it uses, in the order of their first use, each once.
///
/// # Errors
/// The first file cannot be read.
pub(super) fn load(path: &str, store: &dyn Store, sink: &mut Sink) -> Result<Set, LoadError> {
    let mut set = Set::default();
    let bytes = store.read(path)?;
    let mut indices = HashMap::from([(store.identity(path), 0)]);
    set.add(path.to_owned(), &bytes, sink);
    // Files that use each other in a row may be many: the way down is kept here, not on the stack.
    let mut way = vec![Open {
        file: 0,
        next_use: 0,
    }];
    while let Some(open) = way.last_mut() {
        let file = open.file;
        let used = set
            .trees
            .get(file)
            .and_then(|tree| tree.uses.get(open.next_use))
            .copied();
        open.next_use += 1;
        let Some(used) = used else {
            way.pop();
            continue;
        };
        let Some(path) = set.path_of(file, used) else {
            // Its path is broken, which is reported.
            set.lacks_files = true;
            continue;
        };
        let identity = store.identity(&path);
        match indices.get(&identity) {
            Some(index) if way.iter().any(|open| open.file == *index) => {
                let message = told_circle(&set, &way, *index, &path);
                sink.push(
                    Diagnostic::new(Code::E013, used.span, message).hint(
                        "remove this `use`: everything in a set of files sees everything else",
                    ),
                );
            }
            Some(_) => {}
            None => match store.read(&path) {
                Ok(bytes) => {
                    let index = set.files.len();
                    indices.insert(identity, index);
                    set.add(path, &bytes, sink);
                    way.push(Open {
                        file: index,
                        next_use: 0,
                    });
                }
                Err(error) => {
                    set.lacks_files = true;
                    let meant = set.meant(file, used, store);
                    sink.push(unread(used, &error, meant.as_deref()));
                }
            },
        }
    }
    Ok(set)
}

impl Set {
    /// Parses one more file.
    pub(super) fn add(&mut self, path: String, bytes: &[u8], sink: &mut Sink) {
        let index = self.files.len() as u32;
        let bytes = bytes
            .strip_prefix(BYTE_ORDER_MARK.as_bytes())
            .unwrap_or(bytes);
        let text = match std::str::from_utf8(bytes) {
            Ok(text) => {
                self.trees.push(parser::parse(text, index, sink));
                text.to_owned()
            }
            Err(error) => {
                let start = error.valid_up_to() as u32;
                let span = Span {
                    file: index,
                    start,
                    end: start + char::REPLACEMENT_CHARACTER.len_utf8() as u32,
                };
                sink.push(
                    Diagnostic::new(Code::E001, span, "the file is not UTF-8 from here on")
                        .hint("save it as UTF-8"),
                );
                // What else seems wrong with it may come from that alone.
                let text = String::from_utf8_lossy(bytes).into_owned();
                let tree = parser::parse(&text, index, &mut Sink::default());
                self.trees.push(tree);
                self.lacks_files = true;
                text
            }
        };
        self.files.push(SourceFile { path, text });
    }

    /// The path that a `use` names, seen from where the first file is seen.
    fn path_of(&self, file: usize, used: Use) -> Option<String> {
        let (folder, path) = self.written(file, used)?;
        Some(plain(&folder.join(path)))
    }

    /// The folder of a file, and the path that a `use` in it names.
    fn written(&self, file: usize, used: Use) -> Option<(&Path, &Path)> {
        let file = self.files.get(file)?;
        let span = used.path?;
        let path = file.text.get(span.start as usize..span.end as usize)?;
        let folder = Path::new(&file.path).parent().unwrap_or(Path::new(""));
        Some((folder, Path::new(path)))
    }

    /// The path that may have been meant by one that names no file.
    fn meant(&self, file: usize, used: Use, store: &dyn Store) -> Option<String> {
        let (folder, path) = self.written(file, used)?;
        let meant = store.nearby(folder, path)?;
        // What is in the set already was not meant: least of all the file itself.
        let whole = plain(&folder.join(&meant));
        let is_new = self.files.iter().all(|known| known.path != whole);
        is_new.then(|| plain(&meant))
    }
}

/// What is said of a used file that cannot be read.
fn unread(used: Use, error: &LoadError, meant: Option<&str>) -> Diagnostic {
    const RULE: &str = "a path in `use` is relative to the file in which it stands";
    let diagnostic = Diagnostic::new(Code::E013, used.span, error.to_string());
    match (meant, used.path) {
        (Some(meant), Some(place)) => diagnostic
            .hint(format!("{RULE}: did you mean `use \"{meant}\";`?"))
            .fix(Fix::write(place, meant)),
        _ => diagnostic.hint(RULE),
    }
}

/// What some editors put before the first character of a UTF-8 file.
const BYTE_ORDER_MARK: &str = "\u{FEFF}";

/// A file that uses itself, by way of those that are open behind it.
fn told_circle(set: &Set, way: &[Open], file: usize, path: &str) -> String {
    /// More files of a circle than this help nobody.
    const MAX_TOLD: usize = 5;
    let mut behind = way
        .iter()
        .skip_while(|open| open.file != file)
        .skip(1)
        .filter_map(|open| set.files.get(open.file))
        .map(|file| file_name(&file.path));
    let told: Vec<&str> = behind.by_ref().take(MAX_TOLD).collect();
    let rest = if behind.next().is_some() {
        " and more"
    } else {
        ""
    };
    if told.is_empty() {
        format!("`{}` uses itself", file_name(path))
    } else {
        format!(
            "`{}` uses itself by way of {}{rest}",
            file_name(path),
            told.join(", ")
        )
    }
}

/// The last part of a path.
fn file_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// A path without `.` and without `name/..`, with `/` between its parts.
fn plain(path: &Path) -> String {
    let mut parts: Vec<String> = Vec::new();
    let mut root = String::new();
    for component in path.components() {
        match component {
            Component::Prefix(prefix) => root = prefix.as_os_str().to_string_lossy().into_owned(),
            Component::RootDir => root.push('/'),
            Component::CurDir => {}
            Component::ParentDir if parts.last().is_some_and(|part| part != "..") => {
                parts.pop();
            }
            Component::ParentDir => parts.push("..".to_owned()),
            Component::Normal(part) => parts.push(part.to_string_lossy().into_owned()),
        }
    }
    root + &parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_made_plain() {
        for (path, expected) in [
            ("a.esm", "a.esm"),
            ("./a.esm", "a.esm"),
            ("a/./b/../c.esm", "a/c.esm"),
            ("../a.esm", "../a.esm"),
            ("../../x/../a.esm", "../../a.esm"),
            ("/x/../a.esm", "/a.esm"),
        ] {
            assert_eq!(plain(Path::new(path)), expected, "{path}");
        }
    }
}
