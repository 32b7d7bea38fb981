//! Recorded runs are had again from their recordings alone, line by line; and what is wrong with a
//! recording is told.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use esm_core::format::FLAG_EXIT;
use esm_core::{Interpreter, Observer, TransitionTaken};
use esm_link::recording::{MAX_QUIET, write_changes, write_quiet, write_started, write_state};
use esm_link::trace::RecordSink;
use esm_tests::command::root;
use esm_tests::random::Random;
use esm_tests::random_machine::machine;
use esm_tests::recorded::{
    MOST_BYTES_A_TRANSITION, RecordedRun, Row, SECONDS, SHIPPED, bytes_a_transition, mission,
    record_shipped,
};
use host_tools::compile::compile;
use host_tools::lang;
use host_tools::recording::file::{self, FileEnd, FileError, Frame, Header};
use host_tools::recording::player::{Player, Recording, RecordingError, ReplayError, replay};
use host_tools::recording::walk::{Moment, Walk};
use host_tools::recording::writer::RecordingWriter;
use host_tools::run::mission::Mission;
use host_tools::time::work_limit;

const fn run(missions: &'static [(u64, &'static str, bool)], world: &'static str) -> RecordedRun {
    RecordedRun {
        missions,
        world,
        seed: 1,
        until_s: 20,
    }
}

const RUNS: [RecordedRun; 10] = [
    run(&[(0, "patrol", false)], "office"),
    run(&[(0, "patrol", false)], "corridor"),
    RecordedRun {
        seed: 7,
        ..run(&[(0, "patrol", false)], "office")
    },
    run(&[(0, "follow_wall", false)], "office"),
    run(&[(0, "follow_wall", false)], "corridor"),
    run(&[(0, "patrol", false), (6, "follow_wall", false)], "office"),
    run(
        &[
            (0, "patrol", false),
            (5, "follow_wall", false),
            (11, "patrol", false),
        ],
        "corridor",
    ),
    run(&[(0, "patrol", false), (6, "follow_wall", true)], "office"),
    run(&[(0, "tutorial/1_line", false)], "track"),
    run(
        &[
            (0, "tutorial/5_obstacle", false),
            (9, "tutorial/6_everything", true),
        ],
        "track",
    ),
];

fn replayed(bytes: &[u8], over_gaps: bool) -> (String, Option<ReplayError>) {
    let mut trace = Vec::new();
    let ended = replay(
        &Recording::read(bytes).unwrap(),
        over_gaps,
        Some(&mut trace),
    );
    let error = ended.err().map(|(_, error)| error);
    (String::from_utf8(trace).unwrap(), error)
}

#[track_caller]
fn assert_lines_equal(what: &str, expected: &str, found: &str) {
    for (number, (expected, found)) in expected.lines().zip(found.lines()).enumerate() {
        assert_eq!(expected, found, "{what}: line {}", number + 1);
    }
    assert_eq!(expected.len(), found.len(), "{what}: one has more lines");
}

#[test]
fn ten_recorded_runs_with_uploads_in_them_are_had_again_line_by_line() {
    for recorded in &RUNS {
        let what = format!("{:?} in {}", recorded.missions, recorded.world);
        let made = recorded.made();
        let (bytes, trace) = (made.recording, made.trace);
        let (again, error) = replayed(&bytes, false);
        assert!(error.is_none(), "{what}: {error:?}");
        assert_lines_equal(&what, &trace, &again);
        let recording = Recording::read(&bytes).unwrap();
        assert_eq!(recording.end, FileEnd::Whole);
        // What a run says of its recording at the end.
        let outcome = replay(&recording, false, Some(Vec::new())).unwrap();
        assert_eq!(made.counts.steps, outcome.steps, "{what}");
        assert_eq!(made.steps, outcome.steps, "{what}");
        assert_eq!(made.transitions, outcome.transitions, "{what}");
        let of: Vec<u32> = recording.stretches.iter().map(|it| it.mission).collect();
        assert_eq!(of.len(), recorded.missions.len(), "{what}: {of:x?}");
    }
}

