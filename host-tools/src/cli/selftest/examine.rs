//! A robot measures itself: with a mission whose slots start as often as they can, and with one
//! that looks at its body. Both run on trial, so that the mission before comes back whatever
//! happens; and the robot stands behind each.

use std::time::{Duration, Instant};

use anyhow::anyhow;
use esm_link::features::Feature;
use esm_link::message::{LinkError, Mode, Status, Swap};
use esm_link::selftest::Measures;

use super::missions::{
    BODY_NAME, CLOCK_NAME, Measured, OVER_MS, Parts, STANDS_MS, TASKS_NAME, Texts,
};
use crate::boards;
use crate::cli::exit::CommandError;
use crate::cli::own_drive::compiled_with;
use crate::cli::robot::{self, Robot};
use crate::counters::SlotReport;
use crate::link_client::{ClientError, RobotInfo};
use crate::parameters::Value;
use crate::reading::mode_words;
use crate::run::mission::Mission;
use crate::run::story;
use crate::selftest::Finding;
use crate::selftest::board::{self, ClockLook, Kept, RateTried};
use crate::selftest::body::{self, SonarSample};
use crate::selftest::wheels::{self, Seen, WheelSample};
use crate::values::{Catalogue, Reading, Subscription, Told, Watched};

/// How long the missions may be on trial, in milliseconds: several times what they take.
const TRIAL_MS: u32 = 120_000;

/// Activations that are counted.
const ACTIVATIONS: u32 = 10_000;
/// Robot time within which they must be there, and requests between two looks whether they are.
const ACTIVATIONS_LIMIT: Duration = Duration::from_secs(60);
const REQUESTS_AT_ONCE: u64 = 20;

/// Rates of a line that are tried, in baud.
const RATES: [u32; 5] = [9_600, 57_600, 230_400, 460_800, 921_600];
/// How long the robot's end has another rate, how long a change may take it (it is done between
/// slots), and how long it is asked meanwhile.
const RATE_TIME: Duration = Duration::from_millis(2_000);
const RATE_CHANGE: Duration = Duration::from_millis(250);
const RATE_ANSWERS: Duration = Duration::from_millis(1_200);

/// How often the clock is asked at the beginning, and at the end.
const CLOCK_LOOKS: usize = 8;
/// How exactly the host knows when an answer came, in seconds.
const COARSE_S: f64 = 0.000_5;

/// How often values are sampled while the robot stands, and while its wheels turn.
const STANDING_PERIOD: Duration = Duration::from_millis(40);
const TURNING_PERIOD: Duration = Duration::from_millis(20);
/// The robot stops to stand so long before its wheels turn that what is asked for instead is known
/// by then, in microseconds.
const CHANGE_US: u64 = 400_000;
/// How long a wait for samples may last, and how much longer than it should all of them.
const LISTEN_TIME: Duration = Duration::from_millis(20);
const SAMPLES_LIMIT: Duration = Duration::from_secs(20);
/// How often it is looked whether the robot still runs.
const LOOK_TIME: Duration = Duration::from_millis(500);

const US_PER_S: f64 = 1e6;

/// Who sees the wheels.
pub trait Eyes {
    /// What must be known before anything turns.
    ///
    /// # Errors
    /// The person has had enough.
    fn before(&mut self) -> Result<(), CommandError>;

    /// How far the wheels have turned, left and right, in any unit, where somebody knows that at
    /// each moment.
    fn turned(&self) -> Option<[f64; 2]>;

    /// What was seen, where somebody is asked afterwards.
    ///
    /// # Errors
    /// The person has had enough.
    fn seen(&mut self) -> Result<Option<Seen>, CommandError>;
}

/// A robot that measures itself.
pub struct Examination<'r> {
    robot: &'r mut Robot,
    info: &'r RobotInfo,
    parts: Parts<'r>,
    /// Rate of the line, where it has one.
    baud: Option<u32>,
    /// When it began, on the line's clock.
    begun: Instant,
    /// The mission that is on trial by us.
    on_trial: Option<u32>,
    findings: Vec<Finding>,
}

/// Frames that went over the line, and those that were bad.
struct Frames {
    requests: u64,
    bad_before: u64,
}

impl<'r> Examination<'r> {
    /// An examination of a robot whose firmware has these parts. `baud` is the line's rate.
    pub fn new(
        robot: &'r mut Robot,
        info: &'r RobotInfo,
        parts: Parts<'r>,
        baud: Option<u32>,
    ) -> Self {
        Examination {
            begun: robot.clock().now(),
            robot,
            info,
            parts,
            baud,
            on_trial: None,
            findings: Vec::new(),
        }
    }

