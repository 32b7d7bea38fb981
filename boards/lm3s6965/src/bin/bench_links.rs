//! A robot that measures what a link's frames take: `cargo xtask bench dispatch` builds, runs and
//! reads it.
//!
//! Dispatchers, device and interrupts are the firmware's own, built as `rover-links` is; only the
//! exchange with a plant is left out. The mission sends a value of 16 bytes in each second
//! activation, and what the line sends back it receives. In the slots of both dispatchers a task
//! stands before and one behind them: the runtime looks at the clock after each, and so does
//! [`BenchBoard`]. What lies between two such looks is what the dispatcher adds to its slot, with
//! all that the runtime does for it. In slot 0 runs [`Spin`], which notes what interrupts take.
//!
//! The clock counts 20 ns; an instruction takes 2^8 ns (`-icount shift=8`), so what is counted is
//! exact to an instruction.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use esm_link::frame::CRC_BYTES;
use esm_link::frames::configuration::Configuration;
use esm_link::frames::wire::{Header, OVERHEAD_BYTES, checksum, encode, stuffed, unstuffed};
use esm_link::message::SafeReason;
use lm3s6965 as chip;
use lm3s6965::PINS;
use lm3s6965::clock::TICKS_PER_US;
use lm3s6965::cortex_m;
use lm3s6965::cortex_m_board::sys_tick::{self, now_ticks};
use lm3s6965::slots::SlotBoard;
use rt_firmware::body::{Parts, StopPin};
use rt_firmware::frames::LinkDevice;
use rt_firmware::tasks::WheelControl;
use rt_firmware::{
    ActivationStart, Board, Io, Step, Task, TaskPool, WithStopButton, registry, task,
};

#[path = "../../../cortex_m/measured/interruptions.rs"]
mod interruptions;
#[path = "../../../cortex_m/measured/origin.rs"]
mod origin;
#[path = "../../../cortex_m/measured/range.rs"]
mod range;

use origin::ORIGIN;
use range::Range;

/// Bytes of a payload: a [`WheelControl`].
const PAYLOAD_BYTES: usize = 16;
/// Period of all slots, in microseconds; as the host has it.
const PERIOD_US: u32 = 20_000;
/// Period of the frame: each second activation sends one. As the host has it.
const FRAME_PERIOD_US: u32 = 2 * PERIOD_US;
/// When the frame starts, behind all slots; as the host has it.
const FRAME_US: u32 = 15_000;
/// So much of the time around a frame's start is told as that of the interrupts that send it.
const AROUND_US: u32 = 100;
/// From the beginning of a period on to its end, nothing but single bytes interrupts.
const BYTES_US: u32 = 17_000;

/// Until then nothing is counted, in microseconds of the mission: an upload is answered, and the
/// link comes to rest.
const SETTLED_US: u32 = 1_000_000;
/// Until then it is.
const END_US: u32 = 6_000_000;

/// The last look of the runtime at the clock, and the one before.
static LAST: AtomicU32 = AtomicU32::new(0);
static BEFORE: AtomicU32 = AtomicU32::new(0);

/// What a dispatcher adds to its slot that sends a frame, and where there is none to be sent.
static TRANSMIT: Range = Range::new();
static TRANSMIT_NONE: Range = Range::new();
/// What one adds that receives a frame, and where there is none.
static RECEIVE: Range = Range::new();
static RECEIVE_NONE: Range = Range::new();
/// What one more task adds that does nothing: what the runtime does for any.
static PROBE: Range = Range::new();
/// What the interrupts take that send a frame, from the first to the last byte.
static SEND: Range = Range::new();
/// What the interrupt takes that receives a byte.
static BYTE: Range = Range::new();

/// The mission's time, in microseconds.
fn since_us() -> u32 {
    let since_ticks = (now_ticks() as u32).wrapping_sub(ORIGIN.load(Relaxed));
    since_ticks / TICKS_PER_US
}

