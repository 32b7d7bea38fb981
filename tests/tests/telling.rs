//! What commands tell a person of a robot is so: what is stopped does not run, and what has
//! finished does not run on.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use esm_tests::command::{Robot, Running, esm};

/// A mission that is over after a moment: the only state that it ends in is final.
fn short_mission(folder: &Path) -> String {
    let path = folder.join("short.esm");
    let machine = "machine Short { region r { state A timeout 200 ms; initial -> A; \
        A -> final [timeout]; } region s { state B timeout 100 ms; initial -> B; \
        B -> final [timeout]; } }";
    let text = format!("interpreter slot 1; slot 1 period 50 ms duration 2 ms; {machine}");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn an_upload_to_a_stopped_robot_says_that_it_does_not_run_and_what_to_do() {
    let robot = Robot::start("host", None);
    for (stop, expected, mode) in [
        (
            &["stop", "--emergency"][..],
            "emergency stop is latched: the motors are off until `esm start --release`",
            "emergency stop",
        ),
        (
            &["stop"],
            "the robot is stopped: the motors are off until `esm start`",
            "stopped",
        ),
    ] {
        robot.esm(stop).good();
        for trial in [&[][..], &["--trial", "60 s", "--on-trial", "confirm"]] {
            let upload = [&["upload", "missions/patrol.esm"][..], trial].concat();
            let told = robot.esm(&upload).good();
            let both = format!("{}{}", told.out, told.err);
            assert!(!both.contains(" runs"), "{stop:?}: {both}");
            assert!(!both.contains("unseen") && !both.contains("seen to run"));
            assert!(both.contains(expected), "{stop:?}: {both}");
        }
        let upload = ["upload", "missions/patrol.esm", "--on-trial", "confirm"];
        let told = robot.esm(&[&upload[..], &["--json"]].concat()).good();
        let told = told.json();
        assert_eq!(told["mode"], mode, "{told:#}");
        assert_eq!(told["confirmed"], true, "{told:#}");
        robot.esm(&["start", "--release"]).good();
    }
    let told = robot.esm(&["upload", "missions/patrol.esm", "--json"]);
    assert_eq!(told.good().json()["mode"], "running");
}

#[test]
fn a_mission_whose_regions_are_all_final_is_told_as_finished() {
    let folder = tempfile::tempdir().unwrap();
    let short = short_mission(folder.path());
    let robot = Robot::start("host", None);
    let told = robot.esm(&["upload", "missions/patrol.esm"]).good().out;
    assert!(told.contains("runs: "), "{told}");
    assert_eq!(robot.status()["finished"], false);
    let told = robot.esm(&["start"]).good().out;
    assert!(told.contains("runs already"), "{told}");

    let told = robot.esm(&["upload", &short]).good().out;
    assert!(
        told.contains("has finished") && !told.contains("runs"),
        "{told}"
    );
    let status = robot.status();
    // Programs find what they found before, and one key more.
    assert_eq!(status["mode"], "running", "{status:#}");
    assert_eq!(status["finished"], true, "{status:#}");
    let told = robot.esm(&["status"]).good().out;
    let mode = told.lines().find(|line| line.starts_with("mode")).unwrap();
    assert!(
        mode.contains("finished") && !mode.contains("running"),
        "{told}"
    );
    let top = robot.esm(&["top", "--once"]).good().out;
    assert!(
        top.contains("finished") && !top.contains("running"),
        "{top}"
    );
    let top = robot.esm(&["top", "--once", "--json"]).good().json();
    assert_eq!(top["finished"], true, "{top:#}");
    let told = robot.esm(&["start"]).good().out;
    assert!(
        told.contains("finished") && told.contains("esm stop"),
        "{told}"
    );
    let news = Running::esm(&["log", "--news", "100 ms", "--port", robot.port()]);
    let news = news.until("news", |log| log.out().lines().count() > 2);
    let news = news.interrupted().good().out;
    assert!(news.contains("has finished"), "{news}");
    assert!(!news.contains(" runs"), "{news}");

    robot.esm(&["stop"]).good();
    let status = robot.status();
    assert_eq!(status["finished"], false, "{status:#}");
    let told = robot.esm(&["start"]).good().out;
    assert!(told.contains("from its beginning"), "{told}");
    robot.status_when("the end", |status| status["finished"] == true);
}

#[test]
fn the_summary_of_a_run_says_when_its_mission_finished() {
    let folder = tempfile::tempdir().unwrap();
    let short = short_mission(folder.path());
    let run = |mission: &str, until: &str| {
        esm(&["run", mission, "--board", "host", "--until", until]).good()
    };
    let told = run(&short, "1 s").out;
    // More than 200 ms after the step at 0 s, by steps of 50 ms.
    assert!(
        told.contains("finished                 at 0.250 s"),
        "{told}"
    );
    let told = run(&short, "100 ms").out;
    assert!(!told.contains("finished"), "{told}");
    let out = folder.path().to_str().unwrap();
    let run = ["run", &short, "--board", "host", "--until", "1 s"];
    esm(&[&run[..], &["--out", out]].concat()).good();
    let summary = std::fs::read(folder.path().join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["finished_s"], 0.25);
}

#[test]
fn a_black_box_names_the_mission_that_it_lacks_and_the_option_that_takes_it() {
    let folder = tempfile::tempdir().unwrap();
    let short = short_mission(folder.path());
    let robot = Robot::start("host", None);
    let told = robot.esm(&["upload", &short, "--json"]).good().json();
    let hash = told["hash"].as_str().unwrap().to_owned();
    robot.esm(&["upload", "missions/patrol.esm"]).good();
    let told = robot.esm(&["blackbox"]).good();
    assert!(told.out.contains("transition "), "{told:#?}");
    let note = told
        .err
        .lines()
        .find(|line| line.contains("--mission FILE"));
    assert!(note.is_some_and(|note| note.contains(&hash)), "{told:#?}");
    let named = robot.esm(&["blackbox", "--mission", &short]).good();
    assert!(named.out.contains("r/A -> r/final"), "{named:#?}");
    assert!(!named.err.contains("--mission"), "{named:#?}");
    let other = ["blackbox", "--mission", "missions/follow_wall.esm"];
    let other = robot.esm(&other).good();
    assert!(
        other.err.contains("follow_wall.esm is mission ") && other.err.contains(&hash),
        "{other:#?}"
    );
}

#[test]
fn a_log_says_how_many_lines_are_lost_where_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("chatter.esm");
    let rover = esm_tests::command::root().join("missions/rover.esm");
    let text = format!(
        "use {rover:?};\n\
         interpreter slot 1; slot 1 period 2 ms duration 200 us;\n\
         slot 2 period 20 ms duration 1500 us; slot 3 period 40 ms duration 1 ms;\n\
         machine Chatter {{\n\
         region w {{ task Where: Odometry; initial -> Where; Where -> Where on *; }}\n\
         region b {{ task Measure: BatteryMonitor; initial -> Measure; Measure -> Measure on *; }}\n\
         region d {{ task Write: Logger; initial -> Write; Write -> Write on *; }}\n\
         path Where.pose -> Write.pose; path Measure.battery -> Write.battery; }}\n"
    );
    std::fs::write(&path, text).unwrap();
    let robot = Robot::start("host", None);
    robot.esm(&["upload", path.to_str().unwrap()]).good();
    // Nobody listens, until far more is said than is kept.
    robot.status_when("many lines", |status| {
        status["t_us"].as_u64() > Some(20_000_000)
    });
    let is_line = |line: &str| line.contains("battery");
    let is_loss = |line: &str| line.ends_with("lost: the robot had no room for more");
    let log = Running::esm(&["log", "--port", robot.port()]);
    let log = log.until("a loss and a line", |log| {
        let out = log.out();
        let mut behind = out.lines().skip_while(|line| !is_loss(line));
        behind.next().is_some() && behind.any(is_line)
    });
    let told = log.interrupted().good().out;
    let loss = told.lines().position(is_loss).unwrap();
    // What was kept from the beginning stands before it.
    assert!(loss > 100, "{loss}");
    let lines = told.lines().nth(loss).unwrap();
    let count: u32 = lines.split(' ').next().unwrap().parse().unwrap();
    assert!(count > 100, "{lines}");
    // On a busy machine the line loses some, too.
    assert!((told.lines()).all(|line| is_line(line) || line.contains("lost")));

    let waited = robot.status()["t_us"].as_u64().unwrap() + 20_000_000;
    robot.status_when("many lines more", |status| {
        status["t_us"].as_u64() > Some(waited)
    });
    let log = Running::esm(&["log", "--json", "--port", robot.port()]);
    let log = log.until("a loss", |log| {
        log.out().contains(r#"{"what":"lost","lines":"#)
    });
    let told = log.interrupted().good().out;
    let first: serde_json::Value = serde_json::from_str(told.lines().next().unwrap()).unwrap();
    assert_eq!(
        (&first["what"], &first["clock"]),
        (&"line".into(), &().into())
    );
    assert!(
        first["text"].as_str().unwrap().contains("battery"),
        "{first}"
    );
}

#[test]
fn a_failed_expectation_shows_what_happened_up_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let mission = file(
        "m.esm",
        "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms;\n\
         task T slot 2 { out flag near; }\n\
         machine M { event Go; region r { task A: T; state B timeout 20 ms; initial -> A;\n\
         A -> B [.near] / send Go; B -> A [timeout]; }\n\
         region s { state C; state D; initial -> C; C -> D on Go; } }\n",
    );
    let scenario = file(
        "m.scenario",
        "at 20 ms set r/A.near   # something comes\nat 30 ms expect r/A\nuntil 100 ms\n",
    );
    let expected = "\
m.scenario:2:17: expected `r/A` at 30 ms, but after the macro step at 30 ms current was r/B, s/D
     0 ms  r/initial -> r/A on pulse
     0 ms  s/initial -> s/C on pulse
    20 ms  line 1: at 20 ms set r/A.near
    20 ms  r/A -> r/B on pulse
    20 ms  s/C -> s/D on Go
    30 ms  current: r/B, s/D
  > 30 ms  line 2: at 30 ms expect r/A
";
    let told = esm(&["test", folder.path().to_str().unwrap()]).ended(1);
    assert!(told.err.ends_with(expected), "{}", told.err);
    let told = esm(&["sim", &mission, &scenario]).ended(1);
    assert!(told.err.ends_with(expected), "{}", told.err);
    let told = esm(&["test", folder.path().to_str().unwrap(), "--json"]).ended(1);
    let first: serde_json::Value = serde_json::from_str(told.out.lines().next().unwrap()).unwrap();
    let fail = &first["failures"][0];
    assert_eq!(
        fail["timeline"][6],
        "  > 30 ms  line 2: at 30 ms expect r/A"
    );
    // Long before, only the last of it is told, behind what was current then.
    let scenario = file(
        "m.scenario",
        "at 20 ms set r/A.near\nat 900 ms expect r/B\n\
        at 100 ms set r/A.near\nat 300 ms set r/A.near\nat 600 ms set r/A.near\nuntil 1 s\n",
    );
    let told = esm(&["sim", &mission, &scenario]).ended(1).err;
    let rows: Vec<&str> = told.lines().filter(|line| line.contains(" ms  ")).collect();
    assert_eq!(rows[0].trim(), "130 ms  current: r/A, s/D", "{told}");
    assert!(rows.len() < 12, "{told}");
}

