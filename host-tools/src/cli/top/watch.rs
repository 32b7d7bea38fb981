//! The robot read in a thread of its own, so that a request that waits for its answer keeps nobody
//! from pressing a key. A robot that does not answer is looked for until it does.

use std::collections::BTreeMap;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender, TryRecvError};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use esm_link::message::LinkError;

use super::view::NetRow;
use crate::cli::robot::{Robot, RobotArgs};
use crate::link_client::{CALL_INTERVAL, RobotInfo};
use crate::reading::{ReadError, Reader, Reading, Tasks};
use crate::values::{Catalogue, Subscription, Text, Told, ValuesError, Watched};

/// How long to wait before a robot that was lost is looked for again.
const RETRY_WAIT: Duration = Duration::from_secs(1);

/// What came from the robot.
pub enum Change {
    /// A reading, and what is on the nets of the mission.
    Read(Box<Reading>, Vec<NetRow>),
    /// The robot is there again, and says this of itself.
    Found(RobotInfo),
    /// It does not answer, and why.
    Lost(String),
}

/// A robot that is read again and again, until this is dropped.
pub struct Watch {
    news: Receiver<Change>,
    /// Index of the slot whose tasks are of interest. Its end ends the thread.
    wanted: Sender<usize>,
}

impl Watch {
    /// Reads this robot once in each `interval`, and finds it again by `port`.
    ///
    /// # Errors
    /// What the system says, where it gives no thread.
    pub fn start(port: RobotArgs, robot: Robot, interval: Duration) -> std::io::Result<Self> {
        let (teller, news) = mpsc::channel();
        let (wanted, wishes) = mpsc::channel();
        // Nobody waits for its end: it may be in the middle of a request.
        std::thread::Builder::new()
            .name("watch".into())
            .spawn(move || watch(&port, robot, interval, &wishes, &teller))?;
        Ok(Watch { news, wanted })
    }

    /// The tasks of this slot are of interest.
    pub fn look_at(&self, slot: usize) {
        // Should the thread have ended, `news` says so.
        let _ = self.wanted.send(slot);
    }

