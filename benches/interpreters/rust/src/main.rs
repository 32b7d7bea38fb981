//! The CD player for [scxml](https://docs.rs/scxml): a chart as SCXML, which its simulator runs. It
//! tells `tell NAME COUNTS` and `row NAME EVENTS NANOSECONDS...`.
//!
//! The simulator performs no actions, and a state's initial one is not entered by itself. It
//! evaluates guards: so an action stands as a guard that counts and always holds, and transitions
//! to `Playing` lead to its first song.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use bench_machines::{Action, ActionCounters, Button, SCRIPT, SCRIPT_EVENTS};
use scxml::parse_xml;
use scxml::simulate::Simulator;

const CHART: &str = include_str!("player.scxml");

/// How long one measurement takes, and how many there are.
const LONG_ENOUGH: Duration = Duration::from_millis(4);
const MEASUREMENTS: usize = 10;

const ROW: &str = "cd51-scxml";

fn event(button: Button) -> &'static str {
    match button {
        Button::Play => "play",
        Button::EndPause => "end_pause",
        Button::Stop => "stop",
        Button::Pause => "pause",
        Button::OpenClose => "open_close",
        Button::Cd => "cd",
        Button::Next => "next",
        Button::Prev => "prev",
    }
}

fn action(guard: &str) -> Option<Action> {
    Some(match guard {
        "start_playback" => Action::StartPlayback,
        "open_drawer" => Action::OpenDrawer,
        "close_drawer" => Action::CloseDrawer,
        "store_cd_info" => Action::StoreCdInfo,
        "stop_playback" => Action::StopPlayback,
        "pause_playback" => Action::PausePlayback,
        "resume_playback" => Action::ResumePlayback,
        "stop_and_open" => Action::StopAndOpen,
        "stopped_again" => Action::StoppedAgain,
        "next_song" => Action::NextSong,
        "previous_song" => Action::PreviousSong,
        _ => return None,
    })
}

fn main() -> ExitCode {
    let chart = match parse_xml(CHART) {
        Ok(chart) => chart,
        Err(error) => {
            eprintln!("player.scxml: {error}");
            return ExitCode::FAILURE;
        }
    };
    let counters: &'static ActionCounters = Box::leak(Box::new(ActionCounters::new()));
    let mut player = Simulator::new(&chart).with_guard_fn(move |guard| {
        if let Some(action) = action(guard) {
            counters.act(action);
        }
        true
    });
    let script = SCRIPT.map(event);
    let mut pass = || {
        // What it does not wait for is an error of its own; the counts tell.
        for event in std::hint::black_box(&script) {
            let _ = player.send(event);
        }
        // It keeps a history of all events. The player is in its initial state anyway.
        player.reset();
    };
    pass();
    let counts: Vec<String> = counters.read().iter().map(u32::to_string).collect();
    println!("tell {ROW} {}", counts.join(" "));
    let mut of = |times: u32| {
        let started = Instant::now();
        for _ in 0..times {
            pass();
        }
        started.elapsed()
    };
    let mut times = 1;
    while of(times) < LONG_ENOUGH {
        times *= 2;
    }
    print!("row {ROW} {SCRIPT_EVENTS}");
    for _ in 0..MEASUREMENTS {
        print!(" {:.1}", of(times).as_secs_f64() * 1e9 / f64::from(times));
    }
    println!();
    ExitCode::SUCCESS
}