#[test]
fn a_recording_of_the_shipped_missions_takes_four_bytes_a_transition_at_most() {
    let mut missions: Vec<String> = ["", "tutorial/"]
        .iter()
        .flat_map(|folder| {
            let files = std::fs::read_dir(root().join("missions").join(folder)).unwrap();
            let names = files.map(|file| file.unwrap().file_name().into_string().unwrap());
            names.filter_map(move |name| Some(format!("{folder}{}", name.strip_suffix(".esm")?)))
        })
        // It declares tasks, and has no machine.
        .filter(|name| name != "rover")
        .collect();
    let mut listed = SHIPPED.map(|(name, _)| name.to_owned()).to_vec();
    missions.sort();
    listed.sort();
    assert_eq!(missions, listed, "the missions that ship");

    let rows = record_shipped(SECONDS);
    let sum = |of: fn(&Row) -> u64| rows.iter().map(of).sum::<u64>();
    let (bytes, transitions) = (sum(|row| row.record_bytes), sum(|row| row.transitions));
    assert!(transitions > 300, "{transitions} transitions");
    let average = bytes_a_transition(bytes, transitions);
    assert!(
        average <= MOST_BYTES_A_TRANSITION,
        "{average:.2}: {rows:#?}"
    );
    for row in &rows {
        // Where nothing is decided, there is nothing to measure by: it takes some bytes a minute.
        let most = MOST_BYTES_A_TRANSITION * row.transitions.max(10) as f64;
        assert!(row.record_bytes as f64 <= most, "{row:#?}");
    }
}

#[test]
fn equal_runs_have_equal_recordings() {
    let recorded = &RUNS[5];
    assert_eq!(recorded.made().recording, recorded.made().recording);
    assert_ne!(
        RUNS[0].made().recording,
        RUNS[2].made().recording,
        "another seed"
    );
}

/// All moments of a recording, forwards, which are those backwards.
fn walked(what: &str, recording: &Recording) -> Vec<Moment> {
    let (mut walk, ended) = Walk::new(recording, false);
    assert!(ended.is_none(), "{what}: {ended:?}");
    let mut moments = Vec::new();
    while let Some(moment) = walk.forward() {
        moments.push(moment.clone());
    }
    for expected in moments.iter().rev().skip(1) {
        assert_eq!(walk.back(), Some(expected), "{what}");
    }
    assert_eq!(walk.back(), None, "{what}: before the first");
    assert_eq!(walk.forward(), moments.first(), "{what}");
    for taken in moments.iter().flat_map(|moment| &moment.taken) {
        assert!(taken.holds, "{what}: {taken:?}");
    }
    moments
}

