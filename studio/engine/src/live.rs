//! A robot that is connected: a recording that grows.
//!
//! What is new is told at once, however long the robot has been watched: what came long ago is
//! settled, and a shorter recording that begins behind it is replayed in its place. Questions of
//! any moment are answered from all that came; the page asks them of an instance of its own, so
//! that what is new never waits for an answer.

use std::cell::RefCell;

use esm_toolkit::recording::file::Frame;
use esm_toolkit::recording::player::Recording;
use esm_toolkit::recording::told::Told;
use serde_json::Value;

use crate::looked::{self, Lists};

/// Macro steps that are replayed for what is new, at most; with more they are settled.
const MOST_STEPS: u64 = 1_500;

/// What has come of a robot, and how many macro steps of its mission it has made.
#[derive(Default)]
struct Come {
    bytes: Vec<u8>,
    steps: Option<u64>,
}

impl Come {
    fn take(&mut self, bytes: &[u8], steps: Option<u64>) {
        self.bytes.extend_from_slice(bytes);
        self.steps = steps;
    }

    /// It as a recording, up to the steps that the robot has made; none before one begins.
    fn read(&self, steps: Option<u64>) -> Result<Option<Recording>, String> {
        if self.bytes.is_empty() {
            return Ok(None);
        }
        let mut all = self.bytes.clone();
        if let Some(steps) = steps {
            // What entered before them is there, as far as the robot has told.
            let end = Frame::End(steps);
            end.write(&mut all).map_err(|error| error.to_string())?;
        }
        let recording = Recording::read(&all).map_err(|error| error.to_string())?;
        Ok(Some(recording).filter(|it| !it.stretches.is_empty()))
    }

    /// What came so far, if that is much, and bytes with which to go on behind it.
    fn settled(&self) -> Option<(Recording, Vec<u8>)> {
        let settled = self.read(None).ok()??;
        let made: u64 = settled.stretches.iter().map(|it| it.made).sum();
        if made < MOST_STEPS {
            return None;
        }
        let rest = settled.rest()?;
        Some((settled, rest))
    }
}

/// What is new of a robot.
#[derive(Default)]
struct News {
    come: Come,
    /// How many states, transitions and places are settled, and what of the rest was told.
    settled: [usize; 3],
    known: Lists,
    /// The last states that are settled.
    active: Vec<String>,
    faults: Vec<Value>,
    missions: Vec<(String, u64, u64)>,
    first_us: Option<u64>,
    moved_us: u64,
}

/// How many entries of a list stay as they were.
fn kept<T: PartialEq>(before: &[T], now: &[T]) -> usize {
    let pairs = before.iter().zip(now);
    pairs.take_while(|(before, now)| before == now).count()
}

impl News {
    fn lists(&self, recording: &Recording, told: &Told) -> Lists {
        let mut lists = Lists::of(recording, told, self.moved_us);
        // Where it begins anew nothing has changed.
        if (lists.active.first()).is_some_and(|(_, active)| *active == self.active) {
            lists.active.remove(0);
        }
        lists
    }

    fn tell(&mut self) -> Result<Value, String> {
        let Some(recording) = self.come.read(self.come.steps)? else {
            return Ok(Value::Null);
        };
        let (told, _) = Told::of(&recording);
        let now = self.lists(&recording, &told);
        let kept = [
            kept(&self.known.active, &now.active),
            kept(&self.known.transitions, &now.transitions),
            kept(&self.known.shown, &now.shown),
        ];
        let mut answer = now.told(&recording, &told, kept);
        for (place, settled) in self.settled.into_iter().enumerate() {
            answer["kept"][place] = (settled + kept[place]).into();
        }
        if let Some(first_us) = self.first_us {
            answer["start_us"] = first_us.into();
        }
        let faults = self.faults.iter().chain(&now.faults).cloned();
        answer["faults"] = faults.collect();
        if let Some((last, earlier)) = self.missions.split_last() {
            // The last one goes on.
            if let Some(first) = answer["missions"].get_mut(0) {
                first["start_us"] = last.1.into();
            }
            let earlier = earlier.iter().map(|(name, start_us, end_us)| {
                serde_json::json!({ "name": name, "start_us": start_us, "end_us": end_us })
            });
            let rest = answer["missions"].as_array().into_iter().flatten().cloned();
            answer["missions"] = earlier.chain(rest).collect();
        }
        let start_us = told.last_start(&recording).map(|it| it.0 + self.moved_us);
        answer["mission_start_us"] = start_us.into();
        self.known = now;
        self.settle();
        Ok(answer)
    }

