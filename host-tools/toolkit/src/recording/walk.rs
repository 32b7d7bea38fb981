//! A recording, walked through micro step by micro step, forwards and backwards.
//!
//! A first pass over the recording keeps what the machine is every [`CHUNK_STEPS`] macro steps, and
//! how many moments there were before. From there such a chunk is run again whenever the walk comes
//! to it, so that any moment costs no more than a chunk, and memory holds the macro steps of one.
//!
//! What the machine was within a macro step is told by `Retold`.

use std::fmt;
use std::ops::Range;
use std::rc::Rc;

use esm_core::{Fault, TransitionTaken};
use thiserror::Error;

use super::choices::Choices;
use super::choosing::choices_of;
use super::limits::TooMuch;
use super::player::{LastStep, Player, Position, RecordedMission, Recording, ReplayError};
use super::retold::{MadeStep, MicroSteps, Retold, begun, step_words};
pub use super::retold::{Passed, Taken};
use super::stretch::time_of;
use super::surroundings::{Surroundings, flags_of};
use crate::inspect::guards::GuardReader;
use crate::nearest::nearest;
use crate::trace::directory::{StateEntry, StateId};

/// Macro steps between two that the walk can begin at, at most.
pub const CHUNK_STEPS: u64 = 1024;

/// Words that a place to begin at takes beside its machine, about.
const CHUNK_HEAD_WORDS: u64 = 50;

/// Words that the macro steps of such a chunk take in memory, about, where a machine is large: 128
/// MiB. Transitions in it, beyond which the next begins.
const MAX_CHUNK_WORDS: u64 = 1 << 25;
const MAX_CHUNK_TRANSITIONS: u64 = 1 << 20;

/// A micro step in which a transition was taken; or a macro step in which none was, but a flag
/// changed that was looked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Moment {
    /// Number of the stretch of the recording.
    pub stretch: usize,
    /// Name of its mission.
    pub mission: String,
    /// Number of the macro step in its mission.
    pub step: u64,
    /// Nominal time of it, in microseconds since the first macro step of the first mission.
    pub t_us: u64,
    /// Number of the micro step in it, from 0.
    pub micro: u8,
    /// The event of it.
    pub event: String,
    /// The transitions that were taken, in order.
    pub taken: Vec<Taken>,
    /// Paths of the states that were current behind it.
    pub active: Vec<String>,
    /// The fault that ended the macro step, and with it the machine.
    pub fault: Option<Fault>,
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:.3} s, {}: macro step {}, micro step {}, on {}",
            self.t_us as f64 / 1e6,
            self.mission,
            self.step,
            self.micro,
            self.event
        )?;
        for taken in &self.taken {
            writeln!(f, "  {} -> {}", taken.from, taken.to)?;
            if let Some(guard) = &taken.guard {
                let terms = taken.terms.iter();
                let terms: Vec<String> = terms.map(|(name, is)| format!("{name} = {is}")).collect();
                writeln!(f, "    [{guard}]   {}", terms.join(", "))?;
            }
            for (verb, what) in [
                ("sends", &taken.sent),
                ("sets", &taken.set),
                ("clears", &taken.cleared),
            ] {
                if !what.is_empty() {
                    writeln!(f, "    {verb} {}", what.join(", "))?;
                }
            }
        }
        writeln!(f, "  now {}", self.active.join(", "))
    }
}

/// Where a walk can begin.
struct Chunk {
    stretch: usize,
    /// How often the robot was reset before: its times began anew with each one.
    resets: usize,
    /// Number of the mission's macro step.
    step: u64,
    t_us: u64,
    position: Position,
    /// Macro steps in it.
    made: u64,
    /// Moments before it.
    first: u64,
    /// Flags behind the moment before it in its stretch, or where that begins.
    flags: Vec<u32>,
}

/// A moment that was told.
struct Told<'r> {
    chunk: usize,
    moment: Moment,
    /// The machine behind it.
    retold: Retold<'r>,
    /// The region instances that were entered in it.
    begun: Vec<usize>,
    /// Flags behind the moment before.
    flags_before: Vec<u32>,
}

