//! The emulated board: a QEMU process that runs the firmware, its serial line, and the pipes to the
//! plant.
//!
//! Everything of one run lives in a folder of its own under the system's temporary folder, and ends
//! with the [`Emulator`]: on drop, on Ctrl-C (a handler that makes the main loop return), and,
//! where `setpriv` is installed, even if this process is killed. What is left of the folder then
//! goes with the next run.

pub mod firmware;
pub mod folder;
pub mod pipes;

use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rt_firmware::body::frames::{ASK_BYTES, CarriedFrame, MESSAGE_BYTES};
use rt_firmware::body::{Reply, Request};
use thiserror::Error;

use esm_toolkit::boards;

use crate::flash::Flash;
use crate::lockstep::in_system::BoardSide;
use crate::lockstep::line::BoardEnd;
use crate::lockstep::plant_side::PlantSide;
use folder::RunFolder;
use pipes::PipeServer;

/// The emulator's command.
pub const QEMU: &str = "qemu-system-arm";

/// QEMU's name of the default board.
pub fn machine() -> &'static str {
    machine_of(firmware::BOARD).unwrap_or_default()
}

/// QEMU's name of a board; none where QEMU does not emulate it.
pub fn machine_of(board: &str) -> Option<&'static str> {
    firmware::about(boards::find(board).ok()?).machine()
}

/// What becomes of the virtual time in which the emulated processor sleeps. How much of it an
/// instruction takes is the board's to say, in the command that runs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Idle {
    /// It passes at once: two runs are equal to the tick. Where a run keeps to the wall clock, it
    /// does so while the firmware waits for the plant, and no UART is served meanwhile: answers
    /// come in bursts.
    Passes,
    /// It lasts as long as on the wall, and the UART is served as on a wire. The price is that a
    /// slot begins late where this machine wakes up late.
    Lasts,
}

impl Idle {
    /// What QEMU is told, `alone` where nothing but the firmware's semihosting goes into it or
    /// comes out of it.
    ///
    /// The thread that lets time pass for a processor that sleeps runs beside the processor's own.
    /// It sees the sleep before the last instructions are counted, and may let too much time pass
    /// then: a slot begins late by as many, and that in one run and not in the next. While QEMU
    /// records a run, neither thread looks while the other works. So it records, and nobody keeps
    /// it. Bytes of a UART would be recorded, too, and wait for moments at which they can be.
    fn instruction_counting(self, alone: bool) -> &'static str {
        match self {
            Idle::Passes if alone => "sleep=off,rr=record,rrfile=/dev/null",
            Idle::Passes => "sleep=off",
            Idle::Lasts => "sleep=on",
        }
    }
}

/// Name of the socket that is the board's UART0, in the run's folder.
const UART_SOCKET: &str = "uart0";

/// Name of the file that takes what the emulator prints.
const CONSOLE_FILE: &str = "console";

/// How long the emulator may take to connect its serial line.
const START_LIMIT: Duration = Duration::from_secs(60);

/// How long the firmware may leave bytes that were sent to it untouched.
const UART_WRITE_LIMIT: Duration = Duration::from_secs(30);

/// Lines of the emulator's own output that an error message repeats.
const CONSOLE_LINES_TOLD: usize = 8;

/// Why the emulated board does not run.
#[derive(Debug, Error)]
pub enum EmulatorError {
    /// The emulator is not installed.
    #[error(
        "the emulator `{QEMU}` is not installed; on Debian and Ubuntu: apt-get install qemu-system-arm (or let `cargo xtask demo` do it)"
    )]
    NotInstalled,
    /// The emulator of a chip is not set up.
    #[error(
        "the emulator of the board {board} is not set up: run `cargo xtask emulator --board {board}` in the checkout of esm, and esm inside it"
    )]
    NotSetUp {
        /// The board.
        board: &'static str,
    },
    /// The firmware's file is not there.
    #[error("there is no firmware at {}; build it with `cargo xtask firmware`", path.display())]
    NoFirmware {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// The emulator ended by itself.
    #[error("the emulator ended before its time ({status}){}", told(console))]
    Ended {
        /// How it ended.
        status: ExitStatus,
        /// The last that it printed.
        console: String,
    },
    /// The emulator did not connect its serial line.
    #[error("the emulator did not start within {} s{}", START_LIMIT.as_secs(), told(console))]
    NotStarted {
        /// The last that it printed.
        console: String,
    },
    /// A folder, pipe, socket or process could not be made.
    #[error("cannot {what}: {cause}")]
    System {
        /// What was tried.
        what: &'static str,
        /// What the system says.
        cause: io::Error,
    },
}

