//! Which files of a package import which: read from `use` lines and from paths in the code, without
//! the compiler.
//!
//! What stands under `#[cfg(test)]` is left out, comments and texts too, and with the comments what
//! is imported for their links, under `#[cfg(doc)]`. A name that a module only hands on counts as
//! an import of the file that defines it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// A module by its path from the crate's root; the root itself is empty.
type Module = Vec<String>;

/// Why nothing deeper is looked at: no name is handed on more often.
const MAX_HANDED_ON: usize = 16;

/// Files, and those that each imports, as paths below the package's sources.
pub type Imports = BTreeMap<String, BTreeSet<String>>;

/// What is known of a module.
#[derive(Default)]
struct Known {
    file: String,
    /// Its own code, without that of modules inside of it.
    code: String,
    /// Names that `use` brings in, and what they stand for.
    uses: Vec<(String, Vec<String>)>,
}

/// A package that was read.
#[derive(Default)]
pub struct Package {
    modules: BTreeMap<Module, Known>,
}

impl Package {
    /// Reads a package from its root file on. `read` gives a file below the sources.
    ///
    /// # Panics
    /// If a module has no file.
    pub fn read(read: &dyn Fn(&Path) -> Option<String>, root: &str) -> Self {
        let mut package = Package::default();
        let text = read(Path::new(root)).unwrap_or_else(|| panic!("there is no {root}"));
        package.add(
            read,
            Vec::new(),
            Path::new(root),
            Path::new(""),
            &plain(&text),
        );
        package
    }

    /// Takes in a module: its code, the folder that its children lie in.
    fn add(
        &mut self,
        read: &dyn Fn(&Path) -> Option<String>,
        path: Module,
        file: &Path,
        folder: &Path,
        code: &str,
    ) {
        let mut own = String::new();
        let mut rest = code;
        while let Some((before, is_test, name, behind)) = next_module(rest) {
            own += before;
            let child = [path.clone(), vec![name.to_owned()]].concat();
            if is_test {
                // Its attribute would take what comes next.
                own.truncate(own.rfind("#[cfg(test)]").unwrap_or(own.len()));
            }
            if let Some(behind) = behind.strip_prefix(';') {
                rest = behind;
                if is_test {
                    continue;
                }
                let candidates = [
                    folder.join(name).with_extension("rs"),
                    folder.join(name).join("mod.rs"),
                ];
                let found = candidates.iter().find_map(|it| Some((it, read(it)?)));
                let (file, text) = found.unwrap_or_else(|| panic!("no file of {child:?}"));
                let folder = folder.join(name);
                self.add(read, child, file, &folder, &plain(&text));
            } else {
                let (inner, behind) = block(behind);
                rest = behind;
                if !is_test {
                    self.add(read, child, file, &folder.join(name), inner);
                }
            }
        }
        own += rest;
        let own = without_left_out_items(&own);
        let known = Known {
            file: file.display().to_string(),
            uses: use_trees(&own),
            code: own,
        };
        self.modules.insert(path, known);
    }

    /// Who imports whom.
    pub fn imports(&self) -> Imports {
        let mut imports = Imports::new();
        for (module, known) in &self.modules {
            let used = known.uses.iter().map(|(_, path)| path.clone());
            let named = paths(&known.code);
            let targets = used.chain(named);
            let found = targets.filter_map(|path| self.file_of(module, &path, MAX_HANDED_ON));
            let entry = imports.entry(known.file.clone()).or_default();
            entry.extend(found.filter(|file| *file != known.file));
        }
        imports
    }

    /// The file that a path names from within a module; none if it leads out of the package.
    fn file_of(&self, from: &Module, path: &[String], depth: usize) -> Option<String> {
        let (first, mut rest) = path.split_first()?;
        let mut at: Module = match first.as_str() {
            "crate" => Vec::new(),
            "self" => from.clone(),
            "super" => from.split_last()?.1.to_vec(),
            name => {
                let child = [from.clone(), vec![name.to_owned()]].concat();
                if !self.modules.contains_key(&child) {
                    return None;
                }
                child
            }
        };
        while let Some((name, behind)) = rest.split_first() {
            if name == "super" {
                at.pop();
            } else if name != "self" {
                let child = [at.clone(), vec![name.clone()]].concat();
                if !self.modules.contains_key(&child) {
                    break;
                }
                at = child;
            }
            rest = behind;
        }
        let known = self.modules.get(&at)?;
        if let (Some(name), Some(depth)) = (rest.first(), depth.checked_sub(1)) {
            let handed_on = known.uses.iter().find(|(bound, _)| bound == name);
            if let Some((_, path)) = handed_on {
                let path = [path.clone(), rest.get(1..).unwrap_or_default().to_vec()].concat();
                return self.file_of(&at, &path, depth);
            }
        }
        Some(known.file.clone())
    }
}

