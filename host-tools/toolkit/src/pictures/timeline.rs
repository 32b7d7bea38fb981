//! The states of a run over time: one bar a region, one block a state.

use std::collections::HashMap;

use super::axis;
use super::font::{self, Weight};
use super::palette::{GRID, INK, QUIET_INK};
use super::scene::{Anchor, Colour, Scene, Stroke, words};

/// The states of one run, mission after mission.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Timeline {
    /// Heading.
    pub title: String,
    /// The missions, in the order of time.
    pub missions: Vec<MissionStates>,
    /// What happened at single moments: uploads, faults, collisions.
    pub marks: Vec<Mark>,
}

/// The states of a mission over time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MissionStates {
    /// Name of the mission.
    pub name: String,
    /// Time from the start of the run at which it took over.
    pub start_us: u64,
    /// Time from the start of the run at which it ended.
    pub end_us: u64,
    /// Its regions, depth first.
    pub regions: Vec<RegionStates>,
}

/// The states of a region over time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RegionStates {
    /// Path of the region: `motion`, or `motion/Escape/turn`.
    pub path: String,
    /// What was current, in the order of time, without overlaps. A region inside a superstate that
    /// is not current has gaps.
    pub spans: Vec<StateSpan>,
}

/// A time for which a state was current.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StateSpan {
    /// Name of the state in its region; `initial` and `final` are shown paler.
    pub state: String,
    /// Start, from the start of the run.
    pub start_us: u64,
    /// End, from the start of the run.
    pub end_us: u64,
}

/// Something that happened at a moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mark {
    /// Time from the start of the run.
    pub t_us: u64,
    /// What.
    pub label: String,
}

pub(super) const PLOT_WIDTH: f32 = 880.0;
pub(super) const EDGE: f32 = 24.0;
const TOP: f32 = 86.0;
const BOTTOM: f32 = 50.0;
const HEADING_HEIGHT: f32 = 30.0;
const ROW_HEIGHT: f32 = 24.0;
const BAR_HEIGHT: f32 = 18.0;
const INDENT: f32 = 12.0;
const LABEL_SIZE: f32 = 12.0;
const LABEL_WIDTH_MAX: f32 = 260.0;
const KEY_SIZE: f32 = 11.0;
const KEY_WIDTH_MAX: f32 = 330.0;
const TICKS_MOST: usize = 13;
/// By how many colours a region's palette starts after that of the region above.
const COLOURS_A_REGION: usize = 3;
/// Letters of a state's name that a block must have room for, to be worth writing any.
const BLOCK_LETTERS_LEAST: usize = 4;
/// Width of a block that is too narrow to be seen as it is.
const STROKE_WIDTH: f32 = 1.5;
/// Blocks narrower than this are shown together as one of many changes.
const BLOCK_WIDTH_LEAST: f32 = 0.8;

const BAND: Colour = Colour::opaque(0xf6f7f9);
const MARK: Colour = Colour::opaque(0xc81e2b);
const PSEUDO: Colour = Colour::opaque(0xd9dee5);
const CHANGING: Colour = Colour::opaque(0x7d8794);
/// Light enough for dark letters, apart from one another also for eyes that see fewer colours.
const STATES: [Colour; 8] = [
    Colour::opaque(0x9ecae9),
    Colour::opaque(0xffc48a),
    Colour::opaque(0xa6dbb0),
    Colour::opaque(0xe3b6dc),
    Colour::opaque(0xf2e08a),
    Colour::opaque(0xb9bdf0),
    Colour::opaque(0xf4a9a3),
    Colour::opaque(0x9fdcd9),
];

impl Timeline {
    /// Where the bars begin, counted from the left edge.
    pub(super) fn left(&self) -> f32 {
        Layout::of(self).left
    }