    /// Carries it out. Whatever comes of it, the robot stands afterwards, and has the mission that
    /// it had.
    ///
    /// # Errors
    /// What kept it from being carried out.
    pub fn carry_out(mut self, eyes: &mut dyn Eyes) -> Result<Vec<Finding>, CommandError> {
        let examined = self.examine(eyes);
        // Also after Ctrl-C, but then not for long.
        robot::hold_out(self.robot);
        let left = self.leave();
        match (examined, left) {
            (Ok(()), left) => left.map(|()| self.findings),
            (Err(error), Ok(())) => Err(error),
            // Who has taken the line over has stopped it.
            (Err(error), Err(_)) if robot::is_taken_over(&error) => Err(error),
            (Err(error), Err(left)) => Err(CommandError::World(anyhow!(
                "{error}; and the robot could not be stopped ({left}): use its button, or switch it off"
            ))),
        }
    }

    fn examine(&mut self, eyes: &mut dyn Eyes) -> Result<(), CommandError> {
        // Whatever it does now, it stands while it is looked at.
        self.robot.stop()?;
        let keeps = self.robot.built_in()?.features.has(Feature::Store);
        self.other_rates()?;
        let mut mission_kept = self.slots()?;
        if mission_kept == Kept::No {
            let why = "not measured: the robot takes no mission as long as its flash takes none";
            for name in ["slots", "sonars", "battery", "gyroscope"]
                .into_iter()
                .chain(wheels::NAMES)
            {
                self.findings.push(Finding::not_measured(name, why));
            }
        } else {
            self.body(eyes)?;
        }
        if !keeps {
            mission_kept = Kept::NotTried("not measured: the firmware keeps nothing");
        }
        let record_kept = match keeps {
            true => self.keep_record()?,
            false => Kept::NotTried("not measured: the firmware keeps nothing"),
        };
        let status = self.robot.status()?;
        self.findings.extend(board::flash(
            mission_kept,
            record_kept,
            status.flash.as_ref(),
        ));
        let known = boards::find(&self.info.board).ok();
        let room = known.and_then(|board| board.firmware?.stack_bytes);
        self.findings.push(board::stack(status.stack_bytes, room));
        self.critical_section()
    }

    /// The longest critical section, of all that was done until now.
    fn critical_section(&mut self) -> Result<(), CommandError> {
        let measured = match self.measures()? {
            Some(measures) => measures.critical_section_ns,
            None => None,
        };
        self.findings.push(match measured {
            Some(longest_ns) => board::critical_section(f64::from(longest_ns) / 1e3),
            None => Finding::not_measured(
                "critical_section",
                "not measured by this board; one that masks the slot timer would show in `slots.late`",
            ),
        });
        Ok(())
    }

    /// What the board has measured of itself, where it does.
    fn measures(&mut self) -> Result<Option<Measures>, CommandError> {
        match self.robot.built_in()?.features.has(Feature::Selftest) {
            true => Ok(Some(self.robot.measures()?)),
            false => Ok(None),
        }
    }

    /// Other rates of the line, while the robot is stopped.
    fn other_rates(&mut self) -> Result<(), CommandError> {
        let own = self.measures()?.and_then(|it| it.baud).zip(self.baud);
        let why = match own {
            Some((own, baud)) if own == baud => None,
            Some((own, _)) => Some(format!(
                "not measured: the board says that its line has {own} baud, and this computer has another rate"
            )),
            None => Some("not measured: the line of this board has one rate, or none".to_owned()),
        };
        if let Some(why) = why {
            let row = Finding::not_measured("line.other_rates", why);
            self.findings.push(row);
            return Ok(());
        }
        let own = self.baud.unwrap_or_default();
        let mut tried = Vec::new();
        for baud in RATES.into_iter().filter(|baud| *baud != own) {
            tried.extend(self.tried_rate(baud, own)?);
        }
        self.findings.extend(board::other_rates(own, &tried));
        Ok(())
    }

