//! A robot with a clock of its own, tasks that tell what they do, and a host at the other end of
//! its link.

use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use esm_link::access::{Access, NONCE_BYTES, may_be_proven};
use esm_link::frame::{FrameReader, MAX_FRAME_BYTES, checksum, encode, parse, unpack};
use esm_link::key_store::{KeyStore, NotStored, StoredKey, Volatile, WriteError};
use esm_link::message::{
    BankState, CrashReport, FlashHealth, FrameCounters, FromDevice, Identity, KeyValuesState,
    LinkError, MAX_CHUNK, Request, Response, SafeReason, SlotCounters, Source as MissionSource,
    Status, StoreStatus, Swap, TaskCounters, ToDevice,
};
use esm_link::status_event::StatusEvent;
use esm_link::telemetry::Sample;
use esm_link::trace::TraceEvent;
use esm_tests::owner::Owner;
use host_tools::keys::SigningKey;
use rt_firmware::mission_store::MissionStore;
use rt_firmware::mission_store::Start;
use rt_firmware::realtime::params::SavedParams;
use rt_firmware::tasks::SlotMonitor;
use rt_firmware::{
    About, ActivationStart, Background, Board, Io, Limits, LinkPort, LinkSide, Mailbox, Memory,
    RealTime, Step, Task, TaskPool, registry, split, task,
};

/// Ticks of the robot's clock in a microsecond.
pub const TICKS_PER_US: u64 = 12;

/// What tasks and board share.
#[derive(Default)]
pub struct World {
    ticks: AtomicU64,
    said: Mutex<Vec<String>>,
}

impl World {
    fn say(&self, what: String) {
        self.said.lock().unwrap().push(what);
    }

    /// Lets time pass.
    pub fn pass_us(&self, us: u64) {
        self.ticks.fetch_add(us * TICKS_PER_US, Ordering::Relaxed);
    }

    /// Time since the robot started.
    pub fn now_us(&self) -> u64 {
        self.ticks.load(Ordering::Relaxed) / TICKS_PER_US
    }

    /// What was said since the last time.
    pub fn said(&self) -> Vec<String> {
        std::mem::take(&mut self.said.lock().unwrap())
    }
}

/// Publishes how often it was executed; `high` from the second time on; finished after `limit`
/// executions.
pub struct Source<'w> {
    world: &'w World,
    count: u32,
}
task! { impl['w] Source<'w> { data { out count: u32; } flags { out high; } params { limit: u32 = 1, 1..=1000000; } } }
impl Task for Source<'_> {
    fn reset(&mut self) {
        self.count = 0;
    }
    fn enter(&mut self) {
        self.world.say("source enters".into());
    }
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        self.count += 1;
        *io.write(Self::COUNT) = self.count;
        io.set(Self::HIGH, self.count >= 2);
        self.world
            .say(format!("source {} at {}", self.count, io.now_us()));
        if self.count == io.param(Self::LIMIT) {
            Step::Finished
        } else {
            Step::Run
        }
    }
}

/// Says what it reads.
pub struct Sink<'w> {
    world: &'w World,
}
task! { impl['w] Sink<'w> { data { in count: u32; } params { name: u32; } } }
impl Task for Sink<'_> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        self.world.say(format!(
            "sink {} reads {}",
            io.param(Self::NAME),
            io.read(Self::COUNT)
        ));
        Step::Run
    }
}

/// Takes its time.
pub struct Hog<'w> {
    world: &'w World,
}
task! { impl['w] Hog<'w> { exclusive motion; params { takes_us: u32; } } }
impl Task for Hog<'_> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let takes_us = io.param(Self::TAKES_US);
        self.world.say(format!("hog {takes_us}"));
        self.world.pass_us(takes_us.into());
        Step::Run
    }
}

