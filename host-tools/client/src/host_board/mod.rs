//! The host board: the firmware's runtime and tasks as a part of this process.
//!
//! Dispatcher, registry, interpreter, tasks, link: all the code that a firmware runs. What differs
//! is what a board gives: the timer is virtual and jumps from one slot to the next, the byte link
//! is a pipe or a [line](mod@crate::lockstep::line) in the same virtual time, the pins lead to the
//! plant by a call. Code takes no time here, so that nothing is ever late; a task in slot 0 ends
//! before the next slot, or where a recording says that it did.
//!
//! A user's own robot runs here too: `host_tools::cli::main_with`.

mod body;
mod log_lines;
mod port;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use esm_link::message::{Capacities, Mode};
use rt_firmware::body::flash::ERASE_BYTES;
use rt_firmware::body::{Parts, PinImage};
use rt_firmware::rover::{Measures, PinRover};
use rt_firmware::store::flash_store::{self, FlashStore};
use rt_firmware::{About, AnyTaskPool, Limits, Mailbox, Memory, RegistryFault, RetainedRam, split};
use thiserror::Error;

use crate::lockstep::line::{self, BoardEnd, ClientEnd};
use crate::lockstep::plant_side::PlantSide;
use crate::serial::pipe::{self, PipeEnd};
use body::{Body, RecordedEnds};
use esm_toolkit::boards;
use esm_toolkit::recording::entered::Entered;
use port::{Line, Port};

/// The board's name, as `--board` takes it and as it calls itself.
pub const BOARD: &str = boards::HOST.name;

/// What a mission may use here.
pub const CAPACITIES: Capacities = boards::HOST.capacities;

/// The same, as sizes of memory.
const BLOB_BYTES: usize = CAPACITIES.blob_bytes as usize;
const ARENA_WORDS: usize = CAPACITIES.arena_words as usize;
const SLOTS: usize = CAPACITIES.slots as usize;
const TASKS: usize = CAPACITIES.task_instances as usize;
const NETS: usize = CAPACITIES.nets as usize;
const GROUPS: usize = CAPACITIES.exclusive_groups as usize;

/// Bytes of its flash, for missions and records.
pub const FLASH_BYTES: u32 = flash_store::flash_bytes(BLOB_BYTES as u32, ERASE_BYTES as u32);

/// Room for the trace of many macro steps, should the reader be slow.
const TRACE_BYTES: usize = 256 * 1024;

/// The memory above lies on the stack of the board's thread.
const STACK_BYTES: usize = 32 * 1024 * 1024;

/// How long a board without anything to do waits for bytes.
const IDLE_WAIT: Duration = Duration::from_millis(2);

/// Steps of background tasks between two slots. One that needs more goes on after the slot, as on a
/// real board.
const BACKGROUND_STEPS: u32 = 10_000;

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
    let mut memory =
        Memory::<BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, TRACE_BYTES>::new();
    let mut mailbox = Mailbox::new();
    let about = About {
        reset: shared.kept.begin(None),
        kept: Some(&shared.kept),
        ..About::new(concat!("esm ", env!("CARGO_PKG_VERSION")), BOARD)
    };
    let sides = split(
        &mut memory,
        &mut banks,
        &mut mailbox,
        about,
        Limits::default(),
    );
    let (mut real_time, background, mut link) = match sides {
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
    let keep = FlashStore::open(flash, BLOB_BYTES as u32, None, &mut records).ok();
    let keep = keep.map(|keep| keep.over_resets(&shared.kept));
    let mut port = Port::new(line, keep, link.stop_listener(), &shared.stop);
    link.start(&mut port);
    let mut body = Body::new(pins, plant, background, ends);
    let mut due_us = 0;
    while !shared.stop.load(Relaxed) {
        let idle = real_time.mode() == Mode::Empty;
        let gated = body.robot_us_at(due_us) >= shared.gate_us.load(Relaxed);
        shared.waits_at_gate.store(gated, Relaxed);
        if port
            .exchange(if idle || gated {
                IDLE_WAIT
            } else {
                Duration::ZERO
            })
            .is_err()
        {
            // Nobody can reach this board any more.
            return;
        }
        if port.has_heard_stop() {
            // As on a real board, ahead of whatever the link is at.
            due_us = real_time.on_timer(&mut body);
        }
        port.set_clock(body.now_us());
        while link.poll(&mut port) && port.has_room() {}
        if gated {
            if shared.opens_for_mission.load(Relaxed) && link.is_waiting() {
                shared.opens_for_mission.store(false, Relaxed);
                shared
                    .gate_us
                    .store(shared.next_gate_us.load(Relaxed), Relaxed);
                // Before the time of the gate: what is asked for at a macro step's time waits for
                // the next.
                due_us = real_time.on_timer(&mut body);
            } else if link.is_waiting() {
                // Time stands still at a gate; questions are answered all the same.
                real_time.on_timer(&mut body);
            }
            continue;
        }
        // As on a real board, the slots come first.
        if let Some(swap_us) = port.swaps_at_us().filter(|swap_us| *swap_us < due_us) {
            body.pass_time_to(swap_us);
            port.swap(swap_us);
            continue;
        }
        body.pass_time_to(due_us);
        due_us = real_time.on_timer(&mut body);
        body.run_background(BACKGROUND_STEPS);
    }
}