    /// The picture, ready to become SVG or PNG.
    pub fn scene(&self) -> Scene {
        let layout = Layout::of(self);
        let mut scene = Scene::new(layout.width(), layout.height, &self.title);
        let title = font::fitted(&self.title, layout.width() - 2.0 * EDGE, 20.0, Weight::Bold)
            .unwrap_or_default();
        scene.text(words(
            [EDGE, 34.0],
            &title,
            20.0,
            Weight::Bold,
            INK,
            Anchor::Start,
        ));
        layout.time_axis(&mut scene);
        let mut y = TOP;
        for mission in &self.missions {
            layout.mission(mission, &mut y, &mut scene);
        }
        let mut regions = self.missions.iter().flat_map(|mission| &mission.regions);
        if regions.any(|region| {
            layout
                .blocks(region)
                .iter()
                .any(|block| block.state.is_none())
        }) {
            layout.key_of_changing(&mut scene);
        }
        layout.marks(&self.marks, &mut scene);
        scene
    }
}

struct Layout {
    /// Left end of the plot.
    left: f32,
    key_width: f32,
    height: f32,
    end_us: u64,
}

impl Layout {
    fn of(timeline: &Timeline) -> Self {
        let regions = || {
            timeline
                .missions
                .iter()
                .flat_map(|mission| &mission.regions)
        };
        let label = regions().map(|region| {
            indent(region) + font::width(short_name(region), LABEL_SIZE, Weight::Regular)
        });
        let key = regions().map(|region| key_width(&states_in_order(region)));
        let rows =
            regions().count() as f32 * ROW_HEIGHT + timeline.missions.len() as f32 * HEADING_HEIGHT;
        let last_mark = timeline.marks.iter().map(|mark| mark.t_us);
        Layout {
            left: EDGE + label.fold(60.0, f32::max).min(LABEL_WIDTH_MAX) + 12.0,
            key_width: key.fold(0.0, f32::max).min(KEY_WIDTH_MAX),
            height: TOP + rows + BOTTOM,
            end_us: timeline
                .missions
                .iter()
                .map(|mission| mission.end_us)
                .chain(last_mark)
                .max()
                .unwrap_or(0)
                .max(1),
        }
    }

    fn width(&self) -> f32 {
        self.left + PLOT_WIDTH + 14.0 + self.key_width + EDGE
    }

    fn x(&self, t_us: u64) -> f32 {
        // In f64, since f32 would round times of more than 16 s to other microseconds.
        self.left + (t_us as f64 / self.end_us as f64) as f32 * PLOT_WIDTH
    }