/// Runs for three steps.
pub struct Thinker<'w> {
    world: &'w World,
    steps: u32,
}
task! { impl['w] Thinker<'w> { data { in count: u32 optional; out thought: u32; } flags { out good; } } }
impl Task for Thinker<'_> {
    fn enter(&mut self) {
        self.steps = 0;
    }
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        self.steps += 1;
        self.world.say(format!(
            "thinks {} of {:?}",
            self.steps,
            io.try_read(Self::COUNT)
        ));
        if self.steps < 3 {
            return Step::Run;
        }
        io.set(Self::GOOD, true);
        *io.write(Self::THOUGHT) = 100 + io.try_read(Self::COUNT).copied().unwrap_or(0);
        Step::Finished
    }
}

registry! {
    /// What the robot can do.
    pub struct Toy['w]<'w> {
        source: Source<'w>[1],
        sink: Sink<'w>[2],
        hog: Hog<'w>[2],
        thinker: Thinker<'w>[1],
        slot_monitor: SlotMonitor[1],
    }
}

/// Signatures of the robot's tasks.
pub mod signature {
    pub const SOURCE: &str = "task Source{out data count:u32;out flag high;param limit:u32;}";
    pub const SINK: &str = "task Sink{in data count:u32;param name:u32;}";
    pub const HOG: &str = "task Hog{param takes_us:u32;}";
    pub const SLOT_MONITOR: &str =
        "task SlotMonitor{out flag overrun;out flag missed;param limit:u32;}";
    pub const THINKER: &str =
        "task Thinker{in data count:u32 optional;out data thought:u32;out flag good;}";
}

/// The board.
pub struct ToyBoard<'w> {
    world: &'w World,
    /// Times that the motors were stopped.
    pub motors_off: u32,
    /// Times that the watchdog was fed.
    pub fed: u32,
    /// Activations so far.
    pub activations: Vec<ActivationStart>,
    /// How often the motors had been stopped when each exchange with the body began.
    pub off_at_exchanges: Vec<u32>,
    /// What the body says from now on.
    pub body: Result<(), SafeReason>,
    /// Whether the button of the emergency stop is pressed.
    pub is_pressed: bool,
    /// The first look at the clock shows a time that is nowhere near, so that what was made ready
    /// is not found to be due.
    looks_away: bool,
}

impl Board for ToyBoard<'_> {
    const TICKS_PER_US: u32 = TICKS_PER_US as u32;
    // Nothing takes time here that a test does not say.
    const START_LEAD_US: u32 = 0;

    fn now_ticks(&mut self) -> u64 {
        self.world.ticks.load(Ordering::Relaxed)
    }

    fn now_low_ticks(&mut self) -> u32 {
        let away = if std::mem::take(&mut self.looks_away) {
            1 << 31
        } else {
            0
        };
        (self.now_ticks() as u32).wrapping_add(away)
    }

    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        self.activations.push(*activation);
        self.off_at_exchanges.push(self.motors_off);
        self.body
    }

    fn feed_watchdog(&mut self) {
        self.fed += 1;
    }

    fn is_emergency_stop_pressed(&mut self) -> bool {
        self.is_pressed
    }

    fn motors_off(&mut self) {
        self.motors_off += 1;
    }
}

/// The wire.
#[derive(Default)]
pub struct Wire {
    /// Bytes on their way to the robot.
    pub to_robot: VecDeque<u8>,
    /// Bytes from the robot.
    pub to_host: VecDeque<u8>,
    /// What the log holds.
    pub log: VecDeque<u8>,
    /// It takes no bytes from the robot.
    pub stuck: bool,
    /// It takes no more than so many bytes from the robot, if that is said.
    pub room: Option<usize>,
    /// What the board's clock says to the link.
    pub now_us: u64,
    /// What is remembered across a reset.
    pub memory: Memo,
    /// Where the robot keeps a key, if it can have one.
    pub safe: Option<Safe>,
}

