//! What a person sees of a robot: figures worked out from one reading after another, the slot they
//! look at, and what their keys do.

use std::collections::VecDeque;
use std::time::Duration;

use crate::counters::{DelayBucket, SlotReport};
use crate::link_client::RobotInfo;
use crate::reading::{Reading, SlotPlan, SlotReading, TaskReading};

/// Readings that rates and loads are worked out over. Time on the robot is told in whole periods of
/// the interpreter, so that two readings in a row would make them jump.
pub const WINDOW: usize = 10;

const NS_PER_US: f64 = 1e3;
const US_PER_S: f64 = 1e6;

/// A slot in figures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlotRow {
    /// When it runs.
    pub plan: SlotPlan,
    /// What was counted: since the mission started, or, but for what is shortest and longest, since
    /// the person set the view back.
    pub counted: SlotReport,
    /// Executions a second lately; `None` where robot time stands still.
    pub rate_hz: Option<f64>,
}

impl SlotRow {
    /// What the mean execution takes of the slot's duration.
    pub fn mean_share(&self) -> f64 {
        share(self.counted.mean_execution_ns as f64, &self.plan)
    }

    /// What the longest execution took of the slot's duration.
    pub fn longest_share(&self) -> f64 {
        share(f64::from(self.counted.longest_execution_ns), &self.plan)
    }
}

fn share(execution_ns: f64, plan: &SlotPlan) -> f64 {
    execution_ns / (f64::from(plan.duration_us.max(1)) * NS_PER_US)
}

/// How much of the processor's time real-time slots take.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Load {
    /// The measured executions; `None` where robot time stands still.
    pub used: Option<f64>,
    /// What they may take: the durations of all slots.
    pub reserved: f64,
}

impl Load {
    /// The load of all slots, between two readings of the same mission, or from its start where
    /// there is one reading.
    pub fn between(before: Option<&Reading>, now: &Reading) -> Self {
        let reserved = now
            .slots
            .iter()
            .map(|slot| f64::from(slot.plan.duration_us) / f64::from(slot.plan.period_us.max(1)))
            .sum();
        let used = (0..now.slots.len()).map(|slot| {
            let total_ns = |slot: &SlotReading| slot.counted.total_execution_ns as f64;
            per_us(before, now, slot, total_ns).map(|ns| ns / NS_PER_US)
        });
        Load {
            used: used.sum(),
            reserved,
        }
    }

    /// What is left for slot 0.
    pub fn left(&self) -> Option<f64> {
        self.used.map(|used| (1.0 - used).max(0.0))
    }
}

/// Executions of the slot with this index a second, between two readings of the same mission, or
/// from its start.
pub fn rate_hz(before: Option<&Reading>, now: &Reading, slot: usize) -> Option<f64> {
    let executed = |slot: &SlotReading| f64::from(slot.counted.executed);
    per_us(before, now, slot, executed).map(|rate| rate * US_PER_S)
}

/// By how much a counter of a slot grew in a microsecond of robot time; `None` where that stands
/// still.
fn per_us(
    before: Option<&Reading>,
    now: &Reading,
    slot: usize,
    counter: impl Fn(&SlotReading) -> f64,
) -> Option<f64> {
    let now = now.slots.get(slot)?;
    let before = before.and_then(|before| before.slots.get(slot));
    let elapsed_us = now
        .t_us
        .checked_sub(before.map_or(0, |before| before.t_us))?;
    let grown = counter(now) - before.map_or(0.0, counter);
    (elapsed_us > 0).then(|| grown / elapsed_us as f64)
}

/// A net of the mission.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetRow {
    /// What it goes by.
    pub name: String,
    /// What was on it last, in words.
    pub value: Option<String>,
}

/// A key, as far as it means something here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// To the slot before.
    Up,
    /// To the next slot.
    Down,
    /// To the first slot.
    First,
    /// To the last slot.
    Last,
    /// Count from now on.
    Reset,
    /// Stand still, or go on.
    Pause,
}

