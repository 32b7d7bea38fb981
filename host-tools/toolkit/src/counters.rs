//! What a robot counts of a slot and of a link, in the form in which commands show it.

use std::fmt;

use esm_link::message::{DELAY_BUCKETS, FrameCounters, SlotCounters};
use serde::Serialize;

/// What was counted of a slot since the mission started. Times in nanoseconds; 0 where nothing was
/// measured yet.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SlotReport {
    /// Its number in the source.
    pub slot: u32,
    /// Executions that ended while the mission ran.
    pub executed: u32,
    /// Activations that did not start within their period.
    pub missed: u32,
    /// Executions that took longer than the slot; stays at 65,535.
    pub overruns: u32,
    /// Sum of all executions.
    pub total_execution_ns: u64,
    /// Shortest execution.
    pub shortest_execution_ns: u32,
    /// Mean execution, rounded down.
    pub mean_execution_ns: u64,
    /// Longest execution.
    pub longest_execution_ns: u32,
    /// Shortest start delay.
    pub shortest_delay_ns: u32,
    /// Longest start delay.
    pub longest_delay_ns: u32,
    /// Executions by their start delay.
    pub delays: Vec<DelayBucket>,
}

/// Executions with a start delay in some range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DelayBucket {
    /// Their delays are shorter than this, in nanoseconds, and no shorter than the end of the
    /// bucket before; `None` for the last bucket.
    pub below_ns: Option<u64>,
    /// How many.
    pub count: u32,
    /// Whether there are so many, and not more: of several buckets with 65,535 or more the robot
    /// keeps no number.
    pub exact: bool,
}

impl From<SlotCounters> for SlotReport {
    fn from(counters: SlotCounters) -> Self {
        SlotReport {
            slot: counters.number,
            executed: counters.executed,
            missed: counters.missed,
            overruns: counters.overruns,
            total_execution_ns: counters.total_execution_ns,
            shortest_execution_ns: counters.min_execution_ns,
            mean_execution_ns: counters.mean_execution_ns(),
            longest_execution_ns: counters.max_execution_ns,
            shortest_delay_ns: counters.min_delay_ns,
            longest_delay_ns: counters.max_delay_ns,
            delays: (0..DELAY_BUCKETS)
                .zip(counters.delay_counts())
                .map(|(bucket, (count, exact))| DelayBucket {
                    below_ns: counters.bucket_end_ns(bucket),
                    count,
                    exact,
                })
                .collect(),
        }
    }
}

/// What was counted of a link since the mission started.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkReport {
    /// Its name.
    pub link: String,
    /// Whatever came with a wrong checksum, length or configuration, or with an identifier that no
    /// frame has.
    pub errors: u32,
    /// Whatever came while no state received.
    pub dropped: u32,
    /// Its frames: those that are sent, then those that are received.
    pub frames: Vec<FrameReport>,
}

/// What was counted of a frame since the mission started.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameReport {
    /// Its name.
    pub frame: String,
    /// Its identifier.
    pub id: u16,
    /// `out` or `in`.
    pub direction: &'static str,
    /// How many were sent, or came.
    pub passed: u32,
    /// Sent: how many the device had no room for. Received: how many were left out, by their
    /// numbers.
    pub missing: u32,
    /// Received: how many came twice, and were dropped.
    pub repeated: u32,
    /// Received: how many a newer one overtook before a task could see them.
    pub older: u32,
}

impl LinkReport {
    /// What a person reads: a title and counts, of the link and then of each of its frames.
    pub fn rows(&self) -> impl Iterator<Item = (String, String)> {
        let of_link = (format!("link {}", self.link), self.to_string());
        let of_frame = |frame: &FrameReport| {
            let title = format!("  {} {} {}", frame.direction, frame.id, frame.frame);
            (title, frame.to_string())
        };
        std::iter::once(of_link).chain(self.frames.iter().map(of_frame))
    }
}

impl FrameReport {
    /// A frame of which nothing was counted.
    pub fn new(frame: String, id: u16, direction: &'static str) -> Self {
        FrameReport {
            frame,
            id,
            direction,
            ..FrameReport::default()
        }
    }

    /// Takes what a robot has counted of it.
    pub fn count(&mut self, counters: FrameCounters) {
        self.passed = counters.passed;
        self.missing = counters.missing;
        self.repeated = counters.repeated;
        self.older = counters.older;
    }
}

/// The counts as a person reads them.
impl fmt::Display for FrameReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.direction {
            "out" => write!(f, "{} sent, {} without room", self.passed, self.missing),
            _ => write!(
                f,
                "{} came, {} missing, {} came twice, {} overtaken",
                self.passed, self.missing, self.repeated, self.older
            ),
        }
    }
}

/// The counts of the link itself as a person reads them.
impl fmt::Display for LinkReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} errors, {} dropped while no state received",
            self.errors, self.dropped
        )
    }
}

impl DelayBucket {
    /// The number as a person reads it, `≥` before it where there may be more.
    pub fn words(&self) -> String {
        let more = if self.exact { "" } else { "≥" };
        format!("{more}{}", self.count)
    }
}