/// Remembers what it is told of missions on trial.
#[derive(Default)]
pub struct Memo {
    /// Whether it is asked at all.
    pub is_there: bool,
    /// It has no room for another mission.
    pub is_full: bool,
    /// What it was told.
    pub told: Vec<String>,
    /// What it keeps of parameters.
    pub saved: Option<SavedParams>,
    /// Its flash takes nothing more.
    pub is_worn: bool,
    /// It remembers an emergency stop.
    pub is_emergency_stopped: bool,
    /// It does not take that a mission stays.
    pub refuses_confirmation: bool,
    /// It was not told how the last trial ended, or did not take it.
    pub is_on_trial: bool,
    /// The mission that it has for a start, and whether the robot took it, each time that it was
    /// asked.
    pub mission: Vec<u8>,
    pub taken: Vec<bool>,
}

impl MissionStore for Memo {
    fn trial_begins(&mut self, blob: &[u8]) -> Result<(), LinkError> {
        if self.is_full {
            return Err(LinkError::Busy);
        }
        self.told.push(format!("{} bytes", blob.len()));
        self.is_on_trial = true;
        Ok(())
    }

    fn trial_confirmed(&mut self, mission: u32) -> Result<(), LinkError> {
        if self.refuses_confirmation {
            return Err(LinkError::FlashRefused);
        }
        self.told.push(format!("{mission:08x} stays"));
        self.is_on_trial = false;
        Ok(())
    }

    fn trial_failed(&mut self, mission: u32) -> bool {
        self.told.push(format!("{mission:08x} failed"));
        self.is_on_trial = false;
        false
    }

    fn choose(&mut self, room: &mut [u8], accepts: &mut dyn FnMut(&[u8]) -> bool) -> Start {
        let len = self.mission.len();
        room[..len].copy_from_slice(&self.mission);
        let is_taken = len > 0 && accepts(&room[..len]);
        self.taken.push(is_taken);
        if is_taken {
            let on_trial = false;
            Start::Mission { len, on_trial }
        } else {
            Start::Nothing
        }
    }

    fn kept(&self) -> StoreStatus {
        StoreStatus {
            runs: MissionSource::Nothing,
            slots: match self.is_on_trial {
                true => [BankState::OnTrial, BankState::Empty],
                false => [BankState::Empty; 2],
            },
        }
    }

    fn tick(&mut self, _: u64) {}

    fn flash_health(&mut self) -> FlashHealth {
        FlashHealth {
            records: KeyValuesState::Whole,
            flaws: 0,
            mission_erases: 3,
            record_erases: 5,
        }
    }

    fn save_params(&mut self, saved: &SavedParams) -> Result<(), LinkError> {
        if self.is_worn {
            return Err(LinkError::FlashRefused);
        }
        self.saved = Some(*saved);
        Ok(())
    }

    fn saved_params(&mut self) -> SavedParams {
        self.saved.unwrap_or(SavedParams::NONE)
    }

    fn is_emergency_stopped(&self) -> bool {
        self.is_emergency_stopped
    }

    fn set_emergency_stop(&mut self, latched: bool) -> Result<(), LinkError> {
        if self.is_full {
            return Err(LinkError::StopNotStored);
        }
        self.is_emergency_stopped = latched;
        Ok(())
    }
}

/// Keeps a key.
#[derive(Clone, Default)]
pub struct Safe {
    pub kept: Volatile,
    /// It cannot be read and written.
    pub broken: bool,
    /// It takes what is written, and says that it does not.
    pub doubtful: bool,
    /// Writes so far.
    pub writes: u32,
    /// Its records are damaged, and it remembers this key, or that there was none.
    pub damaged: Option<Vec<u8>>,
}

impl KeyStore for Safe {
    fn read(&mut self, record: StoredKey, room: &mut [u8]) -> Result<usize, NotStored> {
        if self.broken || self.damaged.is_some() {
            return Err(NotStored);
        }
        self.kept.read(record, room)
    }

    fn remembered_key(&mut self, room: &mut [u8]) -> Result<usize, NotStored> {
        let key = self.damaged.as_ref().filter(|_| !self.broken);
        let key = key.ok_or(NotStored)?;
        room.get_mut(..key.len())
            .ok_or(NotStored)?
            .copy_from_slice(key);
        Ok(key.len())
    }

