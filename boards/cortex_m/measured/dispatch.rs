//! A robot that measures how its slots are started: `cargo xtask bench dispatch` builds, runs and
//! reads it.
//!
//! Everything between the timer and the tasks is the firmware's own; only the exchange with a plant
//! is left out, which an emulated board has and a real one has not. The mission has one slot for
//! the interpreter; of the others, each third has an enabled task, which is a [`Probe`], a [`Two`]
//! or a [`Four`] in turn. In slot 0 runs either [`Spin`], which calls nothing, or [`Call`], which
//! goes through the framework all the time.
//!
//! The crate has the board as `chip`, and in `own` what each chip has in its own way. An
//! instruction takes 2^8 ns (`-icount shift=8`) and a tick of the clock less, so what is counted is
//! exact to an instruction. First the link sleeps and whole handlers are measured, by what they
//! take from [`Spin`]; then it works, and the beginnings of tasks are measured.

use core::array;
use core::ffi::CStr;
use core::fmt::Write;
use core::hint::black_box;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};

use esm_core::verify;
use rt_firmware::body::{Parts, StopPin};
use rt_firmware::supervision::LINK_BOUND_US;
use rt_firmware::{Io, Memory, PortType, Step, Task, TaskPool, WithStopButton, registry, task};
use semihosting::fd::AsFd;
use semihosting::sys::arm_compat::{OpenMode, sys_open, sys_read_orig};

use crate::chip::clock::TICKS_PER_US;
use crate::chip::cortex_m_board::console::Console;
use crate::chip::cortex_m_board::sys_tick::{self, now_ticks};
use crate::chip::{self, PINS, cortex_m, settings};
use crate::own;
use cortex_m::peripheral::NVIC;

#[path = "board.rs"]
mod board;
#[path = "interruptions.rs"]
mod interruptions;
#[path = "origin.rs"]
mod origin;
#[path = "range.rs"]
mod range;
#[path = "steps.rs"]
mod steps;

use board::BenchBoard;
use origin::ORIGIN;
use range::{Range, ticks_of};

/// Slots that a mission may have, the interpreter's included: as many as the largest that is
/// measured has.
const SLOTS: usize = 64;
/// Tasks with two data ports, and tasks with four.
const PORTED: usize = 8;
/// Room for their mission.
const BLOB_BYTES: usize = 8_640;

/// Nets of tasks with ports, and one more.
const NETS: usize = 4 * PORTED;

/// Time for the interpreter in each period, in microseconds; as the host has it.
const INTERPRETER_US: u32 = 30_000;
/// From one slot to the next, in microseconds; as the host has it.
const DISTANCE_US: u32 = 4_000;

/// Until then the host gets its answer that the mission runs, in microseconds of the mission.
const BEGIN_US: u32 = 200_000;
/// Until then the link, which sleeps from [`BEGIN_US`] on, is done with: what it asked for last is
/// answered by a slot, at the latest in the interpreter's next one.
const SETTLED_US: u32 = 1_200_000;
/// Until then whole handlers are measured. The link sleeps for less than [`LINK_BOUND_US`].
const QUIET_US: u32 = 4_000_000;
const _: () = assert!(QUIET_US - BEGIN_US < LINK_BOUND_US);
/// Until then beginnings of tasks are measured.
const END_US: u32 = 12_000_000;

/// Missions whose check is measured: what they are called, and their files in the emulator's
/// folder.
const CHECKED: [(&str, &CStr); 3] = [
    ("verify-1", c"slots-1.blob"),
    ("verify-64", c"slots-64.blob"),
    ("verify-64-worst", c"slots-64-worst.blob"),
];

/// Period of all slots, in microseconds; 0 as long as no task was executed.
static PERIOD_US: AtomicU32 = AtomicU32::new(0);
/// What the last task in a slot itself took, in ticks.
static OWN: AtomicU32 = AtomicU32::new(0);
/// Whether the link works.
static LOUD: AtomicBool = AtomicBool::new(false);
/// From a slot's nominal start to its task's first instruction.
static START: Range = Range::new();
/// What the handler of a slot without an enabled task takes from the task that is interrupted,
/// where nothing is enabled in the next slot either.
static WHOLE: Range = Range::new();
/// The same where the next slot has an enabled task: of each of [`KINDS`].
static BEFORE: [Range; KINDS.len()] = [const { Range::new() }; KINDS.len()];
/// The same of the slot itself, without what the task itself takes.
static WITH: [Range; KINDS.len()] = [const { Range::new() }; KINDS.len()];

/// Data ports of the tasks in slots, in the order in which slots have them.
const KINDS: [u32; 3] = [0, 2, 4];
/// Slots from one with an enabled task to the next.
const DISTANCE_OF_TASKS: u32 = 3;
/// Slots besides the interpreter's that have tasks at all, enabled or not; a multiple of
/// [`DISTANCE_OF_TASKS`].
const SLOTS_WITH_TASKS: u32 = 60;