/// What a person sees.
pub struct View {
    robot: RobotInfo,
    /// The last readings of one run of one mission, the newest last.
    readings: VecDeque<Reading>,
    /// The nets of the mission, and what was on them last.
    nets: Vec<NetRow>,
    /// Where the person set the view back.
    baseline: Option<Reading>,
    selected: usize,
    paused: bool,
    /// Why nothing comes from the robot, and since when, on the clock of whoever calls.
    lost: Option<(String, Duration)>,
    /// Time on that clock.
    now: Duration,
}

impl View {
    /// The view of a robot that says this of itself, before the first reading.
    pub fn new(robot: RobotInfo) -> Self {
        View {
            robot,
            readings: VecDeque::new(),
            nets: Vec::new(),
            baseline: None,
            selected: 0,
            paused: false,
            lost: None,
            now: Duration::ZERO,
        }
    }

    /// It is so late, on any clock that only goes forward.
    pub fn set_time(&mut self, now: Duration) {
        self.now = now;
    }

    /// The robot was found, for the first time or again.
    pub fn found(&mut self, robot: RobotInfo) {
        self.robot = robot;
        self.lost = None;
    }

    /// The robot does not answer.
    pub fn lost(&mut self, why: String) {
        let since = self.lost.take().map_or(self.now, |(_, since)| since);
        self.lost = Some((why, since));
    }

    /// A reading has come.
    pub fn take(&mut self, reading: Reading) {
        self.lost = None;
        if self.paused {
            return;
        }
        let goes_on = self
            .readings
            .back()
            .is_none_or(|last| is_same_run(last, &reading));
        if !goes_on {
            // Another mission, or the same from its beginning: nothing that was counted before
            // belongs to it.
            self.readings.clear();
            self.baseline = None;
        }
        if self.readings.len() == WINDOW {
            self.readings.pop_front();
        }
        self.selected = self.selected.min(reading.slots.len().saturating_sub(1));
        self.readings.push_back(reading);
    }

    /// What is on the nets of the mission of the reading that came last.
    pub fn take_nets(&mut self, nets: Vec<NetRow>) {
        if !self.paused {
            self.nets = nets;
        }
    }

    /// The nets of the mission, as far as the robot tells of them.
    pub fn nets(&self) -> &[NetRow] {
        &self.nets
    }

    /// The person pressed a key.
    pub fn press(&mut self, key: Key) {
        let last = self.reading().map_or(0, |reading| reading.slots.len());
        let last = last.saturating_sub(1);
        match key {
            Key::Up => self.selected = self.selected.saturating_sub(1),
            Key::Down => self.selected = (self.selected + 1).min(last),
            Key::First => self.selected = 0,
            Key::Last => self.selected = last,
            Key::Reset => self.baseline = self.reading().cloned(),
            Key::Pause => self.paused = !self.paused,
        }
    }

    /// The newest reading.
    pub fn reading(&self) -> Option<&Reading> {
        self.readings.back()
    }

    /// What the robot says of itself.
    pub fn robot(&self) -> &RobotInfo {
        &self.robot
    }

    /// Index of the slot that the person looks at.
    pub fn selected(&self) -> usize {
        self.selected
    }

    /// Whether the view stands still.
    pub fn is_paused(&self) -> bool {
        self.paused
    }

    /// Why nothing comes from the robot, and for how long.
    pub fn trouble(&self) -> Option<(&str, Duration)> {
        let (why, since) = self.lost.as_ref()?;
        Some((why, self.now.saturating_sub(*since)))
    }

    /// Robot time from which counters count, in microseconds since the mission started.
    pub fn counted_from_us(&self) -> Option<u64> {
        self.baseline.as_ref().map(|baseline| baseline.status.t_us)
    }

