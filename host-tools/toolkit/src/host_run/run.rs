//! The run itself.

use std::sync::Arc;

use esm_core::Verified;
use esm_link::message::{Channel, Request, Response};
use esm_link::trace::TraceEvent;
use rt_firmware::Sides;
use rt_firmware::body::{Actuators, PinImage, SONARS};
use rt_firmware::frames::LinkDevice;

use super::port::DirectPort;
use super::session::{RunError, Session, While};
use super::wired_link::WiredLink;
use crate::host_board::{BOARD, HostLife, log_lines};
use crate::plant::behind_pins::{BehindPins, PlantBehindPins, PlantFault, SonarBreak, StuckWheel};
use crate::plant::{BodyParameters, Plant};
use crate::recording::file::Header;
use crate::recording::samples::RawSample;
use crate::recording::writer::RecordingWriter;
use crate::story::{Story, Told};
use crate::streams::StreamEvent;
use crate::trace::directory::{Directory, NoDirectory};
use crate::values::{Net, nets_of};
use crate::world::World;

/// The task whose missions want to hear of the host.
pub const LINK_MONITOR: &str = "LinkMonitor";

/// How often a robot with such a mission is called, in microseconds of robot time.
pub const CALL_INTERVAL_US: u64 = 50_000;

/// How often values on nets are kept, in milliseconds of robot time; and how many samples a run has
/// at most, of which a long one has fewer in the same time.
const SAMPLE_MS: u64 = 100;
const MOST_SAMPLES: u64 = 6_000;

/// How often a run shows where the robot is, in microseconds of robot time.
const SHOWN_EACH_US: u64 = 50_000;

/// A mission of a run.
#[derive(Clone, Debug)]
pub struct RunMission {
    /// Its name.
    pub name: String,
    /// Its blob's hash.
    pub hash: u32,
    /// Its blob.
    pub blob: Vec<u8>,
    /// The names in it.
    pub directory: Arc<Directory>,
    /// Its links, in the order of the blob.
    pub links: Vec<WiredLink>,
    /// Durations of its slots, in microseconds.
    durations_us: Vec<u32>,
    nets: Vec<Net>,
    calls: bool,
}

impl RunMission {
    /// Takes a mission that was compiled.
    ///
    /// # Errors
    /// [`NoDirectory`]
    pub fn new(name: &str, verified: Verified<Vec<u8>>) -> Result<Self, NoDirectory> {
        let tables = verified.tables();
        let directory = Arc::new(Directory::of(&tables)?);
        let calls = (tables.tasks()).any(|task| task.signature.name() == LINK_MONITOR.as_bytes());
        Ok(RunMission {
            name: name.to_owned(),
            hash: verified.hash(),
            links: WiredLink::of(&tables, &directory),
            directory,
            durations_us: tables.slots().map(|slot| slot.duration_us).collect(),
            nets: nets_of(&verified)?,
            calls,
            blob: verified.into_bytes(),
        })
    }
}

/// A mission that takes over during a run.
#[derive(Clone, Debug)]
pub struct Planned {
    /// Robot time, in microseconds.
    pub at_us: u64,
    /// The mission.
    pub mission: RunMission,
    /// Whether what it has in common with the one before goes on as it is.
    pub warm: bool,
}

/// What a run is made of, beside its missions.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The world around the robot.
    pub world: World,
    /// The robot's body.
    pub body: BodyParameters,
    /// Seed of the plant's noise.
    pub seed: u64,
    /// Robot time at which the run ends, in microseconds.
    pub until_us: u64,
    /// Sonars that break while it runs.
    pub breaks: Vec<SonarBreak>,
    /// Wheels that something holds while it runs.
    pub stuck_wheels: Vec<StuckWheel>,
    /// Robot time at which the button of the emergency stop is pressed, in microseconds.
    pub stop_at_us: Option<u64>,
    /// Robot time from which on the robot hears nothing more of its host, in microseconds.
    pub cut_link_us: Option<u64>,
}

/// What a run needs to know beside its missions and its plant.
#[derive(Clone, Copy, Debug)]
pub struct Switches {
    /// Seed of the plant's noise, for the recording.
    pub seed: u64,
    /// Robot time at which the run ends, in microseconds.
    pub until_us: u64,
    /// Robot time from which on the robot hears nothing more of its host, in microseconds.
    pub cut_link_us: Option<u64>,
}

