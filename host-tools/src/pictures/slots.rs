//! A schedule: when each slot runs, over one hyperperiod.

use super::axis;
use super::font::Weight;
use super::scene::{Anchor, Colour, Scene, Stroke, words};

/// The slots of a schedule.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlotPicture {
    /// Heading.
    pub title: String,
    /// The slots, in the order in which they are listed.
    pub slots: Vec<SlotRow>,
    /// Least common multiple of the periods.
    pub hyperperiod_us: u64,
}

/// A slot with its place in time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SlotRow {
    /// What the slot is called.
    pub name: String,
    /// Start of its first occurrence.
    pub start_us: u64,
    /// Its period; 0 for none.
    pub period_us: u64,
    /// Its duration.
    pub duration_us: u64,
}

const LEFT: f32 = 96.0;
const RIGHT: f32 = 28.0;
const TOP: f32 = 76.0;
const BOTTOM: f32 = 46.0;
const PLOT_WIDTH: f32 = 960.0;
const ROW_HEIGHT: f32 = 28.0;
const BAR_HEIGHT: f32 = 20.0;
const TICKS_MOST: usize = 12;
/// Occurrences of one slot that a picture shows at most: one for every two units of its width.
const OCCURRENCES_MOST: u64 = 480;

const INK: Colour = Colour::opaque(0x1d232b);
const QUIET_INK: Colour = Colour::opaque(0x5c6672);
const GRID: Colour = Colour::opaque(0xe6e9ed);
const BAND: Colour = Colour::opaque(0xf6f7f9);
const BAR: Colour = Colour::opaque(0x3d7fb8);

impl SlotPicture {
    /// The picture, ready to become SVG or PNG.
    pub fn scene(&self) -> Scene {
        let plot_height = self.slots.len() as f32 * ROW_HEIGHT;
        let mut scene = Scene::new(
            LEFT + PLOT_WIDTH + RIGHT,
            TOP + plot_height + BOTTOM,
            &self.title,
        );
        scene.text(words(
            [24.0, 34.0],
            &self.title,
            20.0,
            Weight::Bold,
            INK,
            Anchor::Start,
        ));
        scene.text(words(
            [24.0, 55.0],
            &self.caption(),
            12.5,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
        self.time_axis(TOP + plot_height, &mut scene);
        for (index, slot) in self.slots.iter().enumerate() {
            self.row(slot, TOP + index as f32 * ROW_HEIGHT, &mut scene);
        }
        scene
    }

    /// The part of the hyperperiod that is shown.
    fn window_us(&self) -> u64 {
        let periods = self
            .slots
            .iter()
            .map(|slot| slot.period_us)
            .filter(|period| *period > 0);
        let room = periods
            .min()
            .map_or(u64::MAX, |period| period.saturating_mul(OCCURRENCES_MOST));
        self.hyperperiod_us.min(room).max(1)
    }

    fn caption(&self) -> String {
        let (window, whole) = (
            axis::number(self.window_us() as f64 / 1e3),
            axis::number(self.hyperperiod_us as f64 / 1e3),
        );
        if self.window_us() < self.hyperperiod_us {
            format!("the first {window} ms of a hyperperiod of {whole} ms")
        } else {
            format!("one hyperperiod of {whole} ms")
        }
    }

    fn x(&self, t_us: u64) -> f32 {
        LEFT + (t_us as f64 / self.window_us() as f64) as f32 * PLOT_WIDTH
    }

    fn time_axis(&self, bottom: f32, scene: &mut Scene) {
        let window_ms = self.window_us() as f64 / 1e3;
        for mark in axis::ticks(0.0, window_ms, TICKS_MOST) {
            let x = LEFT + (mark / window_ms) as f32 * PLOT_WIDTH;
            scene.line([[x, TOP - 4.0], [x, bottom]], Stroke::solid(GRID, 1.0));
            scene.text(words(
                [x, bottom + 16.0],
                &axis::number(mark),
                11.0,
                Weight::Regular,
                QUIET_INK,
                Anchor::Middle,
            ));
        }
        let right = LEFT + PLOT_WIDTH;
        scene.text(words(
            [right, bottom + 32.0],
            "time / ms",
            11.0,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }

    fn row(&self, slot: &SlotRow, y: f32, scene: &mut Scene) {
        let window = self.window_us();
        scene.text(words(
            [LEFT - 12.0, y + 14.5],
            &slot.name,
            12.0,
            Weight::Regular,
            INK,
            Anchor::End,
        ));
        scene.rectangle([LEFT, y], [PLOT_WIDTH, BAR_HEIGHT], BAND, None);
        // A slot without a period runs once.
        let step = if slot.period_us == 0 {
            usize::MAX
        } else {
            usize::try_from(slot.period_us).unwrap_or(usize::MAX)
        };
        for start in (slot.start_us..window).step_by(step) {
            let end = start.saturating_add(slot.duration_us).min(window);
            let (left, right) = (self.x(start), self.x(end));
            scene.tooltip(format!("{}: {start} us to {end} us", slot.name));
            scene.rectangle([left, y], [(right - left).max(0.8), BAR_HEIGHT], BAR, None);
        }
        // An occurrence that goes on over the end of the hyperperiod is seen at its start too.
        let last_end = slot.start_us.saturating_add(slot.duration_us);
        if slot.period_us > 0 && last_end > slot.period_us {
            let width = self.x((last_end - slot.period_us).min(window)) - LEFT;
            scene.rectangle([LEFT, y], [width, BAR_HEIGHT], BAR, None);
        }
    }
}
