//! Samples in a recording: the values that were on nets of a mission, beside what entered its
//! interpreter.
//!
//! They enter no machine, and a replay passes over them. A frame of nets says which nets of a
//! mission the samples behind it are of, up to the next one of the same mission:
//!
//! | is | content |
//! |---|---|
//! | mission | its hash: number |
//! | each net, to the end of the content | its index: number; name of its type, what its values are made of, as the robot says it: texts; how many names it has: number; its names: texts |
//!
//! A frame of samples is of one run of one mission, and can be read with the frame of nets alone:
//!
//! | is | content |
//! |---|---|
//! | mission | its hash: number |
//! | start | when that mission started, as in its records: number |
//! | each sample, to the end of the content | time of the mission, as difference from the sample before: number; bit n, whether the nth net holds a value: number; the words of those that do, each as the bits that differ from those of the same word in the last sample that has it: numbers |

use std::collections::HashMap;
use std::sync::Arc;

use esm_link::telemetry::MAX_VALUE_WORDS;
use thiserror::Error;

use super::file::{Frame, push_number, push_text, take_number, take_text};
use super::player::Recording;
use crate::parameters::Value;
use crate::values::{Net, Watched, fields_of, text_of, values_in, words_of};

/// Names of a net that are read: a mission has no more ports.
const MAX_NAMES: usize = 1 << 12;

/// What was on the nets of a mission at one moment, as it came.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawSample {
    /// Hash of the mission.
    pub mission: u32,
    /// Nominal start of the macro step behind which it was read, in microseconds since the mission
    /// started.
    pub t_us: u64,
    /// Bit n: the nth net holds a value.
    pub has: u32,
    /// The words of those that do.
    pub words: Vec<u32>,
}

/// Puts samples into frames.
#[derive(Default)]
pub(super) struct SampleFrames {
    /// Words of each net of a mission.
    widths: HashMap<u32, Vec<usize>>,
    /// The frame that samples are added to.
    open: Option<OpenFrame>,
}

struct OpenFrame {
    mission: u32,
    start_us: u64,
    content: Vec<u8>,
    last: Last,
}

/// The sample before, by which the next one is written.
#[derive(Default)]
struct Last {
    t_us: u64,
    /// Words of all nets, one behind the other.
    words: Vec<u32>,
}

impl SampleFrames {
    /// From now on samples of the mission are of these nets. Answers the frame that says so.
    pub(super) fn nets(&mut self, mission: u32, nets: &[Watched]) -> Frame {
        let widths = nets.iter().map(|watched| words_of(&watched.fields));
        self.widths.insert(mission, widths.collect());
        let mut content = Vec::new();
        push_number(&mut content, mission.into());
        for Watched { net, fields } in nets {
            push_number(&mut content, net.index.into());
            push_text(&mut content, &net.type_name);
            push_text(&mut content, &text_of(fields));
            push_number(&mut content, net.names.len() as u64);
            for name in &net.names {
                push_text(&mut content, name);
            }
        }
        Frame::Nets(content)
    }

    /// Whether a sample of a mission that started then can be added to the frame that goes on.
    pub(super) fn goes_on(&self, sample: &RawSample, start_us: u64) -> bool {
        self.open.as_ref().is_none_or(|open| {
            (open.mission, open.start_us) == (sample.mission, start_us)
                && open.last.t_us <= sample.t_us
        })
    }

