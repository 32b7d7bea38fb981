//! A picture of the schedules of a system: the slots of all processors and the frames of all links
//! below each other, on one time axis.

use super::declaration::Medium;
use super::schedule::{Group, GroupName, LinkUse, Placed, SystemSchedule};
use crate::pictures::axis::{self, Unit};
use crate::pictures::bars::{LEAST_BAR, bars};
use crate::pictures::font::{Weight, fitted};
use crate::pictures::palette::{GRID, INK, PAPER, QUIET_INK};
use crate::pictures::scene::{Anchor, Colour, Scene, Stroke, words};
use crate::timetable::{Activation, Timetable, Window};

const WIDTH: f32 = 1200.0;
const MARGIN: f32 = 24.0;
/// Where bars begin and end.
const LEFT: f32 = 372.0;
const RIGHT: f32 = WIDTH - MARGIN - 8.0;
/// Right ends of number, period and duration; where names begin.
const COLUMNS: [f32; 3] = [MARGIN + 40.0, MARGIN + 104.0, MARGIN + 174.0];
const NAMES: f32 = MARGIN + 188.0;
const ROW: f32 = 23.0;
const BAR: f32 = 17.0;
const HEADING_ROW: f32 = 34.0;
/// A window has at most so many shortest periods.
const MAX_PERIODS: u64 = 24;
/// Where there are more rows than this, all of a processor or of a direction share one.
const MAX_ROWS: usize = 120;
const TICKS_MOST: usize = 12;

const TITLE: f32 = 20.0;
const HEADING: f32 = 14.0;
const TEXT: f32 = 12.0;
const SMALL: f32 = 11.0;

const BAND: Colour = Colour::opaque(0xf6f7f9);
const SLOT: Colour = Colour::opaque(0x3d4e8a);
const FRAME: Colour = Colour::opaque(0x21918c);

/// A stretch of plant time between two places.
struct Axis {
    window: Window,
}

impl Axis {
    fn x(&self, t_us: i64) -> f32 {
        let passed = t_us as f64 - self.window.start_us as f64;
        let share = passed / self.window.length_us.max(1) as f64;
        LEFT + share.clamp(0.0, 1.0) as f32 * (RIGHT - LEFT)
    }