    /// The slots in figures.
    pub fn rows(&self) -> Vec<SlotRow> {
        let Some(now) = self.reading() else {
            return Vec::new();
        };
        let before = self.before();
        let baseline = self.baseline.as_ref();
        now.slots
            .iter()
            .enumerate()
            .map(|(index, slot)| SlotRow {
                plan: slot.plan,
                counted: match baseline.and_then(|baseline| baseline.slots.get(index)) {
                    Some(before) => difference(slot, before),
                    None => slot.counted.clone(),
                },
                rate_hz: rate_hz(before, now, index),
            })
            .collect()
    }

    /// How much of the time slots take lately.
    pub fn load(&self) -> Load {
        self.reading()
            .map_or_else(Load::default, |now| Load::between(self.before(), now))
    }

    /// The task states of the slot that the person looks at.
    pub fn tasks(&self) -> impl Iterator<Item = &TaskReading> {
        let selected = Some(self.selected);
        self.reading()
            .into_iter()
            .flat_map(|reading| &reading.tasks)
            .filter(move |task| task.plan.slot == selected)
    }

    /// The oldest reading of the window, if that is not the newest.
    fn before(&self) -> Option<&Reading> {
        self.readings.front().filter(|_| self.readings.len() > 1)
    }
}

/// Whether one reading follows another in the same run of the same mission.
fn is_same_run(before: &Reading, now: &Reading) -> bool {
    let counts_on = before.slots.len() == now.slots.len()
        && before
            .slots
            .iter()
            .zip(&now.slots)
            .all(|(before, now)| before.counted.executed <= now.counted.executed);
    before.status.mission == now.status.mission
        && before.status.t_us <= now.status.t_us
        && counts_on
}

