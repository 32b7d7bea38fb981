//! The book and the front page against what they describe.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use esm_tests::command::root;
use host_tools::lang::{self, Code};

fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn chapters() -> Vec<PathBuf> {
    ["docs/src", "docs/src/codes"]
        .iter()
        .flat_map(|folder| std::fs::read_dir(root().join(folder)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .collect()
}

/// The contents of a Markdown text's fenced blocks of a language.
fn fenced(text: &str, language: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut inside: Option<(bool, String)> = None;
    for line in text.lines() {
        match (&mut inside, line.strip_prefix("```")) {
            (None, Some(tag)) => inside = Some((tag == language, String::new())),
            (Some(_), Some(_)) => {
                let (wanted, block) = inside.take().unwrap_or_default();
                if wanted {
                    found.push(block);
                }
            }
            (Some((_, block)), None) => {
                block.push_str(line);
                block.push('\n');
            }
            (None, None) => {}
        }
    }
    found
}

/// The targets of a Markdown text's links into this checkout.
fn links(text: &str) -> Vec<&str> {
    text.split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next())
        .map(|target| target.split('#').next().unwrap_or_default())
        .filter(|target| !target.contains("://") && !target.is_empty())
        .collect()
}

#[test]
fn every_link_leads_to_a_file_and_every_chapter_is_listed() {
    let mut files = chapters();
    files.extend(["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(|name| root().join(name)));
    for file in &files {
        for target in links(&read(file)) {
            let path = file.parent().unwrap().join(target);
            assert!(path.exists(), "{} links to {target}", file.display());
        }
    }
    let summary = read("docs/src/SUMMARY.md");
    let listed: BTreeSet<&str> = links(&summary).into_iter().collect();
    for chapter in chapters() {
        let name = chapter.strip_prefix(root().join("docs/src")).unwrap();
        let name = name.to_str().unwrap();
        assert!(
            name == "SUMMARY.md" || listed.contains(name),
            "{name} is not listed"
        );
    }
}

#[test]
fn the_code_of_the_first_chapter_is_the_examples() {
    let mut example = String::new();
    for file in [
        "src/lamp.rs",
        "src/headlight.rs",
        "src/lib.rs",
        "src/bin/my_robot.rs",
        "firmware/src/main.rs",
        "mission.esm",
    ] {
        example += &read(Path::new("examples/my_robot").join(file));
    }
    let chapter = read("docs/src/your-own-robot.md");
    let blocks = [fenced(&chapter, "rust"), fenced(&chapter, "text")].concat();
    assert!(blocks.len() >= 8, "only {} blocks of code", blocks.len());
    for block in blocks {
        assert!(example.contains(&block), "not in the example:\n{block}");
    }
}

#[test]
fn whole_missions_in_the_book_are_without_errors_and_warnings() {
    let mut checked = 0;
    for chapter in chapters() {
        for mission in fenced(&read(&chapter), "esm") {
            let result = lang::load_text("book.esm", &mission);
            assert!(
                result.diagnostics.is_empty(),
                "{}: {}",
                chapter.display(),
                result.render(false)
            );
            checked += 1;
        }
    }
    assert!(checked > 0);
}

#[test]
fn the_chapter_on_errors_has_every_code() {
    let chapter = read("docs/src/errors.md");
    for code in Code::ALL {
        let row = format!("| [{code:?}](codes/{code:?}.md) |");
        assert!(chapter.contains(&row), "{code:?}");
    }
}

/// A number as the book writes it.
fn with_commas(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// The value of a constant in a source file, where it is a plain number.
fn constant(file: &str, name: &str) -> u64 {
    let text = read(file);
    let line = text
        .lines()
        .find(|line| line.contains(&format!("const {name}: ")))
        .unwrap_or_else(|| panic!("{file} has no constant {name}"));
    let value = line.split(" = ").nth(1).unwrap().trim_end_matches(';');
    value
        .split('*')
        .map(|factor| factor.trim().replace('_', "").parse::<u64>().unwrap())
        .product()
}

/// A number of the board's settings.
fn setting(key: &str) -> u64 {
    let text = read("boards/lm3s6965/board.toml");
    let value = text
        .lines()
        .filter_map(|line| line.split_once(" = "))
        .find_map(|(found, value)| (found == key).then_some(value));
    let value = value.unwrap_or_else(|| panic!("board.toml has no {key}"));
    value.parse().unwrap()
}

#[test]
fn the_chapter_on_limits_has_the_numbers_of_the_code() {
    let chapter = read("docs/src/limits.md");
    let host = "host-tools/src/host_board/mod.rs";
    for (row, on_board, on_host) in [
        ("bytes of a blob", "blob_bytes", "BLOB_BYTES"),
        (
            "32-bit words for the interpreter",
            "arena_words",
            "ARENA_WORDS",
        ),
        ("slots", "slots", "SLOTS"),
        ("task states", "tasks", "TASKS"),
        ("nets", "nets", "NETS"),
        ("exclusive groups", "exclusive_groups", "GROUPS"),
    ] {
        let line = chapter
            .lines()
            .find(|line| line.starts_with(&format!("| {row} | ")) && line.matches('|').count() == 4)
            .unwrap_or_else(|| panic!("no row for {row}"));
        let cells: Vec<&str> = line.split(" | ").collect();
        for (cell, number) in [(1, setting(on_board)), (2, constant(host, on_host))] {
            let told = cells[cell].split([' ', '|']).next().unwrap();
            assert_eq!(told, with_commas(number), "{row}: {line}");
        }
    }
    for (row, number) in [
        ("data ports", rt_firmware::task::MAX_DATA_PORTS),
        (
            "flags, `in` and `out` together",
            rt_firmware::task::MAX_FLAGS,
        ),
        ("parameters", rt_firmware::task::MAX_PARAMS),
        (
            "overruns of a slot in a row",
            rt_firmware::Limits::default().overruns_in_a_row.into(),
        ),
        (
            "missed occurrences of a slot in a row",
            rt_firmware::Limits::default().missed_in_a_row as usize,
        ),
        (
            "answers of the body that are stale, in a row",
            rt_firmware::body::STALE_FRAME_LIMIT.into(),
        ),
    ] {
        assert!(
            chapter.contains(&format!("| {row} | {number} |")),
            "{row} is {number}"
        );
    }
}
