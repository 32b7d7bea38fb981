//! What is kept across a reset, in RAM that no start-up code clears: why the firmware ended, how
//! often it did so in a row, an emergency stop, and the black box.
//!
//! A board has one [`RetainedRam`], in a section of its own that nothing writes at the start. It
//! calls [`RetainedRam::begin`] first of all, which tells whether what stands there is its own, and
//! gives it to the runtime in [`About`](crate::About). Whoever ends the firmware calls
//! [`RetainedRam::end`].
//!
//! All of it is words that are only loaded and stored, and of which every pattern is valid: so
//! memory that holds what power-on left there is a `RetainedRam` too, which `begin` finds to be
//! nobody's.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::black_box::BlackBox;
use crate::supervision::BACKGROUND_BOUND_US;
use crate::task_word::{NO_TASK, TaskWord};
use esm_link::black_box::Event;
use esm_link::frame::checksum;
use esm_link::message::{CoreFault, CrashReport, MAX_PLACE_BYTES, ResetReason, Silent};

const PLACE_WORDS: usize = MAX_PLACE_BYTES / size_of::<u32>();
/// Words of a report: reason and length of the place; line; task; five of a fault; time, two; who
/// was silent; the place; checksum.
const REPORT_WORDS: usize = 1 + 1 + 1 + 5 + 2 + 1 + PLACE_WORDS + 1;

/// A start that is followed by so much robot time, in µs, was a good one: more than it takes until
/// any silence is found in a mission whose periods are short.
pub const HEALTHY_US: u64 = 60_000_000;
const _: () = assert!(HEALTHY_US > 2 * BACKGROUND_BOUND_US as u64);
/// After so many bad starts in a row no mission starts by itself.
pub const BAD_STARTS: u32 = 3;

/// Says that what stands here was written by a firmware with this layout.
const MARK: u32 = 0x6B65_7003;
/// No emergency stop is latched. Whatever else stands there is one: what a stray write leaves keeps
/// the motors off.
const RELEASED: u32 = 0x52D1_3A9C;
/// Far from [`RELEASED`] in each byte.
const LATCHED: u32 = !RELEASED;
/// Allowances for erases of the flash.
pub(crate) const ALLOWANCES: usize = 3;

/// What a board knows of its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrashCause<'a> {
    /// A panic, at this place.
    Panic {
        /// The file.
        file: &'a str,
        /// The line in it.
        line: u32,
    },
    /// A fault of the processor.
    Fault(CoreFault),
    /// The watchdog ran out.
    Watchdog,
}

impl CrashCause<'_> {
    fn reason(&self) -> ResetReason {
        match self {
            CrashCause::Panic { .. } => ResetReason::Panic,
            CrashCause::Fault(_) => ResetReason::CpuFault,
            CrashCause::Watchdog => ResetReason::Watchdog,
        }
    }

    fn detail(&self) -> u32 {
        match self {
            CrashCause::Panic { line, .. } => *line,
            CrashCause::Fault(fault) => fault.pc,
            CrashCause::Watchdog => 0,
        }
    }
}

/// The end of a panic's place, as it is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    bytes: [u8; MAX_PLACE_BYTES],
    len: usize,
}

impl Place {
    /// UTF-8 but for a letter that was cut at its beginning.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }
}

/// What is kept.
pub struct RetainedRam {
    mark: AtomicU32,
    report: [AtomicU32; REPORT_WORDS],
    /// Whether the report is of the run of the firmware that has just ended.
    is_news: AtomicU32,
    /// The task instance that is executed by a slot.
    task: TaskWord,
    /// Who was silent for so long that the watchdog is fed no more, by its number.
    silent: AtomicU32,
    /// Starts after a watchdog, a panic or a fault, one after another, none of which lasted for
    /// [`HEALTHY_US`].
    bad_starts: AtomicU32,
    /// Robot time, 48 bits and more, as of the last activation of the interpreter's slot.
    alive_us: [AtomicU32; 2],
    /// [`RELEASED`], or an emergency stop is latched.
    emergency_stop: AtomicU32,
    /// What is left of each allowance for erases of the flash. More than there can be is all of it.
    allowances: [AtomicU32; ALLOWANCES],
    /// The black box.
    pub black_box: BlackBox,
}

impl Default for RetainedRam {
    fn default() -> Self {
        Self::new()
    }
}

impl RetainedRam {
    /// What power-on leaves on a board whose RAM is zeros then. A board whose RAM is anything puts
    /// none of this there.
    pub const fn new() -> Self {
        RetainedRam {
            mark: AtomicU32::new(0),
            report: [const { AtomicU32::new(0) }; REPORT_WORDS],
            is_news: AtomicU32::new(0),
            task: TaskWord::new(),
            silent: AtomicU32::new(0),
            bad_starts: AtomicU32::new(0),
            alive_us: [const { AtomicU32::new(0) }; 2],
            emergency_stop: AtomicU32::new(0),
            allowances: [const { AtomicU32::new(0) }; ALLOWANCES],
            black_box: BlackBox::new(),
        }
    }

