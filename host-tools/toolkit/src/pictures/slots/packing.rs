//! The schedule cut into frames, one below the other: what stands in a column recurs, and what is
//! free is seen at once.
//!
//! Where all periods are multiples of a frame, a slot stands at the same place of every frame that
//! it is in; so free rectangles are what another slot could have.

use std::collections::BTreeMap;

use super::super::axis;
use super::{
    Content, FREE, HEADING, INK, MARGIN, MAX_FRAMES, PAPER, QUIET_INK, RIGHT, SMALL, View,
};
use crate::pictures::font::Weight;
use crate::pictures::scene::{Anchor, Scene, Stroke, words};
use crate::timetable::Timetable;

/// The plot begins here: it has no names beside it.
const LEFT: f32 = MARGIN + 62.0;
const PLOT_WIDTH: f32 = RIGHT - LEFT;
/// All frames together are about so high.
const HEIGHT: f32 = 580.0;
const LEAST_ROW: f32 = 9.0;
const MOST_ROW: f32 = 26.0;
/// As many rectangles are drawn, about: fewer frames are shown where they hold more.
const MAX_RECTANGLES: usize = 8_000;
/// The fewest frames that are shown for all that, if there are so many.
const LEAST_FRAMES: u64 = 4;
/// What is narrower becomes one with a neighbour that is nearer than [`TOUCHING`].
const NARROW: f32 = 2.0;
const TOUCHING: f32 = 1.0;
const LEAST_WIDTH: f32 = 0.9;
/// The greatest common divisor is the frame if the shortest period has at most so many of it.
const MOST_DIVISORS: u64 = 4;

/// A slot, or several narrow ones, in one frame: from where to where, in microseconds from the
/// frame's beginning.
type Place = (u64, u64, Content);

/// Draws the view below `top`; gives where it ends.
pub(super) fn draw(view: &View<'_>, top: f32, scene: &mut Scene) -> f32 {
    let (frame_us, reason) = frame(view.timetable());
    let in_window = view.window.length_us / frame_us;
    let per_frame = view.activations.len() as u64 / in_window.max(1) + 1;
    let affordable = (MAX_RECTANGLES as u64 / per_frame).max(LEAST_FRAMES);
    let frames = in_window.min(MAX_FRAMES).min(affordable).max(1);
    let heading = format!(
        "Packing: frames of {}, {reason}, one below the other",
        axis::time(frame_us)
    );
    view.line(
        MARGIN,
        top + 20.0,
        &heading,
        (HEADING, Weight::Bold),
        INK,
        scene,
    );
    let first = view.window.start_us / frame_us;
    let mut note = format!(
        "frame n begins at n × {}. Grey is free: slot 0, and room for slots to grow",
        axis::time(frame_us)
    );
    if frames < in_window {
        note = format!("the first {frames} of the window's {in_window}; {note}");
    }
    view.line(
        LEFT,
        top + 37.0,
        &note,
        (SMALL, Weight::Regular),
        QUIET_INK,
        scene,
    );
    let row = (HEIGHT / frames as f32).clamp(LEAST_ROW, MOST_ROW);
    let top = top + 48.0;
    let bottom = top + frames as f32 * row;
    scene.rectangle([LEFT, top], [PLOT_WIDTH, bottom - top], FREE, None);
    view.time_axis(
        (0, frame_us),
        [LEFT, bottom, bottom + 1.0],
        "time in the frame",
        scene,
    );
    for place in 0..frames {
        let y = top + place as f32 * row;
        if place > 0 {
            scene.line([[LEFT, y], [RIGHT, y]], Stroke::solid(PAPER, 0.5));
        }
        // One number for every two lines' height of rows.
        let step = libm::ceilf(14.0 / row) as u64;
        if place % step.max(1) == 0 {
            let at = [LEFT - 8.0, y + row / 2.0 + 4.0];
            scene.text(words(
                at,
                &(first + place).to_string(),
                SMALL,
                Weight::Regular,
                QUIET_INK,
                Anchor::End,
            ));
        }
    }
    scene.text(words(
        [MARGIN, top + 11.0],
        "frame",
        SMALL,
        Weight::Regular,
        QUIET_INK,
        Anchor::Start,
    ));
    for ((from_us, to_us, content), runs) in places(view, frame_us, first, frames) {
        let x = |us: u64| LEFT + (us as f64 / frame_us as f64) as f32 * PLOT_WIDTH;
        let left = x(from_us);
        let width = (x(to_us) - left).max(LEAST_WIDTH);
        for (from, count) in runs {
            let y = top + from as f32 * row;
            let size = [width, count as f32 * row];
            let edge = (width > 3.0).then_some(Stroke::solid(PAPER, 0.7));
            scene.tooltip(tooltip(
                view,
                (from_us, to_us, content),
                (first + from, count),
            ));
            scene.rectangle([left, y], size, content.fill(), edge);
            if let Some(slot) = content.slot {
                view.number_inside(slot, [left, y], size, scene);
            }
        }
    }
    bottom + 34.0
}

