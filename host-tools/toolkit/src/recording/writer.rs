//! A recording that is written while its robot runs.

use std::fmt;
use std::io::{self, Write};

use esm_link::recording::{MAX_QUIET, Recorded, write_quiet};

use crate::clean::counted;

use super::condense::{Condenser, Missions, Runnable, Sink};
use super::file::{self, BackgroundRunEnd, Frame, Header};
use super::samples::{RawSample, SampleFrames};
use crate::values::Watched;

/// Records are written to the file when they are this many bytes…
const FRAME_BYTES: usize = 1024;
/// … or of this many macro steps: so much is lost at most if the writing is broken off, and macro
/// steps before which nothing entered.
const FRAME_STEPS: u64 = MAX_QUIET as u64;

/// Samples of a mission that wait for word of its beginning at most: it comes over the same line.
const MAX_EARLY_SAMPLES: usize = 64;

/// Writes a recording as it comes, without what made no difference. Equal records give equal bytes,
/// in however many parts they come.
pub struct RecordingWriter<W> {
    out: W,
    /// Records that were not written yet, and their macro steps.
    waiting: Vec<u8>,
    waiting_steps: u64,
    condenser: Condenser,
    missions: Vec<Known>,
    /// Whether what makes no difference is kept, too.
    keeps_all: bool,
    /// Robot time after which nothing is of interest.
    until_us: Option<u64>,
    /// The mission that runs, as far as it is known; and when its next macro step is due.
    clock: Option<Clock>,
    is_over: bool,
    /// What came did not fit to what was there, and nobody was told.
    lost: bool,
    counts: Counts,
    samples: SampleFrames,
    /// Samples of a mission whose beginning was not told yet.
    early: Vec<RawSample>,
    /// The mission that ran before, of which a sample may come late.
    before: Option<Clock>,
}

struct Known {
    hash: u32,
    period_us: u64,
    runnable: Option<Runnable>,
}

impl Missions for [Known] {
    fn runnable(&self, hash: u32) -> Option<&Runnable> {
        let known = self.iter().find(|known| known.hash == hash)?;
        known.runnable.as_ref()
    }
}

/// Where a mission is.
#[derive(Clone, Copy)]
struct Clock {
    mission: u32,
    start_us: u64,
    period_us: u64,
    next_step: u64,
}

impl Clock {
    /// Whether the robot may have sampled then without a word on the macro steps up to there.
    fn reaches(&self, t_us: u64) -> bool {
        let told_by = (self.next_step).saturating_add(MAX_QUIET.into());
        // Where the mission is not known yet, nor is its period.
        self.period_us == 0 || t_us <= told_by.saturating_mul(self.period_us)
    }

    fn next_us(&self) -> u64 {
        self.start_us
            .saturating_add(self.next_step.saturating_mul(self.period_us))
    }
}

/// What a recording holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes of records, as they are kept.
    pub record_bytes: u64,
    /// Macro steps that are known of.
    pub steps: u64,
    /// Gaps.
    pub gaps: u64,
    /// How often all came that the machine was, or a mission began: at the beginning, behind a gap,
    /// or because somebody asked.
    pub beginnings: u64,
    /// Samples of values.
    pub samples: u64,
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} macro steps in {} bytes",
            self.steps, self.record_bytes
        )?;
        match self.gaps {
            0 => {}
            1 => write!(f, ", with 1 gap")?,
            gaps => write!(f, ", with {gaps} gaps")?,
        }
        match self.samples {
            0 => Ok(()),
            samples => write!(f, ", and {} of values", counted(samples, "sample")),
        }
    }
}