    /// Adds a sample of a mission that started then, with which the frame goes on. False of one
    /// that makes no sense: of unknown nets, or with other words than they have.
    pub(super) fn add(&mut self, sample: &RawSample, start_us: u64) -> bool {
        let Some(widths) = self.widths.get(&sample.mission) else {
            return false;
        };
        let places: Vec<usize> = places_of(widths, sample.has).collect();
        if places.len() != sample.words.len() {
            return false;
        }
        let open = self.open.get_or_insert_with(|| {
            let mut content = Vec::new();
            push_number(&mut content, sample.mission.into());
            push_number(&mut content, start_us);
            OpenFrame {
                mission: sample.mission,
                start_us,
                content,
                last: Last::of(widths),
            }
        });
        push_number(
            &mut open.content,
            sample.t_us.saturating_sub(open.last.t_us),
        );
        push_number(&mut open.content, sample.has.into());
        open.last.t_us = sample.t_us;
        for (place, word) in places.into_iter().zip(&sample.words) {
            if let Some(last) = open.last.words.get_mut(place) {
                push_number(&mut open.content, (*last ^ word).into());
                *last = *word;
            }
        }
        true
    }

    /// Bytes of the frame that goes on.
    pub(super) fn bytes(&self) -> usize {
        self.open.as_ref().map_or(0, |open| open.content.len())
    }

    /// The frame that goes on, if there is one: the next sample begins another.
    pub(super) fn take(&mut self) -> Option<Frame> {
        Some(Frame::Samples(self.open.take()?.content))
    }
}

impl Last {
    fn of(widths: &[usize]) -> Self {
        Last {
            t_us: 0,
            words: vec![0; widths.iter().sum()],
        }
    }
}

/// Places of the words of those nets that hold a value, among those of all nets of these widths.
fn places_of(widths: &[usize], has: u32) -> impl Iterator<Item = usize> {
    let mut end = 0;
    (0_u32..).zip(widths).flat_map(move |(net, width)| {
        let start = end;
        end += width;
        let holds = has.checked_shr(net).is_some_and(|bits| bits & 1 != 0);
        start..if holds { end } else { start }
    })
}

/// What was on nets of a mission at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Hash of the mission.
    pub mission: u32,
    /// The stretch that the mission ran in.
    pub stretch: usize,
    /// When it was, in microseconds since the mission started.
    pub t_us: u64,
    /// The nets.
    pub nets: Arc<[Watched]>,
    /// Their values; none of a net that nothing was written to yet.
    pub values: Vec<Option<Vec<Value>>>,
}

/// The samples in a recording make no sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "the samples of values in the recording make no sense: another program wrote them, or a defect"
)]
pub struct BadSamples;

impl Recording {
    /// Whether samples were kept.
    pub fn has_samples(&self) -> bool {
        let mut frames = self.sample_frames.iter();
        frames.any(|(_, frame)| matches!(frame, Frame::Samples(_)))
    }

    /// The samples that were kept, in the order in which they came. Nothing comes behind one that
    /// makes no sense.
    pub fn samples(&self) -> Samples<'_> {
        Samples {
            recording: self,
            next_frame: 0,
            nets: HashMap::new(),
            open: None,
        }
    }
}

/// The samples of a recording.
pub struct Samples<'r> {
    recording: &'r Recording,
    next_frame: usize,
    nets: HashMap<u32, Arc<[Watched]>>,
    open: Option<Opened<'r>>,
}

/// A frame of samples that is read.
struct Opened<'r> {
    mission: u32,
    stretch: usize,
    nets: Arc<[Watched]>,
    widths: Vec<usize>,
    last: Last,
    rest: &'r [u8],
}

impl Iterator for Samples<'_> {
    type Item = Result<Sample, BadSamples>;

    fn next(&mut self) -> Option<Self::Item> {
        let next = self.read().transpose();
        if matches!(next, Some(Err(_))) {
            self.open = None;
            self.next_frame = usize::MAX;
        }
        next
    }
}

impl<'r> Samples<'r> {
    fn read(&mut self) -> Result<Option<Sample>, BadSamples> {
        loop {
            if let Some(open) = self.open.as_mut().filter(|open| !open.rest.is_empty()) {
                return open.take().map(Some).ok_or(BadSamples);
            }
            let Some((begun, frame)) = self.recording.sample_frames.get(self.next_frame) else {
                return Ok(None);
            };
            self.next_frame += 1;
            match frame {
                Frame::Nets(content) => {
                    let (mission, nets) = take_nets(content).ok_or(BadSamples)?;
                    self.nets.insert(mission, nets);
                }
                Frame::Samples(content) => {
                    self.open = self.open(*begun, content).ok_or(BadSamples)?;
                }
                _ => {}
            }
        }
    }

