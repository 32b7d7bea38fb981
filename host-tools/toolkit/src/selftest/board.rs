//! What a board does by itself: its clock, its slots, its line, its flash and its stack.

use esm_link::message::{FlashHealth, KeyValuesState};

use super::finding::Finding;
use crate::counters::SlotReport;

/// How much faster or slower than the host's a robot's clock may be, in millionths. Crystals are
/// within 50, and the host's own is, too; what is beyond this is no crystal, or has wrong
/// capacitors.
const CLOCK_LIMIT_PPM: f64 = 500.0;

/// How late a slot may start once, in microseconds: half the shortest period of the selftest. The
/// first activation behind a start waits until the mission was made ready.
const LATE_LIMIT_US: f64 = 1_000.0;

/// How far apart nearly all starts may be, in microseconds, and which part of them that is: those
/// that wait for a command of the link are left out.
const SPREAD_LIMIT_US: f64 = 50.0;
const NEARLY_ALL: f64 = 0.99;

/// Part of the frames that may be lost or corrupt: a good line loses none, and one in a thousand is
/// left to a cable that was touched.
const BAD_FRAMES_LIMIT: f64 = 0.001;

/// How long a critical section may last, in microseconds: a byte of a line of 115,200 baud lasts
/// 87, and a UART without a FIFO loses the next if nobody takes it meanwhile.
const SECTION_LIMIT_US: f64 = 80.0;

/// How often a place of a flash may be erased, by the data sheets of small flashes; there are two
/// places for each thing.
const ERASES_LIMIT: u32 = 10_000;
const PLACES: u32 = 2;

/// Part of the stack that is to stay free.
const STACK_FREE_PART: f64 = 0.05;

/// A look at a robot's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockLook {
    /// When it was asked, by the host's clock, in seconds.
    pub asked_s: f64,
    /// How long the answer took, in seconds.
    pub took_s: f64,
    /// What it said, in seconds.
    pub said_s: f64,
}

impl ClockLook {
    /// When it was looked, most probably.
    fn at_s(&self) -> f64 {
        self.asked_s + self.took_s / 2.0
    }

    /// The one of some whose answer came soonest: it says best when it was looked.
    fn best(looks: &[Self]) -> Option<&Self> {
        (looks.iter()).min_by(|a, b| a.took_s.total_cmp(&b.took_s))
    }
}

/// How fast the robot's clock is against the host's, by looks at it at the beginning and at the end
/// of some time. `coarse_s` is how exactly the host knows when something came.
pub fn clock(begin: &[ClockLook], end: &[ClockLook], coarse_s: f64) -> Finding {
    const NAME: &str = "clock";
    let limit = format!("within {CLOCK_LIMIT_PPM} ppm of the host's clock");
    let pair = ClockLook::best(begin).zip(ClockLook::best(end));
    let Some((begin, end)) = pair.filter(|(begin, end)| end.at_s() > begin.at_s()) else {
        return Finding::not_measured(NAME, "the robot did not say its clock: try again");
    };
    let passed_s = end.at_s() - begin.at_s();
    // What is not known: where within the way there and back it looked.
    let way_s = (begin.took_s - end.took_s).abs() / 2.0 + coarse_s;
    let unsure_ppm = way_s / passed_s * 1e6;
    if unsure_ppm > CLOCK_LIMIT_PPM {
        return Finding::not_measured(
            NAME,
            format!(
                "the line's answers take too unequally long: the clock is known to {unsure_ppm:.0} ppm only"
            ),
        );
    }
    let ppm = ((end.said_s - begin.said_s) / passed_s - 1.0) * 1e6;
    let which = if ppm < 0.0 { "slow" } else { "fast" };
    Finding::judged(
        NAME,
        (libm::round(ppm), "ppm"),
        limit,
        ppm.abs() <= CLOCK_LIMIT_PPM,
        format!(
            "the robot's clock is {which}: look at the crystal and its capacitors, and at the clock settings of the board"
        ),
    )
}