    fn time_axis(&self, scene: &mut Scene) {
        let bottom = self.height - BOTTOM + 6.0;
        for mark in axis::ticks(0.0, self.end_us as f64 / 1e6, TICKS_MOST) {
            let x = self.left + (mark * 1e6 / self.end_us as f64) as f32 * PLOT_WIDTH;
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
        let right = self.left + PLOT_WIDTH;
        scene.text(words(
            [right, bottom + 31.0],
            "robot time / s",
            11.0,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }

    fn mission(&self, mission: &MissionStates, y: &mut f32, scene: &mut Scene) {
        scene.text(words(
            [EDGE, *y + 20.0],
            &mission.name,
            13.5,
            Weight::Bold,
            INK,
            Anchor::Start,
        ));
        let (start, end) = (self.x(mission.start_us), self.x(mission.end_us));
        scene.line(
            [[start, *y + 16.0], [end, *y + 16.0]],
            Stroke::solid(QUIET_INK, 1.2),
        );
        for x in [start, end] {
            scene.line(
                [[x, *y + 12.0], [x, *y + 20.0]],
                Stroke::solid(QUIET_INK, 1.2),
            );
        }
        *y += HEADING_HEIGHT;
        for (index, region) in mission.regions.iter().enumerate() {
            self.region(region, index * COLOURS_A_REGION, mission, *y, scene);
            *y += ROW_HEIGHT;
        }
    }

    fn region(
        &self,
        region: &RegionStates,
        shift: usize,
        mission: &MissionStates,
        y: f32,
        scene: &mut Scene,
    ) {
        let base = y + 13.0;
        let indent = indent(region).min(LABEL_WIDTH_MAX / 2.0);
        let room = self.left - 12.0 - EDGE - indent;
        let name =
            font::fitted(short_name(region), room, LABEL_SIZE, Weight::Regular).unwrap_or_default();
        scene.tooltip(&region.path);
        scene.text(words(
            [EDGE + indent, base],
            &name,
            LABEL_SIZE,
            Weight::Regular,
            INK,
            Anchor::Start,
        ));
        let (start, end) = (self.x(mission.start_us), self.x(mission.end_us));
        scene.rectangle([start, y], [end - start, BAR_HEIGHT], BAND, None);
        let states = states_in_order(region);
        let colours: HashMap<&str, Colour> = colours(&states, shift).collect();
        let (narrow, wide): (Vec<_>, Vec<_>) =
            self.blocks(region).into_iter().partition(Block::is_narrow);
        // A state of a moment is a stroke on top of its neighbours.
        for block in wide.into_iter().chain(narrow) {
            let colour = block
                .state
                .map(|state| colours.get(state).copied().unwrap_or(PSEUDO));
            block.draw(y, colour.unwrap_or(CHANGING), scene);
        }
        self.key(&states, shift, base, scene);
    }

    /// The blocks of a region's bar. What is too narrow to be told apart becomes a common block, so
    /// that a picture of a long run stays of bounded size.
    fn blocks<'a>(&self, region: &'a RegionStates) -> Vec<Block<'a>> {
        let mut blocks: Vec<Block<'a>> = Vec::new();
        for span in &region.spans {
            let block = Block {
                state: Some(&span.state),
                start_us: span.start_us,
                end_us: span.end_us,
                left: self.x(span.start_us),
                right: self.x(span.end_us),
            };
            let joins = |last: &&mut Block<'a>| {
                let too_fast = last.is_narrow() || last.state.is_none();
                last.end_us == block.start_us && block.is_narrow() && too_fast
            };
            if let Some(last) = blocks.last_mut().filter(joins) {
                last.state = last.state.filter(|state| *state == span.state);
                (last.end_us, last.right) = (block.end_us, block.right);
                continue;
            }
            blocks.push(block);
        }
        blocks
    }

    /// Which colour is which state, at the right of the bar.
    fn key(&self, states: &[&str], shift: usize, base: f32, scene: &mut Scene) {
        let start = self.left + PLOT_WIDTH + 14.0;
        let mut x = start;
        for (index, (state, colour)) in colours(states, shift).enumerate() {
            let width = key_entry_width(state);
            let left_out = states.len() - index;
            // Room for the entry itself, and for the number of those left out should the next one
            // not fit.
            let reserve = if left_out > 1 {
                key_entry_width("+99")
            } else {
                0.0
            };
            if x + width + reserve > start + KEY_WIDTH_MAX {
                let more = format!("+{left_out}");
                scene.tooltip(states[index..].join(", "));
                scene.text(words(
                    [x, base],
                    &more,
                    KEY_SIZE,
                    Weight::Regular,
                    QUIET_INK,
                    Anchor::Start,
                ));
                return;
            }
            scene.rectangle([x, base - 8.5], [9.0, 9.0], colour, None);
            scene.text(words(
                [x + 13.0, base],
                state,
                KEY_SIZE,
                Weight::Regular,
                QUIET_INK,
                Anchor::Start,
            ));
            x += width;
        }
    }

