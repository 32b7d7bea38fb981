//! One run: a board is started, missions are brought to it over its line, its streams are followed
//! until the end.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use esm_link::features::Feature;
use esm_link::message::{Channel, LinkError, Mode, Status, Swap};
use esm_link::trace::TraceEvent;
use rt_firmware::body::SONARS;
use thiserror::Error;

use super::board::{Board, BoardError, LinkWay, RunningBoard};
use super::by_hand::{ByHand, Telling};
use super::mission::{Mission, hash_text};
use super::summary::{EndPose, MissionSummary, Summary};
use super::touches::TouchSummary;
use crate::counted_links::CountedLinks;
use crate::flash::Flash;
use crate::host_board::HostBoard;
use crate::interrupt::Interrupt;
use crate::link_client::log_lines::{LogLine, LogReader, LogTableError};
use crate::link_client::{ClientError, KeyLoader, LinkClient, StreamEvent, Streams};
use crate::lockstep::in_system::BoardSide;
use crate::lockstep::line::STANDSTILL_LIMIT;
use crate::lockstep::pace::{Hold, Pace};
use crate::lockstep::plant_side::{PlantFault, PlantSide, SonarBreak, StuckWheel};
use crate::serial::ByteLink;
use crate::serial::noise::{Noise, Noisy};
use crate::values::Subscription;
use esm_toolkit::clean::counted;
use esm_toolkit::counters::SlotReport;
use esm_toolkit::host_run::{CALL_INTERVAL_US, LINK_MONITOR};
use esm_toolkit::plant::variation::Variation;
use esm_toolkit::plant::{BodyParameters, Plant, PlantError, RecordedRanges, SonarFault};
use esm_toolkit::recording::entered::Entered;
use esm_toolkit::recording::file::Header;
use esm_toolkit::recording::writer::{Counts, RecordingWriter};
use esm_toolkit::schedule::handover::Handover;
use esm_toolkit::story::{Story, Told, safe_reason};
use esm_toolkit::world::World;

/// How long a wait for the robot's next words may last.
const LISTEN_TIME: Duration = Duration::from_millis(20);

/// How long a robot whose time is over may take to say its crash report.
const SILENCE_AT_END: Duration = Duration::from_millis(300);

/// Where that time is the wall's: how often in a row it answers and has nothing else to say. On a
/// loaded machine a robot that is silent may have got no processor.
const SILENT_ANSWERS: u32 = 15;

/// How often a robot is called whose mission wants to hear of the host.
const CALL_INTERVAL: Duration = Duration::from_micros(CALL_INTERVAL_US);

/// Seed of the plant's noise where none is said.
pub const DEFAULT_SEED: u64 = 1;

/// A mission and when it is to take over.
pub struct Planned {
    /// Robot time in microseconds; 0 for the first.
    pub at_us: u64,
    /// The mission.
    pub mission: Mission,
    /// Whether what it has in common with the one before goes on as it is.
    pub warm: bool,
    /// What becomes of the slots that it shares with the one before.
    pub handover: Handover,
}

/// What is to be run.
pub struct Plan {
    /// The board.
    pub board: Board,
    /// How its link goes.
    pub link: LinkWay,
    /// What bytes on their way to the robot suffer. What it says comes through: a trace with holes
    /// is none.
    pub noise: Option<Noise>,
    /// The robot's body.
    pub body: BodyParameters,
    /// The world around the robot.
    pub world: World,
    /// Seed of the plant's noise.
    pub seed: u64,
    /// Robot time at which the run ends, in microseconds.
    pub until_us: Option<u64>,
    /// Whether robot time never runs faster than the wall clock.
    pub realtime: bool,
    /// The missions in the order in which they take over; at least one.
    pub missions: Vec<Planned>,
    /// What entered an earlier run and is to enter this one.
    pub replay: Option<Entered>,
    /// Where a recording of it goes.
    pub record: Option<Box<dyn Write>>,
    /// How often the recording keeps the values on the nets, in the mission's time; with 0 after
    /// each macro step.
    pub sample_period: Option<Duration>,
    /// What happens to the plant.
    pub plant_fault: Option<PlantFault>,
    /// Sonars that break while it runs.
    pub sonar_breaks: Vec<SonarBreak>,
    /// Wheels that something holds while it runs.
    pub stuck_wheels: Vec<StuckWheel>,
    /// What the sonars measure instead of the world. The run ends with it, if not before.
    pub sensors: Option<RecordedRanges>,
    /// What the list of behaviours is told while it goes.
    pub by_hand: ByHand,
    /// The flash beside it; without, one that has no mission and lets none of the firmware's own
    /// run.
    pub flash: Option<Flash>,
    /// Signs, if the robot has a key, which a flash may hold.
    pub key: Option<KeyLoader>,
    /// Robot time from which on the robot hears nothing more of this program, in microseconds.
    pub cut_link_us: Option<u64>,
    /// Who has body and links, where it is a board of a system.
    pub system: Option<Arc<BoardSide>>,
}