    /// What came since the last call, one thing after another.
    ///
    /// # Errors
    /// Nothing will come any more.
    pub fn news(&self) -> anyhow::Result<Option<Change>> {
        match self.news.try_recv() {
            Ok(news) => Ok(Some(news)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(anyhow!(
                "what reads the robot has failed; its message is above"
            )),
        }
    }
}

/// Reads until nobody listens.
fn watch(
    port: &RobotArgs,
    robot: Robot,
    interval: Duration,
    wishes: &Receiver<usize>,
    teller: &Sender<Change>,
) {
    let mut robot = Some(robot);
    let mut reader = Reader::default();
    let mut nets = Nets::default();
    let mut slot = 0;
    loop {
        let began = Instant::now();
        let news = match &mut robot {
            Some(found) => match read(&mut reader, &mut nets, found, slot, interval) {
                Ok(reading) => Change::Read(Box::new(reading), nets.rows()),
                Err(error) => {
                    // Its line is closed before it is opened again.
                    robot = None;
                    Change::Lost(error.to_string())
                }
            },
            None => match port.connect_quietly() {
                Ok((mut found, info)) => {
                    found.limit_waits(None);
                    // A session begins without values.
                    nets = Nets::default();
                    robot = Some(found);
                    Change::Found(info)
                }
                Err(error) => Change::Lost(error.to_string()),
            },
        };
        let wait = match &news {
            Change::Read(..) => interval.saturating_sub(began.elapsed()),
            Change::Found(_) => Duration::ZERO,
            Change::Lost(_) => RETRY_WAIT,
        };
        if teller.send(news).is_err() {
            return;
        }
        match wish(wishes, wait, robot.as_mut()) {
            // Of several wishes the last one counts.
            Ok(wish) => slot = wishes.try_iter().last().unwrap_or(wish),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

/// Waits for a wish. A robot that is there hears meanwhile that somebody looks at it.
fn wish(
    wishes: &Receiver<usize>,
    wait: Duration,
    mut robot: Option<&mut Robot>,
) -> Result<usize, RecvTimeoutError> {
    let began = Instant::now();
    loop {
        let left = wait.saturating_sub(began.elapsed());
        match wishes.recv_timeout(left.min(CALL_INTERVAL)) {
            Err(RecvTimeoutError::Timeout) if left > CALL_INTERVAL => {}
            wish => return wish,
        }
        if let Some(robot) = &mut robot {
            // Should it be lost, the next reading says so.
            let _ = robot.call();
        }
    }
}

/// Reads once, and looks at the nets.
fn read(
    reader: &mut Reader,
    nets: &mut Nets,
    robot: &mut Robot,
    slot: usize,
    interval: Duration,
) -> Result<Reading, ReadError> {
    let reading = reader.read(robot, Tasks::OfSlot(slot))?;
    match nets.look(robot, reading.status.mission, interval) {
        Ok(()) => {}
        Err(ValuesError::Client(error)) if error.refusal().is_none() => return Err(error.into()),
        // It changed its mission meanwhile, or cannot tell: the next look shows which.
        Err(error) => nets.give_up(&error),
    }
    Ok(reading)
}

/// What is on the nets of the mission that a robot runs.
#[derive(Default)]
struct Nets {
    /// The mission that all else is about.
    mission: Option<u32>,
    /// The nets, in groups that a sample has room for; with more than one they are looked at in
    /// turns.
    groups: Vec<Vec<Watched>>,
    /// The group that is looked at.
    group: usize,
    subscription: Option<Subscription>,
    /// What is known, by the indices of the nets.
    rows: BTreeMap<u16, NetRow>,
}

impl Nets {
    /// Takes what came since the last look, and asks for more.
    fn look(
        &mut self,
        robot: &mut Robot,
        mission: Option<u32>,
        interval: Duration,
    ) -> Result<(), ValuesError> {
        for event in robot.take_events() {
            match (self.subscription.as_ref()).and_then(|asked| Some((asked, asked.read(&event)?)))
            {
                Some((asked, Told::Sample(reading))) => {
                    for (watched, values) in asked.nets().iter().zip(&reading.values) {
                        let text = values.as_ref().map(|values| {
                            Text {
                                fields: &watched.fields,
                                values,
                            }
                            .to_string()
                        });
                        if let (Some(text), Some(row)) =
                            (text, self.rows.get_mut(&watched.net.index))
                        {
                            row.value = Some(text);
                        }
                    }
                }
                Some((_, Told::Ended)) => self.subscription = None,
                _ => {}
            }
        }
        if mission != self.mission {
            *self = Nets {
                mission,
                ..Nets::default()
            };
            if mission.is_some() {
                self.begin(robot)?;
            }
        }
        if self.subscription.is_none() || self.groups.len() > 1 {
            self.group += 1;
            let Some(mission) = self.mission else {
                return Ok(());
            };
            let turn = self.group.checked_rem(self.groups.len());
            if let Some(group) = turn.and_then(|turn| self.groups.get(turn)) {
                let nets = group.clone();
                self.subscription = Some(Subscription::begin(robot, mission, nets, interval)?);
            }
        }
        Ok(())
    }

    /// Finds out which nets there are.
    fn begin(&mut self, robot: &mut Robot) -> Result<(), ValuesError> {
        let blob = robot.running_blob()?;
        let Ok(blob) = esm_core::verify(blob) else {
            return Ok(());
        };
        let catalogue = Catalogue::read(robot, &blob)?;
        // Of another mission meanwhile: the next look is about that.
        self.mission = Some(catalogue.mission);
        self.groups = catalogue.groups();
        self.rows = (catalogue.nets.iter())
            .map(|watched| {
                let row = NetRow {
                    name: watched.net.name().to_owned(),
                    value: None,
                };
                (watched.net.index, row)
            })
            .collect();
        Ok(())
    }

    /// Shows nothing of this mission, or looks for another one.
    fn give_up(&mut self, error: &ValuesError) {
        let is_other = matches!(
            error,
            ValuesError::Client(error)
                if matches!(error.refusal(), Some(LinkError::OtherMission | LinkError::NoMission))
        );
        let mission = if is_other { None } else { self.mission };
        *self = Nets {
            mission,
            ..Nets::default()
        };
    }

    fn rows(&self) -> Vec<NetRow> {
        self.rows.values().cloned().collect()
    }
}
