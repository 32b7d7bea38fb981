//! Outputs of `esm`, as processes: what they never replace.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

const MISSION: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;
machine M { region r { state A; initial -> A; } }
";

/// Runs `esm` in `folder`; answers its status and what it says of what is wrong.
fn esm(folder: &Path, arguments: &str) -> (i32, String) {
    let done = Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(arguments.split_whitespace())
        .current_dir(folder)
        .env("XDG_CONFIG_HOME", folder)
        .env_remove("ESM_KEY")
        .env_remove("ESM_FIRMWARE")
        .output()
        .unwrap();
    let told = String::from_utf8(done.stderr).unwrap();
    (done.status.code().unwrap(), told)
}

fn files_in(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    files
        .filter(|entry| entry.path().is_file())
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read(entry.path()).unwrap())
        })
        .collect()
}

#[test]
fn what_cannot_be_had_again_is_never_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("m.esm"), MISSION).unwrap();
    fs::write(folder.join("s.scenario"), "until 10 ms\n").unwrap();
    fs::write(folder.join("my.world"), "world my\n").unwrap();
    fs::write(folder.join("fw.elf"), "elf").unwrap();
    let run = "run m.esm --board host --until 50ms";
    for made in [
        "key new -o my.key",
        "key new",
        &format!("{run} --record real.rec"),
        &format!("{run} --flash f.flash"),
    ] {
        assert_eq!(esm(folder, made).0, 0, "{made}");
    }
    fs::create_dir(folder.join("pictures")).unwrap();
    fs::copy(
        folder.join("real.rec"),
        folder.join("pictures/summary.json"),
    )
    .unwrap();
    let before = files_in(folder);
    let kept = fs::read(folder.join("pictures/summary.json")).unwrap();
    for wrong in [
        "build m.esm -o real.rec",
        "draw m.esm -o real.rec",
        "schedule m.esm --svg real.rec",
        "schedule m.esm --perfetto real.rec",
        "sim m.esm s.scenario --trace real.rec",
        "replay real.rec --trace real.rec",
        "build m.esm -o my.world",
        "log --port unix:nobody --record my.key --key my.key",
        "log --port unix:nobody --record esm/key",
        "upload m.esm --port unix:nobody --record my.key --key my.key",
        &format!("{run} --trace real.rec"),
        &format!("{run} --record real.rec"),
        &format!("{run} --out pictures"),
        &format!("{run} --flash f.flash --trace f.flash"),
        &format!("{run} --flash f.flash --record ./f.flash"),
        &format!("{run} --flash new.flash --record new.flash"),
        &format!("{run} --key my.key --trace my.key"),
        &format!("{run} --trace esm/key"),
        &format!("{run} --firmware fw.elf --trace fw.elf"),
        &format!("{run} --record x --trace ./x"),
        &format!("{run} --trace out/trace.jsonl --out out/"),
    ] {
        let (status, told) = esm(folder, wrong);
        assert_eq!(status, 2, "{wrong}: {told}");
        assert!(
            told.contains("name another file") || told.contains("name a file for each"),
            "{wrong}: {told}"
        );
    }
    assert!(
        files_in(folder) == before,
        "files were made, changed or removed"
    );
    let after = fs::read(folder.join("pictures/summary.json")).unwrap();
    assert!(after == kept, "the recording in the folder is another");
    // What goes nowhere, and older outputs, are replaced as ever.
    for right in [
        &format!("{run} --record /dev/null --trace /dev/null"),
        "build m.esm -o m.blob",
        "build m.esm -o m.blob",
        "replay real.rec --trace t.jsonl",
        "replay real.rec --trace t.jsonl",
    ] {
        let (status, told) = esm(folder, right);
        assert_eq!(status, 0, "{right}: {told}");
    }
}