/// A walk through a recording.
pub struct Walk<'r> {
    recording: &'r Recording,
    /// One for each mission.
    guards: Vec<Rc<GuardReader<'r>>>,
    chunks: Vec<Chunk>,
    /// What the times of each stretch are moved by on a line of time that never goes back.
    moved_us: Vec<u64>,
    moments: u64,
    /// Where a fault ended a stretch.
    faults: Vec<(usize, u64, Fault)>,
    /// The chunk that the walk is in.
    chunk: usize,
    /// The chunk whose macro steps are held, as far as transitions were taken in them.
    loaded: Option<usize>,
    steps: Vec<MadeStep>,
    /// Number of the next moment.
    next: u64,
    told: Option<Told<'r>>,
}

impl<'r> Walk<'r> {
    /// A walk that stands before the first moment. Takes the time of a replay. Where the replay
    /// ends early the walk does, too; then the cause comes with it.
    pub fn new(recording: &'r Recording, over_gaps: bool) -> (Self, Option<ReplayError>) {
        let missions = recording.missions.iter();
        let mut walk = Walk {
            recording,
            guards: missions
                .map(|mission| Rc::new(GuardReader::of(&mission.verified)))
                .collect(),
            chunks: Vec::new(),
            moved_us: Vec::new(),
            moments: 0,
            faults: Vec::new(),
            chunk: 0,
            loaded: None,
            steps: Vec::new(),
            next: 0,
            told: None,
        };
        let ended = walk.find_chunks(over_gaps).err();
        (walk, ended)
    }

    fn find_chunks(&mut self, over_gaps: bool) -> Result<(), ReplayError> {
        let recording = self.recording;
        let mut last: Option<LastStep> = None;
        let (mut resets, mut kept_words, mut transitions) = (0, 0, 0);
        for (number, stretch) in recording.stretches.iter().enumerate() {
            let mission = recording.mission_of(stretch, over_gaps, last)?;
            let mut arena = vec![0; mission.verified.arena_words()];
            let mut player = Player::new(mission, stretch, &mut arena)?;
            let mut flags = player.machine().input_words().to_vec();
            let at_us = |step| time_of(stretch.start_us, step, period_us(mission));
            let begins_us = at_us(player.machine().progress().steps);
            resets += usize::from(last.is_some_and(|last| begins_us < last.at_us));
            let mut moved_us = self.moved_us.last().copied().unwrap_or(0);
            if let Some(last) = last
                && begins_us.saturating_add(moved_us) < last.at_us.saturating_add(moved_us)
            {
                moved_us = (last.at_us)
                    .saturating_add(moved_us)
                    .saturating_add(period_us(mission))
                    .saturating_sub(begins_us);
            }
            self.moved_us.push(moved_us);
            let words = player.machine().state_words().len() + flags.len();
            let kept = words as u64 + CHUNK_HEAD_WORDS;
            let chunk_steps =
                (MAX_CHUNK_WORDS / step_words(player.machine())).clamp(1, CHUNK_STEPS);
            loop {
                kept_words += kept;
                TooMuch::check(
                    "words of machines to walk from",
                    kept_words,
                    recording.limits.kept_words,
                )?;
                let steps = player.machine().progress().steps;
                self.chunks.push(Chunk {
                    stretch: number,
                    resets,
                    step: steps,
                    t_us: at_us(steps),
                    position: player.position(),
                    made: 0,
                    first: self.moments,
                    flags: flags.clone(),
                });
                let (mut goes_on, mut made, mut in_chunk) = (true, 0, 0);
                while made < chunk_steps && in_chunk < MAX_CHUNK_TRANSITIONS {
                    goes_on = player.enter()?.goes_on && player.machine().fault().is_none();
                    if !goes_on {
                        break;
                    }
                    let step = player.machine().progress().steps;
                    last = Some(LastStep {
                        hash: stretch.mission,
                        step,
                        at_us: at_us(step),
                    });
                    let mut micro_steps = MicroSteps::default();
                    // A fault is the machine's end, as in the run.
                    if let Err(fault) = player.macro_step(&mut micro_steps) {
                        self.faults.push((number, step, fault));
                    }
                    made += 1;
                    in_chunk += micro_steps.transitions;
                    transitions += micro_steps.transitions;
                    TooMuch::check("transitions", transitions, recording.limits.transitions)?;
                    if micro_steps.count > 0 {
                        self.moments += micro_steps.count;
                        flags.copy_from_slice(player.machine().input_words());
                    }
                    if let Some(chunk) = self.chunks.last_mut() {
                        chunk.made = made;
                    }
                }
                if !goes_on {
                    break;
                }
            }
        }
        recording.check_end()
    }

