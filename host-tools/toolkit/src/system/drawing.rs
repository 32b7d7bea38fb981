//! A picture of a system: processors with their missions, the dispatchers of their links with all
//! frames, and the media between them.

use super::declaration::{Link, Processor, System};
use crate::duration;
use crate::medium::PS_IN_US;
use crate::medium::chance::Chance;
use crate::model::{Content, Direction, Frame, Model};
use crate::pictures::font::{Weight, fitted};
use crate::pictures::palette::{INK, PAPER, QUIET_INK};
use crate::pictures::scene::{Anchor, Colour, Point, Scene, Stroke, Text};

const MARGIN: f32 = 24.0;
const BOX_WIDTH: f32 = 620.0;
const BOX_GAP: f32 = 28.0;
const PADDING: f32 = 14.0;
const ROW: f32 = 19.0;
const TITLE: f32 = 20.0;
const HEADING: f32 = 14.0;
const TEXT: f32 = 12.0;
/// From a box to the first cable, and from one to the next.
const LANE: f32 = 30.0;
const MARK_RADIUS: f32 = 10.0;
/// Where the columns of a frame begin, from the left of its dispatcher.
const COLUMNS: [f32; 6] = [14.0, 150.0, 190.0, 350.0, 425.0, 490.0];
const COLUMN_GAP: f32 = 8.0;

const FRAME_LINE: Colour = Colour::opaque(0x1d232b);
const DISPATCHER: Colour = Colour::opaque(0xf1f5fa);
const SENT: Colour = Colour::opaque(0x2c728e);
const RECEIVED: Colour = Colour::opaque(0x8a5a13);
const CABLE: Stroke = Stroke::solid(Colour::opaque(0x4a4f57), 2.0);

/// A picture that grows downwards.
struct Drawing {
    scene: Scene,
    y: f32,
}

/// Where an end of a medium leaves its processor.
#[derive(Clone, Copy)]
struct Outlet {
    /// Index of the link among those of the system.
    medium: usize,
    y: f32,
}

impl Drawing {
    fn text(&mut self, x: f32, words: &str, weight: Weight, colour: Colour) {
        self.sized(x, words, TEXT, weight, colour);
    }

    fn sized(&mut self, x: f32, words: &str, size: f32, weight: Weight, colour: Colour) {
        let at = [x, self.y];
        self.scene.text(Text {
            at,
            words: words.to_owned(),
            size,
            weight,
            colour,
            anchor: Anchor::Start,
        });
    }

    /// A number in a circle.
    fn mark(&mut self, [x, y]: Point, number: usize) {
        self.scene
            .circle([x, y], MARK_RADIUS, Some(PAPER), Some(CABLE));
        self.scene.text(Text {
            at: [x, y + TEXT / 3.0],
            words: number.to_string(),
            size: TEXT,
            weight: Weight::Bold,
            colour: INK,
            anchor: Anchor::Middle,
        });
    }
}

/// Draws a system. `missions` has what the mission of each processor declares, as far as it can be
/// read.
#[must_use]
pub fn draw(system: &System, missions: &[Option<&Model>], title: &str) -> Scene {
    let right = MARGIN + BOX_WIDTH + LANE * (system.links.len() + 1) as f32;
    let mut drawing = Drawing {
        scene: Scene::new(right + MARGIN, 0.0, title),
        y: MARGIN + TITLE,
    };
    drawing.sized(MARGIN, title, TITLE, Weight::Bold, INK);
    if let Some(world) = &system.world {
        drawing.y += ROW;
        let words = format!("in the world {}", world.text);
        drawing.text(MARGIN, &words, Weight::Regular, QUIET_INK);
    }
    drawing.y += BOX_GAP;
    let mut outlets = Vec::new();
    for (index, processor) in system.processors.iter().enumerate() {
        let model = missions.get(index).copied().flatten();
        self::processor(
            &mut drawing,
            system,
            index,
            (processor, model),
            &mut outlets,
        );
        drawing.y += BOX_GAP;
    }
    cables(&mut drawing, system, &outlets);
    for (number, link) in (1..).zip(&system.links) {
        drawing.y += ROW;
        let y = drawing.y - TEXT / 3.0;
        drawing.mark([MARGIN + MARK_RADIUS, y], number);
        let left = MARGIN + 3.0 * MARK_RADIUS;
        let room = right - left;
        let words = format!(
            "{} to {}: {}",
            end(system, link, 0),
            end(system, link, 1),
            medium(link)
        );
        if let Some(words) = fitted(&words, room, TEXT, Weight::Regular) {
            drawing.text(left, &words, Weight::Regular, INK);
        }
        drawing.y += 2.0;
    }
    drawing.scene.height = drawing.y + MARGIN;
    drawing.scene
}

fn end(system: &System, link: &Link, which: usize) -> String {
    let end = link.ends.get(which);
    let processor = end.and_then(|end| system.processors.get(end.processor));
    let (processor, name) = (processor.map(|it| &it.name.text), end.map(|it| &it.link));
    format!(
        "{}.{}",
        processor.map_or("", String::as_str),
        name.map_or("", String::as_str)
    )
}