/// How late slots start, and how far apart that is, by what was counted of them.
pub fn slots(slots: &[SlotReport], wanted: u32) -> Vec<Finding> {
    let executed: u32 = slots.iter().map(|slot| slot.executed).sum();
    let lost: u32 = slots.iter().map(|slot| slot.missed + slot.overruns).sum();
    let mut findings = vec![
        Finding::judged(
            "slots.activations",
            (executed.into(), ""),
            format!("at least {wanted}"),
            executed >= wanted,
            "the robot executes fewer activations than it should: `esm status` says why",
        ),
        Finding::judged(
            "slots.missed",
            (lost.into(), ""),
            "none missed or too long",
            lost == 0,
            "slots are missed: something masks the slot timer, or the board is slower than its settings say",
        ),
    ];
    const LATE: [&str; 2] = ["slots.late", "slots.spread"];
    if !slots.iter().any(SlotReport::is_timed) {
        let why = "not measured by this board: its clock stands still in a slot";
        findings.extend(LATE.map(|name| Finding::not_measured(name, why)));
        return findings;
    }
    let longest_ns = slots.iter().map(|slot| slot.longest_delay_ns).max();
    let late_us = f64::from(longest_ns.unwrap_or(0)) / 1e3;
    let spread_us = slots.iter().map(spread_us).fold(0.0, f64::max);
    let advice = "slots start late: something masks the slot timer for that long, such as a critical section or an erase of the flash that the code runs from";
    for (name, measured_us, limit_us, of) in [
        (
            LATE[0],
            late_us,
            LATE_LIMIT_US,
            "each start is late by at most",
        ),
        (
            LATE[1],
            spread_us,
            SPREAD_LIMIT_US,
            "99 starts of 100 are within",
        ),
    ] {
        findings.push(Finding::judged(
            name,
            (measured_us, "µs"),
            format!("{of} {limit_us} µs"),
            measured_us <= limit_us,
            advice,
        ));
    }
    findings
}

/// From the earliest start to the end of the bucket in which nearly all of a slot's starts are.
fn spread_us(slot: &SlotReport) -> f64 {
    let all: u32 = slot.delays.iter().map(|bucket| bucket.count).sum();
    let mut within = 0;
    for bucket in &slot.delays {
        within += bucket.count;
        if f64::from(within) >= f64::from(all) * NEARLY_ALL {
            let longest_ns = u64::from(slot.longest_delay_ns);
            let end_ns = bucket
                .below_ns
                .map_or(longest_ns, |end_ns| end_ns.min(longest_ns));
            return end_ns.saturating_sub(slot.shortest_delay_ns.into()) as f64 / 1e3;
        }
    }
    0.0
}

/// What became of frames on the line, at this rate; `None` where it has none.
pub fn line(frames: u64, bad: u64, baud: Option<u32>) -> Finding {
    let part = bad as f64 / frames.max(1) as f64;
    let at = match baud {
        Some(baud) => format!("of {frames} frames, at {baud} baud"),
        None => format!("of {frames} frames; this line has no baud rate"),
    };
    Finding::judged(
        "line.bad_frames",
        (part, ""),
        format!("at most {BAD_FRAMES_LIMIT} {at}"),
        part <= BAD_FRAMES_LIMIT,
        "the line loses or spoils bytes: look at cable, plugs and ground, or give both ends a lower rate",
    )
}

/// What became of frames at another rate of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RateTried {
    /// In baud.
    pub baud: u32,
    /// Frames that were sent, in both directions.
    pub frames: u64,
    /// Those that were lost or corrupt.
    pub bad: u64,
}

/// What is found of other rates than `own`. A line that is no good for a faster one is no fault:
/// nobody uses that. One that is no good for a slower one is.
pub fn other_rates(own: u32, tried: &[RateTried]) -> Vec<Finding> {
    let finding = |rate: &RateTried| {
        let part = rate.bad as f64 / rate.frames.max(1) as f64;
        let is_good = part <= BAD_FRAMES_LIMIT;
        let finding = Finding::judged(
            format!("line.bad_frames.{}", rate.baud),
            (part, ""),
            format!("at most {BAD_FRAMES_LIMIT} of {} frames", rate.frames),
            is_good,
            "the line is bad at a lower rate than its own: look at cable, plugs and ground",
        );
        if is_good || rate.baud < own {
            return finding;
        }
        Finding {
            pass: None,
            advice: Some(format!(
                "no fault: the line is no good for this rate; its own is {own} baud"
            )),
            ..finding
        }
    };
    tried.iter().map(finding).collect()
}

