//! A schedule: when each slot runs, what is left for slot 0, and how the slots are packed.
//!
//! What is shown large is one hyperperiod where people can read that, else its busiest window; then
//! a strip above shows where that is. Nothing here is as long as the hyperperiod, and nothing as
//! wide as the number of slots: beyond [`MAX_ROWS`] slots those of one period share a row.

mod gantt;
mod overview;
mod packing;

use std::collections::BTreeMap;

use super::axis::{self, Unit};
use super::font::{self, Weight};
use super::palette::{INK, PAPER, QUIET_INK};
use super::scene::{Anchor, Colour, Scene, Stroke, words};
use crate::timetable::{Activation, Extent, Gap, Timetable, Window, gaps};

/// More slots than this share rows by their periods; of more periods than this the longest share
/// one row.
pub const MAX_ROWS: usize = 48;

/// Frames that the packing view shows at most.
pub const MAX_FRAMES: u64 = 48;

/// A window has at most so many shortest periods.
const MAX_WINDOW_FRAMES: f64 = 48.0;
/// And at least so many, unless the hyperperiod is shorter.
const LEAST_WINDOW_FRAMES: f64 = 4.0;
/// The slot of median duration is as wide as this, if the window can be chosen so.
const READABLE_BAR: f32 = 1.5;

/// The slots of a schedule.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlotPicture {
    /// Heading.
    pub title: String,
    /// The slots with their starts.
    pub timetable: Timetable,
    /// Names of the tasks of each slot, by its number.
    pub tasks: BTreeMap<u32, Vec<String>>,
}

const WIDTH: f32 = 1200.0;
const MARGIN: f32 = 24.0;
/// Where the plots begin, without and with a column of tasks.
const LEFT: f32 = 196.0;
const LEFT_OF_NAMES: f32 = 400.0;
const RIGHT: f32 = WIDTH - MARGIN - 8.0;
const TICKS_MOST: usize = 12;

const TITLE: f32 = 20.0;
const HEADING: f32 = 14.0;
const TEXT: f32 = 12.0;
const SMALL: f32 = 11.0;

const GRID: Colour = Colour::opaque(0xd3d8de);
const BAND: Colour = Colour::opaque(0xf6f7f9);
/// What is free, everywhere in the picture.
const FREE: Colour = Colour::opaque(0xd9dee4);
/// Several slots of different periods that are too narrow to be told apart.
const SEVERAL: Colour = Colour::opaque(0x4a4f57);
/// From the shortest period to the longest: they differ in lightness too, so that they can be told
/// apart by everyone and in grey.
const PERIODS: [Colour; 7] = [
    Colour::opaque(0x47267a),
    Colour::opaque(0x3d4e8a),
    Colour::opaque(0x2c728e),
    Colour::opaque(0x21918c),
    Colour::opaque(0x3fae7e),
    Colour::opaque(0x74c95c),
    Colour::opaque(0xb5d93a),
];
/// On those before this one words are white.
const FIRST_LIGHT: usize = 4;

/// What is drawn as one: an activation, or several that are too narrow to be told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Content {
    /// Index of the slot, where it is one.
    slot: Option<usize>,
    /// Index into [`PERIODS`], where all have one period.
    colour: Option<usize>,
}

impl Content {
    fn and(self, other: Content) -> Self {
        Content {
            slot: self.slot.filter(|_| self.slot == other.slot),
            colour: self.colour.filter(|_| self.colour == other.colour),
        }
    }

    fn fill(self) -> Colour {
        let of_period = self.colour.and_then(|place| PERIODS.get(place).copied());
        of_period.unwrap_or(SEVERAL)
    }
}

/// What the parts of the picture share.
struct View<'p> {
    picture: &'p SlotPicture,
    window: Window,
    /// All that is in the window.
    activations: Vec<Activation>,
    /// What they leave.
    gaps: Vec<Gap>,
    /// One for each slot: index into [`PERIODS`].
    colours: Vec<usize>,
    /// Where the plots begin.
    left: f32,
}

impl SlotPicture {
    /// The picture, ready to become SVG or PNG.
    pub fn scene(&self) -> Scene {
        let view = View::new(self);
        // How high it becomes is known at the end.
        let mut scene = Scene::new(WIDTH, 0.0, &self.title);
        view.line(
            MARGIN,
            34.0,
            &self.title,
            (TITLE, Weight::Bold),
            INK,
            &mut scene,
        );
        view.line(
            MARGIN,
            56.0,
            &view.caption(),
            (TEXT, Weight::Regular),
            QUIET_INK,
            &mut scene,
        );
        let mut bottom = 66.0;
        if view.window.extent != Extent::Hyperperiod {
            bottom = overview::draw(&view, bottom, &mut scene);
        }
        if !self.timetable.slots().is_empty() {
            bottom = gantt::draw(&view, bottom, &mut scene);
            bottom = packing::draw(&view, bottom + 14.0, &mut scene);
        }
        scene.height = bottom + MARGIN;
        scene
    }
}

/// As many shortest periods as can be read side by side.
fn readable_frames(timetable: &Timetable) -> u64 {
    let mut durations: Vec<u32> = timetable
        .slots()
        .iter()
        .map(|slot| slot.duration_us)
        .collect();
    durations.sort_unstable();
    let median_us = durations.get(durations.len() / 2).copied().unwrap_or(0);
    let readable_us = f64::from(median_us) * f64::from((RIGHT - LEFT) / READABLE_BAR);
    let frames = readable_us / timetable.frame_us().max(1) as f64;
    frames.clamp(LEAST_WINDOW_FRAMES, MAX_WINDOW_FRAMES) as u64
}

