//! A robot that drives for more than an hour misses nothing and does not drift.

use esm_tests::command::root;
use esm_tests::endurance::{Body, drive};

/// Longer than 2^32 µs, which are 71.6 minutes. 2^32 ticks of the clock are over after 86 seconds
/// already.
const DURATION_US: u64 = 72 * 60 * 1_000_000;

#[test]
fn slots_go_on_to_the_microsecond_beyond_the_wraps_of_32_bit_counters() {
    const { assert!(DURATION_US > 1 << 32) };
    let patrol = root().join("missions/patrol.esm");
    let run = drive(&patrol, Body::OnBlock, DURATION_US).unwrap();
    assert_eq!(run.problems(), [""; 0]);
    assert!(run.slots.len() > 1 && run.status.t_us > 1 << 32, "{run:?}");
}