/// Executes what a task does, and notes what it took and, where that is wanted, when it began. It
/// looks at the clock first of all.
#[inline(always)]
fn measured(io: &mut Io<'_>, noted: bool, work: impl FnOnce(&mut Io<'_>)) -> Step {
    let count = sys_tick::current();
    if noted && LOUD.load(Relaxed) {
        // SysTick counts down, and has done so since the clock's ticks were 0.
        let now = sys_tick::MAX.wrapping_sub(count);
        let since_ticks = (io.now_us() as u32).wrapping_mul(TICKS_PER_US);
        let nominal = ORIGIN.load(Relaxed).wrapping_add(since_ticks);
        START.note(now.wrapping_sub(nominal) & sys_tick::MAX);
    }
    work(io);
    PERIOD_US.store(io.period_us(), Relaxed);
    let after = sys_tick::current();
    OWN.store(count.wrapping_sub(after) & sys_tick::MAX, Relaxed);
    Step::Run
}

/// Does nothing.
struct Probe;

task! {
    impl Probe {
        slot 2;
    }
}

impl Task for Probe {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        measured(io, true, |_| ())
    }
}

/// Reads a value and writes one.
struct Two;

task! {
    impl Two {
        slot 2;
        data {
            in from: Number optional;
            out to: Number;
        }
        flags {
            in go;
        }
        params {
            gain: u32 = 1;
        }
    }
}

impl Task for Two {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        measured(io, false, |io| {
            let from = io.try_read(Self::FROM).map_or(0, |from| from.0);
            let sum = from.wrapping_add(io.param(Self::GAIN));
            *io.write(Self::TO) = Number(sum + u32::from(io.flag(Self::GO)));
        })
    }
}

/// Reads two values and writes two.
struct Four;

task! {
    impl Four {
        slot 2;
        data {
            in first: Number optional;
            in second: Number optional;
            out to: Number;
            out also: Number;
        }
        flags {
            in go;
            out odd;
        }
        params {
            gain: u32 = 1;
            offset: u32 = 1;
        }
    }
}

impl Task for Four {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        measured(io, false, |io| {
            let first = io.try_read(Self::FIRST).map_or(0, |first| first.0);
            let second = io.try_read(Self::SECOND).map_or(0, |second| second.0);
            *io.write(Self::TO) = Number(first.wrapping_add(io.param(Self::GAIN)));
            *io.write(Self::ALSO) = Number(second.wrapping_add(io.param(Self::OFFSET)));
            io.set(Self::ODD, !first.is_multiple_of(2) && io.flag(Self::GO));
        })
    }
}

/// Where it belongs what a handler took that has just ended. Found by the time, so that a handler
/// does nothing for it.
fn range_of_handler() -> Option<&'static Range> {
    let since_ticks = (now_ticks() as u32).wrapping_sub(ORIGIN.load(Relaxed));
    let phase_us = (since_ticks / TICKS_PER_US).checked_rem(PERIOD_US.load(Relaxed))?;
    // Until the interpreter's time is over, the timer only looks whether there is something to do.
    // The slot before it makes nothing ready.
    let slot = phase_us.checked_sub(INTERPRETER_US)? / DISTANCE_US;
    let last = (PERIOD_US.load(Relaxed) - INTERPRETER_US) / DISTANCE_US - 1;
    let slot = slot.checked_sub(1).filter(|_| slot < last)?;
    if slot >= SLOTS_WITH_TASKS {
        return Some(&WHOLE);
    }
    let kind = (slot / DISTANCE_OF_TASKS) as usize % KINDS.len();
    match slot % DISTANCE_OF_TASKS {
        0 => Some(&WHOLE),
        1 => BEFORE.get(kind),
        _ => WITH.get(kind),
    }
}

/// What a measurement does next.
#[derive(PartialEq)]
enum Phase {
    /// Nothing is counted yet.
    Begin,
    /// Nothing is counted still, but the link sleeps.
    Settle,
    /// Whole handlers are measured.
    Quiet,
    /// Beginnings of tasks are measured.
    Loud,
}

/// Where the measurement is. At its end it tells what it found, and ends the emulator.
fn phase() -> Phase {
    let since_ticks = (now_ticks() as u32).wrapping_sub(ORIGIN.load(Relaxed));
    match since_ticks / TICKS_PER_US {
        ..BEGIN_US => Phase::Begin,
        since_us @ BEGIN_US..QUIET_US => {
            // The link would take its part of the time. It is late then, which it is made for.
            own::LINK.into_iter().for_each(NVIC::mask);
            if since_us < SETTLED_US {
                Phase::Settle
            } else {
                Phase::Quiet
            }
        }
        QUIET_US..END_US => {
            LOUD.store(true, Relaxed);
            // SAFETY: no critical section of this firmware rests on these two being masked.
            unsafe {
                own::LINK.into_iter().for_each(|it| NVIC::unmask(it));
            }
            Phase::Loud
        }
        _ => {
            START.print("start");
            WHOLE.print("whole");
            for (ranges, when) in [(&BEFORE, "before"), (&WITH, "with")] {
                for (range, ports) in ranges.iter().zip(KINDS) {
                    let _ = write!(Console, "{when}-");
                    range.print(["0", "2", "4"][ports as usize / 2]);
                }
            }
            // Nobody feeds the watchdog from here on.
            cortex_m::interrupt::disable();
            own::begin_checks();
            for (name, file) in CHECKED {
                measure_check(name, file);
            }
            measure_steps();
            semihosting::process::exit(0);
        }
    }
}

