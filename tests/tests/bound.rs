//! Bounds of macro steps against macro steps that are run: by the interpreter here, and on the
//! emulated board, where their instructions are counted.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::calibration;
use esm_tests::command::{firmware, root};
use esm_tests::instructions::{self, MAX_ARENA_WORDS, MAX_BLOB_BYTES, Run};
use esm_tests::{random_machine, subject};
use host_tools::boards;
use host_tools::bound::search::{Effort, Found, Subject};
use host_tools::bound::worst::Events;
use host_tools::bound::{Costs, bound};

/// The missions that ship, below the checkout.
const SHIPPED: [&str; 10] = [
    "missions/follow_wall.esm",
    "missions/patrol.esm",
    "missions/watch_timing.esm",
    "missions/tutorial/1_line.esm",
    "missions/tutorial/2_lost.esm",
    "missions/tutorial/3_gap.esm",
    "missions/tutorial/4_search.esm",
    "missions/tutorial/5_obstacle.esm",
    "missions/tutorial/6_everything.esm",
    "tests/data/cd51.esm",
];

/// What a search of a test tries.
const EFFORT: Effort = Effort {
    runs: 12,
    ..Effort::USUAL
};

fn costs() -> Costs {
    boards::find(boards::DEFAULT).unwrap().costs().unwrap()
}

/// Missions of many kinds, by name.
fn many() -> Vec<(String, Vec<u8>)> {
    let random = (5_000..5_030).map(|seed| {
        (
            format!("random machine {seed}"),
            random_machine::machine(seed),
        )
    });
    let examples = calibration::examples().into_iter();
    // Two sizes of five.
    let examples = examples.map(|it| (it.name, it.text)).step_by(3);
    let built = examples.chain(random).map(|(name, text)| {
        let built = subject::build(&text).unwrap_or_else(|error| panic!("{name}: {error}"));
        (name, built.blob)
    });
    built
        .filter(|(_, blob)| blob.len() <= MAX_BLOB_BYTES)
        .collect()
}

#[test]
fn no_macro_step_that_is_run_costs_more_than_the_bound_of_its_mission() {
    let costs = costs();
    for (name, blob) in many() {
        let verified = subject::verified(&blob).unwrap();
        let subject = Subject::new(&verified).unwrap();
        let bound = bound(subject.machine(), &costs);
        for seed in 0..3 {
            for (step, ran) in subject.run(&subject.wander(15, seed)).iter().enumerate() {
                assert_eq!(ran.not_met, 0, "{name}, run {seed}, step {step}");
                let cost = costs.total(&ran.counts);
                assert!(
                    cost <= bound.instructions,
                    "{name}, run {seed}, step {step}: {cost}, bound {}",
                    bound.instructions
                );
            }
        }
    }
}

#[test]
fn on_the_board_no_macro_step_takes_more_than_its_constructs_cost() {
    let costs = costs();
    let firmware = firmware("bench_bound");
    let missions: Vec<_> = many()
        .into_iter()
        .map(|(name, blob)| (name, subject::verified(&blob).unwrap()))
        .filter(|(_, verified)| verified.arena_words() <= MAX_ARENA_WORDS)
        .collect();
    let subjects = missions.iter().map(|(name, verified)| {
        let subject = Subject::new(verified).unwrap();
        let inputs = subject.wander(15, 7);
        let ran = subject.run(&inputs);
        // A run ends with a fault.
        let inputs = inputs[..ran.len()].to_vec();
        (name, verified, inputs, ran)
    });
    let subjects: Vec<_> = subjects.collect();
    let runs: Vec<Run<'_>> = subjects
        .iter()
        .map(|(_, verified, inputs, _)| Run {
            blob: verified.bytes(),
            inputs,
        })
        .collect();
    let counted = instructions::count(&firmware, &runs).unwrap();
    let mut steps = 0;
    for ((name, _, _, ran), counted) in subjects.iter().zip(&counted) {
        for (step, (ran, &counted)) in ran.iter().zip(counted).enumerate() {
            let cost = costs.total(&ran.counts);
            assert!(
                counted <= cost,
                "{name}, step {step}: {counted} instructions, its constructs cost {cost}: measure anew with `cargo xtask bench bound --write`"
            );
            steps += 1;
        }
    }
    assert!(steps > 500, "{steps} macro steps are too few");
}

#[test]
fn the_bound_of_a_shipped_mission_is_not_far_above_what_is_found_on_the_board() {
    let costs = costs();
    let firmware = firmware("bench_bound");
    for file in SHIPPED {
        let built = subject::build_file(&root().join(file)).unwrap();
        let verified = subject::verified(&built.blob).unwrap();
        let subject = Subject::new(&verified).unwrap();
        let bound = bound(subject.machine(), &costs);
        assert_eq!(bound.events, Events::Counted, "{file}");
        let Found { inputs, .. } = subject.search(&costs, EFFORT, 1);
        let run = Run {
            blob: &built.blob,
            inputs: &inputs,
        };
        let counted = instructions::count(&firmware, &[run]).unwrap();
        let most = counted.iter().flatten().copied().max().unwrap();
        let bound = bound.instructions;
        assert!(most <= bound, "{file}: {most} instructions, bound {bound}");
        // A mission that takes over warm begins some regions anew while it is in the middle of
        // others. The bound has room for that, and a search from the start does not find it.
        assert!(
            bound * 4 <= most * 9,
            "{file}: the bound {bound} is more than 2.25 times {most}"
        );
    }
}
