//! For build scripts: the numbers of `board.toml` as constants, and where each `board.toml` is.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

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

/// The `board.toml` of each board in a folder, in order; cargo is told to look at them. The folder
/// is relative to the package, so that a build that was moved with its checkout does not look at
/// the old place.
pub fn board_files(boards: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(boards).expect("the boards stand in the checkout");
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path().join("board.toml")))
        .filter(|file| file.is_file())
        .collect();
    files.sort();
    for file in &files {
        println!("cargo:rerun-if-changed={}", file.display());
    }
    files
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
