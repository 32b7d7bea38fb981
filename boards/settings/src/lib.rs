//! For build scripts: what the folder of each board says of it, and the numbers of a `board.toml`
//! as constants.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// What the folder of a board says of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardFiles {
    /// The folder's name, which is the board's.
    pub name: &'static str,
    /// Its `board.toml`.
    pub settings: &'static str,
    /// Its `costs.txt`, where it has one.
    pub costs: Option<&'static str>,
}

/// All boards, by their names.
pub const BOARDS: &[BoardFiles] = &include!(concat!(env!("OUT_DIR"), "/boards.rs"));

/// Keys of `board.toml` that a board's code is built with, and the types of their constants.
const SETTINGS: [(&str, &str); 8] = [
    ("blob_bytes", "usize"),
    ("arena_words", "usize"),
    ("slots", "usize"),
    ("tasks", "usize"),
    ("nets", "usize"),
    ("exclusive_groups", "usize"),
    ("trace_bytes", "usize"),
    ("ticks_per_us", "u32"),
];

/// What cargo says of the features that take memory: a build without any of them is lean.
const FEATURES: [&str; 4] = [
    "CARGO_FEATURE_RECORD",
    "CARGO_FEATURE_STORE",
    "CARGO_FEATURE_BLACK_BOX",
    "CARGO_FEATURE_WARM",
];

/// The type of a runtime's memory, of a board's size.
const MEMORY: &str = "
/// A runtime's memory, of this board's size.
pub type Memory<'m> = rt_firmware::Memory<
    'm,
    BLOB_BYTES,
    ARENA_WORDS,
    SLOTS,
    TASKS,
    NETS,
    EXCLUSIVE_GROUPS,
    TRACE_BYTES,
>;
";

/// Writes `settings.rs` into the build's folder: one constant for each key, of the `board.toml`
/// beside the build script that calls this, and the type of the memory that they make. A lean build
/// takes those of the sections `….lean` where they have one.
pub fn write() {
    let board = Path::new("board.toml");
    println!("cargo:rerun-if-changed={}", board.display());
    let is_lean = !FEATURES
        .iter()
        .any(|feature| env::var_os(feature).is_some());
    fs::write(
        out().join("settings.rs"),
        constants(board, is_lean) + MEMORY,
    )
    .expect("OUT_DIR can be written to");
}

/// Puts a linker script where the linker looks for it. `from` is relative to the package, so that a
/// build that was moved with its checkout does not look at the old place.
pub fn linker_script(from: &str) {
    let from = Path::new(from);
    let name = from.file_name().expect("a script is a file");
    fs::copy(from, out().join(name)).expect("the script stands where it is said to");
    println!("cargo:rustc-link-search={}", out().display());
    println!("cargo:rerun-if-changed={}", from.display());
}

fn out() -> PathBuf {
    env::var_os("OUT_DIR")
        .expect("cargo sets its variables")
        .into()
}

fn constants(board: &Path, is_lean: bool) -> String {
    let text = fs::read_to_string(board).expect("board.toml stands beside build.rs");
    let mut values = HashMap::new();
    let mut is_for_lean = false;
    for line in text.lines() {
        if line.starts_with('[') {
            is_for_lean = line.ends_with(".lean]");
        } else if let Some((key, value)) = line.split_once(" = ")
            && (is_lean || !is_for_lean)
        {
            values.insert(key, value);
        }
    }
    let mut constants = String::new();
    for (key, rust_type) in SETTINGS {
        let value = values
            .get(key)
            .unwrap_or_else(|| panic!("board.toml has no `{key} = …`"));
        let name = key.to_uppercase();
        // Writing to a string cannot fail.
        let _ = writeln!(
            constants,
            "/// `{key}` of `board.toml`.\npub const {name}: {rust_type} = {value};"
        );
    }
    constants
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test that cannot go on has failed

    use super::*;

    /// A package that was published has no boards around it.
    #[test]
    fn the_copies_that_are_packaged_are_the_boards_files() {
        let is_blessed = env::var_os("ESM_BLESS").is_some();
        let packaged = Path::new("packaged");
        let names = |folder: &str| {
            let entries = fs::read_dir(folder).into_iter().flatten().flatten();
            let boards = entries.filter(|entry| entry.path().join("board.toml").is_file());
            let mut names: Vec<String> = boards
                .map(|entry| entry.file_name().into_string().unwrap())
                .collect();
            names.sort();
            names
        };
        if is_blessed {
            let _ = fs::remove_dir_all(packaged);
            for board in BOARDS {
                let folder = packaged.join(board.name);
                fs::create_dir_all(&folder).unwrap();
                fs::write(folder.join("board.toml"), board.settings).unwrap();
                if let Some(costs) = board.costs {
                    fs::write(folder.join("costs.txt"), costs).unwrap();
                }
            }
        }
        let how = "`ESM_BLESS=1 cargo test -p board-settings` copies them";
        assert_eq!(names("packaged"), names(".."), "{how}");
        for board in BOARDS {
            let read = |name| fs::read_to_string(packaged.join(board.name).join(name)).ok();
            assert_eq!(read("board.toml").as_deref(), Some(board.settings), "{how}");
            assert_eq!(read("costs.txt").as_deref(), board.costs, "{how}");
        }
    }
}
