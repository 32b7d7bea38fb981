//! The host board: the firmware's runtime and tasks as a part of this process.
//!
//! Dispatcher, registry, interpreter, tasks, link: all the code that a firmware runs. What differs
//! is what a board gives: the timer is virtual and jumps from one slot to the next, the byte link
//! is a pipe or a [line](mod@crate::lockstep::line) in the same virtual time, the pins lead to the
//! plant by a call. Code takes no time here, so that nothing is ever late; a task in slot 0 ends
//! before the next slot, or where a recording says that it did.
//!
//! A user's own robot runs here too: `host_tools::cli::main_with`.

mod port;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::body::{Parts, PinImage};
use rt_firmware::rover::{Measures, PinRover};
use rt_firmware::store::flash_store::{self, FlashStore};
use rt_firmware::{AnyTaskPool, Limits, Mailbox, RegistryFault, RetainedRam, split};
use thiserror::Error;

use crate::lockstep::line::{self, BoardEnd, ClientEnd};
use crate::lockstep::plant_side::PlantSide;
use crate::serial::pipe::{self, PipeEnd};
pub use esm_toolkit::host_board::{BOARD, CAPACITIES};
use esm_toolkit::host_board::{HostLife, HostMemory, RecordedEnds, about, log_lines};
use esm_toolkit::recording::entered::Entered;
use port::{Line, Port};

/// The longest mission in bytes.
const BLOB_BYTES: u32 = CAPACITIES.blob_bytes;

/// Bytes of its flash, for missions, records and a script.
pub const FLASH_BYTES: u32 = flash_store::flash_bytes_with_script(BLOB_BYTES, ERASE_BYTES as u32);

/// The memory of a runtime lies on the stack of the board's thread.
const STACK_BYTES: usize = 32 * 1024 * 1024;

/// How long a board without anything to do waits for bytes.
const IDLE_WAIT: Duration = Duration::from_millis(2);

/// Makes a robot on the given pins and hands its banks to the runtime, which returns when the board
/// ends.
pub type RobotMaker = fn(Parts<'_>, &mut dyn FnMut(&mut [&mut (dyn AnyTaskPool + '_)]));

/// The robot that ships.
pub fn rover(parts: Parts<'_>, run: &mut dyn FnMut(&mut [&mut (dyn AnyTaskPool + '_)])) {
    run(&mut PinRover::new(parts.into(), &Measures::ROVER).banks());
}

/// Why there is no host board.
#[derive(Debug, Error)]
pub enum HostBoardError {
    /// Something is wrong with the declarations of the robot's tasks.
    #[error("the robot's registry is wrong: {0:?}")]
    Registry(RegistryFault),
    /// The system gives no thread.
    #[error("cannot start the host board: {0}")]
    Thread(#[from] std::io::Error),
    /// The board's thread has ended by itself.
    #[error("the host board stopped: one of the robot's tasks panicked (its message is above)")]
    Panicked,
}

/// A running host board. Dropping it ends it.
pub struct HostBoard {
    shared: Arc<Shared>,
    /// Where its link goes that way.
    line: Option<BoardEnd>,
    thread: Option<JoinHandle<()>>,
}

/// What the board's thread and its owner see of each other.
struct Shared {
    stop: AtomicBool,
    /// Robot time before which the board waits for a mission, in microseconds.
    gate_us: AtomicU64,
    waits_at_gate: AtomicBool,
    /// The gate opens when the link has a mission for the real-time side.
    opens_for_mission: AtomicBool,
    /// The gate behind this one.
    next_gate_us: AtomicU64,
    kept: RetainedRam,
}

const NO_GATE: u64 = u64::MAX;

impl HostBoard {
    /// Starts a board with the tasks of `robot`, and `plant` behind its pins. Answers the other end
    /// of its byte link. Runs of background tasks end where `replay` says, if it is given.
    ///
    /// # Errors
    /// [`HostBoardError`]
    pub fn start(
        robot: RobotMaker,
        plant: PlantSide,
        replay: Option<&Entered>,
    ) -> Result<(Self, PipeEnd), HostBoardError> {
        let (near, far) = pipe::pair();
        let board = Self::start_with(robot, plant, replay, Line::Pipe(near), None)?;
        Ok((board, far))
    }

    /// The same, with a link that shares the board's virtual time: a run repeats to the byte,
    /// whatever is asked of the robot.
    ///
    /// # Errors
    /// [`HostBoardError`]
    pub fn start_in_step(
        robot: RobotMaker,
        plant: PlantSide,
    ) -> Result<(Self, ClientEnd), HostBoardError> {
        let (near, far) = line::pair();
        let line = Line::Plant(near.clone());
        let board = Self::start_with(robot, plant, None, line, Some(near))?;
        Ok((board, far))
    }

