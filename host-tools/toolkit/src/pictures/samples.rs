//! Made-up runs that the tests draw.

use std::collections::BTreeMap;

use super::{
    FloorLine, Leg, Mark, MissionStates, PathPicture, PathSample, RegionStates, Room, SlotPicture,
    StateSpan, Timeline,
};
use crate::samples::timetable;
use crate::world::World;

/// Two missions in a flat of four rooms, with a collision.
pub(super) fn flat() -> PathPicture {
    let room = |name: &str, x0: f32, y0: f32, x1: f32, y1: f32| Room {
        name: name.into(),
        corners: vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
    };
    let rooms = vec![
        room("Kitchen", 0.0, 0.0, 4.0, 3.0),
        room("Workshop", 4.0, 0.0, 10.0, 3.0),
        room("Hall", 0.0, 3.0, 10.0, 4.5),
        room("Library & Stores", 0.0, 4.5, 10.0, 7.0),
    ];
    let mut walls = Vec::new();
    for room in &rooms {
        for (index, from) in room.corners.iter().enumerate() {
            walls.push([*from, room.corners[(index + 1) % room.corners.len()]]);
        }
    }
    // A Lissajous figure is as good a path as any.
    let sample = |tick: u32| {
        let phase = tick as f32 / 400.0;
        PathSample {
            t_us: u64::from(tick) * 50_000,
            x_m: 5.0 + 4.2 * libm::sinf(phase * 1.3),
            y_m: 3.5 + 2.8 * libm::sinf(phase * 2.1 + 0.4),
        }
    };
    PathPicture {
        title: "patrol, then follow_wall, in the flat".into(),
        facts: vec![
            "23.41 m driven".into(),
            "1 collision".into(),
            "4 rooms entered".into(),
        ],
        walls,
        low: Vec::new(),
        rooms,
        lines: vec![FloorLine {
            ends: [[0.5, 3.5], [9.5, 4.0]],
            width_m: 0.02,
        }],
        legs: vec![
            Leg {
                name: "patrol".into(),
                samples: (0..=1200).map(sample).collect(),
            },
            Leg {
                name: "follow_wall".into(),
                samples: (1200..=2400).map(sample).collect(),
            },
        ],
        people: Vec::new(),
        collisions: vec![[9.2, 2.5]],
        robot_radius_m: 0.15,
    }
}

/// A run past people, one of each kind of time.
pub(super) fn visited() -> PathPicture {
    let text = "world visited\nstart 1,1 0\nwall 0,0 4,0 4,3 0,3 0,0\nroom Hall 0,0 4,0 4,3 0,3\n\
         person 1,2.2 0.25\nperson 3,1 0.25 from 2500 ms to 9 s\n\
         person 3.3,2.2 0.4 from 12 s\nperson 2,1.2 0.1 to 4 s";
    let world = World::parse(text).unwrap();
    let sample = |tick: u16| PathSample {
        t_us: u64::from(tick) * 100_000,
        x_m: 1.0 + f32::from(tick.min(50)) / 50.0,
        y_m: 1.0 + f32::from(tick.saturating_sub(50)) / 50.0,
    };
    PathPicture {
        legs: vec![Leg {
            name: "guard".into(),
            samples: (0..=120).map(sample).collect(),
        }],
        robot_radius_m: 0.12,
        ..PathPicture::over(&world)
    }
}

/// Spans of the given states and lengths in milliseconds, one after another.
pub(super) fn spans(start_ms: u64, states: &[(&str, u64)]) -> Vec<StateSpan> {
    let mut at_us = start_ms * 1000;
    let mut spans = Vec::new();
    for (state, length_ms) in states {
        let end_us = at_us + length_ms * 1000;
        spans.push(StateSpan {
            state: (*state).into(),
            start_us: at_us,
            end_us,
        });
        at_us = end_us;
    }
    spans
}

/// Two missions of 60 s each with nested regions, fast changes and marks.
pub(super) fn two_minutes() -> Timeline {
    let region = |path: &str, spans: Vec<StateSpan>| RegionStates {
        path: path.into(),
        spans,
    };
    let flicker: Vec<(&str, u64)> = (0..400)
        .map(|tick| (if tick % 2 == 0 { "Near" } else { "Far" }, 10))
        .collect();
    let mut safety = spans(0, &[("initial", 20), ("Watch", 30_000)]);
    safety.extend(spans(30_020, &flicker));
    safety.extend(spans(34_020, &[("Watch", 25_980)]));
    let turn = [
        ("initial", 10),
        ("Back", 900),
        ("Turn", 2_100),
        ("final", 10),
    ];
    let mut escape = spans(12_000, &turn);
    escape.extend(spans(41_000, &turn));
    let motion = [
        ("initial", 10),
        ("Cruise", 11_990),
        ("Escape", 3_020),
        ("Cruise", 25_980),
        ("Escape", 3_020),
        ("Cruise", 15_980),
    ];
    Timeline {
        title: "States over time: patrol, then follow_wall".into(),
        missions: vec![
            MissionStates {
                name: "patrol".into(),
                start_us: 0,
                end_us: 60_000_000,
                regions: vec![
                    region("motion", spans(0, &motion)),
                    region("motion/Escape/turn", escape),
                    region("safety", safety),
                ],
            },
            MissionStates {
                name: "follow_wall".into(),
                start_us: 60_000_000,
                end_us: 120_000_000,
                regions: vec![region(
                    "motion",
                    spans(
                        60_000,
                        &[
                            ("initial", 10),
                            ("SeekWall", 9_000),
                            ("FollowWall", 45_000),
                            ("TurnCorner", 5_990),
                        ],
                    ),
                )],
            },
        ],
        marks: vec![
            Mark {
                t_us: 59_990_000,
                label: "upload".into(),
            },
            Mark {
                t_us: 60_000_000,
                label: "swap".into(),
            },
            Mark {
                t_us: 97_500_000,
                label: "collision".into(),
            },
        ],
    }
}

/// Four slots, one of which wraps around the end of the hyperperiod.
pub(super) fn four_slots() -> SlotPicture {
    let slots = [
        (500, 10_000, 500),
        (1_000, 10_000, 2_000),
        (3_000, 20_000, 4_000),
        (36_500, 40_000, 3_900),
    ];
    SlotPicture {
        title: "Slots of patrol.esm".into(),
        timetable: timetable(&slots),
        tasks: BTreeMap::from([
            (2, vec!["Odometry".into(), "WheelSpeed".into()]),
            (3, vec!["SonarRing".into()]),
        ]),
    }
}

/// Slots of many rates, whose hyperperiod is too long to be read.
pub(super) fn thirty_slots() -> SlotPicture {
    const EVERY: [u32; 6] = [1, 2, 5, 10, 20, 100];
    // One behind the other in frames of 1 ms.
    let slots: Vec<(u32, u32, u32)> = (0..30_u32)
        .map(|slot| {
            let every = EVERY[slot as usize % EVERY.len()];
            (
                slot * 32 + 1_000 * (slot % every),
                1_000 * every,
                20 + slot % 3 * 5,
            )
        })
        .collect();
    SlotPicture {
        title: "Slots of thirty.esm".into(),
        timetable: timetable(&slots),
        tasks: BTreeMap::new(),
    }
}
