//! Recordings, run again.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::{self, Write};
use std::sync::Arc;

use esm_core::{Fault, Interpreter, Observer, Progress, TransitionTaken, Verified};
use thiserror::Error;

use super::file::{self, BackgroundRunEnd, FileEnd, FileError, Frame, Header, MAX_INPUT_BYTES};
use super::limits::{Limits, TooMuch};
use super::stretch::{Beginning, Change, Input, Stretch, Stretches, time_of};
use crate::mission_hash::hash_text;
use crate::recording::entered::Entered;
use crate::trace::directory::{Directory, NoDirectory};
use crate::trace::{Lines, Step, TraceWriter};

/// A recording as it was read.
#[derive(Debug)]
pub struct Recording {
    /// Where it comes from.
    pub head: Header,
    /// Its missions.
    pub missions: Vec<RecordedMission>,
    /// What ran, in order.
    pub stretches: Vec<Stretch>,
    /// Ends of background runs of a simulated run.
    pub ends: Vec<BackgroundRunEnd>,
    /// How the file ends.
    pub end: FileEnd,
    /// Bytes of records.
    pub record_bytes: u64,
    /// Frames of nets and samples, and how many stretches had begun before each.
    pub(super) sample_frames: Vec<(usize, Frame)>,
    /// How much of everything is replayed.
    pub(super) limits: Limits,
    /// Where the first mission with a hash is.
    by_hash: HashMap<u32, usize>,
}

/// A mission of a recording.
#[derive(Debug)]
pub struct RecordedMission {
    /// Its name.
    pub name: String,
    /// Its blob.
    pub verified: Verified<Vec<u8>>,
    /// The names in it.
    pub directory: Arc<Directory>,
}

/// Why a recording cannot be read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// It is no file of this kind.
    #[error(transparent)]
    File(#[from] FileError),
    /// A mission in it is none.
    #[error("the mission `{name}` in the recording is not valid: {refusal:?}")]
    BadMission {
        /// Its name.
        name: String,
        /// Why not.
        refusal: esm_core::Refusal,
    },
    /// A mission in it has no names.
    #[error("the mission `{name}` in the recording: {cause}")]
    NoNames {
        /// Its name.
        name: String,
        /// What is wrong.
        cause: NoDirectory,
    },
    /// Its records make no sense.
    #[error("the records in the recording make no sense: another program wrote them, or a defect")]
    BadRecords,
    /// Its replay would take too long.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
}

impl Recording {
    /// Reads a recording. Takes time and memory in proportion to the file; what its missions take
    /// beyond that is limited.
    ///
    /// # Errors
    /// [`RecordingError`]
    pub fn read(bytes: &[u8]) -> Result<Self, RecordingError> {
        Self::read_within(bytes, Limits::default())
    }

