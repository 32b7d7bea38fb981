//! What happened in a run, told as it happens and kept for afterwards: the trace, the words for the
//! person who watches, the states for the picture, the ends of background runs. All of it comes
//! from the robot's own records.

use std::io::{self, Write};
use std::sync::Arc;

use esm_link::black_box::Event;
use esm_link::message::SafeReason;
use esm_link::trace::{EMERGENCY, TraceEvent};
use esm_link::trial::FallBackReason;

use crate::behaviour_words::{behaviour, came_up, change, corrected, reaction, situation, state};
use crate::pictures::{Mark, MissionStates, StatesRecorder};
use crate::recording::file::BackgroundRunEnd;
use crate::trace::Snapshot;
use crate::trace::directory::Directory;
use crate::trace::records::{Ended, RecordTrace};

/// Follows the records of a run, mission after mission.
pub struct Story<W> {
    until_us: Option<u64>,
    scene: Scene<W>,
    missions: Vec<MissionStates>,
    marks: Vec<Mark>,
    ends: Vec<BackgroundRunEnd>,
    counts: Counts,
    fault: Option<String>,
    /// Robot time at which the mission that runs had reached all its final states.
    finished_us: Option<u64>,
    ended: bool,
    has_stepped: bool,
}

/// What the trace is written to: at rest between missions, else in the hands of one.
enum Scene<W> {
    Empty(W),
    Playing(Box<Playing<W>>),
    /// Only while one becomes the other.
    Changing,
}

struct Playing<W> {
    name: String,
    index: u32,
    start_us: u64,
    period_us: u64,
    next_step: u64,
    directory: Arc<Directory>,
    trace: RecordTrace<W>,
    states: StatesRecorder,
}

/// What a run had how often.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Macro steps in the trace.
    pub macro_steps: u64,
    /// Transitions in the trace.
    pub transitions: u64,
}

/// A story when it is over.
pub struct Told<W> {
    /// Where the trace went.
    pub out: W,
    /// The states of each mission over time.
    pub missions: Vec<MissionStates>,
    /// What happened at single moments.
    pub marks: Vec<Mark>,
    /// Where background runs ended.
    pub ends: Vec<BackgroundRunEnd>,
    /// What it had how often.
    pub counts: Counts,
    /// What stopped the last mission, if anything did.
    pub fault: Option<String>,
    /// Robot time at which the last mission had reached all its final states, if it has.
    pub finished_us: Option<u64>,
}

impl<W: Write> Story<W> {
    /// A story whose trace goes to `out`, of robot time up to `until_us`.
    pub fn new(out: W, until_us: Option<u64>) -> Self {
        Story {
            until_us,
            scene: Scene::Empty(out),
            missions: Vec::new(),
            marks: Vec::new(),
            ends: Vec::new(),
            counts: Counts::default(),
            fault: None,
            finished_us: None,
            ended: false,
            has_stepped: false,
        }
    }

    /// It ends there, as it turned out.
    pub fn ends_at(&mut self, until_us: Option<u64>) {
        self.until_us = until_us;
    }

    /// A mission starts, with its first macro step at `start_us` of robot time.
    ///
    /// # Errors
    /// When the trace cannot be written.
    pub fn mission(
        &mut self,
        name: &str,
        directory: Arc<Directory>,
        start_us: u64,
    ) -> io::Result<()> {
        if self.is_after_the_end(start_us) {
            self.ended = true;
            return Ok(());
        }
        let index = self.missions.len() as u32 + u32::from(self.is_playing());
        if index > 0 {
            self.marks.push(Mark {
                t_us: start_us,
                label: format!("{name} takes over"),
            });
        }
        let out = self.end_mission(start_us)?;
        self.finished_us = None;
        if let Some(out) = out {
            self.scene = Scene::Playing(Box::new(Playing {
                name: name.to_owned(),
                index,
                start_us,
                period_us: directory.interpreter_period_us().into(),
                next_step: 0,
                trace: RecordTrace::new(out, Arc::clone(&directory)),
                states: StatesRecorder::new(Arc::clone(&directory), start_us),
                directory,
            }));
        }
        Ok(())
    }

