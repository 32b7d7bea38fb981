//! The book and the front page against what they describe.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use esm_tests::command::{esm, root};
use host_tools::lang::{self, Code};
use host_tools::pictures::{MissionStates, RegionStates, StateSpan, Timeline};

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
fn the_lines_of_the_tutorial_are_those_of_its_steps() {
    let folder = root().join("missions/tutorial");
    let mut steps = String::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "esm") {
            steps += &read(&path);
        }
    }
    let blocks = fenced(&read("docs/src/tutorial.md"), "text");
    assert!(blocks.len() >= 15, "only {} blocks of code", blocks.len());
    for block in blocks {
        assert!(steps.contains(&block), "in no step:\n{block}");
    }
}

/// The example of the chapter on semantics: what `esm sim` makes of it.
fn trace_of_the_example() -> String {
    let chapter = read("docs/src/semantics.md");
    let [mission, scenario] = ["esm", "scenario"].map(|tag| fenced(&chapter, tag).join(""));
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let [mission, scenario] = [file("m.esm", &mission), file("m.scenario", &scenario)];
    esm(&["sim", &mission, &scenario, "--trace", "-"])
        .good()
        .out
}

#[test]
fn the_trace_in_the_chapter_on_semantics_is_what_sim_prints() {
    let trace = trace_of_the_example();
    let mut rest = trace.lines();
    let told = fenced(&read("docs/src/semantics.md"), "trace");
    assert!(told.len() >= 5);
    for line in told.iter().flat_map(|block| block.lines()) {
        assert!(
            rest.any(|printed| printed == line),
            "not in this order:\n{line}\n{trace}"
        );
    }
    // What the chapter leaves out are steps in which nothing happens.
    let transitions = |text: &str| text.matches(r#""kind":"transition""#).count();
    assert_eq!(transitions(&told.concat()), transitions(&trace));
}

/// A picture of the book, compared with what a command draws now; `ESM_BLESS=1` writes it.
fn assert_is_picture(name: &str, drawn: &str) {
    let path = root().join("docs/src/img").join(name);
    if std::env::var_os("ESM_BLESS").is_some() {
        std::fs::write(&path, drawn).unwrap();
    }
    assert!(
        read(&path) == drawn,
        "{name} is another now: look at it with ESM_BLESS=1"
    );
}

#[test]
fn the_pictures_of_the_tutorial_are_what_the_last_step_draws() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let step = "missions/tutorial/6_everything.esm";
    esm(&[
        "run", step, "--board", "host", "--world", "track", "--until", "120 s", "--out", out,
    ])
    .good();
    assert_is_picture("track.svg", &read(folder.path().join("path.svg")));
}

#[test]
fn the_diagrams_of_the_book_are_what_draw_draws() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (example, drawn) = (path("example.esm"), path("drawn.svg"));
    let mission = fenced(&read("docs/src/semantics.md"), "esm").concat();
    std::fs::write(&example, mission).unwrap();
    for (mission, more, picture) in [
        (example.as_str(), &[][..], "example.svg"),
        (
            "missions/tutorial/4_search.esm",
            &["--no-data"],
            "search.svg",
        ),
        (
            "missions/tutorial/4_search.esm",
            &["--no-data", "--depth", "0", "--legend"],
            "legend.svg",
        ),
    ] {
        let mut arguments = vec!["draw", mission, "-o", &drawn];
        arguments.extend(more);
        esm(&arguments).good();
        assert_is_picture(picture, &read(&drawn));
    }
}

#[test]
fn the_schedules_of_the_book_are_what_schedule_shows() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (robot, drawn) = (path("robot.esm"), path("drawn.svg"));
    let page = read("docs/src/slots.md");
    std::fs::write(&robot, fenced(&page, "esm").concat()).unwrap();
    for (file, picture) in [
        ("missions/patrol.esm", "slots_patrol.svg"),
        (robot.as_str(), "slots_robot.svg"),
    ] {
        esm(&["schedule", file, "--svg", &drawn]).good();
        assert_is_picture(picture, &read(&drawn));
    }
    let shown = esm(&["schedule", "missions/patrol.esm"]).good().out;
    let told = fenced(&page, "text");
    assert!(shown.contains(told[1].trim_end()), "{shown}");
}

#[test]
fn the_states_of_the_example_are_drawn_as_its_trace_has_them() {
    let trace = trace_of_the_example();
    let mut regions: Vec<RegionStates> = Vec::new();
    let mut end_us = 0;
    for line in trace.lines() {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        let Some(active) = line["active"].as_array() else {
            continue;
        };
        let start_us = line["t_us"].as_u64().unwrap();
        end_us = start_us + 10_000;
        for state in active {
            let (path, state) = state.as_str().unwrap().rsplit_once('/').unwrap();
            let known = regions.iter().position(|region| region.path == path);
            let place = known.unwrap_or_else(|| {
                regions.push(RegionStates {
                    path: path.to_owned(),
                    spans: Vec::new(),
                });
                regions.len() - 1
            });
            let spans = &mut regions[place].spans;
            match spans.last_mut() {
                Some(last) if last.state == state && last.end_us == start_us => {
                    last.end_us = end_us;
                }
                _ => spans.push(StateSpan {
                    state: state.to_owned(),
                    start_us,
                    end_us,
                }),
            }
        }
    }
    let picture = Timeline {
        title: "The example, from macro step to macro step".to_owned(),
        missions: vec![MissionStates {
            name: "Example".to_owned(),
            start_us: 0,
            end_us,
            regions,
        }],
        marks: Vec::new(),
    };
    assert_is_picture("example_states.svg", &picture.scene().to_svg());
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