/// How long the longest critical section was, in microseconds.
pub fn critical_section(longest_us: f64) -> Finding {
    Finding::judged(
        "critical_section",
        (longest_us, "µs"),
        format!("at most {SECTION_LIMIT_US} µs"),
        longest_us <= SECTION_LIMIT_US,
        "something holds up the line's interrupt for longer than a byte lasts: look for critical sections with loops in them",
    )
}

/// Whether the flash took what it was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kept {
    /// It did.
    Yes,
    /// It did not.
    No,
    /// It was not tried.
    NotTried(&'static str),
}

/// What is found of the flash: missions, and records, of which one was written and another read
/// back.
pub fn flash(mission: Kept, record: Kept, health: Option<&FlashHealth>) -> Vec<Finding> {
    let kept = |name: &str, limit: &str, kept: Kept, advice: &str| match kept {
        Kept::Yes => Finding::judged(name, (1.0, ""), limit, true, ""),
        Kept::No => Finding::judged(name, (0.0, ""), limit, false, advice),
        Kept::NotTried(why) => Finding::not_measured(name, why),
    };
    let worn = "the flash does not take it: a sector is worn or damaged; erase the chip at the programmer, and replace it if that does not help";
    let mut findings = vec![
        kept(
            "flash.mission",
            "a mission is written and read back",
            mission,
            worn,
        ),
        kept(
            "flash.record",
            "a record is written and read back",
            record,
            worn,
        ),
    ];
    let Some(health) = health else {
        let why = "the firmware keeps nothing";
        findings
            .extend(["flash.copies", "flash.erases"].map(|name| Finding::not_measured(name, why)));
        return findings;
    };
    let twice = matches!(health.records, KeyValuesState::Whole | KeyValuesState::New);
    findings.push(Finding::judged(
        "flash.copies",
        (if twice { 2.0 } else { 1.0 }, ""),
        "records are there twice",
        twice,
        "one of the two areas for records takes nothing any more: a sector is bad, and the next damage loses the records; replace the chip",
    ));
    let erases = health.mission_erases.max(health.record_erases);
    let most = ERASES_LIMIT * PLACES;
    findings.push(Finding::judged(
        "flash.erases",
        (erases.into(), ""),
        format!("at most {most}"),
        erases <= most,
        "the flash is worn by its data sheet: replace the chip before it forgets",
    ));
    findings
}