/// Whether what happens is counted.
fn is_counted() -> bool {
    (SETTLED_US..END_US).contains(&since_us())
}

/// What lies between the last two looks at the clock.
fn between_looks() -> u32 {
    let (before, last) = (BEFORE.load(Relaxed), LAST.load(Relaxed));
    last.wrapping_sub(before) & sys_tick::MAX
}

/// The board without a plant.
struct BenchBoard(SlotBoard);

impl Board for BenchBoard {
    const TICKS_PER_US: u32 = TICKS_PER_US;
    const COUNT_BITS: u32 = SlotBoard::COUNT_BITS;

    #[inline(always)]
    fn count(&mut self) -> u32 {
        let now = self.0.count();
        BEFORE.store(LAST.load(Relaxed), Relaxed);
        LAST.store(now, Relaxed);
        now
    }

    fn now_ticks(&mut self) -> u64 {
        self.0.now_ticks()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        self.0.now_low_ticks()
    }

    #[inline(always)]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        self.0.note_time(activation);
        origin::note(activation);
        Ok(())
    }

    fn feed_watchdog(&mut self) {
        self.0.feed_watchdog();
    }

    fn link(&mut self, index: usize) -> Option<&mut dyn LinkDevice> {
        self.0.link(index)
    }

    fn motors_off(&mut self) {
        self.0.motors_off();
    }
}

/// Stands before what is measured, and gives a value to be sent.
#[derive(Default)]
struct Give {
    count: u16,
}

task! {
    impl Give {
        slot 2;
        data {
            out control: WheelControl;
        }
    }
}

impl Task for Give {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        self.count = self.count.wrapping_add(1);
        let number = f32::from(self.count);
        *io.write(Self::CONTROL) = WheelControl {
            left_set_m_per_s: number,
            right_set_m_per_s: -number,
            left_power: 0.0,
            right_power: 1.0,
        };
        Step::Run
    }
}

/// Does nothing.
struct Probe;

task! {
    impl Probe {
        slot 2;
    }
}

impl Task for Probe {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        Step::Run
    }
}

/// Stands behind [`Probe`].
struct Probed;

task! {
    impl Probed {
        slot 2;
    }
}

impl Task for Probed {
    fn step(&mut self, _io: &mut Io<'_>) -> Step {
        if is_counted() {
            PROBE.note(between_looks());
        }
        Step::Run
    }
}

/// Stands behind what sends.
struct Sent;

task! {
    impl Sent {
        slot 2;
    }
}

impl Task for Sent {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        if is_counted() {
            let sends = io.now_us() as u32 % FRAME_PERIOD_US < PERIOD_US;
            let range = if sends { &TRANSMIT } else { &TRANSMIT_NONE };
            range.note(between_looks());
        }
        Step::Run
    }
}

/// Stands behind what receives.
#[derive(Default)]
struct Got {
    last: f32,
}

task! {
    impl Got {
        slot 3;
        data {
            in control: WheelControl optional;
        }
    }
}

impl Task for Got {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let took_ticks = between_looks();
        let number = io
            .try_read(Self::CONTROL)
            .map_or(0.0, |it| it.left_set_m_per_s);
        if is_counted() {
            // Each second number is sent.
            if number == self.last + 2.0 {
                RECEIVE.note(took_ticks);
            } else if number == self.last {
                RECEIVE_NONE.note(took_ticks);
            }
        }
        self.last = number;
        Step::Run
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
        const SHORTEST_HANDLER_TICKS: u32 = range::ticks_of(40);
        /// Longer than the interrupt of a byte, shorter than those of a frame.
        const SHORTEST_CHAIN_TICKS: u32 = 10 * SHORTEST_HANDLER_TICKS;
        if (END_US..2 * END_US).contains(&since_us()) {
            end();
        }
        let is_counted = is_counted();
        interruptions::look(SHORTEST_HANDLER_TICKS, |gap, usual| {
            let until_us = since_us();
            let from_us = until_us.wrapping_sub(gap / TICKS_PER_US) % PERIOD_US;
            if !is_counted {
            } else if from_us.abs_diff(FRAME_US) < AROUND_US {
                // A byte that comes just then is none that is sent.
                if gap > SHORTEST_CHAIN_TICKS {
                    SEND.note(gap - usual);
                }
            } else if from_us > BYTES_US && until_us % PERIOD_US > BYTES_US {
                BYTE.note(gap - usual);
            }
        });
        Step::Run
    }
}

