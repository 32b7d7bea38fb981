//! A link of missions over the second UART of the emulated board: what it sends comes back, and is
//! received.

#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::thread;

use esm_link::frames::configuration::{Configuration, Content};
use esm_link::frames::receiver::{InFrame, Receiver, SortedFrames};
use esm_tests::command::{esm, esm_in, firmware, firmware_with_links};
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

/// The words of `esm` that run a mission with a firmware of the emulated board.
fn run_of<'a>(mission: &'a str, firmware: &'a Path, until: &'a str) -> Vec<&'a str> {
    let firmware = firmware.to_str().unwrap();
    let of_board = [
        "run",
        mission,
        "--board",
        "lm3s6965",
        "--firmware",
        firmware,
    ];
    [&of_board[..], &["--world", "office", "--until", until]].concat()
}

#[test]
fn what_the_board_sends_over_its_uart_it_can_receive() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("echo.esm"), MISSION).unwrap();
    // The emulator as it is, with something at the board's second UART.
    let emulator = format!(
        "#!/bin/sh\nPATH=\"${{PATH#*:}}\" exec qemu-system-arm \"$@\" -serial 'unix:{}'\n",
        path("uart1")
    );
    fs::write(path("qemu-system-arm"), emulator).unwrap();
    fs::set_permissions(path("qemu-system-arm"), fs::Permissions::from_mode(0o755)).unwrap();
    let listener = UnixListener::bind(path("uart1")).unwrap();
    let echo = thread::spawn(move || {
        let (mut line, _) = listener.accept().unwrap();
        let (mut all, mut buffer) = (Vec::new(), [0; 256]);
        while let Ok(count @ 1..) = line.read(&mut buffer) {
            all.extend_from_slice(&buffer[..count]);
            if line.write_all(&buffer[..count]).is_err() {
                break;
            }
        }
        all
    });
    let search = format!(
        "{}:{}",
        folder.path().to_str().unwrap(),
        std::env::var("PATH").unwrap()
    );
    let firmware = firmware_with_links();
    let (mission, trace) = (path("echo.esm"), path("trace.jsonl"));
    let mut arguments = run_of(&mission, &firmware, "5 s");
    arguments.extend(["--link", "uart", "--trace", &trace]);
    esm_in(&[("PATH", &search)], &arguments).good();
    let bytes = echo.join().unwrap();
    let configuration = Configuration::of(1, Content::Flags(2), 16, 100_000);
    let frames = [InFrame {
        identifier: 1,
        payload_bytes: 16,
        configuration,
    }];
    let frames = SortedFrames::new(&frames).unwrap();
    let (mut receiver, mut rest) = (Receiver::new(), &bytes[..]);
    let mut numbers = Vec::new();
    while let Some(frame) = receiver.take(&mut rest, &frames) {
        numbers.push(usize::from(frame.unwrap().number));
    }
    assert!((45..=55).contains(&numbers.len()), "{numbers:?}");
    let first = numbers[0];
    assert_eq!(numbers, (first..first + numbers.len()).collect::<Vec<_>>());
    // When bytes come is up to this machine; whether they are right is not.
    let trace = fs::read_to_string(&trace).unwrap();
    let lines = trace
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap());
    let mut entered: Vec<String> = lines
        .filter(|line| line["kind"] == "transition")
        .map(|line| line["to"].as_str().unwrap().to_owned())
        .collect();
    entered.retain(|state| state.starts_with("hearing/"));
    assert!(
        entered.iter().filter(|it| *it == "hearing/Yes").count() >= 3,
        "{entered:?}"
    );
    assert!(
        entered.iter().all(|it| it != "hearing/Wrong"),
        "{entered:?}"
    );
}

#[test]
fn a_mission_with_links_is_refused_where_they_are_not_and_before_it_is_sent() {
    let folder = tempfile::tempdir().unwrap();
    let mission = folder.path().join("echo.esm");
    fs::write(&mission, MISSION).unwrap();
    let mission = mission.to_str().unwrap();
    let firmware = firmware("rover");
    let done = esm(&run_of(mission, &firmware, "1 s")).ended(1);
    assert!(done.err.contains("--with links"), "{}", done.err);
    assert!(!done.out.contains("upload |"), "{}", done.out);
    // A board for which no firmware has them says so without a robot.
    let done = esm(&["check", mission, "--board", "stm32f405"]).ended(1);
    for words in ["E012", "no firmware of this board serves links"] {
        assert!(done.err.contains(words), "{}", done.err);
    }
    esm(&["check", mission, "--board", "lm3s6965"]).good();
}
