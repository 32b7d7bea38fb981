//! A link of missions over the second UART of an emulated board: what it sends comes back and is
//! received, and whatever a partner does shows as its flag.
//!
//! `ESM_LINK_BOARDS` says how many boards do it: the firmware of each takes a minute to be built.
//! `cargo xtask campaign links` lets all of them.

#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::io::{Read, Write};
use std::ops::Range;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::sync::mpsc;
use std::thread;

use esm_link::frames::configuration::{Configuration, Content};
use esm_link::frames::receiver::{InFrame, Receiver, SortedFrames};
use esm_link::frames::wire::{self, Header, MAX_WIRE_BYTES};
use esm_tests::command::{esm, esm_in, firmware, firmware_with};
use esm_tests::environment;
use esm_tests::random::Random;
use serde_json::Value;

/// Sends two flags and receives them; the second is set for 300 ms, and then it is not.
const MISSION: &str = "\
    interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n\
    slot 2 period 20 ms duration 4 ms; slot 3 period 20 ms duration 4 ms;\n\
    link other rate 115200 bps header 6 bytes;\n\
    frame there 1 out on other flags a, b payload 16 bytes period 100 ms;\n\
    frame back 1 in on other flags c, d payload 16 bytes period 100 ms;\n\
    machine Echo {\n\
    region talking {\n\
    task Off: other.transmit slot 2 timeout 300 ms;\n\
    task On: other.transmit slot 2 timeout 300 ms;\n\
    initial -> Off;\n\
    Off -> On on pulse [timeout] / set .b; On -> Off on pulse [timeout]; }\n\
    region hearing {\n\
    task No: other.receive slot 3; task Yes: other.receive slot 3; state Wrong;\n\
    initial -> No;\n\
    No -> Wrong on pulse [.errors]; Yes -> Wrong on pulse [.errors];\n\
    No -> Yes on pulse [.d and not .errors];\n\
    Yes -> No on pulse [.back_available and not .d and not .errors]; } }";

/// The words of `esm` that run a mission with a firmware of an emulated board.
fn run_of<'a>(
    mission: &'a str,
    board: &'a str,
    firmware: &'a Path,
    until: &'a str,
) -> Vec<&'a str> {
    let firmware = firmware.to_str().unwrap();
    let of_board = ["run", mission, "--board", board, "--firmware", firmware];
    [&of_board[..], &["--world", "office", "--until", until]].concat()
}

/// Boards with a firmware with links.
const BOARDS: [&str; 2] = ["lm3s6965", "stm32f405"];

/// Those that this run is about.
fn boards() -> impl Iterator<Item = &'static str> {
    let count = environment::number("ESM_LINK_BOARDS", 1);
    BOARDS.into_iter().take(count as usize)
}

/// What a run of a mission has left.
struct Ran {
    /// The run's summary.
    summary: Value,
    /// All transitions: when, in microseconds, and to which state.
    entered: Vec<(u64, String)>,
}

/// Runs a mission on a board whose second UART leads to `partner`.
fn run(
    board: &str,
    mission: &str,
    until: &str,
    partner: impl FnOnce(UnixStream) + Send + 'static,
) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("mission.esm"), mission).unwrap();
    // The emulator as it is, with something at the board's second UART.
    let emulator = format!(
        "#!/bin/sh\nPATH=\"${{PATH#*:}}\" exec qemu-system-arm \"$@\" -serial 'unix:{}'\n",
        path("uart1")
    );
    fs::write(path("qemu-system-arm"), emulator).unwrap();
    fs::set_permissions(path("qemu-system-arm"), fs::Permissions::from_mode(0o755)).unwrap();
    let listener = UnixListener::bind(path("uart1")).unwrap();
    let partner = thread::spawn(move || partner(listener.accept().unwrap().0));
    let search = format!(
        "{}:{}",
        folder.path().to_str().unwrap(),
        std::env::var("PATH").unwrap()
    );
    let firmware = firmware_with(board, "links");
    let (mission, trace) = (path("mission.esm"), path("trace.jsonl"));
    let mut arguments = run_of(&mission, board, &firmware, until);
    arguments.extend(["--link", "uart", "--realtime", "--json", "--trace", &trace]);
    let summary = esm_in(&[("PATH", &search)], &arguments).good().json();
    partner.join().unwrap();
    let trace = fs::read_to_string(&trace).unwrap();
    let lines = trace
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap());
    let entered = lines
        .filter(|line| line["kind"] == "transition")
        .map(|line| {
            let to = line["to"].as_str().unwrap().to_owned();
            (line["t_us"].as_u64().unwrap(), to)
        })
        .collect();
    Ran { summary, entered }
}