    fn start_with(
        robot: RobotMaker,
        plant: PlantSide,
        replay: Option<&Entered>,
        near: Line,
        line: Option<BoardEnd>,
    ) -> Result<Self, HostBoardError> {
        log_lines::install();
        let shared = Arc::new(Shared {
            stop: AtomicBool::new(false),
            gate_us: AtomicU64::new(NO_GATE),
            waits_at_gate: AtomicBool::new(false),
            opens_for_mission: AtomicBool::new(false),
            next_gate_us: AtomicU64::new(NO_GATE),
            kept: RetainedRam::new(),
        });
        let ends = replay.map(RecordedEnds::of);
        let (ready, started) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("host board".into())
            .stack_size(STACK_BYTES)
            .spawn({
                let shared = Arc::clone(&shared);
                move || {
                    let pins = PinImage::new();
                    // The maker is bound to call this once, and may not.
                    let mut given = Some((plant, ends, near, ready));
                    robot(pins.parts(), &mut |banks| {
                        if let Some((plant, ends, near, ready)) = given.take() {
                            run(banks, &pins, plant, ends, near, &shared, &ready);
                        }
                    });
                }
            })?;
        let board = HostBoard {
            shared,
            line,
            thread: Some(thread),
        };
        match started.recv() {
            Ok(None) => Ok(board),
            Ok(Some(fault)) => Err(HostBoardError::Registry(fault)),
            Err(_) => Err(HostBoardError::Panicked),
        }
    }

    /// Looks whether the board still runs.
    ///
    /// # Errors
    /// [`HostBoardError::Panicked`]
    pub fn check(&self) -> Result<(), HostBoardError> {
        match &self.thread {
            Some(thread) if thread.is_finished() => Err(HostBoardError::Panicked),
            _ => Ok(()),
        }
    }

    /// Lets the board wait before `robot_us` for a mission, so that it takes over then, in each run
    /// the same.
    pub fn set_gate(&self, robot_us: Option<u64>) {
        self.shared
            .gate_us
            .store(robot_us.unwrap_or(NO_GATE), Relaxed);
    }

    /// Whether the board waits for a mission.
    pub fn waits_at_gate(&self) -> bool {
        self.shared.waits_at_gate.load(Relaxed)
    }

    /// Lets the board go on as soon as its link has a mission for it, up to the next gate.
    pub fn open_gate(&self, next_us: Option<u64>) {
        self.shared
            .next_gate_us
            .store(next_us.unwrap_or(NO_GATE), Relaxed);
        self.shared.opens_for_mission.store(true, Relaxed);
    }
}

impl Drop for HostBoard {
    fn drop(&mut self) {
        self.shared.stop.store(true, Relaxed);
        if let Some(line) = &self.line {
            // The board may wait for a client that waits for nothing any more.
            line.close();
        }
        if let Some(thread) = self.thread.take() {
            // Whether it panicked was asked before.
            let _ = thread.join();
        }
    }
}

/// The board's life: link, timer, background, in turn.
fn run(
    banks: &mut [&mut (dyn AnyTaskPool + '_)],
    pins: &PinImage,
    plant: PlantSide,
    ends: Option<RecordedEnds>,
    line: Line,
    shared: &Shared,
    ready: &mpsc::Sender<Option<RegistryFault>>,
) {
    let mut banks: Vec<&mut dyn AnyTaskPool> = banks
        .iter_mut()
        .map(|bank| &mut **bank as &mut dyn AnyTaskPool)
        .collect();
    let mut memory = HostMemory::new();
    let mut mailbox = Mailbox::new();
    let sides = split(
        &mut memory,
        &mut banks,
        &mut mailbox,
        about(&shared.kept),
        Limits::default(),
    );
    let sides = match sides {
        Ok(sides) => sides,
        Err(fault) => {
            // Nobody waits for it any more only where the process ends anyway.
            let _ = ready.send(Some(fault));
            return;
        }
    };
    let flash = plant.flash(FLASH_BYTES);
    let _ = ready.send(None);
    let mut records = [0; flash_store::RECORD_BYTES];
    // A flash of another size is none of this board.
    let keep = FlashStore::open(flash, BLOB_BYTES, None, &mut records).ok();
    let keep = keep.map(|keep| keep.over_resets(&shared.kept));
    let mut life = HostLife::new(sides, pins, plant, ends);
    let mut port = Port::new(line, keep, life.stop_listener(), &shared.stop);
    life.start(&mut port);
    while !shared.stop.load(Relaxed) {
        let gated = life.next_robot_us() >= shared.gate_us.load(Relaxed);
        shared.waits_at_gate.store(gated, Relaxed);
        let wait = match life.is_empty() || gated {
            true => IDLE_WAIT,
            false => Duration::ZERO,
        };
        if port.exchange(wait).is_err() {
            // Nobody can reach this board any more.
            return;
        }
        life.serve(&mut port);
        if !gated {
            life.pass(&mut port);
        } else if life.is_asked() {
            if shared.opens_for_mission.load(Relaxed) {
                shared.opens_for_mission.store(false, Relaxed);
                shared
                    .gate_us
                    .store(shared.next_gate_us.load(Relaxed), Relaxed);
                life.activate();
            } else {
                // Time stands still at a gate; questions are answered all the same.
                life.answer();
            }
        }
    }
}
