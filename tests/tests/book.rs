//! The book and the front page against what they describe.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use esm_tests::command::{NOTHING_PLUGGED_IN, esm, esm_binary, root};
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
        "Cargo.toml",
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
    let blocks = ["rust", "text", "toml"]
        .map(|language| fenced(&chapter, language))
        .concat();
    assert!(blocks.len() >= 9, "only {} blocks of code", blocks.len());
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
fn the_picture_of_the_front_page_is_what_a_run_draws() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let patrol = "missions/patrol.esm";
    esm(&[
        "run", patrol, "--board", "host", "--world", "office", "--until", "120 s", "--out", out,
    ])
    .good();
    assert_is_picture("patrol.svg", &read(folder.path().join("path.svg")));
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
fn the_page_of_the_tasks_is_what_the_declarations_make() {
    let folder = tempfile::tempdir().unwrap();
    let made = folder.path();
    let rover = "missions/rover.esm";
    esm(&["tasks", "--page", made.to_str().unwrap(), rover]).good();
    let text = read(made.join("tasks.md"));
    let names = |folder: &Path| -> BTreeSet<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.collect()
    };
    let pictures = names(&made.join("img/tasks"));
    let page = root().join("docs/src/tasks.md");
    if std::env::var_os("ESM_BLESS").is_some() {
        std::fs::write(&page, &text).unwrap();
    }
    assert!(
        read(&page) == text,
        "tasks.md is another now: ESM_BLESS=1 writes it"
    );
    for name in &pictures {
        let drawn = read(made.join("img/tasks").join(name));
        assert_is_picture(&format!("tasks/{name}"), &drawn);
    }
    assert_eq!(names(&root().join("docs/src/img/tasks")), pictures);
    // A section for each task, each with something to say, and nothing left without a word.
    let declared = read(rover);
    let tasks = declared
        .lines()
        .filter_map(|line| line.strip_prefix("task "));
    let mut sections = 0;
    for task in tasks {
        let name = task.split(' ').next().unwrap();
        assert!(text.contains(&format!("\n## {name}\n\n")), "{name}");
        assert!(pictures.contains(&format!("{name}.svg")), "{name}");
        sections += 1;
    }
    assert_eq!(text.matches("\n## ").count(), sections);
    assert!(
        !text.contains("|  |"),
        "something is without a word of what it is"
    );
}

/// What a type is made of, as its section in the chapter on types has it: `name:type` for each row.
fn fields_in_the_chapter(chapter: &str, type_name: &str) -> String {
    let heading = format!("\n## {type_name}\n");
    let (_, behind) = chapter.split_once(&heading).unwrap_or_else(|| {
        panic!("the chapter on types has no section on {type_name}");
    });
    let section = behind.split("\n## ").next().unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    rows.map(|row| {
        let mut cells = row.split('|').map(|cell| cell.trim().trim_matches('`'));
        let (name, kind) = (cells.nth(1).unwrap(), cells.next().unwrap());
        format!("{name}:{kind}\n")
    })
    .collect()
}