    /// The firmware starts. `hardware` is what the chip says of the reset, if it says anything.
    /// Tells why it started. To be called once, before anything else of this.
    ///
    /// Crash report come before what the chip says: a firmware that ends itself does so by a reset
    /// of the software's. A reset without either, of a firmware that was here before, is the
    /// watchdog's own, which struck where nothing could be written any more.
    pub fn begin(&self, hardware: Option<ResetReason>) -> ResetReason {
        let was_here = self.mark.load(Relaxed) == MARK;
        let report = self.read_report();
        let has_news = was_here && self.is_news.load(Relaxed) == MARK && report.is_some();
        let reason = match (report, hardware) {
            (Some((words, _)), _) if has_news => words.reason,
            (_, Some(reason)) => reason,
            (_, None) if was_here => ResetReason::Watchdog,
            (_, None) => ResetReason::PowerOn,
        };
        if was_here {
            self.black_box.resume();
        } else {
            self.black_box.clear();
            self.set_emergency_stop(false);
            for left in &self.allowances {
                left.store(u32::MAX, Relaxed);
            }
        }
        let silent = match report {
            Some((words, _)) if has_news => words.silent,
            _ if was_here => Silent::from_number(self.silent.load(Relaxed)),
            _ => None,
        };
        if !has_news {
            // Nobody has said how far the run had come, but that stands here.
            let words = CrashReport {
                after_us: if was_here { self.alive_us() } else { 0 },
                silent,
                ..CrashReport::of(reason)
            };
            self.write_report(&words, "");
        }
        let is_defect = matches!(
            reason,
            ResetReason::Watchdog | ResetReason::Panic | ResetReason::CpuFault
        );
        let before = if was_here {
            self.bad_starts.load(Relaxed)
        } else {
            0
        };
        let bad_starts = match silent {
            // What somebody sends makes no start a bad one, and none a good one.
            Some(silent) if is_defect && silent.is_load_from_outside() => before,
            _ if is_defect => before.saturating_add(1),
            _ => 0,
        };
        self.bad_starts.store(bad_starts, Relaxed);
        self.is_news.store(0, Relaxed);
        self.silent.store(0, Relaxed);
        self.task.end();
        self.set_alive(0);
        self.mark.store(MARK, Relaxed);
        self.black_box.record(0, Event::Started(reason));
        reason
    }

    /// The firmware ends. To be called once, by the one that never returns; the reset follows.
    pub fn end(&self, ending: &CrashCause<'_>) {
        let task = self.task.under_way();
        let (file, line) = match *ending {
            CrashCause::Panic { file, line } => (file, line),
            _ => ("", 0),
        };
        let words = CrashReport {
            reason: ending.reason(),
            after_us: self.alive_us(),
            task,
            line,
            fault: match ending {
                CrashCause::Fault(fault) => *fault,
                _ => CoreFault::default(),
            },
            silent: Silent::from_number(self.silent.load(Relaxed)),
            bad_starts: 0,
        };
        self.write_report(&words, file);
        self.is_news.store(MARK, Relaxed);
        self.black_box.record(
            words.after_us,
            Event::Ended {
                reason: words.reason,
                detail: ending.detail(),
            },
        );
    }

    /// Starts after a watchdog, a panic or a fault, one after another, none of which lasted for
    /// [`HEALTHY_US`] of robot time.
    pub fn bad_starts(&self) -> u32 {
        self.bad_starts.load(Relaxed)
    }

    /// Whether a mission that is kept in flash may start by itself: not after [`BAD_STARTS`] starts
    /// that ended in no time. A robot whose mission resets it does not do so for ever.
    pub fn may_start_by_itself(&self) -> bool {
        self.bad_starts() < BAD_STARTS
    }

    /// Whether an emergency stop is latched. Told of memory that [`begin`](Self::begin) was called
    /// for.
    pub fn is_emergency_stopped(&self) -> bool {
        self.mark.load(Relaxed) == MARK && self.emergency_stop.load(Relaxed) != RELEASED
    }

    /// Latches an emergency stop, or releases it.
    pub(crate) fn set_emergency_stop(&self, latched: bool) {
        let word = if latched { LATCHED } else { RELEASED };
        self.emergency_stop.store(word, Relaxed);
    }

    /// What is left of each allowance for erases of the flash, of memory that
    /// [`begin`](Self::begin) was called for.
    pub(crate) fn allowances(&self) -> &[AtomicU32; ALLOWANCES] {
        &self.allowances
    }

