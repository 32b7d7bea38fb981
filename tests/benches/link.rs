//! `cargo xtask bench link`: uploads of 4,096 bytes to the default robot while it is on patrol in
//! the emulator, over its UART at the rate of a real line, good and bad.
//!
//! Its argument is the firmware. Ends with status 1 if the good line brings less than is promised,
//! a slot is missed, or something runs that was not sent.

use std::cmp::Ordering;
use std::io;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use esm_link::message::{Mode, Status, Swap};
use esm_tests::command::root;
use esm_tests::subject;
use host_tools::boards;
use host_tools::files::load_world;
use host_tools::link_client::{ClientError, LinkClient};
use host_tools::lockstep::pace::Pace;
use host_tools::lockstep::plant_side::PlantSide;
use host_tools::plant::{BodyParameters, Plant};
use host_tools::qemu::{Emulator, Idle};
use host_tools::serial::noise::{Noise, Noisy};
use host_tools::serial::pacing::Paced;
use host_tools::serial::{ByteLink, DEFAULT_BAUD};
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::store::flash_store::flash_bytes;

const MISSION: &str = "missions/patrol.esm";
const BODY: &str = "missions/rover.esm";
const WORLD: &str = "missions/worlds/office.world";

/// Length of the blobs that are uploaded.
const BLOB_BYTES: usize = 4_096;
/// The worst line that uploads must arrive over: of 100 bytes so many are corrupt.
const WORST_PERCENT: u32 = 5;
/// Uploads on the good line, and on each of the bad ones.
const UPLOADS: usize = 8;
const UPLOADS_ON_A_BAD_LINE: usize = 3;
/// Part of the wire's rate that an upload on the good line takes at least.
const LEAST_RATE: f64 = 0.90;
/// How long the robot drives with a mission before the next is uploaded.
const DRIVE: Duration = Duration::from_millis(500);
/// Bits on the wire for one byte.
const BITS_PER_BYTE: f64 = 10.0;

/// Lines, and how many of [`Noise::WHOLE`] bytes are corrupted, dropped, doubled on them.
const LINES: [(&str, [u32; 3]); 7] = [
    ("good", [0, 0, 0]),
    ("1 % corrupted", [10_000, 0, 0]),
    ("1 % dropped", [0, 10_000, 0]),
    ("1 % doubled", [0, 0, 10_000]),
    ("5 %, a third of each", [16_667, 16_667, 16_667]),
    ("10 %, a third of each", [33_333, 33_333, 33_333]),
    ("20 %, a third of each", [66_667, 66_667, 66_667]),
];

fn main() -> ExitCode {
    // Cargo adds an option of its own.
    let firmware = std::env::args()
        .skip(1)
        .find(|argument| argument != "--bench");
    let Some(firmware) = firmware else {
        eprintln!("the benchmark of the link needs a firmware: cargo xtask bench link");
        return ExitCode::from(2);
    };
    match measured(Path::new(&firmware)) {
        Ok(problems) if problems.is_empty() => ExitCode::SUCCESS,
        Ok(problems) => {
            for problem in problems {
                println!("{problem}");
            }
            ExitCode::FAILURE
        }
        Err(problem) => {
            eprintln!("the benchmark of the link: {problem}");
            ExitCode::from(3)
        }
    }
}

/// A line that uploads go over.
struct Line {
    name: &'static str,
    noise: Noise,
    idle: Idle,
    uploads: usize,
    /// Whether each upload must arrive, and at a good part of the wire's rate.
    must_arrive: bool,
    must_be_fast: bool,
}

/// The good line twice, and the bad ones.
fn lines() -> Vec<Line> {
    let good = Line {
        name: "good",
        noise: Noise::default(),
        idle: Idle::Lasts,
        uploads: UPLOADS,
        must_arrive: true,
        must_be_fast: true,
    };
    let bad = LINES.map(|(name, [corrupted, dropped, doubled])| Line {
        name,
        noise: Noise {
            corrupted,
            dropped,
            doubled,
        },
        idle: Idle::Passes,
        uploads: UPLOADS_ON_A_BAD_LINE,
        // Three thirds come to a little more.
        must_arrive: corrupted + dropped + doubled <= Noise::WHOLE / 100 * WORST_PERCENT + 2,
        must_be_fast: false,
    });
    [good].into_iter().chain(bad).collect()
}

/// What uploads on one line came to.
#[derive(Default)]
struct Row {
    /// Seconds that each took that arrived, without the switch.
    took_s: Vec<f64>,
    /// From the commit until the new mission runs.
    longest_switch_s: f64,
    retries: u64,
    missed: u32,
    overruns: u32,
    /// Longest start delay since a mission began.
    longest_delay_ns: u32,
}

