//! A row for each slot, or for the slots of a period where there are many, and one for what is
//! free.

use super::super::axis;
use super::{
    BAND, Content, FREE, GRID, HEADING, INK, MARGIN, MAX_ROWS, PAPER, QUIET_INK, RIGHT, SMALL,
    TEXT, View,
};
use crate::pictures::bars::{Bar, LEAST_BAR, bars};
use crate::pictures::font::{self, Weight};
use crate::pictures::scene::{Anchor, Scene, Stroke, words};
use crate::timetable::{Activation, Extent, Row};

const ROW: f32 = 23.0;
const BAR: f32 = 17.0;
/// Gaps that are narrower are not drawn.
const LEAST_GAP: f32 = 0.3;
/// Right ends of the columns of numbers.
const NUMBER: f32 = MARGIN + 30.0;
const PERIOD: f32 = MARGIN + 92.0;
const DURATION: f32 = MARGIN + 158.0;
/// Where names begin.
const NAMES: f32 = DURATION + 14.0;

/// Draws the chart below `top`; gives where it ends.
pub(super) fn draw(view: &View<'_>, top: f32, scene: &mut Scene) -> f32 {
    let is_grouped = view.timetable().slots().len() > MAX_ROWS;
    let rows = view.timetable().rows(MAX_ROWS);
    view.line(
        MARGIN,
        top + 20.0,
        &heading(view),
        (HEADING, Weight::Bold),
        INK,
        scene,
    );
    if is_grouped {
        let note = "slots of one period share a row; occurrences that are too narrow to be told apart are one bar";
        view.line(
            view.left,
            top + 37.0,
            note,
            (SMALL, Weight::Regular),
            QUIET_INK,
            scene,
        );
    }
    let titles = if is_grouped {
        ["slots", "period", "load", "numbers"]
    } else {
        ["slot", "period", "duration", "tasks"]
    };
    let names = if view.left > NAMES + 30.0 {
        titles[3]
    } else {
        ""
    };
    columns(
        view,
        top + 37.0,
        [titles[0], titles[1], titles[2], names],
        Weight::Regular,
        scene,
    );
    let top = top + 45.0;
    let bottom = top + (rows.len() + 1) as f32 * ROW;
    for place in 0..=rows.len() {
        let y = top + place as f32 * ROW;
        scene.rectangle([view.left, y], [view.width(), BAR], BAND, None);
    }
    view.time_axis(
        (view.window.start_us, view.window.end_us()),
        [view.left, top - 3.0, bottom],
        "time",
        scene,
    );
    let mut of_row = vec![0; view.timetable().slots().len()];
    for (place, row) in rows.iter().enumerate() {
        for &slot in &row.slots {
            if let Some(of_row) = of_row.get_mut(slot) {
                *of_row = place;
            }
        }
    }
    let mut in_rows: Vec<Vec<Activation>> = vec![Vec::new(); rows.len()];
    for one in &view.activations {
        if let Some(row) = of_row.get(one.slot).and_then(|&row| in_rows.get_mut(row)) {
            row.push(*one);
        }
    }
    for (place, (row, activations)) in rows.iter().zip(&in_rows).enumerate() {
        let y = top + place as f32 * ROW;
        let heads = heads(view, row);
        columns(
            view,
            y + 13.0,
            heads.each_ref().map(String::as_str),
            Weight::Bold,
            scene,
        );
        if activations.is_empty() {
            absent(view, row, y, scene);
        }
        for bar in bars(activations, |t_us| view.x(t_us), RIGHT + LEAST_BAR) {
            paint(view, &bar, y, scene);
        }
    }
    free(view, bottom - ROW, scene);
    bottom + 34.0
}

fn heading(view: &View<'_>) -> String {
    let (from_us, to_us) = (view.window.start_us, view.window.end_us());
    match view.window.extent {
        Extent::Hyperperiod => "Slots over one hyperperiod".to_owned(),
        _ => format!(
            "Slots from {} to {}, the busiest window",
            axis::time(from_us),
            axis::time(to_us)
        ),
    }
}

/// What stands left of a row, from left to right.
fn heads(view: &View<'_>, row: &Row) -> [String; 4] {
    let slots = view.timetable().slots();
    let timed = || row.slots.iter().filter_map(|&slot| slots.get(slot));
    let period = row
        .period_us
        .map_or_else(|| "longer".to_owned(), |us| axis::time(us.into()));
    if slots.len() <= MAX_ROWS
        && let Some(slot) = timed().next()
    {
        let names = view.picture.tasks.get(&slot.number);
        return [
            slot.number.to_string(),
            period,
            axis::time(slot.duration_us.into()),
            names.map_or_else(String::new, |names| names.join(", ")),
        ];
    }
    let load: f64 = timed()
        .map(|slot| f64::from(slot.duration_us) / f64::from(slot.period_us))
        .sum();
    let numbers: Vec<String> = timed().map(|slot| slot.number.to_string()).collect();
    [
        row.slots.len().to_string(),
        period,
        format!("{:.1} %", load * 100.0),
        numbers.join(", "),
    ]
}

