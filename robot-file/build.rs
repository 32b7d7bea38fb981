//! Collects what each `boards/*/board.toml` says of pins, so that a robot's file is checked without
//! a checkout.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    // Relative to this package, so that a build that was moved with its checkout does not look at
    // the old place.
    let boards = Path::new("../boards");
    println!("cargo:rerun-if-changed=build.rs");
    let entries = fs::read_dir(boards).expect("the boards stand in the checkout");
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path().join("board.toml")))
        .filter(|file| file.is_file())
        .collect();
    files.sort();
    let mut list = String::from("[\n");
    for file in &files {
        println!("cargo:rerun-if-changed={}", file.display());
        let text = fs::read_to_string(file).unwrap_or_else(|error| panic!("{file:?}: {error}"));
        // Writing to a string cannot fail.
        let _ = writeln!(list, "{text:?},");
    }
    list += "]\n";
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets its variables"));
    fs::write(out.join("boards.rs"), list).expect("OUT_DIR can be written to");
}