    fn renew(&mut self, key: &[u8]) -> Result<(), WriteError> {
        self.damaged.take().ok_or(WriteError::NotStored)?;
        self.kept = Volatile::default();
        self.write(StoredKey::Key, key)
    }

    fn write(&mut self, record: StoredKey, bytes: &[u8]) -> Result<(), WriteError> {
        if self.broken || self.damaged.is_some() {
            return Err(WriteError::NotStored);
        }
        self.writes += 1;
        self.kept.write(record, bytes)?;
        if self.doubtful {
            Err(WriteError::NotStored)
        } else {
            Ok(())
        }
    }
}

impl LinkPort for Wire {
    fn now_us(&mut self) -> u64 {
        self.now_us
    }

    fn receive(&mut self) -> Option<u8> {
        self.to_robot.pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        if self.stuck || self.room == Some(0) {
            return false;
        }
        self.room = self.room.map(|room| room - 1);
        self.to_host.push_back(byte);
        true
    }

    fn read_log(&mut self, room: &mut [u8]) -> usize {
        let len = room.len().min(self.log.len());
        for (place, byte) in room.iter_mut().zip(self.log.drain(..len)) {
            *place = byte;
        }
        len
    }

    fn mission_store(&mut self) -> Option<&mut dyn MissionStore> {
        self.memory
            .is_there
            .then_some(&mut self.memory as &mut dyn MissionStore)
    }

    fn key_store(&mut self) -> Option<&mut dyn KeyStore> {
        self.safe.as_mut().map(|safe| safe as &mut dyn KeyStore)
    }
}

/// Slots that the robot has room for.
pub const SLOTS: usize = 4;
/// Bytes of a blob that the robot has room for.
pub const BLOB_BYTES: usize = 4096;

/// The robot, and what is needed to try it.
pub struct Bench<'q, 'm, 'w> {
    pub world: &'w World,
    pub board: ToyBoard<'w>,
    pub real_time: RealTime<'q, 'm>,
    pub background: Background<'q, 'm>,
    pub link: LinkSide<'q, 'm>,
    pub wire: Wire,
    /// Whether background runs go on by themselves.
    pub background_runs: bool,
    /// Whether a task that was made ready before its time is executed as such, or looked up anew
    /// like all others.
    pub uses_what_is_ready: bool,
    reader: FrameReader,
    seq: u8,
    /// The owner's session, in which requests go if there is one.
    pub owner: Option<Owner>,
    /// The request of each number of a message, in the session that it went in.
    proven: Vec<(u8, Owner)>,
    /// Numbers of messages that were answered without a proof, and the kinds of their requests.
    pub kinds: Vec<(u8, u8)>,
    /// Trace records so far, as text.
    pub trace: Vec<String>,
    /// Log bytes so far.
    pub log: Vec<u8>,
    /// News so far.
    pub news: Vec<StatusEvent>,
    /// Values so far.
    pub values: Vec<Values>,
    /// Samples that the robot has dropped, as it says.
    pub samples_dropped: u32,
}

/// A part with values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Values {
    /// Number of the request, nets that hold a value, time of the macro step, words.
    Sample(u8, u32, u64, Vec<u32>),
    /// There are no more.
    Ended(u8),
}

/// Makes a robot and tries it.
pub fn with_robot(test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    with_robot_that_is(About::new("toy 0.1", "bench"), test);
}

