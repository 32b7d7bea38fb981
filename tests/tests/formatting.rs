//! The layout of `esm fmt`: what it must never change, and that the project's own files have it.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};

use esm_tests::command::{esm, root};
use esm_tests::random::Random;
use esm_tests::{random_machine, subject};
use host_tools::lang::format;

/// How many random machines are laid out.
const MACHINES: u64 = 100;

/// Cases for checks and fuzzing, whose layout is a part of the case or does not matter, and what is
/// built.
const LEFT_OUT: [&str; 3] = ["tests/cases", "fuzz", "target"];

/// The sources of the checkout that people read.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.strip_prefix(root()).unwrap().to_str().unwrap();
        if LEFT_OUT.contains(&name) || name.starts_with('.') || path.ends_with("target") {
            continue;
        }
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "esm") {
            found.push(path);
        }
    }
}

#[test]
fn the_projects_own_files_have_the_layout() {
    let mut files = Vec::new();
    sources(root(), &mut files);
    assert!(files.len() > 8, "{files:?}");
    let mut arguments = vec!["fmt".to_owned(), "--check".to_owned()];
    arguments.extend(files.iter().map(|path| path.to_str().unwrap().to_owned()));
    esm(&arguments).good();
}

/// The text with other blanks, and with comments where blanks were. The text has no comments and no
/// quoted texts.
fn sprayed(text: &str, random: &mut Random) -> String {
    let mut sprayed = String::new();
    for character in text.chars() {
        if character != ' ' && character != '\n' {
            sprayed.push(character);
            continue;
        }
        match random.below(30) {
            0 => sprayed.push_str(" // behind, or before\n"),
            1 => sprayed.push_str("\n\n    // on its own\t\r\n\n\n"),
            2 => sprayed.push_str(" /* between */"),
            3 => sprayed.push_str("\t/* over\n   two lines */\n"),
            4 => sprayed.push_str("\r\n\r\n\r\n"),
            5 => sprayed.push_str("  \t "),
            _ => sprayed.push(character),
        }
    }
    sprayed
}

/// The comments of a text without quoted texts, in order, without the blanks at the ends of their
/// lines.
fn comments(text: &str) -> Vec<String> {
    let mut comments = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find("//").into_iter().chain(rest.find("/*")).min() {
        let comment = &rest[start..];
        let length = if comment.starts_with("//") {
            comment.find('\n').unwrap_or(comment.len())
        } else {
            comment.find("*/").unwrap() + 2
        };
        let lines: Vec<&str> = comment[..length].lines().map(str::trim_end).collect();
        comments.push(lines.join("\n"));
        rest = &comment[length..];
    }
    comments
}

#[test]
fn a_machine_means_the_same_in_its_layout() {
    for seed in 0..MACHINES {
        let machine = random_machine::machine(seed);
        let text = sprayed(&machine, &mut Random::new(seed ^ 0xF0_4A17));
        let laid_out = |text: &str| {
            format::format("machine.esm", text.as_bytes())
                .unwrap_or_else(|refusal| panic!("seed {seed}:\n{}", refusal.render(false)))
        };
        let once = laid_out(&text);
        assert_eq!(laid_out(&once), once, "seed {seed}, a second time");
        assert_eq!(comments(&once), comments(&text), "seed {seed}");
        let blob = |text: &str| subject::build(text).map(|built| built.blob);
        assert_eq!(blob(&once), blob(&machine), "seed {seed}");
        // Without comments, how a text was laid out before leaves no trace but empty lines.
        let plain = laid_out(&machine);
        let words: Vec<&str> = machine.split_whitespace().collect();
        assert_eq!(laid_out(&words.join("\n")), plain, "seed {seed}");
    }
}

#[test]
fn files_are_replaced_whole_or_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir_all(folder.path().join(".hidden")).unwrap();
    std::fs::create_dir(&inner).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    write("wide.esm", "queue   3 ;// three\r\n");
    write("wrong.esm", "queue   3");
    write("inner/good.esm", "queue 3;\n");
    write(".hidden/wide.esm", "queue   3;");
    write("text.txt", "queue   3;");
    let path = folder.path().to_str().unwrap();
    let good_since = || {
        std::fs::metadata(inner.join("good.esm"))
            .unwrap()
            .modified()
    };
    let before = good_since().unwrap();

    let checked = esm(&["fmt", path, "--check"]);
    assert_eq!(checked.status, Some(1), "{checked:#?}");
    assert!(
        checked
            .out
            .contains("wide.esm would change:\n  line 1:\n  -queue   3 ;// three␍\n  +queue 3;")
    );
    assert!(
        !checked.out.contains("good.esm") && !checked.out.contains("hidden"),
        "{checked:#?}"
    );
    assert_eq!(read("wide.esm"), "queue   3 ;// three\r\n");

    let done = esm(&["fmt", path]);
    assert_eq!(done.status, Some(1), "{done:#?}");
    assert!(
        done.err.contains("wrong.esm:1:10") && done.err.contains("left as it is"),
        "{done:#?}"
    );
    assert_eq!(done.out.lines().count(), 1, "{done:#?}");
    assert_eq!(read("wide.esm"), format!("{:40}// three\n", "queue 3;"));
    assert_eq!(read("wrong.esm"), "queue   3");
    assert_eq!(read(".hidden/wide.esm"), "queue   3;");
    assert_eq!(read("text.txt"), "queue   3;");
    assert_eq!(
        good_since().unwrap(),
        before,
        "a file that has the layout is not touched"
    );

    let good = esm(&["fmt", path, "--check"]);
    assert_eq!(
        (good.status, good.out.as_str()),
        (Some(1), ""),
        "wrong.esm is still wrong"
    );
    std::fs::remove_file(folder.path().join("wrong.esm")).unwrap();
    let good = esm(&["fmt", path, "--check"]).good();
    assert_eq!((good.out.as_str(), good.err.as_str()), ("", ""));
}

#[test]
fn one_file_can_go_to_standard_output() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esm");
    std::fs::write(&path, "queue   3;").unwrap();
    let path = path.to_str().unwrap();
    assert_eq!(esm(&["fmt", "--stdout", path]).good().out, "queue 3;\n");
    assert_eq!(std::fs::read_to_string(path).unwrap(), "queue   3;");
    let cases: [(&[&str], i32); 5] = [
        (&["fmt"], 2),
        (&["fmt", "--stdout", path, path], 2),
        (&["fmt", "--stdout", "--check", path], 2),
        (&["fmt", "-", path], 2),
        (&["fmt", "nowhere.esm"], 1),
    ];
    for (arguments, status) in cases {
        assert_eq!(esm(arguments).status, Some(status), "{arguments:?}");
    }
}
