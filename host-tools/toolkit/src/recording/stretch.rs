//! Records of a recording, as runs of one mission with a known beginning.

use esm_core::Progress;
use esm_link::recording::{MAX_QUIET, Recorded};

use super::condense::MAX_KEPT_QUIET;
use super::file::Frame;

/// Macro steps of one mission, one after another, of which all is known that entered.
#[derive(Clone, Debug, PartialEq)]
pub struct Stretch {
    /// Hash of the mission.
    pub mission: u32,
    /// When it started, in microseconds since the first macro step of the first mission.
    pub start_us: u64,
    /// What the machine was before the first macro step.
    pub beginning: Beginning,
    /// What entered, in order.
    pub inputs: Vec<Input>,
    /// Macro steps that were made, skipped ones not counted.
    pub made: u64,
    /// Whether something is missing before it: it does not follow from the stretch before.
    pub after_gap: bool,
}

/// What a machine is before a stretch.
#[derive(Clone, Debug, PartialEq)]
pub enum Beginning {
    /// A machine before its first macro step.
    Anew,
    /// A machine under way.
    State(Progress, Vec<u32>),
}

/// Something that entered before a macro step.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// Which of the stretch's macro steps comes next, from 0.
    pub before: u64,
    /// What it is.
    pub change: Change,
}

/// What entered.
#[derive(Clone, Debug, PartialEq)]
pub enum Change {
    /// These bits were turned over.
    Bits(Vec<u32>),
    /// So many macro steps were left out.
    Skipped(u32),
    /// Bits that this differs in: it is what the robot's machine was before the macro step, to be
    /// compared with.
    Check(Progress, Vec<u32>),
}

impl Stretch {
    /// Number of the mission's macro step that the first one made here is, and the number of the
    /// next one behind it if no more are skipped.
    pub(super) fn first_step(&self) -> u64 {
        match &self.beginning {
            Beginning::Anew => 0,
            Beginning::State(progress, _) => progress.steps,
        }
    }
}

/// No mission starts later than this, in microseconds since the first macro step of the first
/// mission.
const MAX_START_US: u64 = 1 << 62;

/// When a macro step is, in microseconds since the first macro step of the first mission: of a
/// mission that started then, whose interpreter has this period.
pub(super) fn time_of(start_us: u64, step: u64, period_us: u64) -> u64 {
    // Numbers that no robot comes to may be in a file.
    start_us.saturating_add(step.saturating_mul(period_us))
}

/// Puts the records of a recording's frames together.
#[derive(Default)]
pub(super) struct Stretches {
    done: Vec<Stretch>,
    /// The one that goes on, and the number of its next macro step.
    open: Option<(Stretch, u64)>,
    /// Something is missing here.
    gap: bool,
}

/// Records make no sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BadRecords;

impl Stretches {
    /// Takes the next frame; what is no matter of the interpreter is passed over.
    pub(super) fn frame(&mut self, frame: &Frame) -> Result<(), BadRecords> {
        match frame {
            Frame::Records(records) => {
                let mut rest = records.as_slice();
                while !rest.is_empty() {
                    let record =
                        Recorded::take_within(&mut rest, MAX_KEPT_QUIET).map_err(|_| BadRecords)?;
                    self.record(&record)?;
                }
            }
            Frame::Gap(_) => {
                self.close();
                self.gap = true;
            }
            Frame::End(steps) => self.end(*steps),
            Frame::Header(_)
            | Frame::Mission { .. }
            | Frame::Ends(_)
            | Frame::Nets(_)
            | Frame::Samples(_) => {}
        }
        Ok(())
    }

    /// How many have begun.
    pub(super) fn begun(&self) -> usize {
        self.done.len() + usize::from(self.open.is_some())
    }

    pub(super) fn finish(mut self) -> Vec<Stretch> {
        self.close();
        self.done
    }

    fn close(&mut self) {
        if let Some((stretch, _)) = self.open.take() {
            self.done.push(stretch);
        }
    }

    fn open(&mut self, mission: u32, start_us: u64, beginning: Beginning) {
        self.close();
        let stretch = Stretch {
            mission,
            start_us,
            beginning,
            inputs: Vec::new(),
            made: 0,
            after_gap: std::mem::take(&mut self.gap),
        };
        let next = stretch.first_step();
        self.open = Some((stretch, next));
    }

    fn record(&mut self, record: &Recorded<'_>) -> Result<(), BadRecords> {
        if let Recorded::Started { start_us, .. } | Recorded::State { start_us, .. } = *record
            && start_us > MAX_START_US
        {
            return Err(BadRecords);
        }
        match *record {
            Recorded::Started {
                quiet,
                anew,
                mission,
                start_us,
            } => {
                self.pass(quiet);
                self.gap |= anew && self.open.is_some();
                self.open(mission, start_us, Beginning::Anew);
            }
            Recorded::State {
                anew,
                mission,
                start_us,
                progress,
                words,
            } => {
                self.gap |= anew && self.open.is_some();
                if progress.steps > esm_core::MAX_STEPS {
                    return Err(BadRecords);
                }
                self.state(mission, start_us, progress, words.iter().collect());
            }
            Recorded::Changes { quiet, bits } => {
                self.pass(quiet);
                self.enter(Change::Bits(bits.iter().collect()));
                self.pass(1);
            }
            Recorded::Quiet { quiet } => self.pass(quiet),
            Recorded::Skipped { quiet, missed } => {
                self.pass(quiet);
                self.enter(Change::Skipped(missed));
                if let Some((_, next)) = &mut self.open {
                    *next += u64::from(missed);
                }
            }
        }
        Ok(())
    }

    /// Macro steps without a change. What comes before a beginning is of no use.
    fn pass(&mut self, quiet: u32) {
        if let Some((stretch, next)) = &mut self.open {
            stretch.made += u64::from(quiet);
            *next += u64::from(quiet);
        }
    }

    fn enter(&mut self, change: Change) {
        if let Some((stretch, _)) = &mut self.open {
            let before = stretch.made;
            stretch.inputs.push(Input { before, change });
        }
    }

    /// A state in the middle of a stretch is one that its reader asked for, and tells how many
    /// macro steps without a change came before it.
    fn state(&mut self, mission: u32, start_us: u64, progress: Progress, words: Vec<u32>) {
        let since = match &self.open {
            Some((stretch, next))
                if (stretch.mission, stretch.start_us) == (mission, start_us) && !self.gap =>
            {
                progress.steps.checked_sub(*next)
            }
            _ => None,
        };
        match since.and_then(|since| u32::try_from(since).ok()) {
            Some(quiet) if quiet <= MAX_QUIET => {
                self.pass(quiet);
                self.enter(Change::Check(progress, words));
            }
            _ => {
                // That of another mission before its first macro step is what a warm one has taken
                // over, of which nothing is missing.
                self.gap |= self.open.as_ref().is_some_and(|(stretch, _)| {
                    (stretch.mission, stretch.start_us) == (mission, start_us)
                        || progress.steps != 0
                });
                self.open(mission, start_us, Beginning::State(progress, words));
            }
        }
    }

    /// The last mission's macro steps, as far as they belong to the recording.
    fn end(&mut self, steps: u64) {
        let Some((stretch, next)) = &mut self.open else {
            return;
        };
        match steps.checked_sub(*next) {
            Some(quiet) => self.pass(quiet.min(MAX_QUIET.into()) as u32),
            None => {
                stretch.made = stretch.made.saturating_sub(*next - steps);
                *next = steps;
            }
        }
    }
}
