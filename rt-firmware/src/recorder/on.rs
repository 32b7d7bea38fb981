//! A firmware that records.
//!
//! It sees only what differs: flags and enable bits before a macro step, against those after the
//! one before. So whatever part of the runtime writes a flag, it is recorded.

use core::ops::Deref;
use core::sync::atomic::{AtomicU32, Ordering};

use esm_core::Interpreter;

use crate::ring::{Part, RecordRing, RingReader, RingWriter};
use esm_link::message::LinkError;
use esm_link::recording::{
    MAX_QUIET, STATE_HEADER_BYTES, STATE_WORD_BYTES, write_changes, write_quiet, write_skipped,
    write_started, write_state,
};

/// Subscriptions are numbered in the low half of a word; in the high half, how often one came after
/// a time in which nothing was wanted.
const PAUSE: u32 = 1 << 16;

/// Memory of a recorder for machines of up to so many words: ten bytes for each.
pub(crate) struct RecorderMemory<const WORDS: usize> {
    ring: RecordRing<WORDS>,
    asked: AtomicU32,
    /// What flags are compared with.
    known: [u32; WORDS],
}

impl<const WORDS: usize> RecorderMemory<WORDS> {
    pub(crate) const fn new() -> Self {
        RecorderMemory {
            ring: RecordRing::new(),
            asked: AtomicU32::new(0),
            known: [0; WORDS],
        }
    }

    /// Its two sides.
    pub(crate) fn split(&mut self) -> (Recorder<'_>, RecordReader<'_>) {
        // A recording begins with all that the machine is.
        const { assert!(WORDS >= RecordRing::<WORDS>::FEWEST_WORDS) };
        let (writer, reader) = self.ring.split();
        let asked = &self.asked;
        (
            Recorder {
                ring: writer,
                asked,
                begun: 0,
                takes_over: false,
                known: &mut self.known,
                quiet: 0,
                mission: (0, 0),
            },
            RecordReader {
                ring: reader,
                asked,
                subscription: 0,
            },
        )
    }
}

/// Reads a recording, and says whether one is wanted.
pub(crate) struct RecordReader<'m> {
    ring: RingReader<'m>,
    asked: &'m AtomicU32,
    /// Number of the last recording that was asked for.
    subscription: u32,
}

impl RecordReader<'_> {
    /// Lets a recording begin, with all that the machine is then, or end.
    ///
    /// # Errors
    /// [`LinkError::NotBuiltIn`] of a firmware that cannot.
    #[expect(
        clippy::unnecessary_wraps,
        reason = "a firmware without this feature refuses"
    )]
    pub(crate) fn want(&mut self, wanted: bool) -> Result<(), LinkError> {
        let number = self.subscription.wrapping_add(1) % PAUSE;
        let mut pauses = self.subscription / PAUSE;
        if !self.is_wanted() {
            // What is left of a recording before is nothing of this one.
            self.ring.clear();
            pauses = pauses.wrapping_add(1) % PAUSE;
        }
        // Never 0, which is nobody's.
        self.subscription = (pauses * PAUSE + number).max(1);
        let asked = if wanted { self.subscription } else { 0 };
        self.asked.store(asked, Ordering::Relaxed);
        Ok(())
    }

    pub(crate) fn is_wanted(&self) -> bool {
        self.asked.load(Ordering::Relaxed) != 0
    }

    pub(crate) fn read(&mut self, room: &mut [u8]) -> Part {
        self.ring.read(room)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.ring.is_empty()
    }

    pub(crate) fn dropped(&self) -> u32 {
        self.ring.dropped()
    }
}

/// Writes a recording.
pub(crate) struct Recorder<'m> {
    ring: RingWriter<'m>,
    /// Number of the last subscription; 0 while nobody wants a recording.
    asked: &'m AtomicU32,
    /// The subscription that the reader has had a beginning for.
    begun: u32,
    /// A mission has taken over warm, of whose beginning the reader knows all that was before.
    takes_over: bool,
    /// Flags and enable bits after the last macro step.
    known: &'m mut [u32],
    /// Macro steps without a change since the last record, that included which is made now.
    quiet: u32,
    /// Hash and start of the mission.
    mission: (u32, u64),
}