    /// What was told long ago stays as it is.
    fn settle(&mut self) {
        let Some((settled, rest)) = self.come.settled() else {
            return;
        };
        let (replayed, _) = Told::of(&settled);
        let lists = self.lists(&settled, &replayed);
        let known = &mut self.known;
        let counts = [
            lists.active.len(),
            lists.transitions.len(),
            lists.shown.len(),
        ];
        let told = [
            kept(&known.active, &lists.active),
            kept(&known.transitions, &lists.transitions),
            kept(&known.shown, &lists.shown),
        ];
        // A robot that takes macro steps back that it has told of is waited for.
        if told != counts {
            return;
        }
        self.come.bytes = rest;
        known.active.drain(..counts[0]);
        known.transitions.drain(..counts[1]);
        known.shown.drain(..counts[2]);
        for (count, settled) in counts.into_iter().zip(&mut self.settled) {
            *settled += count;
        }
        if let Some((_, active)) = lists.active.last() {
            self.active.clone_from(active);
        }
        self.faults.extend(lists.faults);
        let mut missions = lists.missions;
        if let Some((last, first)) = self.missions.pop().zip(missions.first_mut()) {
            first.1 = last.1;
        }
        self.missions.extend(missions);
        self.first_us = self.first_us.or(lists.span_us.map(|it| it.0));
        self.moved_us += replayed.last_start(&settled).map_or(0, |it| it.1);
    }
}

/// What questions are answered from.
#[derive(Default)]
struct Heard {
    all: Come,
    /// What is behind that which is settled.
    late: Come,
    /// Whether times were moved in what is settled, so that they are others in what is behind it.
    is_moved: bool,
    /// Whether what is looked at is all that came, or what came late; none where it is older.
    looked: Option<bool>,
}

impl Heard {
    /// Looks at what came late, if that holds a time.
    fn look_at_late(&mut self, t_us: u64) -> Result<bool, String> {
        if self.is_moved {
            return Ok(false);
        }
        let Some(recording) = self.late.read(self.late.steps)? else {
            return Ok(false);
        };
        if let Some((settled, rest)) = self.late.settled() {
            self.late.bytes = rest;
            let (told, _) = Told::of(&settled);
            self.is_moved |= told.last_start(&settled).is_some_and(|it| it.1 > 0);
        }
        Ok(looked::at_growing(recording, Some(t_us)))
    }
}

thread_local! {
    static NEWS: RefCell<News> = RefCell::default();
    static HEARD: RefCell<Heard> = RefCell::default();
}

/// Takes in what a robot has told. Answers what there is to see of it that was not told before, or
/// nothing before its recording begins.
///
/// # Errors
/// What has come makes no sense.
pub fn news(bytes: &[u8], steps: Option<u64>) -> Result<Value, String> {
    NEWS.with_borrow_mut(|news| {
        news.come.take(bytes, steps);
        news.tell()
    })
}

/// Keeps what a robot has told until something is asked about it.
pub fn hear(bytes: &[u8], steps: Option<u64>) {
    HEARD.with_borrow_mut(|heard| {
        heard.all.take(bytes, steps);
        heard.late.take(bytes, steps);
        heard.looked = None;
    });
}

/// Looks at what a robot has told, if it is one that is asked about: at all of it, or at enough of
/// it for a question about one moment.
///
/// # Errors
/// What has come makes no sense.
pub fn look(t_us: Option<u64>) -> Result<(), String> {
    HEARD.with_borrow_mut(|heard| {
        if heard.all.bytes.is_empty() || heard.looked == Some(true) {
            return Ok(());
        }
        if let Some(t_us) = t_us
            && heard.look_at_late(t_us)?
        {
            heard.looked = Some(false);
            return Ok(());
        }
        if let Some(recording) = heard.all.read(heard.all.steps)? {
            looked::at_growing(recording, None);
            heard.looked = Some(true);
        }
        Ok(())
    })
}