    /// The same with other limits.
    ///
    /// # Errors
    /// [`RecordingError`]
    pub(super) fn read_within(bytes: &[u8], limits: Limits) -> Result<Self, RecordingError> {
        let (frames, end) = file::read(bytes)?;
        let samples = frames.iter().map(|frame| match frame {
            Frame::Samples(content) => content.len() as u64,
            _ => 0,
        });
        let besides = (bytes.len() as u64).saturating_sub(samples.sum());
        TooMuch::check("bytes besides samples of values", besides, MAX_INPUT_BYTES)?;
        let mut recording = Recording {
            head: Header::default(),
            missions: Vec::new(),
            stretches: Vec::new(),
            ends: Vec::new(),
            end,
            record_bytes: 0,
            sample_frames: Vec::new(),
            limits,
            by_hash: HashMap::new(),
        };
        let (mut slot_pairs, mut path_bytes) = (0, 0);
        let mut stretches = Stretches::default();
        for frame in frames {
            stretches
                .frame(&frame)
                .map_err(|_| RecordingError::BadRecords)?;
            match frame {
                Frame::Header(head) => recording.head = head,
                Frame::Mission { name, blob } => {
                    if recording.has(&blob) {
                        continue;
                    }
                    let mission = RecordedMission::new(name, blob)?;
                    slot_pairs += (mission.verified.tables().slots().len() as u64).pow(2) / 2;
                    path_bytes += mission.directory.bytes_of_paths() as u64;
                    TooMuch::check(
                        "pairs of slots in its missions",
                        slot_pairs,
                        limits.slot_pairs,
                    )?;
                    TooMuch::check(
                        "bytes of paths of the states of its missions",
                        path_bytes,
                        limits.path_bytes,
                    )?;
                    recording.add(mission);
                }
                Frame::Ends(ends) => recording.ends.extend(ends),
                Frame::Records(records) => recording.record_bytes += records.len() as u64,
                Frame::Nets(_) | Frame::Samples(_) => {
                    recording.sample_frames.push((stretches.begun(), frame));
                }
                Frame::Gap(_) | Frame::End(_) => {}
            }
        }
        recording.stretches = stretches.finish();
        let made = recording.stretches.iter().map(|stretch| stretch.made);
        TooMuch::check("macro steps", made.sum(), limits.macro_steps)?;
        let words = |stretch: &Stretch| {
            let mission = recording.mission(stretch.mission);
            mission.map_or(0, |mission| mission.verified.arena_words() as u64)
        };
        TooMuch::check(
            "words of machines that begin",
            recording.stretches.iter().map(words).sum(),
            limits.begun_words,
        )?;
        Ok(recording)
    }

    /// Whether a mission of this blob is there.
    fn has(&self, blob: &[u8]) -> bool {
        let hash = blob.last_chunk().map(|hash| u32::from_le_bytes(*hash));
        let mission = hash.and_then(|hash| self.mission(hash));
        mission.is_some_and(|mission| mission.verified.bytes() == blob)
    }

    fn add(&mut self, mission: RecordedMission) {
        if let Entry::Vacant(first) = self.by_hash.entry(mission.verified.hash()) {
            first.insert(self.missions.len());
        }
        self.missions.push(mission);
    }

    /// The mission with a hash.
    pub fn mission(&self, hash: u32) -> Option<&RecordedMission> {
        self.missions.get(self.number_of(hash)?)
    }

    /// Its number among the missions.
    pub(super) fn number_of(&self, hash: u32) -> Option<usize> {
        self.by_hash.get(&hash).copied()
    }

    /// The mission of a stretch, which is run behind that macro step.
    ///
    /// # Errors
    /// [`ReplayError::NoMission`]; or [`ReplayError::Gap`], if that is not to be gone over.
    pub(super) fn mission_of(
        &self,
        stretch: &Stretch,
        over_gaps: bool,
        last: Option<LastStep>,
    ) -> Result<&RecordedMission, ReplayError> {
        let hash = stretch.mission;
        if stretch.after_gap
            && !over_gaps
            && let Some(last) = last
        {
            return Err(ReplayError::Gap {
                hash: last.hash,
                after: last.step,
                after_us: last.at_us,
                next_hash: hash,
                next: match &stretch.beginning {
                    Beginning::Anew => 0,
                    Beginning::State(progress, _) => progress.steps,
                },
            });
        }
        self.mission(hash).ok_or(ReplayError::NoMission { hash })
    }

    /// Fails where something behind what was read is missing, though nobody broke the writing off.
    ///
    /// # Errors
    /// [`ReplayError::Damaged`]
    pub fn check_end(&self) -> Result<(), ReplayError> {
        match self.end {
            FileEnd::Whole | FileEnd::Cut { .. } => Ok(()),
            FileEnd::Damaged { at } => Err(ReplayError::Damaged { at }),
        }
    }

    /// What the host board needs to have a simulated run again; `None` if the recording is of a
    /// real robot, or of a part of a run.
    pub fn entered(&self) -> Option<Entered> {
        let whole = self
            .stretches
            .iter()
            .all(|stretch| stretch.beginning == Beginning::Anew && !stretch.after_gap);
        let is_changed = self.check_end().is_err();
        let seed = self.head.seed.filter(|_| whole && !is_changed)?;
        Some(Entered {
            seed,
            missions: self.stretches.iter().map(|it| it.mission).collect(),
            starts_us: self.stretches.iter().map(|it| it.start_us).collect(),
            ends: self.ends.clone(),
        })
    }
}