impl Recorder<'_> {
    /// Whether a recording is wanted.
    #[cfg_attr(feature = "speed", inline(always))]
    fn is_wanted(&self) -> bool {
        self.asked.load(Ordering::Relaxed) != 0
    }

    /// Whether the reader has had all that it asked for.
    fn is_in_step(&self) -> bool {
        self.begun == self.asked.load(Ordering::Relaxed)
    }

    /// Whether the reader knows all that was before. One that asked anew does so until that was
    /// written, too, if it finds no room at once.
    fn is_known(&self) -> bool {
        let asked = self.asked.load(Ordering::Relaxed);
        self.begun != 0 && self.begun / PAUSE == asked / PAUSE
    }

    /// A mission starts: from its beginning, or warm, with what it has taken over.
    pub(crate) fn started(&mut self, mission: u32, start_us: u64, warm: bool) {
        self.mission = (mission, start_us);
        if !self.is_wanted() {
            return;
        }
        if warm {
            // All that it is then is written before its first macro step; the end of the mission
            // before belongs to what came so far.
            let quiet = self.quiet;
            self.takes_over =
                self.is_known() && self.ring.record(0, |sink| write_quiet(sink, quiet));
            self.begun = 0;
            return;
        }
        self.takes_over = false;
        // Where something was lost before, the steps since then are of no use.
        let is_known = self.is_known();
        let quiet = if is_known { self.quiet } else { 0 };
        let written = self.ring.record(0, |sink| {
            write_started(sink, quiet, !is_known, mission, start_us);
        });
        self.known.fill(0);
        self.end_beginning(written);
    }

    /// Macro steps are left out before the next one.
    pub(crate) fn skipped(&mut self, missed: u32) {
        if self.is_wanted() && self.is_known() {
            let quiet = self.quiet;
            let written = self
                .ring
                .record(0, |sink| write_skipped(sink, quiet, missed));
            self.end_record(written);
        }
    }

    /// A macro step is next.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn before_step<B: Deref<Target = [u8]>>(
        &mut self,
        interpreter: &Interpreter<'_, B>,
    ) {
        if self.is_wanted() {
            self.write_inputs(interpreter);
        }
    }

    /// A macro step has ended.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn after_step<B: Deref<Target = [u8]>>(&mut self, interpreter: &Interpreter<'_, B>) {
        if self.is_wanted() {
            self.look_at(interpreter);
        }
    }

    /// Writes what changed since the last macro step, or all that there is if the reader does not
    /// know that one.
    #[inline(never)]
    fn write_inputs<B: Deref<Target = [u8]>>(&mut self, interpreter: &Interpreter<'_, B>) {
        if !self.is_in_step() && (self.begin_anew(interpreter) || !self.is_known()) {
            return;
        }
        let words = interpreter.input_words();
        let changed = words
            .iter()
            .zip(self.known.iter())
            .any(|(is, was)| is != was);
        if changed {
            let quiet = self.quiet;
            let bits = ChangedBits {
                now: words,
                before: self.known,
                word: 0,
                left: differ(words, self.known, 0),
            };
            let written = self.ring.record(0, |sink| write_changes(sink, quiet, bits));
            self.end_record(written);
            return;
        }
        self.quiet += 1;
        if self.quiet == MAX_QUIET {
            let written = self.ring.record(0, |sink| write_quiet(sink, MAX_QUIET));
            self.end_record(written);
        }
    }

    /// Writes all that the machine is, if there is room for it.
    #[cold]
    #[inline(never)]
    fn begin_anew<B: Deref<Target = [u8]>>(&mut self, interpreter: &Interpreter<'_, B>) -> bool {
        let words = interpreter.state_words();
        if !self
            .ring
            .has_room(STATE_HEADER_BYTES + STATE_WORD_BYTES * words.len())
        {
            return false;
        }
        let (mission, start_us) = self.mission;
        let progress = interpreter.progress();
        let goes_on = self.is_known() || (self.takes_over && progress.steps == 0);
        let written = self.ring.record(0, |sink| {
            write_state(sink, !goes_on, mission, start_us, &progress, words);
        });
        self.end_beginning(written);
        self.quiet = 1;
        true
    }

    /// Keeps what the next macro step is compared with.
    #[inline(never)]
    fn look_at<B: Deref<Target = [u8]>>(&mut self, interpreter: &Interpreter<'_, B>) {
        for (known, word) in self.known.iter_mut().zip(interpreter.input_words()) {
            *known = *word;
        }
    }

    /// A record was written, or found no room: then the reader has to begin anew.
    fn end_record(&mut self, written: bool) {
        self.quiet = 0;
        if !written {
            self.begun = 0;
        }
    }

    /// The same of a record with which the reader knows all, whatever was before it.
    fn end_beginning(&mut self, written: bool) {
        self.begun = self.asked.load(Ordering::Relaxed);
        self.end_record(written);
    }
}

/// The bits in which two rows of words differ, ascending.
#[derive(Clone)]
struct ChangedBits<'w> {
    now: &'w [u32],
    before: &'w [u32],
    /// The word that is looked at, and its bits that were not told yet.
    word: usize,
    left: u32,
}

fn differ(now: &[u32], before: &[u32], word: usize) -> u32 {
    match (now.get(word), before.get(word)) {
        (Some(now), Some(before)) => now ^ before,
        _ => 0,
    }
}

