//! The studio: its run without a thread is the command's, and its page is served to nobody else.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::panic::resume_unwind;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use esm_tests::command::{Robot, esm_binary, root};
use esm_tests::host_drive::{driven, plan, world};
use esm_tests::subject;
use host_tools::host_run::{HostRun, Planned, RunMission, Settings, start_rover};
use host_tools::plant::BodyParameters;
use host_tools::recording::player::Recording;
use host_tools::recording::walk::Walk;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

const UNTIL_US: u64 = 15_000_000;

fn mission(file: &Path) -> RunMission {
    let blob = subject::build_file(file).expect("a mission").blob;
    let verified = esm_core::verify(blob).expect("a valid blob");
    RunMission::new("mission", verified).expect("a mission with names")
}

fn planned(at_us: u64, file: &Path, warm: bool) -> Planned {
    Planned {
        at_us,
        mission: mission(file),
        warm,
    }
}

fn started(world_name: &str, missions: Vec<Planned>) -> HostRun<'static, 'static, 'static> {
    let settings = Settings {
        world: world(world_name),
        body: BodyParameters::default(),
        seed: 1,
        until_us: UNTIL_US,
        breaks: Vec::new(),
        stuck_wheels: Vec::new(),
        stop_at_us: None,
        cut_link_us: None,
    };
    start_rover(settings, missions).expect("a run")
}

/// A test without optimisation makes the memory of a run on the stack.
fn with_stack_for_a_run(test: fn()) {
    const STACK_BYTES: usize = 8 * 1024 * 1024;
    let thread = thread::Builder::new().stack_size(STACK_BYTES).spawn(test);
    if let Err(panic) = thread.expect("a thread").join() {
        resume_unwind(panic);
    }
}

#[test]
fn a_run_without_a_thread_has_the_trace_of_the_board() {
    with_stack_for_a_run(compare_with_the_board);
}

fn compare_with_the_board() {
    for (name, world_name) in [
        ("patrol", "office"),
        ("guard", "visitors"),
        ("follow_wall", "corridor"),
        // Its robot wants to hear of the host.
        ("on_a_lead", "office"),
        ("tutorial/6_everything", "track"),
    ] {
        let file = root().join(format!("missions/{name}.esm"));
        let mut run = started(world_name, vec![planned(0, &file, false)]);
        // In slices of any length.
        let mut to_us = 0;
        while run.go_on(to_us).expect("a run that goes on") {
            to_us += 777_777;
        }
        let ended = run.finish().expect("an end");
        let mut board = plan(&file, world(world_name));
        board.until_us = Some(UNTIL_US);
        let board = driven(board);
        assert_eq!(ended.told.counts, board.told.counts, "{name}");
        assert!(
            ended.told.out == board.told.out,
            "{name}: the traces differ"
        );
        assert_eq!(ended.plant.distance_m(), board.plant.distance_m(), "{name}");
    }
}

#[test]
fn what_a_run_tells_is_in_its_trace_and_each_moment_has_its_choices() {
    with_stack_for_a_run(compare_told_with_trace);
}

fn compare_told_with_trace() {
    let file = root().join("missions/patrol.esm");
    let later = root().join("missions/follow_wall.esm");
    let missions = vec![
        planned(0, &file, false),
        planned(6_000_000, &file, true),
        planned(9_000_000, &later, false),
    ];
    let mut run = started("office", missions);
    assert!(!run.go_on(u64::MAX).expect("a run that goes on"));
    let given = run.take();
    let carried = run.carried().to_vec();
    assert_eq!((carried.len(), carried[0], carried[2]), (3, 0, 0));
    assert!(carried[1] > 0, "the same mission goes on as it is");
    let ended = run.finish().expect("an end");
    let (told, recording) = (ended.told, ended.recording);
    assert_eq!(
        told.missions
            .iter()
            .map(|it| it.start_us)
            .collect::<Vec<_>>(),
        [0, 6_000_000, 9_000_000]
    );
    let times: Vec<u64> = given.shown.iter().map(|it| it.t_us).collect();
    assert!(times.is_sorted() && times.len() as u64 >= UNTIL_US / 50_000);
    let text = String::from_utf8(told.out).expect("text");
    let recording = Recording::read(&recording).expect("a recording");
    let (walk, ended) = Walk::new(&recording, false);
    assert!(ended.is_none(), "{ended:?}");
    let mut starts = (told.missions.iter()).map(|it| it.start_us).peekable();
    let (mut start_us, mut taken) = (0, 0);
    for line in text.lines() {
        let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
        if line["step"] == 0 && line["t_us"] == 0 && line["kind"] == "step" {
            start_us = starts.next().expect("a mission");
        }
        if line["kind"] != "transition" || line["step"] == 0 {
            continue;
        }
        let at_us = start_us + line["t_us"].as_u64().expect("a time");
        let choices = walk.choices_at(at_us).expect("a macro step");
        assert_eq!(choices.step, line["step"].as_u64().expect("a number"));
        let micro = line["micro"].as_u64().expect("a number") as usize;
        let of_micro = &choices.micro_steps[micro];
        assert_eq!(of_micro.event, line["event"].as_str().expect("an event"));
        let found = of_micro.choices.iter().find(|it| {
            it.is_taken && line["from"] == it.from.as_str() && line["to"] == it.to.as_str()
        });
        let found = found.unwrap_or_else(|| panic!("{line} is not among {of_micro:?}"));
        assert!(found.holds && found.is_heard);
        // What was not taken before it could not be.
        let before = of_micro.choices.iter().take_while(|it| !it.is_taken);
        assert!(
            before
                .filter(|it| it.from == found.from && it.is_heard)
                .all(|it| !it.holds)
        );
        taken += 1;
    }
    assert!(taken > 10, "{taken} transitions");
}