/// The circles of a graph: sets of nodes that reach each other, each in order.
pub fn circles(imports: &Imports) -> Vec<Vec<String>> {
    let reached: BTreeMap<&String, BTreeSet<&String>> = imports
        .keys()
        .map(|start| {
            let mut seen = BTreeSet::new();
            let mut open = vec![start];
            while let Some(next) = open.pop().and_then(|node| imports.get(node)) {
                open.extend(next.iter().filter(|node| seen.insert(*node)));
            }
            (start, seen)
        })
        .collect();
    let mut circles = BTreeSet::new();
    for (node, seen) in &reached {
        if seen.contains(node) {
            let back = |other: &&&String| reached.get(*other).is_some_and(|it| it.contains(node));
            circles.insert(seen.iter().filter(back).map(|it| (*it).clone()).collect());
        }
    }
    circles.into_iter().collect()
}

/// The same between what stands at the top of a package: a file, or a folder with all in it.
pub fn between_tops(imports: &Imports) -> Imports {
    let top = |file: &str| {
        let first = file.split('/').next().unwrap_or(file);
        first.trim_end_matches(".rs").to_owned()
    };
    let mut tops = Imports::new();
    for (file, used) in imports {
        let from = top(file);
        let used = used.iter().map(|file| top(file));
        let entry = tops.entry(from.clone()).or_default();
        entry.extend(used.filter(|to| *to != from));
    }
    tops
}

/// The imports of a package on disk, by the folder of its sources: those of its library, or else of
/// its program.
///
/// # Panics
/// If a module has no file.
pub fn of_package(sources: &Path) -> Imports {
    let read = |file: &Path| std::fs::read_to_string(sources.join(file)).ok();
    let root = match sources.join("lib.rs").is_file() {
        true => "lib.rs",
        false => "main.rs",
    };
    Package::read(&read, root).imports()
}

/// The next `mod` of a text: what stands before it, whether it is for tests, its name, and what
/// follows the name from `;` or `{` on.
fn next_module(code: &str) -> Option<(&str, bool, &str, &str)> {
    let mut from = 0;
    while let Some(at) = code.get(from..)?.find("mod ").map(|at| from + at) {
        from = at + "mod ".len();
        let before = code.get(..at)?;
        if before.ends_with(|it: char| it.is_alphanumeric() || it == '_') {
            continue;
        }
        let rest = code.get(from..)?.trim_start();
        let end = rest.find(|it: char| !it.is_alphanumeric() && it != '_')?;
        let (name, behind) = rest.split_at_checked(end)?;
        let behind = behind.trim_start();
        if name.is_empty() || !behind.starts_with([';', '{']) {
            continue;
        }
        let item = before.rfind([';', '}', '{']).map_or(0, |at| at + 1);
        let is_test = before.get(item..)?.contains("cfg(test)");
        return Some((before, is_test, name, behind));
    }
    None
}

/// A block in braces and what stands behind it.
fn block(code: &str) -> (&str, &str) {
    let mut depth = 0_usize;
    for (at, it) in code.char_indices() {
        match it {
            '{' => depth += 1,
            '}' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth == 0 && (it == '}' || it == ';') {
            let start = usize::from(code.starts_with('{'));
            return (
                code.get(start..at).unwrap_or(""),
                code.get(at + 1..).unwrap_or(""),
            );
        }
    }
    (code, "")
}

/// The code without items that are for tests alone, or for the documentation.
fn without_left_out_items(code: &str) -> String {
    let mut code = code.to_owned();
    for left_out in ["#[cfg(test)]", "#[cfg(doc)]"] {
        let mut rest = code.as_str();
        let mut kept = String::new();
        while let Some((before, behind)) = rest.split_once(left_out) {
            kept += before;
            rest = block(behind).1;
        }
        code = kept + rest;
    }
    code
}

/// A text without comments and without what stands in quotes.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let raw = ["r\"", "r#\"", "br\""]
            .iter()
            .find(|it| rest.starts_with(**it));
        let is_word_end = plain.ends_with(|it: char| it.is_alphanumeric() || it == '_');
        let behind = if rest.starts_with("//") {
            rest.find('\n').and_then(|at| rest.get(at..))
        } else if rest.starts_with("/*") {
            rest.find("*/").and_then(|at| rest.get(at + 2..))
        } else if let (Some(raw), false) = (raw, is_word_end) {
            let close = if raw.contains('#') { "\"#" } else { "\"" };
            let inner = rest.get(raw.len()..).unwrap_or("");
            let end = inner.find(close);
            end.and_then(|at| inner.get(at + close.len()..))
        } else if first == '"' {
            let mut is_escaped = false;
            let end = rest.char_indices().skip(1).find(|(_, it)| {
                let ends = *it == '"' && !is_escaped;
                is_escaped = *it == '\\' && !is_escaped;
                ends
            });
            end.and_then(|(at, _)| rest.get(at + 1..))
        } else if first == '\'' {
            // A character; a lifetime has no second quote so near.
            let mut it = rest.chars().skip(1);
            let length = match (it.next(), it.next(), it.next()) {
                (Some('\\'), ..) => rest.get(3..).and_then(|it| it.find('\'')).map(|at| at + 4),
                (Some(it), Some('\''), _) => Some(it.len_utf8() + 2),
                _ => Some(1),
            };
            length.and_then(|length| rest.get(length..))
        } else {
            plain.push(first);
            rest.get(first.len_utf8()..)
        };
        rest = behind.unwrap_or("");
    }
    plain
}

