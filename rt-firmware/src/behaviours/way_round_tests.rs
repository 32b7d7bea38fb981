//! Tests of [`WayRound`].

use core::f32::consts::PI;

use super::way_round::WayRound;
use crate::behaviours::{BehaviourList, GoTo, TurnTo};
use crate::tasks::{Bearing, Bearings, Pose, Ranges, Twist};
use crate::{Step, TaskBench};

/// Ranges of a ring in which these are dead.
fn dead(sonars: &[u8]) -> Ranges {
    let mut ranges = Ranges::FREE;
    for sonar in sonars {
        ranges.dead |= 1 << sonar;
        ranges.range_m[usize::from(*sonar)] = 0.0;
    }
    ranges
}

#[test]
fn it_turns_around_where_that_shows_it_more_of_what_it_needs_to_see() {
    let doors = Bearings::FRONT.with(Bearings::of(&[Bearing::Left]));
    for (lost, needs, turns) in [
        (&[][..], Bearings::FRONT, false),
        (&[0], Bearings::FRONT, true),
        (&[1], Bearings::FRONT, true),
        (&[7], Bearings::FRONT, true),
        (&[2], Bearings::FRONT, false),
        (&[4], Bearings::FRONT, false),
        (&[2], doors, true),
        (&[6], doors, false),
        // Neither end sees all: it stands, where it did before.
        (&[0, 4], Bearings::FRONT, false),
        (&[0, 1, 4], Bearings::FRONT, true),
        (&[0], Bearings::NONE, false),
    ] {
        let mut way_round = WayRound::FORWARDS;
        let twist = way_round.turn_around(&Pose::START, Some(&dead(lost)), || Some(needs));
        assert_eq!(twist.is_some(), turns, "{lost:?} {needs:?}");
    }
    // Nobody drives with an end ahead at which there is no sonar.
    let mut ahead_alone = dead(&[0]);
    ahead_alone.sonars = 1;
    let mut way_round = WayRound::FORWARDS;
    let twist = way_round.turn_around(&Pose::START, Some(&ahead_alone), || Some(Bearings::FRONT));
    assert_eq!(twist, None);
}

#[test]
fn what_the_laws_see_is_the_same_before_and_after() {
    const PERIOD_S: f32 = 0.02;
    let start = Pose {
        x_m: 1.0,
        y_m: -2.0,
        heading_rad: 2.5,
    };
    let (mut pose, mut way_round, mut turned_s) = (start, WayRound::FORWARDS, 0.0);
    let ranges = dead(&[0]);
    loop {
        let mut room = None;
        let seen = way_round.ranges(Some(&ranges), &mut room);
        let Some(twist) = way_round.turn_around(&pose, seen, || Some(Bearings::FRONT)) else {
            break;
        };
        pose = pose.rotate(twist.turn_rad_per_s * PERIOD_S);
        turned_s += PERIOD_S;
        assert!(turned_s < 10.0, "{pose:?}");
    }
    assert!(way_round.is_reversed());
    let seen = way_round.pose(pose);
    assert!(
        (seen.heading_rad - start.heading_rad).abs() < 0.021,
        "{seen:?}"
    );
    assert_eq!((seen.x_m, seen.y_m), (start.x_m, start.y_m));
    let ahead = Twist {
        forward_m_per_s: 0.2,
        turn_rad_per_s: 0.1,
    };
    let back = Twist {
        forward_m_per_s: -0.2,
        turn_rad_per_s: 0.1,
    };
    assert_eq!(way_round.twist(ahead), back);
    let mut room = None;
    let seen = way_round.ranges(Some(&ranges), &mut room).unwrap();
    assert_eq!((seen.ahead_m(), seen.behind_m()), (Ranges::FAR_M, 0.0));
    // Whose front must be ahead turns back, whatever it sees.
    assert!(way_round.is_to_change(Some(seen), || None));
    assert!(!WayRound::FORWARDS.is_to_change(Some(&ranges), || None));
}

#[test]
fn a_behaviour_that_has_lost_its_front_turns_around_and_goes_on_with_its_back_ahead() {
    const PERIOD_US: u32 = 20_000;
    let mut bench = TaskBench::new(GoTo::default());
    bench
        .period_us(PERIOD_US)
        .param(GoTo::X_M, 1.0)
        .param(GoTo::SPEED_M_PER_S, 0.25)
        .give(GoTo::LIST, BehaviourList::EMPTY)
        .give(GoTo::RANGES, Ranges::FREE);
    let mut pose = Pose::START;
    let mut turned_rad = 0.0_f32;
    for step in 0..1_000 {
        if step == 50 {
            bench.give(GoTo::RANGES, dead(&[0]));
        }
        bench.give(GoTo::POSE, pose);
        if bench.step() == Some(Step::Finished) {
            break;
        }
        let mut list: BehaviourList = bench.output(GoTo::LIST).unwrap();
        let twist = list.take_asked();
        list.look();
        bench.give(GoTo::LIST, list);
        let period_s = PERIOD_US as f32 * 1e-6;
        turned_rad += twist.turn_rad_per_s * period_s;
        pose = (pose.translate(twist.forward_m_per_s * period_s, 0.0))
            .rotate(twist.turn_rad_per_s * period_s);
    }
    assert!(!bench.flag(GoTo::FAILED));
    assert!(
        (pose.x_m - 1.0).abs() < 0.04 && pose.y_m.abs() < 0.04,
        "{pose:?}"
    );
    assert!((turned_rad.abs() - PI).abs() < 0.1, "{turned_rad}");
}

#[test]
fn who_only_turns_does_not_turn_around_for_it() {
    let mut bench = TaskBench::new(TurnTo::default());
    bench
        .give(TurnTo::LIST, BehaviourList::EMPTY)
        .give(TurnTo::POSE, Pose::START)
        .give(TurnTo::RANGES, dead(&[0]));
    bench.step();
    let list: BehaviourList = bench.output(TurnTo::LIST).unwrap();
    assert_eq!(list.way_round, WayRound::FORWARDS);
}
