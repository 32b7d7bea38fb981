//! `esm test`: scenarios beside their missions.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn esm(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(std::env::var_os("CARGO_BIN_EXE_esm").unwrap())
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

const LAMP: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; task Dim slot 1 { out flag dark; }\n\
                    machine Lamp { region r { task Watch: Dim; state On; initial -> Watch; Watch -> On on pulse [.dark]; } }\n";
const GOOD: &str = "at 20 ms set r/Watch.dark\nat 20 ms expect r/On\nuntil 30 ms\n";

#[test]
fn the_missions_that_ship_do_what_their_scenarios_say() {
    let root = Path::new("..");
    let ended = esm(root, &["test", "missions"]);
    let (out, err) = (text(&ended.stdout), text(&ended.stderr));
    assert_eq!(ended.status.code(), Some(0), "{out}{err}");
    for mission in ["missions/patrol/", "missions/follow_wall/"] {
        let line = format!("ok      {mission}");
        assert!(
            out.lines().any(|found| found.starts_with(&line)),
            "{mission}: {out}"
        );
    }
    assert!(out.ends_with(" 0 failed\n"), "{out}");
}

#[test]
fn a_run_tells_of_every_scenario_and_of_what_failed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("lamp")).unwrap();
    let files = [
        ("lamp.esm", LAMP),
        ("lamp.scenario", GOOD),
        (
            "lamp/late.scenario",
            "at 20 ms set r/Watch.dark\nat 10 ms expect r/On\nuntil 30 ms\n",
        ),
        (
            "lamp/wrong.scenario",
            "at 20 mss expect r/Onn\nuntil 30 ms\nat 1 ms expect r/Off\n",
        ),
        ("broken.esm", "machine M { region r { initial -> Q; } }\n"),
        ("broken.1.scenario", "until 1 s\n"),
        ("broken.2.scenario", "until 1 s\n"),
        ("alone.scenario", "until 1 s\n"),
    ];
    for (name, content) in files {
        fs::write(at(name), content).unwrap();
    }
    let ended = esm(folder.path(), &["test", "."]);
    let (out, err) = (text(&ended.stdout), text(&ended.stderr));
    assert_eq!(ended.status.code(), Some(1), "{out}{err}");
    let lines = [
        "FAILED  ./alone.scenario",
        "FAILED  ./broken.1.scenario",
        "FAILED  ./broken.2.scenario",
        "FAILED  ./lamp/late.scenario",
        "FAILED  ./lamp/wrong.scenario",
        "ok      ./lamp.scenario: 1 expectation in 30 ms, 4 macro steps",
        "",
        "6 scenarios of 2 missions: 1 ok, 5 failed",
    ];
    assert_eq!(out.lines().collect::<Vec<_>>(), lines);
    for said in [
        "./alone.scenario: it has no mission: there is none of ./alone.esm, ",
        "./broken.1.scenario: its mission does not compile:\n",
        "unknown state `Q`",
        "./broken.2.scenario: its mission does not compile: see above\n",
        "./lamp/late.scenario:2:17: expected `r/On` at 10 ms, but after the macro step at 10 ms current was r/Watch\n     0 ms  r/initial -> r/Watch on pulse\n    10 ms  current: r/Watch\n  > 10 ms  line 2: at 10 ms expect r/On\n",
        "./lamp/wrong.scenario:1:4: error: the unit of a time is",
        "./lamp/wrong.scenario:1:20: error: region `r` has no state `Onn`: did you mean `On`?\n",
        "./lamp/wrong.scenario:3:18: error: region `r` has no state `Off`",
    ] {
        assert!(err.contains(said), "{said}\n{err}");
    }
    assert_eq!(err.matches("unknown state").count(), 1, "{err}");

    let filtered = esm(folder.path(), &["test", ".", "lamp.sc", "--json"]);
    assert_eq!(filtered.status.code(), Some(0));
    let expected = "{\"scenario\":\"./lamp.scenario\",\"mission\":\"./lamp.esm\",\"ok\":true,\"macro_steps\":4,\"simulated_us\":30000,\"met\":1,\"failures\":[]}\n\
                    {\"passed\":1,\"failed\":0}\n";
    assert_eq!(text(&filtered.stdout), expected);
}

#[test]
fn nothing_to_test_is_an_error_that_says_what_was_looked_for() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("lamp.esm"), LAMP).unwrap();
    let cases: [(&[&str], &str); 2] = [
        (
            &["test", "."],
            "error: . has no scenarios: a file `NAME.scenario`",
        ),
        (&["test", "gone"], "error: there is no gone: name a folder"),
    ];
    for (arguments, said) in cases {
        let ended = esm(folder.path(), arguments);
        assert_eq!(ended.status.code(), Some(1), "{arguments:?}");
        assert!(
            text(&ended.stderr).starts_with(said),
            "{}",
            text(&ended.stderr)
        );
    }
    fs::write(folder.path().join("lamp.scenario"), GOOD).unwrap();
    let ended = esm(folder.path(), &["test", ".", "dark"]);
    assert_eq!(ended.status.code(), Some(1));
    assert_eq!(
        text(&ended.stderr),
        "error: . has 1 scenario, and none with `dark` in its path\n"
    );
}