    /// This one was silent for so long that the watchdog is fed no more.
    pub(crate) fn set_silent(&self, who: Silent) {
        self.silent.store(who.number(), Relaxed);
    }

    /// How the run before this one ended, and the place of its panic.
    pub fn crash_report(&self) -> (CrashReport, Place) {
        self.read_report().unwrap_or((
            CrashReport::of(ResetReason::PowerOn),
            Place {
                bytes: [0; MAX_PLACE_BYTES],
                len: 0,
            },
        ))
    }

    /// Where the real-time side writes down which task is under way.
    pub(crate) fn task(&self) -> &TaskWord {
        &self.task
    }

    /// The robot has come this far.
    pub(crate) fn set_alive(&self, robot_us: u64) {
        if robot_us >= HEALTHY_US {
            self.bad_starts.store(0, Relaxed);
        }
        let [low, high] = &self.alive_us;
        low.store(robot_us as u32, Relaxed);
        high.store((robot_us >> 32) as u32, Relaxed);
    }

    fn alive_us(&self) -> u64 {
        let [low, high] = &self.alive_us;
        u64::from(high.load(Relaxed)) << 32 | u64::from(low.load(Relaxed))
    }

    fn write_report(&self, words: &CrashReport, file: &str) {
        let file = file.as_bytes();
        let end = file
            .get(file.len().saturating_sub(MAX_PLACE_BYTES)..)
            .unwrap_or_default();
        let CoreFault {
            pc,
            lr,
            status,
            hard_status,
            address,
        } = words.fault;
        let head = [
            u32::from(words.reason as u8) << 8 | end.len() as u32,
            words.line,
            words.task.map_or(NO_TASK, u32::from),
            pc,
            lr,
            status,
            hard_status,
            address,
            words.after_us as u32,
            (words.after_us >> 32) as u32,
            words.silent.map_or(0, Silent::number),
        ];
        let mut text = [0; MAX_PLACE_BYTES];
        for (place, byte) in text.iter_mut().zip(end) {
            *place = *byte;
        }
        let (groups, _) = text.as_chunks();
        let text = groups.iter().map(|group| u32::from_le_bytes(*group));
        let mut report = [0; REPORT_WORDS];
        for (place, word) in report.iter_mut().zip(head.into_iter().chain(text)) {
            *place = word;
        }
        let sum = checksum_of(&report);
        if let Some(last) = report.last_mut() {
            *last = sum;
        }
        for (place, word) in self.report.iter().zip(report) {
            place.store(word, Relaxed);
        }
    }

    fn read_report(&self) -> Option<(CrashReport, Place)> {
        let report = self.report.each_ref().map(|word| word.load(Relaxed));
        let [
            first,
            line,
            task,
            pc,
            lr,
            status,
            hard_status,
            address,
            after,
            after_high,
            silent,
            text @ ..,
            sum,
        ] = report;
        if checksum_of(&report) != sum {
            return None;
        }
        let mut bytes = [0; MAX_PLACE_BYTES];
        let letters = text.into_iter().flat_map(u32::to_le_bytes);
        for (place, byte) in bytes.iter_mut().zip(letters) {
            *place = byte;
        }
        let words = CrashReport {
            reason: ResetReason::from_number((first >> 8) as u8)?,
            after_us: u64::from(after_high) << 32 | u64::from(after),
            task: u16::try_from(task).ok(),
            line,
            fault: CoreFault {
                pc,
                lr,
                status,
                hard_status,
                address,
            },
            silent: Silent::from_number(silent),
            bad_starts: self.bad_starts.load(Relaxed),
        };
        let len = usize::from(first as u8).min(MAX_PLACE_BYTES);
        Some((words, Place { bytes, len }))
    }
}

