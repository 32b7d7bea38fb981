//! Numbers over time: one panel a quantity, one curve a number.

use std::collections::BTreeMap;

use super::axis;
use super::font::{self, Weight};
use super::palette::{GRID, INK, QUIET_INK};
use super::scene::{Anchor, Colour, Scene, Stroke, words};
use super::timeline::{EDGE, PLOT_WIDTH};

/// Columns that a curve is drawn in: what lies in one is drawn as its least and greatest number.
const COLUMNS: u64 = 880;

/// Columns without a number behind which a curve is broken, where numbers come more often before
/// and behind.
const BREAK_COLUMNS: u64 = 4;

/// Panels over one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curves {
    /// The panels, from the top.
    pub panels: Vec<Panel>,
    /// End of the time axis, which begins at 0.
    pub end_us: u64,
}

/// A quantity over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// Heading.
    pub title: String,
    /// What is written at the axis: the unit.
    pub unit: String,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// A number over time, as far as a picture can show it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Its name.
    pub name: String,
    end_us: u64,
    columns: BTreeMap<u64, Column>,
    /// Longest time between two numbers that are both there, in columns.
    count: u64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Column {
    first: f32,
    least: f32,
    greatest: f32,
    last: f32,
}

impl Curve {
    /// A curve without numbers yet, over a time axis that ends then.
    pub fn new(name: String, end_us: u64) -> Self {
        Curve {
            name,
            end_us: end_us.max(1),
            columns: BTreeMap::new(),
            count: 0,
        }
    }

    /// Adds a number. Times come in any order; what is not finite is left out.
    pub fn add(&mut self, t_us: u64, value: f32) {
        if !value.is_finite() || t_us > self.end_us {
            return;
        }
        self.count += 1;
        let column = u128::from(t_us) * u128::from(COLUMNS) / u128::from(self.end_us);
        let new = Column {
            first: value,
            least: value,
            greatest: value,
            last: value,
        };
        (self.columns.entry(column as u64))
            .and_modify(|column| {
                column.least = column.least.min(value);
                column.greatest = column.greatest.max(value);
                column.last = value;
            })
            .or_insert(new);
    }

    /// How many numbers it has.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The least and the greatest number, if it has any.
    pub fn extent(&self) -> Option<(f32, f32)> {
        let least = self.columns.values().map(|column| column.least);
        let greatest = self.columns.values().map(|column| column.greatest);
        Some((least.reduce(f32::min)?, greatest.reduce(f32::max)?))
    }

    /// The pieces of the curve, as places in columns and numbers.
    fn pieces(&self) -> Vec<Vec<(f32, f32)>> {
        // Where numbers are rarer than columns, as many as usual lie between two.
        let usual = COLUMNS / self.count.clamp(1, COLUMNS);
        let longest = usual.saturating_mul(BREAK_COLUMNS).max(BREAK_COLUMNS);
        let mut pieces: Vec<Vec<(f32, f32)>> = Vec::new();
        let mut before = None;
        for (place, column) in &self.columns {
            let is_broken = before.is_none_or(|before| place - before > longest);
            before = Some(*place);
            if is_broken {
                pieces.push(Vec::new());
            }
            let Some(piece) = pieces.last_mut() else {
                continue;
            };
            let x = *place as f32;
            piece.push((x, column.first));
            if column.least < column.greatest {
                piece.extend([(x, column.least), (x, column.greatest), (x, column.last)]);
            }
        }
        pieces
    }
}

const TOP: f32 = 30.0;
const PANEL_HEIGHT: f32 = 132.0;
const BOTTOM: f32 = 26.0;
const TICKS_ACROSS: usize = 13;
const TICKS_UP: usize = 5;
const KEY_SIZE: f32 = 11.0;
const KEY_WIDTH: f32 = 330.0;
const KEY_LINE: f32 = 15.0;
/// Entries of the key that a panel has room for.
const KEY_ENTRIES: usize = 9;
/// Room above and below the curves, as part of the panel.
const MARGIN: f32 = 0.06;

