//! What frames of a link take on the emulated board, in instructions.
//!
//! The firmware is `boards/lm3s6965/src/bin/bench_links.rs`; there stands also what is measured.

use std::error::Error;
use std::io::{Read, Write};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use host_tools::schedule::LaidOut;
use host_tools::{compile, lang};

use super::emulated::Emulated;

/// Sends a value of 16 bytes, and receives one.
const MISSION: &str = "\
    interpreter slot 1;\n\
    slot 1 period 20 ms duration 4 ms; slot 2 period 20 ms duration 4 ms;\n\
    slot 3 period 20 ms duration 4 ms;\n\
    task Give slot 2 { out data control: WheelControl; }\n\
    task Probe slot 2 { } task Probed slot 2 { } task Sent slot 2 { }\n\
    task Got slot 3 { in data control: WheelControl optional; }\n\
    task Spin slot 0 { }\n\
    link other rate 1000000 bps header 6 bytes;\n\
    frame there 1 out on other: WheelControl payload 16 bytes period 40 ms;\n\
    frame back 1 in on other: WheelControl payload 16 bytes period 40 ms;\n\
    machine Bench {\n\
    region give { task Give: Give; initial -> Give; Give -> Give on *; }\n\
    region probe { task Probe: Probe; initial -> Probe; Probe -> Probe on *; }\n\
    region probed { task Probed: Probed; initial -> Probed; Probed -> Probed on *; }\n\
    region tell { task Tell: other.transmit slot 2; initial -> Tell; Tell -> Tell on *; }\n\
    region sent { task Sent: Sent; initial -> Sent; Sent -> Sent on *; }\n\
    region before { task Before: Probe slot 3; initial -> Before; Before -> Before on *; }\n\
    region hear { task Hear: other.receive slot 3; initial -> Hear; Hear -> Hear on *; }\n\
    region got { task Got: Got; initial -> Got; Got -> Got on *; }\n\
    region below { task Work: Spin; initial -> Work; Work -> Work on *; }\n\
    path Give.control -> Tell.there; path Hear.back -> Got.control; }";
/// First starts of the slots, and that of the frame: behind them, as the firmware has it.
const STARTS_US: [u32; 3] = [0, 5_000, 10_000];
const FRAME_US: u32 = 15_000;
/// How long the emulator may take.
const LIMIT: Duration = Duration::from_secs(60);
/// The socket that is the board's second UART, in the emulator's folder.
const UART_SOCKET: &str = "uart1";

/// What was measured, in instructions.
#[derive(Clone, Copy, Debug)]
pub struct LinkCosts {
    /// What a dispatcher adds to its slot that sends a frame of 16 bytes.
    pub transmit: f64,
    /// The same without a frame that is due.
    pub transmit_none: f64,
    /// What one adds that receives such a frame.
    pub receive: f64,
    /// The same where nothing has arrived.
    pub receive_none: f64,
    /// What any task adds: one that does nothing.
    pub task: f64,
    /// Checksum of a frame, in either direction.
    pub checksum: f64,
    /// COBS of one that is sent.
    pub stuff: f64,
    /// COBS of one that is received.
    pub unstuff: f64,
    /// What the interrupts take together that send a frame, 26 bytes of the line.
    pub sent: f64,
    /// What the interrupt takes that receives a byte.
    pub byte: f64,
}

impl LinkCosts {
    /// What a frame that is sent takes in the dispatcher's slot beyond checksum and COBS.
    #[must_use]
    pub fn transmit_beyond(&self) -> f64 {
        self.transmit - self.transmit_none - self.checksum - self.stuff
    }

    /// What a frame that is received takes there.
    #[must_use]
    pub fn receive_beyond(&self) -> f64 {
        self.receive - self.receive_none - self.checksum - self.unstuff
    }
}

/// Runs the firmware.
///
/// # Errors
/// What stood in the way, for a person.
pub fn measure(firmware: &Path) -> Result<LinkCosts, Box<dyn Error>> {
    let mut checked = lang::load_text("bench.esm", MISSION);
    checked.require_machine();
    if checked.has_errors() {
        return Err(checked.render(false).into());
    }
    let model = checked.model.ok_or("the front end gave no model")?;
    let starts = LaidOut {
        starts_us: STARTS_US.to_vec(),
        frame_starts_us: vec![vec![FRAME_US]],
    };
    let blob = compile::compile(&model, &starts)?;
    let folder = tempfile::tempdir()?;
    // What the board sends comes back.
    let listener = UnixListener::bind(folder.path().join(UART_SOCKET))?;
    let echo = thread::spawn(move || {
        let Ok((mut line, _)) = listener.accept() else {
            return;
        };
        let mut bytes = [0; 256];
        while let Ok(count @ 1..) = line.read(&mut bytes) {
            if line.write_all(&bytes[..count]).is_err() {
                return;
            }
        }
    });
    let more = ["-serial", &format!("unix:{UART_SOCKET}")];
    let (mut board, mut client) = Emulated::start_with(firmware, folder.path(), &more)?;
    client.upload(&blob, &mut |_| ())?;
    let deadline = Instant::now() + LIMIT;
    while board.runs()? {
        if Instant::now() > deadline {
            return Err("the firmware that measures links does not come to an end".into());
        }
        thread::sleep(Duration::from_millis(20));
    }
    let _ = echo.join();
    let console = board.printed()?;
    costs(&console).ok_or_else(|| format!("the firmware says:\n{console}").into())
}

/// What the firmware has printed: names, each with least, most, mean and count, in tenths. Bytes
/// arrive when they do, and may interrupt what is measured: the least is what it takes alone.
fn costs(console: &str) -> Option<LinkCosts> {
    let least = |name: &str| {
        let mut rows = console.lines().filter_map(|line| line.split_once(' '));
        let (_, numbers) = rows.find(|(of, _)| *of == name)?;
        let numbers: Vec<f64> = numbers.split(' ').map_while(|it| it.parse().ok()).collect();
        let [least, _, _, count] = numbers[..] else {
            return None;
        };
        (count > 0.0).then_some(least / 10.0)
    };
    let nothing = least("nothing")?;
    let coding = |name: &str| Some(least(name)? - nothing);
    Some(LinkCosts {
        transmit: least("transmit")?,
        transmit_none: least("transmit-none")?,
        receive: least("receive")?,
        receive_none: least("receive-none")?,
        task: least("probe")?,
        checksum: coding("crc")?,
        stuff: coding("stuff")?,
        unstuff: coding("unstuff")?,
        sent: least("send")?,
        byte: least("byte")?,
    })
}
