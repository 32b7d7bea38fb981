//! A robot that drives for a day, on a clock that runs as fast as this machine can: is every
//! activation of every slot where its period says, to the microsecond, after hours and beyond the
//! wraps of 32-bit counters?
//!
//! Runtime, dispatcher, interpreter, tasks and link are those of the firmware, the body is the
//! plant's, and the clock has the ticks of the default board. Only what a chip gives is made up:
//! time passes by chance whenever somebody looks at the clock, and interrupts come late by chance.

use std::path::Path;

use esm_core::tables::Slot;
use esm_link::frame::{FrameReader, MAX_FRAME_BYTES, checksum, decode, encode};
use esm_link::message::{
    FromDevice, MAX_CHUNK, Mode, Request, Response, SafeReason, Status, Swap, ToDevice,
};
use host_tools::files::load_world;
use host_tools::plant::{BodyParameters, Plant};
use rt_firmware::body::{
    self, ANALOG_CHANNELS, BATTERY_CHANNEL, Freshness, PinImage, PlantExchange, Reply, Sensors,
};
use rt_firmware::rover::{Measures, PinRover};
use rt_firmware::{
    About, ActivationStart, AnyTaskPool, Background, Board, Limits, LinkPort, LinkSide, Mailbox,
    Memory, RealTime, split,
};

use crate::random::Random;
use crate::subject;

/// Ticks of the clock in a microsecond, as on the default board: 32 bits of them last for 86
/// seconds.
const TICKS_PER_US: u32 = 50;
/// The most that an interrupt of the timer is late, in ticks.
const MOST_LATENCY_TICKS: usize = 5 * TICKS_PER_US as usize;
/// The most that passes from one look at the clock to the next, in ticks.
const MOST_WORK_TICKS: usize = 40;
/// The most that an activation may begin after its nominal start: the latency, and the looks at the
/// clock before it.
const MOST_DELAY_US: u64 = 10;
/// Rounds within which a request is answered.
const MOST_ROUNDS: usize = 1_000;

const SLOTS: usize = 16;

/// What a run has shown of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SlotRun {
    /// The slot, as the mission has it.
    pub slot: Slot,
    /// Activations that the robot counts as executed.
    pub executed: u64,
    /// Activations that it counts as missed.
    pub missed: u64,
    /// Executions that it counts as overruns.
    pub overruns: u64,
    /// Nominal start of the last activation, in microseconds since the mission started.
    pub last_start_us: u64,
    /// Activations whose nominal start lies within the run.
    pub expected: u64,
}

/// What a run has shown.
#[derive(Clone, Debug)]
pub struct Run {
    /// Each slot, in the order of the mission.
    pub slots: Vec<SlotRun>,
    /// What the robot says of itself at the end.
    pub status: Status,
    /// The first activation whose nominal start was not where its period says, or that began too
    /// late, in words.
    pub first_wrong: Option<String>,
    /// The way that the robot drove through its world, in metres.
    pub distance_m: f64,
}

impl Run {
    /// What is wrong with it, in words, a line each; nothing if all is right.
    pub fn problems(&self) -> Vec<String> {
        let mut problems: Vec<String> = self.first_wrong.iter().cloned().collect();
        let status = &self.status;
        if status.mode != Mode::Running || status.missed != 0 || status.overruns != 0 {
            problems.push(format!("the robot at the end: {status:?}"));
        }
        for run in &self.slots {
            let SlotRun { slot, .. } = run;
            let last_us = u64::from(slot.start_us) + (run.expected - 1) * u64::from(slot.period_us);
            let right = SlotRun {
                executed: run.expected,
                missed: 0,
                overruns: 0,
                last_start_us: last_us,
                ..*run
            };
            if *run != right {
                problems.push(format!(
                    "slot {}: {run:?}, should be {right:?}",
                    slot.number
                ));
            }
        }
        problems
    }
}

/// A board whose time is made up.
struct MadeUp<'p, 'b> {
    ticks: u64,
    random: Random,
    /// When the timer was last set to come; of the first activation, this is its nominal start.
    due_ticks: u64,
    /// The clock at the mission's start, once there was an activation.
    origin_ticks: Option<u64>,
    slots: Vec<Slot>,
    /// Activations of each slot so far, and the nominal start of the last one.
    begun: Vec<(u64, u64)>,
    first_wrong: Option<String>,
    pins: &'p PinImage,
    exchange: PlantExchange,
    body: Body<'b>,
}

/// What is behind the pins.
pub enum Body<'b> {
    /// A robot in a world.
    InWorld(Box<Plant>),
    /// A robot that stands on a block, with nothing around it: quickly worked out.
    OnBlock,
    /// Whatever answers these requests.
    Answering(&'b mut dyn FnMut(&body::Request) -> Reply),
}

/// What the battery's input reads on the block: 8 V.
const BATTERY_COUNTS: u16 = 3_300;

