//! Widths of lines: code and comments of `.rs` files, prose of `.md` files. `rustfmt` leaves long
//! comments alone.
//!
//! Files that are too wide today stand in a list with how many such lines they have. No file gets
//! wider.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::process::Failure;

/// Columns of a line of code or of a comment.
const CODE_COLUMNS: usize = 100;

/// Columns of a line of prose.
const PROSE_COLUMNS: usize = 120;

/// How many lines of which file are too wide today.
const LIST: &str = "xtask/wide-lines.txt";

/// What stands above the list.
const HEADER: &str = "\
# Lines that are wider than they should be, by file. A number only goes down: `cargo xtask form --write`.
";

/// Folders that nobody writes by hand, or that hold inputs of tests.
const LEFT_OUT: [&str; 4] = ["target", ".git", "node_modules", "corpus"];

/// Compares all files with the list; writes the list with `write`.
///
/// # Errors
/// [`Failure::Content`] for the first file that has more wide lines than the list says,
/// [`Failure::File`].
pub fn command(root: &Path, write: bool) -> Result<(), Failure> {
    let mut wide = BTreeMap::new();
    let mut files = Vec::new();
    collect(root, &mut files)?;
    for path in files {
        let Some(find) = finder(&path) else { continue };
        let text = std::fs::read_to_string(&path).map_err(|cause| Failure::File {
            path: path.clone(),
            cause,
        })?;
        let lines = find(&text);
        if !lines.is_empty() {
            let name = path.strip_prefix(root).unwrap_or(&path).to_string_lossy();
            wide.insert(name.into_owned(), lines);
        }
    }
    let list = root.join(LIST);
    if write {
        return store(&list, &wide);
    }
    // Without a list, nothing wide is allowed.
    let text = std::fs::read_to_string(&list).unwrap_or_default();
    let allowed = allowed(&text);
    let mut first = None;
    for (file, lines) in &wide {
        let allowed = allowed.get(file.as_str()).copied().unwrap_or(0);
        if lines.len() > allowed {
            let numbers: Vec<String> = lines.iter().map(usize::to_string).collect();
            println!(
                "{file}: {} wide lines, {allowed} allowed: {}",
                lines.len(),
                numbers.join(", ")
            );
            first.get_or_insert(file);
        }
    }
    match first {
        None => Ok(()),
        Some(file) => Err(Failure::Content {
            path: root.join(file),
            problem: "has lines above 100 columns (.rs) or 120 (.md): break them",
        }),
    }
}

/// Keeps how many lines are too wide; without any there is no list.
fn store(list: &Path, wide: &BTreeMap<String, Vec<usize>>) -> Result<(), Failure> {
    let of_list = |cause| Failure::File {
        path: list.to_owned(),
        cause,
    };
    if wide.is_empty() {
        return match std::fs::remove_file(list) {
            Err(cause) if cause.kind() != ErrorKind::NotFound => Err(of_list(cause)),
            _ => Ok(()),
        };
    }
    let rows = (wide.iter()).map(|(file, lines)| format!("{} {file}\n", lines.len()));
    let text = HEADER.to_owned() + &rows.collect::<String>();
    std::fs::write(list, text).map_err(of_list)
}

/// Collects the files below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let of_folder = |cause| Failure::File {
        path: folder.to_owned(),
        cause,
    };
    for entry in std::fs::read_dir(folder).map_err(of_folder)? {
        let entry = entry.map_err(of_folder)?;
        let kind = entry.file_type().map_err(of_folder)?;
        let is_left_out = LEFT_OUT.iter().any(|name| entry.file_name() == *name);
        if kind.is_dir() && !is_left_out {
            collect(&entry.path(), files)?;
        } else if kind.is_file() {
            files.push(entry.path());
        }
    }
    Ok(())
}

/// Finds the numbers of a text's wide lines.
type Finder = fn(&str) -> Vec<usize>;

/// What looks at files of this name, if anything does.
fn finder(file: &Path) -> Option<Finder> {
    match file.extension()?.to_str()? {
        "rs" => Some(wide_code),
        "md" => Some(wide_prose),
        _ => None,
    }
}

/// The numbers in a list, by file.
fn allowed(list: &str) -> BTreeMap<&str, usize> {
    list.lines()
        .filter_map(|line| line.split_once(' '))
        .filter_map(|(number, file)| Some((file, number.parse().ok()?)))
        .collect()
}

/// Whether a line has more columns than these. Each character counts as one.
fn is_wider(line: &str, columns: usize) -> bool {
    line.len() > columns && line.chars().count() > columns
}

/// Lines of prose that are too wide: tables and what is fenced are not broken,
/// nor are links alone on their line.
fn wide_prose(text: &str) -> Vec<usize> {
    let mut is_fenced = false;
    let mut wide = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let start = line.trim_start();
        if start.starts_with("```") {
            is_fenced = !is_fenced;
        }
        // The end of a link is on the line of its beginning.
        let is_link = start.starts_with('[') && start.split(' ').count() == 2;
        let is_whole = start.starts_with(['|', '#', '<']) || is_link || !start.contains(' ');
        if !is_fenced && !is_whole && is_wider(line, PROSE_COLUMNS) {
            wide.push(number);
        }
    }
    wide
}

/// Lines of Rust that are too wide. A line with a part of a text in quotes is not broken, nor is a
/// table in a comment.
fn wide_code(text: &str) -> Vec<usize> {
    if !text.lines().any(|line| is_wider(line, CODE_COLUMNS)) {
        return Vec::new();
    }
    let mut rest = Code::Plain;
    let mut wide = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let comment = line.trim_start().trim_start_matches(['/', '!']);
        let is_table = comment.starts_with(" | ") && comment.len() < line.trim_start().len();
        let has_text = rest.read(line);
        if !has_text && !is_table && is_wider(line, CODE_COLUMNS) {
            wide.push(number);
        }
    }
    wide
}