fn told(console: &str) -> String {
    if console.is_empty() {
        String::new()
    } else {
        format!("; it said:\n{console}")
    }
}

/// Which serial line of an emulated chip the link goes by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipSerial {
    /// Its UART 0.
    Uart,
    /// Its USB, as a CDC device.
    Usb,
}

impl ChipSerial {
    /// As the emulator's script takes it.
    fn name(self) -> &'static str {
        match self {
            ChipSerial::Uart => "uart",
            ChipSerial::Usb => "usb",
        }
    }
}

/// A running emulator. Dropping it ends the process and removes its folder.
///
/// To be started by a thread that outlives it: the system ends the emulator with the thread that
/// started it.
pub struct Emulator {
    process: Child,
    plant: PipeServer,
    flash: PipeServer,
    /// What the sonars of a chip's body answer.
    pulses: Option<PipeServer>,
    link: Option<(BoardEnd, PipeServer)>,
    /// Frames of missions, those that go out and those that come in.
    frames: Option<[PipeServer; 2]>,
    folder: RunFolder,
    uart: Option<UnixStream>,
}

impl Emulator {
    /// Starts the firmware at `firmware` on a board of QEMU, with `plant` behind its pins and
    /// `flash` beside it.
    ///
    /// # Errors
    /// [`EmulatorError`]: what is missing, and what to do.
    pub fn start(
        board: &'static boards::Board,
        firmware: &Path,
        idle: Idle,
        plant: impl FnMut(&Request) -> Reply + Send + 'static,
        flash: Flash,
    ) -> Result<Self, EmulatorError> {
        Self::start_linked(board, firmware, idle, plant, flash, (None, None))
    }

    /// The same, with the link on `line` instead of the UART, if there is one, and with frames of
    /// missions that `frames` takes and gives, if it is a board of one.
    ///
    /// # Errors
    /// [`EmulatorError`]: what is missing, and what to do.
    pub fn start_linked(
        board: &'static boards::Board,
        firmware: &Path,
        idle: Idle,
        plant: impl FnMut(&Request) -> Reply + Send + 'static,
        flash: Flash,
        (line, frames): (Option<BoardEnd>, Option<Arc<BoardSide>>),
    ) -> Result<Self, EmulatorError> {
        let system = |what| move |cause| EmulatorError::System { what, cause };
        let firmware = firmware
            .canonicalize()
            .map_err(|_| EmulatorError::NoFirmware {
                path: firmware.to_owned(),
            })?;
        let folder = RunFolder::new().map_err(system("make a folder for the run"))?;
        // The firmware takes the ways by which its link and frames go from whether these are there.
        let mut pairs = vec![pipes::PINS, pipes::FLASH];
        pairs.extend(line.as_ref().map(|_| pipes::LINK));
        if frames.is_some() {
            pairs.extend([pipes::FRAMES_OUT, pipes::FRAMES_IN]);
        }
        pipes::make(folder.path(), &pairs).map_err(system("make the pipes to the plant"))?;
        let listener = UnixListener::bind(folder.path().join(UART_SOCKET))
            .map_err(system("make the socket of the serial line"))?;
        let plant = PipeServer::start(folder.path(), plant)
            .map_err(system("open the pipes to the plant"))?;
        let flash =
            serve_flash(folder.path(), flash).map_err(system("open the pipes to the flash"))?;
        let link = line
            .map(|line| Ok((line.clone(), serve_link(folder.path(), line)?)))
            .transpose()
            .map_err(system("open the pipes of the link"))?;
        let frames = frames
            .map(|system| serve_frames(folder.path(), &system))
            .transpose()
            .map_err(system("open the pipes of frames"))?;
        let counting = idle.instruction_counting(link.is_some());
        let machine = command(firmware::about(board).runner, &firmware, counting);
        let process = spawn(machine, folder.path())?;
        let mut emulator = Emulator {
            link,
            process,
            plant,
            flash,
            pulses: None,
            frames,
            folder,
            uart: None,
        };
        emulator.uart = Some(emulator.accept_uart(&listener)?);
        Ok(emulator)
    }

