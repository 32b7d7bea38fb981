//! What the real-time side tells of itself without being asked.

use core::sync::atomic::{AtomicU32, Ordering, fence};

use esm_link::message::{Mode, SafeReason};
use esm_link::trial::{FallBack, FallBackReason, Trial};

/// How the real-time side is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// What it is doing.
    pub mode: Mode,
    /// Hash of its mission.
    pub mission: Option<u32>,
    /// Macro steps that were completed since the mission started.
    pub steps: u64,
    /// Nominal start of the last macro step, in microseconds since the mission started.
    pub t_us: u64,
    /// Activations that were executed since the mission started.
    pub executed: u32,
    /// Activations missed since the robot started.
    pub missed: u32,
    /// Overruns since the robot started.
    pub overruns: u32,
    /// Longest start delay since the mission started, in nanoseconds.
    pub max_delay_ns: u32,
    /// Whether a background run is under way.
    pub background_busy: bool,
    /// If the mission runs on trial.
    pub trial: Option<Trial>,
    /// The last mission that was given up on trial.
    pub fell_back: Option<FallBack>,
    /// Parameters whose values differ from the mission's.
    pub changed_params: u8,
    /// Values of parameters that were saved for the mission.
    pub saved_params: u8,
}

impl Health {
    /// A robot without a mission.
    pub const EMPTY: Health = Health {
        mode: Mode::Empty,
        mission: None,
        steps: 0,
        t_us: 0,
        executed: 0,
        missed: 0,
        overruns: 0,
        max_delay_ns: 0,
        background_busy: false,
        trial: None,
        fell_back: None,
        changed_params: 0,
        saved_params: 0,
    };
}

const WORDS: usize = 13;
/// From this bit on the number of parameters that differ, which is at most
/// [`MAX_CHANGED`](crate::realtime::params::MAX_CHANGED) and takes four bits.
const CHANGED_PARAMS_SHIFT: u32 = 8;
/// From this bit on the number of those that were saved, which is no more.
const SAVED_PARAMS_SHIFT: u32 = 12;
const PARAMS_MASK: u32 = 0xF;
const HAS_MISSION: u32 = 1 << 16;
const BACKGROUND_BUSY: u32 = 1 << 17;
const ON_TRIAL: u32 = 1 << 18;
const TRIAL_HAS_BEFORE: u32 = 1 << 19;
const HAS_FALLEN_BACK: u32 = 1 << 20;
/// From this bit on the reason of the last fall-back.
const FALL_BACK_SHIFT: u32 = 24;
/// Attempts to read a snapshot between two writes. On one core, with the writer above the reader,
/// the first fails at most once.
const ATTEMPTS: usize = 64;

/// A [`Health`] that one side writes and another reads, neither waiting for the other.
///
/// The version is odd while the words are being written. A reader takes what it read only if the
/// version was even and the same before and after.
pub struct Snapshot {
    version: AtomicU32,
    words: [AtomicU32; WORDS],
}

impl Default for Snapshot {
    fn default() -> Self {
        Self::new()
    }
}

impl Snapshot {
    /// The snapshot of a robot without a mission.
    pub const fn new() -> Self {
        Snapshot {
            version: AtomicU32::new(0),
            words: [const { AtomicU32::new(0) }; WORDS],
        }
    }

    /// Its two sides.
    pub fn split(&mut self) -> (SnapshotWriter<'_>, SnapshotReader<'_>) {
        (SnapshotWriter(self), SnapshotReader(self))
    }
}

/// The side that writes.
pub struct SnapshotWriter<'a>(&'a Snapshot);

impl SnapshotWriter<'_> {
    /// Replaces the snapshot.
    pub fn write(&mut self, health: &Health) {
        let Snapshot { version, words } = self.0;
        let before = version.load(Ordering::Relaxed);
        version.store(before.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        for (place, word) in words.iter().zip(pack(health)) {
            place.store(word, Ordering::Relaxed);
        }
        version.store(before.wrapping_add(2), Ordering::Release);
    }
}

/// The side that reads.
pub struct SnapshotReader<'a>(&'a Snapshot);

impl SnapshotReader<'_> {
    /// The last snapshot. `None` if each attempt met a write, which cannot be on one core.
    pub fn read(&self) -> Option<Health> {
        let Snapshot { version, words } = self.0;
        for _ in 0..ATTEMPTS {
            let before = version.load(Ordering::Acquire);
            let mut copy = [0; WORDS];
            for (place, word) in copy.iter_mut().zip(words) {
                *place = word.load(Ordering::Relaxed);
            }
            fence(Ordering::Acquire);
            if before.is_multiple_of(2) && version.load(Ordering::Relaxed) == before {
                return Some(unpack(&copy));
            }
        }
        None
    }
}

