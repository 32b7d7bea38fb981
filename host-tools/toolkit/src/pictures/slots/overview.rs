//! How busy the schedule is over time, and where in it the window is that is shown large.

use super::super::axis;
use super::{FREE, GRID, HEADING, INK, MARGIN, QUIET_INK, RIGHT, SMALL, View};
use crate::pictures::font::Weight;
use crate::pictures::scene::{Anchor, Colour, Scene, Shape, Stroke, words};

const HEIGHT: f32 = 64.0;
/// A column of the strip is at least so wide.
const LEAST_COLUMN: f32 = 1.5;
const MEAN: Colour = Colour::opaque(0x3d4e8a);
const PEAK: Colour = Colour::opaque(0xb9c2dd);

/// Draws the strip below `top`; gives where it ends.
pub(super) fn draw(view: &View<'_>, top: f32, scene: &mut Scene) -> f32 {
    let timetable = view.timetable();
    let frame_us = timetable.frame_us().max(1);
    let loads = timetable.loads_us(view.window.length_us / frame_us);
    let shown_us = loads.len() as u64 * frame_us;
    let most = (view.width() / LEAST_COLUMN) as usize;
    let columns = loads.len().min(most).max(1);
    let is_exact = columns == loads.len();
    let heading = format!("Load {}", stretch(view, shown_us));
    view.line(
        MARGIN,
        top + 20.0,
        &heading,
        (HEADING, Weight::Bold),
        INK,
        scene,
    );
    let legend = if is_exact {
        format!("each column is a frame of {}", axis::time(frame_us))
    } else {
        format!(
            "dark: mean, light: busiest frame of {}",
            axis::time(frame_us)
        )
    };
    view.line(
        MARGIN,
        top + 37.0,
        &legend,
        (SMALL, Weight::Regular),
        QUIET_INK,
        scene,
    );
    let (top, bottom) = (top + 48.0, top + 48.0 + HEIGHT);
    view.time_axis((0, shown_us), [view.left, top, bottom], "time", scene);
    for (percent, y) in [
        ("100 %", top),
        ("50 %", top + HEIGHT / 2.0),
        ("0 %", bottom),
    ] {
        scene.line([[view.left, y], [RIGHT, y]], Stroke::solid(GRID, 1.0));
        scene.text(words(
            [view.left - 8.0, y + 4.0],
            percent,
            SMALL,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }
    let of_column = |column: usize| {
        let from = column * loads.len() / columns;
        let to = ((column + 1) * loads.len() / columns).max(from + 1);
        loads.get(from..to.min(loads.len())).unwrap_or(&[])
    };
    let peak = |loads: &[u64]| loads.iter().copied().max().unwrap_or(0) as f64;
    let mean = |loads: &[u64]| loads.iter().sum::<u64>() as f64 / loads.len().max(1) as f64;
    let mut outline = |colour: Colour, height: &dyn Fn(&[u64]) -> f64| {
        let mut corners = vec![[view.left, bottom]];
        for column in 0..columns {
            let x = |column: usize| view.left + column as f32 / columns as f32 * view.width();
            let y = bottom - (height(of_column(column)) / frame_us as f64) as f32 * HEIGHT;
            corners.extend([[x(column), y], [x(column + 1), y]]);
        }
        corners.push([RIGHT, bottom]);
        scene.shapes.push(Shape::Polygon {
            corners,
            fill: Some(colour),
            stroke: None,
        });
    };
    if !is_exact {
        outline(PEAK, &peak);
    }
    outline(MEAN, &mean);
    // The window may go on over the end of a hyperperiod, at its beginning.
    let x =
        |us: u64| view.left + (us as f64 / shown_us.max(1) as f64).min(1.0) as f32 * view.width();
    let mut ends = vec![(view.window.start_us, view.window.end_us().min(shown_us))];
    if view.window.end_us() > shown_us {
        ends.push((0, view.window.end_us() - shown_us));
    }
    for (from_us, to_us) in ends {
        let (left, right) = (x(from_us), x(to_us).max(x(from_us) + 2.0));
        scene.tooltip("what is shown below");
        let frame = Stroke::solid(INK, 1.6);
        scene.rectangle(
            [left, top - 4.0],
            [right - left, HEIGHT + 8.0],
            FREE.with_alpha(40),
            Some(frame),
        );
    }
    bottom + 34.0
}

/// Of what it is the load.
fn stretch(view: &View<'_>, shown_us: u64) -> String {
    match view.timetable().hyperperiod_us() {
        Some(us) if us == shown_us => format!("over the hyperperiod of {}", axis::time(us)),
        Some(us) => format!(
            "over the first {} of a hyperperiod of {}",
            axis::time(shown_us),
            axis::time(us)
        ),
        None => format!(
            "over the first {} of a hyperperiod of more than 64 bits",
            axis::time(shown_us)
        ),
    }
}