/// What a medium is, and what it does to frames.
fn medium(link: &Link) -> String {
    let mut words = vec![link.medium.name().to_owned()];
    if link.delay_us > 0 {
        words.push(format!("delay {}", duration::time(link.delay_us)));
    }
    for (what, chance) in [
        ("noise", link.noise),
        ("loss", link.loss),
        ("byte_loss", link.byte_loss),
    ] {
        if chance != Chance::NEVER {
            words.push(format!("{what} {}", chance.probability()));
        }
    }
    for cut in &link.cuts {
        let time = |ps: u64| duration::time(ps / PS_IN_US);
        words.push(format!("cut {} to {}", time(cut.from_ps), time(cut.to_ps)));
    }
    words.join(", ")
}

fn processor(
    drawing: &mut Drawing,
    system: &System,
    index: usize,
    (processor, model): (&Processor, Option<&Model>),
    outlets: &mut Vec<Outlet>,
) {
    let top = drawing.y;
    let left = MARGIN + PADDING;
    // It is painted behind what is in it, and how high it is is known at the end.
    let place = drawing.scene.shapes.len();
    drawing.y += PADDING + HEADING;
    let name = &processor.name.text;
    drawing.sized(left, name, HEADING, Weight::Bold, INK);
    let mission = format!("mission {}", processor.mission.text);
    let at = left + 150.0;
    let room = BOX_WIDTH - 150.0 - 2.0 * PADDING;
    if let Some(mission) = fitted(&mission, room, TEXT, Weight::Regular) {
        drawing.text(at, &mission, Weight::Regular, INK);
    }
    drawing.y += ROW;
    if let Some(words) = fitted(
        &properties(processor),
        BOX_WIDTH - 2.0 * PADDING,
        TEXT,
        Weight::Regular,
    ) {
        drawing.text(left, &words, Weight::Regular, QUIET_INK);
    }
    for (number, link) in model
        .map_or(&[][..], |model| &model.links)
        .iter()
        .enumerate()
    {
        drawing.y += ROW;
        let joined = system.links.iter().position(|joined| {
            let mut ends = joined.ends.iter();
            ends.any(|end| end.processor == index && end.link == link.name)
        });
        let top = drawing.y;
        let place = drawing.scene.shapes.len();
        drawing.y += ROW;
        let rate = link.rate_bps.unwrap_or(0);
        let heading = format!("link {}, {rate} bps", link.name);
        drawing.text(left + PADDING, &heading, Weight::Bold, INK);
        match joined {
            Some(medium) => outlets.push(Outlet {
                medium,
                y: drawing.y - TEXT / 3.0,
            }),
            None => {
                let at = left + PADDING + COLUMNS[3];
                drawing.text(at, "leads nowhere", Weight::Regular, QUIET_INK);
            }
        }
        let frames = model.map_or(&[][..], |model| &model.frames).iter();
        for (direction, what) in [(Direction::Out, "transmit"), (Direction::In, "receive")] {
            let mut of_it = (frames.clone())
                .filter(|frame| frame.link == number && frame.direction == direction)
                .peekable();
            if of_it.peek().is_none() {
                continue;
            }
            drawing.y += ROW;
            let colour = if direction == Direction::Out {
                SENT
            } else {
                RECEIVED
            };
            drawing.text(left + PADDING, what, Weight::Bold, colour);
            for frame in of_it {
                drawing.y += ROW;
                row(drawing, left + PADDING, frame, colour);
            }
        }
        drawing.y += PADDING;
        let width = BOX_WIDTH - 2.0 * PADDING;
        behind(
            drawing,
            place,
            ([left, top], [width, drawing.y - top], 6.0),
            DISPATCHER,
            None,
        );
    }
    drawing.y += PADDING;
    let size = [BOX_WIDTH, drawing.y - top];
    let line = Stroke::solid(FRAME_LINE, 1.5);
    behind(
        drawing,
        place,
        ([MARGIN, top], size, 10.0),
        PAPER,
        Some(line),
    );
}

/// Paints a rounded box behind all that was painted since a place.
fn behind(
    drawing: &mut Drawing,
    place: usize,
    (corner, size, radius): (Point, [f32; 2], f32),
    fill: Colour,
    stroke: Option<Stroke>,
) {
    let scene = &mut drawing.scene;
    scene.rounded(corner, size, radius, Some(fill), stroke);
    if let Some(last) = scene.shapes.pop() {
        scene.shapes.insert(place.min(scene.shapes.len()), last);
    }
}

fn properties(processor: &Processor) -> String {
    let board = processor.board.as_ref().map_or("host", |it| &it.text);
    let mut words = vec![format!("board {board}")];
    if !processor.pins.is_empty() {
        let all = crate::system::declaration::Pins::ALL.iter();
        let has = all.filter(|(_, pins)| processor.pins.contains(pins));
        let names: Vec<&str> = has.map(|(name, _)| *name).collect();
        words.push(format!("pins {}", names.join(", ")));
    }
    if processor.drift_ppb != 0 {
        words.push(format!(
            "drift {} ppm",
            f64::from(processor.drift_ppb) / 1e3
        ));
    }
    if processor.start_us != 0 {
        words.push(format!("start {}", duration::time(processor.start_us)));
    }
    for reset in &processor.resets {
        let time = |ps: u64| duration::time(ps / PS_IN_US);
        let (from, to) = (time(reset.from_ps), time(reset.to_ps));
        words.push(format!("reset {from} to {to}"));
    }
    words.join("; ")
}