impl Planned {
    /// The first mission of a run, or the only one.
    pub fn first(mission: Mission) -> Self {
        Planned {
            at_us: 0,
            mission,
            warm: false,
            handover: Handover::default(),
        }
    }
}

impl Plan {
    /// A run of these missions as `esm run` makes it where nothing else is said, over the UART and
    /// without an end.
    pub fn new(board: Board, world: World, missions: Vec<Planned>) -> Self {
        Plan {
            board,
            link: LinkWay::Uart,
            noise: None,
            world,
            seed: DEFAULT_SEED,
            until_us: None,
            realtime: false,
            missions,
            replay: None,
            record: None,
            sample_period: None,
            body: BodyParameters::default(),
            plant_fault: None,
            sonar_breaks: Vec::new(),
            stuck_wheels: Vec::new(),
            sensors: None,
            by_hand: ByHand::default(),
            flash: None,
            key: None,
            cut_link_us: None,
            system: None,
        }
    }

    /// Looks for what would be refused when the run starts, before anything is made for it.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn check(&self) -> Result<(), RunError> {
        self.board.check_link(self.link)?;
        if let Some(replay) = &self.replay {
            self.board.check_replay(self.link)?;
            check_replay(replay, &self.missions)?;
        }
        Plant::new(self.world.clone(), self.body, self.seed)?;
        Ok(())
    }

    /// The same run with what is around the robot [varied](Variation) with its seed.
    #[must_use]
    pub fn varied(mut self) -> Self {
        let variation = Variation::new(self.seed);
        self.world = variation.world(&self.world);
        let dead = variation.dead_sonar(SONARS);
        self.sonar_breaks
            .extend(dead.map(|(sonar, robot_us)| SonarBreak {
                sonar,
                fault: SonarFault::Dead,
                robot_us,
            }));
        self
    }
}

