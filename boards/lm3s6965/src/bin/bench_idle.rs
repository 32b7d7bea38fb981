//! The default robot with a task in slot 0 that never sleeps and notes how much time reaches it:
//! `cargo xtask bench idle` runs and reads it.
//!
//! The task looks at the clock all the time. Two looks that are as close as its loop is long are
//! its own time; what is longer was taken from it, by slots if an activation was begun meanwhile.
//! First the link sleeps, so that slots and the rest can be told apart; then it works, and what it
//! takes is the difference. An instruction takes 64 ns, as everywhere on this board
//! (`-icount shift=6`).
#![no_std]
#![no_main]

use core::array;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use esm_link::message::SafeReason;
use lm3s6965::PINS;
use lm3s6965::clock::TICKS_PER_US;
use lm3s6965::cortex_m::peripheral::NVIC;
use lm3s6965::cortex_m_board::sys_tick;
use lm3s6965::pac::Interrupt;
use lm3s6965::slots::SlotBoard;
use rt_firmware::body::{
    AnalogChannel, DirectionPin, EchoCapture, EncoderCount, MotorPwm, Parts, StopPin, TriggerPin,
};
use rt_firmware::rover::{Measures, RoverParts};
use rt_firmware::tasks::{
    Back, BatteryMonitor, Cruise, Logger, Odometry, ProximityMonitor, SonarRing, Stop, Turn,
    WheelSpeed,
};
use rt_firmware::{
    ActivationStart, Board, Io, Step, Task, TaskPool, WithStopButton, registry, task,
};

/// Rounds of looks at the clock in one step of the task.
const ROUNDS: u32 = 200;
/// Looks in a round. The emulator's clock is read in steps that differ, so that only several looks
/// tell how long one takes.
const LOOKS: u32 = 64;
/// A gap between two looks that is so many times as long as a look takes is an interruption.
const INTERRUPTION: u32 = 3;

/// Phases of the measurement and how long each lasts, in ticks: the link works in the last.
const SETTLE_TICKS: u32 = 2_000_000 * TICKS_PER_US;
/// See [`SETTLE_TICKS`]. So short that nothing is lost of what the link has to send.
const QUIET_TICKS: u32 = 1_000_000 * TICKS_PER_US;
/// See [`SETTLE_TICKS`].
const LOUD_TICKS: u32 = 8_000_000 * TICKS_PER_US;

/// Activations of slots that were begun.
static ACTIVATIONS: AtomicU32 = AtomicU32::new(0);

/// The default board, which counts activations.
struct CountingBoard(SlotBoard);

impl Board for CountingBoard {
    const TICKS_PER_US: u32 = TICKS_PER_US;

    fn now_ticks(&mut self) -> u64 {
        self.0.now_ticks()
    }

    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        ACTIVATIONS.store(ACTIVATIONS.load(Relaxed).wrapping_add(1), Relaxed);
        self.0.begin_activation(activation)
    }

    fn feed_watchdog(&mut self) {
        self.0.feed_watchdog();
    }

    fn motors_off(&mut self) {
        self.0.motors_off();
    }
}

/// Whose time it was, in ticks.
#[derive(Clone, Copy, Default)]
struct Times {
    own: u32,
    /// In interruptions in which an activation was begun.
    slots: u32,
    rest: u32,
}

impl Times {
    fn total(&self) -> u32 {
        self.own + self.slots + self.rest
    }
}

/// What the task does next.
#[derive(Clone, Copy, Default, PartialEq)]
enum Phase {
    #[default]
    Settle,
    Quiet,
    Loud,
    Done,
}

/// Never sleeps.
#[derive(Default)]
struct Busy {
    phase: Phase,
    times: Times,
    /// SysTick at the last look.
    last: u32,
    /// What a look takes: the mean of the shortest round, which nothing has interrupted. Known when
    /// the first phase is over.
    look_ticks: Option<u32>,
    activations: u32,
}

task! {
    impl Busy {
        slot 0;
    }
}

