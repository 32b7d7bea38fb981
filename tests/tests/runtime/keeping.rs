//! What a robot writes down in RAM that a reset leaves alone, and tells at the next connection.

use esm_link::black_box::{Event, RECORD_BYTES, Record};
use esm_link::message::{CrashReport, Mode, Request, ResetReason, SafeReason};
use rt_firmware::About;
use rt_firmware::retained_ram::{CrashCause, RetainedRam};

use super::robot::{Answer, Bench, with_robot_that_is};
use super::{counting, hogging};

/// A robot that starts, with what was kept of its runs before.
pub(crate) fn with_kept(kept: &RetainedRam, test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    let about = About {
        reset: kept.begin(None),
        kept: Some(kept),
        ..About::new("toy 0.1", "bench")
    };
    with_robot_that_is(about, test);
}

/// All that the black box holds, asked for page by page.
fn black_box(robot: &mut Bench<'_, '_, '_>) -> Vec<(u64, Event)> {
    let mut records = Vec::new();
    let mut from = None;
    loop {
        let Ok(Answer::Bytes(end, bytes)) = robot.ask(Request::BlackBox { from }) else {
            panic!("the robot tells what it holds");
        };
        let (page, _) = bytes.as_chunks::<RECORD_BYTES>();
        let page: Vec<Record> = page.iter().filter_map(Record::from_bytes).collect();
        let Some(last) = page.last() else {
            assert_eq!(from, (end > 0).then_some(end));
            return records;
        };
        from = Some(last.sequence + 1);
        records.extend(page.iter().map(|record| (record.at_us, record.event)));
    }
}

#[test]
fn states_faults_and_stops_are_told_with_their_times() {
    let kept = RetainedRam::new();
    with_kept(&kept, |robot| {
        let blob = counting(3).blob();
        let hash = u32::from_le_bytes(*blob.last_chunk().unwrap());
        robot.upload(&blob).unwrap();
        robot.run_us(45_000);
        robot.ask(Request::Stop).unwrap();
        let told = black_box(robot);
        let transition = |transition| Event::Transition {
            region_instance: 0,
            transition,
        };
        let stopped = Event::Mode(Mode::Stopped);
        let expected = [
            Event::Started(ResetReason::PowerOn),
            Event::Mission { hash },
            transition(0),
            transition(1),
            stopped,
        ];
        assert!(
            told.iter().map(|(_, event)| *event).eq(expected),
            "{told:?}"
        );
        // At the nominal starts of the macro steps that they were taken in.
        assert_eq!((told[2].0, told[3].0), (0, 20_000), "{told:?}");
    });
}

#[test]
fn what_was_written_down_is_there_after_a_reset_with_how_the_run_ended() {
    let kept = RetainedRam::new();
    let mut before = Vec::new();
    with_kept(&kept, |robot| {
        robot.upload(&hogging(1_500).blob()).unwrap();
        robot.run_us(100_000);
        assert_eq!(robot.status().mode, Mode::Safe(SafeReason::Overruns));
        before = black_box(robot);
        assert!(before.contains(&(
            before[before.len() - 1].0,
            Event::Mode(Mode::Safe(SafeReason::Overruns))
        )));
        let overruns = before.iter().filter(|(_, event)| {
            matches!(
                event,
                Event::Overrun {
                    task_instance: 0,
                    took_us: 1_500
                }
            )
        });
        assert_eq!(overruns.count(), 4, "{before:?}");
    });
    kept.end(&CrashCause::Panic {
        file: "src/hog.rs",
        line: 12,
    });
    with_kept(&kept, |robot| {
        let told = black_box(robot);
        assert_eq!(told[..before.len()], before);
        let ended = Event::Ended {
            reason: ResetReason::Panic,
            detail: 12,
        };
        let started = Event::Started(ResetReason::Panic);
        let after: Vec<Event> = told[before.len()..]
            .iter()
            .map(|(_, event)| *event)
            .collect();
        assert_eq!(after, [ended, started]);
        let Ok(Answer::CrashReport(words)) = robot.ask(Request::CrashReport) else {
            panic!("the robot tells how it ended");
        };
        assert_eq!(
            (words.reason, words.line, words.task),
            (ResetReason::Panic, 12, None)
        );
        assert!(words.after_us > 0, "{words:?}");
        assert_eq!(robot.status().reset, ResetReason::Panic);
    });
}

#[test]
fn a_board_that_keeps_nothing_says_so() {
    with_robot_that_is(About::new("toy 0.1", "bench"), |robot| {
        assert_eq!(black_box(robot), []);
        assert_eq!(
            robot.ask(Request::CrashReport),
            Ok(Answer::CrashReport(CrashReport::of(ResetReason::PowerOn)))
        );
    });
}

#[test]
fn a_robot_that_may_not_start_by_itself_looks_at_what_it_has_all_the_same() {
    let kept = RetainedRam::new();
    for starts in 0..5 {
        let mut taken = Vec::new();
        let reset = kept.begin((starts > 0).then_some(ResetReason::Watchdog));
        let may_start = kept.may_start_by_itself();
        assert_eq!(may_start, starts < 3, "{starts}");
        let about = About {
            reset,
            kept: Some(&kept),
            ..About::new("toy 0.1", "bench")
        };
        with_robot_that_is(about, |robot| {
            robot.wire.memory.is_there = true;
            robot.wire.memory.mission = counting(3).blob();
            robot.link.start(&mut robot.wire);
            robot.run_us(50_000);
            assert_eq!(robot.status().mission.is_some(), may_start);
            taken = std::mem::take(&mut robot.wire.memory.taken);
        });
        assert_eq!(taken, [may_start], "start {starts}");
    }
}