#[test]
fn what_a_board_sends_over_its_uart_it_can_receive() {
    for board in boards() {
        let (to, from) = mpsc::channel();
        let ran = run(board, MISSION, "5 s", move |mut line| {
            let mut buffer = [0; 256];
            while let Ok(count @ 1..) = line.read(&mut buffer) {
                to.send(buffer[..count].to_vec()).unwrap();
                if line.write_all(&buffer[..count]).is_err() {
                    break;
                }
            }
        });
        let bytes: Vec<u8> = from.iter().flatten().collect();
        let mut numbers = Vec::new();
        let frames = [in_frame(PERIOD_US)];
        let frames = SortedFrames::new(&frames).unwrap();
        let (mut receiver, mut rest) = (Receiver::new(), &bytes[..]);
        while let Some(frame) = receiver.take(&mut rest, &frames) {
            numbers.push(usize::from(frame.unwrap().number));
        }
        assert!((45..=55).contains(&numbers.len()), "{numbers:?}");
        let first = numbers[0];
        assert_eq!(numbers, (first..first + numbers.len()).collect::<Vec<_>>());
        // When bytes come is up to this machine; whether they are right is not.
        let entered = ran.entered.iter().map(|(_, state)| state.as_str());
        let heard: Vec<&str> = entered.filter(|it| it.starts_with("hearing/")).collect();
        let times = heard.iter().filter(|it| **it == "hearing/Yes").count();
        assert!(times >= 3, "{}: {heard:?}", board);
        assert!(!heard.contains(&"hearing/Wrong"), "{}: {heard:?}", board);
        assert_eq!(missed(&ran.summary), (0, 0), "{}", board);
    }
}

/// What slots have missed, and how often one took too long.
fn missed(summary: &Value) -> (u64, u64) {
    let number = |name: &str| summary[name].as_u64().unwrap();
    (number("slots_missed"), number("overruns"))
}

/// Hears what the partner says: what is right, what is wrong, and nothing. What is wrong shows also
/// after nothing came: noise is mostly judged when the last value is long late.
const WATCH: &str = "\
    interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n\
    slot 2 period 20 ms duration 4 ms; slot 3 period 20 ms duration 4 ms;\n\
    link other rate 4800 bps header 6 bytes;\n\
    frame there 1 out on other flags a, b payload 16 bytes period 100 ms;\n\
    frame back 1 in on other flags c, d payload 16 bytes period 100 ms late 300 ms;\n\
    machine Watch {\n\
    region talking { task Tell: other.transmit slot 2; initial -> Tell; }\n\
    region hearing {\n\
    task Good: other.receive slot 3; task Bad: other.receive slot 3;\n\
    task Lost: other.receive slot 3; initial -> Good;\n\
    Good -> Lost on pulse [.back_delayed]; Good -> Bad on pulse [.errors and not .back_delayed];\n\
    Bad -> Lost on pulse [.back_delayed];\n\
    Bad -> Good on pulse [.back_available and not .errors and not .back_delayed];\n\
    Lost -> Good on pulse [.back_available];\n\
    Lost -> Bad on pulse [.errors and not .back_available]; } }";

/// Period of the frames of both missions, in microseconds.
const PERIOD_US: u32 = 100_000;
/// What a line of 4,800 bit/s has time for in a period: 10 bits a byte. The emulator, which takes a
/// byte each time that it looks at its sockets, takes some 150 a period; the rest would wait.
const BYTES_A_PERIOD: usize = 48;
/// Periods in which a partner does the same.
const PERIODS: u64 = 15;