    /// What the blocks without a name are, below the plot.
    fn key_of_changing(&self, scene: &mut Scene) {
        let base = self.height - 14.0;
        scene.rectangle([self.left, base - 8.5], [9.0, 9.0], CHANGING, None);
        let said = "many changes, too fast for this picture";
        scene.text(words(
            [self.left + 13.0, base],
            said,
            KEY_SIZE,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
    }

    fn marks(&self, marks: &[Mark], scene: &mut Scene) {
        let bottom = self.height - BOTTOM + 6.0;
        // Two lines of labels above the plot; a label that finds room in neither is left to the
        // tooltip.
        let mut free_from = [0.0_f32; 2];
        for mark in marks {
            let x = self.x(mark.t_us);
            scene.tooltip(format!("{} at {} s", mark.label, seconds(mark.t_us)));
            let stroke = Stroke {
                colour: MARK,
                width: 1.2,
                dash: Some([4.0, 3.0]),
            };
            scene.line([[x, TOP - 6.0], [x, bottom]], stroke);
            let width = font::width(&mark.label, 11.0, Weight::Regular);
            let start = (x - width / 2.0).clamp(EDGE, (self.width() - EDGE - width).max(EDGE));
            if let Some(line) = free_from.iter().position(|free| *free <= start) {
                free_from[line] = start + width + 10.0;
                let base = TOP - 10.0 - line as f32 * 15.0;
                scene.text(words(
                    [start, base],
                    &mark.label,
                    11.0,
                    Weight::Regular,
                    MARK,
                    Anchor::Start,
                ));
            }
        }
    }
}

/// A part of a bar.
struct Block<'a> {
    /// `None` for states that change too fast to be told apart.
    state: Option<&'a str>,
    start_us: u64,
    end_us: u64,
    left: f32,
    right: f32,
}

impl Block<'_> {
    fn is_narrow(&self) -> bool {
        self.right - self.left < BLOCK_WIDTH_LEAST
    }

    fn draw(&self, y: f32, colour: Colour, scene: &mut Scene) {
        let said = self.state.unwrap_or("many changes");
        scene.tooltip(format!(
            "{said}: {} s to {} s",
            seconds(self.start_us),
            seconds(self.end_us)
        ));
        // Edges on whole dots of the PNG: neighbours then leave no seam between them.
        let (left, right) = (snapped(self.left), snapped(self.right));
        let width = (right - left).max(STROKE_WIDTH);
        scene.rectangle([left, y], [width, BAR_HEIGHT], colour, None);
        let fitted = |state| font::fitted(state, width - 6.0, KEY_SIZE, Weight::Regular);
        let name = self
            .state
            .and_then(fitted)
            .filter(|name| name.chars().count() > BLOCK_LETTERS_LEAST || self.state == Some(name));
        if let Some(name) = name {
            let middle = left + width / 2.0;
            scene.text(words(
                [middle, y + 13.0],
                &name,
                KEY_SIZE,
                Weight::Regular,
                INK,
                Anchor::Middle,
            ));
        }
    }
}

/// `x` moved to the nearest half.
fn snapped(x: f32) -> f32 {
    libm::roundf(x * 2.0) / 2.0
}

/// The states of a region in the order of their first appearance.
fn states_in_order(region: &RegionStates) -> Vec<&str> {
    let mut seen = std::collections::HashSet::new();
    region
        .spans
        .iter()
        .map(|span| span.state.as_str())
        .filter(|state| seen.insert(*state))
        .collect()
}

/// A colour for each state of a region. `shift` makes the first of neighbouring regions differ.
fn colours<'a>(states: &[&'a str], shift: usize) -> impl Iterator<Item = (&'a str, Colour)> {
    let mut palette = STATES.into_iter().cycle().skip(shift % STATES.len());
    states.iter().map(move |state| {
        let colour = match *state {
            "initial" | "final" => Some(PSEUDO),
            _ => palette.next(),
        };
        (*state, colour.unwrap_or(PSEUDO))
    })
}

fn key_entry_width(state: &str) -> f32 {
    13.0 + font::width(state, KEY_SIZE, Weight::Regular) + 12.0
}

fn key_width(states: &[&str]) -> f32 {
    states.iter().map(|state| key_entry_width(state)).sum()
}

/// Regions inside superstates stand below their region, moved in.
fn indent(region: &RegionStates) -> f32 {
    (region.path.matches('/').count() / 2) as f32 * INDENT
}

/// The last superstate and the region in it: what is above them stands above.
fn short_name(region: &RegionStates) -> &str {
    let mut slashes = region.path.rmatch_indices('/');
    slashes
        .nth(1)
        .map_or(region.path.as_str(), |(at, _)| &region.path[at + 1..])
}

fn seconds(t_us: u64) -> String {
    axis::number(t_us as f64 / 1e6)
}