impl<'p> View<'p> {
    fn new(picture: &'p SlotPicture) -> Self {
        let timetable = &picture.timetable;
        let window = timetable.window(readable_frames(timetable));
        let activations = timetable.activations(window.start_us, window.end_us());
        let is_grouped = timetable.slots().len() > MAX_ROWS;
        let has_names = is_grouped || picture.tasks.values().any(|names| !names.is_empty());
        View {
            gaps: gaps(&activations, window.start_us, window.end_us()),
            colours: colours(timetable),
            left: if has_names { LEFT_OF_NAMES } else { LEFT },
            picture,
            window,
            activations,
        }
    }

    fn timetable(&self) -> &Timetable {
        &self.picture.timetable
    }

    fn width(&self) -> f32 {
        RIGHT - self.left
    }

    /// Where a point of time is.
    fn x(&self, t_us: i64) -> f32 {
        let share =
            (t_us as f64 - self.window.start_us as f64) / self.window.length_us.max(1) as f64;
        self.left + share.clamp(0.0, 1.0) as f32 * self.width()
    }

    fn caption(&self) -> String {
        let slots = self.timetable().slots();
        let (length_us, busy_us) = (self.window.length_us, self.window.busy_us);
        let what = self.timetable().describe(&self.window);
        let largest_us = self.gaps.iter().map(|gap| gap.length_us).max().unwrap_or(0);
        let share =
            axis::number(libm::round(busy_us as f64 / length_us.max(1) as f64 * 1000.0) / 10.0);
        format!(
            "{} slot{}; {what}. Slots take {share} % of it, the longest gap is {}.",
            slots.len(),
            if slots.len() == 1 { "" } else { "s" },
            axis::time(largest_us)
        )
    }

    fn content(&self, slot: usize) -> Content {
        Content {
            slot: Some(slot),
            colour: self.colours.get(slot).copied(),
        }
    }

    /// A slot's number inside its shape, where that has room for it.
    fn number_inside(&self, slot: usize, left_top: [f32; 2], size: [f32; 2], scene: &mut Scene) {
        let Some(timed) = self.timetable().slots().get(slot) else {
            return;
        };
        let number = timed.number.to_string();
        let letters = (size[1] - 3.0).min(SMALL);
        if letters < 7.0 || font::width(&number, letters, Weight::Bold) + 3.0 > size[0] {
            return;
        }
        let is_dark = self
            .colours
            .get(slot)
            .is_some_and(|&place| place < FIRST_LIGHT);
        scene.text(words(
            [
                left_top[0] + size[0] / 2.0,
                left_top[1] + size[1] / 2.0 + letters * 0.36,
            ],
            &number,
            letters,
            Weight::Bold,
            if is_dark { PAPER } else { INK },
            Anchor::Middle,
        ));
    }

    /// A line of words that starts at `left` and ends within the picture.
    fn line(
        &self,
        left: f32,
        base: f32,
        text: &str,
        (size, weight): (f32, Weight),
        colour: Colour,
        scene: &mut Scene,
    ) {
        if let Some(text) = font::fitted(text, RIGHT - left, size, weight) {
            scene.text(words(
                [left, base],
                &text,
                size,
                weight,
                colour,
                Anchor::Start,
            ));
        }
    }

    /// Marks of a time axis over a plot, with what they mean at its right end.
    fn time_axis(
        &self,
        (from_us, to_us): (u64, u64),
        [left, top, bottom]: [f32; 3],
        label: &str,
        scene: &mut Scene,
    ) {
        let width = RIGHT - left;
        let unit = Unit::of(to_us.saturating_sub(from_us));
        let (from, to) = (unit.of_us(from_us), unit.of_us(to_us));
        // As many marks as have room for their numbers.
        let widest = |marks: &[f64]| {
            let widths = marks
                .iter()
                .map(|mark| font::width(&axis::number(*mark), SMALL, Weight::Regular));
            widths.fold(0.0, f32::max)
        };
        let marks = (1..=TICKS_MOST)
            .rev()
            .map(|most| axis::ticks(from, to, most))
            .find(|marks| (widest(marks) + 14.0) * marks.len() as f32 <= width)
            .unwrap_or_default();
        for mark in marks {
            let x = left + ((mark - from) / (to - from)) as f32 * width;
            scene.line([[x, top], [x, bottom + 3.0]], Stroke::solid(GRID, 1.0));
            scene.text(words(
                [x, bottom + 15.0],
                &axis::number(mark),
                SMALL,
                Weight::Regular,
                QUIET_INK,
                Anchor::Middle,
            ));
        }
        let label = format!("{label} / {}", unit.name());
        scene.text(words(
            [RIGHT, bottom + 29.0],
            &label,
            SMALL,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }
}

/// Periods share the colours in the order of their length.
fn colours(timetable: &Timetable) -> Vec<usize> {
    let mut periods: Vec<u32> = timetable
        .slots()
        .iter()
        .map(|slot| slot.period_us)
        .collect();
    periods.sort_unstable();
    periods.dedup();
    let steps = (periods.len().max(2) - 1).max(3);
    let place = |period_us: u32| {
        let rank = periods.binary_search(&period_us).unwrap_or(0);
        rank * (PERIODS.len() - 1) / steps
    };
    timetable
        .slots()
        .iter()
        .map(|slot| place(slot.period_us))
        .collect()
}

#[cfg(test)]
mod laws;
