//! The default robot without a plant, which measures how one mission follows another:
//! `cargo xtask bench` builds, runs and reads it.
//!
//! A mission whose only task is [`Watch`] is followed by one that is measured. `Watch` looks at the
//! clock all the time: the longest gap between two looks is what the link takes for the request to
//! commit, which is by far the most that it ever does at once. What the slot takes is seen by the
//! board, which is asked for the time first of all when the slot's interrupt comes, told before the
//! new mission's first macro step, and asked again after it.
//!
//! The clock counts 20 ns; an instruction takes 2^8 ns (`-icount shift=8`).
#![no_std]
#![no_main]

use core::array;
use core::fmt::Write;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use esm_link::message::SafeReason;
use lm3s6965::clock::TICKS_PER_US;
use lm3s6965::console::Console;
use lm3s6965::cortex_m_board::sys_tick;
use lm3s6965::slots::SlotBoard;
use rt_firmware::body::{
    AnalogChannel, DirectionPin, EchoCapture, EncoderCount, MotorPwm, Parts, TriggerPin,
};
use rt_firmware::rover::{Measures, RoverParts};
use rt_firmware::tasks::{
    Back, BatteryMonitor, Cruise, FollowWall, Logger, Odometry, ProximityMonitor, RoundCorner,
    SlotMonitor, SonarRing, Stop, Turn, WheelSpeed,
};
use rt_firmware::{ActivationStart, Board, Io, Step, Task, TaskPool, registry, task};

/// Nanoseconds that an instruction takes.
const INSTRUCTION_NS: u32 = 1 << 8;
/// Nanoseconds that a tick takes.
const TICK_NS: u32 = 1_000 / TICKS_PER_US;

/// The longest time between two looks at the clock since a mission began, in ticks.
static LONGEST_GAP: AtomicU32 = AtomicU32::new(0);

/// Instructions.
fn instructions(ticks: u32) -> u32 {
    ticks.saturating_mul(TICK_NS) / INSTRUCTION_NS
}

/// The board without a plant, which sees missions begin.
struct SwapBoard {
    board: SlotBoard,
    /// When it was asked for the time last, low half.
    asked_ticks: u32,
    /// The same before the first macro step of a mission that is under way.
    began_ticks: Option<u32>,
}

impl Board for SwapBoard {
    const TICKS_PER_US: u32 = TICKS_PER_US;

    fn now_ticks(&mut self) -> u64 {
        self.board.now_ticks()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        let now = self.board.now_low_ticks();
        if let Some(began_ticks) = self.began_ticks.take() {
            tell(now.wrapping_sub(began_ticks));
        }
        self.asked_ticks = now;
        now
    }

    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        // The first one of its mission.
        if activation.interpreter && activation.number == 0 {
            self.began_ticks = Some(self.asked_ticks);
        }
        Ok(())
    }

    fn feed_watchdog(&mut self) {
        self.board.feed_watchdog();
    }

    fn motors_off(&mut self) {
        self.board.motors_off();
    }
}

/// Tells what the link and the slot took: one line a mission that began.
#[inline(never)]
fn tell(slot_ticks: u32) {
    let link_ticks = LONGEST_GAP.swap(0, Relaxed);
    let _ = writeln!(
        Console,
        "swap {} {}",
        instructions(link_ticks),
        instructions(slot_ticks)
    );
}

/// Looks at the clock.
#[derive(Default)]
struct Watch {
    /// SysTick at the last look; it counts down.
    last: Option<u32>,
}

task! {
    impl Watch {
        slot 0;
    }
}

impl Task for Watch {
    fn enter(&mut self) {
        self.last = None;
    }

    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        const ROUNDS: u32 = 1_000;
        for _ in 0..ROUNDS {
            let now = sys_tick::current();
            if let Some(last) = self.last.replace(now) {
                let gap = last.wrapping_sub(now) & sys_tick::MAX;
                LONGEST_GAP.store(LONGEST_GAP.load(Relaxed).max(gap), Relaxed);
            }
        }
        Step::Run
    }
}

registry! {
    /// What the shipped missions need, and the task that watches.
    struct Swap {
        sonar_ring: SonarRing<TriggerPin<'static>, EchoCapture<'static>>[1],
        odometry: Odometry<EncoderCount<'static>, EncoderCount<'static>>[1],
        wheel_speed: WheelSpeed<MotorPwm<'static>, DirectionPin<'static>, MotorPwm<'static>, DirectionPin<'static>>[1],
        battery_monitor: BatteryMonitor<AnalogChannel<'static>>[1],
        proximity_monitor: ProximityMonitor[1],
        cruise: Cruise[2],
        back: Back[3],
        turn: Turn[4],
        follow_wall: FollowWall[1],
        round_corner: RoundCorner[1],
        stop: Stop[2],
        logger: Logger[1],
        slot_monitor: SlotMonitor[1],
        watch: Watch[1],
    }
}

impl Swap {
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
            follow_wall: TaskPool::new([FollowWall]),
            round_corner: TaskPool::new([RoundCorner]),
            stop: TaskPool::new(array::from_fn(|_| Stop)),
            logger: TaskPool::new([Logger]),
            slot_monitor: TaskPool::new([SlotMonitor::default()]),
            watch: TaskPool::new([Watch::default()]),
        }
    }
}

lm3s6965::app! {
    firmware: concat!("bench ", env!("CARGO_PKG_VERSION")),
    robot: Swap = Swap::new,
    board: SwapBoard = |board| SwapBoard { board, asked_ticks: 0, began_ticks: None },
    memory: lm3s6965::Memory<'static>,
    slots: lm3s6965::settings::SLOTS,
}