/// Length of a frame in microseconds, and what it is.
fn frame(timetable: &Timetable) -> (u64, &'static str) {
    let (divisor_us, shortest_us) = (
        timetable.common_divisor_us().max(1),
        timetable.frame_us().max(1),
    );
    if divisor_us == shortest_us {
        (shortest_us, "the shortest period, which divides all others")
    } else if shortest_us <= divisor_us.saturating_mul(MOST_DIVISORS) {
        (divisor_us, "the greatest common divisor of the periods")
    } else {
        (
            shortest_us,
            "the shortest period, which does not divide all others",
        )
    }
}

fn tooltip(
    view: &View<'_>,
    (from_us, to_us, content): Place,
    (first, count): (u64, u64),
) -> String {
    let what = match content
        .slot
        .and_then(|slot| view.timetable().slots().get(slot))
    {
        Some(slot) => format!("slot {}", slot.number),
        None => "several slots".to_owned(),
    };
    let frames = if count == 1 {
        format!("frame {first}")
    } else {
        format!("frames {first} to {}", first + count - 1)
    };
    format!("{what}: {from_us} us to {to_us} us of {frames}")
}

/// Where slots are in frames, and in which: runs of frames that follow each other, by their first
/// one, counted from the first that is shown, and their number.
fn places(
    view: &View<'_>,
    frame_us: u64,
    first: u64,
    frames: u64,
) -> BTreeMap<Place, Vec<(u64, u64)>> {
    let mut of_frame: Vec<Vec<Place>> = vec![Vec::new(); usize::try_from(frames).unwrap_or(0)];
    let shown_us = (first * frame_us, (first + frames) * frame_us);
    let near = (f64::from(TOUCHING / PLOT_WIDTH) * frame_us as f64) as u64;
    let narrow = (f64::from(NARROW / PLOT_WIDTH) * frame_us as f64) as u64;
    for one in &view.activations {
        let clip = |us: i64| u64::try_from(us).unwrap_or(0).clamp(shown_us.0, shown_us.1);
        let (mut from_us, to_us) = (clip(one.start_us), clip(one.end_us));
        while from_us < to_us {
            let frame = from_us / frame_us;
            let part_end_us = to_us.min((frame + 1) * frame_us);
            let (from, to) = (from_us - frame * frame_us, part_end_us - frame * frame_us);
            from_us = part_end_us;
            let Some(places) = usize::try_from(frame - first)
                .ok()
                .and_then(|at| of_frame.get_mut(at))
            else {
                continue;
            };
            match places.last_mut() {
                Some(last)
                    if from < last.1 + near && (to - from < narrow || last.1 - last.0 < narrow) =>
                {
                    last.1 = to;
                    last.2 = last.2.and(view.content(one.slot));
                }
                _ => places.push((from, to, view.content(one.slot))),
            }
        }
    }
    let mut runs: BTreeMap<Place, Vec<(u64, u64)>> = BTreeMap::new();
    for (frame, places) in (0..).zip(of_frame) {
        for place in places {
            let runs = runs.entry(place).or_default();
            match runs.last_mut() {
                Some((from, count)) if *from + *count == frame => *count += 1,
                _ => runs.push((frame, 1)),
            }
        }
    }
    runs
}