    /// The beginning of a frame of samples. None of a run of the mission whose beginning is not in
    /// the recording, since it is not known when that was.
    fn open(&self, begun: usize, mut rest: &'r [u8]) -> Option<Option<Opened<'r>>> {
        let mission = take_number(&mut rest)?;
        let start_us = take_number::<u64>(&mut rest)?;
        let nets = self.nets.get(&mission)?.clone();
        let stretches = self.recording.stretches.get(..begun)?;
        let is_of =
            |stretch: &super::Stretch| (stretch.mission, stretch.start_us) == (mission, start_us);
        let widths: Vec<usize> = (nets.iter())
            .map(|watched| words_of(&watched.fields))
            .collect();
        Some(stretches.iter().rposition(is_of).map(|stretch| Opened {
            mission,
            stretch,
            last: Last::of(&widths),
            nets,
            widths,
            rest,
        }))
    }
}

impl Opened<'_> {
    /// The next sample.
    fn take(&mut self) -> Option<Sample> {
        let since = take_number::<u64>(&mut self.rest)?;
        self.last.t_us = self.last.t_us.checked_add(since)?;
        let has = take_number(&mut self.rest)?;
        let mut words = Vec::new();
        for place in places_of(&self.widths, has) {
            let last = self.last.words.get_mut(place)?;
            *last ^= take_number::<u32>(&mut self.rest)?;
            words.push(*last);
        }
        Some(Sample {
            mission: self.mission,
            stretch: self.stretch,
            t_us: self.last.t_us,
            nets: self.nets.clone(),
            values: values_in(&self.nets, has, words.into_iter()),
        })
    }
}

