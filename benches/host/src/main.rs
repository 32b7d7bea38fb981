//! The machines on the host. `bench-host FOLDER count` is to be run under callgrind, which writes
//! the instructions of each call of [`counted`] to a file; `bench-host FOLDER time` measures
//! itself. The folder holds the plan and the missions. A line of the output is
//! `row NAME EVENTS [NANOSECONDS]...` or `tell NAME NUMBERS`.

use std::fs;
use std::hint::black_box;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use bench_machines::{
    ActionCounters, Meter, Nothing, Player, by_hand, drive, play, rust_fsm, smlang, statig,
};

/// Words for machines, more than any mission needs.
const ARENA_WORDS: usize = 1 << 16;

/// What callgrind counts in is this function, and when it returns, callgrind writes down what it
/// counted.
#[inline(never)]
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "a name that callgrind's options can say")]
extern "C" fn counted(work: &mut &mut dyn FnMut()) {
    work();
}

/// Has callgrind count.
struct Count;

impl Meter for Count {
    fn measure(&mut self, row: &str, events: usize, mut work: impl FnMut()) {
        // The first time takes the caches and lazily bound names along.
        work();
        println!("row {row} {events}");
        let mut work: &mut dyn FnMut() = &mut work;
        counted(black_box(&mut work));
    }

    fn measure_once(&mut self, row: &str, events: usize, work: impl FnOnce()) {
        println!("row {row} {events}");
        let mut work = Some(work);
        let mut work = || {
            if let Some(work) = work.take() {
                work();
            }
        };
        let mut work: &mut dyn FnMut() = &mut work;
        counted(black_box(&mut work));
    }

    fn tell(&mut self, row: &str, numbers: &[u32]) {
        tell(row, numbers);
    }
}

fn tell(row: &str, numbers: &[u32]) {
    let numbers: Vec<_> = numbers.iter().map(u32::to_string).collect();
    println!("tell {row} {}", numbers.join(" "));
}

/// Takes the time. What can only be done once is too short for a clock.
struct Time;

impl Meter for Time {
    fn measure(&mut self, row: &str, events: usize, mut work: impl FnMut()) {
        /// How long one measurement takes, and how many there are. All are told: what disturbs only
        /// makes longer.
        const LONG_ENOUGH: Duration = Duration::from_millis(4);
        const MEASUREMENTS: usize = 10;
        let mut times = 1_u32;
        let mut of = |times: u32| {
            let started = Instant::now();
            for _ in 0..times {
                work();
            }
            started.elapsed()
        };
        while of(times) < LONG_ENOUGH {
            times *= 2;
        }
        print!("row {row} {events}");
        for _ in 0..MEASUREMENTS {
            let nanoseconds = of(times).as_secs_f64() * 1e9 / f64::from(times);
            print!(" {nanoseconds:.1}");
        }
        println!();
    }

    fn measure_once(&mut self, _: &str, _: usize, work: impl FnOnce()) {
        work();
    }

    fn tell(&mut self, row: &str, numbers: &[u32]) {
        tell(row, numbers);
    }
}

fn peers(meter: &mut impl Meter) {
    fn peer<P: Player>(
        meter: &mut impl Meter,
        rows: [&str; 2],
        make: impl FnOnce(&'static ActionCounters) -> P,
    ) {
        let counters: &'static ActionCounters = Box::leak(Box::new(ActionCounters::new()));
        play(meter, rows, &mut make(counters), counters);
    }
    peer(meter, ["cd51-nothing", "idle-nothing"], |_| Nothing);
    peer(
        meter,
        ["cd51-by-hand", "idle-by-hand"],
        by_hand::Machine::new,
    );
    peer(meter, ["cd51-statig", "idle-statig"], statig::Machine::new);
    peer(meter, ["cd51-smlang", "idle-smlang"], smlang::Machine::new);
    peer(
        meter,
        ["cd51-rust-fsm", "idle-rust-fsm"],
        rust_fsm::Machine::new,
    );
}

fn missions(meter: &mut impl Meter, folder: &Path) -> Result<(), String> {
    let read = |name: &str| fs::read(folder.join(name)).map_err(|error| format!("{name}: {error}"));
    let plan = String::from_utf8(read("plan")?).map_err(|error| error.to_string())?;
    let mut arena = vec![0; ARENA_WORDS];
    for line in drive::lines(&plan) {
        let line = line.ok_or("a line of the plan is none")?;
        drive::run(meter, line, &read(line.mission)?, &mut arena)
            .map_err(|problem| format!("{}: {problem:?}", line.row))?;
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<_> = std::env::args().skip(1).collect();
    let result = match &arguments[..] {
        [folder, mode] if mode == "count" => {
            peers(&mut Count);
            missions(&mut Count, folder.as_ref())
        }
        [folder, mode] if mode == "time" => {
            peers(&mut Time);
            missions(&mut Time, folder.as_ref())
        }
        _ => Err("bench-host FOLDER count|time".to_owned()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("bench-host: {problem}");
            ExitCode::FAILURE
        }
    }
}