impl<W: Write> RecordingWriter<W> {
    /// Begins a recording. Of robot time after `until_us` nothing is kept.
    ///
    /// # Errors
    /// Whatever `out` has.
    pub fn new(mut out: W, head: Header, until_us: Option<u64>) -> io::Result<Self> {
        file::write_mark(&mut out)?;
        Frame::Header(head).write(&mut out)?;
        out.flush()?;
        Ok(RecordingWriter {
            out,
            waiting: Vec::new(),
            waiting_steps: 0,
            condenser: Condenser::new(),
            missions: Vec::new(),
            keeps_all: false,
            until_us,
            clock: None,
            is_over: false,
            lost: false,
            counts: Counts::default(),
            samples: SampleFrames::default(),
            early: Vec::new(),
            before: None,
        })
    }

    /// Keeps all that comes of missions that are added from now on, also what makes no difference
    /// to the trace: whoever looks at a guard then finds each flag as it was on the robot.
    pub fn keep_all(&mut self) {
        self.keeps_all = true;
    }

    /// Of robot time after `until_us` nothing is kept, as it turned out.
    pub fn ends_at(&mut self, until_us: Option<u64>) {
        self.until_us = until_us;
    }

    /// Whether a mission is in the recording.
    pub fn knows(&self, hash: u32) -> bool {
        self.missions.iter().any(|known| known.hash == hash)
    }

    /// Hash of the mission whose macro steps the recording goes on with.
    pub fn running(&self) -> Option<u32> {
        self.clock.as_ref().map(|clock| clock.mission)
    }

    /// Number of the next macro step that the recording lacks of it.
    pub fn next_step(&self) -> Option<u64> {
        self.clock.as_ref().map(|clock| clock.next_step)
    }