    /// Tries a rate; none where one of both ends cannot have it. Whatever comes of it, both ends
    /// have their own again.
    fn tried_rate(&mut self, baud: u32, own: u32) -> Result<Option<RateTried>, CommandError> {
        match self.robot.try_rate(baud, RATE_TIME) {
            Ok(()) => {}
            Err(error) if error.refusal() == Some(LinkError::NotBuiltIn) => return Ok(None),
            Err(error) => return Err(error.into()),
        }
        let clock = self.robot.clock().clone();
        let begun = clock.now();
        clock.pause(RATE_CHANGE);
        let here = self.robot.set_rate(baud);
        let tried = match here {
            Ok(()) => self.ask_at_rate(baud, begun).map(Some),
            Err(_) => Ok(None),
        };
        // The robot has its own again by itself.
        clock.pause((RATE_TIME + RATE_CHANGE * 2).saturating_sub(clock.since(begun)));
        self.robot.limit_waits(None);
        let back = self.robot.set_rate(own);
        let tried = tried?;
        if tried.is_some() {
            back.map_err(|error| {
                CommandError::World(anyhow!("the line does not take its own rate back: {error}"))
            })?;
        }
        Ok(tried)
    }

    /// Asks at another rate, as long as the robot has it.
    fn ask_at_rate(&mut self, baud: u32, begun: Instant) -> Result<RateTried, CommandError> {
        let clock = self.robot.clock().clone();
        self.robot.limit_waits(Some(RATE_ANSWERS));
        // How long an answer takes at this rate is learnt by the first, which counts only where it
        // does not come.
        let mut unanswered = u64::from(self.robot.robot_us().is_err());
        let bad_before = self.bad_frames();
        let mut requests = unanswered;
        while clock.since(begun) < RATE_CHANGE + RATE_ANSWERS && unanswered == 0 {
            requests += 1;
            match self.robot.robot_us() {
                Ok(_) => {}
                Err(error @ (ClientError::Interrupted { .. } | ClientError::Line(_))) => {
                    return Err(error.into());
                }
                Err(_) => unanswered = 1,
            }
        }
        let frames = 2 * requests;
        let bad = (self.bad_frames() - bad_before).max(unanswered);
        Ok(RateTried { baud, frames, bad })
    }

    /// The robot stands, and has the mission that it had.
    fn leave(&mut self) -> Result<(), CommandError> {
        self.robot.stop()?;
        if let Some(mission) = self.on_trial {
            let done = self.robot.fall_back(mission);
            let refusal = done.as_ref().err().and_then(ClientError::refusal);
            // It has gone back by itself, or has never come to it.
            if !matches!(refusal, Some(LinkError::NotOnTrial | LinkError::NoMission)) {
                done?;
            }
            self.on_trial = None;
        }
        Ok(())
    }