impl RecordedMission {
    fn new(name: String, blob: Vec<u8>) -> Result<Self, RecordingError> {
        let verified = match esm_core::verify(blob) {
            Ok(verified) => verified,
            Err((_, refusal)) => return Err(RecordingError::BadMission { name, refusal }),
        };
        let directory = match Directory::of(&verified.tables()) {
            Ok(directory) => Arc::new(directory),
            Err(cause) => return Err(RecordingError::NoNames { name, cause }),
        };
        Ok(RecordedMission {
            name,
            verified,
            directory,
        })
    }
}

/// A macro step, where nothing may be known of what follows.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastStep {
    /// Hash of its mission.
    pub(super) hash: u32,
    /// Its number.
    pub(super) step: u64,
    /// When it was, in microseconds since the first macro step of the first mission.
    pub(super) at_us: u64,
}

/// What came of a replay.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Stretches that were run.
    pub stretches: usize,
    /// Macro steps that were made.
    pub steps: u64,
    /// Transitions that were taken.
    pub transitions: u64,
    /// Macro steps with a change from outside.
    pub changes: u64,
    /// States of the robot's machine that were compared with that of the replay, and equal.
    pub checks: u64,
}

/// Why a replay did not come to the recording's end.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The trace cannot be written.
    #[error("cannot write the trace: {0}")]
    Trace(#[from] io::Error),
    /// There is too much in it.
    #[error(transparent)]
    TooMuch(#[from] TooMuch),
    /// A mission is missing.
    #[error("the recording is of the mission {} from here on, which is not in it", hash_text(*hash))]
    NoMission {
        /// Its hash.
        hash: u32,
    },
    /// The state that a stretch begins with is none of its mission.
    #[error("the recorded state is none of the mission {}", hash_text(*hash))]
    BadState {
        /// Its hash.
        hash: u32,
    },
    /// Something entered that this machine does not have.
    #[error("before macro step {step} a flag changed that the mission {} does not have", hash_text(*hash))]
    BadInput {
        /// Hash of the mission.
        hash: u32,
        /// Number of the macro step.
        step: u64,
    },
    /// The robot's machine was another than this one.
    #[error("before macro step {step} of the mission {} the robot's machine was not what the replay is: the recording lacks something", hash_text(*hash))]
    Differs {
        /// Hash of the mission.
        hash: u32,
        /// Number of the macro step.
        step: u64,
    },
    /// The file was changed.
    #[error(
        "the recording was changed since it was written: what comes from byte {at} on was not read"
    )]
    Damaged {
        /// Where the frame begins in which it was.
        at: usize,
    },
    /// Something is missing.
    #[error("the recording has a gap after macro step {after} of the mission {} ({:.3} s); it goes on before macro step {next} of the mission {}: with --over-gaps, so does the replay",
        hash_text(*hash), *after_us as f64 / 1e6, hash_text(*next_hash))]
    Gap {
        /// Hash of the mission before.
        hash: u32,
        /// Number of the last macro step before.
        after: u64,
        /// When that was, in microseconds since the first macro step of the first mission.
        after_us: u64,
        /// Hash of the mission behind.
        next_hash: u32,
        /// Number of the first macro step behind.
        next: u64,
    },
}

/// A machine that runs a stretch again.
pub struct Player<'s, 'm> {
    stretch: &'s Stretch,
    machine: Interpreter<'m, &'s [u8]>,
    inputs: std::slice::Iter<'s, Input>,
    /// Macro steps that were made.
    made: u64,
}

/// Where a player is in its stretch, and what its machine is there.
#[derive(Clone, Debug)]
pub struct Position {
    /// Macro steps that were made.
    made: u64,
    /// Inputs that entered.
    entered: usize,
    progress: Progress,
    words: Vec<u32>,
}