fn measured(firmware: &Path) -> Result<Vec<String>, String> {
    let missions = [mission("one")?, mission("other")?];
    println!(
        "Blobs of {BLOB_BYTES} bytes at {DEFAULT_BAUD} baud, while the robot drives with {MISSION}. While the emulated processor sleeps, time lasts as on the wall and its UART\n\
         is served as on a wire; or it passes at once, the UART is served between slots alone, and none is late because this machine is busy.\n"
    );
    println!(
        "| line | sleep | arrived | time, s | part of the wire's rate | sent again | switch, ms | missed | overruns | longest start delay, µs |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut problems = Vec::new();
    let mut robot: Option<Robot> = None;
    for line in lines() {
        let robot = match &mut robot {
            Some(robot) if robot.idle == line.idle => robot,
            other => {
                // The one before ends first.
                *other = None;
                other.insert(Robot::start(firmware, line.idle)?)
            }
        };
        let mut row = Row::default();
        for upload in 0..line.uploads {
            let blob = missions.get(upload % 2).map(Vec::as_slice);
            robot.take(&line, upload as u64, blob.unwrap_or_default(), &mut row)?;
        }
        println!("{}", row.shown(&line));
        problems.extend(row.problems(&line));
    }
    Ok(problems)
}

/// A robot that drives, and its line.
struct Robot {
    emulator: Emulator,
    idle: Idle,
    line: Lent,
}

impl Robot {
    fn start(firmware: &Path, idle: Idle) -> Result<Self, String> {
        let world = load_world(&root().join(WORLD)).map_err(|error| error.to_string())?;
        let plant =
            Plant::new(world, BodyParameters::default(), 1).map_err(|error| error.to_string())?;
        let plant = PlantSide::new(plant, Pace::new(true), None);
        let served = plant.clone();
        let board = boards::find(boards::DEFAULT).map_err(|error| error.to_string())?;
        let blob_bytes = board.capacities.blob_bytes;
        let flash = plant.flash(flash_bytes(blob_bytes, ERASE_BYTES as u32));
        let answer = move |request: &_| served.exchange(request);
        let mut emulator = Emulator::start(board, firmware, idle, answer, flash)
            .map_err(|error| error.to_string())?;
        let uart = emulator.take_uart().ok_or("the emulator has no UART")?;
        let line = Lent(Arc::new(Mutex::new(Paced::new(uart, DEFAULT_BAUD))));
        let blob = subject::build_file(&root().join(MISSION))?.blob;
        LinkClient::connect(line.clone())
            .and_then(|(mut client, _)| client.upload(&blob, &mut |_| ()))
            .map_err(|error| error.to_string())?;
        std::thread::sleep(DRIVE);
        Ok(Robot {
            emulator,
            idle,
            line,
        })
    }

    /// Takes an upload over the line, made bad; then the good one tells what has come of it.
    fn take(&mut self, line: &Line, seed: u64, blob: &[u8], row: &mut Row) -> Result<(), String> {
        let failed = |error: ClientError| error.to_string();
        let (mut client, _) = LinkClient::connect(self.line.clone()).map_err(failed)?;
        let before = client.status().map_err(failed)?;
        let was = client.running_blob().map_err(failed)?;
        let bad = Noisy::new(self.line.clone(), line.noise, seed);
        let arrived = LinkClient::connect(bad).and_then(|(mut client, _)| {
            let started = Instant::now();
            let staged = client.stage(blob, &mut |_| ());
            row.retries += client.counts().retries;
            staged.map(|()| started.elapsed())
        });
        let (mut client, _) = LinkClient::connect(self.line.clone()).map_err(failed)?;
        let meanwhile = client.status().map_err(failed)?;
        row.note(&before, &meanwhile);
        let mut runs = was.as_slice();
        match arrived {
            Ok(took) => {
                let started = Instant::now();
                client.commit(Swap::default()).map_err(failed)?;
                row.longest_switch_s = row.longest_switch_s.max(started.elapsed().as_secs_f64());
                row.took_s.push(took.as_secs_f64());
                runs = blob;
            }
            Err(ClientError::NoReply { .. }) => {}
            Err(error) => return Err(failed(error)),
        }
        if client.running_blob().map_err(failed)? != runs {
            return Err("a mission runs that nobody sent".into());
        }
        std::thread::sleep(DRIVE);
        let after = client.status().map_err(failed)?;
        row.note(&meanwhile, &after);
        if after.mode != Mode::Running {
            return Err(format!("the robot does not drive: {:?}", after.mode));
        }
        self.emulator
            .check_alive()
            .map_err(|error| error.to_string())
    }
}

/// The robot's line, for one session after another.
#[derive(Clone)]
struct Lent(Arc<Mutex<Paced<UnixStream>>>);

impl Lent {
    fn line(&self) -> MutexGuard<'_, Paced<UnixStream>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ByteLink for Lent {
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        self.line().receive(buffer, timeout)
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.line().send(bytes)
    }
}