#[test]
fn the_chapter_on_types_has_the_fields_of_the_code() {
    use rt_firmware::PortType;
    use rt_firmware::behaviours::BehaviourList;
    use rt_firmware::tasks::{
        ArrayRanges, Battery, Contact, GlobalPose, Line, Pose, Ranges, Twist, WheelControl,
        WheelSpeeds, YawRate,
    };

    let chapter = read("docs/src/types.md");
    let types = [
        (Pose::NAME, Pose::FIELDS),
        (Twist::NAME, Twist::FIELDS),
        (WheelSpeeds::NAME, WheelSpeeds::FIELDS),
        (WheelControl::NAME, WheelControl::FIELDS),
        (Ranges::NAME, Ranges::FIELDS),
        (ArrayRanges::NAME, ArrayRanges::FIELDS),
        (BehaviourList::NAME, BehaviourList::FIELDS),
        (Battery::NAME, Battery::FIELDS),
        (Line::NAME, Line::FIELDS),
        (Contact::NAME, Contact::FIELDS),
        (GlobalPose::NAME, GlobalPose::FIELDS),
        (YawRate::NAME, YawRate::FIELDS),
    ];
    for (name, fields) in types {
        assert_eq!(fields_in_the_chapter(&chapter, name), fields, "{name}");
    }
    // No task has a port of a type that the chapter leaves out.
    let mut checked = lang::load(&root().join("missions/rover.esm")).unwrap();
    let model = checked.model.take().unwrap();
    let ports = model.tasks.iter().flat_map(|task| &task.data);
    for port in ports {
        let name = port.type_name.as_str();
        let is_number = matches!(name, "bool" | "i32" | "u32" | "f32");
        let is_listed = types.iter().any(|(known, _)| *known == name);
        assert!(is_number || is_listed, "{name}");
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
    let host = host_tools::boards::HOST.capacities;
    for (row, on_board, on_host) in [
        ("bytes of a blob", "blob_bytes", host.blob_bytes.into()),
        (
            "32-bit words for the interpreter",
            "arena_words",
            host.arena_words.into(),
        ),
        ("slots", "slots", host.slots.into()),
        ("task states", "tasks", host.task_instances.into()),
        ("nets", "nets", host.nets.into()),
        (
            "exclusive groups",
            "exclusive_groups",
            host.exclusive_groups.into(),
        ),
    ] {
        let line = chapter
            .lines()
            .find(|line| line.starts_with(&format!("| {row} | ")) && line.matches('|').count() == 4)
            .unwrap_or_else(|| panic!("no row for {row}"));
        let cells: Vec<&str> = line.split(" | ").collect();
        for (cell, number) in [(1, setting(on_board)), (2, on_host)] {
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
            "deadline misses of a slot in a row",
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

/// Files of Markdown outside the book that show commands.
const OTHER_PAGES: [&str; 9] = [
    "README.md",
    "docs/benchmarks.md",
    "docs/link.md",
    "editors/README.md",
    "editors/vscode/README.md",
    "examples/my_pico/README.md",
    "examples/my_robot/README.md",
    "missions/README.md",
    "clients/python/README.md",
];

/// Each command line of the book and of the other pages, with its page: what stands in fenced `sh`
/// blocks, without comments.
fn commands() -> Vec<(PathBuf, String)> {
    let mut pages = chapters();
    pages.sort();
    pages.extend(OTHER_PAGES.map(|page| root().join(page)));
    let mut found = Vec::new();
    for page in pages {
        for line in fenced(&read(&page), "sh").concat().lines() {
            let command = line.split(" #").next().unwrap_or_default().trim();
            if !command.is_empty() && !command.starts_with('#') {
                found.push((page.clone(), command.to_owned()));
            }
        }
    }
    found
}

/// Splits a command into words; quotes keep words together.
fn words(command: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (index, part) in command.split('\'').enumerate() {
        match index % 2 {
            1 => found.push(part.to_owned()),
            _ => found.extend(part.split_whitespace().map(str::to_owned)),
        }
    }
    found
}

/// Files that commands of the book read, and of which the text says that somebody has made them
/// before.
fn stock() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let patrol = "missions/patrol.esm";
    for blob in ["patrol.blob", "before.blob", "after.blob"] {
        esm(&["build", patrol, "-o", &path(blob)]).good();
    }
    let text = read(patrol).replace("use \"", "use \"missions/");
    for name in ["patrol.esm", "patrol_faster.esm"] {
        std::fs::write(path(name), &text).unwrap();
    }
    let square = read("missions/square.esm").replace("use \"", "use \"missions/");
    std::fs::write(path("square.esm"), square).unwrap();
    for name in ["patrol", "drive"] {
        let [recording, trace] = ["rec", "jsonl"].map(|ending| path(&format!("{name}.{ending}")));
        let run = ["run", patrol, "--board", "host", "--until", "120 s"];
        let kept = ["--record", &recording, "--trace", &trace];
        esm(&[run.as_slice(), &kept].concat()).good();
    }
    let run = [
        "system",
        "run",
        "missions/head_and_base/head_and_base.system",
    ];
    let [recordings, trace] = ["robot.recs", "first.jsonl"].map(path);
    let kept = ["--until", "5 s", "--record", &recordings, "--trace", &trace];
    esm(&[run.as_slice(), &kept].concat()).good();
    esm(&["key", "new", "-o", &path("robot7.key")]).good();
    let ticks = "t_us,left,right\n0,65000,0\n20000,65030,32\n40000,65060,64\n";
    std::fs::write(path("ticks.csv"), ticks).unwrap();
    let squares = "direction,x_mm,y_mm\ncw,-12,-20\ncw,-15,-18\nccw,-4,9\nccw,-6,8\n";
    std::fs::write(path("squares.csv"), squares).unwrap();
    folder
}

/// A folder to run a command in as at the top of the checkout, with these files beside.
fn playground(stock: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["missions", "examples", "boards"] {
        std::os::unix::fs::symlink(root().join(name), at(name)).unwrap();
    }
    for entry in std::fs::read_dir(stock).unwrap() {
        let path = entry.unwrap().path();
        let to = folder.path().join(path.file_name().unwrap());
        match path.is_dir() {
            true => std::os::unix::fs::symlink(&path, to).unwrap(),
            false => _ = std::fs::copy(&path, to).unwrap(),
        }
    }
    folder
}

/// Commands of the book that end as they are meant to, and not with 0: a run whose button is
/// pressed, or whose robot is left alone, and a fault that was planted and is found.
const ENDS_WITH_1: [&str; 3] = ["--estop '", "--cut-link '", "--fault "];

/// Runs `esm` as a page shows it, in a folder; what is wrong with it. What needs a robot is given a
/// port that is none, and must get so far as to say so.
fn wrong_with(command: &str, folder: &Path) -> Option<String> {
    let (command, input) = match command.split_once(" < ") {
        Some((command, file)) => (command, Some(folder.join(file))),
        None => (command, None),
    };
    let mut arguments = words(command.strip_prefix("esm ")?);
    let nowhere = folder.join("nowhere").display().to_string();
    let needs_robot = arguments[0] == "flash" || arguments.iter().any(|word| word == "--port");
    for place in 1..arguments.len() {
        if arguments[place - 1] == "--port" {
            arguments[place] = nowhere.clone();
        }
    }
    match arguments[0].as_str() {
        // It goes on until it is ended: what it is given is looked at before the help is printed.
        "board" => arguments.push("--help".to_owned()),
        // What the page has built before.
        "flash" => arguments.retain(|word| !word.ends_with(".elf")),
        // The same run on the host, in hundredths of the time.
        "run" | "record" if command.contains(".esm") && !command.contains("--board host") => {
            if let Some(place) = arguments.iter().position(|word| word == "--board") {
                arguments.drain(place..place + 2);
            }
            arguments.extend(["--board", "host"].map(str::to_owned));
            if let Some(place) = arguments.iter().position(|word| word == "--firmware") {
                arguments.drain(place..place + 2);
            }
            // Its tasks are in its own program.
            if arguments[1].contains("my_robot") {
                let mission = arguments[1].replace("~/", "examples/");
                arguments = vec!["check".to_owned(), mission];
            }
        }
        _ => {}
    }
    let mut esm = Command::new(esm_binary());
    esm.args(&arguments)
        .current_dir(folder)
        .env("XDG_CONFIG_HOME", folder.join("config"))
        .envs(NOTHING_PLUGGED_IN)
        .env_remove("ESM_KEY")
        .stdin(input.map_or_else(Stdio::null, |file| File::open(file).unwrap().into()));
    let done = esm.output().unwrap();
    let expected = match () {
        () if needs_robot => 3,
        () if ENDS_WITH_1.iter().any(|part| command.contains(part)) => 1,
        () => 0,
    };
    let err = String::from_utf8_lossy(&done.stderr);
    (done.status.code() != Some(expected)).then(|| format!("{command}: {:?}\n{err}", done.status))
}

#[test]
fn every_command_of_esm_in_the_book_works_as_it_stands() {
    let mut problems = Vec::new();
    let mut ran = 0;
    let stock = stock();
    for (page, command) in commands() {
        let on_screen = command.ends_with("--step");
        let is_front_page = page.ends_with("README.md") && page.parent() == Some(root());
        if !command.starts_with("esm ") || on_screen || is_front_page {
            continue;
        }
        ran += 1;
        let folder = playground(stock.path());
        // Nothing writes over a recording or a key: what makes one finds none.
        for pair in words(&command).windows(2) {
            if ["--record", "-o"].contains(&pair[0].as_str()) {
                let _ = std::fs::remove_file(folder.path().join(&pair[1]));
            }
        }
        if let Some(problem) = wrong_with(&command, folder.path()) {
            problems.push(format!("{}: {problem}", page.display()));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
    assert!(ran >= 70, "only {ran} commands");
}

#[test]
fn every_other_command_in_the_book_names_what_there_is() {
    let help = read("xtask/src/main.rs");
    let campaigns = read("xtask/src/campaign.rs");
    for (page, command) in commands() {
        let page = page.display();
        assert!(
            !command.contains("cargo esm"),
            "{page}: the book writes `esm`: {command}"
        );
        let words: Vec<&str> = command.split_whitespace().collect();
        if let Some(rest) = command.strip_prefix("cargo xtask ") {
            let mut rest = rest.split_whitespace();
            let (name, more) = (rest.next().unwrap(), rest.next());
            assert!(help.contains(&format!("\n  {name} ")), "{page}: {command}");
            let campaign = more.filter(|_| name == "campaign");
            let known = |name: &str| campaigns.contains(&format!("name: \"{name}\""));
            assert!(campaign.is_none_or(known), "{page}: {command}");
        }
        for pair in words.windows(2) {
            if let ["--test", name] = pair {
                let path = root().join(format!("tests/tests/{name}.rs"));
                assert!(path.is_file(), "{page}: {command}");
            }
        }
    }
}