/// A plant behind a board's pins, or the part of one that the board has.
pub trait Behind: BehindPins {
    /// Looks at the plant as it is.
    fn look<T>(&self, at: impl FnOnce(&Plant) -> T) -> T;

    /// The plant at the end of the time of interest, or as it is where that has not come yet.
    fn at_end(&self) -> Plant;

    /// The board has left this at its pins, which takes effect at a robot time in microseconds. A
    /// plant that one board has learns it in time with the next exchange.
    fn announce(&mut self, effect_us: u64, actuators: &Actuators) {
        let _ = (effect_us, actuators);
    }
}

impl Behind for PlantBehindPins {
    fn look<T>(&self, at: impl FnOnce(&Plant) -> T) -> T {
        at(self.plant())
    }

    fn at_end(&self) -> Plant {
        PlantBehindPins::at_end(self)
    }
}

/// Where the robot is at a time, and what it hears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// Robot time, in microseconds.
    pub t_us: u64,
    /// Its centre, in metres.
    pub at_m: [f64; 2],
    /// Counter-clockwise from x, in radians.
    pub heading_rad: f64,
    /// How long the echo of each sonar was last, in microseconds; none where there is no pulse.
    pub echo_us: [Option<u16>; SONARS],
    /// The battery's voltage.
    pub battery_v: f64,
    /// Touches of walls and people so far.
    pub touches: u32,
}

/// What happened since it was asked last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Given {
    /// Where the robot was.
    pub shown: Vec<Shown>,
    /// The states that were current from a time on, in microseconds, where that has changed.
    pub active: Vec<(u64, Vec<String>)>,
    /// What happened, in words, each with its time in microseconds.
    pub words: Vec<(u64, String)>,
    /// Lines of the robot's log.
    pub log: Vec<(u64, String)>,
    /// People who were there from a time on, in microseconds, where that has changed: centre and
    /// radius, in metres.
    pub people: Vec<(u64, Vec<[f64; 3]>)>,
    /// Walls that came at a time, in microseconds: both ends, in metres.
    pub walls: Vec<(u64, [f64; 4])>,
}

/// A run that has come to its end.
pub struct Ended {
    /// What happened, with the trace.
    pub told: Told<Vec<u8>>,
    /// The recording of it.
    pub recording: Vec<u8>,
    /// The plant as it was then.
    pub plant: Plant,
    /// Slot activations that did not start within their period.
    pub slots_missed: u64,
}

/// A run that goes on as far as it is told to.
pub struct HostRun<'p, 'q, 'm, B = PlantBehindPins> {
    life: HostLife<'p, 'q, 'm, B>,
    port: DirectPort<'m>,
    session: Session,
    story: Story<Vec<u8>>,
    recording: RecordingWriter<Vec<u8>>,
    missions: Vec<Planned>,
    /// Missions that were brought to the robot, and those that the trace has seen start.
    brought: usize,
    started: usize,
    until_us: u64,
    cut_link_us: Option<u64>,
    called_us: u64,
    shown_us: Option<u64>,
    given: Given,
    /// Active regions that went on as they were, of each mission that took over.
    carried: Vec<u16>,
    people: Vec<[f64; 3]>,
    /// How many walls have come.
    walls: usize,
    active: Vec<String>,
    /// Whether current states may be others since they were looked at.
    is_moved: bool,
    /// Whether the mission that runs is another one than the one whose values are sampled.
    is_new: bool,
    /// Hash of the mission whose values are sampled, and the number of the request for them.
    sampled: Option<(u32, u8)>,
}

impl<'p, 'q, 'm> HostRun<'p, 'q, 'm> {
    /// Switches a board of these sides on, and brings the first of `missions` to it.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn start(
        sides: Sides<'q, 'm>,
        pins: &'p PinImage,
        settings: Settings,
        missions: Vec<Planned>,
    ) -> Result<Self, RunError> {
        log_lines::install();
        let until_us = settings.until_us;
        let plant = Plant::new(settings.world, settings.body, settings.seed)?;
        let mut behind = PlantBehindPins::new(plant, Some(until_us));
        behind.break_sonars(settings.breaks);
        behind.stick_wheels(settings.stuck_wheels);
        if let Some(robot_us) = settings.stop_at_us {
            behind.inject(PlantFault::StopPressedFrom { robot_us });
        }
        let switches = Switches {
            seed: settings.seed,
            until_us,
            cut_link_us: settings.cut_link_us,
        };
        let mut run = Self::switch_on(sides, pins, behind, switches, missions)?;
        run.begin()?;
        Ok(run)
    }
}

