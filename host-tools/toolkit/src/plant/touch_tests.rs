//! Encounters that are staged: a robot drives, somebody steps in, and the oracle says whether the
//! touch could have been avoided.

use rt_firmware::body::Actuators;

use super::*;
use crate::world::Point;

/// When the person steps in, in microseconds.
const FROM_US: u64 = 2_000_000;

/// Radius of the person, in metres.
const RADIUS_M: f64 = 0.25;

/// Part of full duty at which the robots drive: about 0.3 m/s.
const DUTY: i16 = 500;

/// For how long, in milliseconds, and with which duties of both wheels.
type Leg = (u64, i16, i16);

const AHEAD: Leg = (6_000, DUTY, DUTY);
const BACK: Leg = (1_000, -DUTY, -DUTY);
const STAND: Leg = (1_000, 0, 0);

/// A long room, with this line more. The robot looks along it.
fn room(person: &str) -> Plant {
    let world = World::parse(&format!(
        "world room\nstart 1,2 0\nwall 0,0 9,0 9,4 0,4 0,0\n{person}"
    ));
    Plant::new(world.unwrap(), BodyParameters::default(), 1).unwrap()
}

fn drive(plant: &mut Plant, legs: &[Leg]) {
    for (duration_ms, left_duty, right_duty) in legs {
        let end_us = plant.now_us() + duration_ms * 1_000;
        plant.apply(&Actuators {
            left_duty: *left_duty,
            right_duty: *right_duty,
            ..Actuators::default()
        });
        plant.advance_to(end_us);
    }
}

/// An encounter on stage.
struct Staged {
    what: &'static str,
    /// What the robot does before somebody steps in, for two seconds in all.
    before: &'static [Leg],
    /// How far ahead of the rim the person stands then, and to the left of it: in metres.
    ahead_m: f64,
    left_m: f64,
    /// What the robot does then.
    then: &'static [Leg],
    /// Whether each touch could have been avoided.
    avoidable: &'static [bool],
}

/// The robots need 0.06 m to react, and as much to brake.
const STAGED: [Staged; 8] = [
    Staged {
        what: "steps in too near",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: 0.05,
        left_m: 0.0,
        then: &[AHEAD],
        avoidable: &[false],
    },
    Staged {
        what: "steps in farther than the needed way",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: 0.15,
        left_m: 0.0,
        then: &[AHEAD],
        avoidable: &[true],
    },
    Staged {
        what: "steps in too near; the robot backs off and drives into that person again",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: 0.05,
        left_m: 0.0,
        then: &[(1_000, DUTY, DUTY), BACK, AHEAD],
        avoidable: &[false, true],
    },
    Staged {
        what: "steps in too near; the robot stands in time, and drives on",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: 0.05,
        left_m: 0.0,
        then: &[STAND, AHEAD],
        avoidable: &[true],
    },
    Staged {
        what: "steps in before a robot that stands, which drives off",
        before: &[(1_000, DUTY, DUTY), STAND],
        ahead_m: 0.05,
        left_m: 0.0,
        then: &[STAND, AHEAD],
        avoidable: &[true],
    },
    Staged {
        what: "steps in beside the way, and the robot turns towards that person",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: 0.2,
        left_m: 0.5,
        then: &[(420, -DUTY, DUTY), AHEAD],
        avoidable: &[true],
    },
    Staged {
        what: "steps in too near behind a robot that backs up",
        before: &[(500, DUTY, DUTY), (1_500, -DUTY, -DUTY)],
        ahead_m: -0.24 - 2.0 * RADIUS_M - 0.04,
        left_m: 0.0,
        then: &[BACK],
        avoidable: &[false],
    },
    Staged {
        what: "would step into the robot, waits, and steps in behind it; nobody is touched",
        before: &[(2_000, DUTY, DUTY)],
        ahead_m: -0.3,
        left_m: 0.0,
        then: &[AHEAD],
        avoidable: &[],
    },
];

#[test]
fn an_encounter_is_judged_by_the_way_that_was_free_and_the_way_that_was_needed() {
    for Staged {
        what,
        before,
        ahead_m,
        left_m,
        then,
        avoidable,
    } in STAGED
    {
        let mut alone = room("");
        drive(&mut alone, before);
        assert_eq!(alone.now_us(), FROM_US, "{what}");
        let BodyPose {
            position: Point { x_m, y_m },
            heading_rad,
        } = alone.pose();
        let (sin, cos) = libm::sincos(heading_rad);
        let far_m = alone.body().radius_m + RADIUS_M + ahead_m;
        let mut plant = room(&format!(
            "person {:.6},{:.6} {RADIUS_M} from 2 s",
            x_m + far_m * cos - left_m * sin,
            y_m + far_m * sin + left_m * cos
        ));
        drive(&mut plant, before);
        drive(&mut plant, then);
        let touches = plant.statistics().touches();
        let judged: Vec<bool> = touches.iter().map(|touch| touch.avoidable).collect();
        assert_eq!(judged, avoidable, "{what}: {touches:#?}");
        let counted = avoidable.iter().filter(|avoidable| **avoidable).count();
        assert_eq!(plant.statistics().avoidable(), counted as u32, "{what}");
        assert_eq!(plant.collisions(), avoidable.len() as u32, "{what}");
        for touch in touches {
            assert_eq!(touch.touched, Touched::Person { line: 4 }, "{what}");
            let encounter = touch.encounter.unwrap();
            assert_eq!(encounter.t_us, FROM_US, "{what}");
            let gap_m = match left_m == 0.0 {
                true if ahead_m > 0.0 => Some(ahead_m),
                true => Some(-ahead_m - 0.24 - 2.0 * RADIUS_M),
                false => None,
            };
            // A robot that stands has no way to go.
            let gap_m = gap_m.filter(|_| encounter.speed_m_per_s > 0.1);
            match (encounter.free_m, gap_m) {
                (Some(free_m), Some(gap_m)) => {
                    assert!((free_m - gap_m).abs() < 0.002, "{what}: {free_m}");
                }
                (free_m, gap_m) => assert_eq!(free_m, gap_m, "{what}"),
            }
        }
    }
}

#[test]
fn walls_and_people_who_were_there_from_the_start_could_have_been_avoided() {
    for (person, touched) in [
        ("", Touched::Wall),
        ("person 2,2 0.25", Touched::Person { line: 4 }),
    ] {
        let mut plant = room(person);
        for _ in 0..10 {
            drive(&mut plant, &[AHEAD]);
        }
        let [touch] = plant.statistics().touches() else {
            panic!("one touch: {:?}", plant.statistics().touches());
        };
        assert_eq!(touch.touched, touched);
        assert_eq!(touch.encounter, None);
        assert!(touch.avoidable);
        let Point { x_m, y_m } = touch.place;
        let apart_m = match touched {
            Touched::Wall => x_m.min(y_m).min(9.0 - x_m).min(4.0 - y_m),
            Touched::Low => unreachable!("this world has nothing low"),
            Touched::Person { .. } => plant.world().people[0].circle.distance_m(touch.place),
        };
        assert!((apart_m - plant.body().radius_m).abs() < 0.001, "{touch:?}");
        assert!((0.2..0.4).contains(&touch.speed_m_per_s), "{touch:?}");
        assert!(
            (1_000_000..plant.now_us()).contains(&touch.t_us),
            "{touch:?}"
        );
    }
}
