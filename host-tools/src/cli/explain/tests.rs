#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::time::Duration;

use super::*;
use crate::boards;
use crate::compile::NameTable;
use crate::fit;
use crate::lang::{Checked, load_text};
use crate::time::work_limit;

/// The name that the examples go by in messages.
const FILE: &str = "mission.esm";

/// What `esm check` does, for a text.
fn checked(text: &str) -> Checked {
    let mut checked = load_text(FILE, text);
    if let Some(schedule) = checked.lay_out(work_limit(Duration::from_secs(10))) {
        let board = boards::find(boards::DEFAULT).unwrap();
        fit::compile_to_fit(&mut checked, &schedule, Some(board), NameTable::Kept).unwrap();
    }
    checked
}

/// The only fenced block of a language in a page.
fn block<'p>(page: &'p str, language: &str) -> &'p str {
    let fence = format!("\n```{language}\n");
    let (_, behind) = page
        .split_once(&fence)
        .unwrap_or_else(|| panic!("no block `{language}`"));
    assert!(!behind.contains(&fence), "two blocks `{language}`");
    let end = behind.find("```").unwrap();
    &behind[..end]
}

#[test]
fn the_examples_of_each_page_are_wrong_and_right_as_it_says() {
    let mut problems = String::new();
    for code in Code::ALL {
        let page = page(code);
        let wrong = checked(block(page, "esm,wrong"));
        let codes: Vec<Code> = wrong.diagnostics.iter().map(|found| found.code).collect();
        if codes != [code] {
            problems += &format!("{code}: the wrong example gets {codes:?}\n");
        }
        let said = wrong.render(false);
        let said = said.trim_end().to_owned() + "\n";
        if block(page, "text") != said {
            if std::env::var_os("ESM_BLESS").is_some() {
                let path = format!("../docs/src/codes/{code}.md");
                let (before, behind) = page.split_once("```text\n").unwrap();
                let (_, behind) = behind.split_once("```").unwrap();
                std::fs::write(path, format!("{before}```text\n{said}```{behind}")).unwrap();
            } else {
                problems += &format!("{code}: `esm check` says\n{said}\n");
            }
        }
        let right = checked(block(page, "esm"));
        if !right.diagnostics.is_empty() {
            problems += &format!("{code}: the right example gets\n{}\n", right.render(false));
        }
    }
    assert!(
        problems.is_empty(),
        "{problems}(ESM_BLESS=1 writes into the pages what is said)"
    );
}

#[test]
fn every_page_has_the_heading_and_the_parts_of_all() {
    for code in Code::ALL {
        let page = page(code);
        assert!(page.starts_with(&format!("# {code}: ")), "{code}");
        let parts: Vec<&str> = page
            .lines()
            .filter_map(|line| line.strip_prefix("## "))
            .collect();
        assert_eq!(
            parts,
            ["Why it matters", "Wrong", "Right", "Notes"],
            "{code}"
        );
        assert!(title(code).len() > 10, "{code}: {}", title(code));
    }
}

#[test]
fn codes_are_found_in_small_letters_and_unknown_ones_get_the_nearest() {
    let cases = [
        ("E008", Ok(Code::E008)),
        ("w110", Ok(Code::W110)),
        (
            "E0008",
            Err("there is no code `E0008`: did you mean `E008`?"),
        ),
        ("E108", Err("there is no code `E108`: did you mean `E008`?")),
        (
            "cheese",
            Err("there is no code `cheese`: `esm explain` lists them"),
        ),
        ("", Err("there is no code ``: `esm explain` lists them")),
    ];
    for (word, expected) in cases {
        assert_eq!(find(word), expected.map_err(str::to_owned), "{word}");
    }
}

#[test]
fn a_page_is_readable_without_its_marks() {
    let long = "word ".repeat(30);
    let markdown = format!(
        "# E001: a title\n\n{long}\n\n## Wrong\n\n```esm,wrong\nslot 1\n\n  x\n```\n\n- see [E002](E002.md), and `[a]`\n- {long}\n"
    );
    let mut expected = String::from("E001: a title\n=============\n\n");
    let line = "word ".repeat(19);
    expected += &format!(
        "{}\n{}\n\nWrong\n-----\n\n    slot 1\n\n      x\n\n",
        line.trim_end(),
        "word ".repeat(11).trim_end()
    );
    expected += "- see E002, and `[a]`\n";
    let line = "word ".repeat(19);
    expected += &format!(
        "- {}\n  {}\n",
        line.trim_end(),
        "word ".repeat(11).trim_end()
    );
    assert_eq!(for_terminal(&markdown), expected);
    for code in Code::ALL {
        let plain = for_terminal(page(code));
        assert!(!plain.contains("```") && !plain.contains("]("), "{plain}");
    }
}