impl Iterator for ChangedBits<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        while self.left == 0 {
            self.word += 1;
            if self.word >= self.now.len() {
                return None;
            }
            self.left = differ(self.now, self.before, self.word);
        }
        let bit = self.left.trailing_zeros();
        self.left &= self.left - 1;
        Some(self.word as u32 * u32::BITS + bit)
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use esm_core::{Observer, TransitionTaken};

    use super::*;
    use esm_link::recording::Recorded;

    /// A mission with a few tasks, whose firmware takes it where there is no other.
    const BLOB: &[u8] = include_bytes!("../../../boards/stand_by.blob");
    const WORDS: usize = 64;
    const STEPS: u64 = 3_000;

    #[derive(Default)]
    struct Seen(Vec<TransitionTaken>);

    impl Observer for Seen {
        fn transition(&mut self, taken: TransitionTaken) {
            self.0.push(taken);
        }
    }

    /// What a macro step of a machine shows.
    fn step(machine: &mut Interpreter<'_, &[u8]>) -> (Vec<TransitionTaken>, Vec<u32>) {
        let mut seen = Seen::default();
        machine.macro_step(&mut seen).unwrap();
        (seen.0, machine.enabled_words().to_vec())
    }

    /// Runs what the records tell. Answers how many macro steps that were, and in how many
    /// stretches.
    fn replayed(records: &[u8], robot: &[(Vec<TransitionTaken>, Vec<u32>)]) -> (u64, u32) {
        let mut rest = records;
        let mut arena = [0; WORDS];
        let mut arena = Some(&mut arena[..]);
        let mut machine: Option<Interpreter<'_, &[u8]>> = None;
        let (mut steps, mut stretches) = (0, 0);
        while let Ok(record) = Recorded::take(&mut rest) {
            let mut make = |machine: &mut Interpreter<'_, &[u8]>, count: u64| {
                for _ in 0..count {
                    let number = machine.progress().steps as usize;
                    assert_eq!(step(machine), robot[number], "macro step {number}");
                    steps += 1;
                }
            };
            match (&mut machine, record) {
                (Some(machine), Recorded::Changes { quiet, bits }) => {
                    make(machine, quiet.into());
                    assert!(bits.iter().all(|bit| machine.toggle_input(bit as usize)));
                    make(machine, 1);
                }
                (Some(machine), Recorded::Quiet { quiet }) => make(machine, quiet.into()),
                (
                    Some(machine),
                    Recorded::State {
                        anew: false,
                        progress,
                        words,
                        ..
                    },
                ) => {
                    let quiet = progress.steps - machine.progress().steps;
                    assert!(quiet <= MAX_QUIET.into(), "{quiet} macro steps");
                    make(machine, quiet);
                    let words: Vec<u32> = words.iter().collect();
                    let entered: Vec<usize> = machine.inputs_unlike(&words).collect();
                    assert!(entered.iter().all(|bit| machine.toggle_input(*bit)));
                    assert!(machine.is_like(&words, &progress));
                }
                (
                    before,
                    Recorded::State {
                        progress, words, ..
                    },
                ) => {
                    let free = before.take().map(|machine| machine.into_parts().1);
                    let arena = free.or_else(|| arena.take()).unwrap();
                    let words: Vec<u32> = words.iter().collect();
                    let verified = esm_core::verify(BLOB).unwrap();
                    *before = Some(Interpreter::resume(verified, arena, &words, progress).unwrap());
                    stretches += 1;
                }
                (_, other) => panic!("{other:?}"),
            }
        }
        (steps, stretches)
    }

    #[test]
    fn what_is_dropped_is_told_where_it_is_missing_and_the_rest_is_as_it_was() {
        let mut lost = 0;
        for seed in 1..40_u64 {
            let mut random = seed;
            let mut below = |bound: u64| {
                random = random
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (random >> 33) % bound
            };
            let mut arena = [0; WORDS];
            let verified = esm_core::verify(BLOB).unwrap();
            let mut machine = Interpreter::new(verified, &mut arena).unwrap();
            let mut memory = RecorderMemory::<WORDS>::new();
            let (mut recorder, mut reader) = memory.split();
            recorder.started(1, 0, false);
            let mut robot = Vec::new();
            let mut records = Vec::new();
            let mut wire = true;
            for number in 0..STEPS {
                let bits = 32 * machine.input_words().len() as u64;
                for _ in 0..below(3) {
                    machine.toggle_input(below(bits) as usize);
                }
                // The first of them in the midst of the run.
                if number >= 10 && (number == 10 || below(40) == 0) {
                    reader.want(true).unwrap();
                }
                recorder.before_step(&machine);
                robot.push(step(&mut machine));
                recorder.after_step(&machine);
                // A wire that takes nothing for a while, or a part.
                if below(100) == 0 {
                    wire = !wire;
                }
                if wire {
                    let mut room = [0; 24];
                    let part = reader.read(&mut room);
                    records.extend_from_slice(&room[..part.len]);
                }
            }
            let (steps, stretches) = replayed(&records, &robot);
            assert!(steps > STEPS / 10, "seed {seed}: {steps}");
            assert_eq!(stretches > 1, reader.dropped() > 0, "seed {seed}");
            lost += stretches - 1;
        }
        assert!(lost > 10, "only {lost} losses");
    }
}