    /// Mission and reader of the guards of a stretch that was walked through.
    pub(super) fn mission_of(
        &self,
        stretch: usize,
    ) -> Option<(&'r RecordedMission, &Rc<GuardReader<'r>>)> {
        let recording = self.recording;
        let hash = recording.stretches.get(stretch)?.mission;
        let number = recording.number_of(hash)?;
        (recording.missions.get(number)).zip(self.guards.get(number))
    }

    /// Runs a chunk again; `made` is shown each macro step, with the flags behind the one before
    /// and behind it, and says whether it goes on.
    pub(super) fn run(&self, chunk: usize, mut made: impl FnMut(MadeStep, &[u32], &[u32]) -> bool) {
        let Some(chunk) = self.chunks.get(chunk) else {
            return;
        };
        let stretch = self.recording.stretches.get(chunk.stretch);
        let (Some(stretch), Some((mission, _))) = (stretch, self.mission_of(chunk.stretch)) else {
            return;
        };
        let mut arena = vec![0; mission.verified.arena_words()];
        // What can go wrong did so in the first pass, and was told.
        let Ok(mut player) = Player::at(mission, stretch, &chunk.position, &mut arena) else {
            return;
        };
        let mut flags_before = chunk.flags.clone();
        let mut flags_last = player.machine().input_words().to_vec();
        for _ in 0..chunk.made {
            match player.enter() {
                Ok(entries) if entries.goes_on && player.machine().fault().is_none() => {}
                _ => return,
            }
            let mut step = MadeStep::of(player.machine());
            step.fault = player.macro_step(&mut step).err();
            let flags = player.machine().input_words();
            step.flags_before.clone_from(&flags_before);
            if !step.taken.is_empty() {
                flags_before.copy_from_slice(flags);
            }
            if !made(step, &flags_last, flags) {
                return;
            }
            flags_last.copy_from_slice(flags);
        }
    }

    /// Holds the macro steps of a chunk in which transitions were taken.
    fn load(&mut self, chunk: usize) {
        if self.loaded == Some(chunk) {
            return;
        }
        let mut steps = std::mem::take(&mut self.steps);
        steps.clear();
        self.run(chunk, |step, _, _| {
            if !step.taken.is_empty() {
                steps.push(step);
            }
            true
        });
        self.steps = steps;
        self.loaded = Some(chunk);
    }

    /// The chunk of the last macro step at or before a time, and the stretch that it is in. The
    /// time is of the line of time of [`Told`](super::told::Told).
    pub(super) fn place_at(&self, t_us: u64) -> Option<(usize, usize)> {
        let moved_us = |chunk: &Chunk| self.moved_us.get(chunk.stretch).copied().unwrap_or(0);
        let begins_us = |chunk: &Chunk| chunk.t_us.saturating_add(moved_us(chunk));
        let chunk = (self.chunks.iter()).rposition(|chunk| begins_us(chunk) <= t_us)?;
        Some((chunk, self.chunks.get(chunk)?.stretch))
    }

    /// The chunks, each with its stretch.
    pub(super) fn places(&self) -> impl DoubleEndedIterator<Item = (usize, usize)> {
        let places = self.chunks.iter().enumerate();
        places.map(|(chunk, it)| (chunk, it.stretch))
    }

