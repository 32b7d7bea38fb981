//! The default robot with tasks that misbehave beside its own, for tests: an overrun, masked
//! interrupts, tasks that never return, a panic, a fault of the core, a stack that is too deep. And
//! one that works in slot 0 without an end, and says how much it has done.
//!
//! Each does its harm in the first step after its state was entered, and only then, so that
//! counters can be compared with exact numbers.
#![no_std]
#![no_main]

use core::array;
use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering};

use lm3s6965::clock::TICKS_PER_US;
use lm3s6965::cortex_m;
use lm3s6965::cortex_m_board::sys_tick::now_ticks;
use rt_firmware::body::{
    AnalogChannel, DirectionPin, EchoCapture, EncoderCount, MotorPwm, Parts, TriggerPin,
};
use rt_firmware::rover::{Measures, RoverParts};
use rt_firmware::tasks::{BatteryMonitor, Cruise, Odometry, SonarRing, Stop, Turn, WheelSpeed};
use rt_firmware::{Io, Step, Task, TaskPool, registry, task};

/// Keeps the core busy for a time, whatever its instructions take.
fn busy_us(duration_us: u32) {
    let end_ticks = now_ticks() + u64::from(duration_us) * u64::from(TICKS_PER_US);
    while now_ticks() < end_ticks {}
}

/// Takes longer than its slot, once.
#[derive(Default)]
struct Overrun {
    done: bool,
}

task! {
    impl Overrun {
        slot 2;
        params {
            duration_us: u32 = 20000, 0..=250000;
        }
    }
}

impl Task for Overrun {
    fn enter(&mut self) {
        self.done = false;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if !self.done {
            self.done = true;
            busy_us(io.param(Self::DURATION_US));
        }
        Step::Run
    }
}

/// Masks all interrupts for a time, the slot timer's included; from slot 0, so that it is
/// activations that are missed, not tasks that overrun.
struct MaskInterrupts;

task! {
    impl MaskInterrupts {
        slot 0;
        params {
            duration_us: u32 = 20000, 0..=250000;
        }
    }
}

impl Task for MaskInterrupts {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let duration_us = io.param(Self::DURATION_US);
        cortex_m::interrupt::free(|_| busy_us(duration_us));
        Step::Finished
    }
}

/// Never returns.
struct NeverReturn;

task! {
    impl NeverReturn {
        slot 2;
    }
}

impl Task for NeverReturn {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        loop {
            cortex_m::asm::nop();
        }
    }
}

/// Never returns, and has no slot that would miss it.
struct NeverReturnInBackground;

task! {
    impl NeverReturnInBackground {
        slot 0;
    }
}

impl Task for NeverReturnInBackground {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        loop {
            cortex_m::asm::nop();
        }
    }
}

/// Panics.
struct Panic;

task! {
    impl Panic {
        slot 2;
    }
}

impl Task for Panic {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        panic!("planted");
    }
}

/// Executes an instruction that there is not.
struct Undefined;

task! {
    impl Undefined {
        slot 2;
    }
}

impl Task for Undefined {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        cortex_m::asm::udf()
    }
}

/// Calls itself until the stack's memory ends.
struct DeepStack;

task! {
    impl DeepStack {
        slot 2;
    }
}

impl Task for DeepStack {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        /// More than the stack's memory has room for.
        const CALLS: u32 = 10_000;
        match calls(CALLS) {
            CALLS => Step::Finished,
            _ => Step::Run,
        }
    }
}

/// Calls itself so often, each time with some bytes on the stack, and counts.
#[inline(never)]
fn calls(left: u32) -> u32 {
    let bytes = black_box([left; 16]);
    match left {
        0 => 0,
        _ => calls(left - 1) + black_box(bytes[0] / left),
    }
}

/// Pieces of work that were done in slot 0.
static WORK_DONE: AtomicU32 = AtomicU32::new(0);

/// Works for as long as it is let: a piece a step.
struct Work;

task! {
    impl Work {
        slot 0;
        endless;
    }
}

impl Task for Work {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        /// Of a piece. Some 30 us of the emulated core.
        const ROUNDS: u32 = 100;
        for _ in 0..ROUNDS {
            cortex_m::asm::nop();
        }
        // It is the only one who writes it.
        WORK_DONE.store(
            WORK_DONE.load(Ordering::Relaxed).wrapping_add(1),
            Ordering::Relaxed,
        );
        Step::Run
    }
}

/// Says how much work was done.
struct WorkMeter;

task! {
    impl WorkMeter {
        slot 2;
        endless;
        data {
            // An output that somebody reads is on a net, where it can be seen.
            in last: u32 optional;
            out done: u32;
        }
    }
}

impl Task for WorkMeter {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        *io.write(Self::DONE) = WORK_DONE.load(Ordering::Relaxed);
        Step::Run
    }
}

registry! {
    /// Some of the default robot's tasks, and those that misbehave.
    struct Faults {
        sonar_ring: SonarRing<TriggerPin<'static>, EchoCapture<'static>>[1],
        odometry: Odometry<EncoderCount<'static>, EncoderCount<'static>>[1],
        wheel_speed: WheelSpeed<MotorPwm<'static>, DirectionPin<'static>, MotorPwm<'static>, DirectionPin<'static>>[1],
        battery_monitor: BatteryMonitor<AnalogChannel<'static>>[1],
        cruise: Cruise[1],
        turn: Turn[1],
        stop: Stop[1],
        overrun: Overrun[2],
        mask_interrupts: MaskInterrupts[1],
        never_return: NeverReturn[1],
        never_return_in_slot_0: NeverReturnInBackground[1],
        panic: Panic[1],
        undefined: Undefined[1],
        deep_stack: DeepStack[1],
        work: Work[1],
        work_meter: WorkMeter[1],
    }
}

impl Faults {
    fn new(parts: Parts<'static>) -> Self {
        let hardware = RoverParts::from(parts).into_tasks(&Measures::ROVER);
        Self {
            sonar_ring: TaskPool::new([hardware.sonar_ring]),
            odometry: TaskPool::new([hardware.odometry]),
            wheel_speed: TaskPool::new([hardware.wheel_speed]),
            battery_monitor: TaskPool::new([hardware.battery_monitor]),
            cruise: TaskPool::new([Cruise]),
            turn: TaskPool::new([Turn::default()]),
            stop: TaskPool::new([Stop]),
            overrun: TaskPool::new(array::from_fn(|_| Overrun::default())),
            mask_interrupts: TaskPool::new([MaskInterrupts]),
            never_return: TaskPool::new([NeverReturn]),
            never_return_in_slot_0: TaskPool::new([NeverReturnInBackground]),
            panic: TaskPool::new([Panic]),
            undefined: TaskPool::new([Undefined]),
            deep_stack: TaskPool::new([DeepStack]),
            work: TaskPool::new([Work]),
            work_meter: TaskPool::new([WorkMeter]),
        }
    }
}

lm3s6965::app! {
    firmware: concat!("faults ", env!("CARGO_PKG_VERSION")),
    robot: Faults = Faults::new,
}