fn pack(health: &Health) -> [u32; WORDS] {
    let mode = u32::from(health.mode.number());
    let params = u32::from(health.changed_params) << CHANGED_PARAMS_SHIFT
        | u32::from(health.saved_params) << SAVED_PARAMS_SHIFT;
    let mission = if health.mission.is_some() {
        HAS_MISSION
    } else {
        0
    };
    let background = if health.background_busy {
        BACKGROUND_BUSY
    } else {
        0
    };
    let (trial, left_ms, before) = match health.trial {
        Some(Trial { left_ms, before }) => match before {
            Some(before) => (ON_TRIAL | TRIAL_HAS_BEFORE, left_ms, before),
            None => (ON_TRIAL, left_ms, 0),
        },
        None => (0, 0, 0),
    };
    let (fell_back, failed) = health.fell_back.map_or((0, 0), |fell_back| {
        let reason = u32::from(fell_back.reason.number()) << FALL_BACK_SHIFT;
        (HAS_FALLEN_BACK | reason, fell_back.mission)
    });
    [
        mode | params | mission | background | trial | fell_back,
        health.mission.unwrap_or(0),
        health.steps as u32,
        (health.steps >> 32) as u32,
        health.t_us as u32,
        (health.t_us >> 32) as u32,
        health.executed,
        health.missed,
        health.overruns,
        health.max_delay_ns,
        left_ms,
        before,
        failed,
    ]
}

fn unpack(words: &[u32; WORDS]) -> Health {
    let [
        first,
        mission,
        steps,
        steps_high,
        t_us,
        t_us_high,
        executed,
        missed,
        overruns,
        max_delay_ns,
        left_ms,
        before,
        failed,
    ] = *words;
    let wide = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
    Health {
        mode: Mode::from_number(first as u8).unwrap_or(Mode::Safe(SafeReason::Board)),
        mission: (first & HAS_MISSION != 0).then_some(mission),
        steps: wide(steps, steps_high),
        t_us: wide(t_us, t_us_high),
        executed,
        missed,
        overruns,
        max_delay_ns,
        background_busy: first & BACKGROUND_BUSY != 0,
        trial: (first & ON_TRIAL != 0).then_some(Trial {
            left_ms,
            before: (first & TRIAL_HAS_BEFORE != 0).then_some(before),
        }),
        fell_back: (first & HAS_FALLEN_BACK != 0).then_some(FallBack {
            mission: failed,
            reason: FallBackReason::from_number((first >> FALL_BACK_SHIFT) as u8)
                .unwrap_or(FallBackReason::Failed(SafeReason::Board)),
        }),
        changed_params: (first >> CHANGED_PARAMS_SHIFT & PARAMS_MASK) as u8,
        saved_params: (first >> SAVED_PARAMS_SHIFT & PARAMS_MASK) as u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_snapshot_reads_back_as_it_was_written() {
        let modes = [
            Mode::Empty,
            Mode::Running,
            Mode::Stopped,
            Mode::EmergencyStopped,
        ];
        for mode in modes.into_iter().chain(SafeReason::ALL.map(Mode::Safe)) {
            for (mission, background_busy) in
                [(None, true), (Some(0), false), (Some(u32::MAX), true)]
            {
                let before = mission.map(|mission| mission ^ 0x5555);
                let health = Health {
                    mode,
                    mission,
                    steps: 1 << 40 | 7,
                    t_us: 1 << 50 | 9,
                    executed: 1,
                    missed: 2,
                    overruns: 3,
                    max_delay_ns: 4,
                    background_busy,
                    trial: background_busy.then_some(Trial { left_ms: 5, before }),
                    fell_back: mission.map(|mission| FallBack {
                        mission,
                        reason: FallBackReason::Failed(SafeReason::Board),
                    }),
                    changed_params: if background_busy { 8 } else { 0 },
                    saved_params: if background_busy { 3 } else { 8 },
                };
                let mut snapshot = Snapshot::new();
                let (mut writer, reader) = snapshot.split();
                assert_eq!(reader.read(), Some(Health::EMPTY));
                writer.write(&health);
                assert_eq!(reader.read(), Some(health));
            }
        }
    }

    #[test]
    fn a_reader_never_sees_half_a_write() {
        let mut snapshot = Snapshot::new();
        let (mut writer, reader) = snapshot.split();
        let stop = core::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|threads| {
            threads.spawn(|| {
                for number in 0..20_000 {
                    let wide = u64::from(number);
                    writer.write(&Health {
                        steps: wide,
                        t_us: wide,
                        executed: number,
                        missed: number,
                        ..Health::EMPTY
                    });
                }
                stop.store(true, Ordering::Release);
            });
            while !stop.load(Ordering::Acquire) {
                if let Some(health) = reader.read() {
                    assert_eq!(health.steps, health.t_us);
                    assert_eq!(health.executed, health.missed);
                    assert_eq!(health.steps, u64::from(health.executed));
                }
            }
        });
    }
}
