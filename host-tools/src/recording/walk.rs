//! A recording, walked through micro step by micro step, forwards and backwards.
//!
//! A first pass over the recording keeps what the machine is every [`CHUNK_STEPS`] macro steps. From there such a chunk is run again whenever the walk comes to it, so that a step back costs
//! no more than a chunk, and memory holds the moments of one.
//!
//! The interpreter tells which transitions it took, in order. What flags were when a guard was evaluated follows from what they were before the macro step and from what the transitions before
//! it in the same macro step did: see `Retold`.

use std::fmt;
use std::sync::Arc;

use esm_core::tables::{Code, Guard, StateKind, Tables};
use esm_core::{Observer, TransitionTaken, format};

use super::player::{LastStep, Player, Position, RecordedMission, Recording, ReplayError};
use super::stretch::{Beginning, Stretch};
use crate::inspect::guards::{GuardReader, Read};
use crate::trace::directory::Directory;

/// Macro steps between two that the walk can begin at.
pub const CHUNK_STEPS: u64 = 1024;

/// A micro step in which a transition was taken.
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
}

/// A transition that was taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Path of its source.
    pub from: String,
    /// Path of its target.
    pub to: String,
    /// Its guard as in the source, if it has one.
    pub guard: Option<String>,
    /// The flags in it, each with its value when it was evaluated.
    pub terms: Vec<(String, bool)>,
    /// Whether the guard is true of these values, as it must be.
    pub holds: bool,
    /// Events that it sent.
    pub sent: Vec<String>,
    /// Paths of the flags that it set.
    pub set: Vec<String>,
    /// Paths of the flags that it cleared.
    pub cleared: Vec<String>,
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
    /// Number of the mission's macro step.
    step: u64,
    t_us: u64,
    position: Position,
    /// In which macro step the current state of each region instance was entered, where that is known.
    entered: Vec<Option<u64>>,
}

/// A walk through a recording.
pub struct Walk<'r> {
    recording: &'r Recording,
    chunks: Vec<Chunk>,
    /// The chunk that the walk is in, and its moments.
    chunk: usize,
    moments: Vec<Moment>,
    /// The next moment.
    next: usize,
}

impl<'r> Walk<'r> {
    /// A walk that stands before the first moment. Takes the time of a replay. Where the replay ends early the walk does, too; then the cause comes with it.
    pub fn new(recording: &'r Recording, over_gaps: bool) -> (Self, Option<ReplayError>) {
        let mut walk = Walk {
            recording,
            chunks: Vec::new(),
            chunk: 0,
            moments: Vec::new(),
            next: 0,
        };
        let ended = walk.find_chunks(over_gaps).err();
        walk.load(0);
        (walk, ended)
    }