/// A studio that is served.
struct Served {
    child: Child,
    address: String,
}

impl Served {
    fn start(words: &[&str]) -> Self {
        let mut child = Command::new(esm_binary())
            .args(["studio", "--json"])
            .args(words)
            .current_dir(root())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the command");
        let mut line = String::new();
        BufReader::new(child.stdout.take().expect("its output"))
            .read_line(&mut line)
            .expect("its address");
        let said: serde_json::Value = serde_json::from_str(&line).expect("JSON");
        let address = said["address"].as_str().expect("an address").to_owned();
        Served { child, address }
    }

    /// Host and path of the address.
    fn parts(&self) -> (&str, &str) {
        let rest = self.address.strip_prefix("http://").expect("an address");
        rest.split_at(rest.find('/').expect("a path"))
    }

    /// The answer to a request, from its first line on.
    fn ask(&self, head: &str) -> String {
        String::from_utf8_lossy(&self.ask_for_bytes(head)).into_owned()
    }

    fn ask_for_bytes(&self, head: &str) -> Vec<u8> {
        let mut stream = TcpStream::connect(self.parts().0).expect("a connection");
        stream
            .set_read_timeout(Some(Duration::from_secs(10)))
            .expect("a limit");
        write!(stream, "{head}\r\nConnection: close\r\n\r\n").expect("a request");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).expect("an answer");
        answer
    }

    /// What is new of the robot since an answer: what is told of it, and bytes of its recording.
    fn news(&self, from: usize, seen: &str) -> (serde_json::Value, Vec<u8>) {
        let (host, path) = self.parts();
        let head = format!("GET {path}live?from={from}&seen={seen} HTTP/1.1\r\nHost: {host}");
        let answer = self.ask_for_bytes(&head);
        assert!(answer.starts_with(b"HTTP/1.1 200"), "{head}");
        let mut windows = answer.windows(4);
        let body = windows.position(|it| it == b"\r\n\r\n").expect("a body") + 4;
        let (length, rest) = answer[body..].split_first_chunk().expect("a length");
        let (told, bytes) = rest.split_at(u32::from_le_bytes(*length) as usize);
        (serde_json::from_slice(told).expect("JSON"), bytes.to_vec())
    }

    fn get(&self, path: &str) -> String {
        self.ask(&format!("GET {path} HTTP/1.1\r\nHost: {}", self.parts().0))
    }

    fn end(mut self) {
        let id = Pid::from_raw(self.child.id() as i32);
        kill(id, Signal::SIGINT).expect("a signal");
        let status = self.child.wait().expect("an end");
        assert_eq!(status.code(), Some(0));
    }
}

#[test]
fn the_page_is_served_to_who_has_its_address_alone() {
    let served = Served::start(&["missions/tutorial/3_gap.esm"]);
    let (host, path) = served.parts();
    assert!(host.starts_with("127.0.0.1:"));
    let page = served.get(path);
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    assert!(page.contains("Content-Security-Policy: default-src 'self'"));
    assert!(page.contains("<title>esm studio</title>"));
    assert!(
        served
            .get(&format!("{path}studio.js"))
            .contains("text/javascript")
    );
    let files = served.get(&format!("{path}files.json"));
    assert!(
        files.contains("\"open\":\"/disk/tutorial/3_gap.esm\""),
        "{files:.300}"
    );
    assert!(files.contains("\"/disk/rover.esm\""));
    for (what, status, head) in [
        ("no token", 403, format!("GET / HTTP/1.1\r\nHost: {host}")),
        (
            "another name for this computer",
            403,
            format!("GET {path} HTTP/1.1\r\nHost: evil.example"),
        ),
        (
            "a page from elsewhere",
            403,
            format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://evil.example"),
        ),
        (
            "no such file",
            404,
            format!("GET {path}../../Cargo.toml HTTP/1.1\r\nHost: {host}"),
        ),
        (
            "something to write",
            405,
            format!("POST {path} HTTP/1.1\r\nHost: {host}\r\nContent-Length: 0"),
        ),
    ] {
        let answer = served.ask(&head);
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {status}")),
            "{what}: {answer}"
        );
    }
    served.end();
}