    /// Gives the robot one of the missions, on trial. Answers whether its flash took it.
    fn give(&mut self, mission: &Mission) -> Result<Kept, CommandError> {
        self.robot.stage(&mission.blob, &mut |_| ())?;
        let swap = Swap {
            warm: false,
            trial_ms: TRIAL_MS,
        };
        // From here on it may be, whatever is heard of it.
        self.on_trial = Some(mission.hash);
        match self.robot.commit(swap) {
            Ok(_) => Ok(Kept::Yes),
            Err(error) if error.refusal() == Some(LinkError::FlashRefused) => {
                self.on_trial = None;
                Ok(Kept::No)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Clock, line and slots.
    fn slots(&mut self) -> Result<Kept, CommandError> {
        let mission = compiled(CLOCK_NAME, &self.parts.slots_mission())?;
        let mut frames = Frames {
            requests: 0,
            bad_before: self.bad_frames(),
        };
        let kept = self.give(&mission)?;
        let begin = self.look_at_clock(&mut frames)?;
        if kept == Kept::Yes {
            self.robot.start()?;
            self.load_line(&mut frames)?;
            let counters = self.count_slots(&mission, &mut frames)?;
            self.findings.extend(board::slots(&counters, ACTIVATIONS));
        } else {
            self.load_line_for(Duration::from_secs(10), &mut frames)?;
        }
        let end = self.look_at_clock(&mut frames)?;
        self.findings.push(board::clock(&begin, &end, COARSE_S));
        let bad = self.bad_frames() - frames.bad_before;
        // A request and its answer.
        let all = 2 * frames.requests;
        self.findings.push(board::line(all, bad, self.baud));
        self.leave()?;
        Ok(kept)
    }

    fn bad_frames(&self) -> u64 {
        let counts = self.robot.counts();
        counts.retries.max(counts.bad_frames)
    }

    fn look_at_clock(&mut self, frames: &mut Frames) -> Result<Vec<ClockLook>, ClientError> {
        let clock = self.robot.clock().clone();
        let begun = self.begun;
        (0..CLOCK_LOOKS)
            .map(|_| {
                let asked = clock.now();
                let said_us = self.robot.robot_us()?;
                frames.requests += 1;
                Ok(ClockLook {
                    asked_s: asked.saturating_duration_since(begun).as_secs_f64(),
                    took_s: clock.since(asked).as_secs_f64(),
                    said_s: said_us as f64 / US_PER_S,
                })
            })
            .collect()
    }

    /// Asks without a pause until the activations are there.
    fn load_line(&mut self, frames: &mut Frames) -> Result<(), CommandError> {
        let clock = self.robot.clock().clone();
        let begun = clock.now();
        loop {
            self.ask_at_once(frames)?;
            let executed = self.require_running()?.executed;
            frames.requests += 1;
            // The interpreter's slot answers what is counted of slots, and its macro step is late
            // for it: so that is asked where all slots together have executed enough.
            let is_enough = executed >= ACTIVATIONS && {
                frames.requests += 1;
                self.robot.slot_counters(0)?.executed >= ACTIVATIONS
            };
            if is_enough || clock.since(begun) > ACTIVATIONS_LIMIT {
                return Ok(());
            }
        }
    }

    /// The same without a mission.
    fn load_line_for(&mut self, time: Duration, frames: &mut Frames) -> Result<(), CommandError> {
        let clock = self.robot.clock().clone();
        let begun = clock.now();
        while clock.since(begun) < time {
            self.ask_at_once(frames)?;
        }
        Ok(())
    }

    /// What brings long answers, one after the other.
    fn ask_at_once(&mut self, frames: &mut Frames) -> Result<(), CommandError> {
        let before = frames.requests;
        let mut index = 0;
        while frames.requests - before < REQUESTS_AT_ONCE {
            let text = self.robot.task_declaration(index)?;
            // A part has 128 bytes at most, and the last one is empty.
            frames.requests += text.len() as u64 / 128 + 2;
            index = (index + 1) % self.info.task_types.max(1);
        }
        Ok(())
    }

    fn count_slots(
        &mut self,
        mission: &Mission,
        frames: &mut Frames,
    ) -> Result<Vec<SlotReport>, CommandError> {
        let count = 1 + u8::from(mission.task_names.iter().any(|it| it == "LinkMonitor"));
        (0..count)
            .map(|slot| {
                frames.requests += 1;
                Ok(SlotReport::from(self.robot.slot_counters(slot)?))
            })
            .collect()
    }

    /// # Errors
    /// Somebody has stopped it, or something has.
    fn require_running(&mut self) -> Result<Status, CommandError> {
        let status = self.robot.status()?;
        if status.mode != Mode::Running || status.mission != self.on_trial {
            let (mode, _) = mode_words(status.mode);
            let gave_up = status
                .fell_back
                .filter(|it| Some(it.mission) == self.on_trial);
            let why = gave_up.map_or_else(
                || "somebody has stopped it, or `esm status` says why".to_owned(),
                |it| format!("it gave it up: {}", story::fall_back_reason(it.reason)),
            );
            return Err(CommandError::Input(anyhow!(
                "the robot does not run its selftest any more, it is {mode}: {why}"
            )));
        }
        Ok(status)
    }

    /// Sonars, battery, gyroscope, wheels.
    fn body(&mut self, eyes: &mut dyn Eyes) -> Result<(), CommandError> {
        if self.parts.drives() {
            eyes.before()?;
        }
        let mission = compiled(BODY_NAME, &self.parts.body_mission())?;
        if self.give(&mission)? == Kept::No {
            return Err(CommandError::Input(anyhow!(
                "the robot's flash took one mission and refuses the next: `esm status` says how it is"
            )));
        }
        let verified = esm_core::verify(mission.blob.as_slice());
        let verified =
            verified.map_err(|(_, refusal)| CommandError::Input(anyhow!("{refusal:?}")))?;
        let nets = Catalogue::read(self.robot, &verified).map_err(values_error)?;
        self.robot.start()?;
        let standing = self.samples(
            &nets,
            &[
                "of_Ring/Ring.ranges",
                "of_Measure/Measure.battery",
                "of_Rate/Rate.yaw_rate",
            ],
            STANDING_PERIOD,
            u64::from(STANDS_MS) * 1_000 - CHANGE_US,
            &|| None,
        )?;
        let driven = if self.parts.drives() {
            let over_us = u64::from(OVER_MS) * 1_000;
            let names = ["of_Drive/Drive.control", "of_Track/Track.speeds"];
            self.samples(&nets, &names, TURNING_PERIOD, over_us, &|| eyes.turned())?
        } else {
            Vec::new()
        };
        self.leave()?;
        self.judge_standing(&standing);
        self.judge_wheels(&driven, eyes)
    }

    fn judge_standing(&mut self, samples: &[Sample]) {
        let parts = self.parts;
        let one = |net: &str, field: &str| -> Vec<f64> {
            let values = samples.iter().filter_map(|it| it.on(net));
            values
                .filter_map(|it| it.row(field).first().copied())
                .collect()
        };
        self.findings
            .extend(measured(parts, Measured::Sonars, &["sonars"], || {
                let ring = samples.iter().filter_map(|it| it.on("of_Ring/Ring.ranges"));
                let ring: Vec<SonarSample> = ring.map(sonar_sample).collect();
                body::sonars(&ring)
            }));
        self.findings
            .extend(measured(parts, Measured::Battery, &["battery"], || {
                let low_v = parts.default_of("BatteryMonitor", "low_v").unwrap_or(0.0);
                // A measure of the file, and not all the digits of its single precision.
                let low_v = libm::round(low_v * 1e3) / 1e3;
                vec![body::battery(
                    &one("of_Measure/Measure.battery", "voltage_v"),
                    low_v,
                )]
            }));
        self.findings
            .extend(measured(parts, Measured::Gyroscope, &["gyroscope"], || {
                let rates = one("of_Rate/Rate.yaw_rate", "yaw_rate_rad_per_s");
                vec![body::gyroscope(&rates)]
            }));
    }

    fn judge_wheels(
        &mut self,
        samples: &[Sample],
        eyes: &mut dyn Eyes,
    ) -> Result<(), CommandError> {
        if !self.parts.drives() {
            let unmeasured = measured(self.parts, Measured::Wheels, &wheels::NAMES, || {
                let why = "not measured: lift the robot's wheels off the ground, and give `--wheels-lifted`";
                wheels::NAMES
                    .map(|name| Finding::not_measured(name, why))
                    .to_vec()
            });
            self.findings.extend(unmeasured);
            return Ok(());
        }
        let mut drive = Vec::new();
        let mut turned = Vec::new();
        for sample in samples {
            let (Some(control), Some(speeds)) = (
                sample.on("of_Drive/Drive.control"),
                sample.on("of_Track/Track.speeds"),
            ) else {
                continue;
            };
            let pair = |net: &NetValues, left: &str, right: &str| {
                [left, right].map(|field| net.row(field).first().copied().unwrap_or(0.0))
            };
            drive.push(WheelSample {
                t_s: sample.t_us as f64 / US_PER_S,
                asked_m_per_s: pair(&control, "left_set_m_per_s", "right_set_m_per_s"),
                counted_m_per_s: pair(&speeds, "left_m_per_s", "right_m_per_s"),
            });
            turned.extend(sample.turned);
        }
        let findings = if turned.len() == drive.len() && !drive.is_empty() {
            wheels::judge_known(&drive, &turned)
        } else {
            let seen = eyes.seen()?;
            wheels::judge(&drive, seen.as_ref())
        };
        self.findings.extend(findings);
        Ok(())
    }

    /// Samples of what is on the nets of these names, until this time of the mission.
    fn samples(
        &mut self,
        catalogue: &Catalogue,
        names: &[&'static str],
        period: Duration,
        until_us: u64,
        turned: &dyn Fn() -> Option<[f64; 2]>,
    ) -> Result<Vec<Sample>, CommandError> {
        let found = names.iter().filter_map(|name| {
            let net = catalogue.find(name)?;
            Some((*name, net.clone()))
        });
        let (names, nets): (Vec<&'static str>, Vec<Watched>) = found.unzip();
        let subscription = Subscription::begin(self.robot, catalogue.mission, nets, period)?;
        let clock = self.robot.clock().clone();
        let begun = clock.now();
        let mut looked = begun;
        let limit = Duration::from_micros(until_us) + SAMPLES_LIMIT;
        let mut samples = Vec::new();
        let mut now_us = 0;
        while now_us < until_us {
            self.robot.attend(LISTEN_TIME)?;
            if crate::run::interrupt::is_requested() {
                return Err(ClientError::Interrupted { request: "values" }.into());
            }
            for event in self.robot.take_events() {
                match subscription.read(&event) {
                    Some(Told::Sample(reading)) => {
                        now_us = reading.t_us;
                        samples.push(Sample::of(&names, &subscription, reading, turned()));
                    }
                    Some(Told::Ended) => {
                        self.require_running()?;
                    }
                    Some(Told::Gap(_)) | None => {}
                }
            }
            if clock.since(looked) > LOOK_TIME {
                looked = clock.now();
                // Where there is nothing to sample, the robot says itself how late it is.
                now_us = now_us.max(self.require_running()?.t_us);
            }
            if clock.since(begun) > limit {
                return Err(CommandError::World(anyhow!(
                    "the robot's selftest stands still: `esm top` shows what it does"
                )));
            }
        }
        self.robot.end_values()?;
        Ok(samples)
    }

    /// Writes a record, by an emergency stop that is latched and released.
    fn keep_record(&mut self) -> Result<Kept, CommandError> {
        // Nobody is to be left with a stop that was latched for this.
        robot::hold_out(self.robot);
        let latched = took(self.robot.emergency_stop())?;
        let released = took(self.robot.release())?;
        Ok(if latched && released {
            Kept::Yes
        } else {
            Kept::No
        })
    }
}

/// What is found, or rows of these names that say why nothing is: a task is missing.
fn measured(
    parts: Parts<'_>,
    what: Measured,
    names: &[&str],
    found: impl FnOnce() -> Vec<Finding>,
) -> Vec<Finding> {
    let Some(task) = parts.lacks(what) else {
        return found();
    };
    let why = format!("not measured: the firmware has no task `{task}`");
    let rows = names.iter().map(|name| Finding::not_measured(*name, &*why));
    rows.collect()
}

fn compiled(name: &str, texts: &Texts) -> Result<Mission, CommandError> {
    compiled_with(name, &texts.mission, (TASKS_NAME, &texts.tasks))
}

/// Whether a robot's flash took a stop or a release; that it was done is so in any case.
fn took(done: Result<(), ClientError>) -> Result<bool, CommandError> {
    match done {
        Ok(()) => Ok(true),
        Err(error) if error.refusal() == Some(LinkError::StopNotStored) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn values_error(error: crate::values::ValuesError) -> CommandError {
    match error.of_line() {
        Ok(error) => error.into(),
        Err(error) => CommandError::Input(error.into()),
    }
}

/// What was on some nets at a time.
struct Sample {
    t_us: u64,
    nets: Vec<NetValues>,
    turned: Option<[f64; 2]>,
}

/// What was on one of them.
#[derive(Clone)]
struct NetValues {
    name: &'static str,
    fields: Vec<(String, f64)>,
}

impl NetValues {
    /// The values of a field, several where it is a row.
    fn row(&self, field: &str) -> Vec<f64> {
        let of_it = self.fields.iter().filter(|(name, _)| name == field);
        of_it.map(|(_, value)| *value).collect()
    }
}

impl Sample {
    fn of(
        names: &[&'static str],
        subscription: &Subscription,
        reading: Reading,
        turned: Option<[f64; 2]>,
    ) -> Self {
        let nets = names.iter().zip(subscription.nets()).zip(reading.values);
        let nets = nets.filter_map(|((name, watched), values)| {
            let fields = watched.fields.iter().zip(values?);
            let fields = fields.map(|(field, value)| (field.name.to_string(), number(&value)));
            Some(NetValues {
                name,
                fields: fields.collect(),
            })
        });
        Sample {
            t_us: reading.t_us,
            nets: nets.collect(),
            turned,
        }
    }

    fn on(&self, net: &str) -> Option<NetValues> {
        self.nets.iter().find(|it| it.name == net).cloned()
    }
}

fn number(value: &Value) -> f64 {
    match value {
        Value::Bool(value) => f64::from(u8::from(*value)),
        Value::I32(value) => f64::from(*value),
        Value::U32(value) => f64::from(*value),
        Value::F32(value) => f64::from(*value),
    }
}

fn sonar_sample(net: NetValues) -> SonarSample {
    const CS_PER_S: f64 = 100.0;
    let bits = |field: &str| net.row(field).first().map_or(0, |bits| *bits as u32);
    SonarSample {
        range_m: net.row("range_m"),
        age_s: net.row("age_cs").iter().map(|cs| cs / CS_PER_S).collect(),
        dead: bits("dead"),
    }
}