/// Measures the check of the blob in a file, if there is one. Interrupts are masked.
///
/// A check may last for longer than a round of SysTick, which has 24 bits: the chip has another
/// stopwatch.
fn measure_check(name: &str, file: &CStr) {
    let mut blob = [0; 2048];
    let Ok(opened) = sys_open(file, OpenMode::RDONLY_BINARY) else {
        return;
    };
    let Ok(left) = sys_read_orig(opened.as_fd(), &mut blob) else {
        return;
    };
    let blob = blob.get(..blob.len() - left).unwrap_or_default();
    let mut passes = false;
    let ticks = own::ticks_of(|| passes = verify(black_box(blob)).is_ok());
    if passes {
        let range = Range::new();
        range.note(ticks);
        range.print(name);
    } else {
        let _ = writeln!(Console, "{name} does not pass");
    }
}

/// Measures macro steps of the CD player, if its mission is in a file. Interrupts are masked.
fn measure_steps() {
    let mut blob = [0; 2048];
    let Ok(opened) = sys_open(c"cd51.blob", OpenMode::RDONLY_BINARY) else {
        return;
    };
    let Ok(left) = sys_read_orig(opened.as_fd(), &mut blob) else {
        return;
    };
    let blob = blob.get(..blob.len() - left).unwrap_or_default();
    let (step, pulse) = (Range::new(), Range::new());
    let mut note = |is_step: bool, ticks| if is_step { &step } else { &pulse }.note(ticks);
    if steps::measure(blob, &mut note).is_some() {
        step.print("macro-step");
        pulse.print("idle-pulse");
    } else {
        let _ = writeln!(Console, "macro-step is not what the chart says");
    }
}

/// Does nothing but look at the clock, and notes for how long it was interrupted.
struct Spin;

task! {
    impl Spin {
        slot 0;
    }
}

impl Task for Spin {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        /// Longer than a round, shorter than any handler.
        const SHORTEST_HANDLER_TICKS: u32 = ticks_of(50);
        let quiet = phase() == Phase::Quiet;
        // A task that was executed between two steps of this one belongs to no gap.
        OWN.store(0, Relaxed);
        interruptions::look(SHORTEST_HANDLER_TICKS, |gap, usual| {
            // Whatever was executed before this one is taken off for nothing where no task is
            // enabled.
            let own = OWN.swap(0, Relaxed);
            if quiet && let Some(range) = range_of_handler() {
                range.note(gap - usual - own);
            }
        });
        Step::Run
    }
}

/// A value that is published.
#[derive(Clone, Copy)]
struct Number(u32);

impl PortType for Number {
    const NAME: &'static str = "Number";
    const INIT: Self = Number(0);
}

/// Goes through the framework all the time: its run ends and begins anew, reads and writes values,
/// sets a flag, and writes to the log, which has critical sections.
#[derive(Default)]
struct Call {
    runs: u32,
}

task! {
    impl Call {
        slot 0;
        data {
            out number: Number;
        }
        flags {
            out odd;
        }
    }
}

impl Task for Call {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        phase();
        self.runs = self.runs.wrapping_add(1);
        for _ in 0..20 {
            *io.write(Self::NUMBER) = Number(self.runs);
            io.set(Self::ODD, !self.runs.is_multiple_of(2));
            defmt::info!("run {=u32} at {=u64} us", self.runs, io.now_us());
        }
        Step::Finished
    }
}

/// Reads what [`Call`] publishes, in a slot, so that values pass from slot 0.
struct Read;

task! {
    impl Read {
        slot 2;
        data {
            in number: Number;
        }
    }
}

impl Task for Read {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        black_box(io.read(Self::NUMBER).0);
        Step::Run
    }
}

registry! {
    /// What measures.
    struct Bench {
        probe: Probe[SLOTS_WITH_TASKS as usize],
        two: Two[PORTED],
        four: Four[PORTED],
        spin: Spin[1],
        call: Call[1],
        read: Read[1],
    }
}

impl Bench {
    fn new(_: Parts<'static>) -> Self {
        Self {
            probe: TaskPool::new(array::from_fn(|_| Probe)),
            two: TaskPool::new([const { Two }; PORTED]),
            four: TaskPool::new([const { Four }; PORTED]),
            spin: TaskPool::new([Spin]),
            call: TaskPool::new([Call::default()]),
            read: TaskPool::new([Read]),
        }
    }
}

chip::app! {
    firmware: concat!("bench ", env!("CARGO_PKG_VERSION")),
    robot: Bench = Bench::new,
    board: WithStopButton<BenchBoard, StopPin<'static>> = |board| WithStopButton::new(BenchBoard(board), PINS.stop_button()),
    memory: Memory<'static, BLOB_BYTES, 144, SLOTS, { SLOTS_WITH_TASKS as usize + 3 }, NETS, 1, { settings::TRACE_BYTES }>,
    slots: SLOTS,
}