/// The mission and the nets that a frame names. No more than a sample has room for.
fn take_nets(mut content: &[u8]) -> Option<(u32, Arc<[Watched]>)> {
    let rest = &mut content;
    let mission = take_number(rest)?;
    let (mut nets, mut words) = (Vec::new(), 0);
    while !rest.is_empty() {
        let index = take_number(rest)?;
        let type_name = take_text(rest)?;
        let fields = fields_of(&take_text(rest)?)?;
        let count = take_number::<usize>(rest)?;
        let mut names = Vec::new();
        for _ in 0..count.min(MAX_NAMES) {
            names.push(take_text(rest)?);
        }
        words += words_of(&fields).max(1);
        if words > MAX_VALUE_WORDS || count > MAX_NAMES {
            return None;
        }
        nets.push(Watched {
            net: Net {
                index,
                names,
                type_name,
            },
            fields: fields.into(),
        });
    }
    Some((mission, nets.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::file::{self, Header};
    use crate::recording::planted::BLINK;
    use crate::recording::player::{RecordingError, replay};
    use crate::recording::told::Told;
    use crate::recording::writer::RecordingWriter;
    use crate::samples::directory_and_blob;
    use esm_link::recording::{write_quiet, write_started};
    use esm_link::trace::RecordSink;
    use proptest::prelude::*;

    const PERIOD_US: u32 = 20_000;

    #[derive(Default)]
    struct Bytes(Vec<u8>);

    impl RecordSink for Bytes {
        fn put(&mut self, byte: u8) {
            self.0.push(byte);
        }
    }

    fn net(index: u16, name: &str, fields: &str) -> Watched {
        Watched {
            net: Net {
                index,
                names: vec![name.to_owned(), format!("{name}_in")],
                type_name: "T".to_owned(),
            },
            fields: fields_of(fields).unwrap().into(),
        }
    }

    fn nets() -> Vec<Watched> {
        vec![
            net(3, "a/A.pose", "x_m:f32\ny_m:f32\nheading_rad:f32\n"),
            net(1, "a/A.count", ":u32\n"),
        ]
    }

    /// A recording that is made of a machine that blinks.
    struct Made {
        writer: RecordingWriter<Vec<u8>>,
        hash: u32,
    }

    impl Made {
        fn new() -> Self {
            let (_, blob) = directory_and_blob(BLINK);
            let hash = esm_core::verify(&blob[..]).unwrap().hash();
            let mut writer = RecordingWriter::new(Vec::new(), Header::default(), None).unwrap();
            writer.mission("blink", hash, &blob, PERIOD_US).unwrap();
            writer.nets(hash, &nets()).unwrap();
            Made { writer, hash }
        }

        fn starts(mut self, start_us: u64) -> Self {
            let mut records = Bytes::default();
            write_started(&mut records, 0, false, self.hash, start_us);
            self.writer.records(&records.0).unwrap();
            self
        }

        fn steps(mut self, steps: u32) -> Self {
            let mut records = Bytes::default();
            write_quiet(&mut records, steps);
            self.writer.records(&records.0).unwrap();
            self
        }

        /// A sample in which both nets have a value, or only the first.
        fn sample(mut self, t_us: u64, x_m: f32, count: Option<u32>) -> Self {
            let mut words = vec![x_m.to_bits(), 0, (-x_m).to_bits()];
            words.extend(count);
            let sample = RawSample {
                mission: self.hash,
                t_us,
                has: if count.is_some() { 3 } else { 1 },
                words,
            };
            self.writer.sample(sample).unwrap();
            self
        }

        fn bytes(self) -> Vec<u8> {
            self.writer.finish(None).unwrap().0
        }

        fn recording(self) -> Recording {
            Recording::read(&self.bytes()).unwrap()
        }
    }

    /// When each sample was on the line of time of the recording, and what it said of the first
    /// number.
    fn told_of(recording: &Recording) -> Vec<(u64, Value)> {
        let (told, ended) = Told::of(recording);
        ended.unwrap();
        let samples = recording.samples().map(|sample| {
            let sample = sample.unwrap();
            let first = sample.values[0].as_ref().unwrap()[0];
            (told.place(&sample, recording).unwrap().0, first)
        });
        samples.collect()
    }

    fn records_in(bytes: &[u8]) -> Vec<u8> {
        let (frames, _) = file::read(bytes).unwrap();
        let records = frames.into_iter().map(|frame| match frame {
            Frame::Records(records) => records,
            _ => Vec::new(),
        });
        records.collect::<Vec<_>>().concat()
    }

    #[test]
    fn samples_come_back_as_they_were_taken() {
        let made = Made::new().starts(0).steps(10);
        let made = made.sample(20_000, 0.5, None).sample(40_000, 0.75, Some(7));
        let recording = made.steps(10).sample(60_000, 0.75, Some(7)).recording();
        let samples: Vec<Sample> = recording.samples().map(Result::unwrap).collect();
        let values: Vec<_> = samples
            .iter()
            .map(|it| (it.t_us, it.values.clone()))
            .collect();
        let pose = |x_m: f32| Some([x_m, 0.0, -x_m].map(Value::F32).to_vec());
        let count = |count| Some(vec![Value::U32(count)]);
        assert_eq!(
            values,
            [
                (20_000, vec![pose(0.5), None]),
                (40_000, vec![pose(0.75), count(7)]),
                (60_000, vec![pose(0.75), count(7)]),
            ]
        );
        assert_eq!(*samples[0].nets, *nets());
    }

    #[test]
    fn samples_change_no_record_and_no_replay() {
        let with = Made::new().starts(0).sample(0, 1.0, None).steps(100);
        let with = with.sample(1_980_000, 2.0, Some(1)).steps(100).bytes();
        let without = Made::new().starts(0).steps(100).steps(100).bytes();
        assert_eq!(records_in(&with), records_in(&without));
        let replayed = |bytes: &[u8]| {
            let mut trace = Vec::new();
            let recording = Recording::read(bytes).unwrap();
            let outcome = replay(&recording, false, Some(&mut trace)).unwrap();
            (outcome, trace)
        };
        assert_eq!(replayed(&with), replayed(&without));
    }

    #[test]
    fn a_sample_is_of_the_run_in_which_it_was_taken_however_late_or_early_it_comes() {
        let second = 1_000_000;
        // Before word of the mission's beginning.
        let early = Made::new().sample(0, 1.0, None).starts(0).steps(5);
        // Of the run before, when the mission runs anew.
        let late = Made::new()
            .starts(0)
            .steps(120)
            .steps(30)
            .starts(5 * second);
        let late = late
            .steps(1)
            .sample(2_980_000, 1.0, None)
            .sample(20_000, 2.0, None);
        // Behind a reset, with which the robot's times begin anew.
        let reset = Made::new().starts(0).steps(50).sample(980_000, 1.0, None);
        let reset = reset.starts(0).steps(50).sample(20_000, 2.0, None);
        type Case<'a> = (&'a str, Made, &'a [(u64, f32)]);
        let cases: [Case<'_>; 3] = [
            ("early", early, &[(0, 1.0)]),
            ("late", late, &[(2_980_000, 1.0), (5_020_000, 2.0)]),
            ("reset", reset, &[(980_000, 1.0), (1_020_000, 2.0)]),
        ];
        for (case, made, expected) in cases {
            let found = told_of(&made.recording());
            let expected: Vec<_> = expected.iter().map(|(t, x)| (*t, Value::F32(*x))).collect();
            assert_eq!(found, expected, "{case}");
        }
    }

    #[test]
    fn a_sample_of_which_the_nets_are_not_known_is_left_out() {
        let mut made = Made::new().starts(0).steps(5);
        for (mission, words) in [(made.hash, vec![1; 2]), (made.hash ^ 1, vec![1; 4])] {
            let sample = RawSample {
                mission,
                t_us: 0,
                has: 3,
                words,
            };
            made.writer.sample(sample).unwrap();
        }
        assert_eq!(made.writer.counts().samples, 0);
        assert!(!made.recording().has_samples());
    }

    #[test]
    fn more_bytes_of_other_frames_than_are_replayed_are_refused_and_samples_are_not_counted() {
        let most = usize::try_from(file::MAX_INPUT_BYTES).unwrap();
        let read = |frame: Frame| {
            let mut bytes = Made::new().starts(0).steps(5).bytes();
            frame.write(&mut bytes).unwrap();
            Recording::read(&bytes).map(|_| ())
        };
        read(Frame::Samples(vec![0; most])).unwrap();
        let refused = read(Frame::Nets(vec![0; most]));
        assert!(matches!(refused, Err(RecordingError::TooMuch(_))));
    }

    proptest! {
        #[test]
        fn whatever_stands_in_frames_is_read_or_refused_and_replays_all_the_same(
            nets in prop::collection::vec(any::<u8>(), 0..60),
            samples in prop::collection::vec(any::<u8>(), 0..60),
            changed in any::<(prop::sample::Index, u8)>(),
        ) {
            let bytes = Made::new().starts(0).sample(0, 1.0, Some(9)).steps(5).bytes();
            let (mut frames, _) = file::read(&bytes).unwrap();
            for frame in &mut frames {
                if let Frame::Samples(content) | Frame::Nets(content) = frame {
                    let at = changed.0.index(content.len());
                    content[at] ^= changed.1;
                }
            }
            frames.extend([Frame::Nets(nets), Frame::Samples(samples)]);
            let mut bytes = Vec::new();
            file::write_mark(&mut bytes).unwrap();
            for frame in frames {
                frame.write(&mut bytes).unwrap();
            }
            let recording = Recording::read(&bytes).unwrap();
            let count = recording.samples().take(1_000).count();
            prop_assert!(count < 1_000);
            prop_assert!(replay(&recording, false, None::<Vec<u8>>).is_ok());
        }
    }
}
