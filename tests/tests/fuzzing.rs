//! The functions that fuzzers drive, over all seeds and over changed copies of them: the same
//! copies each time, and some seconds in all.
//!
//! `ESM_SEED` sets the first changed copy (0 if unset) and `ESM_FUZZ_RUNS` how many there are for
//! each target, for more than a short look. `cargo xtask fuzz` goes on where this ends.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::panic::{AssertUnwindSafe, catch_unwind};

use esm_tests::environment;
use esm_tests::fuzzing::{TARGETS, Target, mutations, seeds};
use esm_tests::random::Random;

/// All seeds together stay small enough to be read and to be kept.
const MAX_CORPUS_BYTES: usize = 300 << 10;

fn target(name: &str) -> &'static Target {
    TARGETS.iter().find(|target| target.name == name).unwrap()
}

/// Runs one input; if it goes wrong, keeps it where a fuzzer would.
fn run(target: &Target, what: &str, bytes: &[u8]) {
    if catch_unwind(AssertUnwindSafe(|| (target.body)(bytes))).is_ok() {
        return;
    }
    let folder = esm_tests::command::root()
        .join("target/fuzz")
        .join(target.name);
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("found-by-test");
    std::fs::write(&file, bytes).unwrap();
    panic!(
        "{name}: {what} goes wrong, for the reason above. Run it alone with\n    ESM_FUZZ_FILE={} cargo test -p esm-tests --test fuzzing {name}",
        file.display(),
        name = target.name
    );
}

/// The seeds, then changed copies.
fn short_run(name: &str) {
    let target = target(name);
    if let Ok(file) = std::env::var("ESM_FUZZ_FILE") {
        (target.body)(&std::fs::read(&file).unwrap());
        return;
    }
    let seeds = seeds::all(name);
    assert!(seeds.len() >= 9, "{name} has only {} seeds", seeds.len());
    for seed in &seeds {
        run(target, &seed.name, &seed.bytes);
    }
    let first = environment::number("ESM_SEED", 0);
    let runs = environment::number("ESM_FUZZ_RUNS", target.short_runs as u64);
    for number in first..first + runs {
        let mut random = Random::new(number);
        let (seed, other) = (random.pick(&seeds).unwrap(), random.pick(&seeds).unwrap());
        let bytes = mutations::mutated(&seed.bytes, &other.bytes, &mut random);
        run(target, &format!("copy {number} of {}", seed.name), &bytes);
    }
}

#[test]
fn front_end() {
    short_run("front_end");
}

#[test]
fn verifier() {
    short_run("verifier");
}

#[test]
fn interpreter() {
    short_run("interpreter");
}

#[test]
fn link() {
    short_run("link");
}

#[test]
fn round_trip() {
    short_run("round_trip");
}

#[test]
fn seeds_stay_small() {
    let mut total = 0;
    for target in TARGETS {
        let folder = seeds::folder(target.name);
        if std::env::var_os("ESM_BLESS").is_some() {
            std::fs::create_dir_all(&folder).unwrap();
            for seed in (target.seeds)() {
                std::fs::write(folder.join(&seed.name), &seed.bytes).unwrap();
            }
        }
        let found = seeds::all(target.name);
        total += found.iter().map(|seed| seed.bytes.len()).sum::<usize>();
    }
    assert!(total <= MAX_CORPUS_BYTES, "the seeds have {total} bytes");
}

#[test]
fn blobs_among_the_seeds_are_valid_ones() {
    for seed in seeds::all("verifier") {
        let verdict = esm_core::verify(seed.bytes).map_err(|(_, refusal)| refusal);
        assert!(
            verdict.is_ok(),
            "{} is of an older format: make the seeds anew with ESM_BLESS=1",
            seed.name
        );
    }
}
