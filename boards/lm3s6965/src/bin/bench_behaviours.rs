//! A robot that measures what a behaviour adds to a task: `cargo xtask bench behaviours` builds,
//! runs and reads it.
//!
//! The same two laws run as plain tasks and as behaviours. [`Move`] does not look at where the
//! robot is, [`GoTo`] does. A plain task (`Plain…`) calls its law with what it reads, and writes
//! what that says. A careful one (`Careful…`) does what a task has to that counts from where it
//! began and may meet somebody: its law sees a local frame, and the robot stands where the way is
//! not free. The behaviour has that, and stands on a list.
//!
//! Each has a slot; between them are slots with nothing to do, so that both handlers are measured
//! that a task has to do with: the one before makes it ready. Behind a behaviour the owner of its
//! list executes, and one slot has such an owner, with nobody on its list, behind a plain task. The
//! robot stands in open space, whatever they say: nothing changes from one activation to the next.
//!
//! The clock counts 20 ns; an instruction takes 2^8 ns (`-icount shift=8`).
#![no_std]
#![no_main]

use core::sync::atomic::Ordering::Relaxed;

use lm3s6965 as chip;
use lm3s6965::clock::TICKS_PER_US;
use lm3s6965::cortex_m::peripheral::NVIC;
use lm3s6965::cortex_m_board::sys_tick::now_ticks;
use lm3s6965::{PINS, pac::Interrupt, settings};
use rt_firmware::behaviours::situation::{StopDistance, is_outside};
use rt_firmware::behaviours::{
    Behaviour, Behaviours, Control, GoTo, GoToLaw, Move, MoveLaw, Scene,
};
use rt_firmware::body::{Parts, StopPin};
use rt_firmware::odometry::LocalFrame;
use rt_firmware::supervision::LINK_BOUND_US;
use rt_firmware::tasks::{Pose, Ranges, Twist};
use rt_firmware::{Io, Memory, Step, Task, TaskPool, WithStopButton, registry, task};

#[path = "../../../cortex_m/measured/board.rs"]
mod board;
#[path = "../../../cortex_m/measured/interruptions.rs"]
mod interruptions;
#[path = "../../../cortex_m/measured/origin.rs"]
mod origin;
#[path = "../../../cortex_m/measured/range.rs"]
mod range;

use board::BenchBoard;
use origin::ORIGIN;
use range::{Range, ticks_of};

/// Time for the interpreter in each period, in microseconds; as the host has it.
const INTERPRETER_US: u32 = 15_000;
/// From one slot to the next, in microseconds; as the host has it.
const DISTANCE_US: u32 = 4_000;
/// Period of all slots, in microseconds; as the host has it.
const PERIOD_US: u32 = 90_000;

/// What runs in each second slot, in the order in which slots have it: what it is called.
const KINDS: [&str; 8] = [
    "nothing",
    "owner",
    "move-plain",
    "move-careful",
    "move-behaviour",
    "go-to-plain",
    "go-to-careful",
    "go-to-behaviour",
];
/// Slots: that of the interpreter, that of [`Feed`], and two of each kind.
const SLOTS: usize = 2 + 2 * KINDS.len();
/// Tasks of a mission.
const TASKS: usize = 13;
/// Nets of a mission.
const NETS: usize = 16;
/// Room for the mission.
const BLOB_BYTES: usize = 6 * 1024;

/// Until then the link is told that the mission runs, in microseconds of the mission; from then on
/// it sleeps.
const BEGIN_US: u32 = 200_000;
/// Until then what it asked for is answered.
const SETTLED_US: u32 = 1_200_000;
/// Until then is measured. The link sleeps for less than [`LINK_BOUND_US`].
const END_US: u32 = 4_000_000;
const _: () = assert!(END_US - BEGIN_US < LINK_BOUND_US);

/// What the handlers take of a slot with nothing to do that is followed by one of a kind.
static BEFORE: [Range; KINDS.len()] = [const { Range::new() }; KINDS.len()];
/// What the handlers of the kinds themselves take.
static WITH: [Range; KINDS.len()] = [const { Range::new() }; KINDS.len()];