/// What whoever watches a run gets to hear.
pub enum Heard<'a> {
    /// Something happened on the robot.
    Happened(&'a str),
    /// The robot's log has a line.
    Log(&'a LogLine),
    /// An upload begins.
    UploadBegins(&'a Mission),
    /// So many bytes of it are on the robot.
    Uploaded(usize),
    /// The mission runs.
    UploadEnds(&'a MissionSummary),
    /// The last mission has finished, and the run has no end of its own.
    FinishedWithoutEnd,
    /// Something is not as it should be, and the run goes on.
    Warning(&'a str),
}

/// Why a run did not come to its end.
#[derive(Debug, Error)]
pub enum RunError {
    /// The robot does not stand well in the world.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// The board.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The link.
    #[error("{cause}{}", if is_told(cause) { String::new() } else { during(console) })]
    Link {
        /// What went wrong.
        cause: ClientError,
        /// What the emulator and the firmware printed last.
        console: String,
    },
    /// The robot refused a mission.
    #[error("the robot refused {}: {reason}", file.display())]
    Refused {
        /// The mission's file.
        file: PathBuf,
        /// Why, with names.
        reason: String,
    },
    /// Robot time stands still.
    #[error("the board has stood still for {} s, at {:.3} s of robot time{}", STANDSTILL_LIMIT.as_secs(), *robot_us as f64 / 1e6, during(console))]
    Standstill {
        /// Where robot time stood.
        robot_us: u64,
        /// What the emulator and the firmware printed last.
        console: String,
    },
    /// The trace has a hole.
    #[error("the trace is not whole: {missing} records did not come through")]
    TraceGap {
        /// How many.
        missing: u32,
    },
    /// The robot streams what makes no sense.
    #[error("the robot's trace makes no sense; its firmware and this program do not fit together")]
    BadTrace,
    /// The recording is not of these missions.
    #[error(
        "the recording is of other missions ({recorded}) than these ({given}); give the same files as when it was made"
    )]
    OtherMissions {
        /// Hashes in the recording.
        recorded: String,
        /// Hashes of the missions given.
        given: String,
    },
    /// The trace cannot be written.
    #[error("cannot write the trace: {0}")]
    Trace(#[from] io::Error),
    /// The recording cannot be written.
    #[error("cannot write the recording: {0}")]
    Recording(io::Error),
}

/// Whether the robot itself says what is wrong, so that nobody need guess from its crash report.
fn is_told(cause: &ClientError) -> bool {
    matches!(
        cause,
        ClientError::Refused { .. } | ClientError::NotBuiltIn { .. } | ClientError::OtherKey { .. }
    )
}

fn during(console: &str) -> String {
    if console.is_empty() {
        String::new()
    } else {
        format!("; the board's last words:\n{console}")
    }
}

/// A run that came to its end.
pub struct Run<W> {
    /// Its figures.
    pub summary: Summary,
    /// What happened.
    pub told: Told<W>,
    /// The plant at the end.
    pub plant: Plant,
    /// What entered it from outside of virtual time.
    pub entered: Entered,
    /// What its recording holds, if there is one.
    pub recorded: Option<Counts>,
    /// Time on the wall that it took, uploads and start included.
    pub wall: Duration,
    /// Whether the person ended it before its time.
    pub interrupted: bool,
}

/// Carries out a plan; the trace goes to `out`, everything else to `watch`.
///
/// # Errors
/// [`RunError`]; whatever was started has ended then, too.
pub fn drive<W: Write>(
    plan: Plan,
    out: W,
    interrupt: Interrupt,
    watch: &mut dyn FnMut(Heard<'_>),
) -> Result<Run<W>, RunError> {
    let mut driver = Driver::start(plan, out)?;
    let ended = driver.follow(interrupt, watch);
    match ended {
        Ok(interrupted) => driver.finish(interrupted, watch),
        Err(error) => Err(driver.with_console(error)),
    }
}

struct Driver<W> {
    // Dropped first, so that the board's line has a reader for as long as the board lives.
    board: RunningBoard,
    link: LinkWay,
    robot: LinkClient<Box<dyn ByteLink>>,
    plant: PlantSide,
    pace: Arc<Pace>,
    story: Story<W>,
    /// What reads its log, or why nothing can.
    log: Result<LogReader, LogTableError>,
    board_name: &'static str,
    seed: u64,
    missions: Vec<Planned>,
    recording: Option<RecordingWriter<Box<dyn Write>>>,
    sample_period: Option<Duration>,
    /// The values that are kept, and the mission that they are of.
    sampled: Option<(u32, Subscription)>,
    until_us: Option<u64>,
    /// Of each mission that was brought to the robot.
    uploads: Vec<MissionSummary>,
    /// Whether it was said that the run has no end.
    told_of_no_end: bool,
    /// Of the missions before the present one; the robot counts anew with each.
    longest_delay_ns: u32,
    /// How many missions the trace has seen start.
    started: usize,
    wall_start: Instant,
    /// When the robot's trace last had something to say, on the line's clock.
    last_word: Instant,
    /// Answers since then that were looked for at the end.
    silent_answers: u32,
    /// Whether a mission wants to hear of the host, and from which robot time on it does not.
    calls: bool,
    /// What the list of behaviours is told.
    telling: Telling,
    cut_link_us: Option<u64>,
    /// Whether somebody wants to have the robot's flash from run to run.
    keeps_flash: bool,
    /// When, on the line's clock.
    last_call: Instant,
}

impl<W: Write> Driver<W> {
    fn start(plan: Plan, out: W) -> Result<Self, RunError> {
        let wall_start = Instant::now();
        let mut missions = plan.missions;
        if let Some(replay) = &plan.replay {
            check_replay(replay, &missions)?;
            for (planned, at_us) in missions.iter_mut().zip(&replay.starts_us).skip(1) {
                planned.at_us = *at_us;
            }
        }
        let calls = missions.iter().any(|planned| {
            let names = &planned.mission.task_names;
            names.iter().any(|name| name == LINK_MONITOR)
        });
        // A robot measures the silence of its host in its own time: it must not run ahead of the
        // clock by which this program calls.
        let pace = Pace::new(plan.realtime || (calls && plan.link == LinkWay::Uart));
        let plant = Plant::new(plan.world, plan.body, plan.seed)?;
        let keeps_flash = plan.flash.is_some();
        let flash = plan.flash.unwrap_or_else(|| plan.board.flash_of_a_run());
        let plant = PlantSide::new(plant, Arc::clone(&pace), plan.until_us)
            .with_flash(Some(flash))
            .in_system(plan.system);
        if let Some(fault) = plan.plant_fault {
            plant.inject(fault);
        }
        plant.break_sonars(plan.sonar_breaks);
        plant.stick_wheels(plan.stuck_wheels);
        if let Some(ranges) = plan.sensors {
            plant.measure_from(ranges);
        }
        let board_name = plan.board.name();
        let log = plan.board.log_reader();
        let (board, line) =
            RunningBoard::start(plan.board, &plant, plan.replay.as_ref(), plan.link)?;
        let line = match plan.noise {
            Some(noise) => Box::new(Noisy::outwards(line, noise, plan.seed)) as Box<dyn ByteLink>,
            None => line,
        };
        let connected = LinkClient::connect(line).map_err(|cause| RunError::Link {
            cause,
            console: board.console(),
        });
        let (mut robot, info) = connected?;
        if let Some(key) = plan.key {
            robot.use_key(key);
        }
        let recording = match plan.record {
            Some(out) => {
                let head = Header {
                    board: info.board,
                    firmware: info.firmware,
                    program: concat!("esm ", env!("CARGO_PKG_VERSION")).to_owned(),
                    seed: Some(plan.seed),
                };
                Some(
                    begin_recording(out, head, plan.until_us, &missions)
                        .map_err(RunError::Recording)?,
                )
            }
            None => None,
        };
        let link_start = robot.clock().now();
        Ok(Driver {
            board,
            link: plan.link,
            robot,
            pace,
            story: Story::new(out, plan.until_us),
            log,
            board_name,
            seed: plan.seed,
            until_us: plan.until_us,
            missions,
            sample_period: plan.sample_period.filter(|_| recording.is_some()),
            recording,
            sampled: None,
            uploads: Vec::new(),
            told_of_no_end: false,
            longest_delay_ns: 0,
            started: 0,
            wall_start,
            last_word: link_start,
            silent_answers: 0,
            calls,
            telling: plan.by_hand.into(),
            cut_link_us: plan.cut_link_us,
            keeps_flash,
            last_call: link_start,
            plant,
        })
    }

    /// Follows the robot until the plan is fulfilled; answers whether the person ended it before.
    fn follow(
        &mut self,
        interrupt: Interrupt,
        watch: &mut dyn FnMut(Heard<'_>),
    ) -> Result<bool, RunError> {
        {
            let _hold = self.hold();
            self.check_features()?;
            self.subscribe()?;
            let built_in = self.link(|robot| robot.built_in())?;
            if let Err(error) = &self.log
                && built_in.features.has(Feature::Log)
            {
                watch(Heard::Warning(&error.to_string()));
            }
        }
        self.upload_next(watch)?;
        let mut exchanges = self.pace.exchanges();
        // As often as it was looked at: a process that was suspended has not looked.
        let mut stood = Duration::ZERO;
        loop {
            let looked = Instant::now();
            if interrupt.is_requested() {
                return Ok(true);
            }
            self.board.check()?;
            self.link(|robot| robot.listen(LISTEN_TIME))?;
            self.take_events(watch)?;
            self.call()?;
            self.tell()?;
            self.tell_of_no_end(watch);
            let is_told = self.story.has_ended() || self.story.fault().is_some();
            if (is_told || self.is_over_in_silence()) && !self.is_needed() {
                return Ok(false);
            }
            if let Some(next) = self.missions.get(self.uploads.len())
                && self.is_time_for(next.at_us)
            {
                self.upload_next(watch)?;
                self.take_events(watch)?;
            }
            if self.pace.exchanges() != exchanges {
                exchanges = self.pace.exchanges();
                stood = Duration::ZERO;
            } else if stood > STANDSTILL_LIMIT {
                return Err(RunError::Standstill {
                    robot_us: self.pace.robot_us(),
                    console: String::new(),
                });
            } else {
                stood += looked.elapsed().min(LISTEN_TIME);
            }
        }
    }

    /// Whether other boards of a system need what this one does up to the end.
    fn is_needed(&self) -> bool {
        let is_before = |until_us| self.pace.robot_us() <= until_us;
        self.plant.system().is_some() && self.until_us.is_some_and(is_before)
    }

    /// Says it once where the last mission has finished and the run has no end of its own.
    fn tell_of_no_end(&mut self, watch: &mut dyn FnMut(Heard<'_>)) {
        let is_last = self.uploads.len() == self.missions.len();
        let goes_on = self.until_us.is_none() && is_last && self.story.has_finished();
        if goes_on && !std::mem::replace(&mut self.told_of_no_end, true) {
            watch(Heard::FinishedWithoutEnd);
        }
    }

    /// Whether the time of interest has passed without the macro step that would have ended the
    /// story: in a stop or in the safe state robot time goes on, and the machine does not.
    fn is_over_in_silence(&mut self) -> bool {
        let over = match self.gate() {
            None => self
                .until_us
                .is_some_and(|until_us| self.pace.robot_us() > until_us),
            Some(board) => board.waits_at_gate() && !self.missions_left_in_time(),
        };
        if !over || self.link != LinkWay::Uart {
            return over && self.robot.clock().since(self.last_word) > SILENCE_AT_END;
        }
        if self.silent_answers < SILENT_ANSWERS {
            let _hold = self.hold();
            // One that does not answer any more says nothing more, either.
            let answers = self.robot.status().is_ok();
            self.silent_answers += if answers { 1 } else { SILENT_ANSWERS };
            // What came with the answer, or before it, is looked at first.
            return false;
        }
        true
    }

    /// Lets the robot hear that this program is there, if it wants to and the link is not cut.
    fn call(&mut self) -> Result<(), RunError> {
        let is_cut = |at_us: u64| self.pace.robot_us() >= at_us;
        if !self.calls
            || self.cut_link_us.is_some_and(is_cut)
            || self.robot.clock().since(self.last_call) < CALL_INTERVAL
        {
            return Ok(());
        }
        self.last_call = self.robot.clock().now();
        self.link(|robot| robot.status())?;
        Ok(())
    }

    /// Tells the list of behaviours what is due.
    fn tell(&mut self) -> Result<(), RunError> {
        let robot_us = self.pace.robot_us();
        if self.cut_link_us.is_some_and(|at_us| robot_us >= at_us) {
            return Ok(());
        }
        // Nothing is left of the telling if it fails, for the run ends then.
        let mut telling = std::mem::take(&mut self.telling);
        self.link(|robot| telling.tell(robot, robot_us))?;
        self.telling = telling;
        Ok(())
    }

    /// Whether another mission is to take over before the end.
    fn missions_left_in_time(&self) -> bool {
        self.missions
            .get(self.uploads.len())
            .is_some_and(|next| self.until_us.is_none_or(|until_us| next.at_us <= until_us))
    }

    /// Whether a mission planned for that robot time is to be uploaded now.
    fn is_time_for(&self, at_us: u64) -> bool {
        if self.until_us.is_some_and(|until_us| at_us > until_us) {
            return false;
        }
        match self.gate() {
            None => self.pace.robot_us() >= at_us,
            // It waits there by itself.
            Some(board) => board.waits_at_gate(),
        }
    }

    /// The board, if it waits by itself for missions: one whose robot time cannot be held for as
    /// long as an upload takes on the wall.
    fn gate(&self) -> Option<&HostBoard> {
        match (&self.board, self.link) {
            (RunningBoard::Host(board), LinkWay::Uart) => Some(board),
            (RunningBoard::Host(_), LinkWay::Exchange | LinkWay::Usb)
            | (RunningBoard::Emulated(_), _) => None,
        }
    }

    /// Holds robot time while a request is open, where the line's time is another.
    fn hold(&self) -> Option<Hold> {
        (self.link == LinkWay::Uart).then(|| self.pace.hold())
    }

    fn upload_next(&mut self, watch: &mut dyn FnMut(Heard<'_>)) -> Result<(), RunError> {
        let index = self.uploads.len();
        let Some(Planned {
            mission,
            handover,
            warm,
            ..
        }) = self.missions.get(index)
        else {
            return Ok(());
        };
        watch(Heard::UploadBegins(mission));
        let hold = self.hold();
        let next_at_us = self.missions.get(index + 1).map(|next| next.at_us);
        let wrap = |cause: ClientError| match cause.refusal() {
            Some(error) if is_about_the_mission(error) => RunError::Refused {
                file: mission.file.clone(),
                reason: mission.refusal(error),
            },
            _ => RunError::Link {
                cause,
                console: String::new(),
            },
        };
        count_last(&mut self.robot, &self.missions, &mut self.uploads).map_err(wrap)?;
        let started = self.robot.clock().now();
        let before = self.robot.status().map_err(wrap)?;
        let mut progress = |bytes| watch(Heard::Uploaded(bytes));
        self.robot
            .stage(&mission.blob, &mut progress)
            .map_err(wrap)?;
        // Where something is to happen next. At the end the board is to wait, too: its counters are
        // of interest as they are then.
        let end_us = self.until_us.map(|until_us| until_us.saturating_add(1));
        let next_us = next_at_us.into_iter().chain(end_us).min();
        match self.gate() {
            Some(board) if board.waits_at_gate() => board.open_gate(next_us),
            Some(board) => board.set_gate(next_us),
            None => {}
        }
        self.robot
            .commit(Swap {
                warm: *warm,
                ..Swap::default()
            })
            .map_err(wrap)?;
        let upload_s = self.robot.clock().since(started).as_secs_f64();
        let missed = self.robot.status().map_err(wrap)?.missed;
        drop(hold);
        // The one who waits for the next moment looks at the clock only now and then.
        if self.link == LinkWay::Uart && self.gate().is_none() {
            self.pace.hold_from(next_us);
        }
        let summary = MissionSummary {
            file: mission.file.display().to_string(),
            hash: mission.hash_text(),
            bytes: mission.blob.len(),
            started_s: 0.0,
            upload_s,
            slots_missed_in_upload: u64::from(missed.wrapping_sub(before.missed)),
            slots: Vec::new(),
            links: Vec::new(),
            handover: handover.clone(),
        };
        self.longest_delay_ns = self.longest_delay_ns.max(before.max_delay_ns);
        watch(Heard::UploadEnds(&summary));
        self.uploads.push(summary);
        self.sample(index, watch)
    }

    /// Asks for values on the nets of the mission that was brought to the robot, if the recording
    /// is to keep them. A robot that has none to tell of is recorded without.
    fn sample(&mut self, index: usize, watch: &mut dyn FnMut(Heard<'_>)) -> Result<(), RunError> {
        let (Some(period), Some(recording), Some(planned)) = (
            self.sample_period,
            &mut self.recording,
            self.missions.get(index),
        ) else {
            return Ok(());
        };
        let _hold = (self.link == LinkWay::Uart).then(|| self.pace.hold());
        let Mission { hash, blob, .. } = &planned.mission;
        match Subscription::of_kept(&mut self.robot, blob, period) {
            Ok(None) => Ok(()),
            Ok(Some(kept)) => {
                recording
                    .nets(*hash, kept.subscription.nets())
                    .map_err(RunError::Recording)?;
                if let Some(left_out) = kept.left_out() {
                    watch(Heard::Warning(&left_out));
                }
                self.sampled = Some((*hash, kept.subscription));
                Ok(())
            }
            Err(error) => match error.of_line() {
                Ok(cause) => Err(RunError::Link {
                    cause,
                    console: String::new(),
                }),
                Err(answer) => {
                    watch(Heard::Warning(&format!(
                        "the recording is without values: {answer}"
                    )));
                    Ok(())
                }
            },
        }
    }

    fn take_events(&mut self, watch: &mut dyn FnMut(Heard<'_>)) -> Result<(), RunError> {
        // The end of what was recorded is known a row before it comes: before any event that is
        // after it.
        let until_us = self.plant.until_us();
        if until_us != self.until_us {
            self.until_us = until_us;
            self.story.ends_at(until_us);
            if let Some(recording) = &mut self.recording {
                recording.ends_at(until_us);
            }
        }
        for event in self.robot.take_events() {
            match event {
                StreamEvent::Trace(records) => {
                    self.last_word = self.robot.clock().now();
                    self.silent_answers = 0;
                    self.take_records(&records, watch)?;
                }
                StreamEvent::Values { .. } => {
                    if let (Some(recording), Some((mission, subscription))) =
                        (&mut self.recording, &self.sampled)
                        && let Some(sample) = subscription.raw(*mission, &event)
                    {
                        recording.sample(sample).map_err(RunError::Recording)?;
                    }
                }
                // Nobody asked for news. Samples that did not come are missing where they were.
                StreamEvent::StatusEvent(_)
                | StreamEvent::ValuesEnded { .. }
                | StreamEvent::Gap {
                    channel: Channel::Values,
                    ..
                } => {}
                StreamEvent::Log(bytes) => {
                    let lines = self.log.as_mut().map(|log| log.lines(&bytes));
                    for line in lines.iter().flatten() {
                        watch(Heard::Log(line));
                    }
                }
                StreamEvent::Gap {
                    channel: Channel::Trace,
                    missing,
                } => {
                    // What comes after the end is of no interest.
                    if !self.story.has_ended() {
                        return Err(RunError::TraceGap { missing });
                    }
                }
                StreamEvent::LinesLost(lines) => {
                    let lines = counted(lines.into(), "line");
                    watch(Heard::Warning(&format!("{lines} of the log lost")));
                }
                StreamEvent::Gap {
                    channel: Channel::Log,
                    missing,
                } => {
                    if let Ok(log) = &mut self.log {
                        log.gap();
                    }
                    watch(Heard::Warning(&format!(
                        "{missing} pieces of the log did not come through"
                    )));
                }
                StreamEvent::Record(records) => {
                    let Some(recording) = &mut self.recording else {
                        continue;
                    };
                    recording.records(&records).map_err(RunError::Recording)?;
                    if recording.take_lost() {
                        self.subscribe()?;
                        watch(Heard::Warning("the recording has a gap"));
                    }
                }
                StreamEvent::Gap {
                    channel: Channel::Record,
                    missing,
                } => {
                    if let Some(recording) = &mut self.recording {
                        recording.gap(missing).map_err(RunError::Recording)?;
                    }
                    // It begins anew with what the machine is now.
                    self.subscribe()?;
                    watch(Heard::Warning(&format!(
                        "the recording has a gap: {missing} records did not come through"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Fails where the plan needs what the robot's firmware was built without, before anything of
    /// it is done.
    fn check_features(&mut self) -> Result<(), RunError> {
        let records = self.recording.is_some();
        let goes_warm = self.missions.iter().any(|planned| planned.warm);
        let has_links = self
            .missions
            .iter()
            .any(|planned| planned.mission.has_links);
        for (feature, is_needed) in [
            (Feature::Record, records),
            (Feature::Warm, goes_warm),
            (Feature::Links, has_links),
            (Feature::Store, self.keeps_flash),
        ] {
            if is_needed {
                self.link(|robot| robot.require(feature))?;
            }
        }
        Ok(())
    }

    /// Asks for what is wanted of the robot; where it keeps no log, for all but that.
    fn subscribe(&mut self) -> Result<(), RunError> {
        let record = self.recording.is_some();
        self.link(|robot| {
            let log = robot.built_in()?.features.has(Feature::Log);
            robot.subscribe(Streams {
                trace: true,
                log,
                record,
            })
        })
    }

    /// Waits for what was recorded and is not here yet, while robot time is held.
    fn end_recording(&mut self, watch: &mut dyn FnMut(Heard<'_>)) -> Result<(), RunError> {
        const LONGEST_WAIT: Duration = Duration::from_secs(5);
        let mut waited = Duration::ZERO;
        while self.recording.is_some() && waited < LONGEST_WAIT {
            let pending = match self.robot.status() {
                Ok(status) => status.record_pending,
                // A robot that fell silent at the very end has told all that it will.
                Err(_) => false,
            };
            if !pending {
                break;
            }
            let began = self.robot.clock().now();
            self.link(|robot| robot.listen(LISTEN_TIME))?;
            waited += self.robot.clock().since(began).min(LISTEN_TIME);
        }
        self.take_events(watch)
    }

    fn take_records(
        &mut self,
        records: &[u8],
        watch: &mut dyn FnMut(Heard<'_>),
    ) -> Result<(), RunError> {
        let mut rest = records;
        while !rest.is_empty() {
            let record = TraceEvent::take(&mut rest).map_err(|_| RunError::BadTrace)?;
            if let TraceEvent::Started { mission, start_us } = record {
                self.mission_starts(mission, start_us)?;
            }
            self.story
                .record(&record, &mut |told| watch(Heard::Happened(&told)))?;
        }
        Ok(())
    }

    fn mission_starts(&mut self, hash: u32, start_us: u64) -> Result<(), RunError> {
        // The same file may be planned twice: the next one in turn is meant.
        let index = self.started.min(self.missions.len().saturating_sub(1));
        let planned = self
            .missions
            .get(index)
            .filter(|planned| planned.mission.hash == hash)
            .ok_or(RunError::BadTrace)?;
        self.story.mission(
            &planned.mission.name,
            Arc::clone(&planned.mission.directory),
            start_us,
        )?;
        if let Some(upload) = self.uploads.get_mut(index) {
            upload.started_s = start_us as f64 / 1e6;
        }
        self.started = index + 1;
        Ok(())
    }

    /// One request, or one wait, while robot time is held only for requests.
    fn link<T>(
        &mut self,
        request: impl FnOnce(&mut LinkClient<Box<dyn ByteLink>>) -> Result<T, ClientError>,
    ) -> Result<T, RunError> {
        request(&mut self.robot).map_err(|cause| RunError::Link {
            cause,
            console: String::new(),
        })
    }

    /// An error of the link or the board, with what the board printed last.
    fn with_console(mut self, error: RunError) -> RunError {
        // A link that ends because the emulator did: the emulator's reason is the better one.
        if let Err(ended) = self.board.check() {
            return ended.into();
        }
        let console = self.board.console();
        match error {
            RunError::Link { cause, .. } => RunError::Link { cause, console },
            RunError::Standstill { robot_us, .. } => RunError::Standstill { robot_us, console },
            other => other,
        }
    }

    fn finish(
        mut self,
        interrupted: bool,
        watch: &mut dyn FnMut(Heard<'_>),
    ) -> Result<Run<W>, RunError> {
        let status = {
            let _hold = self.hold();
            self.end_recording(watch)?;
            // A robot that fell silent at the very end has told all that matters.
            let status = self.robot.status().ok();
            if status.is_some() {
                let _ = count_last(&mut self.robot, &self.missions, &mut self.uploads);
            }
            status
        };
        let link_retries = self.robot.counts().retries;
        drop(self.board);
        let plant = self.plant.at_end();
        let robot_us = self.pace.robot_us();
        let end_us = match self.until_us {
            Some(until_us) if !interrupted && self.story.fault().is_none() => until_us,
            Some(until_us) => robot_us.min(until_us),
            None => robot_us,
        };
        let steps = self.story.steps();
        let told = self
            .story
            .finish(end_us)?
            .ok_or_else(|| io::Error::other("the trace was lost"))?;
        let recorded = match self.recording {
            Some(mut recording) => {
                recording.ends(&told.ends).map_err(RunError::Recording)?;
                Some(recording.finish(steps).map_err(RunError::Recording)?.1)
            }
            None => None,
        };
        let entered = Entered {
            seed: self.seed,
            missions: self
                .missions
                .iter()
                .take(self.started)
                .map(|planned| planned.mission.hash)
                .collect(),
            starts_us: told.missions.iter().map(|it| it.start_us).collect(),
            ends: told.ends.clone(),
        };
        let wall = self.wall_start.elapsed();
        // What repeats to the byte names no time that does not.
        let wall_time = (self.link == LinkWay::Uart).then_some(wall);
        let counted = status.map_or_else(Summary::default, Summary::of_status);
        let summary = Summary {
            board: self.board_name.to_owned(),
            world: plant.world().name.clone(),
            robot_time_s: end_us as f64 / 1e6,
            wall_time_s: wall_time.map(|wall| wall.as_secs_f64()),
            distance_m: plant.distance_m(),
            end: Some(EndPose::of(&plant)),
            interrupted,
            collisions: plant.collisions(),
            avoidable: plant.statistics().avoidable(),
            touches: TouchSummary::all_of(&plant),
            hardest_collision_m_per_s: (plant.collisions() > 0)
                .then(|| plant.hardest_collision_m_per_s()),
            rooms_entered: plant.statistics().rooms_entered().to_vec(),
            macro_steps: told.counts.macro_steps,
            transitions: told.counts.transitions,
            fault: told
                .fault
                .clone()
                .or_else(|| status.and_then(|status| safe_mode(&status))),
            finished_s: told.finished_us.map(|at_us| at_us as f64 / 1e6),
            slots_executed: self.plant.exchanges(),
            longest_dispatch_delay_ns: self.longest_delay_ns.max(counted.longest_dispatch_delay_ns),
            missions: self.uploads,
            link_retries,
            ..counted
        };
        Ok(Run {
            summary,
            told,
            plant,
            entered,
            recorded,
            wall,
            interrupted,
        })
    }
}

/// Asks what was counted of the mission that was brought to the robot last, if there is one.
fn count_last<L: ByteLink>(
    robot: &mut LinkClient<L>,
    missions: &[Planned],
    uploads: &mut [MissionSummary],
) -> Result<(), ClientError> {
    let planned = uploads.len().checked_sub(1);
    let planned = planned.and_then(|index| missions.get(index));
    let (Some(last), Some(planned)) = (uploads.last_mut(), planned) else {
        return Ok(());
    };
    last.slots = slot_reports(robot)?;
    // A mission without slots is none that runs.
    if !last.slots.is_empty() {
        last.links = CountedLinks::of_blob(&planned.mission.blob).ask(robot)?;
    }
    Ok(())
}

/// What the robot has counted of each slot of its mission.
fn slot_reports<L: ByteLink>(robot: &mut LinkClient<L>) -> Result<Vec<SlotReport>, ClientError> {
    let mut slots = Vec::new();
    for index in 0..=u8::MAX {
        match robot.slot_counters(index) {
            Ok(counters) => slots.push(SlotReport::from(counters)),
            // There are no more, or there is no mission any more.
            Err(error)
                if matches!(
                    error.refusal(),
                    Some(LinkError::NoSuchIndex | LinkError::NoMission)
                ) =>
            {
                break;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(slots)
}

/// Whether a refusal says something about the mission, not about the link or the robot's present
/// state.
fn is_about_the_mission(error: LinkError) -> bool {
    matches!(
        error,
        LinkError::Invalid { .. }
            | LinkError::UnknownTask { .. }
            | LinkError::SignatureDiffers { .. }
            | LinkError::TooManyInstances { .. }
            | LinkError::CapacityExceeded { .. }
            | LinkError::NetTypeDiffers { .. }
            | LinkError::ParamOutOfRange { .. }
            | LinkError::PayloadDiffers { .. }
    )
}

fn safe_mode(status: &Status) -> Option<String> {
    match status.mode {
        Mode::Safe(reason) => Some(safe_reason(reason).to_owned()),
        Mode::EmergencyStopped if status.stop_pressed => {
            Some("the emergency stop's button is pressed".to_owned())
        }
        Mode::EmergencyStopped => Some("an emergency stop is latched".to_owned()),
        Mode::Empty | Mode::Running | Mode::Stopped => None,
    }
}

/// A recording of a run, with all of its missions.
fn begin_recording(
    out: Box<dyn Write>,
    head: Header,
    until_us: Option<u64>,
    missions: &[Planned],
) -> io::Result<RecordingWriter<Box<dyn Write>>> {
    let mut recording = RecordingWriter::new(out, head, until_us)?;
    for Planned { mission, .. } in missions {
        let period_us = mission.directory.interpreter_period_us();
        recording.mission(&mission.name, mission.hash, &mission.blob, period_us)?;
    }
    Ok(recording)
}

fn check_replay(replay: &Entered, missions: &[Planned]) -> Result<(), RunError> {
    let given: Vec<u32> = missions
        .iter()
        .map(|planned| planned.mission.hash)
        .collect();
    if replay.missions == given {
        return Ok(());
    }
    let listed = |hashes: &[u32]| {
        let texts: Vec<String> = hashes.iter().map(|hash| hash_text(*hash)).collect();
        texts.join(", ")
    };
    Err(RunError::OtherMissions {
        recorded: listed(&replay.missions),
        given: listed(&given),
    })
}
