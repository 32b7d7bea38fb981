//! What `inspect` says of blobs that the compiler made.

use esm_core::verify;

use super::{Counts, Report};
use crate::compile::compile;
use crate::compile::test_models::{STARTS_US, cd_player, everything};
use crate::model::Model;

fn report(model: &Model) -> Report {
    Report::of(&verify(compile(model, &STARTS_US).unwrap()).unwrap())
}

#[test]
fn the_cd_player_reads_back() {
    let report = report(&cd_player());
    assert_eq!(
        report.counts,
        Counts {
            bytes: report.counts.bytes,
            states: 9,
            transitions: 27,
            containers: 2,
            instances: 2,
            events: 8,
            flags: 2 + 11 + 2,
            ram_bytes: 4 * (2 + 2 + 1 + 1 + 3 + 16),
        }
    );
    let text = report.to_string();
    for line in [
        "container CdPlayer",
        "    super Playing: Songs",
        "    Stopped -> Playing on Play",
        "    task Panel: Buttons slot 2",
        "    Panel -> Panel on pulse [.end_pause] / send EndPause",
        "    One -> Two on Next",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}\n{text}");
    }
}

#[test]
fn everything_reads_back() {
    let report = report(&everything());
    let text = report.to_string();
    for line in [
        "container Leg, 3 times, flags hurry, done",
        "    task Back: Drive slot 2 with { speed = -0.25 }",
        "    state Wait timeout 5000 us",
        "    task Log: Sonar slot 0",
        "    initial -> Back on pulse / set .go",
        "    Back -> Wait on pulse [.near and not ^hurry or exit and (timeout or busy)] / send Done, set ^done",
        "    Left -> Right on pulse [not busy] / set .hurry",
        "    Log -> Back on pulse [exit]",
        "    Right -> final on pulse [exit and .done]",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}\n{text}");
    }
    let paths: Vec<_> = report
        .task_states
        .iter()
        .map(|row| row.path.as_str())
        .collect();
    let expected = [
        "motion/First/turn/Back",
        "motion/First/turn/Log",
        "motion/Nested/both/Left/turn/Back",
        "motion/Nested/both/Left/turn/Log",
        "motion/Nested/both/Right/turn/Back",
        "motion/Nested/both/Right/turn/Log",
        "sense/Ring",
    ];
    assert_eq!(paths, expected);
    let scan = &report.nets[0];
    assert_eq!(scan.type_name, "Scan");
    assert_eq!(scan.writers, ["sense/Ring.scan"]);
    assert_eq!(scan.readers, ["motion/First/turn/Back.scan"]);
    assert_eq!(report.tasks[1].exclusive.as_deref(), Some("motors"));
}