impl<'p, 'q, 'm, B: Behind> HostRun<'p, 'q, 'm, B> {
    /// Switches a board of these sides on, with `behind` behind its pins. It has no mission yet.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn switch_on(
        sides: Sides<'q, 'm>,
        pins: &'p PinImage,
        behind: B,
        switches: Switches,
        missions: Vec<Planned>,
    ) -> Result<Self, RunError> {
        log_lines::install();
        let Switches {
            seed,
            until_us,
            cut_link_us,
        } = switches;
        let mut life = HostLife::new(sides, pins, behind, None);
        let mut port = DirectPort::new(life.stop_listener());
        life.start(&mut port);
        let firmware = concat!("esm ", env!("CARGO_PKG_VERSION"));
        let head = Header {
            board: BOARD.to_owned(),
            firmware: firmware.to_owned(),
            program: firmware.to_owned(),
            seed: Some(seed),
        };
        let mut recording = RecordingWriter::new(Vec::new(), head, Some(until_us))?;
        // Guards are looked at in it.
        recording.keep_all();
        for Planned { mission, .. } in &missions {
            let period_us = mission.directory.interpreter_period_us();
            recording.mission(&mission.name, mission.hash, &mission.blob, period_us)?;
        }
        let mut run = HostRun {
            life,
            port,
            session: Session::new(),
            story: Story::new(Vec::new(), Some(until_us)),
            recording,
            missions,
            brought: 0,
            started: 0,
            until_us,
            cut_link_us,
            called_us: 0,
            shown_us: None,
            given: Given::default(),
            carried: Vec::new(),
            people: Vec::new(),
            walls: 0,
            active: Vec::new(),
            is_moved: true,
            is_new: false,
            sampled: None,
        };
        run.session.begin((&mut run.life, &mut run.port))?;
        Ok(run)
    }

    /// Gives the links of its missions devices, in their order; without any, they lead nowhere.
    pub fn connect(&mut self, links: Vec<Box<dyn LinkDevice>>) {
        self.life.connect(links);
    }

    /// Brings the first mission to the board: robot time begins.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn begin(&mut self) -> Result<(), RunError> {
        self.bring(While::Passing)
    }

    /// Robot time at which the next slot begins, in microseconds; none where the run is over.
    pub fn next_us(&self) -> Option<u64> {
        let next_us = self.life.next_robot_us();
        let is_over = self.story.has_ended() || self.story.fault().is_some();
        (!is_over && next_us <= self.until_us).then_some(next_us)
    }

    /// The same up to the very end, whether or not there is another macro step before: other
    /// processors see what its slots do.
    pub fn next_slot_us(&self) -> Option<u64> {
        let next_us = self.life.next_robot_us();
        let goes_on = self.story.fault().is_none() && next_us <= self.until_us;
        goes_on.then_some(next_us)
    }

    /// Lets the next slot be executed.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn pass_slot(&mut self) -> Result<(), RunError> {
        self.call(self.life.next_robot_us())?;
        self.life.serve(&mut self.port);
        self.take_in()?;
        if std::mem::take(&mut self.is_new) {
            self.watch()?;
        }
        self.life.pass(&mut self.port);
        self.show();
        Ok(())
    }

    /// What the last activation has left at the pins, and when that takes effect, in microseconds
    /// of robot time.
    fn outputs(&self) -> Option<(u64, Actuators)> {
        let outputs = self.life.outputs()?;
        let runs = self.started.checked_sub(1)?;
        let durations_us = &self.missions.get(runs)?.mission.durations_us;
        let duration_us = *durations_us.get(outputs.slot)?;
        Some((outputs.start_us + u64::from(duration_us), outputs.actuators))
    }

    /// Tells the plant what the last activation has left at the pins, before the next one does:
    /// others may look at the plant meanwhile.
    pub fn announce(&mut self) {
        if let Some((effect_us, actuators)) = self.outputs() {
            self.life.plant().announce(effect_us, &actuators);
        }
    }

    /// Takes in what the board has said and logged so far, where others log, too.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn hear(&mut self) -> Result<(), RunError> {
        self.life.serve(&mut self.port);
        self.take_in()
    }

    /// Lets robot time pass up to `robot_us`, or to the end where that comes before. Answers
    /// whether there is more.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn go_on(&mut self, robot_us: u64) -> Result<bool, RunError> {
        loop {
            let Some(next_us) = self.next_us() else {
                self.take_in()?;
                return Ok(false);
            };
            if self.bring_what_is_due()? {
                continue;
            }
            if next_us > robot_us {
                return Ok(true);
            }
            self.pass_slot()?;
        }
    }

    /// Brings the next mission to the robot where that is to take over before the next slot.
    /// Answers whether it did: then another slot may be the next.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn bring_what_is_due(&mut self) -> Result<bool, RunError> {
        let next_us = self.life.next_robot_us();
        let next = self.missions.get(self.brought);
        let is_due = next.is_some_and(|next| next_us >= next.at_us);
        if is_due {
            self.bring(While::Standing)?;
        }
        Ok(is_due)
    }

    /// Robot time that has passed, in microseconds.
    pub fn robot_us(&self) -> u64 {
        self.life.next_robot_us().min(self.until_us)
    }

    /// What happened since this was asked last.
    pub fn take(&mut self) -> Given {
        std::mem::take(&mut self.given)
    }

    /// How many active regions went on as they were, for each mission that was brought.
    pub fn carried(&self) -> &[u16] {
        &self.carried
    }

    /// Ends the run.
    ///
    /// # Errors
    /// [`RunError`]
    pub fn finish(mut self) -> Result<Ended, RunError> {
        self.life.serve(&mut self.port);
        self.take_in()?;
        let missed = |response: Response<'_>| match response {
            Response::Status(status) => Some(u64::from(status.missed)),
            _ => None,
        };
        let board = (&mut self.life, &mut self.port);
        let slots_missed = (self.session).ask(
            board,
            While::Standing,
            "say how it is",
            Request::Status,
            missed,
        )?;
        let steps = self.story.steps();
        let end_us = match self.story.fault() {
            None => self.until_us,
            Some(_) => self.robot_us(),
        };
        let told = (self.story.finish(end_us)?).ok_or(RunError::BadTrace)?;
        let mut recording = self.recording;
        recording.ends(&told.ends)?;
        let (recording, _) = recording.finish(steps)?;
        Ok(Ended {
            told,
            recording,
            plant: self.life.plant().at_end(),
            slots_missed,
        })
    }

    /// Brings the next mission to the robot.
    fn bring(&mut self, time: While) -> Result<(), RunError> {
        let Some(next) = self.missions.get(self.brought) else {
            return Ok(());
        };
        let board = (&mut self.life, &mut self.port);
        let carried = self
            .session
            .bring(board, time, &next.mission.blob, next.warm)?;
        self.carried.push(carried);
        self.brought += 1;
        self.take_in()
    }

    /// Lets the robot hear that somebody is there, if its mission wants to.
    fn call(&mut self, robot_us: u64) -> Result<(), RunError> {
        let current = self.brought.checked_sub(1);
        let calls = current.and_then(|index| self.missions.get(index));
        if !calls.is_some_and(|planned| planned.mission.calls)
            || self.cut_link_us.is_some_and(|cut_us| robot_us >= cut_us)
            || robot_us < self.called_us + CALL_INTERVAL_US
        {
            return Ok(());
        }
        self.called_us = robot_us;
        (self.session).call(&mut self.port, "say how it is", Request::Status)
    }

    /// Asks for the values of the mission that runs now.
    fn watch(&mut self) -> Result<(), RunError> {
        let current = self.started.checked_sub(1);
        let Some(Planned { mission, .. }) = current.and_then(|index| self.missions.get(index))
        else {
            return Ok(());
        };
        let each_ms = SAMPLE_MS.max(self.until_us / 1_000 / MOST_SAMPLES);
        let period_ms = u16::try_from(each_ms).unwrap_or(u16::MAX);
        let board = (&mut self.life, &mut self.port);
        let watched = (self.session).watch(board, &mission.nets, mission.hash, period_ms)?;
        self.sampled = match watched {
            None => None,
            Some((nets, number)) => {
                self.recording.nets(mission.hash, &nets)?;
                Some((mission.hash, number))
            }
        };
        self.take_in()
    }

    /// Takes in what the board has said.
    fn take_in(&mut self) -> Result<(), RunError> {
        self.session.hear(&mut self.port, |_| {});
        for event in self.session.take_events() {
            match event {
                StreamEvent::Trace(records) => self.take_records(&records)?,
                StreamEvent::Record(records) => {
                    self.recording.records(&records)?;
                }
                StreamEvent::Log(bytes) => {
                    let t_us = self.robot_us();
                    let text = String::from_utf8_lossy(&bytes).into_owned();
                    let lines = text.lines().map(|line| (t_us, line.to_owned()));
                    self.given.log.extend(lines);
                }
                StreamEvent::Values {
                    number,
                    left_out: _,
                    has,
                    t_us,
                    words,
                } => {
                    if let Some((mission, asked)) = self.sampled
                        && number == asked
                    {
                        self.recording.sample(RawSample {
                            mission,
                            t_us,
                            has,
                            words,
                        })?;
                    }
                }
                // There is a next one.
                StreamEvent::Gap {
                    channel: Channel::Values,
                    ..
                } => {}
                StreamEvent::Gap { missing, .. } if !self.story.has_ended() => {
                    return Err(RunError::Gap { missing });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn take_records(&mut self, records: &[u8]) -> Result<(), RunError> {
        let mut rest = records;
        while !rest.is_empty() {
            let record = TraceEvent::take(&mut rest).map_err(|_| RunError::BadTrace)?;
            if let TraceEvent::Started { mission, start_us } = record {
                let next = (self.missions.get(self.started))
                    .filter(|next| next.mission.hash == mission)
                    .ok_or(RunError::BadTrace)?;
                let directory = Arc::clone(&next.mission.directory);
                self.story
                    .mission(&next.mission.name, directory, start_us)?;
                self.started += 1;
                self.is_moved = true;
                self.is_new = true;
            }
            self.is_moved |= matches!(record, TraceEvent::Transition { .. });
            let words = &mut self.given.words;
            let t_us = self.story.now_us().unwrap_or(0);
            self.story
                .record(&record, &mut |told| words.push((t_us, told)))?;
            if self.story.has_stepped() && std::mem::take(&mut self.is_moved) {
                let active = self.story.active();
                if active != self.active {
                    self.active.clone_from(&active);
                    self.given.active.push((t_us, active));
                }
            }
        }
        Ok(())
    }

    /// Notes where the robot is, where it is time to.
    fn show(&mut self) {
        let walls = &mut self.walls;
        let (given, known, shown) = (&mut self.given, &mut self.people, &mut self.shown_us);
        let until_us = self.until_us;
        self.life.plant().look(|plant| {
            let t_us = plant.now_us();
            let people = plant.people();
            let people: Vec<[f64; 3]> = people
                .map(|person| {
                    let circle = person.circle;
                    [circle.centre.x_m, circle.centre.y_m, circle.radius_m]
                })
                .collect();
            if people != *known {
                given.people.push((t_us, people.clone()));
                *known = people;
            }
            for wall in plant.added_walls().iter().skip(*walls) {
                let ends = [wall.from.x_m, wall.from.y_m, wall.to.x_m, wall.to.y_m];
                given.walls.push((t_us, ends));
                *walls += 1;
            }
            let is_due = |shown_us: u64| t_us >= shown_us + SHOWN_EACH_US;
            if t_us > until_us || !shown.is_none_or(is_due) {
                return;
            }
            *shown = Some(t_us - t_us % SHOWN_EACH_US);
            let pose = plant.pose();
            given.shown.push(Shown {
                t_us,
                at_m: [pose.position.x_m, pose.position.y_m],
                heading_rad: pose.heading_rad,
                echo_us: plant.pulses().map(|pulse| pulse.map(|it| it.width_us)),
                battery_v: plant.battery_v(),
                touches: plant.collisions(),
            });
        });
    }
}