/// Holds what a walk tells of flags and timers behind each macro step against the machine that made
/// it.
fn assert_what_is_told_is_what_the_machine_was(what: &str, recording: &Recording) {
    let (mut walk, _) = Walk::new(recording, false);
    for stretch in &recording.stretches {
        let mission = recording.mission(stretch.mission).unwrap();
        let period_us = u64::from(mission.directory.interpreter_period_us());
        let mut arena = vec![0; mission.verified.arena_words()];
        let mut player = Player::new(mission, stretch, &mut arena).unwrap();
        let mut entered: HashMap<String, u64> = HashMap::new();
        let mut flags_before = player.machine().input_words().to_vec();
        while player.enter().unwrap().goes_on && player.machine().fault().is_none() {
            let step = player.machine().progress().steps;
            let mut taken = Taken::default();
            let _ = player.macro_step(&mut taken);
            let (mut told, mut flags_told) = (0, flags_before.clone());
            while told < taken.count {
                let moment = walk.forward().unwrap();
                assert_eq!(moment.step, step, "{what}");
                told += moment.taken.len() as u64;
                entered.extend(moment.taken.iter().map(|taken| (taken.to.clone(), step)));
                let surroundings = walk.surroundings().unwrap();
                for flag in &surroundings.flags {
                    let (word, bit) = (flag.bit / 32, 1 << (flag.bit % 32));
                    let was_set = flags_told[word] & bit != 0;
                    assert_eq!(
                        flag.is_new,
                        flag.is_set != was_set,
                        "{what}, {step}: {flag:?}"
                    );
                    flags_told[word] = if flag.is_set {
                        flags_told[word] | bit
                    } else {
                        flags_told[word] & !bit
                    };
                }
            }
            let machine = player.machine();
            // What a transition had done that a fault broke off was not taken back.
            if taken.count == 0 || machine.fault().is_some() {
                continue;
            }
            let surroundings = walk.surroundings().unwrap();
            for flag in &surroundings.flags {
                assert_eq!(
                    flag.is_set,
                    machine.flag(flag.bit),
                    "{what}, {step}: {flag:?}"
                );
            }
            // What was told to be new is all that is; only `exit` of the machine itself is of no
            // state.
            let flags = machine.first_enable_bit() / 32;
            flags_told[0] |= machine.input_words()[0] & 1 << FLAG_EXIT;
            assert_eq!(
                flags_told[..flags],
                machine.input_words()[..flags],
                "{what}, {step}"
            );
            flags_before.copy_from_slice(machine.input_words());
            for timer in &surroundings.timers {
                if let Some(entered) = entered.get(&timer.state) {
                    assert_eq!(
                        timer.age_us,
                        (step - entered) * period_us,
                        "{what}, {step}: {timer:?}"
                    );
                }
            }
        }
    }
    assert_eq!(walk.forward(), None, "{what}");
}

#[test]
fn a_walk_tells_the_transitions_of_the_trace_with_guards_that_were_true() {
    for recorded in &RUNS[5..8] {
        let what = format!("{:?}", recorded.missions);
        let made = recorded.made();
        let (bytes, trace) = (made.recording, made.trace);
        let recording = Recording::read(&bytes).unwrap();
        let moments = walked(&what, &recording);
        assert_what_is_told_is_what_the_machine_was(&what, &recording);
        let told = moments.iter().flat_map(|moment| {
            moment.taken.iter().map(move |taken| {
                let (from, to) = (taken.from.clone(), taken.to.clone());
                (moment.step, u64::from(moment.micro), from, to)
            })
        });
        let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
        let traced = trace.lines().filter_map(|line| {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            let (step, micro) = (line["step"].as_u64()?, line["micro"].as_u64()?);
            Some((step, micro, text(&line["from"]), text(&line["to"])))
        });
        assert_eq!(
            told.collect::<Vec<_>>(),
            traced.collect::<Vec<_>>(),
            "{what}"
        );
        // Where the last macro step of a moment ends, the trace has the same states.
        for moment in &moments {
            let micro = format!(
                "\"active\":{}",
                serde_json::to_string(&moment.active).unwrap()
            );
            let step = format!("\"kind\":\"step\",\"step\":{},", moment.step);
            let is_last = moments.iter().all(|other| {
                (other.stretch, other.step) != (moment.stretch, moment.step)
                    || other.micro <= moment.micro
            });
            let of_step = |line: &&str| line.contains(&step) && line.contains(&micro);
            assert!(
                !is_last || trace.lines().any(|line| of_step(&line)),
                "{what}: {moment}"
            );
        }
    }
}

