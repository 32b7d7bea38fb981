//! What entered an interpreter, without what made no difference.
//!
//! A robot sends each flag that a task changed, and says at short intervals that nothing did, so
//! that whoever listens knows that it is there. Much of that no transition waits for. Here the
//! machine runs again as it comes, and beside it one that is given only what is kept. As long as
//! both take the same transitions, and have the same tasks enabled, what differs is left out; as
//! soon as they would not, all that differs enters before that macro step. So a replay of what is
//! kept is the run, macro step by macro step, as was seen when it was written.
//!
//! Where a transition is taken, the flags in its guard are brought in before, whether the
//! transition needs all of them or not: whoever looks at it sees what it was.

use esm_core::{
    Fault, Interpreter, MAX_STEPS, Observer, Progress, StepSummary, TransitionTaken, Verified,
};
use esm_link::recording::{
    MAX_QUIET, Recorded, write_changes, write_quiet, write_skipped, write_started, write_state,
};
use esm_link::trace::RecordSink;

use crate::inspect::guards::GuardReader;

/// Macro steps without anything that entered after which a record says so, at most: so many may be
/// missing from a recording that was broken off, and nothing happened in them.
pub const MAX_KEPT_QUIET: u32 = 1024;

/// A mission whose records can be made fewer.
pub(super) struct Runnable {
    verified: Verified<Vec<u8>>,
    /// The flags that the guard of each transition reads, counted from the first of the container
    /// instance; none for a busy flag of a superstate.
    reads: Vec<Vec<Option<usize>>>,
}

impl Runnable {
    /// The mission of a blob, if it is a valid one.
    pub(super) fn of(blob: &[u8]) -> Option<Self> {
        let verified = esm_core::verify(blob.to_vec()).ok()?;
        let guards = GuardReader::of(&verified);
        let terms = |transition| guards.read(transition).terms;
        let reads = (0..verified.tables().transition_count())
            .map(|transition| terms(transition).iter().map(|term| term.bit).collect())
            .collect();
        Some(Runnable { verified, reads })
    }

    /// Its machine, as it was.
    fn machine<'m>(
        &self,
        arena: &'m mut Vec<u32>,
        kept: Option<&Kept>,
    ) -> Option<Interpreter<'m, &[u8]>> {
        let verified = esm_core::verify(self.verified.bytes()).ok()?;
        arena.resize(verified.arena_words(), 0);
        match kept {
            None => Interpreter::new(verified, arena).ok(),
            Some(kept) => Interpreter::resume(verified, arena, &kept.words, kept.progress).ok(),
        }
    }
}

/// Finds the mission of a hash.
pub(super) trait Missions {
    /// The mission, if it is there and can be run.
    fn runnable(&self, hash: u32) -> Option<&Runnable>;
}

/// What was said does not fit to what was said before: something is missing in between.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lost;

/// Makes records fewer, a few at a time.
pub(super) struct Condenser {
    known: Known,
    /// Macro steps since the last record that was kept, before which nothing entered.
    quiet: u32,
}

/// What is known of the machine that runs.
enum Known {
    /// Nothing. What comes before a beginning is of no use.
    Nothing,
    /// Whose it is, but that mission is not there: what comes is kept as it is.
    Unread,
    /// All.
    Machines(Machines),
}

/// Two machines of one mission between two macro steps: what the robot's is, and what a replay's
/// will be.
struct Machines {
    mission: u32,
    start_us: u64,
    robot: Kept,
    replay: Kept,
}

/// A machine between two macro steps.
#[derive(Clone)]
struct Kept {
    progress: Progress,
    words: Vec<u32>,
}

impl Kept {
    fn of(machine: &Interpreter<'_, &[u8]>) -> Self {
        Kept {
            progress: machine.progress(),
            words: machine.state_words().to_vec(),
        }
    }
}

/// Bytes of records.
pub(super) struct Sink<'b>(pub(super) &'b mut Vec<u8>);