    /// When a macro step of a stretch was, in microseconds since the first macro step of the first
    /// mission, on the line of time of [`Told`](super::told::Told).
    pub(super) fn time_of_step(&self, stretch: usize, step: u64) -> u64 {
        let start_us = (self.recording.stretches.get(stretch)).map_or(0, |it| it.start_us);
        let period_us = (self.mission_of(stretch)).map_or(0, |(mission, _)| period_us(mission));
        let moved_us = self.moved_us.get(stretch).copied().unwrap_or(0);
        time_of(start_us, step, period_us).saturating_add(moved_us)
    }

    /// What there was to choose from in the last macro step at or before a time, in microseconds
    /// since the first macro step of the first mission; none before that.
    pub fn choices_at(&self, t_us: u64) -> Option<Choices> {
        let (chunk, number) = self.place_at(t_us)?;
        let (mission, guards) = self.mission_of(number)?;
        let at_us = |step| self.time_of_step(number, step);
        let mut last = None;
        self.run(chunk, |made, _, _| {
            let goes_on = at_us(made.step) <= t_us;
            if goes_on {
                last = Some(made);
            }
            goes_on
        });
        let made = last?;
        let mut retold = Retold::new(mission, Rc::clone(guards));
        Some(choices_of(&mut retold, &made, (number, at_us(made.step))))
    }

    /// How many moments there are.
    pub fn count(&self) -> u64 {
        self.moments
    }

    /// Number of the moment that was told last, from 0; or, if that is none in which a transition
    /// was taken, or none was told, of the next one.
    pub fn number(&self) -> u64 {
        match &self.told {
            Some(told) if !told.moment.taken.is_empty() => self.next.saturating_sub(1),
            _ => self.next,
        }
    }

    /// The moment that was told last.
    pub fn moment(&self) -> Option<&Moment> {
        self.told.as_ref().map(|told| &told.moment)
    }

    /// What the machine was behind the moment that was told last.
    pub fn surroundings(&self) -> Option<Surroundings> {
        let told = self.told.as_ref()?;
        let before = &told.flags_before;
        let was_set = |flag: usize| {
            let word = before.get(flag / 32);
            word.is_some_and(|word| word >> (flag % 32) & 1 != 0)
        };
        Some(Surroundings::of(&told.retold, &told.begun, was_set))
    }

    /// The fault that ended a stretch, and its macro step.
    pub fn fault_of(&self, stretch: usize) -> Option<(u64, Fault)> {
        let of_it = |it: &&(usize, u64, Fault)| it.0 == stretch;
        self.faults.iter().find(of_it).map(|it| (it.1, it.2))
    }

    /// The chunk that a moment is in.
    fn chunk_of(&self, number: u64) -> usize {
        let behind = self.chunks.partition_point(|chunk| chunk.first <= number);
        behind.saturating_sub(1)
    }

    /// The macro step that a moment is in, by its place in the loaded chunk, and the number of that
    /// one's first moment.
    fn place_of(&mut self, number: u64) -> Option<(usize, u64)> {
        if number >= self.moments {
            return None;
        }
        let chunk = self.chunk_of(number);
        let mut first = self.chunks.get(chunk)?.first;
        self.load(chunk);
        for (place, step) in self.steps.iter().enumerate() {
            let moments = step.micro_steps().count() as u64;
            if number < first + moments {
                return Some((place, first));
            }
            first += moments;
        }
        None
    }

    /// Goes to the moment with a number, from 0.
    pub fn to_number(&mut self, number: u64) -> Option<&Moment> {
        let (place, first) = self.place_of(number)?;
        let chunk = self.loaded?;
        let step = self.steps.get(place)?;
        let stretch = self.chunks.get(chunk)?.stretch;
        let (mission, guards) = self.mission_of(stretch)?;
        let mut retold = Retold::new(mission, Rc::clone(guards));
        retold.begin(step);
        let mut flags_before = step.flags_before.clone();
        let mut told = None;
        let wanted = usize::try_from(number - first).unwrap_or(usize::MAX);
        for (at, of_one) in step.micro_steps().enumerate().take(wanted + 1) {
            if at < wanted {
                of_one.iter().for_each(|taken| retold.take(taken));
                flags_before = retold.flags().to_vec();
            } else {
                told = Some(of_one);
            }
        }
        let is_last = step.micro_steps().nth(wanted + 1).is_none();
        let fault = step.fault.filter(|_| is_last);
        self.told = Some(self.tell(chunk, retold, told?, fault, flags_before)?);
        self.chunk = chunk;
        self.next = number + 1;
        self.moment()
    }