/// Of all words of a report but the last.
fn checksum_of(report: &[u32; REPORT_WORDS]) -> u32 {
    let mut bytes = [0; (REPORT_WORDS - 1) * size_of::<u32>()];
    let words = report.iter().flat_map(|word| word.to_le_bytes());
    for (place, byte) in bytes.iter_mut().zip(words) {
        *place = byte;
    }
    checksum(&bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAULT: CoreFault = CoreFault {
        pc: 0x1234,
        lr: 0x5678,
        status: 0x0001_0000,
        hard_status: 0x4000_0000,
        address: 0xE000_ED38,
    };

    fn records(kept: &RetainedRam) -> Vec<Event> {
        let mut from = None;
        let mut events = Vec::new();
        while let Some(record) = kept.black_box.first_from(from) {
            events.push(record.event);
            from = Some(record.sequence.wrapping_add(1));
            if from == Some(kept.black_box.end()) {
                break;
            }
        }
        events
    }

    #[test]
    fn what_ends_the_firmware_is_known_at_the_next_start_and_not_at_the_one_after() {
        let long = "/a/path/that/is/longer/than/what/is/kept/of/it/src/tasks/cruise.rs";
        let kept = RetainedRam::new();
        assert_eq!(kept.begin(None), ResetReason::PowerOn);
        for (ending, reason, place, line, fault) in [
            (
                CrashCause::Panic {
                    file: "src/x.rs",
                    line: 7,
                },
                ResetReason::Panic,
                "src/x.rs",
                7,
                CoreFault::default(),
            ),
            (
                CrashCause::Panic {
                    file: long,
                    line: 70_000,
                },
                ResetReason::Panic,
                &long[long.len() - MAX_PLACE_BYTES..],
                70_000,
                CoreFault::default(),
            ),
            (
                CrashCause::Fault(FAULT),
                ResetReason::CpuFault,
                "",
                0,
                FAULT,
            ),
            (
                CrashCause::Watchdog,
                ResetReason::Watchdog,
                "",
                0,
                CoreFault::default(),
            ),
        ] {
            kept.task().begin(5);
            kept.set_alive(1 << 33 | 4);
            kept.end(&ending);
            // The chip calls it a reset by software: what the firmware said comes first.
            assert_eq!(kept.begin(Some(ResetReason::Software)), reason);
            let (words, told) = kept.crash_report();
            let expected = CrashReport {
                reason,
                after_us: 1 << 33 | 4,
                task: Some(5),
                line,
                fault,
                silent: None,
                bad_starts: 1,
            };
            assert_eq!(words, expected);
            assert_eq!(told.as_bytes(), place.as_bytes());
            // Somebody presses the button.
            assert_eq!(kept.begin(Some(ResetReason::Pin)), ResetReason::Pin);
            assert_eq!(kept.crash_report().0, CrashReport::of(ResetReason::Pin));
        }
    }

    #[test]
    fn a_reset_that_nobody_explains_is_the_watchdogs_where_there_was_a_firmware() {
        let kept = RetainedRam::new();
        kept.begin(None);
        kept.set_alive(77);
        assert_eq!(kept.begin(None), ResetReason::Watchdog);
        assert_eq!(kept.crash_report().0.after_us, 77);
        assert_eq!(
            kept.begin(Some(ResetReason::BrownOut)),
            ResetReason::BrownOut
        );
    }

    #[test]
    fn a_robot_that_resets_again_and_again_starts_no_mission_by_itself_until_a_start_was_good() {
        let kept = RetainedRam::new();
        kept.begin(None);
        for bad in 1..=BAD_STARTS {
            assert!(kept.may_start_by_itself());
            kept.set_alive(HEALTHY_US - 1);
            kept.set_silent(Silent::Slot(2));
            kept.end(&CrashCause::Watchdog);
            kept.begin(Some(ResetReason::Software));
            let words = kept.crash_report().0;
            assert_eq!(
                (words.silent, words.bad_starts),
                (Some(Silent::Slot(2)), bad)
            );
        }
        assert!(!kept.may_start_by_itself());
        kept.set_alive(HEALTHY_US);
        assert!(kept.may_start_by_itself());
        // Somebody presses the button, which is a start like any first.
        kept.end(&CrashCause::Watchdog);
        kept.begin(None);
        assert_eq!(kept.bad_starts(), 1);
        assert_eq!(kept.begin(Some(ResetReason::Pin)), ResetReason::Pin);
        assert_eq!(kept.bad_starts(), 0);
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn what_power_on_left_is_no_reason_and_no_record() {
        let kept = RetainedRam::new();
        for (number, word) in (0u32..).zip(&kept.report) {
            word.store(number.wrapping_mul(0x0101_0101) ^ 0x5555_5555, Relaxed);
        }
        kept.is_news.store(MARK, Relaxed);
        assert_eq!(kept.begin(None), ResetReason::PowerOn);
        assert_eq!(records(&kept), [Event::Started(ResetReason::PowerOn)]);
    }

    #[test]
    #[cfg_attr(not(feature = "black-box"), ignore = "there is no room for records")]
    fn a_report_that_was_torn_is_none_but_the_records_stay() {
        let kept = RetainedRam::new();
        kept.begin(None);
        kept.end(&CrashCause::Fault(FAULT));
        kept.report[3].store(0, Relaxed);
        assert_eq!(kept.begin(None), ResetReason::Watchdog);
        assert_eq!(
            records(&kept),
            [
                Event::Started(ResetReason::PowerOn),
                Event::Ended {
                    reason: ResetReason::CpuFault,
                    detail: FAULT.pc
                },
                Event::Started(ResetReason::Watchdog),
            ]
        );
    }
}