impl RecordSink for Sink<'_> {
    fn put(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

impl Condenser {
    /// Nothing is known yet.
    pub(super) fn new() -> Self {
        Condenser {
            known: Known::Nothing,
            quiet: 0,
        }
    }

    /// Forgets all that it knows: what comes next does not go on from here.
    pub(super) fn forget(&mut self) {
        self.known = Known::Nothing;
        self.quiet = 0;
    }

    /// Takes whole records, and writes what is to be kept of them.
    pub(super) fn take(
        &mut self,
        records: &[u8],
        missions: &(impl Missions + ?Sized),
        out: &mut Vec<u8>,
    ) -> Result<(), Lost> {
        let mut rest = records;
        while !rest.is_empty() {
            match &mut self.known {
                Known::Machines(machines) => {
                    let runnable = missions.runnable(machines.mission).ok_or(Lost)?;
                    machines.run(runnable, &mut rest, &mut self.quiet, out)?;
                }
                Known::Nothing | Known::Unread => {
                    let from = rest;
                    let record = Recorded::take(&mut rest).map_err(|_| Lost)?;
                    let is_beginning =
                        matches!(record, Recorded::Started { .. } | Recorded::State { .. });
                    if is_beginning {
                        rest = from;
                    } else if matches!(self.known, Known::Unread) {
                        let bytes = from.get(..from.len() - rest.len());
                        out.extend_from_slice(bytes.unwrap_or_default());
                    }
                }
            }
            if !rest.is_empty() {
                self.begin(&mut rest, missions, out)?;
            }
        }
        Ok(())
    }

    /// Writes how many macro steps were made since the last record, if there were any.
    pub(super) fn tell_quiet(&mut self, out: &mut Vec<u8>) {
        tell_quiet(&mut self.quiet, out);
    }

    /// Takes a beginning, if one is next.
    fn begin(
        &mut self,
        rest: &mut &[u8],
        missions: &(impl Missions + ?Sized),
        out: &mut Vec<u8>,
    ) -> Result<(), Lost> {
        let from = *rest;
        let (mission, start_us, beginning) = match Recorded::take(rest).map_err(|_| Lost)? {
            Recorded::Started {
                quiet,
                anew,
                mission,
                start_us,
            } => {
                // Those of a machine that runs here were made, and counted.
                let quiet = match self.known {
                    Known::Unread => quiet,
                    Known::Nothing | Known::Machines(_) => self.quiet,
                };
                write_started(&mut Sink(out), quiet, anew, mission, start_us);
                (mission, start_us, None)
            }
            Recorded::State {
                anew,
                mission,
                start_us,
                progress,
                words,
            } => {
                tell_quiet(&mut self.quiet, out);
                let words: Vec<u32> = words.iter().collect();
                write_state(&mut Sink(out), anew, mission, start_us, &progress, &words);
                (mission, start_us, Some(Kept { progress, words }))
            }
            Recorded::Changes { .. } | Recorded::Quiet { .. } | Recorded::Skipped { .. } => {
                *rest = from;
                return Ok(());
            }
        };
        self.quiet = 0;
        self.known = Known::Unread;
        let mut arena = Vec::new();
        if let Some(runnable) = missions.runnable(mission)
            && let Some(machine) = runnable.machine(&mut arena, beginning.as_ref())
        {
            let robot = Kept::of(&machine);
            self.known = Known::Machines(Machines {
                mission,
                start_us,
                replay: robot.clone(),
                robot,
            });
        }
        Ok(())
    }
}

fn tell_quiet(quiet: &mut u32, out: &mut Vec<u8>) {
    if *quiet > 0 {
        write_quiet(&mut Sink(out), *quiet);
        *quiet = 0;
    }
}

impl Machines {
    /// Takes records up to one with which something else begins.
    fn run(
        &mut self,
        runnable: &Runnable,
        rest: &mut &[u8],
        quiet: &mut u32,
        out: &mut Vec<u8>,
    ) -> Result<(), Lost> {
        let (mut arena, mut other_arena) = (Vec::new(), Vec::new());
        let robot = runnable.machine(&mut arena, Some(&self.robot));
        let replay = runnable.machine(&mut other_arena, Some(&self.replay));
        let (robot, replay) = robot.zip(replay).ok_or(Lost)?;
        let mut run = Run {
            runnable,
            robot,
            replay: Some(replay),
            quiet,
            out,
        };
        while !rest.is_empty() {
            let from = *rest;
            let record = Recorded::take(rest).map_err(|_| Lost)?;
            if !run.take(&record, (self.mission, self.start_us))? {
                *rest = from;
                break;
            }
        }
        self.robot = Kept::of(&run.robot);
        self.replay = run.replay.as_ref().map(Kept::of).ok_or(Lost)?;
        Ok(())
    }
}

/// Two machines that run.
struct Run<'r, 'm, 'o> {
    runnable: &'r Runnable,
    robot: Interpreter<'m, &'r [u8]>,
    /// Always there, but while a macro step is made.
    replay: Option<Interpreter<'m, &'r [u8]>>,
    quiet: &'o mut u32,
    out: &'o mut Vec<u8>,
}

/// What a macro step showed.
#[derive(PartialEq)]
struct Shown {
    ended: Result<StepSummary, Fault>,
    taken: Vec<TransitionTaken>,
    enabled: Vec<u32>,
}

/// The transitions of a macro step.
#[derive(Default)]
struct Seen(Vec<TransitionTaken>);

impl Observer for Seen {
    fn transition(&mut self, taken: TransitionTaken) {
        self.0.push(taken);
    }
}

impl Shown {
    fn by(machine: &mut Interpreter<'_, &[u8]>) -> Self {
        let mut seen = Seen::default();
        let ended = machine.macro_step(&mut seen);
        Shown {
            ended,
            taken: seen.0,
            enabled: machine.enabled_words().to_vec(),
        }
    }
}