    /// Starts the firmware at `firmware` in the emulator of a chip, with the body of `plant` at its
    /// pins, `flash` for the cells in which it keeps missions, and one of its serial lines at
    /// `line`.
    ///
    /// # Errors
    /// [`EmulatorError`]: what is missing, and what to do.
    pub fn start_chip(
        board: &'static boards::Board,
        firmware: &Path,
        plant: PlantSide,
        flash: Flash,
        (serial, line): (ChipSerial, BoardEnd),
    ) -> Result<Self, EmulatorError> {
        let system = |what| move |cause| EmulatorError::System { what, cause };
        let path = firmware.to_owned();
        let firmware = firmware
            .canonicalize()
            .map_err(|_| EmulatorError::NoFirmware { path })?;
        let not_set_up = || EmulatorError::NotSetUp { board: board.name };
        let here = std::env::current_dir().map_err(system("find the working directory"))?;
        let checkout = firmware::checkout_around(&here)
            .or_else(|| firmware::checkout_around(&firmware))
            .ok_or_else(not_set_up)?;
        let python = checkout.join(format!("target/emulators/{}/bin/python", board.name));
        let script = firmware::about(board).script().ok_or_else(not_set_up)?;
        if !python.is_file() {
            return Err(not_set_up());
        }
        let folder = RunFolder::new().map_err(system("make a folder for the run"))?;
        let pairs = [pipes::PINS, pipes::PULSES, pipes::FLASH, pipes::LINK];
        pipes::make(folder.path(), &pairs).map_err(system("make the pipes to the plant"))?;
        let body = plant.clone();
        let pins = PipeServer::start(folder.path(), move |request| body.exchange(request))
            .map_err(system("open the pipes to the plant"))?;
        let pulses =
            PipeServer::start_pair(folder.path(), pipes::PULSES, move |requests, replies| {
                pipes::tell_pulses(requests, replies, || plant.pulses())
            })
            .map_err(system("open the pipes to the sonars"))?;
        let flash =
            serve_flash(folder.path(), flash).map_err(system("open the pipes to the flash"))?;
        let link = serve_link(folder.path(), line.clone())
            .map_err(system("open the pipes of the link"))?;
        let mut chip = Command::new(python);
        chip.arg(checkout.join("boards").join(board.name).join(script))
            .arg(&firmware)
            .arg(serial.name());
        let process = spawn(chip, folder.path())?;
        Ok(Emulator {
            link: Some((line, link)),
            process,
            plant: pins,
            flash,
            pulses: Some(pulses),
            frames: None,
            folder,
            uart: None,
        })
    }

    /// The board's UART0; `None` after the first call.
    pub fn take_uart(&mut self) -> Option<UnixStream> {
        self.uart.take()
    }

    /// Looks whether the emulator still runs.
    ///
    /// # Errors
    /// [`EmulatorError::Ended`] with what it said last.
    pub fn check_alive(&mut self) -> Result<(), EmulatorError> {
        match self.process.try_wait() {
            Ok(None) => Ok(()),
            Ok(Some(status)) => Err(EmulatorError::Ended {
                status,
                console: self.console(),
            }),
            Err(cause) => Err(EmulatorError::System {
                what: "ask for the emulator's state",
                cause,
            }),
        }
    }

    /// The last lines that the emulator and the firmware's semihosting printed.
    pub fn console(&self) -> String {
        let text = std::fs::read(self.folder.path().join(CONSOLE_FILE)).unwrap_or_default();
        let text = String::from_utf8_lossy(&text);
        let lines: Vec<&str> = text.lines().collect();
        lines[lines.len().saturating_sub(CONSOLE_LINES_TOLD)..].join("\n")
    }

    /// The process's id, for tests that look whether it has ended.
    pub fn process_id(&self) -> u32 {
        self.process.id()
    }

    fn accept_uart(&mut self, listener: &UnixListener) -> Result<UnixStream, EmulatorError> {
        let system = |cause| EmulatorError::System {
            what: "connect the serial line",
            cause,
        };
        listener.set_nonblocking(true).map_err(system)?;
        let deadline = Instant::now() + START_LIMIT;
        loop {
            match listener.accept() {
                Ok((uart, _)) => {
                    uart.set_nonblocking(false).map_err(system)?;
                    // A firmware that reads no bytes must not keep anybody waiting for ever.
                    uart.set_write_timeout(Some(UART_WRITE_LIMIT))
                        .map_err(system)?;
                    return Ok(uart);
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    self.check_alive()?;
                    if Instant::now() > deadline {
                        return Err(EmulatorError::NotStarted {
                            console: self.console(),
                        });
                    }
                    std::thread::sleep(Duration::from_millis(2));
                }
                Err(error) => return Err(system(error)),
            }
        }
    }
}

impl Drop for Emulator {
    fn drop(&mut self) {
        // Killed, not asked: while the firmware waits in a pipe, QEMU listens to nobody.
        let _ = self.process.kill();
        let _ = self.process.wait();
        if let Some((line, server)) = &mut self.link {
            // Its thread may wait for a client that waits for nothing any more.
            line.close();
            server.stop();
        }
        self.plant.stop();
        self.flash.stop();
        if let Some(pulses) = &mut self.pulses {
            pulses.stop();
        }
        for frames in self.frames.iter_mut().flatten() {
            frames.stop();
        }
    }
}