    fn find_chunks(&mut self, over_gaps: bool) -> Result<(), ReplayError> {
        let recording = self.recording;
        let mut last = None;
        for (number, stretch) in recording.stretches.iter().enumerate() {
            let mission = recording.mission_of(stretch, over_gaps, last)?;
            let mut arena = vec![0; mission.verified.arena_words()];
            let mut player = Player::new(mission, stretch, &mut arena)?;
            let known = match stretch.beginning {
                Beginning::Anew => Some(0),
                // Also that of a mission that took over warm, with timers that run on.
                Beginning::State(..) => None,
            };
            let mut entered = vec![known; mission.directory.regions().len()];
            let tables = mission.verified.tables();
            loop {
                let steps = player.machine().progress().steps;
                self.chunks.push(Chunk {
                    stretch: number,
                    step: steps,
                    t_us: stretch.start_us + steps * period_us(mission),
                    position: player.position(),
                    entered: entered.clone(),
                });
                let mut goes_on = true;
                for _ in 0..CHUNK_STEPS {
                    goes_on = player.enter()?.goes_on && player.machine().fault().is_none();
                    if !goes_on {
                        break;
                    }
                    let step = player.machine().progress().steps;
                    last = Some(LastStep {
                        hash: stretch.mission,
                        step,
                        at_us: stretch.start_us + step * period_us(mission),
                    });
                    let mut seen = Seen::default();
                    // A fault is the machine's end, as in the run.
                    let _ = player.macro_step(&mut seen);
                    for taken in seen.0 {
                        note_entered(&tables, &taken, step, &mut entered, None);
                    }
                }
                if !goes_on {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Runs a chunk again.
    fn load(&mut self, chunk: usize) {
        self.chunk = chunk;
        self.next = 0;
        self.moments.clear();
        if let Some(chunk) = self.chunks.get(chunk) {
            // What can go wrong did so in the first pass, and was told.
            self.moments = self.moments_of(chunk).unwrap_or_default();
        }
    }

    fn moments_of(&self, chunk: &Chunk) -> Result<Vec<Moment>, ReplayError> {
        let mut moments = Vec::new();
        let Some(stretch) = self.recording.stretches.get(chunk.stretch) else {
            return Ok(moments);
        };
        let mission = self.recording.mission_of(stretch, true, None)?;
        let mut arena = vec![0; mission.verified.arena_words()];
        let mut player = Player::at(mission, stretch, &chunk.position, &mut arena)?;
        let mut retold = Retold::new(mission, chunk.entered.clone());
        for _ in 0..CHUNK_STEPS {
            match player.enter() {
                Ok(entries) if entries.goes_on && player.machine().fault().is_none() => {}
                _ => break,
            }
            let machine = player.machine();
            let step = machine.progress().steps;
            retold.begin(step, machine.input_words(), |region| {
                machine.current(region)
            });
            let mut seen = Seen::default();
            let _ = player.macro_step(&mut seen);
            retold.tell(chunk.stretch, stretch, &seen.0, &mut moments);
        }
        Ok(moments)
    }

    /// The next moment, behind which the walk stands then.
    pub fn forward(&mut self) -> Option<&Moment> {
        while self.next >= self.moments.len() {
            if self.chunk + 1 >= self.chunks.len() {
                return None;
            }
            self.load(self.chunk + 1);
        }
        self.next += 1;
        self.moments.get(self.next - 1)
    }

    /// The moment before the one that was told last, behind which the walk stands then; none at the beginning.
    pub fn back(&mut self) -> Option<&Moment> {
        // Before the one that was told last, and before what is told now.
        for _ in 0..2 {
            while self.next == 0 {
                if self.chunk == 0 {
                    return None;
                }
                self.load(self.chunk - 1);
                self.next = self.moments.len();
            }
            self.next -= 1;
        }
        self.forward()
    }

    /// Goes to the first moment in a macro step, or behind it, of the stretch that the walk is in.
    pub fn to_step(&mut self, step: u64) -> Option<&Moment> {
        let stretch = self.chunks.get(self.chunk)?.stretch;
        self.to(
            |chunk| (chunk.stretch, chunk.step) <= (stretch, step),
            |moment| (moment.stretch, moment.step) >= (stretch, step),
        )
    }

    /// Goes to the first moment at a time, in microseconds since the first macro step of the first mission, or behind it.
    pub fn to_time(&mut self, t_us: u64) -> Option<&Moment> {
        self.to(|chunk| chunk.t_us <= t_us, |moment| moment.t_us >= t_us)
    }

    fn to(
        &mut self,
        begins_before: impl Fn(&Chunk) -> bool,
        is_there: impl Fn(&Moment) -> bool,
    ) -> Option<&Moment> {
        let chunk = self.chunks.partition_point(begins_before).saturating_sub(1);
        self.load(chunk);
        while !is_there(self.forward()?) {}
        self.moments.get(self.next - 1)
    }
}

fn period_us(mission: &RecordedMission) -> u64 {
    mission.directory.interpreter_period_us().into()
}

/// The transitions of a macro step.
#[derive(Default)]
struct Seen(Vec<TransitionTaken>);

impl Observer for Seen {
    fn transition(&mut self, taken: TransitionTaken) {
        self.0.push(taken);
    }
}

/// Notes which region instances a transition made begin, and with which state.
fn note_entered(
    tables: &Tables<'_>,
    taken: &TransitionTaken,
    step: u64,
    entered: &mut [Option<u64>],
    mut current: Option<&mut [usize]>,
) {
    let region = usize::from(taken.region_instance);
    let Some(transition) = tables.transition(taken.transition.into()) else {
        return;
    };
    let mut begin = |region: usize, state: usize| {
        if let Some(entered) = entered.get_mut(region) {
            *entered = Some(step);
        }
        if let Some(place) = current.as_mut().and_then(|all| all.get_mut(region)) {
            *place = state;
        }
    };
    begin(region, transition.target);
    let Some(mut inside) = tables.first_region_inside(region, transition.target) else {
        return;
    };
    let instance = tables.region_instance(inside).map(|it| it.instance);
    // Each is numbered above the one before.
    while let Some(record) = tables.region_instance(inside)
        && Some(record.instance) == instance
    {
        begin(inside, record.initial);
        inside = record.next;
    }
}

/// A machine's flags and current states within a macro step, as they follow from the transitions that the interpreter took.
struct Retold<'m> {
    tables: Tables<'m>,
    directory: Arc<Directory>,
    guards: GuardReader<'m>,
    name: String,
    period_us: u64,
    step: u64,
    flags: Vec<u32>,
    current: Vec<usize>,
    entered: Vec<Option<u64>>,
}

impl<'m> Retold<'m> {
    fn new(mission: &'m RecordedMission, entered: Vec<Option<u64>>) -> Self {
        Retold {
            tables: mission.verified.tables(),
            directory: Arc::clone(&mission.directory),
            guards: GuardReader::of(&mission.verified),
            name: mission.name.clone(),
            period_us: period_us(mission),
            step: 0,
            flags: Vec::new(),
            current: Vec::new(),
            entered,
        }
    }

    /// Takes what the machine is before a macro step.
    fn begin(&mut self, step: u64, flags: &[u32], current: impl Fn(usize) -> usize) {
        self.step = step;
        self.flags.clear();
        self.flags.extend_from_slice(flags);
        self.current.clear();
        self.current.extend((0..self.entered.len()).map(current));
    }

    /// Adds a moment for each micro step in which transitions were taken.
    fn tell(
        &mut self,
        number: usize,
        stretch: &Stretch,
        seen: &[TransitionTaken],
        moments: &mut Vec<Moment>,
    ) {
        for of_one in seen.chunk_by(|a, b| a.micro == b.micro) {
            let mut moment = Moment {
                stretch: number,
                mission: self.name.clone(),
                step: self.step,
                t_us: stretch.start_us + self.step * self.period_us,
                micro: of_one.first().map_or(0, |taken| taken.micro),
                event: String::new(),
                taken: Vec::new(),
                active: Vec::new(),
            };
            for taken in of_one {
                self.take(taken, &mut moment);
            }
            let state = |region: usize| self.current.get(region).copied().unwrap_or(usize::MAX);
            let active = self.directory.active(state);
            let paths = active.filter_map(|id| self.directory.state(id));
            moment.active = paths.map(|state| state.path.clone()).collect();
            moments.push(moment);
        }
    }

    fn take(&mut self, taken: &TransitionTaken, moment: &mut Moment) {
        let (region, transition) = (
            usize::from(taken.region_instance),
            usize::from(taken.transition),
        );
        self.run_timer(region, transition);
        let guard = self.guards.read(transition);
        let term = |term: &Read| (term.name.clone(), self.is_set(region, term.bit));
        let terms = guard.terms.iter().map(term).collect();
        let holds = self.holds(region, transition);
        self.enter(region, transition);
        note_entered(
            &self.tables,
            taken,
            self.step,
            &mut self.entered,
            Some(&mut self.current),
        );
        let Some(words) = self.directory.transition(region, transition) else {
            return;
        };
        if moment.event.is_empty() {
            words.event.clone_into(&mut moment.event);
        }
        moment.taken.push(Taken {
            from: words.from.to_owned(),
            to: words.to.to_owned(),
            guard: guard.text,
            terms,
            holds,
            sent: words.sent.iter().map(|event| (*event).to_owned()).collect(),
            set: words.set,
            cleared: words.cleared,
        });
    }

    /// Sets the timeout flag of the state that a transition leaves, if its time is over.
    fn run_timer(&mut self, region: usize, transition: usize) {
        let source = self.tables.source_of_transition(transition);
        let Some(state) = self.tables.state(source) else {
            return;
        };
        let Some(limit_us) = state.timeout_us else {
            return;
        };
        let offset = match state.kind {
            StateKind::Task { .. } | StateKind::Super { .. } => format::FLAG_TIMEOUT,
            _ => 0,
        };
        let Some((first, _)) = self.tables.flags_of_state(region, source) else {
            return;
        };
        let is_over = match self.entered.get(region).copied().flatten() {
            Some(entered) => {
                self.step.saturating_sub(entered) * self.period_us > u64::from(limit_us)
            }
            // Where a recording begins in the middle of a run nobody knows since when; but nothing else can have made the guard true.
            None => !self.holds(region, transition),
        };
        if is_over {
            self.write(first + offset, true);
        }
    }

    /// Does what entering the target and the actions of a transition do to flags.
    fn enter(&mut self, region: usize, transition: usize) {
        let tables = self.tables;
        let (Some(taken), Some(here)) = (
            tables.transition(transition),
            tables.region_instance(region),
        ) else {
            return;
        };
        if let Some((first, flags)) = tables.flags_of_state(region, taken.target) {
            for flag in first..first + flags {
                self.write(flag, false);
            }
        }
        for action in tables.actions_of(transition) {
            if let Code::Write { flag, value, .. } = action {
                self.write(here.first_flag + flag, value);
            }
        }
        if tables
            .state(taken.target)
            .is_some_and(|state| state.kind == StateKind::Final)
        {
            self.write(here.first_flag + format::FLAG_EXIT, true);
        }
    }

    fn write(&mut self, flag: usize, value: bool) {
        let bit = 1 << (flag % 32);
        if let Some(word) = self.flags.get_mut(flag / 32) {
            *word = if value { *word | bit } else { *word & !bit };
        }
    }

    fn flag(&self, flag: usize) -> bool {
        let word = self.flags.get(flag / 32);
        word.is_some_and(|word| word >> (flag % 32) & 1 != 0)
    }

    /// A flag that a guard in a region instance reads, counted from the first of its container instance; or the busy flag of its superstate.
    fn is_set(&self, region: usize, bit: Option<usize>) -> bool {
        let Some(here) = self.tables.region_instance(region) else {
            return false;
        };
        match bit {
            Some(bit) => self.flag(here.first_flag + bit),
            None => self.is_busy_within(region),
        }
    }

    /// Whether an active task state inside the current superstate of a region instance is busy.
    fn is_busy_within(&self, region: usize) -> bool {
        let tables = &self.tables;
        let current = |region: usize| self.current.get(region).copied().unwrap_or(usize::MAX);
        let Some(around) = tables.region_instance(region) else {
            return false;
        };
        let mut at = tables.first_region_inside(region, current(region));
        while let Some(inside) = at
            && inside < around.next
        {
            let state = current(inside);
            let is_busy = tables
                .state(state)
                .is_some_and(|state| matches!(state.kind, StateKind::Task { .. }))
                && tables
                    .flags_of_state(inside, state)
                    .is_some_and(|(first, _)| self.flag(first + format::FLAG_BUSY));
            if is_busy {
                return true;
            }
            at = tables
                .first_region_inside(inside, state)
                .or_else(|| tables.region_instance(inside).map(|it| it.next));
        }
        false
    }

    /// Whether the guard of a transition is true.
    fn holds(&self, region: usize, transition: usize) -> bool {
        let tables = &self.tables;
        let source = tables.source_of_transition(transition);
        let first = tables
            .flags_of_state(region, source)
            .map_or(0, |(first, _)| first);
        match tables.guard_of(transition) {
            None => false,
            Some(Guard::True) => true,
            Some(Guard::Flag { bit, value }) => self.flag(first + bit) == value,
            Some(Guard::Mask { mask, value }) => (0..u16::BITS as usize)
                .filter(|bit| mask >> bit & 1 != 0)
                .all(|bit| self.flag(first + bit) == (value >> bit & 1 != 0)),
            Some(Guard::Program { .. }) => {
                let tests: Vec<Code> = tables.program_of(transition).collect();
                let mut at = 0;
                while let Some(test) = tests.get(at) {
                    let (value, jump_if, jump) = match *test {
                        Code::Test {
                            flag,
                            jump_if,
                            jump,
                        } => (self.is_set(region, Some(flag)), jump_if, jump),
                        Code::TestBusyInside { jump_if, jump } => {
                            (self.is_set(region, None), jump_if, jump)
                        }
                        _ => return true,
                    };
                    match (value == jump_if, jump) {
                        (false, _) => at += 1,
                        (true, None) => return false,
                        // Always ahead: verified.
                        (true, Some(jump)) => at += jump.max(1),
                    }
                }
                true
            }
        }
    }
}