/// Tells what was found, and ends the emulator.
fn end() -> ! {
    cortex_m::interrupt::disable();
    TRANSMIT.print("transmit");
    TRANSMIT_NONE.print("transmit-none");
    RECEIVE.print("receive");
    RECEIVE_NONE.print("receive-none");
    PROBE.print("probe");
    SEND.print("send");
    BYTE.print("byte");
    measure_coding();
    semihosting::process::exit(0);
}

/// Measures checksum and COBS of a frame as [`Give`] has it, which are not the dispatchers'.
/// Interrupts are masked.
fn measure_coding() {
    /// 300, -300, 0 and 1.
    const PAYLOAD: [u8; PAYLOAD_BYTES] = [0, 0, 150, 67, 0, 0, 150, 195, 0, 0, 0, 0, 0, 0, 128, 63];
    let header = Header {
        identifier: 1,
        number: 150,
        configuration: Configuration::from_hash(1),
    };
    let (nothing, crc) = (Range::new(), Range::new());
    let (stuffing, unstuffing) = (Range::new(), Range::new());
    let measure = |of: &Range, work: &mut dyn FnMut()| {
        let before = sys_tick::current();
        work();
        of.note(before.wrapping_sub(sys_tick::current()) & sys_tick::MAX);
    };
    let mut bytes = [0; PAYLOAD_BYTES + OVERHEAD_BYTES];
    let length = encode(header, &PAYLOAD, &mut bytes).unwrap_or_default();
    let Some((_, stuffed_bytes)) = bytes.split_last_mut() else {
        return;
    };
    measure(&nothing, &mut || ());
    measure(&unstuffing, &mut || {
        black_box(unstuffed(black_box(stuffed_bytes)).is_some());
    });
    measure(&crc, &mut || {
        let checked = stuffed_bytes.get(1..length - 1 - CRC_BYTES);
        let checked = black_box(checked.unwrap_or_default());
        black_box(checksum(black_box(header.configuration), checked));
    });
    measure(&stuffing, &mut || {
        if let Some((first, plain)) = stuffed_bytes.split_first_mut() {
            *first = stuffed(black_box(plain));
        }
    });
    for (range, name) in [
        (&nothing, "nothing"),
        (&crc, "crc"),
        (&stuffing, "stuff"),
        (&unstuffing, "unstuff"),
    ] {
        range.print(name);
    }
}

registry! {
    /// What measures.
    struct Bench {
        give: Give[1],
        probe: Probe[2],
        probed: Probed[1],
        sent: Sent[1],
        got: Got[1],
        spin: Spin[1],
    }
}

impl Bench {
    fn new(_: Parts<'static>) -> Self {
        Self {
            give: TaskPool::new([Give::default()]),
            probe: TaskPool::new([const { Probe }; 2]),
            probed: TaskPool::new([Probed]),
            sent: TaskPool::new([Sent]),
            got: TaskPool::new([Got::default()]),
            spin: TaskPool::new([Spin]),
        }
    }
}

lm3s6965::app! {
    firmware: concat!("bench ", env!("CARGO_PKG_VERSION")),
    robot: Bench = Bench::new,
    board: WithStopButton<BenchBoard, StopPin<'static>> =
        |board| WithStopButton::new(BenchBoard(board), PINS.stop_button()),
    memory: lm3s6965::Memory<'static>,
    slots: lm3s6965::settings::SLOTS,
}