impl Body<'_> {
    /// A robot at the start of the world in this file.
    ///
    /// # Errors
    /// Says what stood in the way, for a person.
    pub fn in_world(path: &Path) -> Result<Self, String> {
        let world = load_world(path).map_err(|error| error.to_string())?;
        let plant = Plant::new(world, BodyParameters::default(), 1);
        Ok(Body::InWorld(Box::new(
            plant.map_err(|error| error.to_string())?,
        )))
    }

    fn exchange(&mut self, request: &body::Request) -> Reply {
        let mut adc_counts = [0; ANALOG_CHANNELS];
        if let Some(battery) = adc_counts.get_mut(BATTERY_CHANNEL) {
            *battery = BATTERY_COUNTS;
        }
        match self {
            Body::InWorld(plant) => plant.exchange(request),
            Body::Answering(answer) => answer(request),
            Body::OnBlock => Reply {
                sequence: request.sequence,
                sensors: Sensors {
                    adc_counts,
                    ..Sensors::default()
                },
            },
        }
    }

    fn distance_m(&self) -> f64 {
        match self {
            Body::InWorld(plant) => plant.distance_m(),
            Body::OnBlock | Body::Answering(_) => 0.0,
        }
    }
}

impl MadeUp<'_, '_> {
    /// Compares an activation with what is to be. None is lost or doubled if each slot's starts go
    /// on by its period.
    fn compare(&mut self, activation: &ActivationStart) {
        let origin_ticks = *self.origin_ticks.get_or_insert(self.due_ticks);
        let (Some(slot), Some((count, last_us))) = (
            self.slots.get(activation.slot),
            self.begun.get_mut(activation.slot),
        ) else {
            self.first_wrong
                .get_or_insert(format!("there is no such slot: {activation:?}"));
            return;
        };
        let expected_us = u64::from(slot.start_us) + *count * u64::from(slot.period_us);
        let nominal_ticks = origin_ticks + expected_us * u64::from(TICKS_PER_US);
        let delay_us = self
            .ticks
            .checked_sub(nominal_ticks)
            .map(|ticks| ticks / u64::from(TICKS_PER_US));
        if activation.start_us != expected_us || delay_us.is_none_or(|us| us > MOST_DELAY_US) {
            self.first_wrong.get_or_insert(format!(
                "occurrence {count} of slot {} is nominally at {expected_us} us; told {} us, begun {delay_us:?} us after it",
                slot.number, activation.start_us
            ));
        }
        *count += 1;
        *last_us = activation.start_us;
    }
}

impl Board for MadeUp<'_, '_> {
    const TICKS_PER_US: u32 = TICKS_PER_US;

    fn now_ticks(&mut self) -> u64 {
        self.ticks += self.random.below(MOST_WORK_TICKS) as u64;
        self.ticks
    }

    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        self.compare(activation);
        let request =
            (self.exchange).request(self.pins, activation.start_us, activation.previous_end_us);
        let reply = self.body.exchange(&request);
        match self.exchange.accept(self.pins, Some(&reply.encode())) {
            Freshness::Fresh | Freshness::Stale => Ok(()),
            Freshness::Lost => Err(SafeReason::BodyLost),
        }
    }

    fn motors_off(&mut self) {
        self.pins.safe();
    }
}

/// A line that takes all bytes.
#[derive(Default)]
struct Line {
    to_robot: std::collections::VecDeque<u8>,
    to_host: Vec<u8>,
}

impl LinkPort for Line {
    // Nothing here has a deadline.
    fn now_us(&mut self) -> u64 {
        0
    }

    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        self.to_host.push(byte);
        true
    }
}

/// The robot with its line.
struct Robot<'q, 'm, 'p, 'b> {
    board: MadeUp<'p, 'b>,
    real_time: RealTime<'q, 'm>,
    background: Background<'q, 'm>,
    link: LinkSide<'q, 'm>,
    line: Line,
    seq: u8,
}

impl Robot<'_, '_, '_, '_> {
    /// The timer's interrupt, and what else is to be done then.
    fn turn(&mut self) {
        self.board.due_ticks = self.real_time.on_timer(&mut self.board);
        while self.background.poll() {}
        while self.link.poll(&mut self.line) {}
    }

    /// Lets time pass until the timer's next interrupt.
    fn wait(&mut self) {
        let latency = self.board.random.below(MOST_LATENCY_TICKS) as u64;
        self.board.ticks = self.board.ticks.max(self.board.due_ticks) + latency;
    }

