//! What a slot's first task is executed with is found before its time. Whatever happens meanwhile,
//! all is as if it were found at its time.

use esm_link::message::{Request, SafeReason};
use esm_tests::random::Random;

use crate::mission::Mission;
use crate::robot::{Bench, TICKS_PER_US, signature, with_robot};

/// Robots that are tried, each in another way.
const ROBOTS: u64 = 24;
/// What happens to each of them, one after another.
const EVENTS: usize = 40;

/// Interpreter's period and the slots, (period, duration, start) in µs. No slot but the
/// interpreter's starts when that does.
const SLOTS: [[(u32, u32, u32); 3]; 3] = [
    [
        (10_000, 1_000, 0),
        (5_000, 1_000, 2_000),
        (10_000, 500, 4_000),
    ],
    [
        (10_000, 1_000, 0),
        (5_000, 1_000, 2_000),
        (2_500, 300, 1_500),
    ],
    [
        (20_000, 1_000, 0),
        (5_000, 1_000, 3_500),
        (20_000, 500, 9_600),
    ],
];

/// A mission of some of the robot's tasks, which are entered, left, blocked and ended all the time.
/// Answers the interpreter's period, too.
fn mission(random: &mut Random) -> (Vec<u8>, u32) {
    let slots = SLOTS[random.below(SLOTS.len())];
    let mut slot = || 1 + random.below(slots.len()) as u32;
    let (source, sink, first_hog, hog, monitor) = (slot(), slot(), slot(), slot(), slot());
    let second_hog = if random.below(3) == 0 { 0 } else { hog };
    let mut one_of = |choices: &[&'static str]| choices[random.below(choices.len())];
    let source_ends = one_of(&[
        "Count -> Rest [exit]",
        "Count -> Rest [high]",
        "Count -> Count [exit]",
    ]);
    let source_begins = one_of(&["Rest -> Count", "Rest -> Count on Again"]);
    let hog_ends = one_of(&["Long -> Short", "Long -> Short on Again", "Long -> Rest"]);
    let hog_begins = one_of(&["Short -> Long", "Short -> Long on Again", "Rest -> Short"]);
    let other_hog = one_of(&["On -> Off", "On -> Off [busy] / Again", "Off -> On / Again"]);
    let thinker_ends = one_of(&[
        "Think -> Out [exit] / Again",
        "Think -> Out",
        "Think -> Think [good]",
    ]);
    let monitor_ends = one_of(&[
        "Watch -> Rest [overrun]",
        "Watch -> Rest [missed]",
        "Watch -> Watch [overrun]",
    ]);
    let limit = [1, 3, 7][random.below(3)];
    let takes_us = [10, 900, 1_001, 2_600][random.below(4)];
    let allowed = [0, 2, 1_000][random.below(3)];
    let mission = Mission::new(&slots)
        .task(signature::SOURCE, None)
        .task(signature::SINK, None)
        .task(signature::HOG, Some("motion"))
        .task(signature::THINKER, None)
        .task(signature::SLOT_MONITOR, None)
        .region(
            &[("Count", "Source", source, &[limit]), ("Rest", "", 0, &[])],
            &["initial -> Count", source_ends, source_begins],
        )
        .region(
            &[("Read", "Sink", sink, &[1]), ("Rest", "", 0, &[])],
            &[
                "initial -> Read",
                "Read -> Rest [busy]",
                "Rest -> Read on Again",
            ],
        )
        .region(
            &[
                ("Long", "Hog", first_hog, &[takes_us]),
                ("Short", "", 0, &[]),
                ("Rest", "", 0, &[]),
            ],
            &["initial -> Short", hog_ends, hog_begins, "Rest -> Long"],
        )
        .region(
            &[("On", "Hog", second_hog, &[1]), ("Off", "", 0, &[])],
            &["initial -> On", other_hog],
        )
        .region(
            &[("Think", "Thinker", 0, &[]), ("Out", "", 0, &[])],
            &["initial -> Think", thinker_ends, "Out -> Think"],
        )
        .region(
            &[
                ("Watch", "SlotMonitor", monitor, &[allowed]),
                ("Rest", "", 0, &[]),
            ],
            &["initial -> Watch", monitor_ends, "Rest -> Watch"],
        )
        .path((0, 0, 0), (1, 0, 0));
    let mission = match random.below(3) {
        0 => mission.path((4, 0, 1), (1, 0, 0)),
        1 => mission.path((0, 0, 0), (4, 0, 0)),
        _ => mission,
    };
    (mission.blob(), slots[0].0)
}

/// Lets a robot run. Background runs go on just before the interpreter's slot, so that they are
/// noted in it: in other slots, what was ready comes before that.
fn run(robot: &mut Bench<'_, '_, '_>, us: u64, interpreter_period_us: u32) {
    let until_ticks = robot.world.now_us() * TICKS_PER_US + us * TICKS_PER_US;
    loop {
        let next_ticks = robot.timer();
        let last = (robot.board.activations.iter().rev()).find(|activation| activation.interpreter);
        let interpreter_ticks =
            last.map(|last| last.start_ticks + u64::from(interpreter_period_us) * TICKS_PER_US);
        // A run may have no end.
        for _ in 0..5 {
            let _ = interpreter_ticks == Some(next_ticks) && robot.background.poll();
        }
        robot.exchange();
        if next_ticks > until_ticks {
            return robot
                .world
                .pass_us((until_ticks / TICKS_PER_US).saturating_sub(robot.world.now_us()));
        }
        robot
            .world
            .pass_us((next_ticks / TICKS_PER_US).saturating_sub(robot.world.now_us()));
    }
}

/// What a robot has done and told, with everything that the seed brings upon it.
fn told(seed: u64, uses_what_is_ready: bool) -> Vec<String> {
    let mut told = vec![];
    with_robot(|robot| {
        let random = &mut Random::new(seed);
        robot.uses_what_is_ready = uses_what_is_ready;
        robot.background_runs = false;
        let subscribe = Request::Subscribe {
            trace: true,
            log: false,
            record: false,
        };
        told.push(format!("{:?}", robot.ask(subscribe)));
        let (blob, mut period_us) = mission(random);
        told.push(format!("{:?}", robot.upload(&blob)));
        for _ in 0..EVENTS {
            run(robot, random.below(30_000) as u64, period_us);
            let event = match random.below(16) {
                0..=4 => String::from("late"),
                5 => format!("{:?}", robot.ask(Request::Stop)),
                6..=8 => format!("{:?}", robot.ask(Request::Start)),
                9 | 10 => {
                    let (blob, period) = mission(random);
                    period_us = period;
                    format!("{:?}", robot.upload(&blob))
                }
                11 => {
                    robot.board.body = Err(SafeReason::BodyLost);
                    String::from("body lost")
                }
                12 => {
                    robot
                        .real_time
                        .fail_safe(&mut robot.board, SafeReason::Board);
                    String::from("fail-safe")
                }
                // The timer comes early, and more than once.
                _ => format!("{:?}", [robot.timer(), robot.timer()]),
            };
            told.push(event);
            // The timer comes late, whatever is due. Letters that have come are taken before.
            robot.world.pass_us(random.below(12_000) as u64);
            run(robot, 0, period_us);
            robot.board.body = Ok(());
            told.append(&mut robot.world.said());
            told.append(&mut robot.trace);
            told.push(format!(
                "{:?}",
                std::mem::take(&mut robot.board.activations).last()
            ));
            told.push(format!("{:?}", robot.status()));
            for slot in 0..4 {
                told.push(format!("{:?}", robot.ask(Request::SlotCounters { slot })));
            }
            for task_instance in 0..6 {
                told.push(format!(
                    "{:?}",
                    robot.ask(Request::TaskCounters { task_instance })
                ));
            }
        }
    });
    told
}

#[test]
fn what_is_made_ready_before_its_time_is_right_at_its_time() {
    for seed in 0..ROBOTS {
        let (ready, anew) = (told(seed, true), told(seed, false));
        let differs = ready
            .iter()
            .zip(&anew)
            .position(|(ready, anew)| ready != anew);
        if let Some(at) = differs {
            let before = at.saturating_sub(12);
            panic!(
                "seed {seed}: ready {:#?}, looked up anew {:#?}",
                &ready[before..=at],
                &anew[before..=at]
            );
        }
        assert_eq!(ready.len(), anew.len(), "seed {seed}");
    }
}