    /// Tells of a micro step; the machine stands before it.
    fn tell(
        &self,
        chunk: usize,
        mut retold: Retold<'r>,
        taken: &[TransitionTaken],
        fault: Option<Fault>,
        flags_before: Vec<u32>,
    ) -> Option<Told<'r>> {
        let number = self.chunks.get(chunk)?.stretch;
        let stretch = self.recording.stretches.get(number)?;
        let (mission, _) = self.mission_of(number)?;
        let mut moment = Moment {
            stretch: number,
            mission: mission.name.clone(),
            step: retold.step,
            t_us: time_of(stretch.start_us, retold.step, retold.period_us),
            micro: taken.first().map_or(0, |taken| taken.micro),
            event: retold.directory.event(0).to_owned(),
            taken: Vec::new(),
            active: Vec::new(),
            fault,
        };
        let mut entered = Vec::new();
        for taken in taken {
            let (region, transition) = (taken.region_instance.into(), taken.transition.into());
            if let Some(words) = retold.directory.transition(region, transition) {
                words.event.clone_into(&mut moment.event);
            }
            moment.taken.extend(retold.words(taken));
            retold.take(taken);
            let begun = begun(&retold.tables, taken);
            entered.extend(begun.into_iter().map(|(region, _)| region));
        }
        moment.active = retold.active();
        Some(Told {
            chunk,
            moment,
            retold,
            begun: entered,
            flags_before,
        })
    }

    /// Tells of a macro step in which no transition was taken.
    fn tell_quiet(&mut self, chunk: usize, number: u64) -> Option<&Moment> {
        let mut next = self.chunks.get(chunk)?.first;
        let mut found = None;
        self.run(chunk, |step, _, _| {
            if step.step == number {
                found = Some(step);
                return false;
            }
            next += step.micro_steps().count() as u64;
            true
        });
        let step = found?;
        let (mission, guards) = self.mission_of(self.chunks.get(chunk)?.stretch)?;
        let mut retold = Retold::new(mission, Rc::clone(guards));
        retold.begin(&step);
        self.told = Some(self.tell(chunk, retold, &[], step.fault, step.flags_before)?);
        self.chunk = chunk;
        self.next = next;
        self.moment()
    }

    /// The next moment, behind which the walk stands then.
    pub fn forward(&mut self) -> Option<&Moment> {
        if self.next >= self.moments {
            self.chunk = self.chunks.len().saturating_sub(1);
            return None;
        }
        self.to_number(self.next)
    }

    /// The moment before the one that was told last, behind which the walk stands then; none at the
    /// beginning.
    pub fn back(&mut self) -> Option<&Moment> {
        match self.number().checked_sub(1) {
            Some(before) => self.to_number(before),
            None => {
                (self.next, self.chunk) = (0, 0);
                self.told = None;
                None
            }
        }
    }

    /// The first moment of the next macro step in which a transition was taken.
    pub fn next_macro_step(&mut self) -> Option<u64> {
        let told = self.told.as_ref().map(|told| &told.moment);
        let here = told.map(|moment| (moment.stretch, moment.step));
        let mut number = self.next;
        while here.is_some() && self.macro_step_of(number) == here {
            number += 1;
        }
        (number < self.moments).then_some(number)
    }

    /// Stretch and number of the macro step of a moment.
    fn macro_step_of(&mut self, number: u64) -> Option<(usize, u64)> {
        let (place, _) = self.place_of(number)?;
        let stretch = self.chunks.get(self.loaded?)?.stretch;
        Some((stretch, self.steps.get(place)?.step))
    }

    /// The first moment of the macro step before, of those in which a transition was taken.
    pub fn macro_step_before(&mut self) -> Option<u64> {
        let is_quiet = self.moment().is_none_or(|moment| moment.taken.is_empty());
        let first = match is_quiet {
            true => self.next,
            false => self.place_of(self.number())?.1,
        };
        Some(self.place_of(first.checked_sub(1)?)?.1)
    }

    /// Number of the first moment in a macro step, or behind it, of a stretch.
    pub fn at_step(&mut self, stretch: usize, step: u64) -> Option<u64> {
        self.at(
            0..self.chunks.len(),
            |chunk| (chunk.stretch, chunk.step) <= (stretch, step),
            |chunk, made| (chunk.stretch, made.step) >= (stretch, step),
        )
    }

    /// Number of the first moment at a time, in microseconds since the first macro step of the
    /// first mission, or behind it. Where the robot was reset its times began anew: it is looked
    /// for from where the robot started before the place of the walk, and where nothing is found
    /// from there to the end, from the beginning.
    pub fn at_time(&mut self, t_us: u64) -> Option<u64> {
        let here = self.chunks.get(self.chunk)?.resets;
        let mut stretches: Vec<Range<usize>> = Vec::new();
        let mut first_here = 0;
        for stretch in self.chunks.chunk_by(|a, b| a.stretch == b.stretch) {
            let begin = stretches.last().map_or(0, |before| before.end);
            stretches.push(begin..begin + stretch.len());
            let is_before = stretch.first().is_some_and(|chunk| chunk.resets < here);
            first_here += usize::from(is_before);
        }
        stretches.rotate_left(first_here);
        (stretches.into_iter()).find_map(|stretch| self.at_time_in(stretch, t_us))
    }

    /// The same, in the chunks of one stretch, in which times ascend.
    fn at_time_in(&mut self, stretch: Range<usize>, t_us: u64) -> Option<u64> {
        let recording = self.recording;
        self.at(
            stretch,
            |chunk| chunk.t_us <= t_us,
            |chunk, made| {
                let stretch = recording.stretches.get(chunk.stretch);
                let mission = stretch.and_then(|stretch| recording.mission(stretch.mission));
                let period_us = mission.map_or(0, period_us);
                let start_us = stretch.map_or(0, |stretch| stretch.start_us);
                time_of(start_us, made.step, period_us) >= t_us
            },
        )
    }

    /// Number of the first moment in some chunks that is there, where chunks that begin before it
    /// come first.
    fn at(
        &mut self,
        chunks: Range<usize>,
        begins_before: impl Fn(&Chunk) -> bool,
        is_there: impl Fn(&Chunk, &MadeStep) -> bool,
    ) -> Option<u64> {
        let looked_through = self.chunks.get(chunks.clone())?;
        let before = looked_through.partition_point(begins_before);
        let mut number = looked_through.get(before.saturating_sub(1))?.first;
        let end = (self.chunks.get(chunks.end)).map_or(self.moments, |behind| behind.first);
        while number < end {
            let (place, first) = self.place_of(number)?;
            let (chunk, made) = (self.chunks.get(self.loaded?)?, self.steps.get(place)?);
            if is_there(chunk, made) {
                return Some(first);
            }
            number = first + made.micro_steps().count() as u64;
        }
        None
    }

    /// Goes to the first moment in a macro step, or behind it, of the stretch that the walk is in;
    /// to the end, if there is none.
    pub fn to_step(&mut self, step: u64) -> Option<&Moment> {
        let stretch = self.chunks.get(self.chunk)?.stretch;
        let number = self.at_step(stretch, step);
        self.go_or_stand_at_the_end(number)
    }

    /// Goes to the first moment at a time, in microseconds since the first macro step of the first
    /// mission, or behind it; to the end, if there is none.
    pub fn to_time(&mut self, t_us: u64) -> Option<&Moment> {
        let number = self.at_time(t_us);
        self.go_or_stand_at_the_end(number)
    }

    fn go_or_stand_at_the_end(&mut self, number: Option<u64>) -> Option<&Moment> {
        if number.is_none() {
            self.next = self.moments;
            self.chunk = self.chunks.len().saturating_sub(1);
            self.told = None;
        }
        self.to_number(number?)
    }
}