#[test]
fn a_moment_of_a_walk_shows_its_guard_with_what_was_read() {
    let bytes = RUNS[0].made().recording;
    let recording = Recording::read(&bytes).unwrap();
    let (mut walk, _) = Walk::new(&recording, false);
    let told = walk.to_time(16_490_000).unwrap().to_string();
    assert_eq!(
        told,
        "\
16.500 s, patrol: macro step 825, micro step 0, on pulse
  motion/Roam/steps/Ahead -> motion/Roam/steps/AvoidLeft
    [.near and .left_freer]   .near = true, .left_freer = true
    sets motion/Roam/steps/AvoidLeft.left
  now sonars/Listen, position/Track, motion/Roam, motion/Roam/steps/AvoidLeft, motion/Roam/steps/AvoidLeft/steps/initial, wheels/Drive, safety/Watch, battery/Measure, diary/Pause
"
    );
    assert_eq!(walk.to_step(102).unwrap().step, 102);
    assert_eq!(walk.back().unwrap().step, 101);
    // Behind the end stands nothing, and before it the last moment.
    let mut last = None;
    while let Some(moment) = walk.forward() {
        last = Some(moment.clone());
    }
    for beyond in [Walk::to_time, Walk::to_step] {
        assert_eq!(beyond(&mut walk, 99_000_000), None);
        assert_eq!(walk.forward(), None);
        assert_eq!(walk.back(), last.as_ref());
    }
}

#[test]
fn times_are_looked_for_in_each_run_of_a_robot_that_was_reset() {
    const SECOND: u64 = 1_000_000;
    let (frames, _) = file::read(&RUNS[0].made().recording).unwrap();
    let records = || {
        let is_records = |frame: &&Frame| matches!(frame, Frame::Records(_));
        frames.iter().filter(is_records).cloned()
    };
    // After a reset it ran for 10 s, in which it did what it had done before.
    let mut again = frames[..2].to_vec();
    again.extend(records());
    again.push(Frame::Gap(1));
    again.extend(records());
    again.push(Frame::End(500));
    let recording = Recording::read(&bytes_of(&again)).unwrap();
    let (mut walk, ended) = Walk::new(&recording, true);
    assert!(ended.is_none(), "{ended:?}");
    let mut at = |t_s: u64| {
        let moment = walk.to_time(t_s * SECOND)?;
        assert!(moment.t_us >= t_s * SECOND, "{moment}");
        Some((moment.stretch, moment.t_us))
    };
    let late = (0, 16_300_000);
    assert_eq!(at(15), Some(late));
    let early = at(1).unwrap();
    assert_eq!(early.0, 0);
    assert_eq!(at(99), None);
    // In the run in which the walk stands, and only then in the others.
    assert_eq!(at(1), Some((1, early.1)));
    assert_eq!(at(15), Some(late));
    assert_eq!(at(1), Some(early));
}

#[test]
fn times_beyond_all_sense_are_refused_or_told_as_they_can_be() {
    let mission = mission("patrol");
    let verified = esm_core::verify(mission.blob.as_slice()).unwrap();
    let mut arena = vec![0; verified.arena_words()];
    let machine = Interpreter::new(verified, &mut arena).unwrap();
    let recording = |steps: u64, start_us: u64| {
        let mut records = Bytes::default();
        let mut progress = machine.progress();
        progress.steps = steps;
        let words = machine.state_words();
        write_state(&mut records, true, mission.hash, start_us, &progress, words);
        for _ in 0..3 {
            write_quiet(&mut records, MAX_QUIET);
        }
        Recording::read(&bytes_of(&[
            Frame::Header(Header::default()),
            Frame::Mission {
                name: "patrol".into(),
                blob: mission.blob.clone(),
            },
            Frame::Records(records.0),
        ]))
    };
    for start_us in [u64::MAX, u64::MAX / 2] {
        let refused = recording(0, start_us).unwrap_err();
        assert!(matches!(refused, RecordingError::BadRecords), "{refused}");
    }
    let latest = recording(esm_core::MAX_STEPS, 1 << 62).unwrap();
    let outcome = replay(&latest, false, Some(Vec::new())).unwrap();
    assert!(outcome.transitions > 0);
    let (mut walk, ended) = Walk::new(&latest, false);
    assert!(ended.is_none(), "{ended:?}");
    assert!(walk.forward().is_some());
    assert!(walk.to_time(u64::MAX).is_none());
}

