//! What the runtime takes on a core, whatever chip is around it: `cargo xtask bench costs` builds
//! and runs this program for each core, in the emulator, and reads what it tells.
//!
//! The runtime is that of the boards, with the settings of their firmwares. Its clock is a number
//! that is set to when the runtime wants to be called next; what is counted are the instructions of
//! that call, which on a board the slot timer's handler makes. Nothing else runs meanwhile.
//!
//! The emulator's folder has two files: `cd51.blob`, whose macro steps are measured, and
//! `mission.blob`, whose slots are. Each line that is told is a name, ticks, and how many were
//! measured; `thousand` are the ticks of a thousand instructions.
#![no_std]
#![no_main]

use core::fmt::Write;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use cortex_m_board::stack;
use cortex_m_rt::{entry, exception};
use esm_link::message::SafeReason;
use rt_firmware::{
    About, ActivationStart, AnyTaskPool, Board, Io, Limits, Mailbox, Memory, Step, Task, TaskPool,
    registry, split, task,
};
use semihosting::process::exit;

mod file;
mod one_mission;
mod stopwatch;

/// What all measurements of macro steps have for a clock.
mod chip {
    pub(crate) mod cortex_m_board {
        pub(crate) use crate::stopwatch as sys_tick;
    }
}
#[path = "../../cortex_m/measured/steps.rs"]
mod steps;

use file::Console;
use one_mission::{OneMission, Port};

/// Room for a mission, in bytes.
const BLOB_BYTES: usize = 1_536;
/// Room for the player's, in bytes.
const PLAYER_BYTES: usize = 1_024;
/// Slots of the mission that have a task, enabled or not; there is one more for the interpreter.
const TASKS: usize = 7;
/// Slots in all.
const SLOTS: usize = TASKS + 1;
/// Periods that pass before anything is measured: the mission starts in the first.
const PERIODS_BEFORE: u32 = 4;
/// Periods that are measured.
const PERIODS: u32 = 32;
/// Calls after which a runtime without a mission is given up.
const MOST_CALLS: u32 = 10_000;

/// Exit status where there is no mission that may run.
const NO_MISSION: i32 = 2;
/// Exit status where the player's machine does not do what its chart says.
const WRONG_STEPS: i32 = 3;
/// Exit status of a panic and of a fault.
const DEFECT: i32 = 4;

/// How often the task was executed.
static EXECUTED: AtomicU32 = AtomicU32::new(0);

/// Counts how often it is executed.
struct Probe;

task! {
    impl Probe {
        slot 2;
    }
}

impl Task for Probe {
    fn step(&mut self, _: &mut Io<'_>) -> Step {
        EXECUTED.store(EXECUTED.load(Relaxed).wrapping_add(1), Relaxed);
        Step::Run
    }
}

registry! {
    /// What is measured.
    struct Costs {
        probe: Probe[TASKS],
    }
}

/// What an activation was that has just ended.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Activated {
    Nothing,
    Interpreter,
    Tasks,
}

/// A clock that is set, and nothing that moves.
struct Clock {
    now_us: u64,
    activated: Activated,
}

impl Board for Clock {
    const TICKS_PER_US: u32 = 1;

    fn now_ticks(&mut self) -> u64 {
        self.now_us
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        self.now_us as u32
    }

    #[inline(always)]
    fn begin_activation(&mut self, start: &ActivationStart) -> Result<(), SafeReason> {
        self.activated = match start.interpreter {
            true => Activated::Interpreter,
            false => Activated::Tasks,
        };
        Ok(())
    }

    fn motors_off(&mut self) {}
}

/// Ticks of so many occasions.
#[derive(Default)]
struct Sum {
    ticks: u32,
    count: u32,
}

impl Sum {
    fn note(&mut self, ticks: u32) {
        self.ticks = self.ticks.wrapping_add(ticks);
        self.count += 1;
    }

    fn tell(&self, name: &str) {
        let _ = writeln!(Console, "{name} {} {}", self.ticks, self.count);
    }
}

/// Measures macro steps of the CD player, if its mission is there.
#[inline(never)]
fn macro_steps() {
    let mut blob = [0; PLAYER_BYTES];
    let len = file::read(c"cd51.blob", &mut blob);
    let Some(blob) = blob.get(..len).filter(|blob| !blob.is_empty()) else {
        return;
    };
    let (mut step, mut pulse) = (Sum::default(), Sum::default());
    let mut note = |is_step, ticks| match is_step {
        true => step.note(ticks),
        false => pulse.note(ticks),
    };
    if steps::measure(blob, &mut note).is_none() {
        exit(WRONG_STEPS);
    }
    step.tell("macro-step");
    pulse.tell("idle-pulse");
}

#[entry]
fn main() -> ! {
    static mut ROBOT: MaybeUninit<Costs> = MaybeUninit::uninit();
    static mut BANKS: MaybeUninit<[&'static mut (dyn AnyTaskPool + 'static); Costs::POOLS]> =
        MaybeUninit::uninit();
    static mut MEMORY: Memory<'static, BLOB_BYTES, 32, SLOTS, TASKS, 1, 1, 64> = Memory::new();
    static mut MAILBOX: Mailbox<'static> = Mailbox::new();
    stack::paint();
    stopwatch::start();
    let _ = writeln!(Console, "thousand {} 1", stopwatch::of_thousand());
    macro_steps();
    let robot = ROBOT.write(Costs {
        probe: TaskPool::new([const { Probe }; TASKS]),
    });
    let banks = BANKS.write(robot.banks());
    let about = About::new("costs", "costs");
    let Ok((mut real_time, mut background, mut link)) =
        split(MEMORY, banks, MAILBOX, about, Limits::default())
    else {
        exit(DEFECT)
    };
    let mut port = Port {
        now_us: 0,
        mission: OneMission,
    };
    link.start(&mut port);
    let mut board = Clock {
        now_us: 0,
        activated: Activated::Nothing,
    };
    let (mut interpreter, mut slots) = (Sum::default(), Sum::default());
    let (mut periods, mut calls) = (0, 0);
    let (none, ()) = stopwatch::ticks(|| ());
    while periods < PERIODS_BEFORE + PERIODS {
        calls += 1;
        if calls > MOST_CALLS {
            exit(NO_MISSION);
        }
        board.activated = Activated::Nothing;
        let (ticks, next_us) = stopwatch::ticks(|| real_time.on_timer(&mut board));
        let ticks = ticks.wrapping_sub(none);
        if board.activated == Activated::Interpreter {
            periods += 1;
        }
        if periods > PERIODS_BEFORE {
            match board.activated {
                Activated::Nothing => {}
                Activated::Interpreter => interpreter.note(ticks),
                Activated::Tasks => slots.note(ticks),
            }
        }
        background.poll();
        port.now_us = next_us;
        link.poll(&mut port);
        board.now_us = next_us;
    }
    interpreter.tell("interpreter");
    slots.tell("slot");
    let _ = writeln!(Console, "executed {} 1", EXECUTED.load(Relaxed));
    let _ = writeln!(Console, "stack {} 1", stack::deepest_bytes());
    exit(0)
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    exit(DEFECT)
}

// SAFETY: the handler neither returns nor trusts the state that it interrupted.
#[exception]
unsafe fn HardFault(_: &cortex_m_rt::ExceptionFrame) -> ! {
    exit(DEFECT)
}