/// A frame: name, identifier, what it carries, payload, period, and how old it may be.
fn row(drawing: &mut Drawing, left: f32, frame: &Frame, colour: Colour) {
    let carries = match &frame.content {
        Content::Value(type_name) => type_name.clone(),
        Content::Flags(flags) => format!("flags {}", flags.join(", ")),
    };
    let time = |us: Option<u32>| us.map(|us| duration::time(us.into())).unwrap_or_default();
    let late = match frame.late_us {
        Some(_) => format!("late {}", time(frame.late_us)),
        None => String::new(),
    };
    let payload = frame.payload_bytes.map(|bytes| format!("{bytes} bytes"));
    let cells = [
        frame.name.clone(),
        frame.id.to_string(),
        carries,
        payload.unwrap_or_default(),
        time(frame.period_us),
        late,
    ];
    let [arrow_left, arrow_right] = [left, left + 8.0];
    let y = drawing.y - TEXT / 3.0;
    let (tip, back) = if frame.direction == Direction::Out {
        (arrow_right, arrow_left)
    } else {
        (arrow_left, arrow_right)
    };
    let line = Stroke::solid(colour, 1.5);
    let wings = [[back, y - 4.0], [tip, y], [back, y + 4.0]];
    drawing.scene.line(wings, line);
    let ends = COLUMNS
        .iter()
        .skip(1)
        .copied()
        .chain([BOX_WIDTH - 3.0 * PADDING]);
    for ((words, column), end) in cells.iter().zip(COLUMNS).zip(ends) {
        let room = end - column - COLUMN_GAP;
        if let Some(words) = fitted(words, room, TEXT, Weight::Regular) {
            drawing.text(left + column, &words, Weight::Regular, INK);
        }
    }
}

/// The media: each from its one end to its other, on a way of its own.
fn cables(drawing: &mut Drawing, system: &System, outlets: &[Outlet]) {
    let edge = MARGIN + BOX_WIDTH;
    let lane = |medium: usize| edge + LANE * (medium + 1) as f32;
    let mut marks = Vec::new();
    for medium in 0..system.links.len() {
        let mut ends = outlets.iter().filter(|outlet| outlet.medium == medium);
        let (Some(first), Some(second)) = (ends.next(), ends.next()) else {
            continue;
        };
        let x = lane(medium);
        // From dispatchers to dispatchers.
        let from = edge - PADDING;
        let way = vec![
            [from, first.y],
            [x, first.y],
            [x, second.y],
            [from, second.y],
        ];
        drawing.scene.track(way, 8.0, CABLE);
        marks.push(([x, (first.y + second.y) / 2.0], medium + 1));
    }
    for (at, number) in marks {
        drawing.mark(at, number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lang::load_from;
    use crate::system::read::read;
    use crate::test_disk::Disk;
    use crate::test_golden::assert_golden;
    use std::path::Path;

    #[test]
    fn the_rover_in_two_is_drawn_as_it_was_looked_at() {
        let folder = Path::new("../../missions/head_and_base");
        let text = std::fs::read_to_string(folder.join("head_and_base.system")).unwrap();
        let worse = "link base.head to head.base delay 200 us noise 1e-6 loss 1 % cut 20 s to 25 s";
        let text = text.replace("link base.head to head.base", worse);
        let system = read(&text).0.unwrap();
        let missions = system.processors.iter().map(|it| {
            let path = folder.join(&it.mission.text);
            load_from(path.to_str().unwrap(), &Disk).unwrap().model
        });
        let missions: Vec<Option<Model>> = missions.collect();
        let missions: Vec<Option<&Model>> = missions.iter().map(Option::as_ref).collect();
        let scene = draw(&system, &missions, "head_and_base.system");
        for (name, found) in [
            ("system.svg", scene.to_svg().into_bytes()),
            ("system.png", scene.to_png().unwrap()),
        ] {
            assert_golden(Path::new("src/pictures/golden").join(name), &found);
        }
    }

    #[test]
    fn sixteen_processors_with_all_links_and_a_mission_that_cannot_be_read_are_drawn() {
        let mut text = String::new();
        for number in 0..16 {
            text += &format!("processor p{number} mission \"m{number}.esm\";");
        }
        for number in 0..64 {
            text += &format!(
                "link p{}.l{number} to p{}.l{number};",
                number % 16,
                (number + 3) % 16
            );
        }
        let system = read(&text).0.unwrap();
        let scene = draw(&system, &[], "many");
        assert!(scene.height > 16.0 * 50.0 && scene.width > 64.0 * LANE);
    }
}
