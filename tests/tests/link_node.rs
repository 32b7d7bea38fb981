//! `esm link`: a computer as a node on a line between processors, with another one, and with a
//! board.

#![cfg(unix)]
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::io::{Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use esm_tests::command::{esm, esm_binary, esm_in, firmware_with, root};
use serde_json::{Value, json};

/// A node that runs.
struct Node(Child);

impl Node {
    fn start(port: &Path, mission: &str, time: &str) -> Self {
        let mut command = Command::new(esm_binary());
        let port = format!("unix:{}", port.to_str().unwrap());
        command
            .args(["link", "--port", &port, mission, "--for", time])
            .current_dir(root())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        Node(command.spawn().unwrap())
    }

    fn say(&mut self, lines: &str) {
        let input = self.0.stdin.as_mut().unwrap();
        input.write_all(lines.as_bytes()).unwrap();
    }

    /// What it has told until its end, its last words and its exit status.
    fn end(self) -> (Vec<Value>, String, Option<i32>) {
        let output = self.0.wait_with_output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        let told = text.lines().map(|line| serde_json::from_str(line).unwrap());
        let error = String::from_utf8(output.stderr).unwrap();
        (told.collect(), error, output.status.code())
    }
}

/// The values of a frame, one after the other.
fn values<'t>(told: &'t [Value], frame: &str) -> Vec<&'t Value> {
    let of_it = told
        .iter()
        .filter(|it| it["what"] == "frame" && it["frame"] == frame);
    of_it.collect()
}

/// Carries bytes from one to the other, but for the time in which the line is cut.
fn carry(mut from: UnixStream, mut to: UnixStream, begun: Instant, cut: [Duration; 2]) {
    let mut buffer = [0; 256];
    while let Ok(count @ 1..) = from.read(&mut buffer) {
        let is_cut = (cut[0]..cut[1]).contains(&begun.elapsed());
        if !is_cut && to.write_all(&buffer[..count]).is_err() {
            return;
        }
    }
}

#[test]
fn two_nodes_hear_each_other_and_tell_when_the_line_is_cut() {
    let folder = tempfile::tempdir().unwrap();
    let ports = ["near", "far"].map(|name| folder.path().join(name));
    let listeners = ports.each_ref().map(|it| UnixListener::bind(it).unwrap());
    let relay = thread::spawn(move || {
        let [near, far] = listeners.each_ref().map(|it| it.accept().unwrap().0);
        let begun = Instant::now();
        let cut = [1_500, 2_500].map(Duration::from_millis);
        let back = (far.try_clone().unwrap(), near.try_clone().unwrap());
        let back = thread::spawn(move || carry(back.0, back.1, begun, cut));
        carry(near, far, begun, cut);
        back.join().unwrap();
    });
    let missions = ["base", "head"].map(|name| format!("missions/head_and_base/{name}.esm"));
    let mut near = Node::start(&ports[0], &missions[0], "4 s");
    let mut far = Node::start(&ports[1], &missions[1], "4 s");
    near.say("pose 1.5 -2 0.25\nhalted on\nhalted maybe\nspeed 1\n");
    thread::sleep(Duration::from_millis(700));
    far.say("blind on\n");
    let (of_near, near_said, _) = near.end();
    let (of_far, _, _) = far.end();
    relay.join().unwrap();
    for words in ["`halted on` or `halted off`", "there are pose, halted"] {
        assert!(near_said.contains(words), "{near_said}");
    }
    let poses = values(&of_far, "pose");
    let pose = json!({"x_m": 1.5, "y_m": -2.0, "heading_rad": 0.25});
    // 25 a second, less the second without a line and the start of the other; a busy machine leaves
    // some out.
    assert!((30..=80).contains(&poses.len()), "{}", poses.len());
    assert!(poses.iter().all(|it| it["value"] == pose), "{poses:?}");
    let lost: u64 = poses.iter().map(|it| it["lost"].as_u64().unwrap()).sum();
    assert!(lost >= 20, "{lost}");
    for it in &poses {
        // 22 bytes of the line, and what this machine does meanwhile.
        let age_ms = it["age_ms"].as_f64().unwrap();
        assert!((1.9..1_000.0).contains(&age_ms), "{it}");
    }
    let blind: Vec<bool> = (values(&of_near, "sight").iter())
        .map(|it| it["value"]["blind"].as_bool().unwrap())
        .collect();
    assert!(
        blind.is_sorted() && !blind[0] && *blind.last().unwrap(),
        "{blind:?}"
    );
    // Nobody says ranges: they are late once, and the rest when the line is cut.
    let late = |told: &[Value], frame: &str| {
        let of_it = told
            .iter()
            .filter(|it| it["what"] == "late" && it["frame"] == frame);
        of_it.count()
    };
    assert_eq!(late(&of_near, "ranges"), 1);
    assert!(late(&of_near, "sight") >= 1 && late(&of_far, "alarm") >= 1);
    let counts = of_near.last().unwrap();
    assert_eq!(counts["what"], "counts");
    assert!(counts["sent"][0]["sent"].as_u64().unwrap() > 50, "{counts}");
    assert_eq!(counts["received"][0]["received"], 0, "{counts}");
}