    /// Takes the robot's next record; `tell` gets the words for the person who watches.
    ///
    /// # Errors
    /// When the trace cannot be written.
    pub fn record(
        &mut self,
        record: &TraceEvent<'_>,
        tell: &mut dyn FnMut(String),
    ) -> io::Result<()> {
        self.has_stepped = false;
        let Scene::Playing(playing) = &mut self.scene else {
            return Ok(());
        };
        let at_us = match *record {
            TraceEvent::Step { step, .. } | TraceEvent::Fault { step, .. } => {
                playing.robot_us_of(step)
            }
            _ => playing.robot_us_of(playing.next_step),
        };
        if self.until_us.is_some_and(|until_us| at_us > until_us) {
            self.ended = true;
        }
        if self.ended {
            return Ok(());
        }
        let time = at_us as f64 / 1e6;
        match *record {
            TraceEvent::Transition {
                region_instance,
                transition,
                ..
            } => {
                self.counts.transitions += 1;
                if let Some(words) = playing
                    .directory
                    .transition(region_instance.into(), transition.into())
                {
                    let sent = match words.sent.as_slice() {
                        [] => String::new(),
                        sent => format!("  sends {}", sent.join(", ")),
                    };
                    tell(format!(
                        "{time:>9.3} s  {} -> {}{sent}",
                        words.from, words.to
                    ));
                }
            }
            TraceEvent::BackgroundRunEnded {
                task_instance,
                activation,
            } => self.ends.push(BackgroundRunEnd {
                mission: playing.index,
                activation,
                task_instance,
            }),
            TraceEvent::Overrun {
                task_instance,
                took_us,
            } => {
                let task = playing.path_of_task(task_instance);
                tell(format!(
                    "{time:>9.3} s  {task} took {took_us} us, longer than its slot"
                ));
            }
            TraceEvent::DeadlineMiss { slot, count } => {
                tell(format!(
                    "{time:>9.3} s  {count} occurrences of the slot at place {slot} were missed"
                ));
            }
            TraceEvent::MotorsOff { reason } => {
                let why = motors_off_reason(reason);
                tell(format!("{time:>9.3} s  motors off: {why}"));
                self.marks.push(Mark {
                    t_us: at_us,
                    label: format!("motors off: {why}"),
                });
            }
            TraceEvent::FellBack { reason, .. } => {
                let why =
                    FallBackReason::from_number(reason).map_or(UNKNOWN_REASON, fall_back_reason);
                tell(format!("{time:>9.3} s  falls back: {why}"));
                self.marks.push(Mark {
                    t_us: at_us,
                    label: format!("falls back: {why}"),
                });
            }
            TraceEvent::Noted(event) => {
                if let Some(words) = playing.noted(event) {
                    tell(format!("{time:>9.3} s  {words}"));
                }
            }
            TraceEvent::Started { .. }
            | TraceEvent::Step { .. }
            | TraceEvent::Same { .. }
            | TraceEvent::Fault { .. }
            | TraceEvent::BackgroundRunStarted { .. } => {}
        }
        match playing.trace.record(record)? {
            Some(Ended::Step(at)) => {
                self.counts.macro_steps += 1;
                self.has_stepped = true;
                playing.next_step = at.step + 1;
                playing.states.step(at.t_us, playing.trace.states());
                let states = playing.trace.states();
                let has_finished = || {
                    let current = |region| states.current(region);
                    playing.directory.has_finished(current)
                };
                if self.finished_us.is_none() && has_finished() {
                    tell(format!(
                        "{time:>9.3} s  all final states are reached: the mission has finished"
                    ));
                    self.finished_us = Some(at_us);
                }
                // The next macro step, if there is one, is of no interest any more.
                self.ended = self
                    .until_us
                    .is_some_and(|until_us| playing.robot_us_of(playing.next_step) > until_us);
            }
            Some(Ended::Fault(at, code)) => {
                playing.next_step = at.step + 1;
                tell(format!("{time:>9.3} s  the machine stopped: {code}"));
                self.fault = Some(code.to_owned());
                self.marks.push(Mark {
                    t_us: at_us,
                    label: code.to_owned(),
                });
            }
            None => {}
        }
        Ok(())
    }

    /// Whether the mission that runs has reached all its final states.
    pub fn has_finished(&self) -> bool {
        self.finished_us.is_some()
    }

    /// Whether all of the time of interest has been told.
    pub fn has_ended(&self) -> bool {
        self.ended
    }

    /// Macro steps of the mission that runs which the trace holds, or would if none had been
    /// missed.
    pub fn steps(&self) -> Option<u64> {
        match &self.scene {
            Scene::Playing(playing) => Some(playing.next_step),
            Scene::Empty(_) | Scene::Changing => None,
        }
    }

    /// Robot time of the macro step that is told, in microseconds.
    pub fn now_us(&self) -> Option<u64> {
        match &self.scene {
            Scene::Playing(playing) => Some(playing.robot_us_of(playing.next_step)),
            Scene::Empty(_) | Scene::Changing => None,
        }
    }

