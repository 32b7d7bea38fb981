//! The missions and worlds that ship, as the studio's page has them: a list of their paths and
//! texts, made when the command is built, so that it needs no checkout later.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Where they lie, seen from this package.
const MISSIONS: &str = "shipped/missions";

/// A folder whose missions only tests look at.
const SOLUTIONS: &str = "solutions";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo::rerun-if-changed={MISSIONS}");
    let root = fs::canonicalize(MISSIONS)?;
    let mut files = Vec::new();
    collect(&root, &mut files)?;
    files.sort();
    let mut list = String::from("&[\n");
    for file in files {
        let below = file.strip_prefix(&root)?;
        let parts: Vec<_> = below.iter().map(|part| part.to_string_lossy()).collect();
        let path = format!("/missions/{}", parts.join("/"));
        writeln!(list, "    ({path:?}, include_str!({:?})),", file)?;
    }
    list.push_str("]\n");
    let out = PathBuf::from(env::var("OUT_DIR")?).join("missions.rs");
    fs::write(out, list)?;
    Ok(())
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            if !path.ends_with(SOLUTIONS) {
                collect(&path, files)?;
            }
        } else if (path.extension()).is_some_and(|ending| ending == "esm" || ending == "world") {
            files.push(path);
        }
    }
    Ok(())
}
