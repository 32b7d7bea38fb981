//! Collects what each `boards/*/board.toml` says of pins, so that a robot's file is checked without
//! a checkout.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let mut list = String::from("[\n");
    for board in board_settings::BOARDS {
        // Writing to a string cannot fail.
        let _ = writeln!(list, "{:?},", board.settings);
    }
    list += "]\n";
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets its variables"));
    fs::write(out.join("boards.rs"), list).expect("OUT_DIR can be written to");
}