    /// Lines at round times from one height to another, and the times below.
    fn draw(&self, [top, bottom]: [f32; 2], scene: &mut Scene) {
        let unit = Unit::of(self.window.length_us);
        let (from, to) = (
            unit.of_us(self.window.start_us),
            unit.of_us(self.window.end_us()),
        );
        for mark in axis::ticks(from, to, TICKS_MOST) {
            let x = LEFT + ((mark - from) / (to - from)) as f32 * (RIGHT - LEFT);
            scene.line([[x, top], [x, bottom + 3.0]], Stroke::solid(GRID, 1.0));
            let number = axis::number(mark);
            let at = [x, bottom + 15.0];
            scene.text(words(
                at,
                &number,
                SMALL,
                Weight::Regular,
                QUIET_INK,
                Anchor::Middle,
            ));
        }
        let label = format!("plant time / {}", unit.name());
        let at = [RIGHT, bottom + 30.0];
        scene.text(words(
            at,
            &label,
            SMALL,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }
}

/// Draws the schedules of a system.
#[must_use]
pub fn draw(schedule: &SystemSchedule, title: &str) -> Scene {
    let timetable = schedule.timetable();
    let axis = Axis {
        window: timetable.window(MAX_PERIODS),
    };
    let groups: Vec<Group<'_>> = schedule.groups().collect();
    let rows: usize = groups.iter().map(|group| group.placed.len()).sum();
    let is_grouped = rows > MAX_ROWS;
    // How high it becomes is known at the end.
    let mut scene = Scene::new(WIDTH, 0.0, title);
    line(
        &mut scene,
        [MARGIN, 34.0],
        title,
        (TITLE, Weight::Bold),
        INK,
    );
    let drift = "Clocks are drawn without drift.";
    let caption = format!("{}. {drift}", timetable.describe(&axis.window));
    line(
        &mut scene,
        [MARGIN, 56.0],
        &caption,
        (TEXT, Weight::Regular),
        QUIET_INK,
    );
    let top = 66.0;
    let bottom = groups.iter().fold(top, |y, group| {
        let rows = if is_grouped { 1 } else { group.placed.len() };
        y + HEADING_ROW + rows as f32 * ROW
    });
    if rows > 0 {
        axis.draw([top, bottom], &mut scene);
    }
    let mut y = top;
    let mut first = 0;
    for group in groups {
        let (heading, colour) = heading(&group, &schedule.links);
        let at = [MARGIN, y + HEADING_ROW - 11.0];
        line(&mut scene, at, &heading, (HEADING, Weight::Bold), INK);
        y += HEADING_ROW;
        let numbers: Vec<usize> = (first..first + group.placed.len()).collect();
        first += group.placed.len();
        let lanes: Vec<&[usize]> = match is_grouped {
            true => vec![&numbers],
            false => numbers.chunks(1).collect(),
        };
        for (place, lane) in lanes.into_iter().enumerate() {
            if let Some(placed) = group.placed.get(place).filter(|_| !is_grouped) {
                cells(placed, y + 13.0, &mut scene);
            }
            row(
                &timetable,
                (&axis, y),
                (lane, &group, numbers.first()),
                colour,
                &mut scene,
            );
            y += ROW;
        }
    }
    scene.height = bottom + 34.0 + MARGIN;
    scene
}

/// What stands over a group, and the colour of its bars.
fn heading(group: &Group<'_>, links: &[LinkUse]) -> (String, Colour) {
    let percent = |share: f64| format!("{:.1} %", share * 100.0);
    let share = percent(group.utilisation);
    match group.heading {
        GroupName::Processor(name) => {
            let start = match group.origin_us {
                0 => String::new(),
                us => format!(", starts at {}", axis::time(us)),
            };
            (format!("{name}{start}: slots take {share}"), SLOT)
        }
        GroupName::Frames(from, to) => {
            let link = links.iter().find(|link| {
                let [one, other] = &link.ends;
                (one == from && other == to) || (one == to && other == from)
            });
            let medium = link.map_or("", |link| link.medium);
            let together = link.filter(|_| medium == Medium::Can.name());
            let together = together.map_or_else(String::new, |link| {
                format!(", both directions {}", percent(link.utilisation))
            });
            let words = format!("{from} to {to}, {medium}: frames take {share}{together}");
            (words, FRAME)
        }
    }
}

fn line(
    scene: &mut Scene,
    at: [f32; 2],
    text: &str,
    (size, weight): (f32, Weight),
    colour: Colour,
) {
    if let Some(text) = fitted(text, RIGHT - at[0], size, weight) {
        scene.text(words(at, &text, size, weight, colour, Anchor::Start));
    }
}

/// Number, period, duration and names left of a row.
fn cells(placed: &Placed, base: f32, scene: &mut Scene) {
    let texts = [
        placed.number.to_string(),
        axis::time(placed.period_us.into()),
        axis::time(placed.duration_us.into()),
    ];
    for (place, (text, right)) in texts.iter().zip(COLUMNS).enumerate() {
        let weight = if place == 0 {
            Weight::Bold
        } else {
            Weight::Regular
        };
        scene.text(words([right, base], text, TEXT, weight, INK, Anchor::End));
    }
    let names = placed.names.join(", ");
    if let Some(names) = fitted(&names, LEFT - 12.0 - NAMES, SMALL, Weight::Regular) {
        let at = [NAMES, base];
        scene.text(words(
            at,
            &names,
            SMALL,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
    }
}

/// Draws a row of which the group's first slot of the timetable is known.
fn row(
    timetable: &Timetable,
    (axis, y): (&Axis, f32),
    (slots, group, first): (&[usize], &Group<'_>, Option<&usize>),
    colour: Colour,
    scene: &mut Scene,
) {
    scene.rectangle([LEFT, y], [RIGHT - LEFT, BAR], BAND, None);
    let (from_us, to_us) = (axis.window.start_us, axis.window.end_us());
    let in_window = slots
        .iter()
        .flat_map(|slot| timetable.of_slot(*slot, from_us, to_us));
    let mut activations: Vec<Activation> = in_window.collect();
    activations.sort_by_key(|one| (one.start_us, one.slot));
    for bar in bars(&activations, |t_us| axis.x(t_us), RIGHT + LEAST_BAR) {
        let slot = bar.activations.first().map(|one| one.slot);
        let placed =
            (slot.zip(first)).and_then(|(slot, first)| group.placed.get(slot.checked_sub(*first)?));
        let what = match (group.heading, placed) {
            (GroupName::Processor(name), Some(slot)) => format!("{name} slot {}", slot.number),
            (GroupName::Frames(from, _), Some(frame)) => {
                format!("{from} {} ({})", frame.names.join(", "), frame.number)
            }
            (_, None) => String::new(),
        };
        let count = match bar.activations.len() {
            1 => String::new(),
            more => format!(" and {} more", more - 1),
        };
        let [start_us, end_us] = bar.ends_us();
        scene.tooltip(format!("{what}{count}: {start_us} us to {end_us} us"));
        let size = [bar.right - bar.left, BAR];
        // A thin edge keeps neighbours apart.
        let edge = (size[0] > 4.0).then_some(Stroke::solid(PAPER, 0.6));
        scene.rectangle([bar.left, y], size, colour, edge);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lang::load_from;
    use crate::model::Model;
    use crate::schedule::Limit;
    use crate::system::read::read;
    use crate::system::schedule::{LinkUse, ProcessorSlots, SentFrames};
    use crate::test_disk::Disk;
    use crate::test_golden::assert_golden;
    use std::path::Path;

    #[test]
    fn the_schedules_of_the_rover_in_two_are_drawn_as_they_were_looked_at() {
        let folder = Path::new("../../missions/head_and_base");
        let text = std::fs::read_to_string(folder.join("head_and_base.system")).unwrap();
        let system = read(&text).0.unwrap();
        let missions = system.processors.iter().map(|it| {
            let path = folder.join(&it.mission.text);
            let mut checked = load_from(path.to_str().unwrap(), &Disk).unwrap();
            let schedule = checked.lay_out(Limit::pieces(1_000_000)).unwrap();
            let model: &Model = checked.model.as_ref().unwrap();
            let blob = crate::compile::compile(model, &schedule).unwrap();
            esm_core::verify(blob).unwrap()
        });
        let missions: Vec<_> = missions.collect();
        let blobs: Vec<_> = missions.iter().map(Some).collect();
        let tasks = |processor: usize, slot: u32| vec![format!("tasks {processor}.{slot}")];
        let schedule = SystemSchedule::new(&system, &blobs, &tasks);
        let scene = draw(&schedule, "Schedule of head_and_base.system");
        for (name, found) in [
            ("system_schedule.svg", scene.to_svg().into_bytes()),
            ("system_schedule.png", scene.to_png().unwrap()),
        ] {
            assert_golden(Path::new("src/pictures/golden").join(name), &found);
        }
    }

    #[test]
    fn sixteen_processors_with_as_many_slots_as_there_can_be_are_drawn() {
        let placed = |count: u32, period_us: u32| -> Vec<Placed> {
            let one = |at: u32| Placed {
                number: at + 1,
                names: Vec::new(),
                start_us: at * 10,
                period_us: period_us * (1 + at % 3),
                duration_us: 10,
            };
            (0..count).map(one).collect()
        };
        let processors = (0..16).map(|at| ProcessorSlots {
            processor: format!("p{at}"),
            mission: "m.esm".to_owned(),
            origin_us: at * 7,
            utilisation: 1.0,
            slots: placed(4_000, 40_000 + 2 * at as u32),
        });
        let ends = ["p0.a".to_owned(), "p1.b".to_owned()];
        let schedule = SystemSchedule {
            hyperperiod_us: None,
            processors: processors.collect(),
            links: vec![LinkUse {
                ends: ends.clone(),
                medium: "can",
                utilisation: 0.5,
                directions: vec![SentFrames {
                    from: ends[0].clone(),
                    to: ends[1].clone(),
                    origin_us: 0,
                    utilisation: 0.5,
                    frames: placed(64, 10_000),
                }],
            }],
        };
        let scene = draw(&schedule, "many");
        // Bars are no narrower than what a person can tell apart.
        assert!(scene.shapes.len() < 17 * 2_000, "{}", scene.shapes.len());
        let nothing = SystemSchedule {
            hyperperiod_us: None,
            processors: Vec::new(),
            links: Vec::new(),
        };
        assert!(draw(&nothing, "nothing").height > 0.0);
    }
}
