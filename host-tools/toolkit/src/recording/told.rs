//! What a recording tells over time: which states were current when, which transitions were taken,
//! and when its samples were.
//!
//! The machine is run again, as in a replay, over gaps too. All times are of one line of time,
//! which never goes back: robot time, in microseconds since the first macro step of the first
//! mission. Where the robot was reset, its times began anew; here they go on behind those before.

use std::sync::Arc;

use esm_core::{Observer, TransitionTaken};

use super::limits::TooMuch;
use super::player::{LastStep, Player, Recording, ReplayError};
use super::samples::Sample;
use super::stretch::{Stretch, time_of};
use crate::pictures::{MissionStates, StatesRecorder};
use crate::trace::directory::{Directory, TransitionWords};

/// Transitions, times regions of their machine, that are told of: each may change the state of each
/// region.
const MAX_CHANGES: u64 = 50_000_000;

/// What a recording tells over time.
#[derive(Default)]
pub struct Told {
    /// The states of each run of a mission.
    pub missions: Vec<MissionStates>,
    /// The transitions, in the order of time.
    pub transitions: Vec<TransitionThen>,
    /// Faults.
    pub faults: Vec<FaultThen>,
    /// First and last moment.
    pub span_us: Option<(u64, u64)>,
    /// The run in which each stretch is, and what its times are moved by.
    stretches: Vec<(usize, u64)>,
    directories: Vec<Arc<Directory>>,
}

/// A transition, and when it was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransitionThen {
    /// When.
    pub t_us: u64,
    /// The run of a mission.
    pub run: usize,
    region: usize,
    transition: usize,
}

/// A fault, and when it stopped a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultThen {
    /// When.
    pub t_us: u64,
    /// The run of a mission.
    pub run: usize,
    /// What it is.
    pub code: &'static str,
}

impl Told {
    /// Runs a recording again. What keeps it from its end comes with all that was told before that.
    pub fn of(recording: &Recording) -> (Self, Result<(), ReplayError>) {
        let mut told = Told::default();
        let ended = told.run(recording);
        (told, ended)
    }

    /// A transition in words.
    pub fn words(&self, then: &TransitionThen) -> Option<TransitionWords<'_>> {
        self.directories
            .get(then.run)?
            .transition(then.region, then.transition)
    }

    /// Name of the mission of a run.
    pub fn mission(&self, run: usize) -> &str {
        let mission = self.missions.get(run);
        mission.map_or("", |mission| mission.name.as_str())
    }

    /// When a sample was, and in which run of a mission. None of one behind the end of what is
    /// told.
    pub fn place(&self, sample: &Sample, recording: &Recording) -> Option<(u64, usize)> {
        let (run, moved_us) = self.stretches.get(sample.stretch)?;
        let start_us = recording.stretches.get(sample.stretch)?.start_us;
        let t_us = start_us
            .saturating_add(sample.t_us)
            .saturating_add(*moved_us);
        Some((t_us, *run))
    }

    /// When the mission started that ran last, and by how much times are moved there.
    pub fn last_start(&self, recording: &Recording) -> Option<(u64, u64)> {
        let (_, moved_us) = *self.stretches.last()?;
        let stretch = recording.stretches.get(self.stretches.len() - 1)?;
        Some((stretch.start_us.saturating_add(moved_us), moved_us))
    }

    fn run(&mut self, recording: &Recording) -> Result<(), ReplayError> {
        let mut last: Option<LastStep> = None;
        let mut before: Option<&Stretch> = None;
        let mut changes = 0;
        let mut moved_us = 0_u64;
        for stretch in &recording.stretches {
            let mission = recording.mission_of(stretch, true, last)?;
            let period_us = u64::from(mission.directory.interpreter_period_us());
            let begin_us = time_of(stretch.start_us, stretch.first_step(), period_us);
            if let Some(last) = last
                && begin_us.saturating_add(moved_us) < last.at_us
            {
                moved_us = last
                    .at_us
                    .saturating_add(period_us)
                    .saturating_sub(begin_us);
            }
            let begin_us = begin_us.saturating_add(moved_us);
            let goes_on = before.is_some_and(|before| {
                (before.mission, before.start_us) == (stretch.mission, stretch.start_us)
            });
            if !goes_on {
                self.directories.push(Arc::clone(&mission.directory));
            }
            let run = self.directories.len() - 1;
            self.stretches.push((run, moved_us));
            let mut arena = vec![0; mission.verified.arena_words()];
            let mut player = Player::new(mission, stretch, &mut arena)?;
            let mut states = StatesRecorder::new(Arc::clone(&mission.directory), 0);
            let regions = mission.directory.regions().len() as u64;
            let mut at_us = begin_us;
            let mut ended = Ok(());
            let mut is_first = true;
            loop {
                match player.enter() {
                    Ok(entries) if entries.goes_on && player.machine().fault().is_none() => {}
                    Ok(_) => break,
                    Err(error) => {
                        ended = Err(error);
                        break;
                    }
                }
                let step = player.machine().progress().steps;
                at_us = time_of(stretch.start_us, step, period_us).saturating_add(moved_us);
                let known = self.transitions.len();
                let mut watcher = Watcher {
                    t_us: at_us,
                    run,
                    transitions: &mut self.transitions,
                };
                let made = player.macro_step(&mut watcher);
                let taken = (self.transitions.len() - known) as u64;
                changes += taken * regions.max(1);
                if let Err(error) = TooMuch::check("changes of states", changes, MAX_CHANGES) {
                    ended = Err(error.into());
                    break;
                }
                if std::mem::take(&mut is_first) || taken > 0 {
                    states.step(at_us, player.machine());
                }
                if let Err(fault) = made {
                    self.faults.push(FaultThen {
                        t_us: at_us,
                        run,
                        code: fault.code(),
                    });
                }
                last = Some(LastStep {
                    hash: stretch.mission,
                    step,
                    at_us,
                });
            }
            let end_us = at_us.saturating_add(period_us);
            let mut run_states = states.finish(&mission.name, end_us);
            run_states.start_us = begin_us;
            match self.missions.last_mut().filter(|_| goes_on) {
                Some(before) => join(before, run_states),
                None => self.missions.push(run_states),
            }
            let first_us = self.span_us.map_or(begin_us, |(first_us, _)| first_us);
            self.span_us = Some((first_us, end_us));
            before = Some(stretch);
            ended?;
        }
        recording.check_end()
    }
}

/// Adds the states of a mission behind a gap to those before it.
fn join(before: &mut MissionStates, behind: MissionStates) {
    before.end_us = behind.end_us;
    for region in behind.regions {
        match (before.regions.iter_mut()).find(|known| known.path == region.path) {
            Some(known) => known.spans.extend(region.spans),
            None => before.regions.push(region),
        }
    }
}

struct Watcher<'t> {
    t_us: u64,
    run: usize,
    transitions: &'t mut Vec<TransitionThen>,
}

impl Observer for Watcher<'_> {
    fn transition(&mut self, taken: TransitionTaken) {
        self.transitions.push(TransitionThen {
            t_us: self.t_us,
            run: self.run,
            region: taken.region_instance.into(),
            transition: taken.transition.into(),
        });
    }
}