    /// Asks; `take` makes something of the answer.
    fn ask<T>(
        &mut self,
        request: Request<'_>,
        take: impl Fn(Response<'_>) -> Option<T>,
    ) -> Result<T, String> {
        self.seq = self.seq.wrapping_add(1);
        let seq = self.seq;
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(&ToDevice { seq, request }, &mut frame)
            .map_err(|error| format!("{request:?}: {error:?}"))?;
        self.line.to_robot.extend(frame.iter().take(len));
        self.line.to_host.clear();
        let mut reader = FrameReader::new();
        for _ in 0..MOST_ROUNDS {
            self.turn();
            for byte in self.line.to_host.drain(..) {
                let Some(frame) = reader.push(byte) else {
                    continue;
                };
                let message = decode(frame).map_err(|error| format!("{request:?}: {error:?}"))?;
                if let FromDevice::Reply {
                    seq: answered,
                    result,
                    ..
                } = message
                    && answered == seq
                {
                    let response = result.map_err(|error| format!("{request:?}: {error:?}"))?;
                    return take(response).ok_or_else(|| format!("{request:?}: {response:?}"));
                }
            }
            // The run's time begins with the mission's first activation, at which a commit is
            // answered.
            if self.board.origin_ticks.is_none() {
                self.wait();
            }
        }
        Err(format!("{request:?}: no answer"))
    }

    fn upload(&mut self, blob: &[u8]) -> Result<(), String> {
        let done = |_: Response<'_>| Some(());
        let crc = checksum(blob);
        let len = blob.len() as u32;
        self.ask(Request::Begin { len, crc }, done)?;
        for (part, data) in blob.chunks(MAX_CHUNK).enumerate() {
            let offset = (part * MAX_CHUNK) as u32;
            self.ask(Request::Chunk { offset, data }, done)?;
        }
        self.ask(Request::Commit(Swap::default()), done)
    }
}

/// Lets the default robot run a mission for a time.
///
/// # Errors
/// Says what stood in the way, for a person. What the run shows is not judged here: see
/// [`Run::problems`].
pub fn drive(mission: &Path, body: Body<'_>, duration_us: u64) -> Result<Run, String> {
    let built = subject::build_file(mission)?;
    let pins = PinImage::new();
    let mut rover = PinRover::new(pins.parts().into(), &Measures::ROVER);
    drive_robot(&built.blob, &pins, &mut rover.banks(), body, duration_us)
}

/// Lets a robot of these tasks, on these pins, run a compiled mission for a time.
///
/// # Errors
/// As [`drive`].
pub fn drive_robot(
    blob: &[u8],
    pins: &PinImage,
    banks: &mut [&mut (dyn AnyTaskPool + '_)],
    body: Body<'_>,
    duration_us: u64,
) -> Result<Run, String> {
    let slots: Vec<Slot> = subject::verified(blob)?.tables().slots().collect();
    let mut banks: Vec<&mut dyn AnyTaskPool> = banks
        .iter_mut()
        .map(|bank| &mut **bank as &mut dyn AnyTaskPool)
        .collect();
    let mut memory = Memory::<4096, 256, SLOTS, 32, 32, 4, 1024>::new();
    let mut mail = Mailbox::new();
    let (real_time, background, link) = split(
        &mut memory,
        &mut banks,
        &mut mail,
        About::new("rover", "made up"),
        Limits::default(),
    )
    .map_err(|fault| format!("{fault:?}"))?;
    let mut robot = Robot {
        board: MadeUp {
            ticks: 0,
            random: Random::new(1),
            due_ticks: 0,
            origin_ticks: None,
            begun: vec![(0, 0); slots.len()],
            slots,
            first_wrong: None,
            pins,
            exchange: PlantExchange::new(),
            body,
        },
        real_time,
        background,
        link,
        line: Line::default(),
        seq: 0,
    };
    let streams = Request::Subscribe {
        trace: true,
        log: true,
        record: true,
    };
    robot.ask(streams, |_| Some(()))?;
    robot.upload(blob)?;
    loop {
        robot.turn();
        robot.line.to_host.clear();
        let end_ticks = robot
            .board
            .origin_ticks
            .map(|origin_ticks| origin_ticks + duration_us * u64::from(TICKS_PER_US));
        if end_ticks.is_some_and(|end_ticks| robot.board.due_ticks >= end_ticks) {
            break;
        }
        robot.wait();
    }
    finished(robot, duration_us)
}

/// Asks the robot what it has counted.
fn finished(mut robot: Robot<'_, '_, '_, '_>, duration_us: u64) -> Result<Run, String> {
    let status = robot.ask(Request::Status, |response| match response {
        Response::Status(status) => Some(status),
        _ => None,
    })?;
    let mut runs = Vec::new();
    for (index, slot) in robot.board.slots.clone().into_iter().enumerate() {
        let request = Request::SlotCounters { slot: index as u8 };
        let counters = robot.ask(request, |response| match response {
            Response::Slot(counters) => Some(counters),
            _ => None,
        })?;
        runs.push(SlotRun {
            slot,
            executed: counters.executed.into(),
            missed: counters.missed.into(),
            overruns: counters.overruns.into(),
            last_start_us: robot.board.begun.get(index).map_or(0, |begun| begun.1),
            expected: (duration_us - u64::from(slot.start_us)).div_ceil(slot.period_us.into()),
        });
    }
    Ok(Run {
        slots: runs,
        status,
        first_wrong: robot.board.first_wrong,
        distance_m: robot.board.body.distance_m(),
    })
}