/// Sends a flag that changes each 300 ms, and tells by a state whether it hears one.
const BOARD: &str = "\
    interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n\
    slot 2 period 20 ms duration 4 ms; slot 3 period 20 ms duration 4 ms;\n\
    link other rate 115200 bps header 6 bytes;\n\
    frame there 1 out on other flags a payload 16 bytes period 100 ms;\n\
    frame back 2 in on other flags c payload 16 bytes period 100 ms;\n\
    machine Board {\n\
    region talking {\n\
    task Off: other.transmit slot 2 timeout 300 ms;\n\
    task On: other.transmit slot 2 timeout 300 ms;\n\
    initial -> Off;\n\
    Off -> On on pulse [timeout] / set .a; On -> Off on pulse [timeout]; }\n\
    region hearing {\n\
    task No: other.receive slot 3; task Yes: other.receive slot 3; state Wrong;\n\
    initial -> No; No -> Wrong on pulse [.errors]; Yes -> Wrong on pulse [.errors];\n\
    No -> Yes on pulse [.c and not .errors]; } }";

/// The same from the other end.
const OPERATOR: &str = "\
    interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n\
    slot 2 period 20 ms duration 4 ms; slot 3 period 20 ms duration 4 ms;\n\
    link robot rate 115200 bps header 6 bytes;\n\
    frame told 1 in on robot flags a payload 16 bytes period 100 ms;\n\
    frame asked 2 out on robot flags go payload 16 bytes period 100 ms;\n\
    machine Operator {\n\
    region talking { task Tell: robot.transmit slot 2; initial -> Tell; }\n\
    region hearing { task Hear: robot.receive slot 3; state On; initial -> Hear;\n\
    Hear -> On on pulse [.a or .errors or .told_delayed or .told_available]; } }";

#[test]
fn an_operator_is_heard_by_a_board_and_hears_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("board.esm"), BOARD).unwrap();
    fs::write(path("operator.esm"), OPERATOR).unwrap();
    // The emulator as it is, with a socket at the board's second UART.
    let emulator = format!(
        "#!/bin/sh\nPATH=\"${{PATH#*:}}\" exec qemu-system-arm \"$@\" -serial 'unix:{},server=on,wait=off'\n",
        path("uart1")
    );
    fs::write(path("qemu-system-arm"), emulator).unwrap();
    fs::set_permissions(path("qemu-system-arm"), fs::Permissions::from_mode(0o755)).unwrap();
    let search = format!("{}:{}", path(""), std::env::var("PATH").unwrap());
    let firmware = firmware_with("lm3s6965", "links");
    let (mission, trace) = (path("board.esm"), path("trace.jsonl"));
    let firmware = firmware.to_str().unwrap().to_owned();
    esm_binary();
    let board = thread::spawn({
        let trace = trace.clone();
        move || {
            let arguments = [
                "run",
                &mission,
                "--board",
                "lm3s6965",
                "--firmware",
                &firmware,
                "--world",
                "office",
                "--until",
                "6 s",
                "--realtime",
                "--trace",
                &trace,
            ];
            esm_in(&[("PATH", &search)], &arguments).good()
        }
    });
    let uart = folder.path().join("uart1");
    let begun = Instant::now();
    while !uart.exists() && begun.elapsed() < Duration::from_secs(60) {
        thread::sleep(Duration::from_millis(20));
    }
    let mut operator = Node::start(&uart, &path("operator.esm"), "30 s");
    thread::sleep(Duration::from_secs(2));
    operator.say("go on\n");
    let (told, said, status) = operator.end();
    board.join().unwrap();
    // The board's end is the end of the line.
    assert_eq!(status, Some(3), "{said}");
    assert!(said.contains("is gone"), "{said}");
    let flags: Vec<bool> = (values(&told, "told").iter())
        .map(|it| it["value"]["a"].as_bool().unwrap())
        .collect();
    let changes = flags.windows(2).filter(|it| it[0] != it[1]).count();
    assert!(flags.len() >= 30 && changes >= 8, "{flags:?}");
    let trace = fs::read_to_string(trace).unwrap();
    assert!(trace.contains("\"to\":\"hearing/Yes\""));
    assert!(!trace.contains("\"to\":\"hearing/Wrong\""));
}

#[test]
fn what_is_no_node_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let other = file("other.esm", &OPERATOR.replace("payload 16", "payload 0"));
    let unlinked = "missions/patrol.esm".to_owned();
    let linked = file("operator.esm", OPERATOR);
    for (mission, more, status, words) in [
        (&unlinked, &[][..], 1, "uses no link"),
        (&other, &[], 1, "E014"),
        (&linked, &["--link", "radio"], 2, "it uses robot"),
        (&linked, &[], 3, "there is no"),
    ] {
        let port = folder.path().join("gone");
        let port = format!("unix:{}", port.to_str().unwrap());
        let arguments = [&["link", "--port", &port, mission][..], more].concat();
        let said = esm(&arguments).ended(status);
        assert!(said.err.contains(words), "{said:#?}");
    }
}