/// A line of counters.
impl fmt::Display for SlotReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} executed, {} missed, {} overruns",
            self.executed, self.missed, self.overruns
        )?;
        if self.executed > 0 && !self.is_timed() {
            return f.write_str("; no times, the clock of this board stands still in a slot");
        }
        if self.executed > 0 {
            write!(
                f,
                "; lasts {} to {}, {} on average",
                Ns(self.shortest_execution_ns.into()),
                Ns(self.longest_execution_ns.into()),
                Ns(self.mean_execution_ns)
            )?;
            write!(
                f,
                "; starts {} to {} late",
                Ns(self.shortest_delay_ns.into()),
                Ns(self.longest_delay_ns.into())
            )?;
        }
        Ok(())
    }
}

impl SlotReport {
    /// Whether its times say anything: on the board `host` time stands still while an activation is
    /// executed.
    pub fn is_timed(&self) -> bool {
        self.longest_execution_ns > 0 || self.longest_delay_ns > 0
    }

    /// The buckets that are not empty, in words: `1.28 us: 1200` are those below, `more: 3` those
    /// beyond all ends.
    pub fn delays_in_words(&self) -> String {
        let words = self.delays.iter().filter(|bucket| bucket.count > 0);
        let words = words.map(|bucket| match bucket.below_ns {
            Some(end) => format!("<{}: {}", Ns(end), bucket.words()),
            None => format!("more: {}", bucket.words()),
        });
        words.collect::<Vec<_>>().join(", ")
    }
}

/// A time in nanoseconds, shown in the unit that suits it, with three digits: `320 ns`, `1.28 us`,
/// `20.5 us`, `1.31 ms`, `12.0 s`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ns(pub u64);

impl fmt::Display for Ns {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const UNITS: [(u64, &str); 4] = [
            (1_000_000_000, "s"),
            (1_000_000, "ms"),
            (1_000, "us"),
            (1, "ns"),
        ];
        // The digits of a unit end at 999; what would round up to 1000 belongs to the next.
        let (unit_ns, unit) = UNITS
            .into_iter()
            .find(|(unit_ns, _)| self.0.saturating_mul(10_000) >= unit_ns.saturating_mul(9_995))
            .unwrap_or((1, "ns"));
        let value = self.0 as f64 / unit_ns as f64;
        let digits = match value {
            _ if unit_ns == 1 => 0,
            value if value < 9.995 => 2,
            value if value < 99.95 => 1,
            _ => 0,
        };
        f.pad(&format!("{value:.digits$} {unit}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_has_three_digits_and_the_unit_that_suits_it() {
        for (ns, expected) in [
            (0, "0 ns"),
            (320, "320 ns"),
            (999, "999 ns"),
            (1_000, "1.00 us"),
            (1_284, "1.28 us"),
            (9_996, "10.0 us"),
            (99_960, "100 us"),
            (999_400, "999 us"),
            (999_600, "1.00 ms"),
            (20_480_000, "20.5 ms"),
            (12_000_000_000, "12.0 s"),
            (u64::MAX, "18446744074 s"),
        ] {
            assert_eq!(Ns(ns).to_string(), expected, "{ns} ns");
        }
        assert_eq!(format!("[{:>9}]", Ns(320)), "[   320 ns]");
    }

    #[test]
    fn a_slot_is_told_in_a_line_and_its_delays_in_another() {
        let counters = SlotCounters {
            number: 3,
            missed: 1,
            overruns: 2,
            executed: 4,
            total_execution_ns: 441_000,
            min_execution_ns: 90_000,
            max_execution_ns: 150_000,
            min_delay_ns: 1_000,
            max_delay_ns: 90_000_000,
            first_bucket_ns: 16_000,
            delays: [1, 0, 1, 0, 0, 0, 0, 2],
        };
        let report = SlotReport::from(counters);
        assert_eq!(
            report.to_string(),
            "4 executed, 1 missed, 2 overruns; lasts 90.0 us to 150 us, 110 us on average; starts 1.00 us to 90.0 ms late"
        );
        assert_eq!(report.delays_in_words(), "<16.0 us: 1, <256 us: 1, more: 2");
        let long_run = SlotReport::from(SlotCounters {
            executed: 1_000_000,
            delays: [u16::MAX, 3, u16::MAX, 0, 0, 0, 0, 0],
            ..counters
        });
        assert_eq!(
            long_run.delays_in_words(),
            "<16.0 us: ≥65535, <64.0 us: 3, <256 us: ≥65535"
        );
        let without_times = SlotReport::from(SlotCounters {
            executed: 7,
            ..SlotCounters::default()
        });
        assert_eq!(
            without_times.to_string(),
            "7 executed, 0 missed, 0 overruns; no times, the clock of this board stands still in a slot"
        );
        let nothing = SlotReport::from(SlotCounters::default());
        assert_eq!(nothing.to_string(), "0 executed, 0 missed, 0 overruns");
        assert_eq!(nothing.delays_in_words(), "");
    }
}