/// Bytes of a file of these frames.
fn bytes_of(frames: &[Frame]) -> Vec<u8> {
    let mut bytes = Vec::new();
    file::write_mark(&mut bytes).unwrap();
    for frame in frames {
        frame.write(&mut bytes).unwrap();
    }
    bytes
}

#[test]
fn a_recording_that_was_broken_off_is_had_again_to_its_last_whole_frame() {
    let made = RUNS[0].made();
    let (bytes, trace) = (made.recording, made.trace);
    let (frames, _) = file::read(&bytes).unwrap();
    let ends: Vec<usize> = (0..=frames.len())
        .map(|count| bytes_of(&frames[..count]).len())
        .collect();
    let mut lines = 0;
    for length in (0..bytes.len()).step_by(7) {
        let whole = ends.iter().rev().find(|end| **end <= length).copied();
        let cut = &bytes[..length];
        // Before the end of the head it is no recording, and before that of the mission there is
        // nothing of it.
        let Ok(recording) = Recording::read(cut) else {
            assert!(length < ends[1], "{length}");
            continue;
        };
        let expected = match whole {
            Some(end) if end == length => FileEnd::Whole,
            end => FileEnd::Cut { at: end.unwrap() },
        };
        assert_eq!(recording.end, expected, "{length}");
        let (part, error) = replayed(cut, false);
        assert!(error.is_none(), "{length}: {error:?}");
        assert!(trace.starts_with(&part), "{length}");
        lines = lines.max(part.lines().count());
    }
    assert!(lines * 2 > trace.lines().count(), "only {lines} lines");
}

#[test]
fn a_byte_that_was_changed_is_told_wherever_it_is() {
    let made = RUNS[0].made();
    let (bytes, trace) = (made.recording, made.trace);
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        match Recording::read(&changed) {
            Ok(recording) => {
                let is_damaged = matches!(recording.end, FileEnd::Damaged { .. });
                assert!(is_damaged, "byte {at}: {:?}", recording.end);
                assert!(recording.entered().is_none(), "byte {at}");
                if at % 11 != 0 {
                    continue;
                }
                // What is left is what was there before the byte.
                let (part, error) = replayed(&changed, true);
                assert!(trace.starts_with(&part), "byte {at}");
                let is_told = matches!(error, Some(ReplayError::Damaged { .. }));
                assert!(is_told, "byte {at}: {error:?}");
                let (_, ended) = Walk::new(&recording, true);
                let is_told = matches!(ended, Some(ReplayError::Damaged { .. }));
                assert!(is_told, "byte {at}: {ended:?}");
            }
            Err(RecordingError::File(_)) => assert!(at < 80, "byte {at}"),
            Err(other) => panic!("byte {at}: {other}"),
        }
    }
}

#[test]
fn what_is_no_recording_of_this_form_is_refused_by_what_it_is() {
    let refused = |bytes: &[u8]| match Recording::read(bytes).unwrap_err() {
        RecordingError::File(error) => error,
        other => panic!("{other}"),
    };
    assert_eq!(
        refused(b"{\"kind\":\"recording\",\"seed\":1}\n"),
        FileError::Json
    );
    assert_eq!(
        refused(b"ESMREC\x03\0"),
        FileError::OtherVersion { found: 3 }
    );
    assert_eq!(refused(b"ESMREC\x01\0"), FileError::Empty);
    assert_eq!(refused(b"mission"), FileError::NoRecording);
    assert_eq!(refused(b""), FileError::NoRecording);
}

