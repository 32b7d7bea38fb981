//! What the compiler makes of a source, `inspect` gives back as a source of which the compiler
//! makes the same again, byte for byte: with names, and without.
//!
//! `ESM_MACHINES` sets how many random machines are tried (300 if unset), `ESM_SEED` the seed of
//! the first.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;
use std::time::Duration;

use esm_tests::{command, environment, random_machine, random_nets};
use host_tools::compile::{NameTable, compile_with};
use host_tools::inspect;
use host_tools::lang::{self, Checked};
use host_tools::time::work_limit;

const DEFAULT_MACHINES: u64 = 300;
/// How long start times are searched for; the slots of the tests are laid out at once.
const LAY_OUT_LIMIT: Duration = Duration::from_secs(10);

fn blob(checked: &mut Checked, names: NameTable) -> Vec<u8> {
    let schedule = checked.lay_out(work_limit(LAY_OUT_LIMIT));
    assert!(!checked.has_errors(), "{}", checked.render(false));
    let model = checked.model.as_ref().unwrap();
    compile_with(model, &schedule.unwrap(), names).unwrap()
}

/// Goes round with names and without. Gives the source that came back with names.
#[track_caller]
fn assert_goes_round(what: &str, mut checked: Checked) -> String {
    let mut with_names = String::new();
    for names in [NameTable::LeftOut, NameTable::Kept] {
        let bytes = blob(&mut checked, names);
        let verified = esm_core::verify(bytes.clone()).unwrap();
        let source = match inspect::source(&verified, work_limit(LAY_OUT_LIMIT)) {
            Ok(source) => source,
            Err(cause) => panic!("{what}, names {names:?}: {cause}"),
        };
        // Once more, by other means than those by which the source was checked before it was given
        // out.
        let again = blob(&mut lang::load_text("again.esm", &source), names);
        assert_eq!(again, bytes, "{what}, names {names:?}:\n{source}");
        with_names = source;
    }
    with_names
}

#[test]
fn missions_go_round() {
    let missions = [
        "missions/patrol.esm",
        "missions/follow_wall.esm",
        "examples/my_robot/mission.esm",
        "tests/data/cd51.esm",
    ];
    for mission in missions {
        let path = command::root().join(mission);
        assert_goes_round(mission, lang::load(&path).unwrap());
    }
}

#[test]
fn random_machines_go_round() {
    let first = environment::number("ESM_SEED", 1);
    for seed in first..first + environment::number("ESM_MACHINES", DEFAULT_MACHINES) {
        let text = random_machine::machine(seed);
        assert_goes_round(
            &format!("seed {seed}"),
            lang::load_text("machine.esm", &text),
        );
    }
}

/// Random nets that have no errors are about a third of all.
const SEEDS_A_MISSION: u64 = 12;

#[test]
fn random_nets_go_round() {
    let first = environment::number("ESM_SEED", 1);
    let wanted = environment::number("ESM_MACHINES", DEFAULT_MACHINES);
    let mut found = 0;
    for seed in first..first + wanted * SEEDS_A_MISSION {
        let text = random_nets::mission(seed);
        let checked = lang::load_text("nets.esm", &text);
        if !checked.has_errors() {
            assert_goes_round(&format!("seed {seed}\n{text}"), checked);
            found += 1;
        }
        if found == wanted {
            return;
        }
    }
    panic!("only {found} of {wanted} missions have no errors");
}

#[test]
fn what_comes_back_reads_like_what_was_written() {
    let path = command::root().join("missions/patrol.esm");
    let source = assert_goes_round("patrol", lang::load(Path::new(&path)).unwrap());
    for line in [
        "task Stop slot 2 exclusive motion {",
        "    param acceleration_m_per_s2: f32 = 1.2;",
        "    in data ranges: Ranges;",
        "        task Away: Turn with { angle_rad = 1.1 };",
        "        Retreat -> Away on pulse [exit and ^left] / set .left;",
        "        Away -> final on *;",
        "    path Track.pose -> Listen.pose, Roam.pose, Write.pose;",
        "        state Pause timeout 2 s;",
    ] {
        assert!(
            source.lines().any(|found| found == line),
            "{line}\n{source}"
        );
    }
}