/// What a line of Rust begins in.
#[derive(Clone, Copy, PartialEq)]
enum Code {
    Plain,
    /// Comments in comments.
    Comment(usize),
    Text,
    /// Between quotes with so many hashes.
    RawText(usize),
}

impl Code {
    /// Reads a line to its end. Whether a part of a text was in it.
    fn read(&mut self, line: &str) -> bool {
        let bytes = line.as_bytes();
        let mut has_text = matches!(self, Code::Text | Code::RawText(_));
        let mut at = 0;
        while at < bytes.len() {
            let rest = &bytes[at..];
            at += match *self {
                Code::Plain if rest.starts_with(b"//") => return has_text,
                Code::Plain if rest.starts_with(b"/*") => {
                    *self = Code::Comment(1);
                    2
                }
                Code::Plain if rest[0] == b'"' => {
                    has_text = true;
                    *self = opened(&bytes[..at]);
                    1
                }
                Code::Plain if rest[0] == b'\'' => character(rest),
                Code::Comment(depth) if rest.starts_with(b"*/") => {
                    *self = match depth {
                        1 => Code::Plain,
                        depth => Code::Comment(depth - 1),
                    };
                    2
                }
                Code::Comment(depth) if rest.starts_with(b"/*") => {
                    *self = Code::Comment(depth + 1);
                    2
                }
                Code::Text if rest[0] == b'\\' => 2,
                Code::Text if rest[0] == b'"' => {
                    *self = Code::Plain;
                    1
                }
                Code::RawText(hashes) if rest[0] == b'"' && hashes_of(&rest[1..]) >= hashes => {
                    *self = Code::Plain;
                    1 + hashes
                }
                _ => 1,
            };
        }
        has_text
    }
}

/// What a quote begins behind this: a text, or a raw one.
fn opened(before: &[u8]) -> Code {
    let hashes = before
        .iter()
        .rev()
        .take_while(|byte| **byte == b'#')
        .count();
    let before = &before[..before.len() - hashes];
    let is_raw = before.last() == Some(&b'r');
    // A name that ends in r is no prefix of a text.
    let prefix = before
        .iter()
        .rev()
        .take_while(|byte| byte.is_ascii_alphanumeric());
    if is_raw && prefix.count() <= 2 {
        Code::RawText(hashes)
    } else {
        Code::Text
    }
}

/// How many hashes these bytes begin with.
fn hashes_of(bytes: &[u8]) -> usize {
    bytes.iter().take_while(|byte| **byte == b'#').count()
}

/// The bytes of a character literal, or of a lifetime's quote.
fn character(rest: &[u8]) -> usize {
    match rest {
        [_, b'\\', _, after @ ..] => {
            let end = after.iter().position(|byte| *byte == b'\'');
            end.map_or(1, |end| end + 4)
        }
        [_, _, b'\'', ..] => 3,
        _ => 1,
    }
}

#[cfg(test)]
mod tests {
    use super::{allowed, wide_code, wide_prose};

    #[test]
    fn a_wide_line_of_code_or_of_a_comment_is_found_and_one_with_a_text_is_not() {
        let fill = "x".repeat(100);
        for (text, expected) in [
            (format!("// {fill}"), &[1][..]),
            (format!("let a = 1; // {fill}"), &[1]),
            (format!("let a = '\"'; let {fill} = 1;"), &[1]),
            (format!("let a = '\\''; let {fill} = 1;"), &[1]),
            (format!("fn f<'a>(a: &'a str) {{ {fill} }}"), &[1]),
            (format!("/* \" */ {fill}"), &[1]),
            (format!("let bar = b; // \"{fill}\""), &[1]),
            (format!("let a = \"{fill}\";"), &[]),
            (format!("    //! | a | {fill} |"), &[]),
            (format!("    | a | {fill} |"), &[1]),
            (
                format!("let a = r#\"\n{fill} \"\n{fill}\"#;\n// {fill}"),
                &[4],
            ),
            (format!("let a = \"\\\"\n{fill}\n\";\n// {fill}"), &[4]),
            (fill[..100].to_owned(), &[]),
            ("ü".repeat(100), &[]),
            ("ü".repeat(101), &[1]),
        ] {
            assert_eq!(wide_code(&text), expected, "{text}");
        }
    }

    #[test]
    fn a_wide_line_of_prose_is_found_and_tables_code_and_links_are_not() {
        let fill = "x ".repeat(61);
        for (text, expected) in [
            (fill.clone(), &[1][..]),
            (format!("- {fill}"), &[1]),
            (format!("| {fill} |"), &[]),
            (format!("```text\n{fill}\n```\n{fill}"), &[4]),
            ("x".repeat(121), &[]),
            (format!("[link]: {}", "x".repeat(121)), &[]),
            (format!("[link]: a {}", "x".repeat(121)), &[1]),
            (fill[..120].to_owned(), &[]),
        ] {
            assert_eq!(wide_prose(&text), expected, "{text}");
        }
    }

    #[test]
    fn a_list_says_how_many_wide_lines_a_file_may_have() {
        let list = allowed("# a heading\n3 a/b.rs\n12 c d.md\n");
        assert_eq!(list.get("a/b.rs"), Some(&3));
        assert_eq!(list.get("c d.md"), Some(&12));
        assert_eq!(list.len(), 2);
    }
}