/// What entered before a macro step that was made again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entries {
    /// Bits that were turned over.
    pub bits: usize,
    /// States that were compared.
    pub checks: u64,
    /// There is a macro step behind them in the stretch.
    pub goes_on: bool,
}

impl<'s, 'm> Player<'s, 'm> {
    /// A machine before the first macro step of a stretch. `arena` has as many words as the mission
    /// needs.
    ///
    /// # Errors
    /// [`ReplayError::BadState`]
    pub fn new(
        mission: &'s RecordedMission,
        stretch: &'s Stretch,
        arena: &'m mut [u32],
    ) -> Result<Self, ReplayError> {
        let hash = stretch.mission;
        let verified = mission.verified.by_ref();
        let machine = match &stretch.beginning {
            Beginning::Anew => Interpreter::new(verified, arena).ok(),
            Beginning::State(progress, words) => {
                Interpreter::resume(verified, arena, words, *progress).ok()
            }
        };
        let machine = machine.ok_or(ReplayError::BadState { hash })?;
        Ok(Player {
            stretch,
            machine,
            inputs: stretch.inputs.iter(),
            made: 0,
        })
    }

    /// A machine where another player was in the same stretch. `arena` has as many words as the
    /// mission needs.
    ///
    /// # Errors
    /// [`ReplayError::BadState`], of a position in another stretch.
    pub fn at(
        mission: &'s RecordedMission,
        stretch: &'s Stretch,
        position: &Position,
        arena: &'m mut [u32],
    ) -> Result<Self, ReplayError> {
        let hash = stretch.mission;
        let verified = mission.verified.by_ref();
        let machine = Interpreter::resume(verified, arena, &position.words, position.progress).ok();
        let inputs = stretch.inputs.get(position.entered..);
        let (machine, inputs) = machine.zip(inputs).ok_or(ReplayError::BadState { hash })?;
        Ok(Player {
            stretch,
            machine,
            inputs: inputs.iter(),
            made: position.made,
        })
    }

    /// Where it is, between two macro steps.
    pub fn position(&self) -> Position {
        Position {
            made: self.made,
            entered: self.stretch.inputs.len() - self.inputs.len(),
            progress: self.machine.progress(),
            words: self.machine.state_words().to_vec(),
        }
    }

    /// The machine.
    pub fn machine(&self) -> &Interpreter<'m, &'s [u8]> {
        &self.machine
    }

    /// Lets enter what entered before the next macro step, or behind the last one of the stretch.
    ///
    /// # Errors
    /// [`ReplayError::BadInput`], [`ReplayError::Differs`]
    pub fn enter(&mut self) -> Result<Entries, ReplayError> {
        let hash = self.stretch.mission;
        let mut entries = Entries::default();
        while let Some(input) = self.inputs.as_slice().first()
            && input.before == self.made
        {
            self.inputs.next();
            let step = self.machine.progress().steps;
            match &input.change {
                Change::Bits(bits) => {
                    entries.bits += bits.len();
                    for bit in bits {
                        if !self.machine.toggle_input(*bit as usize) {
                            return Err(ReplayError::BadInput { hash, step });
                        }
                    }
                }
                Change::Skipped(missed) => {
                    if step.saturating_add(u64::from(*missed)) > esm_core::MAX_STEPS {
                        return Err(ReplayError::BadInput { hash, step });
                    }
                    self.machine.skip(*missed);
                }
                Change::Check(progress, words) => {
                    // What entered since the macro step before is told by this alone.
                    let entered: Vec<usize> = self.machine.inputs_unlike(words).collect();
                    entries.bits += entered.len();
                    let took_all = (entered.into_iter()).all(|bit| self.machine.toggle_input(bit));
                    if !took_all || !self.machine.is_like(words, progress) {
                        return Err(ReplayError::Differs { hash, step });
                    }
                    entries.checks += 1;
                }
            }
        }
        entries.goes_on = self.made < self.stretch.made;
        Ok(entries)
    }

    /// Makes the next macro step.
    ///
    /// # Errors
    /// The fault that stopped the machine.
    pub fn macro_step(
        &mut self,
        observer: &mut impl Observer,
    ) -> Result<esm_core::StepSummary, Fault> {
        self.made += 1;
        self.machine.macro_step(observer)
    }
}