/// A file of declarations is what a mission rests on.
#[test]
fn declarations_are_replaced_when_they_are_all_here_and_nothing_else_is() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let first = "tasks --board host -o tasks.esm";
    assert_eq!(esm(folder, first).0, 0);
    let printed = fs::read_to_string(folder.join("tasks.esm")).unwrap();
    assert!(printed.contains("\ntask Odometry slot 2 "), "{printed}");
    // Older declarations go when new ones are here, and only then.
    let (mark, _) = printed.split_once('\n').unwrap();
    let older = format!("{mark}\n\ntask Old slot 2 {{ }}\n");
    fs::write(folder.join("tasks.esm"), &older).unwrap();
    let (status, told) = esm(folder, "tasks --port unix:nobody -o tasks.esm");
    assert_eq!(status, 3, "{told}");
    let kept = fs::read_to_string(folder.join("tasks.esm")).unwrap();
    assert_eq!(kept, older);
    assert_eq!(esm(folder, first).0, 0);
    let again = fs::read_to_string(folder.join("tasks.esm")).unwrap();
    assert_eq!(again, printed);
    // What a person has written is no output, nor is what he has added to.
    for text in [
        MISSION.to_owned(),
        "// The tasks of my robot, by hand\ntask Mine slot 2 { }\n".to_owned(),
        format!("{printed}\nslot 2 period 10 ms duration 1 ms;\n"),
        format!("{printed}\ncontainer Mine {{ }}\n"),
        format!("{printed}\nuse \"mine.esm\";\n"),
    ] {
        fs::write(folder.join("mine.esm"), &text).unwrap();
        let (status, told) = esm(folder, "tasks --board host -o mine.esm");
        assert_eq!(status, 2, "{text}: {told}");
        assert!(told.contains("name another file"), "{told}");
        let mine = fs::read_to_string(folder.join("mine.esm")).unwrap();
        assert_eq!(mine, text);
    }
}

/// Where a run ended is in numbers what its picture shows.
#[test]
fn a_run_says_where_it_ended_and_what_file_was_meant() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("m.esm"), MISSION).unwrap();
    let (status, told) = esm(folder, "run m.esm --board host --until 50ms --out o");
    assert_eq!(status, 0, "{told}");
    let text = fs::read_to_string(folder.join("o/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    let end = &summary["end"];
    for key in ["x_m", "y_m", "heading_deg"] {
        assert!(end[key].is_f64(), "{key}: {text}");
    }
    // It has not moved.
    assert_eq!(end["from_start_m"], 0.0, "{text}");
    assert_eq!(end["turned_deg"], 0.0, "{text}");
    assert!(summary.get("interrupted").is_none(), "{text}");
    let (status, told) = esm(folder, "run n.esm --board host --until 50ms");
    assert_eq!(status, 1, "{told}");
    assert!(told.contains("; did you mean `m.esm`?"), "{told}");
}

#[test]
fn a_run_that_is_refused_leaves_no_files_and_empties_none() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("m.esm"), MISSION).unwrap();
    fs::write(
        folder.join("other.esm"),
        MISSION.replace("state A", "state A; state B"),
    )
    .unwrap();
    let wall = "world w\nstart 0,0 0\nwall 0,0 6,6\nroom r 0,0 1,0 1,1\n";
    fs::write(folder.join("wall.world"), wall).unwrap();
    fs::write(folder.join("short.flash"), "no flash").unwrap();
    fs::write(folder.join("old.jsonl"), "an older trace\n").unwrap();
    let run = "run m.esm --board host --until 50ms";
    assert_eq!(esm(folder, &format!("{run} --record real.rec")).0, 0);
    let before = files_in(folder);
    let files = "--flash new.flash --trace old.jsonl";
    for (refused, expected) in [
        (
            format!("{run} {files} --replay real.rec --link exchange"),
            2,
        ),
        (
            format!("run other.esm --board host {files} --replay real.rec"),
            1,
        ),
        (
            format!("{run} {files} --record new.rec --world wall.world"),
            1,
        ),
        (format!("{run} {files} --record no/folder/new.rec"), 3),
        (format!("{run} --flash new.flash --trace no/folder/t"), 3),
        (format!("{run} --flash no/folder/f --trace old.jsonl"), 3),
        (format!("{run} --flash new.flash --out m.esm/pictures"), 3),
        (
            format!("{run} --flash short.flash --trace old.jsonl --record new.rec"),
            1,
        ),
    ] {
        let (status, told) = esm(folder, &refused);
        assert_eq!(status, expected, "{refused}: {told}");
        assert!(!told.trim().is_empty(), "{refused}");
        let after = files_in(folder);
        assert!(
            after == before,
            "{refused}: {:?}",
            after.keys().collect::<Vec<_>>()
        );
    }
}
