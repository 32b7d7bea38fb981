//! Collects what the folder of each board says of it, for those who are built without the checkout.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// Where the boards are: around this package in a checkout, else in a copy that is a part of it.
const PLACES: [&str; 2] = ["..", "packaged"];

/// What is known of a board, in its folder.
const FILE: &str = "board.toml";

/// What an interpreter's steps take, where that was measured.
const COSTS: &str = "costs.txt";

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let found = PLACES.map(|place| (place, boards(Path::new(place))));
    let Some((place, boards)) = found.into_iter().find(|(_, boards)| !boards.is_empty()) else {
        panic!("there is no board: neither beside this package nor in its folder `packaged`");
    };
    // Changes when a board is added or removed.
    println!("cargo:rerun-if-changed={place}");
    let mut list = String::from("[\n");
    for board in boards {
        let name = board.file_name().unwrap_or_default().to_string_lossy();
        let settings = read(&board.join(FILE)).unwrap_or_default();
        let costs = read(&board.join(COSTS));
        // Writing to a string cannot fail.
        let _ = writeln!(
            list,
            "BoardFiles {{ name: {name:?}, settings: {settings:?}, costs: {costs:?} }},"
        );
    }
    list += "]\n";
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets its variables"));
    fs::write(out.join("boards.rs"), list).expect("OUT_DIR can be written to");
}

/// The folders of boards in a folder, by their names. The folder is relative to the package, so
/// that a build that was moved with its checkout does not look at the old place.
fn boards(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut boards: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(|board| board.join(FILE).is_file())
        .collect();
    boards.sort();
    boards
}

/// The text of a file; none where it is not. Such a file is not named to cargo, which would build
/// anew each time.
fn read(file: &Path) -> Option<String> {
    let text = fs::read_to_string(file).ok()?;
    println!("cargo:rerun-if-changed={}", file.display());
    Some(text)
}