/// How deep the stack went, of how much there is.
pub fn stack(deepest_bytes: Option<u32>, room_bytes: Option<u32>) -> Finding {
    const NAME: &str = "stack";
    let Some(deepest_bytes) = deepest_bytes else {
        return Finding::not_measured(NAME, "not measured by this board");
    };
    let Some(room_bytes) = room_bytes else {
        return Finding {
            advice: Some("this program does not know the board, and so not its stack".to_owned()),
            value: Some(deepest_bytes.into()),
            unit: "bytes",
            ..Finding::not_measured(NAME, "")
        };
    };
    let most = libm::floor(f64::from(room_bytes) * (1.0 - STACK_FREE_PART));
    Finding::judged(
        NAME,
        (deepest_bytes.into(), "bytes"),
        format!("at most {most} of {room_bytes}"),
        f64::from(deepest_bytes) <= most,
        "the stack is nearly full: give it more RAM (`stack_bytes` of the board), or take what is large off it",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counters::DelayBucket;

    fn looks(from_s: f64, speed: f64, took_s: &[f64]) -> Vec<ClockLook> {
        let each = took_s.iter().enumerate();
        each.map(|(index, took_s)| {
            let asked_s = from_s + index as f64 * 0.1;
            ClockLook {
                asked_s,
                took_s: *took_s,
                said_s: 7.0 + (asked_s + took_s / 2.0) * speed,
            }
        })
        .collect()
    }

    #[test]
    fn a_clock_is_compared_by_the_answers_that_came_soonest() {
        for (speed, pass, ppm) in [
            (1.0, true, 0.0),
            (1.0001, true, 100.0),
            (0.997, false, -3000.0),
        ] {
            let begin = looks(1.0, speed, &[0.2, 0.003, 0.01]);
            let end = looks(11.0, speed, &[0.003, 0.5, 0.02]);
            let finding = clock(&begin, &end, 0.0);
            assert_eq!((finding.pass, finding.value), (Some(pass), Some(ppm)));
        }
    }

    #[test]
    fn a_clock_behind_a_line_that_is_too_slow_is_not_judged() {
        let finding = clock(&looks(1.0, 1.0, &[0.4]), &looks(11.0, 1.0, &[0.003]), 0.0);
        assert_eq!(finding.pass, None);
        assert_eq!(clock(&[], &looks(1.0, 1.0, &[0.1]), 0.0).pass, None);
    }

    #[test]
    fn slots_are_late_missed_or_not_timed() {
        let slot = |executed, longest_delay_ns, missed| SlotReport {
            executed,
            missed,
            longest_delay_ns,
            shortest_delay_ns: 1_000,
            delays: vec![
                DelayBucket {
                    below_ns: Some(20_000),
                    count: executed - executed / 50,
                    exact: true,
                },
                DelayBucket {
                    below_ns: None,
                    count: executed / 50,
                    exact: true,
                },
            ],
            ..SlotReport::default()
        };
        let pass = |of: &[SlotReport]| -> Vec<Option<bool>> {
            slots(of, 100).iter().map(|it| it.pass).collect()
        };
        let (yes, no) = (Some(true), Some(false));
        assert_eq!(pass(&[slot(60, 3_000, 0), slot(60, 2_000, 0)]), [yes; 4]);
        // Two starts of a hundred are late.
        assert_eq!(pass(&[slot(99, 1_900_000, 1)]), [no, no, no, no]);
        // One of 149 is.
        let mut once = slot(149, 900_000, 0);
        (once.delays[0].count, once.delays[1].count) = (148, 1);
        assert_eq!(pass(&[once]), [yes; 4]);
        assert_eq!(pass(&[slot(160, 0, 0)]), [yes, yes, None, None]);
    }

    #[test]
    fn a_line_is_judged_by_its_frames() {
        assert_eq!(line(2_000, 1, Some(115_200)).pass, Some(true));
        assert_eq!(line(2_000, 20, None).pass, Some(false));
    }

    #[test]
    fn a_line_that_is_no_good_for_a_faster_rate_than_its_own_has_no_fault() {
        let tried = |baud, bad| RateTried {
            baud,
            frames: 200,
            bad,
        };
        let found = other_rates(
            115_200,
            &[
                tried(9_600, 0),
                tried(57_600, 3),
                tried(230_400, 0),
                tried(921_600, 200),
            ],
        );
        let passes: Vec<_> = found.iter().map(|it| it.pass).collect();
        assert_eq!(passes, [Some(true), Some(false), Some(true), None]);
        assert_eq!(found[3].value, Some(1.0));
    }

    #[test]
    fn a_critical_section_is_shorter_than_a_byte_of_the_line() {
        assert_eq!(critical_section(12.5).pass, Some(true));
        assert_eq!(critical_section(87.0).pass, Some(false));
    }

    #[test]
    fn a_flash_is_judged_by_what_it_took_and_by_its_wear() {
        let health = |records, mission_erases| FlashHealth {
            records,
            flaws: 0,
            mission_erases,
            record_erases: 3,
        };
        let passes = |mission, record, health: Option<FlashHealth>| -> Vec<Option<bool>> {
            let findings = flash(mission, record, health.as_ref());
            findings.iter().map(|it| it.pass).collect()
        };
        let (yes, no) = (Some(true), Some(false));
        let whole = health(KeyValuesState::Whole, 2);
        assert_eq!(passes(Kept::Yes, Kept::Yes, Some(whole)), [yes; 4]);
        let once = health(KeyValuesState::Once, 30_000);
        assert_eq!(passes(Kept::No, Kept::No, Some(once)), [no; 4]);
        let not_tried = Kept::NotTried("the firmware keeps nothing");
        assert_eq!(passes(not_tried, not_tried, None), [None; 4]);
    }

    #[test]
    fn a_stack_needs_to_be_known_and_to_have_room() {
        assert_eq!(stack(Some(6_000), Some(7_168)).pass, Some(true));
        assert_eq!(stack(Some(7_100), Some(7_168)).pass, Some(false));
        assert_eq!(stack(Some(6_000), None).pass, None);
        assert_eq!(stack(None, Some(7_168)).pass, None);
    }
}
