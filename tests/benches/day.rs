//! `cargo xtask bench day`: the default robot on patrol for a day of virtual time, every activation
//! of every slot compared with what its period says.
//!
//! One argument: how many minutes it is to be, 1,440 unless told otherwise. Ends with status 1 if
//! something was wrong.

use std::process::ExitCode;
use std::time::Instant;

use esm_tests::command::root;
use esm_tests::endurance::{Body, Run, drive};

const DAY_MINUTES: u64 = 24 * 60;
const US_PER_MINUTE: u64 = 60 * 1_000_000;

fn main() -> ExitCode {
    // `cargo bench` appends an argument of its own.
    let minutes = std::env::args()
        .skip(1)
        .find(|argument| argument != "--bench");
    let minutes = match minutes.map_or(Ok(DAY_MINUTES), |text| text.parse()) {
        Ok(minutes @ 1..) => minutes,
        _ => {
            eprintln!("bench day takes one whole number: the minutes of robot time");
            return ExitCode::from(2);
        }
    };
    let started = Instant::now();
    let run = Body::in_world(&root().join("missions/worlds/office.world")).and_then(|body| {
        drive(
            &root().join("missions/patrol.esm"),
            body,
            minutes * US_PER_MINUTE,
        )
    });
    match run {
        Ok(run) => report(&run, minutes, started.elapsed().as_secs_f64()),
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::from(3)
        }
    }
}

fn report(run: &Run, minutes: u64, took_s: f64) -> ExitCode {
    println!(
        "patrol.esm in the office for {minutes} min of robot time: {:.0} m, in {took_s:.0} s on the wall",
        run.distance_m
    );
    println!("| slot | period, us | executed | expected | missed | overruns | last start, us |");
    println!("|---|---|---|---|---|---|---|");
    for run in &run.slots {
        println!(
            "| {} | {} | {} | {} | {} | {} | {} |",
            run.slot.number,
            run.slot.period_us,
            run.executed,
            run.expected,
            run.missed,
            run.overruns,
            run.last_start_us
        );
    }
    let problems = run.problems();
    for problem in &problems {
        println!("{problem}");
    }
    if problems.is_empty() {
        println!(
            "Every start to the microsecond, none missed; the latest began {:.1} us after it.",
            f64::from(run.status.max_delay_ns) / 1e3
        );
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
