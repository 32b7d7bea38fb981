//! Machines that pass the verifier, from a compiler and from nowhere.

use std::sync::OnceLock;

use crate::random::Random;
use crate::random_machine::{FULL, SMALL};
use crate::reference::{self, Outcome};
use crate::scenario::Scenario;
use crate::{random_machine, subject};

use super::records::Records;
use super::watched;

/// Macro steps that a machine is run for.
const STEPS: usize = 12;

/// How many of all machines from source are [`SMALL`]: the others take ten times as long, and few
/// things need them.
const SMALL_PERCENT: usize = 95;

/// Machines whose blobs are changed, by their seeds: small enough that a change hits something that
/// matters.
const MACHINES: u64 = 24;
const MAX_BLOB_BYTES: usize = 4_000;

/// A little over half of all first bytes make a machine from source; the others change a blob.
const FROM_SOURCE_PERCENT: usize = 40;

/// Lets bytes decide about a machine, and about what happens to it, and runs it.
///
/// Either they write an `.esm` file without errors, which is compiled, run through a scenario as
/// `esm sim` does, and compared with the reference; or they change records of a blob. If the
/// verifier lets that pass, it is a machine like any other.
///
/// # Panics
/// Where a law does not hold.
pub fn interpreter(bytes: &[u8]) {
    let mut random = Random::of_bytes(bytes);
    if random.chance(FROM_SOURCE_PERCENT) {
        from_source(random);
    } else {
        from_records(random);
    }
}

fn from_source(mut random: Random) {
    let size = if random.chance(SMALL_PERCENT) {
        SMALL
    } else {
        FULL
    };
    let text = random_machine::machine_of(&mut random, size);
    let built = subject::build(&text).unwrap_or_else(|cause| panic!("{cause}\n{text}"));
    let scenario = random_machine::scenario_of(&mut random, &built.model, size);
    let expected = reference::run(&built.model, &scenario);
    let found = subject::simulate(&built.blob, &scenario)
        .unwrap_or_else(|cause| panic!("{cause}\n{text}\n{scenario}"));
    assert_same(&expected, &found, &text, &scenario);
    let verified = subject::verified(&built.blob).unwrap_or_else(|cause| panic!("{cause}"));
    super::verifier::read_everywhere(&verified.tables());
    watched::run(verified, &mut random, STEPS);
}

fn assert_same(expected: &Outcome, found: &Outcome, text: &str, scenario: &Scenario) {
    if expected == found {
        return;
    }
    let pairs = expected.trace.iter().zip(&found.trace);
    let differs = pairs
        .clone()
        .position(|(expected, found)| expected != found);
    let line = differs.unwrap_or_else(|| pairs.len());
    panic!(
        "line {}: the reference has {:?}, esm has {:?}; failed expectations {:?} and {:?}\n{text}\n{scenario}",
        line + 1,
        expected.trace.get(line),
        found.trace.get(line),
        expected.failed,
        found.failed,
    );
}

fn from_records(mut random: Random) {
    let blobs = blobs();
    let mut records = blobs[random.below(blobs.len())].clone();
    for _ in 0..random.between(1, 6) {
        let before = records.clone();
        records.change(&mut random);
        // One wrong record hides all that the others would do: mostly it is taken back.
        if random.chance(85) && esm_core::verify(records.seal()).is_err() {
            records = before;
        }
    }
    if let Ok(verified) = esm_core::verify(records.seal()) {
        super::verifier::read_everywhere(&verified.tables());
        super::verifier::dispatch(&verified.tables());
        watched::run(verified, &mut random, STEPS);
    }
}

/// Blobs of machines that use the whole language between them.
fn blobs() -> &'static [Records] {
    static BLOBS: OnceLock<Vec<Records>> = OnceLock::new();
    BLOBS.get_or_init(|| {
        let player = include_str!("../../data/cd51.esm").to_owned();
        let machines = (1..=MACHINES).map(random_machine::machine);
        std::iter::once(player)
            .chain(machines)
            .filter_map(|text| Some(subject::build(&text).ok()?.blob))
            .filter(|blob| blob.len() <= MAX_BLOB_BYTES)
            .filter_map(|blob| Records::of(&blob))
            .collect()
    })
}