    /// Whether the last record ended a macro step.
    pub fn has_stepped(&self) -> bool {
        self.has_stepped
    }

    /// Paths of the states that are current behind the last macro step that was told.
    pub fn active(&self) -> Vec<String> {
        let Scene::Playing(playing) = &self.scene else {
            return Vec::new();
        };
        let states = playing.trace.states();
        let active = playing.directory.active(|region| states.current(region));
        let paths = active.filter_map(|id| playing.directory.state(id));
        paths.map(|state| state.path.clone()).collect()
    }

    /// What stopped the mission that runs, if anything did.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Ends the story at `end_us` of robot time.
    ///
    /// # Errors
    /// When the trace cannot be written.
    pub fn finish(mut self, end_us: u64) -> io::Result<Option<Told<W>>> {
        let out = self.end_mission(end_us)?;
        Ok(out.map(|out| Told {
            out,
            missions: self.missions,
            marks: self.marks,
            ends: self.ends,
            counts: self.counts,
            fault: self.fault,
            finished_us: self.finished_us,
        }))
    }

    fn is_playing(&self) -> bool {
        matches!(self.scene, Scene::Playing(_))
    }

    fn is_after_the_end(&self, robot_us: u64) -> bool {
        self.ended || self.until_us.is_some_and(|until_us| robot_us > until_us)
    }

    /// Ends the mission that plays, if one does, and gives back what the trace is written to.
    fn end_mission(&mut self, end_us: u64) -> io::Result<Option<W>> {
        match std::mem::replace(&mut self.scene, Scene::Changing) {
            Scene::Empty(out) => Ok(Some(out)),
            Scene::Playing(mut playing) => {
                playing.trace.flush()?;
                self.missions
                    .push(playing.states.finish(&playing.name, end_us));
                Ok(Some(playing.trace.into_inner()))
            }
            Scene::Changing => Ok(None),
        }
    }
}

impl<W> Playing<W> {
    /// What a task has noted, in words; where the robot is meanwhile its path shows.
    fn noted(&self, event: Event) -> Option<String> {
        let names = self.directory.task_names();
        Some(match event {
            Event::Behaviour {
                key,
                task,
                from,
                to,
            } => change(&behaviour(key, task, names), key, state(from), state(to)),
            Event::Situation {
                key,
                task,
                situation: number,
                reaction: done,
            } => came_up(
                &behaviour(key, task, names),
                key,
                situation(number),
                reaction(done),
            ),
            Event::Corrected {
                is_difference,
                is_refused,
            } => corrected(is_difference, is_refused).to_owned(),
            _ => return None,
        })
    }

    /// Robot time of a macro step.
    fn robot_us_of(&self, step: u64) -> u64 {
        self.start_us
            .saturating_add(step.saturating_mul(self.period_us))
    }

    fn path_of_task(&self, task_instance: u16) -> String {
        self.directory
            .task_states()
            .get(usize::from(task_instance))
            .and_then(|state| self.directory.state(*state))
            .map_or_else(
                || format!("task {task_instance}"),
                |state| state.path.clone(),
            )
    }
}

/// Why motors are off, in words.
pub fn safe_reason(reason: SafeReason) -> &'static str {
    match reason {
        SafeReason::EventQueueOverflow => "the machine sent more events than its queue holds",
        SafeReason::MacroStepLimit => "a macro step of the machine had no end",
        SafeReason::Overruns => "tasks took longer than their slots too often",
        SafeReason::DeadlineMiss => "too many slots were missed in a row",
        SafeReason::BodyLost => "the robot's body does not answer",
        SafeReason::LowBattery => "the battery is low",
        SafeReason::LinkLost => "the host has not called for too long",
        SafeReason::Board => "the board found something wrong",
        SafeReason::MonitorSilent => "a task that watches something says nothing any more",
    }
}

/// Why a mission on trial was given up, in words.
pub fn fall_back_reason(reason: FallBackReason) -> &'static str {
    match reason {
        FallBackReason::NotConfirmed => "it was not confirmed in time",
        FallBackReason::Asked => "it was asked to",
        FallBackReason::Failed(reason) => safe_reason(reason),
    }
}

const UNKNOWN_REASON: &str = "for a reason that this program does not know";

fn motors_off_reason(number: Option<u8>) -> &'static str {
    match number {
        None => "stopped by request",
        Some(EMERGENCY) => "an emergency stop",
        Some(number) => SafeReason::from_number(number).map_or(UNKNOWN_REASON, safe_reason),
    }
}
