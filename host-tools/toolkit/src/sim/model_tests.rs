//! Models that stand in for tasks: what comes of them, and what is wrong with those that are wrong.

use super::run;
use crate::samples::directory_and_blob;
use crate::scenario;
use crate::scenario::ports::Ports;

/// Looks, drives, and turns where something is near; what is near it hears from a sonar.
const RIDE: &str = "
    interpreter slot 1;
    slot 1 period 10 ms duration 1 ms;
    slot 2 period 10 ms duration 1 ms;
    task Sonar slot 2 { out data range: Range; out flag broken; }
    task Drive slot 2 { in data range: Range; out data speed: Speed; out flag near; }
    task Turn slot 2 { out flag slow; }
    task Watch slot 2 { in data speed: Speed; out data spare: Speed; out flag fast; }
    machine Ride {
        region sonars { task Listen: Sonar; initial -> Listen; }
        region motion {
            task Ahead: Drive;
            task Away: Turn;
            initial -> Ahead;
            Ahead -> Away [.near];
            Away -> Ahead [exit];
        }
        region watch {
            task Look: Watch;
            state Fast timeout 1 s;
            initial -> Look;
            Look -> Fast [.fast];
            Fast -> Look [timeout];
        }
        path Listen.range -> Ahead.range;
        path Ahead.speed -> Look.speed;
    }
";

fn mistakes(text: &str) -> Vec<String> {
    let (directory, blob) = directory_and_blob(RIDE);
    let verified = esm_core::verify(blob).unwrap();
    let ports = Ports::of(&verified.tables(), &directory);
    let mistakes = scenario::bind::read(text, &directory, &ports).unwrap_err();
    let told = mistakes.iter();
    told.map(|mistake| format!("{}: {}", mistake.place, mistake.cause))
        .collect()
}

/// The transitions of a region, as `time in ms, state`.
fn entered(text: &str, region: &str) -> Vec<(u64, String)> {
    let (directory, blob) = directory_and_blob(RIDE);
    let verified = esm_core::verify(blob).unwrap();
    let ports = Ports::of(&verified.tables(), &directory);
    let bound = scenario::bind::read(text, &directory, &ports).unwrap();
    let mut trace = Vec::new();
    let outcome = run(verified, &directory, &bound, &mut trace).unwrap();
    assert!(outcome.is_good(), "{outcome:?}");
    let trace = String::from_utf8(trace).unwrap();
    let lines = trace
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    lines
        .filter(|line| line["kind"] == "transition")
        .filter_map(|line| {
            let to = line["to"]
                .as_str()?
                .strip_prefix(region)?
                .strip_prefix('/')?;
            Some((line["t_us"].as_u64()? / 1_000, to.to_owned()))
        })
        .collect()
}

fn steps(steps: &[(u64, &str)]) -> Vec<(u64, String)> {
    steps
        .iter()
        .map(|(t_ms, state)| (*t_ms, (*state).to_owned()))
        .collect()
}

#[test]
fn a_model_acts_each_time_that_its_state_is_entered() {
    let text = "model motion/Ahead set near after 50 ms\n\
                model motion/Away exit after 30 ms\n\
                at 60 ms expect motion/Away\nuntil 200 ms";
    // Entered in the macro step at 0, 50 ms later its flag is set; then 30 ms to its end.
    let expected = [
        (0, "Ahead"),
        (50, "Away"),
        (80, "Ahead"),
        (130, "Away"),
        (160, "Ahead"),
    ];
    assert_eq!(entered(text, "motion"), steps(&expected));
}

#[test]
fn what_is_not_current_reports_nothing() {
    let text = "model motion/Away set slow after 0 ms\nat 100 ms expect not motion/Away.slow\nuntil 100 ms";
    assert_eq!(entered(text, "motion"), steps(&[(0, "Ahead")]));
}

#[test]
fn data_goes_along_the_paths_of_the_mission_and_makes_flags() {
    // 2 m at first, 0 m 200 ms later: below 0.5 m from 150 ms on, looked at the macro step after.
    let text = "model sonars/Listen data range at 0 s 2.0, 200 ms 0.0\n\
                model motion/Ahead set near while range below 0.5\n\
                model motion/Away exit after 1 s\nuntil 300 ms";
    assert_eq!(
        entered(text, "motion"),
        steps(&[(0, "Ahead"), (160, "Away")])
    );
    // The same through a transformation: full speed above 1 m, none below 0.5 m.
    let text = "model sonars/Listen data range at 0s 0.0, 200ms 2.0\n\
                model motion/Ahead data speed by range 0.5 0.0, 1.0 0.4\n\
                model watch/Look set fast while speed above 0.2\n\
                until 300 ms";
    // 0.75 m are 0.2 m/s, at 75 ms.
    assert_eq!(entered(text, "watch"), steps(&[(0, "Look"), (80, "Fast")]));
}