/// What stands left of a row.
fn columns(
    view: &View<'_>,
    base: f32,
    [number, period, duration, names]: [&str; 4],
    weight: Weight,
    scene: &mut Scene,
) {
    let ink = if weight == Weight::Bold {
        INK
    } else {
        QUIET_INK
    };
    let size = if weight == Weight::Bold { TEXT } else { SMALL };
    let mut cell = |right: f32, room: f32, text: &str, weight: Weight| {
        if let Some(text) = font::fitted(text, room, size, weight) {
            scene.text(words([right, base], &text, size, weight, ink, Anchor::End));
        }
    };
    cell(NUMBER, NUMBER - 4.0, number, weight);
    cell(PERIOD, PERIOD - NUMBER - 6.0, period, Weight::Regular);
    cell(DURATION, DURATION - PERIOD - 6.0, duration, Weight::Regular);
    let room = view.left - 12.0 - NAMES;
    if room > 0.0
        && !names.is_empty()
        && let Some(text) = font::fitted(names, room, SMALL, Weight::Regular)
    {
        scene.text(words(
            [NAMES, base],
            &text,
            SMALL,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
    }
}

/// Says when the slots of an empty row occur.
fn absent(view: &View<'_>, row: &Row, y: f32, scene: &mut Scene) {
    let slots = view.timetable().slots();
    let note = match row.slots.as_slice() {
        [slot] => slots.get(*slot).map(|slot| {
            format!(
                "not in this window: at {} and every {}",
                axis::time(slot.start_us.into()),
                axis::time(slot.period_us.into())
            )
        }),
        _ => Some("not in this window".to_owned()),
    };
    if let Some(note) = note {
        view.line(
            view.left + 6.0,
            y + 12.5,
            &note,
            (SMALL, Weight::Regular),
            QUIET_INK,
            scene,
        );
    }
}

fn paint(view: &View<'_>, bar: &Bar<'_>, y: f32, scene: &mut Scene) {
    let [from_us, to_us] = bar.ends_us();
    let contents = bar.activations.iter().map(|one| view.content(one.slot));
    let Some((content, first)) = contents.reduce(Content::and).zip(bar.activations.first()) else {
        return;
    };
    let count = bar.activations.len();
    let name = |slot: usize| {
        view.timetable()
            .slots()
            .get(slot)
            .map_or(0, |slot| slot.number)
    };
    scene.tooltip(match content.slot {
        Some(slot) if count == 1 => {
            format!(
                "slot {}, occurrence {}: {from_us} us to {to_us} us",
                name(slot),
                first.number
            )
        }
        Some(slot) => format!(
            "slot {}, {} occurrences: {from_us} us to {to_us} us",
            name(slot),
            count
        ),
        None => format!("{count} occurrences: {from_us} us to {to_us} us"),
    });
    let colour = content.fill();
    let size = [bar.right - bar.left, BAR];
    // A thin edge keeps neighbours apart.
    let edge = (size[0] > 4.0).then_some(Stroke::solid(PAPER, 0.6));
    scene.rectangle([bar.left, y], size, colour, edge);
    if let Some(slot) = content.slot {
        view.number_inside(slot, [bar.left, y], size, scene);
    }
}

/// What is left for slot 0, with the length of the gaps that have room for it.
fn free(view: &View<'_>, y: f32, scene: &mut Scene) {
    let length_us = view.window.length_us.max(1);
    let free_us = length_us.saturating_sub(view.window.busy_us);
    let share = format!("{:.1} %", free_us as f64 / length_us as f64 * 100.0);
    columns(
        view,
        y + 13.0,
        ["0", "free", &share, ""],
        Weight::Bold,
        scene,
    );
    scene.line(
        [[MARGIN, y - 3.0], [RIGHT, y - 3.0]],
        Stroke::solid(GRID, 1.0),
    );
    for gap in &view.gaps {
        let signed = |us: u64| i64::try_from(us).unwrap_or(i64::MAX);
        let (left, right) = (
            view.x(signed(gap.start_us)),
            view.x(signed(gap.start_us.saturating_add(gap.length_us))),
        );
        if right - left < LEAST_GAP {
            continue;
        }
        let length = axis::time(gap.length_us);
        scene.tooltip(format!(
            "free: {} us from {} us",
            gap.length_us, gap.start_us
        ));
        scene.rectangle([left, y], [right - left, BAR], FREE, None);
        if font::width(&length, SMALL, Weight::Regular) + 6.0 <= right - left {
            let at = [(left + right) / 2.0, y + 12.5];
            scene.text(words(
                at,
                &length,
                SMALL,
                Weight::Regular,
                INK,
                Anchor::Middle,
            ));
        }
    }
}