/// The command of a board's `runner`, with another word on the time in which the processor sleeps.
fn command(runner: &str, firmware: &Path, counting: &str) -> Command {
    let mut words = runner.split_whitespace();
    let mut command = Command::new(words.next().unwrap_or_default());
    while let Some(word) = words.next() {
        match word {
            "{firmware}" => command.arg(firmware),
            "-icount" => {
                // `shift=…`, which is what an instruction takes, and what is said of sleep there.
                let shift = words.next().unwrap_or_default();
                let shift = shift.split(',').next().unwrap_or_default();
                command.args([word, &format!("{shift},{counting}")])
            }
            word => command.arg(word.replace("{serial}", UART_SOCKET)),
        };
    }
    command
}

/// Serves the pipes of the flash.
fn serve_flash(folder: &Path, flash: Flash) -> io::Result<PipeServer> {
    PipeServer::start_pair(folder, pipes::FLASH, move |requests, replies| {
        flash.serve(requests, replies)
    })
}

/// Serves the pipes of the link, whose other end is that of `line`.
fn serve_link(folder: &Path, line: BoardEnd) -> io::Result<PipeServer> {
    PipeServer::start_pair(folder, pipes::LINK, move |requests, replies| {
        let ended = pipes::swap_link(requests, replies, &line);
        line.close();
        ended
    })
}

/// Serves the pipes of frames, as a board of a system.
fn serve_frames(folder: &Path, system: &Arc<BoardSide>) -> io::Result<[PipeServer; 2]> {
    let (takes, gives) = (Arc::clone(system), Arc::clone(system));
    Ok([
        PipeServer::start_pair(folder, pipes::FRAMES_OUT, move |requests, replies| {
            pipes::answer_all(requests, replies, |message: &[u8; MESSAGE_BYTES]| {
                takes.start(CarriedFrame::from_bytes(*message));
                [0]
            })
        })?,
        PipeServer::start_pair(folder, pipes::FRAMES_IN, move |requests, replies| {
            pipes::answer_all(requests, replies, |message: &[u8; ASK_BYTES]| {
                *gives.arrived(u64::from_le_bytes(*message)).as_bytes()
            })
        })?,
    ])
}

/// Starts an emulator in the folder of its run.
fn spawn(emulator: Command, folder: &Path) -> Result<Child, EmulatorError> {
    let system = |cause| EmulatorError::System {
        what: "start the emulator",
        cause,
    };
    let console = File::create(folder.join(CONSOLE_FILE)).map_err(system)?;
    let start = |mut command: Command| -> io::Result<Child> {
        command
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(console.try_clone()?)
            .stderr(console.try_clone()?)
            // Ctrl-C is for this process, which then ends the emulator in order.
            .process_group(0)
            .spawn()
    };
    let program = emulator.get_program().to_owned();
    let process = if is_installed("setpriv") && is_installed(&program) {
        // `setpriv` (util-linux) has the system kill the emulator should this process be killed
        // itself.
        let mut guarded = Command::new("setpriv");
        guarded.args(["--pdeathsig", "KILL"]).arg(&program);
        guarded.args(emulator.get_args());
        start(guarded)
    } else {
        start(emulator)
    };
    process.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => EmulatorError::NotInstalled,
        _ => system(error),
    })
}

/// Whether `program` is found on the search path.
fn is_installed(program: impl AsRef<OsStr>) -> bool {
    let program = program.as_ref();
    std::env::var_os("PATH").is_some_and(|path| {
        std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_says_what_an_instruction_takes_and_the_run_says_what_becomes_of_sleep() {
        let runner = "qemu -machine m -icount shift=4,sleep=off -chardev socket,path={serial} \
                      -kernel {firmware}";
        for (idle, alone, expected) in [
            (Idle::Lasts, false, "shift=4,sleep=on"),
            (Idle::Passes, false, "shift=4,sleep=off"),
            (
                Idle::Passes,
                true,
                "shift=4,sleep=off,rr=record,rrfile=/dev/null",
            ),
        ] {
            let counting = idle.instruction_counting(alone);
            let command = command(runner, Path::new("a robot.elf"), counting);
            let words: Vec<&OsStr> = command.get_args().collect();
            let serial = format!("socket,path={UART_SOCKET}");
            let all = [
                "-machine",
                "m",
                "-icount",
                expected,
                "-chardev",
                &serial,
                "-kernel",
                "a robot.elf",
            ];
            assert_eq!(command.get_program(), "qemu");
            assert_eq!(words, all);
        }
    }
}