/// What was counted from one reading of a slot to another. What is shortest and longest stays as it
/// is: of a span nobody knows it.
fn difference(now: &SlotReading, before: &SlotReading) -> SlotReport {
    let (now, before) = (&now.counted, &before.counted);
    let executed = now.executed.saturating_sub(before.executed);
    let total_execution_ns = now
        .total_execution_ns
        .saturating_sub(before.total_execution_ns);
    SlotReport {
        missed: now.missed.saturating_sub(before.missed),
        overruns: now.overruns.saturating_sub(before.overruns),
        executed,
        total_execution_ns,
        mean_execution_ns: total_execution_ns.checked_div(executed.into()).unwrap_or(0),
        delays: now
            .delays
            .iter()
            .zip(&before.delays)
            .map(|(now, before)| DelayBucket {
                count: now.count.saturating_sub(before.count),
                below_ns: now.below_ns,
                exact: now.exact && before.exact,
            })
            .collect(),
        ..now.clone()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use esm_link::message::{Capacities, ResetReason, SlotCounters, Status, TaskCounters, Uploads};

    use crate::reading::{LineReport, TaskPlan};
    use esm_client::samples::status;

    pub fn robot() -> RobotInfo {
        RobotInfo {
            firmware: "rover 0.1.0".to_owned(),
            board: "lm3s6965".to_owned(),
            task_types: 14,
            capacities: Capacities {
                blob_bytes: 3_328,
                arena_words: 128,
                slots: 16,
                task_instances: 24,
                nets: 24,
                exclusive_groups: 4,
            },
            mission: Some(0x1234_abcd),
            access: esm_link::access::Access::Open,
            reset: ResetReason::PowerOn,
            uploads: Uploads {
                chunk_bytes: 176,
                window_bytes: 528,
            },
        }
    }

    /// What a robot says of itself whose numbers are all this, as far as they go so high.
    pub fn reading_of(number: u64) -> Reading {
        let most = u32::try_from(number).unwrap_or(u32::MAX);
        let small = u16::try_from(number).unwrap_or(u16::MAX);
        let mut reading = reading(1);
        let status = &mut reading.status;
        (status.steps, status.t_us) = (number, number);
        (status.executed, status.missed, status.overruns) = (most, most, most);
        (
            status.max_delay_ns,
            status.trace_dropped,
            status.record_dropped,
        ) = (most, most, most);
        status.stack_bytes = Some(most);
        for slot in &mut reading.slots {
            slot.t_us = number;
            slot.plan = SlotPlan {
                number: most,
                period_us: most,
                duration_us: most,
                start_us: most,
            };
            slot.counted = SlotReport::from(SlotCounters {
                number: most,
                executed: most,
                missed: most,
                overruns: most,
                total_execution_ns: number,
                min_execution_ns: most,
                max_execution_ns: most,
                min_delay_ns: most,
                max_delay_ns: most,
                first_bucket_ns: most,
                delays: [small; _],
            });
        }
        for task in &mut reading.tasks {
            task.counted = Some(TaskCounters {
                enabled: true,
                busy: true,
                overruns: small,
            });
        }
        reading.line = LineReport {
            requests_sent_again: number,
            frames_spoiled: number,
            bytes_sent: number,
        };
        reading
    }

    /// A robot with two slots that has run for so many periods of 20 ms, all of them alike.
    pub fn reading(periods: u32) -> Reading {
        let rare = (periods / 50) as u16;
        let common = periods as u16 - rare;
        let slot = |number, start_us, execution_ns: u32, delay_ns| {
            let counters = SlotCounters {
                number,
                missed: 0,
                overruns: periods / 100,
                executed: periods,
                total_execution_ns: u64::from(periods) * u64::from(execution_ns),
                min_execution_ns: execution_ns / 2,
                max_execution_ns: execution_ns * 2,
                min_delay_ns: delay_ns,
                max_delay_ns: delay_ns * 30,
                first_bucket_ns: 320,
                delays: [0, 0, common, 0, rare, 0, 0, 0],
            };
            SlotReading {
                plan: SlotPlan {
                    number,
                    period_us: 20_000,
                    duration_us: 2_000 * number,
                    start_us,
                },
                counted: counters.into(),
                t_us: u64::from(periods) * 20_000,
            }
        };
        let task = |path: &str, task: &str, slot, overruns| TaskReading {
            plan: TaskPlan {
                path: path.to_owned(),
                task: task.to_owned(),
                slot,
            },
            counted: Some(TaskCounters {
                enabled: overruns == 0,
                busy: false,
                overruns,
            }),
        };
        Reading {
            status: Status {
                t_us: u64::from(periods) * 20_000,
                executed: 2 * periods,
                overruns: 2 * (periods / 100),
                max_delay_ns: 93_000,
                background_busy: true,
                stack_bytes: Some(2_640),
                ..status(Some(0x1234_abcd), periods.into())
            },
            robot_us: u64::from(periods) * 20_000 + 300_000,
            machine: Some("Patrol".to_owned()),
            active: ["motion/Ahead", "sonars/Listen", "diary/Write"]
                .map(str::to_owned)
                .into(),
            finished: false,
            links: Vec::new(),
            slots: vec![slot(1, 0, 400_000, 1_900), slot(2, 2_000, 3_000_000, 3_100)],
            tasks: vec![
                task("motion/Ahead", "Cruise", Some(0), 0),
                task("motion/Avoid/Turn", "Turn", Some(0), 3),
                task("sonars/Listen", "SonarRing", Some(1), 0),
                task("diary/Write", "Logger", None, 0),
            ],
            line: LineReport {
                requests_sent_again: 2,
                frames_spoiled: 1,
                bytes_sent: 12_345,
            },
        }
    }

    pub fn view_of(periods: &[u32]) -> View {
        let mut view = View::new(robot());
        for &periods in periods {
            view.take(reading(periods));
        }
        view
    }

    #[test]
    fn rates_and_load_are_those_of_the_last_readings() {
        let view = view_of(&[50, 100, 150]);
        let rows = view.rows();
        assert_eq!(rows[0].rate_hz, Some(50.0));
        assert_eq!(rows[0].counted.executed, 150);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(rows[0].mean_share(), 0.2));
        assert!(close(rows[0].longest_share(), 0.4));
        let load = view.load();
        assert!(close(load.reserved, 0.3), "{load:?}");
        assert!(close(load.used.unwrap(), 0.17), "{load:?}");
        assert!(close(load.left().unwrap(), 0.83), "{load:?}");
        // One reading tells of the time since the mission started.
        assert_eq!(view_of(&[50]).rows()[1].rate_hz, Some(50.0));
    }

    #[test]
    fn where_robot_time_stands_still_there_are_no_rates() {
        let view = view_of(&[100, 100]);
        assert_eq!(view.rows()[0].rate_hz, None);
        assert_eq!(view.load().used, None);
        assert_eq!(view.load().left(), None);
    }

    #[test]
    fn the_window_holds_the_last_readings() {
        let mut view = view_of(&[]);
        for step in 0..30 {
            view.take(reading(50 + step));
        }
        assert_eq!(view.readings.len(), WINDOW);
        assert_eq!(view.rows()[0].rate_hz, Some(50.0));
    }

    #[test]
    fn counters_count_from_where_the_person_set_them_back() {
        let mut view = view_of(&[100, 200]);
        view.press(Key::Reset);
        view.take(reading(300));
        assert_eq!(view.counted_from_us(), Some(4_000_000));
        let counted = &view.rows()[0].counted;
        assert_eq!((counted.executed, counted.overruns), (100, 1));
        assert_eq!(counted.mean_execution_ns, 400_000);
        assert_eq!(counted.longest_execution_ns, 800_000);
        let counts: Vec<u32> = counted.delays.iter().map(|bucket| bucket.count).collect();
        assert_eq!(counts, [0, 0, 98, 0, 2, 0, 0, 0]);
    }

    #[test]
    fn a_mission_that_starts_anew_is_counted_anew() {
        let mut other = reading(500);
        other.status.mission = Some(7);
        for next in [reading(50), other] {
            let mut view = view_of(&[200, 300]);
            view.press(Key::Reset);
            let executed = next.slots[0].counted.executed;
            view.take(next);
            assert_eq!(view.counted_from_us(), None);
            assert_eq!(view.readings.len(), 1);
            assert_eq!(view.rows()[0].counted.executed, executed);
        }
    }

    #[test]
    fn a_view_that_stands_still_takes_no_readings() {
        let mut view = view_of(&[100]);
        view.press(Key::Pause);
        view.take(reading(200));
        assert!(view.is_paused());
        assert_eq!(view.rows()[0].counted.executed, 100);
        view.press(Key::Pause);
        view.take(reading(300));
        assert_eq!(view.rows()[0].counted.executed, 300);
    }

    #[test]
    fn the_slot_that_is_looked_at_is_always_one_of_the_mission() {
        let mut view = view_of(&[]);
        for key in [Key::Down, Key::Last, Key::Up] {
            view.press(key);
            assert_eq!(view.selected(), 0, "{key:?} before the first reading");
        }
        view.take(reading(100));
        for (key, selected) in [
            (Key::Up, 0),
            (Key::Down, 1),
            (Key::Down, 1),
            (Key::First, 0),
            (Key::Last, 1),
        ] {
            view.press(key);
            assert_eq!(view.selected(), selected, "{key:?}");
        }
        assert_eq!(view.tasks().count(), 1);
        // Another mission has no slots at all.
        view.take(Reading::without_mission(reading(1).status, 0));
        assert_eq!(view.selected(), 0);
        assert_eq!(view.tasks().count(), 0);
    }

    #[test]
    fn a_robot_that_is_lost_is_told_until_it_is_found() {
        let mut view = view_of(&[100]);
        view.set_time(Duration::from_secs(5));
        view.lost("no answer".to_owned());
        view.set_time(Duration::from_secs(9));
        view.lost("no port".to_owned());
        assert_eq!(view.trouble(), Some(("no port", Duration::from_secs(4))));
        assert_eq!(view.rows().len(), 2, "what was known stays");
        view.found(robot());
        assert_eq!(view.trouble(), None);
    }
}