/// States and flags that are looked for, in each mission of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sought {
    /// As it was asked for.
    pub text: String,
    /// Region instances and states of the missions, in their order.
    states: Vec<Vec<(usize, usize)>>,
    /// Bits of flags.
    flags: Vec<Vec<usize>>,
}

/// Why nothing can be looked for.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SoughtError {
    /// There is no such state.
    #[error("no mission of the recording has a state `{name}`{}", meant(nearest))]
    NoState {
        /// As it was asked for.
        name: String,
        /// What may be meant.
        nearest: Option<String>,
    },
    /// There is no such flag.
    #[error("no state that is called so has a flag `{name}`{}", meant(nearest))]
    NoFlag {
        /// As it was asked for.
        name: String,
        /// What may be meant.
        nearest: Option<String>,
    },
}

fn meant(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |nearest| {
        format!(": did you mean `{nearest}`?")
    })
}

/// A search that is under way.
#[derive(Clone, Debug)]
pub struct Search {
    sought: Sought,
    is_backwards: bool,
    /// The next chunk that is looked through.
    chunk: Option<usize>,
    /// Macro step and micro step that it begins behind, or before, in that chunk.
    from: Option<(u64, u8)>,
}

/// What came of looking through a part of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Searched {
    /// It was found, and the walk stands there.
    Found,
    /// Not yet; this is how much of the recording lies before the place.
    GoesOn {
        /// In hundredths.
        percent: u64,
    },
    /// There is none in this direction.
    Nothing,
}

