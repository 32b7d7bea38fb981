//! What every picture of a schedule promises, and many schedules that are held to it.

use super::*;
use crate::pictures::scene::{Shape, Text};
use crate::samples::timetable;

/// What a text covers: left, top, right, bottom. Letters without tails are lower than their line.
fn area(text: &Text) -> [f32; 4] {
    let width = font::width(&text.words, text.size, text.weight);
    let left = match text.anchor {
        Anchor::Start => text.at[0],
        Anchor::Middle => text.at[0] - width / 2.0,
        Anchor::End => text.at[0] - width,
    };
    [
        left,
        text.at[1] - text.size * 0.72,
        left + width,
        text.at[1] + text.size * 0.2,
    ]
}

/// Everything that is wrong with a picture.
fn violations(scene: &Scene) -> Vec<String> {
    let mut found = Vec::new();
    let mut texts: Vec<([f32; 4], &str)> = scene
        .shapes
        .iter()
        .filter_map(|shape| match shape {
            Shape::Text(text) => Some((area(text), text.words.as_str())),
            _ => None,
        })
        .collect();
    texts.sort_by(|one, other| one.0[1].total_cmp(&other.0[1]));
    let is_outside = |left: f32, top: f32, right: f32, bottom: f32| {
        !(left >= 0.0 && top >= 0.0 && right <= scene.width && bottom <= scene.height)
    };
    for (place, (one, words)) in texts.iter().enumerate() {
        if is_outside(one[0], one[1], one[2], one[3]) {
            found.push(format!("`{words}` leaves the picture"));
        }
        for (other, others) in texts[place + 1..]
            .iter()
            .take_while(|(other, _)| other[1] < one[3])
        {
            if one[0] < other[2] && other[0] < one[2] && one[1] < other[3] {
                found.push(format!("`{words}` and `{others}` overlap"));
            }
        }
    }
    for shape in &scene.shapes {
        if let Shape::Polygon { corners, .. } = shape {
            for [x, y] in corners {
                if is_outside(*x, *y, *x, *y) {
                    found.push(format!("a shape has a corner at {x}, {y}"));
                }
            }
        }
    }
    found
}

fn picture(slots: &[(u32, u32, u32)]) -> SlotPicture {
    SlotPicture {
        title: "Slots of missions/with/a/path/that/is/long/patrol.esm".into(),
        timetable: timetable(slots),
        tasks: BTreeMap::new(),
    }
}

/// Slots one behind the other in a frame, each of which comes in every n-th frame.
fn frames(frame_us: u32, slots: usize, every: &[u32]) -> SlotPicture {
    let duration_us = frame_us * 9 / 10 / slots as u32;
    let of_slot = |slot: usize| {
        (
            slot as u32 * duration_us,
            frame_us * every[slot % every.len()],
            duration_us,
        )
    };
    picture(&(0..slots).map(of_slot).collect::<Vec<_>>())
}

/// Pictures of all kinds, each with what it is.
fn pictures() -> Vec<(&'static str, SlotPicture)> {
    let mut named = picture(&[
        (0, 20_000, 2_000),
        (2_000, 20_000, 4_000),
        (6_000, 40_000, 2_000),
    ]);
    named.tasks.insert(
        2,
        vec![
            "Odometry".into(),
            "a task whose name nobody can write in the room that there is".into(),
        ],
    );
    let primes = [999_983, 999_979, 999_961, 999_959, 999_953, 999_931];
    let primes: Vec<_> = primes
        .iter()
        .zip(0..)
        .map(|(&period, at)| (at * 100_000, period, 90_000))
        .collect();
    vec![
        ("no slots", picture(&[])),
        ("one slot", picture(&[(0, 1, 1)])),
        (
            "the longest slot",
            picture(&[(0, 4_000_000_000, 4_000_000_000)]),
        ),
        ("three slots with names", named),
        (
            "a slot over the end",
            picture(&[
                (500, 10_000, 500),
                (1_000, 10_000, 2_000),
                (36_500, 40_000, 3_900),
            ]),
        ),
        (
            "many rates",
            frames(1_000, 30, &[1, 2, 5, 10, 20, 50, 100, 200, 1_000]),
        ),
        ("no common multiple", picture(&primes)),
        ("two hundred slots", frames(20_000, 200, &[1, 2, 4, 8, 16])),
        (
            "two thousand slots",
            frames(1_000_000, 2_000, &[1, 2, 3, 5, 7, 11, 13, 17, 19, 23, 29]),
        ),
        (
            "as many slots as there may be",
            frames(4_000_000, 4_096, &[1]),
        ),
        (
            "more periods than rows",
            frames(50_000, 400, &(1..80).collect::<Vec<_>>()),
        ),
        (
            "slots that hardly take time",
            picture(&[(0, 1_000, 1), (1, 1_000, 1), (500, 4_000_000_000, 1)]),
        ),
        (
            "rates of a robot",
            picture(&[
                (0, 2_500, 300),
                (300, 10_000, 200),
                (600, 20_000, 200),
                (1_000, 1_000_000, 100),
                (1_200, 12_500, 100),
            ]),
        ),
    ]
}

#[test]
fn words_stand_apart_and_nothing_leaves_the_picture() {
    for (what, picture) in pictures() {
        assert_eq!(violations(&picture.scene()), [""; 0], "{what}");
    }
}

#[test]
fn pictures_stay_small() {
    for (what, picture) in pictures() {
        let scene = picture.scene();
        assert!(scene.height < 2_400.0, "{what}: {} high", scene.height);
        assert!(
            scene.shapes.len() < 60_000,
            "{what}: {} shapes",
            scene.shapes.len()
        );
        assert!(!scene.to_svg().contains("NaN"), "{what}");
    }
}

#[test]
fn every_slot_is_in_the_picture() {
    let number = |shape: &Shape| match shape {
        Shape::Text(text) => text.words.parse::<u32>().ok(),
        _ => None,
    };
    let (_, picture) = pictures().swap_remove(5);
    let shown: std::collections::BTreeSet<u32> =
        picture.scene().shapes.iter().filter_map(number).collect();
    assert!((1..=30).all(|slot| shown.contains(&slot)), "{shown:?}");
}

#[test]
fn bars_of_slots_and_free_time_share_the_window() {
    let (_, picture) = pictures().swap_remove(3);
    let view = View::new(&picture);
    let width = |from: i64, to: i64| view.x(to) - view.x(from);
    let busy: f32 = view
        .activations
        .iter()
        .map(|one| width(one.start_us, one.end_us))
        .sum();
    let free: f32 = view
        .gaps
        .iter()
        .map(|gap| width(gap.start_us as i64, (gap.start_us + gap.length_us) as i64))
        .sum();
    assert!((busy + free - view.width()).abs() < 0.1, "{busy} {free}");
}