/// Says where the robot is, and what is around it: always the same.
struct Feed;

task! {
    impl Feed {
        slot 2;
        data {
            out pose: Pose;
            out ranges: Ranges;
        }
    }
}

impl Task for Feed {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        *io.write(Self::POSE) = Pose::START;
        *io.write(Self::RANGES) = Ranges::FREE;
        Step::Run
    }
}

/// A plain task and a careful one that run a law with the parameters of its behaviour, which stand
/// at the same places.
macro_rules! plain_tasks {
    (
        $law:ident: $plain:ident, $careful:ident;
        $($param:ident = $default:literal, $min:literal..=$max:literal;)+
    ) => {
        #[derive(Default)]
        struct $plain($law);

        task! {
            impl $plain {
                slot 2;
                data {
                    in pose: Pose optional within 100 ms;
                    in ranges: Ranges optional within 200 ms;
                    out twist: Twist;
                }
                flags {
                    out failed;
                }
                params {
                    $($param: f32 = $default, $min..=$max;)+
                }
            }
        }

        impl Task for $plain {
            fn step(&mut self, io: &mut Io<'_>) -> Step {
                let Some(pose) = io.try_read(Self::POSE) else {
                    *io.write(Self::TWIST) = Twist::STILL;
                    return Step::Run;
                };
                let scene = Scene::at(pose, io.try_read(Self::RANGES), io.period_us());
                let control = self.0.control(&scene, &io.params());
                write_down(io, Self::TWIST, Self::FAILED, control)
            }
        }

        #[derive(Default)]
        struct $careful {
            law: $law,
            centre: Option<LocalFrame>,
            stop_distance: StopDistance,
            is_suspended: bool,
        }

        task! {
            impl $careful {
                slot 2;
                data {
                    in pose: Pose optional within 100 ms;
                    in ranges: Ranges optional within 200 ms;
                    out twist: Twist;
                }
                flags {
                    out failed;
                    out suspended;
                }
                params {
                    $($param: f32 = $default, $min..=$max;)+
                    outside_m: f32 = 0.0, 0.0..=1000.0;
                }
            }
        }

        impl Task for $careful {
            fn enter(&mut self) {
                *self = Self::default();
            }

            fn step(&mut self, io: &mut Io<'_>) -> Step {
                let Some(pose) = io.try_read(Self::POSE) else {
                    *io.write(Self::TWIST) = Twist::STILL;
                    return Step::Run;
                };
                let params = io.params();
                let law = &mut self.law;
                let begin = || LocalFrame::from(law.centre(*pose, &params));
                let centre = self.centre.get_or_insert_with(begin);
                let ranges = io.try_read(Self::RANGES);
                let scene = Scene::seen_from(centre, pose, ranges, io.period_us());
                let mut control = law.control(&scene, &params);
                let mut suspended = false;
                if let Control::Move(twist) = &mut control {
                    let outside_m = params.get(Self::OUTSIDE_M);
                    if outside_m > 0.0 && is_outside(&scene.pose(), outside_m) {
                        return Step::Finished;
                    }
                    let clearance_m = law.clearance_m(&scene, &params);
                    if !(self.stop_distance).is_free(clearance_m, twist, scene.ranges) {
                        *twist = Twist::STILL;
                        suspended = true;
                    }
                }
                if suspended != self.is_suspended {
                    self.is_suspended = suspended;
                    io.set(Self::SUSPENDED, suspended);
                }
                write_down(io, Self::TWIST, Self::FAILED, control)
            }
        }
    };
}

plain_tasks! {
    MoveLaw: PlainMove, CarefulMove;
    speed_m_per_s = 0.2, -0.5..=0.5;
    rate_rad_per_s = 0.0, -3.0..=3.0;
}