#[test]
fn many_connections_at_once_wait_for_nobody() {
    let served = Served::start(&[]);
    let (host, path) = served.parts();
    let began = Instant::now();
    for _ in 0..10 {
        // Opened together, as a browser does it, and none ends before its answer says so.
        let mut streams: Vec<TcpStream> = (0..12)
            .map(|_| TcpStream::connect(host).expect("a connection"))
            .collect();
        for stream in &mut streams {
            let limit = Some(Duration::from_secs(20));
            stream.set_read_timeout(limit).expect("a limit");
            write!(
                stream,
                "GET {path}studio.css HTTP/1.1\r\nHost: {host}\r\n\r\n"
            )
            .expect("a request");
        }
        // Whichever is answered is closed, as the answer asks for.
        while !streams.is_empty() {
            let mut open = Vec::new();
            for mut stream in streams {
                let wait = Some(Duration::from_millis(20));
                stream.set_read_timeout(wait).expect("a limit");
                let mut begun = [0; 4096];
                match stream.read(&mut begun) {
                    Ok(read) => {
                        let head = String::from_utf8_lossy(&begun[..read]);
                        assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
                        assert!(head.contains("\r\nConnection: close\r\n"), "{head}");
                    }
                    Err(_) => open.push(stream),
                }
            }
            streams = open;
            assert!(began.elapsed() < Duration::from_secs(20), "they wait");
        }
    }
    served.end();
}

#[test]
fn news_of_a_robot_are_a_recording_that_grows_and_stop_with_the_robot() {
    let robot = Robot::start("host", None);
    let upload = Command::new(esm_binary())
        .args(["upload", "missions/patrol.esm", "--port", robot.port()])
        .current_dir(root())
        .output()
        .expect("the command");
    assert_eq!(upload.status.code(), Some(0));
    let mut served = Served::start(&["--port", robot.port()]);
    let files = served.get(&format!("{}files.json", served.parts().1));
    assert!(files.contains("\"live\":true"));
    let (mut bytes, mut seen) = (Vec::new(), String::new());
    let began = Instant::now();
    let mut steps = 0;
    // As long as it takes for slots to be counted, and for some macro steps.
    loop {
        let (told, more) = served.news(bytes.len(), &seen);
        assert_eq!(told["from"], bytes.len());
        assert_ne!(told["seen"], seen.as_str(), "an answer waits for news");
        assert_eq!(told["error"], serde_json::Value::Null);
        bytes.extend(more);
        seen = told["seen"].as_str().expect("a number").to_owned();
        steps = told["steps"].as_u64().unwrap_or(steps);
        let slots = told["slots"].as_array().expect("slots").len();
        if steps > 100 && slots == 3 && told["mission_us"].is_u64() {
            break;
        }
        assert!(began.elapsed() < Duration::from_secs(30), "{told}");
    }
    let recording = Recording::read(&bytes).expect("a recording");
    let (walk, ended) = Walk::new(&recording, false);
    assert!(ended.is_none(), "{ended:?}");
    assert!(walk.choices_at(u64::MAX).is_some());
    assert!(recording.has_samples());
    // The robot is lost, and the command says so.
    drop(robot);
    let status = served.child.wait().expect("an end");
    assert_eq!(status.code(), Some(3));
}

#[test]
fn the_page_can_be_written_for_another_server() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("site");
    let mut studio = Command::new(esm_binary());
    studio.args(["studio", "missions", "--write"]).arg(&out);
    let written = studio.current_dir(root()).status().expect("the command");
    assert_eq!(written.code(), Some(0));
    for name in [
        "index.html",
        "studio.js",
        "studio.css",
        "worker.js",
        "licenses.txt",
        "engine.wasm.gz",
    ] {
        let bytes = std::fs::read(out.join(name)).expect("a file of the page");
        let committed = std::fs::read(root().join("studio/dist").join(name)).expect("the page");
        assert!(bytes == committed, "{name}");
    }
    let none = Command::new(esm_binary())
        .args(["studio", "missions/none.esm", "--write"])
        .arg(&out)
        .current_dir(root())
        .output()
        .expect("the command");
    assert_eq!(none.status.code(), Some(1));
}