/// Runs a recording again; the trace goes to `out`, where one is wanted. Where something is missing
/// it ends, or goes on with what is known again.
///
/// # Errors
/// [`ReplayError`], with what was done until then.
pub fn replay(
    recording: &Recording,
    over_gaps: bool,
    out: Option<impl Write>,
) -> Result<Outcome, (Outcome, ReplayError)> {
    let mut outcome = Outcome::default();
    match replay_stretches(recording, over_gaps, out, &mut outcome) {
        Ok(()) => Ok(outcome),
        Err(error) => Err((outcome, error)),
    }
}

fn replay_stretches(
    recording: &Recording,
    over_gaps: bool,
    mut out: Option<impl Write>,
    outcome: &mut Outcome,
) -> Result<(), ReplayError> {
    let mut last = None;
    // What a trace says of a mission is made ready once, and not for each of its stretches.
    let mut lines: HashMap<u32, Lines> = HashMap::new();
    for stretch in &recording.stretches {
        let hash = stretch.mission;
        let mission = recording.mission_of(stretch, over_gaps, last)?;
        let writer = out.as_mut().map(|out| {
            let lines = lines.entry(hash);
            let lines = lines.or_insert_with(|| Lines::of(Arc::clone(&mission.directory)));
            TraceWriter::with(out, lines)
        });
        let ended = play(mission, stretch, recording.limits, writer, outcome)?;
        last = Some(LastStep {
            hash,
            step: ended.step,
            at_us: stretch.start_us.saturating_add(ended.t_us),
        });
        outcome.stretches += 1;
    }
    if let Some(out) = &mut out {
        out.flush()?;
    }
    recording.check_end()
}

/// Runs one stretch; answers its last macro step.
fn play(
    mission: &RecordedMission,
    stretch: &Stretch,
    limits: Limits,
    mut writer: Option<TraceWriter<impl Write, &mut Lines>>,
    outcome: &mut Outcome,
) -> Result<Step, ReplayError> {
    let mut arena = vec![0; mission.verified.arena_words()];
    let mut player = Player::new(mission, stretch, &mut arena)?;
    let period_us = u64::from(mission.directory.interpreter_period_us());
    let mut at = Step { step: 0, t_us: 0 };
    loop {
        let entries = player.enter()?;
        outcome.changes += u64::from(entries.bits > 0);
        outcome.checks += entries.checks;
        // A machine with a fault stands still until it is started anew.
        if !entries.goes_on || player.machine().fault().is_some() {
            break;
        }
        let step = player.machine().progress().steps;
        at = Step {
            step,
            t_us: time_of(0, step, period_us),
        };
        let mut watcher = Watcher {
            writer: writer.as_mut(),
            at,
            transitions: 0,
            written: Ok(()),
        };
        let ended = player.macro_step(&mut watcher);
        let Watcher {
            transitions,
            written,
            ..
        } = watcher;
        written?;
        outcome.transitions += transitions;
        outcome.steps += 1;
        TooMuch::check("transitions", outcome.transitions, limits.transitions)?;
        let Some(writer) = &mut writer else { continue };
        match ended {
            Ok(summary) => writer.step(at, summary.micro_steps.into(), player.machine())?,
            Err(fault) => writer.fault(at, fault.code())?,
        }
    }
    Ok(at)
}

/// Writes the transitions of a macro step.
struct Watcher<'w, 'l, W> {
    writer: Option<&'w mut TraceWriter<W, &'l mut Lines>>,
    at: Step,
    transitions: u64,
    written: io::Result<()>,
}

impl<W: Write> Observer for Watcher<'_, '_, W> {
    fn transition(&mut self, taken: TransitionTaken) {
        self.transitions += 1;
        if let Some(writer) = &mut self.writer
            && self.written.is_ok()
        {
            let (region, transition) = (taken.region_instance.into(), taken.transition.into());
            self.written = writer.transition(self.at, taken.micro.into(), region, transition);
        }
    }
}