plain_tasks! {
    GoToLaw: PlainGoTo, CarefulGoTo;
    x_m = 1.0, -100.0..=100.0;
    y_m = 0.0, -100.0..=100.0;
    speed_m_per_s = 0.25, 0.05..=0.5;
}

/// What a plain task does with what its law says.
#[inline(always)]
fn write_down(
    io: &mut Io<'_>,
    twist: rt_firmware::Out<Twist>,
    failed: rt_firmware::OutFlag,
    control: Control,
) -> Step {
    match control {
        Control::Move(asked) => {
            *io.write(twist) = asked;
            Step::Run
        }
        Control::Done | Control::Failed => {
            io.set(failed, control == Control::Failed);
            Step::Finished
        }
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
        let is_measured = is_measured();
        interruptions::look(SHORTEST_HANDLER_TICKS, |gap, usual| {
            if is_measured && let Some(range) = range_of_handler() {
                range.note(gap - usual);
            }
        });
        Step::Run
    }
}

/// Whether what handlers take is to be noted. At the end it is told, and the emulator ends.
fn is_measured() -> bool {
    match since_us() {
        ..BEGIN_US => false,
        since_us @ BEGIN_US..END_US => {
            // The link would take its part of the time. It is late then, which it is made for.
            NVIC::mask(Interrupt::SSI0);
            NVIC::mask(Interrupt::UART0);
            since_us >= SETTLED_US
        }
        _ => {
            for (ranges, when) in [(&BEFORE, "before"), (&WITH, "with")] {
                for (range, kind) in ranges.iter().zip(KINDS) {
                    range.print(format_args!("{when}-{kind}"));
                }
            }
            semihosting::process::exit(0);
        }
    }
}

/// Microseconds of the mission.
fn since_us() -> u32 {
    (now_ticks() as u32).wrapping_sub(ORIGIN.load(Relaxed)) / TICKS_PER_US
}

/// Where it belongs what a handler took that has just ended. Found by the time, so that a handler
/// does nothing for it.
fn range_of_handler() -> Option<&'static Range> {
    let phase_us = since_us() % PERIOD_US;
    // Until the interpreter's time is over, the timer only looks whether there is something to do.
    // The first slot behind it is that of the task that feeds the others.
    let slot = (phase_us.checked_sub(INTERPRETER_US)? / DISTANCE_US).checked_sub(2)? as usize;
    let kind = slot / 2;
    if slot.is_multiple_of(2) {
        BEFORE.get(kind)
    } else {
        WITH.get(kind)
    }
}

registry! {
    /// What measures.
    struct Bench {
        feed: Feed[1],
        plain_move: PlainMove[2],
        careful_move: CarefulMove[1],
        move_on: Move[1],
        plain_go_to: PlainGoTo[1],
        careful_go_to: CarefulGoTo[1],
        go_to: GoTo[1],
        behaviours: Behaviours[3],
        spin: Spin[1],
    }
}

impl Bench {
    fn new(_: Parts<'static>) -> Self {
        Self {
            feed: TaskPool::new([Feed]),
            plain_move: TaskPool::from_fn(PlainMove::default),
            careful_move: TaskPool::new([CarefulMove::default()]),
            move_on: TaskPool::new([Move::default()]),
            plain_go_to: TaskPool::new([PlainGoTo::default()]),
            careful_go_to: TaskPool::new([CarefulGoTo::default()]),
            go_to: TaskPool::new([GoTo::default()]),
            behaviours: TaskPool::from_fn(Behaviours::default),
            spin: TaskPool::new([Spin]),
        }
    }
}

lm3s6965::app! {
    firmware: concat!("bench ", env!("CARGO_PKG_VERSION")),
    robot: Bench = Bench::new,
    board: WithStopButton<BenchBoard, StopPin<'static>> = |board| {
        WithStopButton::new(BenchBoard(board), PINS.stop_button())
    },
    memory: Memory<'static, BLOB_BYTES, 144, SLOTS, TASKS, NETS, 1, { settings::TRACE_BYTES }>,
    slots: SLOTS,
}
