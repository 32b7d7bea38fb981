//! Which checkout the program works on: the one around its working directory, wherever it was
//! compiled.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

mod common;

use std::path::{Path, PathBuf};

use common::{Folder, xtask};

/// What `xtask` says in a folder, and its exit status.
fn said(folder: &Path, arguments: &[&str]) -> (String, Option<i32>) {
    let output = xtask(folder, arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (said, output.status.code())
}

#[test]
fn it_works_on_the_checkout_around_the_working_directory() {
    let copy = Folder::checkout("copy");
    // The list of fuzz targets is that of this checkout, and not of the one that this test was
    // compiled in.
    copy.write("fuzz/fuzz_targets/only_here.rs", "");
    copy.write("missions/deep/below/m.esm", "");
    for folder in [&copy.0, &copy.0.join("missions/deep/below")] {
        let (said, status) = said(folder, &["fuzz", "nothing"]);
        assert_eq!(status, Some(2), "{said}");
        assert!(
            said.contains("there is no fuzz target nothing, only only_here\n"),
            "{said}"
        );
    }
}

#[test]
fn outside_a_checkout_it_says_so() {
    let nowhere = Folder::new("nowhere");
    for command in [&["setup"][..], &["fuzz"], &["bench", "day"]] {
        let (said, status) = said(&nowhere.0, command);
        assert_eq!(status, Some(3), "{said}");
        let expected = format!(
            "xtask: {} is not inside a checkout of esm",
            nowhere.0.canonicalize().unwrap().display()
        );
        assert!(said.starts_with(&expected), "{said}");
    }
}

/// The source files below a folder, but for what is built.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            sources(&path, found);
        } else if name.ends_with(".rs") {
            found.push(path);
        }
    }
}

#[test]
fn no_source_keeps_a_folder_of_the_machine_that_it_was_compiled_on() {
    let mut found = Vec::new();
    sources(Path::new(".."), &mut found);
    assert!(found.len() > 300, "only {} source files", found.len());
    for variable in [
        "CARGO_MANIFEST_DIR",
        "CARGO_BIN_EXE_",
        "CARGO_TARGET_TMPDIR",
    ] {
        let compiled_in = format!("env!(\"{variable}");
        for path in &found {
            let text = std::fs::read_to_string(path).unwrap();
            assert!(
                !text.contains(&compiled_in),
                "{}: read {variable} when it runs, or name the file from the package's folder",
                path.display()
            );
        }
    }
}