/// Makes a robot that says this of itself, and tries it.
pub fn with_robot_that_is<'a>(about: About<'a>, test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    let world = World::default();
    let mut toy = Toy {
        source: TaskPool::new([Source {
            world: &world,
            count: 0,
        }]),
        sink: TaskPool::new([Sink { world: &world }, Sink { world: &world }]),
        hog: TaskPool::new([Hog { world: &world }, Hog { world: &world }]),
        thinker: TaskPool::new([Thinker {
            world: &world,
            steps: 0,
        }]),
        slot_monitor: TaskPool::new([SlotMonitor::default()]),
    };
    let mut banks = toy.banks();
    let mut memory = Memory::<BLOB_BYTES, 64, SLOTS, 6, 4, 1, 512>::new();
    let mut mail = Mailbox::new();
    let limits = Limits {
        overruns_in_a_row: 3,
        missed_in_a_row: 5,
    };
    let (real_time, background, link) =
        split(&mut memory, &mut banks, &mut mail, about, limits).expect("the registry is right");
    let mut bench = Bench {
        world: &world,
        board: ToyBoard {
            world: &world,
            motors_off: 0,
            fed: 0,
            activations: vec![],
            off_at_exchanges: vec![],
            body: Ok(()),
            is_pressed: false,
            looks_away: false,
        },
        real_time,
        background,
        link,
        wire: Wire::default(),
        background_runs: true,
        uses_what_is_ready: true,
        reader: FrameReader::new(),
        seq: 0,
        owner: None,
        proven: vec![],
        kinds: vec![],
        trace: vec![],
        log: vec![],
        news: vec![],
        values: vec![],
        samples_dropped: 0,
    };
    test(&mut bench);
}

/// An answer, on the host.
#[derive(Debug, PartialEq)]
pub enum Answer {
    Done,
    Received(u32),
    Committed(u32),
    Status(Status),
    Bytes(u32, Vec<u8>),
    Slot(SlotCounters),
    Task(TaskCounters),
    CrashReport(CrashReport),
    Hello(String, Access),
    Challenge {
        nonce: [u8; NONCE_BYTES],
        counter: u64,
    },
    Identity(Identity),
    Param {
        value: u32,
        of_mission: u32,
        saved: Option<u32>,
    },
    ParamsSaved {
        count: u8,
    },
    ParamSet {
        before: u32,
    },
    Clock(u64),
    Features,
    Behaviour(u16),
    BehaviourList(usize),
    Frame(FrameCounters),
}

impl Answer {
    fn of(response: Response<'_>) -> Self {
        match response {
            Response::Hello(info) => {
                Answer::Hello(format!("{} {}", info.firmware, info.board), info.access)
            }
            Response::Received { len } => Answer::Received(len),
            Response::Committed { mission, .. } => Answer::Committed(mission),
            Response::Done => Answer::Done,
            Response::Status(status) => Answer::Status(status),
            Response::TaskText { total, text } => Answer::Bytes(total.into(), text.to_vec()),
            Response::Blob { total, data } => Answer::Bytes(total, data.to_vec()),
            Response::States { total, states, .. } => Answer::Bytes(total.into(), states.to_vec()),
            Response::Slot(counters) => Answer::Slot(counters),
            Response::Frame(counters) => Answer::Frame(counters),
            Response::TaskInstance(counters) => Answer::Task(counters),
            Response::CrashReport { words, .. } => Answer::CrashReport(words),
            Response::BlackBox { end, records } => Answer::Bytes(end, records.to_vec()),
            Response::Challenge { nonce, counter } => Answer::Challenge { nonce, counter },
            Response::Identity(identity) => Answer::Identity(identity),
            Response::Param {
                value,
                of_mission,
                saved,
            } => Answer::Param {
                value,
                of_mission,
                saved,
            },
            Response::ParamsSaved { count } => Answer::ParamsSaved { count },
            Response::ParamSet { before } => Answer::ParamSet { before },
            Response::Clock { now_us } => Answer::Clock(now_us),
            Response::Features { .. } => Answer::Features,
            Response::Behaviour { key } => Answer::Behaviour(key),
            Response::BehaviourList { entries, .. } => Answer::BehaviourList(entries.len()),
        }
    }
}