    /// Adds a mission, if it is not there. `period_us` is that of its interpreter.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn mission(
        &mut self,
        name: &str,
        hash: u32,
        blob: &[u8],
        period_us: u32,
    ) -> io::Result<()> {
        if self.knows(hash) {
            return Ok(());
        }
        // Nothing is left out of a mission that cannot be run beside the robot.
        let runnable = match self.keeps_all {
            true => None,
            false => Runnable::of(blob),
        };
        self.missions.push(Known {
            hash,
            period_us: period_us.into(),
            runnable,
        });
        self.write(&Frame::Mission {
            name: name.to_owned(),
            blob: blob.to_vec(),
        })
    }

    /// Adds whole records. Answers the hash of a mission that they are of and that is not in the
    /// recording yet.
    ///
    /// # Errors
    /// Whatever the file has; or that these are no records.
    pub fn records(&mut self, records: &[u8]) -> io::Result<Option<u32>> {
        let mut rest = records;
        let mut unknown = None;
        while !rest.is_empty() && !self.is_over {
            let from = rest;
            let record = Recorded::take(&mut rest)
                .map_err(|_| io::Error::other("the robot's recording makes no sense"))?;
            if let Recorded::Started { mission, .. } | Recorded::State { mission, .. } = record
                && !self.knows(mission)
            {
                unknown = Some(mission);
            }
            let begins = matches!(record, Recorded::Started { .. } | Recorded::State { .. });
            if begins && self.samples.bytes() > 0 {
                // Samples stand before the beginning that they are not of.
                self.flush()?;
            }
            let before = (self.clock, self.counts);
            let steps = self.steps_of(&record);
            if self.is_over {
                (self.clock, self.counts) = before;
                break;
            }
            let bytes = from.get(..from.len() - rest.len()).unwrap_or_default();
            self.waiting.extend_from_slice(bytes);
            self.waiting_steps += steps;
            self.counts.steps += steps;
            if self.waiting.len() >= FRAME_BYTES || self.waiting_steps >= FRAME_STEPS {
                self.flush()?;
            }
        }
        Ok(unknown)
    }

    /// How many macro steps a record is of, which moves the clock on; or it is after the end, and
    /// all is over.
    fn steps_of(&mut self, record: &Recorded<'_>) -> u64 {
        let (steps, skipped) = match *record {
            Recorded::Changes { quiet, .. } => (u64::from(quiet) + 1, 0),
            Recorded::Quiet { quiet } | Recorded::Started { quiet, .. } => (quiet.into(), 0),
            Recorded::Skipped { quiet, missed } => (quiet.into(), missed.into()),
            Recorded::State { anew: true, .. } => (0, 0),
            Recorded::State {
                mission,
                start_us,
                progress,
                ..
            } => (
                self.quiet_before(mission, start_us, progress.steps)
                    .unwrap_or(0),
                0,
            ),
        };
        let until_us = self.until_us.unwrap_or(u64::MAX);
        // Behind a gap, nothing is of use before a beginning.
        let steps = if self.clock.is_some() { steps } else { 0 };
        if let Some(clock) = &mut self.clock {
            clock.next_step = clock.next_step.saturating_add(steps);
            // The last of these macro steps began a period before the next one.
            self.is_over = clock.next_us().saturating_sub(clock.period_us) > until_us;
            clock.next_step = clock.next_step.saturating_add(skipped);
        }
        let (mission, start_us, next_step) = match *record {
            Recorded::Started {
                anew,
                mission,
                start_us,
                ..
            } => {
                self.counts.gaps += u64::from(anew && self.clock.is_some());
                (mission, start_us, 0)
            }
            Recorded::State {
                anew,
                mission,
                start_us,
                progress,
                ..
            } => {
                // Nothing is missing before the first macro step of a mission that took over warm,
                // and before the one that is due. So does a replay see it.
                let is_due = |clock: &Clock| {
                    let is_same = (clock.mission, clock.start_us) == (mission, start_us);
                    progress.steps == if is_same { clock.next_step } else { 0 }
                };
                if (self.clock.as_ref()).is_some_and(|clock| anew || !is_due(clock)) {
                    self.counts.gaps += 1;
                }
                (mission, start_us, progress.steps)
            }
            _ => return steps,
        };
        self.counts.beginnings += 1;
        let known = self.missions.iter().find(|known| known.hash == mission);
        let clock = Clock {
            mission,
            start_us,
            period_us: known.map_or(0, |known| known.period_us),
            next_step,
        };
        self.is_over |= clock.next_us() > until_us;
        self.before = self.clock.replace(clock).or(self.before);
        steps
    }

    /// From now on samples of the mission are of these nets.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn nets(&mut self, mission: u32, nets: &[Watched]) -> io::Result<()> {
        self.flush()?;
        let frame = self.samples.nets(mission, nets);
        self.write(&frame)
    }

    /// Adds a sample of the nets that were named. One that cannot be told apart from those of
    /// another run of the mission is left out.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn sample(&mut self, sample: RawSample) -> io::Result<()> {
        self.take_early()?;
        let is_of = |clock: &Clock| clock.mission == sample.mission && clock.reaches(sample.t_us);
        let clocks = [self.clock, self.before];
        match clocks.into_iter().flatten().find(is_of) {
            Some(clock) => self.add_sample(&sample, clock.start_us),
            None => {
                if self.early.len() == MAX_EARLY_SAMPLES {
                    self.early.remove(0);
                }
                self.early.push(sample);
                Ok(())
            }
        }
    }

    /// Takes the samples that came before the beginning of their mission.
    fn take_early(&mut self) -> io::Result<()> {
        let Some(clock) = self.clock else {
            return Ok(());
        };
        let (due, early) = (std::mem::take(&mut self.early).into_iter())
            .partition(|sample| sample.mission == clock.mission && clock.reaches(sample.t_us));
        self.early = early;
        let due: Vec<RawSample> = due;
        (due.iter()).try_for_each(|sample| self.add_sample(sample, clock.start_us))
    }

    fn add_sample(&mut self, sample: &RawSample, start_us: u64) -> io::Result<()> {
        let until_us = self.until_us.unwrap_or(u64::MAX);
        if start_us.saturating_add(sample.t_us) > until_us {
            return Ok(());
        }
        if !self.samples.goes_on(sample, start_us) {
            self.flush()?;
        }
        self.counts.samples += u64::from(self.samples.add(sample, start_us));
        if self.samples.bytes() >= FRAME_BYTES {
            self.flush()?;
        }
        Ok(())
    }

    /// Macro steps without a change before the one of this number, which nobody has told yet; none
    /// where more is missing than that.
    fn quiet_before(&self, mission: u32, start_us: u64, step: u64) -> Option<u64> {
        let clock = self.clock.as_ref()?;
        let is_same = (clock.mission, clock.start_us) == (mission, start_us);
        let quiet = step.checked_sub(clock.next_step).filter(|_| is_same)?;
        (quiet <= MAX_QUIET.into()).then_some(quiet)
    }

    /// Notes that something did not come.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn gap(&mut self, missing: u32) -> io::Result<()> {
        if self.is_over {
            return Ok(());
        }
        self.flush()?;
        self.write_gap(missing)
    }

    /// Writes that something is missing behind all that was written.
    fn write_gap(&mut self, missing: u32) -> io::Result<()> {
        self.write_quiet()?;
        self.counts.gaps += 1;
        // What comes next goes on from elsewhere.
        self.before = self.clock.take().or(self.before);
        self.condenser.forget();
        self.write(&Frame::Gap(missing))
    }

    /// Notes where background runs ended in a simulated run.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn ends(&mut self, ends: &[BackgroundRunEnd]) -> io::Result<()> {
        self.flush()?;
        self.write_quiet()?;
        self.write(&Frame::Ends(ends.to_vec()))
    }

    /// Writes all that came, and how many macro steps of the last mission it is of, where that is
    /// known.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn finish(mut self, steps: Option<u64>) -> io::Result<(W, Counts)> {
        if let Some((steps, next)) = steps.zip(self.next_step()) {
            // The robot need not have said yet that nothing entered before the last of them; or has
            // told of some behind the end.
            let quiet = steps.saturating_sub(next).min(MAX_QUIET.into()) as u32;
            if quiet > 0 {
                write_quiet(&mut Sink(&mut self.waiting), quiet);
            }
            self.counts.steps += u64::from(quiet);
            self.counts.steps = (self.counts.steps).saturating_sub(next.saturating_sub(steps));
        }
        self.take_early()?;
        self.flush()?;
        self.write_quiet()?;
        if let Some(steps) = steps {
            self.write(&Frame::End(steps))?;
        }
        Ok((self.out, self.counts))
    }

    /// What it holds so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Writes what came, as far as it is to be kept.
    ///
    /// # Errors
    /// Whatever the file has.
    pub fn flush(&mut self) -> io::Result<()> {
        self.waiting_steps = 0;
        let records = std::mem::take(&mut self.waiting);
        let mut kept = Vec::new();
        let taken = (self.condenser).take(&records, self.missions.as_slice(), &mut kept);
        self.write_records(kept)?;
        if taken.is_err() {
            // Nobody has said so, but something is missing.
            self.write_gap(1)?;
            self.lost = true;
        }
        // Behind the beginning of their mission.
        match self.samples.take() {
            Some(samples) => self.write(&samples),
            None => Ok(()),
        }
    }

    /// Whether something was missing since this was last asked, of which no word came: whoever can
    /// asks the robot for all that its machine is.
    pub fn take_lost(&mut self) -> bool {
        std::mem::take(&mut self.lost)
    }

    /// Writes how many macro steps were made since the last record that was kept.
    fn write_quiet(&mut self) -> io::Result<()> {
        let mut kept = Vec::new();
        self.condenser.tell_quiet(&mut kept);
        self.write_records(kept)
    }

    fn write_records(&mut self, records: Vec<u8>) -> io::Result<()> {
        if records.is_empty() {
            return Ok(());
        }
        self.counts.record_bytes += records.len() as u64;
        self.write(&Frame::Records(records))
    }

    /// Writes a frame, and hands it to the system: it is there then, whatever becomes of this
    /// process.
    fn write(&mut self, frame: &Frame) -> io::Result<()> {
        frame.write(&mut self.out)?;
        self.out.flush()
    }
}