impl Busy {
    /// Looks at the clock, and tells how long ago the last look was.
    fn look(&mut self) -> u32 {
        let now = sys_tick::current();
        // SysTick counts down.
        let gap = self.last.wrapping_sub(now) & sys_tick::MAX;
        self.last = now;
        let own = self.look_ticks.unwrap_or_default();
        if gap <= own * INTERRUPTION {
            self.times.own += gap;
            return gap;
        }
        self.times.own += own;
        let activations = ACTIVATIONS.load(Relaxed);
        if activations == self.activations {
            self.times.rest += gap - own;
        } else {
            self.activations = activations;
            self.times.slots += gap - own;
        }
        gap
    }

    fn round(&mut self) {
        let mut ticks = 0;
        for _ in 0..LOOKS {
            ticks += self.look();
        }
        if self.phase == Phase::Settle {
            let look_ticks = ticks / LOOKS;
            self.look_ticks = Some(
                self.look_ticks
                    .map_or(look_ticks, |least| least.min(look_ticks)),
            );
        }
    }

    /// Goes on to the next phase if this one is over.
    fn turn(&mut self) {
        let times = self.times;
        let total = times.total();
        self.phase = match self.phase {
            Phase::Settle if total > SETTLE_TICKS => {
                NVIC::mask(Interrupt::SSI0);
                NVIC::mask(Interrupt::UART0);
                Phase::Quiet
            }
            Phase::Quiet if total > QUIET_TICKS => {
                // SAFETY: no critical section of this firmware rests on these two being masked.
                unsafe {
                    NVIC::unmask(Interrupt::SSI0);
                    NVIC::unmask(Interrupt::UART0);
                }
                self.tell(false);
                Phase::Loud
            }
            Phase::Loud if total > LOUD_TICKS => {
                self.tell(true);
                Phase::Done
            }
            _ => return,
        };
        self.times = Times::default();
        self.last = sys_tick::current();
    }

    fn tell(&self, link: bool) {
        let Times { own, slots, rest } = self.times;
        defmt::info!(
            "idle: link {=bool}, own {=u32}, slots {=u32}, rest {=u32}",
            link,
            own,
            slots,
            rest
        );
    }
}

impl Task for Busy {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        for _ in 0..ROUNDS {
            self.round();
        }
        self.turn();
        Step::Run
    }
}

registry! {
    /// What the patrol needs, and the task that never sleeps.
    struct Idle {
        sonar_ring: SonarRing<TriggerPin<'static>, EchoCapture<'static>>[1],
        odometry: Odometry<EncoderCount<'static>, EncoderCount<'static>>[1],
        wheel_speed: WheelSpeed<MotorPwm<'static>, DirectionPin<'static>, MotorPwm<'static>, DirectionPin<'static>>[1],
        battery_monitor: BatteryMonitor<AnalogChannel<'static>>[1],
        proximity_monitor: ProximityMonitor[1],
        cruise: Cruise[2],
        back: Back[3],
        turn: Turn[4],
        stop: Stop[2],
        logger: Logger[1],
        busy: Busy[1],
    }
}

impl Idle {
    fn new(parts: Parts<'static>) -> Self {
        let hardware = RoverParts::from(parts).into_tasks(&Measures::ROVER);
        Self {
            sonar_ring: TaskPool::new([hardware.sonar_ring]),
            odometry: TaskPool::new([hardware.odometry]),
            wheel_speed: TaskPool::new([hardware.wheel_speed]),
            battery_monitor: TaskPool::new([hardware.battery_monitor]),
            proximity_monitor: TaskPool::new([ProximityMonitor]),
            cruise: TaskPool::new(array::from_fn(|_| Cruise)),
            back: TaskPool::new(array::from_fn(|_| Back::default())),
            turn: TaskPool::new(array::from_fn(|_| Turn::default())),
            stop: TaskPool::new(array::from_fn(|_| Stop)),
            logger: TaskPool::new([Logger]),
            busy: TaskPool::new([Busy::default()]),
        }
    }
}

lm3s6965::app! {
    firmware: concat!("bench ", env!("CARGO_PKG_VERSION")),
    robot: Idle = Idle::new,
    board: WithStopButton<CountingBoard, StopPin<'static>> = |board| WithStopButton::new(CountingBoard(board), PINS.stop_button()),
    memory: lm3s6965::Memory<'static>,
    slots: lm3s6965::settings::SLOTS,
}