/// The frame that a mission receives, by what it declares.
fn in_frame(period_us: u32) -> InFrame {
    InFrame {
        identifier: 1,
        payload_bytes: 16,
        configuration: Configuration::of(1, Content::Flags(2), 16, period_us),
    }
}

/// A frame of two flags as bytes of the line.
fn frame(identifier: u16, number: u8, payload_bytes: u8, period_us: u32) -> Vec<u8> {
    let content = Content::Flags(2);
    let configuration = Configuration::of(identifier, content, payload_bytes, period_us);
    let header = Header {
        identifier,
        number,
        configuration,
    };
    let mut bytes = [0; MAX_WIRE_BYTES];
    let payload = vec![0; payload_bytes.into()];
    let length = wire::encode(header, &payload, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

/// What a partner says in a period, how many of the kind came before.
type Says = fn(u64, &mut Random) -> Vec<u8>;

/// What a partner does one after the other, and which states must be entered meanwhile, and which
/// must not.
///
/// What comes is judged at its end, a byte 0. So noise that has one is wrong, and noise that has
/// none is a frame that has not ended: it says nothing but that no value comes.
const DOINGS: [(&str, Says, &[&str], &[&str]); 12] = [
    ("as declared", as_declared, &[], &[BAD, LOST]),
    ("is reset within a frame", reset, &[LOST], &[BAD]),
    ("begins anew", as_declared, &[BAD, GOOD], &[BAD, LOST]),
    ("noise at the line's rate", noise, &[BAD, LOST], &[GOOD]),
    ("as declared", as_declared, &[GOOD], &[BAD, LOST]),
    ("noise without an end", endless, &[LOST], &[BAD, GOOD]),
    ("as declared", as_declared, &[BAD, GOOD], &[BAD, LOST]),
    ("frames at the line's rate", babble, &[BAD], &[LOST]),
    ("one number, again and again", repeat, &[LOST], &[BAD]),
    ("as declared", as_declared, &[], &[BAD, LOST]),
    ("of an older mission", older, &[BAD, LOST], &[GOOD]),
    ("as declared", as_declared, &[GOOD], &[BAD, LOST]),
];
const GOOD: &str = "hearing/Good";
const LOST: &str = "hearing/Lost";
const BAD: &str = "hearing/Bad";

fn as_declared(count: u64, _: &mut Random) -> Vec<u8> {
    frame(1, count as u8, 16, PERIOD_US)
}

fn reset(count: u64, _: &mut Random) -> Vec<u8> {
    let mut bytes = frame(1, count as u8, 16, PERIOD_US);
    bytes.truncate(if count == 0 { bytes.len() / 2 } else { 0 });
    bytes
}

/// All bytes are as probable as each other, so that one in 256 ends something.
fn noise(_: u64, random: &mut Random) -> Vec<u8> {
    (0..BYTES_A_PERIOD)
        .map(|_| random.below(256) as u8)
        .collect()
}

fn endless(_: u64, random: &mut Random) -> Vec<u8> {
    (0..BYTES_A_PERIOD)
        .map(|_| 1 + random.below(255) as u8)
        .collect()
}

/// The own frame, and one that nobody expects.
fn babble(count: u64, _: &mut Random) -> Vec<u8> {
    let mut bytes = frame(1, count as u8, 16, PERIOD_US);
    bytes.extend(frame(9, count as u8, 12, PERIOD_US));
    assert_eq!(bytes.len(), BYTES_A_PERIOD);
    bytes
}

fn repeat(_: u64, _: &mut Random) -> Vec<u8> {
    frame(1, 77, 16, PERIOD_US)
}

fn older(count: u64, _: &mut Random) -> Vec<u8> {
    frame(1, count as u8, 16, 2 * PERIOD_US)
}

#[test]
fn whatever_a_partner_does_shows_as_its_flag_and_no_slot_is_missed() {
    let until = format!("{} s", 2 + DOINGS.len() as u64 * PERIODS / 10);
    let ran = run(BOARDS[0], WATCH, &until, |mut line| {
        let frames = [in_frame(PERIOD_US)];
        let frames = SortedFrames::new(&frames).unwrap();
        let (mut receiver, mut random) = (Receiver::new(), Random::new(1));
        let (mut buffer, mut heard) = ([0; 256], 0);
        while let Ok(count @ 1..) = line.read(&mut buffer) {
            let mut rest = &buffer[..count];
            // Each frame of the board is a period.
            while let Some(frame) = receiver.take(&mut rest, &frames) {
                frame.unwrap();
                let doing = DOINGS[(heard / PERIODS) as usize % DOINGS.len()];
                let says = doing.1(heard % PERIODS, &mut random);
                heard += 1;
                if line.write_all(&says).is_err() {
                    return;
                }
            }
        }
    });
    assert_eq!(missed(&ran.summary), (0, 0), "{}", ran.summary);
    let period_us = u64::from(PERIOD_US);
    // The first frame starts within a period, and what it says is there in the next one.
    let begins_us = |nth: usize| period_us * (1 + nth as u64 * PERIODS);
    for (nth, (says, _, must, must_not)) in DOINGS.iter().enumerate() {
        // What a doing does to the next one's first two periods is not the next one's.
        let during = begins_us(nth)..begins_us(nth + 1);
        let settled = begins_us(nth) + 2 * period_us..begins_us(nth + 1);
        let entered = |state: &str, when: &Range<u64>| {
            let mut entered = ran.entered.iter();
            entered.any(|(t_us, it)| when.contains(t_us) && it == state)
        };
        for state in *must {
            assert!(entered(state, &during), "{says}: {state} {:?}", ran.entered);
        }
        for state in *must_not {
            assert!(
                !entered(state, &settled),
                "{says}: {state} {:?}",
                ran.entered
            );
        }
    }
    // What is late shows within its time: 300 ms, a period, a slot and a macro step.
    let lost = ran.entered.iter().find(|(_, it)| it == LOST);
    let late_us = lost.unwrap().0 - begins_us(1);
    assert!(late_us <= 450_000, "{late_us}");
    // And all of it was counted.
    let link = &ran.summary["missions"][0]["links"][0];
    let count = |of: &Value, key: &str| of[key].as_u64().unwrap();
    let frame = |direction: &str| {
        let frames = link["frames"].as_array().unwrap();
        let mut of_it = frames.iter().filter(|it| it["direction"] == direction);
        of_it.next().unwrap()
    };
    let (sent, heard) = (frame("out"), frame("in"));
    let periods = DOINGS.len() as u64 * PERIODS;
    assert!(count(sent, "passed") >= periods, "{link}");
    assert_eq!(count(sent, "missing"), 0, "{link}");
    for key in ["passed", "missing", "repeated"] {
        assert!(count(heard, key) > 0, "{key}: {link}");
    }
    assert!(count(link, "errors") > PERIODS, "{link}");
}

#[test]
fn a_mission_with_links_is_refused_where_they_are_not_and_before_it_is_sent() {
    let folder = tempfile::tempdir().unwrap();
    let mission = folder.path().join("echo.esm");
    fs::write(&mission, MISSION).unwrap();
    let mission = mission.to_str().unwrap();
    let firmware = firmware("rover");
    let done = esm(&run_of(mission, "lm3s6965", &firmware, "1 s")).ended(1);
    assert!(done.err.contains("--with links"), "{}", done.err);
    assert!(!done.out.contains("upload |"), "{}", done.out);
    // A board for which no firmware has them says so without a robot.
    let done = esm(&["check", mission, "--board", "pico"]).ended(1);
    for words in ["E012", "no firmware of this board serves links"] {
        assert!(done.err.contains(words), "{}", done.err);
    }
    for board in BOARDS {
        esm(&["check", mission, "--board", board]).good();
    }
}