#[test]
fn what_is_no_news_is_told_once_and_advice_is_of_use() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let unused = |done: &esm_tests::command::Done| done.err.contains("not used by this mission");
    let mission = "missions/tutorial/1_line.esm";
    assert!(unused(&esm(&["check", mission]).good()));
    for command in [
        &["build", mission, "-o", &file("m.blob")][..],
        &["draw", mission, "-o", &file("m.svg")],
        &["schedule", mission],
        &["test", "missions/tutorial"],
        &["run", mission, "--board", "host", "--until", "1 s"],
    ] {
        let done = esm(command).good();
        assert!(!unused(&done), "{command:?}: {}", done.err);
    }
    let robot = Robot::start("host", None);
    let anyone = "takes commands from anyone";
    let told = robot.esm(&["upload", mission]).good();
    assert_eq!(told.err.matches(anyone).count(), 1, "{}", told.err);
    assert!(!unused(&told), "{}", told.err);
    for command in [&["status"][..], &["stop"], &["start"], &["blackbox"]] {
        let told = robot.esm(command).good();
        assert!(!told.err.contains(anyone), "{command:?}: {}", told.err);
    }

    // The owner's key is elsewhere: a new one would not be the robot's.
    let key = file("owner.key");
    esm(&["key", "new", "-o", &key]).good();
    robot.esm(&["key", "install", "--key", &key]).good();
    let gone = file("gone.key");
    for command in [
        &["upload", mission, "--key", &gone][..],
        &["start", "--key", &gone],
        &["key", "install", "--key", &gone],
    ] {
        let told = robot.esm(command).ended(3).err;
        assert!(told.contains("there is no key at"), "{command:?}: {told}");
        assert!(!told.contains("key new"), "{command:?}: {told}");
    }
}

#[test]
fn how_much_longer_slots_may_last_is_never_nought_percent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slots.esm");
    let slot = |number, duration| format!("slot {number} period 10 ms duration {duration} ms; ");
    for (slots, alone, together) in [
        (
            [slot(1, 5), slot(2, 5)].concat(),
            "no slot may last longer, not even one alone",
            "all at once may not, not even by 0.1 % each",
        ),
        (
            [slot(1, 2), slot(2, 5)].concat(),
            "one slot alone may last longer by what stands under `may grow`",
            "all at once may not, not even by 0.1 % each",
        ),
        (
            slot(1, 5),
            "one slot alone may last longer by what stands under `may grow`",
            "all at once by 100.0 % each",
        ),
    ] {
        std::fs::write(&path, format!("interpreter slot 1; {slots}")).unwrap();
        let told = esm(&["schedule", path.to_str().unwrap()]).good().out;
        let line = format!("with these starts {alone};\n{together}\n");
        assert!(told.contains(&line), "{told}");
    }
}
