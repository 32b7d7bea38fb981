//! When a robot tells [status events](esm_link::status_event).

use esm_link::message::Mode;
use esm_link::status_event::{Cause, SHORTEST_PERIOD_MS, StatusEvent};
use esm_link::trial::FallBack;

use crate::status::Health;

/// A host's wish for status events, and what it was told last.
#[derive(Debug)]
pub(crate) struct Watch {
    period_us: u64,
    seq: u8,
    told: Option<Told>,
    /// Nominal time of the sample that was told last.
    sampled_us: u64,
}

/// What is told when it changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Told {
    mode: Mode,
    mission: Option<u32>,
    on_trial: bool,
    fell_back: Option<FallBack>,
}

impl Watch {
    /// A wish for samples each `period_ms` of the mission's time, or with 0 for changes alone.
    pub(crate) fn new(period_ms: u32) -> Self {
        let period_ms = match period_ms {
            0 => 0,
            period_ms => period_ms.max(SHORTEST_PERIOD_MS),
        };
        Watch {
            period_us: u64::from(period_ms) * 1_000,
            seq: 0,
            told: None,
            sampled_us: 0,
        }
    }

    /// The status events that there are now, if there are any.
    pub(crate) fn news(&mut self, now: Health, corrupt_frames: u32) -> Option<StatusEvent> {
        let tell = Told {
            mode: now.mode,
            mission: now.mission,
            on_trial: now.trial.is_some(),
            fell_back: now.fell_back,
        };
        let cause = match &self.told {
            None => Cause::Begun,
            Some(told) => self.change(told, &tell, now.t_us)?,
        };
        let seq = self.seq;
        self.seq = seq.wrapping_add(1);
        self.sampled_us = now.t_us;
        self.told = Some(tell);
        Some(StatusEvent {
            seq,
            cause,
            mode: now.mode,
            mission: now.mission,
            on_trial: tell.on_trial,
            fell_back: now.fell_back,
            steps: now.steps,
            t_us: now.t_us,
            executed: now.executed,
            missed: now.missed,
            overruns: now.overruns,
            max_delay_ns: now.max_delay_ns,
            corrupt_frames,
        })
    }

    fn change(&self, told: &Told, now: &Told, t_us: u64) -> Option<Cause> {
        if told.mission != now.mission || told.fell_back != now.fell_back {
            return Some(Cause::Mission);
        }
        if told.on_trial != now.on_trial {
            return Some(Cause::Trial);
        }
        if told.mode != now.mode {
            return Some(Cause::Mode);
        }
        // A mission that began anew begins to count its time anew.
        let passed_us = t_us.checked_sub(self.sampled_us);
        let is_over = passed_us.is_none_or(|passed_us| passed_us >= self.period_us);
        (self.period_us > 0 && is_over).then_some(Cause::Period)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_link::message::SafeReason;
    use esm_link::trial::{FallBackReason, Trial};

    #[test]
    fn what_changes_is_told_once_and_samples_each_period() {
        let empty = Health::EMPTY;
        let runs = |t_us| Health {
            mode: Mode::Running,
            mission: Some(7),
            t_us,
            ..Health::EMPTY
        };
        let on_trial = |t_us| Health {
            trial: Some(Trial {
                left_ms: 5,
                before: None,
            }),
            ..runs(t_us)
        };
        let safe = Health {
            mode: Mode::Safe(SafeReason::DeadlineMiss),
            ..runs(40_000)
        };
        let fell_back = Health {
            fell_back: Some(FallBack {
                mission: 9,
                reason: FallBackReason::Asked,
            }),
            ..runs(0)
        };
        let mut watch = Watch::new(20);
        let steps = [
            (empty, Some(Cause::Begun)),
            (empty, None),
            (on_trial(0), Some(Cause::Mission)),
            (on_trial(10_000), None),
            (on_trial(20_000), Some(Cause::Period)),
            (runs(30_000), Some(Cause::Trial)),
            (runs(40_000), None),
            (safe, Some(Cause::Mode)),
            (runs(40_000), Some(Cause::Mode)),
            (runs(10_000), Some(Cause::Period)),
            (fell_back, Some(Cause::Mission)),
        ];
        let mut seq = 0;
        for (health, expected) in steps {
            let news = watch.news(health, 3);
            assert_eq!(news.map(|news| news.cause), expected, "{health:?}");
            if let Some(news) = news {
                assert_eq!(
                    (news.seq, news.mission, news.corrupt_frames),
                    (seq, health.mission, 3)
                );
                seq += 1;
            }
        }
    }

    #[test]
    fn a_period_of_none_is_for_changes_alone_and_a_short_one_becomes_longer() {
        let at = |t_us| Health {
            t_us,
            ..Health::EMPTY
        };
        for (period_ms, after_us, expected) in [
            (0, u64::MAX, None),
            (1, 9_999, None),
            (1, 10_000, Some(Cause::Period)),
            (u32::MAX, u64::MAX, Some(Cause::Period)),
        ] {
            let mut watch = Watch::new(period_ms);
            assert!(watch.news(at(0), 0).is_some());
            let news = watch.news(at(after_us), 0).map(|news| news.cause);
            assert_eq!(news, expected, "{period_ms} ms, after {after_us} us");
        }
    }
}
