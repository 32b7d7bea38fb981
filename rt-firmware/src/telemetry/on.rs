//! A firmware with telemetry.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use crate::ports::Executor;
use crate::show::Show;
use esm_link::message::MAX_STREAM_BYTES;
use esm_link::telemetry::{self, HEADER_WORDS, MAX_VALUE_WORDS, SAMPLE_WORDS, WORD_BYTES};

/// What both sides look at.
pub(crate) struct TelemetryMemory {
    /// Whether samples are wanted. The reader's.
    wanted: AtomicBool,
    /// Words of the sample that is here; 0 where none is, and the writer may write one.
    len: AtomicU8,
    words: [AtomicU32; SAMPLE_WORDS],
    /// Samples that were due and found no room; wraps. The writer's.
    dropped: AtomicU32,
}

impl TelemetryMemory {
    pub(crate) const fn new() -> Self {
        TelemetryMemory {
            wanted: AtomicBool::new(false),
            len: AtomicU8::new(0),
            words: [const { AtomicU32::new(0) }; SAMPLE_WORDS],
            dropped: AtomicU32::new(0),
        }
    }

    /// Its two sides.
    pub(crate) fn split(&mut self) -> (Sampler<'_>, SampleReader<'_>) {
        let shared = &*self;
        (
            Sampler {
                shared,
                number: 0,
                mission: 0,
                period_us: 0,
                due_us: 0,
                nets: [0; MAX_VALUE_WORDS],
                count: 0,
            },
            SampleReader {
                shared,
                asked: None,
            },
        )
    }
}

/// Writes samples.
pub(crate) struct Sampler<'m> {
    shared: &'m TelemetryMemory,
    number: u8,
    mission: u32,
    period_us: u32,
    /// Time of the mission from which on the next sample is due.
    due_us: u64,
    /// Nets by their indices in the mission, and how many.
    nets: [u16; MAX_VALUE_WORDS],
    count: u8,
}

impl Sampler<'_> {
    /// From now on there are samples of these nets.
    pub(crate) fn begin(
        &mut self,
        number: u8,
        mission: u32,
        period_ms: u16,
        nets: impl Iterator<Item = u16>,
    ) {
        self.number = number;
        self.mission = mission;
        self.period_us = u32::from(period_ms) * 1_000;
        self.due_us = 0;
        self.count = 0;
        for (place, net) in self.nets.iter_mut().zip(nets) {
            *place = net;
            self.count += 1;
        }
    }

    /// A mission starts. Nets are those of one mission: with another one there are no samples any
    /// more.
    pub(crate) fn started(&mut self, mission: u32) {
        self.due_us = 0;
        if mission != self.mission {
            self.count = 0;
        }
    }

    /// A macro step has ended that started at this time of the mission.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn after_step(&mut self, executor: &Executor<'_>, t_us: u64) {
        if self.shared.wanted.load(Ordering::Relaxed) {
            self.sample(executor, t_us);
        }
    }

    // Not inlined: no macro step should be made on top of what this needs of the stack.
    #[inline(never)]
    fn sample(&mut self, executor: &Executor<'_>, t_us: u64) {
        if t_us < self.due_us || self.count == 0 {
            return;
        }
        self.due_us = t_us + u64::from(self.period_us);
        let TelemetryMemory {
            len,
            words,
            dropped,
            ..
        } = self.shared;
        // Acquire: what the reader has read may be written over.
        if len.load(Ordering::Acquire) > 0 {
            dropped.store(
                dropped.load(Ordering::Relaxed).wrapping_add(1),
                Ordering::Relaxed,
            );
            return;
        }
        let [head, nets, low, high, values @ ..] = words;
        let (mut count, mut has, mut left_out) = (0, 0, 0);
        for (place, net) in (0_u32..).zip(self.nets.iter().take(usize::from(self.count))) {
            let room = values.get(count..).unwrap_or_default();
            let mut show = Show::new(room);
            if !executor.show(*net, &mut show) {
                continue;
            }
            // One that does not fit leaves its place to those behind it.
            if show.len() > room.len() {
                left_out += 1;
                continue;
            }
            count += show.len();
            has |= 1 << place;
        }
        head.store(telemetry::head(self.number, left_out), Ordering::Relaxed);
        nets.store(has, Ordering::Relaxed);
        low.store(t_us as u32, Ordering::Relaxed);
        high.store((t_us >> u32::BITS) as u32, Ordering::Relaxed);
        // Release: the sample is there before its length is.
        len.store((HEADER_WORDS + count) as u8, Ordering::Release);
    }
}

/// Reads samples, and says whether some are wanted.
pub(crate) struct SampleReader<'m> {
    shared: &'m TelemetryMemory,
    /// Number of the request that asked for them, and hash of the mission.
    asked: Option<(u8, u32)>,
}

impl SampleReader<'_> {
    /// Samples are wanted, since a request of this number asked for those of the mission of this
    /// hash.
    pub(crate) fn begin(&mut self, number: u8, mission: u32) {
        self.asked = Some((number, mission));
        self.shared.wanted.store(true, Ordering::Relaxed);
    }

    /// No samples are wanted, also not the one that may be here.
    pub(crate) fn end(&mut self) {
        self.asked = None;
        self.shared.wanted.store(false, Ordering::Relaxed);
        self.shared.len.store(0, Ordering::Release);
    }

    /// Reads the sample that is here, or says that no more will come, as `runs` tells which mission
    /// does. Returns the number of bytes.
    pub(crate) fn read(
        &mut self,
        room: &mut [u8; MAX_STREAM_BYTES],
        runs: impl FnOnce() -> Option<Option<u32>>,
    ) -> usize {
        let Some((number, mission)) = self.asked else {
            return 0;
        };
        let TelemetryMemory { len, words, .. } = self.shared;
        // Acquire: the sample is there when its length is.
        let mut count = usize::from(len.load(Ordering::Acquire));
        if count > 0 {
            let (places, _) = room.as_chunks_mut::<WORD_BYTES>();
            for (place, word) in places.iter_mut().zip(words) {
                *place = word.load(Ordering::Relaxed).to_le_bytes();
            }
            // Release: it was read before it is written over.
            len.store(0, Ordering::Release);
        } else if let Some(runs) = runs()
            && runs != Some(mission)
        {
            self.end();
            let (end, rest) = room.split_at_mut(WORD_BYTES);
            end.copy_from_slice(&telemetry::end(number).to_le_bytes());
            rest.fill(0);
            count = HEADER_WORDS;
        }
        count * WORD_BYTES
    }

    pub(crate) fn dropped(&self) -> u32 {
        self.shared.dropped.load(Ordering::Relaxed)
    }
}
