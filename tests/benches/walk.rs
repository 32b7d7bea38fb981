//! `cargo xtask bench walk`: what it takes to walk through a recording, forwards, backwards and
//! from one end to the other.
//!
//! One argument: how many minutes of patrol are recorded, 60 unless told otherwise. Ends with
//! status 1 if a step back took longer than a person feels.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use esm_tests::recorded::RecordedRun;
use host_tools::recording::player::Recording;
use host_tools::recording::walk::{Searched, Walk};

const MINUTES: u64 = 60;

/// What is shorter is felt as at once.
const AT_ONCE: Duration = Duration::from_millis(50);

fn main() -> ExitCode {
    // `cargo bench` appends an argument of its own.
    let minutes = std::env::args()
        .skip(1)
        .find(|argument| argument != "--bench");
    let minutes = match minutes.map_or(Ok(MINUTES), |text| text.parse()) {
        Ok(minutes @ 1..=100_000) => minutes,
        _ => {
            eprintln!("bench walk takes one whole number: the minutes of robot time");
            return ExitCode::from(2);
        }
    };
    let run = RecordedRun {
        missions: &[(0, "patrol", false)],
        world: "office",
        seed: 1,
        until_s: 60 * minutes,
    };
    let bytes = run.made().recording;
    let before_kib = resident_kib();
    let (recording, read) = timed(|| Recording::read(&bytes));
    let recording = match recording {
        Ok(recording) => recording,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::from(3);
        }
    };
    let ((mut walk, _), first) = timed(|| Walk::new(&recording, false));
    let count = walk.count();
    let steps: u64 = recording.stretches.iter().map(|stretch| stretch.made).sum();
    println!(
        "patrol.esm in the office for {minutes} min: {steps} macro steps, {count} micro steps with transitions, {} bytes",
        bytes.len()
    );
    println!("| what | in all, ms | the longest, ms |");
    println!("|---|---:|---:|");
    row("read the file", read, read);
    row("first pass", first, first);
    let forwards = many(|| walk.forward().is_some());
    row("forwards, each micro step", forwards.0, forwards.1);
    let backwards = many(|| walk.back().is_some());
    row("backwards, each micro step", backwards.0, backwards.1);
    let (_, to_end) = timed(|| walk.to_number(count.saturating_sub(1)).is_some());
    row("to the end", to_end, to_end);
    let (_, to_middle) = timed(|| walk.to_time(30_000_000 * minutes).is_some());
    row("to a time in the middle", to_middle, to_middle);
    let (_, to_beginning) = timed(|| walk.to_number(0).is_some());
    row("to the beginning", to_beginning, to_beginning);
    // `exit` of the machine's sensing task is never set.
    let (nothing, search) = timed(|| {
        let sought = walk.sought("sonars/Listen.exit").ok()?;
        let mut search = walk.search(sought, false);
        while let Searched::GoesOn { .. } = walk.look(&mut search) {}
        Some(())
    });
    if nothing.is_none() {
        eprintln!("the mission has no sonars/Listen.exit any more: look for something else");
        return ExitCode::from(3);
    }
    row("search through all of it", search, search);
    if let (Some(before), Some(now)) = (before_kib, resident_kib()) {
        println!(
            "\nMemory: {:.1} MiB more than before.",
            now.saturating_sub(before) as f64 / 1024.0
        );
    }
    let longest = backwards.1.max(to_end).max(to_beginning);
    if longest < AT_ONCE {
        ExitCode::SUCCESS
    } else {
        println!("{longest:?} is longer than {AT_ONCE:?}.");
        ExitCode::FAILURE
    }
}

fn timed<T>(what: impl FnOnce() -> T) -> (T, Duration) {
    let began = Instant::now();
    let done = what();
    (done, began.elapsed())
}

/// All of it until it ends, and the longest.
fn many(mut step: impl FnMut() -> bool) -> (Duration, Duration) {
    let (mut all, mut longest) = (Duration::ZERO, Duration::ZERO);
    loop {
        let (goes_on, took) = timed(&mut step);
        all += took;
        longest = longest.max(took);
        if !goes_on {
            return (all, longest);
        }
    }
}

fn row(what: &str, all: Duration, longest: Duration) {
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    println!("| {what} | {:.1} | {:.2} |", ms(all), ms(longest));
}

/// Memory of this process, where the system tells.
fn resident_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.split_whitespace().next()?.parse().ok()
}