impl Bench<'_, '_, '_> {
    /// The timer's interrupt. Returns when it comes again.
    pub fn timer(&mut self) -> u64 {
        self.board.looks_away = !self.uses_what_is_ready;
        self.real_time.on_timer(&mut self.board)
    }

    /// Lets the robot run until a time since it started.
    pub fn run_until_us(&mut self, until_us: u64) {
        loop {
            let next_ticks = self.timer();
            while self.background_runs && self.background.poll() {}
            self.exchange();
            let until_ticks = until_us * TICKS_PER_US;
            if next_ticks > until_ticks {
                self.world.ticks.fetch_max(until_ticks, Ordering::Relaxed);
                return;
            }
            self.world.ticks.fetch_max(next_ticks, Ordering::Relaxed);
        }
    }

    /// Lets the robot run for some time.
    pub fn run_us(&mut self, us: u64) {
        self.run_until_us(self.world.now_us() + us);
    }

    /// Lets the link do its work; returns the answers that came, with their numbers.
    pub fn exchange(&mut self) -> Vec<(u8, Result<Answer, LinkError>)> {
        let mut answers = vec![];
        self.wire.now_us = self.world.now_us();
        while self.link.poll(&mut self.wire) && !self.wire.stuck && self.wire.room != Some(0) {}
        while let Some(byte) = self.wire.to_host.pop_front() {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let message = unpack(frame).expect("the robot sends frames");
            match parse(message).expect("the robot sends messages") {
                FromDevice::Stream(stream) if stream.channel == esm_link::message::Channel::Log => {
                    self.log.extend(stream.bytes);
                }
                FromDevice::StatusEvent(news) => self.news.push(news),
                FromDevice::Stream(stream)
                    if stream.channel == esm_link::message::Channel::Values =>
                {
                    assert!(!stream.continues, "a part is a whole sample");
                    self.samples_dropped = stream.dropped;
                    self.values
                        .push(match Sample::of(stream.bytes).expect("a sample") {
                            Sample::Values {
                                number,
                                left_out,
                                has,
                                t_us,
                                words,
                            } => {
                                assert_eq!(left_out, 0);
                                let words = words.iter().map(|word| u32::from_le_bytes(*word));
                                Values::Sample(number, has, t_us, words.collect())
                            }
                            Sample::Ended { number } => Values::Ended(number),
                        });
                }
                FromDevice::Stream(stream) => {
                    let mut bytes = stream.bytes;
                    while !bytes.is_empty() {
                        self.trace.push(format!(
                            "{:?}",
                            TraceEvent::take(&mut bytes).expect("whole records")
                        ));
                    }
                }
                FromDevice::Reply { seq, result, of } => {
                    self.kinds.push((seq, of));
                    answers.push((seq, result.map(Answer::of)));
                }
                FromDevice::Proven {
                    seq, proof, result, ..
                } => {
                    let asked = self.proven.iter().rfind(|(number, _)| *number == seq);
                    let (_, owner) = asked.expect("it was asked in a session");
                    assert!(owner.accepts(owner.number, &proof, message), "{result:?}");
                    answers.push((seq, result.map(Answer::of)));
                }
            }
        }
        answers
    }

    /// Number of the last request.
    pub fn last_number(&self) -> u8 {
        self.seq
    }

    /// Opens a session with the owner of this key, in which requests go from now on.
    pub fn open_session(&mut self, key: &SigningKey) -> Result<Answer, LinkError> {
        self.owner = None;
        let client = [self.seq ^ 0x5a; NONCE_BYTES];
        let identity = match self.ask(Request::Identify { nonce: client })? {
            Answer::Identity(identity) => identity,
            other => panic!("{other:?}"),
        };
        let owner = Owner::of(key, &client, &identity);
        self.proven.push((self.seq.wrapping_add(1), owner));
        let opened = self.ask(owner.opening(client, &identity))?;
        self.owner = Some(owner);
        Ok(opened)
    }

    /// Lets somebody else have the line.
    pub fn by_anyone<T>(&mut self, test: impl FnOnce(&mut Self) -> T) -> T {
        let owner = self.owner.take();
        let tested = test(self);
        self.owner = owner;
        tested
    }

    /// The frame of the next request.
    pub fn frame(&mut self, request: Request<'_>) -> Vec<u8> {
        match self.owner.as_mut().filter(|_| may_be_proven(&request)) {
            Some(owner) => {
                let proven = owner.prove(&request);
                self.proven.push((self.seq.wrapping_add(1), *owner));
                self.plain_frame(proven.request())
            }
            None => self.plain_frame(request),
        }
    }

    fn plain_frame(&mut self, request: Request<'_>) -> Vec<u8> {
        self.seq = self.seq.wrapping_add(1);
        let mut frame = [0; MAX_FRAME_BYTES];
        let len = encode(
            &ToDevice {
                seq: self.seq,
                request,
            },
            &mut frame,
        )
        .expect("requests fit");
        frame[..len].to_vec()
    }

    /// Asks, and lets the robot run until it answers, for a second at most.
    pub fn ask(&mut self, request: Request<'_>) -> Result<Answer, LinkError> {
        let frame = self.frame(request);
        self.wire.to_robot.extend(frame);
        let mut answers = self.exchange();
        for _ in 0..1_000 {
            // What is to a request before is passed over.
            answers.retain(|(seq, _)| *seq == self.seq);
            if let Some((_, answer)) = answers.pop() {
                assert_eq!(answers, []);
                return answer;
            }
            let next_ticks = self.timer();
            answers = self.exchange();
            if answers.is_empty() {
                self.world.ticks.fetch_max(next_ticks, Ordering::Relaxed);
            }
        }
        panic!("no answer to {request:?}");
    }

    /// Sends a blob, but does not commit it.
    pub fn send(&mut self, blob: &[u8]) {
        assert_eq!(
            self.ask(Request::Begin {
                len: blob.len() as u32,
                crc: checksum(blob)
            }),
            Ok(Answer::Received(0))
        );
        for (part, data) in blob.chunks(MAX_CHUNK).enumerate() {
            let offset = (part * MAX_CHUNK) as u32;
            let received = offset + data.len() as u32;
            assert_eq!(
                self.ask(Request::Chunk { offset, data }),
                Ok(Answer::Received(received))
            );
        }
    }

    /// Sends a blob and switches to it.
    pub fn upload(&mut self, blob: &[u8]) -> Result<Answer, LinkError> {
        self.send(blob);
        self.ask(Request::Commit(Swap::default()))
    }

    /// Sends a blob that is right, and switches to it on trial.
    pub fn try_out(&mut self, blob: &[u8], trial_ms: u32) {
        self.send(blob);
        let swapped = self.ask(Request::Commit(Swap {
            warm: false,
            trial_ms,
        }));
        assert!(matches!(swapped, Ok(Answer::Committed(_))), "{swapped:?}");
    }

    /// Sends a blob that is right, and switches to it.
    pub fn start(&mut self, blob: &[u8]) {
        assert!(matches!(self.upload(blob), Ok(Answer::Committed(_))));
    }

    /// Whether the robot has a key, as it says.
    pub fn access(&mut self) -> Access {
        match self.ask(Request::Hello) {
            Ok(Answer::Hello(_, access)) => access,
            other => panic!("{other:?}"),
        }
    }

    pub fn status(&mut self) -> Status {
        match self.ask(Request::Status) {
            Ok(Answer::Status(status)) => status,
            other => panic!("{other:?}"),
        }
    }

    pub fn slot(&mut self, slot: u8) -> SlotCounters {
        match self.ask(Request::SlotCounters { slot }) {
            Ok(Answer::Slot(counters)) => counters,
            other => panic!("{other:?}"),
        }
    }

    pub fn task(&mut self, task_instance: u16) -> TaskCounters {
        match self.ask(Request::TaskCounters { task_instance }) {
            Ok(Answer::Task(counters)) => counters,
            other => panic!("{other:?}"),
        }
    }
}
