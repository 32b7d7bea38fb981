//! `cargo xtask bench record`: bytes that a recording takes for a transition, of all shipped
//! missions.
//!
//! One argument: how many seconds of robot time each is recorded, 120 unless told otherwise. Ends
//! with status 1 if it is more than promised, on average.

use std::process::ExitCode;

use esm_tests::recorded::{
    MOST_BYTES_A_TRANSITION, Row, SECONDS, bytes_a_transition, record_shipped,
};

fn main() -> ExitCode {
    // `cargo bench` appends an argument of its own.
    let seconds = std::env::args()
        .skip(1)
        .find(|argument| argument != "--bench");
    let seconds = match seconds.map_or(Ok(SECONDS), |text| text.parse()) {
        Ok(seconds @ 1..=1_000_000) => seconds,
        _ => {
            eprintln!("bench record takes one whole number: the seconds of robot time of each run");
            return ExitCode::from(2);
        }
    };
    let rows = record_shipped(seconds);
    println!(
        "| mission | world | s | macro steps | transitions | bytes of records | a transition | bytes of the file |"
    );
    println!("|---|---|---:|---:|---:|---:|---:|---:|");
    for row in &rows {
        println!("{row}");
    }
    let sum = |of: fn(&Row) -> u64| rows.iter().map(of).sum::<u64>();
    let (bytes, transitions) = (sum(|row| row.record_bytes), sum(|row| row.transitions));
    let average = bytes_a_transition(bytes, transitions);
    println!(
        "\nIn all {bytes} bytes of records for {transitions} transitions: {average:.2} bytes a transition, of {MOST_BYTES_A_TRANSITION} at most."
    );
    if average <= MOST_BYTES_A_TRANSITION {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