impl Row {
    /// Takes what the robot counted since. To be called before a new mission begins to count its
    /// delays anew, and after.
    fn note(&mut self, before: &Status, now: &Status) {
        self.missed += now.missed - before.missed;
        self.overruns += now.overruns - before.overruns;
        self.longest_delay_ns = self.longest_delay_ns.max(now.max_delay_ns);
    }

    /// Part of the wire's rate that half of the uploads come to at least.
    fn rate(&self) -> f64 {
        let wire_s = BLOB_BYTES as f64 * BITS_PER_BYTE / f64::from(DEFAULT_BAUD);
        let mut took_s = self.took_s.clone();
        took_s.sort_by(f64::total_cmp);
        took_s
            .get(took_s.len() / 2)
            .map_or(0.0, |took_s| wire_s / took_s)
    }

    fn shown(&self, line: &Line) -> String {
        let sleep = match line.idle {
            Idle::Lasts => "lasts",
            Idle::Passes => "passes",
        };
        let arrived = self.took_s.len();
        let shortest_s = self.took_s.iter().copied().fold(f64::INFINITY, f64::min);
        let longest_s = self.took_s.iter().copied().fold(0.0, f64::max);
        let (time, rate, switch) = if arrived > 0 {
            (
                format!("{shortest_s:.3} to {longest_s:.3}"),
                format!("{:.1} %", 100.0 * self.rate()),
                format!("{:.0}", 1e3 * self.longest_switch_s),
            )
        } else {
            Default::default()
        };
        format!(
            "| {} | {sleep} | {arrived} of {} | {time} | {rate} | {} | {switch} | {} | {} | {:.1} |",
            line.name,
            line.uploads,
            self.retries,
            self.missed,
            self.overruns,
            f64::from(self.longest_delay_ns) / 1e3,
        )
    }

    fn problems(&self, line: &Line) -> Vec<String> {
        let name = line.name;
        let mut problems = Vec::new();
        if self.missed + self.overruns > 0 {
            problems.push(format!(
                "{name}: {} occurrences missed, {} overruns",
                self.missed, self.overruns
            ));
        }
        if line.must_be_fast && self.rate() < LEAST_RATE {
            problems.push(format!(
                "{name}: half of the uploads are below {:.0} % of the wire's rate; is this machine busy?",
                100.0 * LEAST_RATE
            ));
        }
        if line.must_arrive && self.took_s.len() < line.uploads {
            problems.push(format!("{name}: not all arrived"));
        }
        problems
    }
}

/// The patrol, with a region more whose states have names that bring the blob to [`BLOB_BYTES`].
fn mission(name: &str) -> Result<Vec<u8>, String> {
    const STATES: usize = 16;
    let read = |path: &str| -> Result<(PathBuf, String), String> {
        let path = root().join(path);
        let text = std::fs::read_to_string(&path).map_err(|error| error.to_string())?;
        Ok((path, text))
    };
    let ((path, text), (body_path, body)) = (read(MISSION)?, read(BODY)?);
    let (before, after) = text
        .split_once("    region sonars {")
        .ok_or("the patrol has other regions now")?;
    let build = |letters: usize| -> Result<Vec<u8>, String> {
        let mut states = String::new();
        let mut first = None;
        for state in 0..STATES {
            // The letters are spread evenly.
            let length = (letters + state) / STATES;
            let state = format!("{:x<length$}", format!("{name}{state}"));
            states += &format!("        state {state};\n");
            first.get_or_insert(state);
        }
        let first = first.unwrap_or_default();
        let text = format!(
            "{before}    region ballast {{\n{states}        initial -> {first};\n    }}\n\n    region sonars {{{after}"
        );
        let files = [
            (path.display().to_string(), text),
            (body_path.display().to_string(), body.clone()),
        ];
        let files: Vec<(&str, &[u8])> = files
            .iter()
            .map(|(path, text)| (path.as_str(), text.as_bytes()))
            .collect();
        Ok(subject::build_files(&files)?.blob)
    };
    // Each letter is a byte.
    let mut letters = STATES * 20;
    for _ in 0..5 {
        let blob = build(letters)?;
        match BLOB_BYTES.cmp(&blob.len()) {
            Ordering::Equal => return Ok(blob),
            Ordering::Greater => letters += BLOB_BYTES - blob.len(),
            Ordering::Less => letters = letters.saturating_sub(blob.len() - BLOB_BYTES),
        }
    }
    Err(format!("no blob comes to {BLOB_BYTES} bytes"))
}