#[test]
fn a_recording_whose_mission_is_another_or_none_is_told() {
    let bytes = RUNS[0].made().recording;
    let (frames, _) = file::read(&bytes).unwrap();
    let with = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut frames = frames.clone();
        for frame in &mut frames {
            if let Frame::Mission { blob, .. } = frame {
                change(blob);
            }
        }
        bytes_of(&frames)
    };
    let other = mission("follow_wall").blob;
    let (trace, error) = replayed(&with(&|blob| blob.clone_from(&other)), false);
    assert!(trace.is_empty());
    assert!(
        matches!(error, Some(ReplayError::NoMission { .. })),
        "{error:?}"
    );
    let corrupt = Recording::read(&with(&|blob| blob[40] ^= 1)).unwrap_err();
    assert!(
        matches!(corrupt, RecordingError::BadMission { .. }),
        "{corrupt}"
    );
}

/// Bytes of records.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl RecordSink for Bytes {
    fn put(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

#[test]
fn a_gap_ends_the_replay_and_over_it_the_replay_goes_on_as_the_run_did() {
    const BEFORE: u64 = 300;
    const BEHIND: u64 = 500;
    let made = RUNS[0].made();
    let (bytes, trace) = (made.recording, made.trace);
    let recording = Recording::read(&bytes).unwrap();
    let stretch = &recording.stretches[0];
    let recorded = recording.mission(stretch.mission).unwrap();
    let (frames, _) = file::read(&bytes).unwrap();
    let mut with_gap = frames[..2].to_vec();
    let mut sink = Bytes::default();
    write_started(&mut sink, 0, true, stretch.mission, stretch.start_us);
    let mut arena = vec![0; recorded.verified.arena_words()];
    let mut player = Player::new(recorded, stretch, &mut arena).unwrap();
    let mut inputs = stretch.inputs.iter();
    for step in 0..stretch.made {
        if step == BEFORE {
            with_gap.push(Frame::Records(std::mem::take(&mut sink.0)));
            with_gap.push(Frame::Gap(3));
        }
        if step == BEHIND {
            let (progress, words) = (player.machine().progress(), player.machine().state_words());
            write_state(
                &mut sink,
                true,
                stretch.mission,
                stretch.start_us,
                &progress,
                words,
            );
        }
        player.enter().unwrap();
        let entered = inputs
            .as_slice()
            .first()
            .filter(|input| input.before == step);
        if entered.is_some() {
            inputs.next();
        }
        if !(BEFORE..BEHIND).contains(&step) {
            match entered.map(|input| &input.change) {
                Some(host_tools::recording::Change::Bits(bits)) => {
                    write_changes(&mut sink, 0, bits.iter().copied());
                }
                None => write_quiet(&mut sink, 1),
                other => panic!("{other:?}"),
            }
        }
        player.macro_step(&mut ()).unwrap();
    }
    with_gap.push(Frame::Records(sink.0));
    let bytes = bytes_of(&with_gap);

    let line_of = |step: u64| format!("\"step\":{step},");
    let lines = |keep: &dyn Fn(u64) -> bool| -> String {
        let kept = trace.split_inclusive('\n').filter(|line| {
            let step = line.split("\"step\":").nth(1).unwrap();
            let step = step.split(',').next().unwrap().parse().unwrap();
            assert!(line.contains(&line_of(step)));
            keep(step)
        });
        kept.collect()
    };
    let (part, error) = replayed(&bytes, false);
    assert_lines_equal("up to the gap", &lines(&|step| step < BEFORE), &part);
    match error {
        Some(ReplayError::Gap { after, next, .. }) => {
            assert_eq!((after, next), (BEFORE - 1, BEHIND))
        }
        other => panic!("{other:?}"),
    }
    let (both, error) = replayed(&bytes, true);
    assert!(error.is_none(), "{error:?}");
    let known = lines(&|step| !(BEFORE..BEHIND).contains(&step));
    assert_lines_equal("over the gap", &known, &both);
}

/// The transitions that were taken, and what each macro step showed.
#[derive(Default)]
struct Taken {
    count: u64,
    now: Vec<TransitionTaken>,
    steps: Vec<(Vec<TransitionTaken>, Vec<u32>)>,
}

impl Observer for Taken {
    fn transition(&mut self, taken: TransitionTaken) {
        self.count += 1;
        self.now.push(taken);
    }
}

impl Taken {
    fn step_ended(&mut self, enabled: &[u32]) {
        let taken = std::mem::take(&mut self.now);
        self.steps.push((taken, enabled.to_vec()));
    }
}

#[test]
fn random_machines_under_random_inputs_are_had_again() {
    let mut made = 0;
    let mut changes = 0;
    for seed in 0..60 {
        let mut checked = lang::load_text("random.esm", &machine(seed));
        let Some(schedule) = checked.lay_out(work_limit(Duration::from_secs(5))) else {
            continue;
        };
        let Some(model) = checked.model.as_ref() else {
            continue;
        };
        let verified = esm_core::verify(compile(model, &schedule).unwrap()).unwrap();
        let mission = Mission::new(Path::new("random.esm"), verified).unwrap();
        let verified = esm_core::verify(mission.blob.as_slice()).unwrap();
        let mut arena = vec![0; verified.arena_words()];
        let mut robot = Interpreter::new(verified, &mut arena).unwrap();
        let period_us = mission.directory.interpreter_period_us();
        let mut writer = RecordingWriter::new(Vec::new(), Header::default(), None).unwrap();
        writer
            .mission("random", mission.hash, &mission.blob, period_us)
            .unwrap();
        let mut sink = Bytes::default();
        write_started(&mut sink, 0, true, mission.hash, 0);
        let mut random = Random::new(seed);
        let mut known = robot.input_words().to_vec();
        let (mut quiet, mut taken, mut steps) = (0, Taken::default(), 0);
        for _ in 0..400 {
            if random.chance(15) {
                let bit = random.below(32 * known.len());
                robot.toggle_input(bit);
            }
            let now = robot.input_words();
            let bits: Vec<u32> = (0..32 * known.len() as u32)
                .filter(|bit| {
                    let (word, place) = (*bit as usize / 32, bit % 32);
                    (now[word] ^ known[word]) >> place & 1 != 0
                })
                .collect();
            if bits.is_empty() {
                quiet += 1;
                if quiet == MAX_QUIET {
                    write_quiet(&mut sink, std::mem::take(&mut quiet));
                }
            } else {
                write_changes(&mut sink, std::mem::take(&mut quiet), bits.into_iter());
                changes += 1;
            }
            steps += 1;
            let ended = robot.macro_step(&mut taken);
            taken.step_ended(robot.enabled_words());
            if ended.is_err() {
                break;
            }
            known.copy_from_slice(robot.input_words());
        }
        writer.records(&sink.0).unwrap();
        let (bytes, _) = writer.finish(Some(steps)).unwrap();
        let recording = Recording::read(&bytes).unwrap();
        let stretch = &recording.stretches[0];
        let recorded = &recording.missions[0];
        let mut arena = vec![0; recorded.verified.arena_words()];
        let mut player = Player::new(recorded, stretch, &mut arena).unwrap();
        let mut again = Taken::default();
        while player.enter().unwrap().goes_on && player.machine().fault().is_none() {
            let _ = player.macro_step(&mut again);
            again.step_ended(player.machine().enabled_words());
        }
        let moments = walked(&format!("seed {seed}"), &recording);
        if seed % 6 == 0 {
            assert_what_is_told_is_what_the_machine_was(&format!("seed {seed}"), &recording);
        }
        let told: usize = moments.iter().map(|moment| moment.taken.len()).sum();
        assert_eq!(told as u64, taken.count, "seed {seed}");
        // Flags that made no difference are another matter.
        let machine = player.machine();
        assert_eq!(again.steps, taken.steps, "seed {seed}");
        assert_eq!(
            machine.progress().steps,
            robot.progress().steps,
            "seed {seed}"
        );
        assert_eq!(machine.fault(), robot.fault(), "seed {seed}");
        made += 1;
    }
    assert!(
        made >= 30 && changes > 300,
        "{made} machines, {changes} changes"
    );
}