const ZERO: Colour = Colour::opaque(0xb9bfc8);
/// Dark enough for lines on white, apart from one another also for eyes that see fewer colours.
const CURVES: [Colour; 8] = [
    Colour::opaque(0x0b64a8),
    Colour::opaque(0xd55e00),
    Colour::opaque(0x00805f),
    Colour::opaque(0x9d4787),
    Colour::opaque(0x8a6d00),
    Colour::opaque(0x3a4cc0),
    Colour::opaque(0xc81e2b),
    Colour::opaque(0x5c6672),
];

impl Curves {
    /// The picture, whose plots begin so far from the left edge.
    pub fn scene(&self, left: f32) -> Scene {
        let width = left + PLOT_WIDTH + 14.0 + KEY_WIDTH + EDGE;
        let mut scene = Scene::new(width, 0.0, "");
        for panel in &self.panels {
            scene.below(self.panel(panel, left, width));
        }
        scene
    }

    fn panel(&self, panel: &Panel, left: f32, width: f32) -> Scene {
        let mut scene = Scene::new(width, TOP + PANEL_HEIGHT + BOTTOM, &panel.title);
        scene.text(words(
            [EDGE, 20.0],
            &panel.title,
            13.5,
            Weight::Bold,
            INK,
            Anchor::Start,
        ));
        let (least, greatest) = panel.extent();
        let bottom = TOP + PANEL_HEIGHT;
        let y = |value: f64| bottom - ((value - least) / (greatest - least)) as f32 * PANEL_HEIGHT;
        for mark in axis::ticks(least, greatest, TICKS_UP) {
            let colour = if mark == 0.0 { ZERO } else { GRID };
            let line = [[left, y(mark)], [left + PLOT_WIDTH, y(mark)]];
            scene.line(line, Stroke::solid(colour, 1.0));
            let number = axis::number(mark);
            scene.text(words(
                [left - 8.0, y(mark) + 4.0],
                &number,
                11.0,
                Weight::Regular,
                QUIET_INK,
                Anchor::End,
            ));
        }
        scene.text(words(
            [EDGE, TOP + 10.0],
            &panel.unit,
            11.0,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
        self.time_axis(left, &mut scene);
        let colours = CURVES.into_iter().cycle();
        for (curve, colour) in panel.curves.iter().zip(colours) {
            for piece in curve.pieces() {
                let points: Vec<[f32; 2]> = (piece.into_iter())
                    .map(|(column, value)| {
                        let x = left + column * (PLOT_WIDTH / COLUMNS as f32);
                        [x, y(f64::from(value))]
                    })
                    .collect();
                scene.tooltip(&*curve.name);
                match points[..] {
                    [point] => scene.circle(point, 1.4, Some(colour), None),
                    _ => scene.line(points, Stroke::solid(colour, 1.3)),
                }
            }
        }
        panel.key(left + PLOT_WIDTH + 14.0, &mut scene);
        scene
    }

    fn time_axis(&self, left: f32, scene: &mut Scene) {
        let bottom = TOP + PANEL_HEIGHT;
        let end_us = self.end_us.max(1) as f64;
        for mark in axis::ticks(0.0, end_us / 1e6, TICKS_ACROSS) {
            let x = left + (mark * 1e6 / end_us) as f32 * PLOT_WIDTH;
            scene.line([[x, TOP], [x, bottom]], Stroke::solid(GRID, 1.0));
            scene.text(words(
                [x, bottom + 15.0],
                &axis::number(mark),
                11.0,
                Weight::Regular,
                QUIET_INK,
                Anchor::Middle,
            ));
        }
    }
}

impl Panel {
    /// The ends of the axis: 0 is always on it.
    fn extent(&self) -> (f64, f64) {
        let extents = self.curves.iter().filter_map(Curve::extent);
        let (least, greatest) = extents.fold((0.0_f32, 0.0_f32), |(least, greatest), extent| {
            (least.min(extent.0), greatest.max(extent.1))
        });
        let (least, greatest) = (f64::from(least), f64::from(greatest));
        let margin = (greatest - least) * f64::from(MARGIN);
        if margin <= 0.0 {
            return (-1.0, 1.0);
        }
        (least - margin, greatest + margin)
    }

    /// Which colour is which curve, at the right of the plot.
    fn key(&self, left: f32, scene: &mut Scene) {
        let colours = CURVES.into_iter().cycle();
        let shown = match self.curves.len() {
            ..=KEY_ENTRIES => self.curves.len(),
            _ => KEY_ENTRIES - 1,
        };
        for (index, (curve, colour)) in self.curves.iter().zip(colours).take(shown).enumerate() {
            let base = TOP + 9.0 + index as f32 * KEY_LINE;
            scene.rectangle([left, base - 8.5], [9.0, 9.0], colour, None);
            let room = KEY_WIDTH - 13.0;
            let name = font::fitted(&curve.name, room, KEY_SIZE, Weight::Regular);
            scene.tooltip(&*curve.name);
            scene.text(words(
                [left + 13.0, base],
                &name.unwrap_or_default(),
                KEY_SIZE,
                Weight::Regular,
                QUIET_INK,
                Anchor::Start,
            ));
        }
        if shown < self.curves.len() {
            let base = TOP + 9.0 + shown as f32 * KEY_LINE;
            let left_out = self.curves.get(shown..).unwrap_or_default();
            let names: Vec<&str> = left_out.iter().map(|curve| curve.name.as_str()).collect();
            scene.tooltip(names.join(", "));
            scene.text(words(
                [left + 13.0, base],
                &format!("+{}", left_out.len()),
                KEY_SIZE,
                Weight::Regular,
                QUIET_INK,
                Anchor::Start,
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(end_us: u64, numbers: &[(u64, f32)]) -> Curve {
        let mut curve = Curve::new("c".into(), end_us);
        for (t_us, value) in numbers {
            curve.add(*t_us, *value);
        }
        curve
    }

    #[test]
    fn a_curve_is_broken_where_numbers_are_missing() {
        let every_second = |from: u64, to: u64| (from..to).map(|s| (s * 1_000_000, 1.0));
        let numbers: Vec<_> = every_second(0, 40).chain(every_second(70, 100)).collect();
        let pieces = curve(100_000_000, &numbers).pieces();
        let lengths: Vec<usize> = pieces.iter().map(Vec::len).collect();
        assert_eq!(lengths, [40, 30]);
        // Ten numbers over the same time are rare, and no gap.
        let rare: Vec<_> = (0..10).map(|at| (at * 10_000_000, 1.0)).collect();
        assert_eq!(curve(100_000_000, &rare).pieces().len(), 1);
    }

    #[test]
    fn what_no_picture_shows_takes_no_room_and_no_peak_is_lost() {
        let numbers: Vec<(u64, f32)> = (0..1_000_000)
            .map(|at| (at, if at == 777_777 { 5.0 } else { (at % 2) as f32 }))
            .collect();
        let curve = curve(1_000_000, &numbers);
        assert_eq!(curve.extent(), Some((0.0, 5.0)));
        let points: usize = curve.pieces().iter().map(Vec::len).sum();
        assert!(points <= 4 * COLUMNS as usize + 4, "{points}");
    }

    #[test]
    fn what_is_not_finite_or_behind_the_end_is_left_out() {
        let numbers = [
            (0, f32::NAN),
            (5, f32::INFINITY),
            (11, 1.0),
            (u64::MAX, 1.0),
        ];
        assert_eq!(curve(10, &numbers).extent(), None);
        let panel = Panel {
            curves: vec![curve(10, &numbers)],
            ..Panel::default()
        };
        let curves = Curves {
            panels: vec![panel],
            end_us: 0,
        };
        let svg = curves.scene(100.0).to_svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