impl Run<'_, '_, '_> {
    /// Takes a record of this run of a mission, known by hash and start. False of one with which
    /// another begins: then those macro steps were made that it tells of before that.
    fn take(&mut self, record: &Recorded<'_>, of: (u32, u64)) -> Result<bool, Lost> {
        match *record {
            Recorded::Started { quiet, .. } => {
                self.steps(quiet)?;
                return Ok(false);
            }
            Recorded::State {
                anew,
                mission,
                start_us,
                progress,
                words,
            } => {
                if anew || (mission, start_us) != of {
                    return Ok(false);
                }
                let next = self.robot.progress().steps;
                let since = progress.steps.checked_sub(next).ok_or(Lost)?;
                let since = u32::try_from(since).map_err(|_| Lost)?;
                if since > MAX_QUIET {
                    return Err(Lost);
                }
                self.steps(since)?;
                self.check(&progress, &words.iter().collect::<Vec<u32>>(), of)?;
            }
            Recorded::Changes { quiet, bits } => {
                self.steps(quiet)?;
                for bit in bits.iter() {
                    if !self.robot.toggle_input(bit as usize) {
                        return Err(Lost);
                    }
                }
                self.step()?;
            }
            Recorded::Quiet { quiet } => self.steps(quiet)?,
            Recorded::Skipped { quiet, missed } => {
                self.steps(quiet)?;
                let steps = self.robot.progress().steps;
                if steps.saturating_add(missed.into()) > MAX_STEPS {
                    return Err(Lost);
                }
                write_skipped(&mut Sink(self.out), *self.quiet, missed);
                *self.quiet = 0;
                self.robot.skip(missed);
                if let Some(replay) = &mut self.replay {
                    replay.skip(missed);
                }
            }
        }
        Ok(true)
    }

    /// Compares with all that the robot's machine is before the next macro step, what entered since
    /// the one before included; keeps that, for the replay to compare with, too.
    fn check(&mut self, progress: &Progress, words: &[u32], of: (u32, u64)) -> Result<(), Lost> {
        let replay = self.replay.as_mut().ok_or(Lost)?;
        for machine in [&mut self.robot, replay] {
            let entered: Vec<usize> = machine.inputs_unlike(words).collect();
            let took_all = (entered.into_iter()).all(|bit| machine.toggle_input(bit));
            if !took_all || !machine.is_like(words, progress) {
                return Err(Lost);
            }
        }
        tell_quiet(self.quiet, self.out);
        write_state(&mut Sink(self.out), false, of.0, of.1, progress, words);
        Ok(())
    }

    fn steps(&mut self, count: u32) -> Result<(), Lost> {
        (0..count).try_for_each(|_| self.step())
    }

    /// Makes a macro step of both machines. What the replay's lacks enters before it as far as it
    /// must.
    fn step(&mut self) -> Result<(), Lost> {
        let mut replay = self.replay.take().ok_or(Lost)?;
        let lacks: Vec<usize> = replay.inputs_unlike(self.robot.state_words()).collect();
        let before = (!lacks.is_empty()).then(|| Kept::of(&replay));
        let shown = Shown::by(&mut self.robot);
        let read = self.read_by(&shown.taken);
        let is_read = |bit: &usize| read.as_ref().is_none_or(|read| read.contains(bit));
        let first_enable_bit = self.robot.first_enable_bit();
        let is_read_or_enables = |bit: &usize| is_read(bit) || *bit >= first_enable_bit;
        let all = |_: &usize| true;
        let choices: [&dyn Fn(&usize) -> bool; 3] = [&is_read, &is_read_or_enables, &all];
        let mut tried = None;
        for choice in choices {
            let enter: Vec<usize> = lacks.iter().copied().filter(|bit| choice(bit)).collect();
            if tried.as_ref() == Some(&enter) {
                continue;
            }
            if let (Some(_), Some(before)) = (&tried, &before) {
                let (verified, arena) = replay.into_parts();
                replay = Interpreter::resume(verified, arena, &before.words, before.progress)
                    .map_err(|_| Lost)?;
            }
            if !enter.iter().all(|bit| replay.toggle_input(*bit)) {
                return Err(Lost);
            }
            if Shown::by(&mut replay) == shown {
                self.replay = Some(replay);
                self.keep(&enter);
                return Ok(());
            }
            tried = Some(enter);
        }
        Err(Lost)
    }

    /// Notes what entered before a macro step that was made.
    fn keep(&mut self, entered: &[usize]) {
        if entered.is_empty() {
            *self.quiet += 1;
            if *self.quiet == MAX_KEPT_QUIET {
                tell_quiet(self.quiet, self.out);
            }
            return;
        }
        let bits = entered.iter().map(|bit| *bit as u32);
        write_changes(&mut Sink(self.out), *self.quiet, bits);
        *self.quiet = 0;
    }

    /// The flags in the guards of transitions that were taken; none where one asks for busy tasks,
    /// which may be any.
    fn read_by(&self, taken: &[TransitionTaken]) -> Option<Vec<usize>> {
        let tables = self.runnable.verified.tables();
        let mut read = Vec::new();
        for taken in taken {
            let first_flag = tables
                .region_instance(taken.region_instance.into())
                .map_or(0, |region| region.first_flag);
            let terms = self.runnable.reads.get(usize::from(taken.transition));
            for term in terms.into_iter().flatten() {
                read.push(first_flag + (*term)?);
            }
        }
        Some(read)
    }
}