impl Search {
    /// What is looked for.
    pub fn sought(&self) -> &Sought {
        &self.sought
    }

    /// Whether it goes towards the beginning.
    pub fn is_backwards(&self) -> bool {
        self.is_backwards
    }
}

impl<'r> Walk<'r> {
    /// What is to be looked for: the path of a state, or the end of one, and for flags a dot and
    /// the name of one; without a state before the dot the flags of all states.
    ///
    /// # Errors
    /// [`SoughtError`]
    pub fn sought(&self, text: &str) -> Result<Sought, SoughtError> {
        let (name, flag) = match text.split_once('.') {
            Some((name, flag)) => (name, Some(flag)),
            None => (text, None),
        };
        let mut sought = Sought {
            text: text.to_owned(),
            states: Vec::new(),
            flags: Vec::new(),
        };
        let is_called = |state: &StateEntry| {
            let before = state.path.strip_suffix(name);
            before.is_some_and(|before| before.is_empty() || before.ends_with('/'))
        };
        let (mut some_state, mut names, mut flag_names) = (false, Vec::new(), Vec::new());
        for mission in &self.recording.missions {
            let directory = &*mission.directory;
            let tables = mission.verified.tables();
            let (mut states, mut flags) = (Vec::new(), Vec::new());
            for region in directory.regions() {
                for (local, state) in region.locals.iter().enumerate() {
                    let id = StateId {
                        region: region.index,
                        local,
                    };
                    names.push(state.name());
                    if !(name.is_empty() && flag.is_some() || is_called(state)) {
                        continue;
                    }
                    some_state = true;
                    let Some(flag) = flag else {
                        states.extend(directory.index_of(id).map(|state| (id.region, state)));
                        continue;
                    };
                    for own in flags_of(directory, &tables, id) {
                        flag_names.push(own.name);
                        if own.name == flag {
                            flags.push(own.bit);
                        }
                    }
                }
            }
            sought.states.push(states);
            sought.flags.push(flags);
        }
        let owned = |nearest: Option<&str>| nearest.map(str::to_owned);
        if !some_state {
            return Err(SoughtError::NoState {
                name: name.to_owned(),
                nearest: owned(nearest(name.rsplit('/').next().unwrap_or(name), names)),
            });
        }
        match flag {
            Some(flag) if sought.flags.iter().all(Vec::is_empty) => Err(SoughtError::NoFlag {
                name: flag.to_owned(),
                nearest: owned(nearest(flag, flag_names)),
            }),
            _ => Ok(sought),
        }
    }