/// The names that the `use` lines of a text bring in, and their paths. A glob brings in `*`.
fn use_trees(code: &str) -> Vec<(String, Vec<String>)> {
    let mut uses = Vec::new();
    for line in code.split_inclusive([';', '}', '{']).filter_map(is_use) {
        // The tree may have braces: it is taken from the code once more.
        let at = line.as_ptr() as usize - code.as_ptr() as usize;
        let tree = code.get(at..).and_then(|rest| rest.split(';').next());
        expand(tree.unwrap_or(""), &[], &mut uses);
    }
    uses
}

/// What follows `use` in a piece of code that ends in one.
fn is_use(piece: &str) -> Option<&str> {
    let at = piece.rfind("use ")?;
    let before = piece.get(..at)?.trim_end();
    let is_item = before.is_empty()
        || before.ends_with(['\n', ']', ')'])
        || before.ends_with("pub")
        || piece.get(..at)?.ends_with('\n');
    is_item.then(|| piece.get(at + 4..)).flatten()
}

fn expand(tree: &str, prefix: &[String], uses: &mut Vec<(String, Vec<String>)>) {
    let tree = tree.trim();
    let (path, branches) = match tree.split_once('{') {
        Some((path, rest)) => (path, rest.rsplit_once('}').map(|it| it.0)),
        None => (tree, None),
    };
    let (path, name) = match path.split_once(" as ") {
        Some((path, name)) => (path, Some(name.trim().to_owned())),
        None => (path, None),
    };
    let words = path.split("::").map(str::trim).filter(|it| !it.is_empty());
    let mut whole = prefix.to_vec();
    whole.extend(words.map(str::to_owned));
    let Some(branches) = branches else {
        if whole.last().is_some_and(|it| it == "self") {
            whole.pop();
        }
        if let Some(last) = whole.last().cloned() {
            uses.push((name.unwrap_or(last), whole));
        }
        return;
    };
    let mut depth = 0_usize;
    let mut start = 0;
    for (at, it) in branches.char_indices().chain([(branches.len(), ',')]) {
        match it {
            '{' => depth += 1,
            '}' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                let branch = branches.get(start..at).unwrap_or("");
                if !branch.trim().is_empty() {
                    expand(branch, &whole, uses);
                }
                start = at + 1;
            }
            _ => {}
        }
    }
}

/// The paths in a text that lead from the root, the parent or the module itself. One that begins
/// with a child's name goes down, and is how a parent calls what is inside of it.
fn paths(code: &str) -> Vec<Vec<String>> {
    let starts = ["crate::", "super::", "self::"];
    let is_part = |it: char| it.is_alphanumeric() || it == '_' || it == ':';
    // Of a visibility nothing is imported, and trees of `use` are read elsewhere.
    let code = code.replace("pub(in ", "pub(");
    let words = code.split_inclusive(|it: char| !is_part(it));
    let mut paths = Vec::new();
    let mut before = "";
    for word in words {
        let is_tree = word.ends_with("::{") || word.ends_with("::*");
        let is_visibility = before.ends_with("pub(");
        before = word;
        let path = word.trim_end_matches(|it: char| !is_part(it));
        if is_tree || is_visibility || !starts.iter().any(|start| path.starts_with(start)) {
            continue;
        }
        let words = path.split("::").filter(|it| !it.is_empty());
        paths.push(words.map(str::to_owned).collect());
    }
    paths
}

/// The sources of a package below the checkout.
pub fn sources(root: &Path, package: &str) -> PathBuf {
    root.join(package).join("src")
}