#[test]
fn a_value_that_nothing_has_written_is_on_no_side_of_a_limit() {
    for side in ["below", "above"] {
        let text = format!("model motion/Ahead set near while range {side} 1\nuntil 100 ms");
        assert_eq!(entered(&text, "motion"), steps(&[(0, "Ahead")]), "{side}");
    }
}

#[test]
fn what_is_kept_follows_its_value_back() {
    let text = "model sonars/Listen data range at 0 s 0.0, 100 ms 1.0, 200 ms 0.0\n\
                model motion/Ahead data speed by range 0.0 0.0, 1.0 1.0\n\
                model watch/Look set fast while speed above 0.5\n\
                model watch/Look busy while speed above 0.7\n\
                at 40 ms expect not watch/Look.busy\nuntil 60 ms";
    assert_eq!(entered(text, "watch"), steps(&[(0, "Look"), (60, "Fast")]));
    let text = text.replace("set fast while speed above 0.5", "exit while speed above 2");
    let text = text.replace(
        "until 60 ms",
        "until 200 ms\nat 90 ms expect watch/Look.busy\nat 190 ms expect not watch/Look.busy",
    );
    assert_eq!(entered(&text, "watch"), steps(&[(0, "Look")]));
}

#[test]
fn what_is_wrong_with_a_model_is_told_with_its_place() {
    for (line, expected) in [
        (
            "model",
            "1:6: the line ends here, but the path of a task state, such as `motion/Cruise` must follow",
        ),
        (
            "model motion/Awai exit after 1 s",
            "1:14: region `motion` has no state `Awai`: did you mean `Away`?",
        ),
        (
            "model watch/Fast exit after 1 s",
            "1:7: `watch/Fast` is no task state: there is no task that could report anything",
        ),
        (
            "model motion/Away exits after 1 s",
            "1:19: `exits` is nothing that a model does: write `set`, `clear`, `exit`, `busy`, `free` or `data`: did you mean `exit`?",
        ),
        (
            "model motion/Away set fast after 1 s",
            "1:23: `motion/Away` has no flag `fast`",
        ),
        (
            "model motion/Away exit at 1 s",
            "1:24: `at` stands where `after 400 ms` or `while PORT below 0.2` is wanted",
        ),
        (
            "model motion/Away clear slow while x below 1",
            "1:30: `while` stands where `after 400 ms` is wanted",
        ),
        (
            "model motion/Away exit after 1",
            "1:31: the line ends here, but the unit of the time: `us`, `ms` or `s` must follow",
        ),
        (
            "model motion/Away exit after 1 s too",
            "1:34: `too` is too much: the line is complete before it",
        ),
        (
            "model motion/Ahead set near while rnge below 1",
            "1:35: `motion/Ahead` has no in data port `rnge` that is on a path of the mission: did you mean `range`?",
        ),
        (
            "model motion/Ahead set near while speed below 1",
            "1:35: `motion/Ahead` has no in data port `speed` that is on a path of the mission",
        ),
        (
            "model watch/Look data spare at 0 s 1",
            "1:23: `watch/Look` has no out data port `spare` that is on a path of the mission",
        ),
        (
            "model motion/Ahead set near while range under 1",
            "1:41: `under` stands where `below` or `above` is wanted",
        ),
        (
            "model motion/Ahead set near while range below inf",
            "1:47: `inf` is no number",
        ),
        (
            "model sonars/Listen data range at 1 s 2, 1 s 3",
            "1:42: each row of a table comes behind the one before: `1` does not",
        ),
        (
            "model sonars/Listen data range at 1 s 2 2 s 3",
            "1:41: `2` stands where a comma, and a row, or the line's end is wanted",
        ),
        (
            "model sonars/Listen data range at 1 s 2,",
            "1:41: the line ends here, but a time such as `200 ms` must follow",
        ),
    ] {
        let told = mistakes(&format!("{line}\nuntil 1 s"));
        assert_eq!(told, [expected], "{line}");
    }
    let many = "model motion/Away exit after 1 s\n".repeat(1_001);
    let told = mistakes(&format!("{many}until 1 s"));
    assert_eq!(
        told,
        ["1001:1: more than 1000 lines start with `model`: leave some out"]
    );
}