    /// A search from where the walk stands.
    pub fn search(&self, sought: Sought, is_backwards: bool) -> Search {
        let told = self.told.as_ref();
        Search {
            sought,
            is_backwards,
            chunk: Some(told.map_or(0, |told| told.chunk)),
            from: told.map(|told| (told.moment.step, told.moment.micro)),
        }
    }

    /// Looks through the next part of the recording.
    pub fn look(&mut self, search: &mut Search) -> Searched {
        let Some(chunk) = search.chunk.filter(|chunk| *chunk < self.chunks.len()) else {
            return Searched::Nothing;
        };
        let mut hits = self.hits(chunk, &search.sought);
        if let Some(from) = search.from.take() {
            hits.retain(|hit| {
                let at = (hit.step, hit.micro);
                if search.is_backwards {
                    at < from
                } else {
                    at > from
                }
            });
        }
        let hit = match search.is_backwards {
            true => hits.last(),
            false => hits.first(),
        };
        if let Some(hit) = hit {
            let found = match hit.number {
                Some(number) => self.to_number(number),
                None => self.tell_quiet(chunk, hit.step),
            };
            if found.is_some() {
                return Searched::Found;
            }
        }
        search.chunk = match search.is_backwards {
            true => chunk.checked_sub(1),
            false => Some(chunk + 1),
        };
        match search.chunk {
            Some(chunk) if chunk < self.chunks.len() => Searched::GoesOn {
                percent: (100 * chunk / self.chunks.len()) as u64,
            },
            _ => Searched::Nothing,
        }
    }

    /// Where a chunk has what is looked for.
    fn hits(&self, chunk: usize, sought: &Sought) -> Vec<Hit> {
        let mut hits = Vec::new();
        let found = self.chunks.get(chunk).and_then(|chunk| {
            let (mission, guards) = self.mission_of(chunk.stretch)?;
            let index = (self.guards.iter()).position(|other| Rc::ptr_eq(other, guards))?;
            let sought = (sought.states.get(index)?, sought.flags.get(index)?);
            Some((chunk, Retold::new(mission, Rc::clone(guards)), sought))
        });
        let Some((begin, mut retold, (states, flags))) = found else {
            return hits;
        };
        if states.is_empty() && flags.is_empty() {
            return hits;
        }
        let set_of = |words: &[u32]| -> Vec<bool> {
            let is_set = |flag: &usize| {
                let word = words.get(flag / 32);
                word.is_some_and(|word| word >> (flag % 32) & 1 != 0)
            };
            flags.iter().map(is_set).collect()
        };
        let mut number = begin.first;
        self.run(chunk, |step, before, behind| {
            let mut known = set_of(before);
            if step.taken.is_empty() {
                if set_of(behind) != known {
                    hits.push(Hit {
                        step: step.step,
                        micro: 0,
                        number: None,
                    });
                }
            } else {
                retold.begin(&step);
                for of_one in step.micro_steps() {
                    let mut is_hit = false;
                    for taken in of_one {
                        retold.take(taken);
                        let begun = begun(&retold.tables, taken);
                        is_hit |= begun.iter().any(|begun| states.contains(begun));
                    }
                    let now = set_of(retold.flags());
                    is_hit |= now != known;
                    known = now;
                    if is_hit {
                        hits.push(Hit {
                            step: step.step,
                            micro: of_one.first().map_or(0, |taken| taken.micro),
                            number: Some(number),
                        });
                    }
                    number += 1;
                }
            }
            true
        });
        hits
    }
}

/// A place in a chunk that was looked for.
struct Hit {
    step: u64,
    micro: u8,
    /// Number of its moment; none where no transition was taken.
    number: Option<u64>,
}

fn period_us(mission: &RecordedMission) -> u64 {
    mission.directory.interpreter_period_us().into()
}
