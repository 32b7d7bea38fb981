//! A task by itself: its box as the diagrams draw it, with all that goes in on the left and all
//! that comes out on the right, and beside each port what it carries.

use super::drawing::{Arrow, Placed, PlacedPort};
use super::face::{self, DETAIL_ROWS, FOOT_ROWS, Kind, NAME_ROWS, PORT_NAME_GAP, PORT_ROWS, Side};
use super::grid::{self, Area, LANE, Spot};
use super::label::{self, Line, Piece, Symbol};
use super::paint;
use crate::model::{DataPort, Direction, Flag, Span, Task};
use crate::pictures::scene::Scene;
use crate::scenario::time::Time;

/// Cells of the line at a port or a flag, outside of the box.
const REACH: i32 = 5;
/// Cells between such a line and its words.
const GAP: i32 = 1;
/// Cells around all.
const MARGIN: i32 = 2;
/// Cells between what stands on the left and on the right in the box.
const BETWEEN: i32 = 3;
/// Cells of the box, at least.
const LEAST_WIDTH: i32 = 16;

/// A data port or flag at its place.
struct Entry<'t> {
    what: What<'t>,
    side: Side,
    /// Its row, from the top of the box.
    row: i32,
    /// What stands in the box.
    name: Line,
    /// What stands outside.
    beside: Line,
}

enum What<'t> {
    Data(&'t DataPort),
    Flag,
}

/// Draws a task. `slot` is the number of the slot that its declaration names.
pub fn draw(task: &Task, slot: Option<u32>) -> Scene {
    let details = details(task, slot);
    let first = NAME_ROWS + DETAIL_ROWS * details.len() as i32 + PORT_ROWS / 2;
    let entries = entries(task, first);
    let widest = |side: Side, line: &dyn Fn(&Entry<'_>) -> i32| {
        let on_side = entries.iter().filter(|entry| entry.side == side);
        on_side.map(line).max().unwrap_or(0)
    };
    let name_cells = |entry: &Entry<'_>| PORT_NAME_GAP + cells(&entry.name, label::PORT);
    let beside_cells = |entry: &Entry<'_>| REACH + GAP + cells(&entry.beside, label::PORT);

    let name = Line::words(label::name(&task.name));
    let texts = details.iter().map(|line| cells(line, label::DETAIL));
    let text = texts.chain([cells(&name, label::NAME)]).max().unwrap_or(0);
    let names = widest(Side::Left, &name_cells) + BETWEEN + widest(Side::Right, &name_cells);
    let width = names.max(text + 2 * face::MARGIN).max(LEAST_WIDTH);
    let lowest = entries.iter().map(|entry| entry.row + PORT_ROWS / 2).max();
    let height = lowest.unwrap_or(first - PORT_ROWS / 2) + FOOT_ROWS;
    let left = MARGIN + widest(Side::Left, &beside_cells);
    let area = Area::new([left, MARGIN], [(width + LANE - 1) / LANE * LANE, height]);

    let right = area.right + widest(Side::Right, &beside_cells) + MARGIN;
    let [across, down] = grid::point([right, area.bottom + MARGIN]);
    let mut scene = Scene::new(across, down, &format!("task {name}"));
    let placed = Placed {
        area,
        parent: None,
        kind: Kind::Task,
        path: String::new(),
        span: None,
        is_open: false,
        name,
        details,
    };
    paint::paint_box(&mut scene, &placed);
    for entry in &entries {
        paint_entry(&mut scene, entry, area);
    }
    scene
}

/// What stands below the name.
fn details(task: &Task, slot: Option<u32>) -> Vec<Line> {
    let mut parts = Vec::new();
    if let Some(slot) = slot {
        parts.push(format!("slot {slot}"));
    }
    if let Some(wcet_us) = task.wcet_us {
        parts.push(format!("wcet {}", Time { us: wcet_us.into() }));
    }
    if task.endless {
        parts.push("endless".to_owned());
    }
    if parts.is_empty() {
        return Vec::new();
    }
    vec![Line::words(parts.join(" · "))]
}

/// What goes in and out, each side from the top: data, then flags.
fn entries(task: &Task, first: i32) -> Vec<Entry<'_>> {
    let data = (task.data.iter()).map(|port| (What::Data(port), port.direction));
    let flags = (task.flags.iter()).map(|flag| (What::Flag, flag.direction));
    let names = (task.data.iter()).map(|port| Line::words(label::name(&port.name)));
    let names = names.chain(task.flags.iter().map(flag_name));
    let mut next = [first; 2];
    let all = data.chain(flags).zip(names);
    all.map(|((what, direction), name)| {
        let side = match direction {
            Direction::In | Direction::InOut => Side::Left,
            Direction::Out => Side::Right,
        };
        let row = next[side as usize];
        next[side as usize] += PORT_ROWS;
        let beside = match what {
            What::Data(port) => Line::words(carried(port)),
            What::Flag => Line::default(),
        };
        Entry {
            what,
            side,
            row,
            name,
            beside,
        }
    })
    .collect()
}

fn flag_name(flag: &Flag) -> Line {
    Line(vec![
        Piece::Symbol(Symbol::Own),
        Piece::Words(label::name(&flag.name).into_owned()),
    ])
}

/// What a port carries, in the words of the source.
fn carried(port: &DataPort) -> String {
    let mut words = label::name(&port.type_name).into_owned();
    if port.optional {
        words.push_str(" optional");
    }
    if let Some(within_us) = port.within_us {
        words += &format!(
            " within {}",
            Time {
                us: within_us.into()
            }
        );
    }
    words
}

fn cells(line: &Line, set: label::Type) -> i32 {
    match line.0.as_slice() {
        [] => 0,
        _ => grid::cells(line.width(set)),
    }
}

fn paint_entry(scene: &mut Scene, entry: &Entry<'_>, area: Area) {
    let row = area.top + entry.row;
    let (edge, outer) = match entry.side {
        Side::Left => (area.left, area.left - REACH),
        Side::Right => (area.right, area.right + REACH),
    };
    let inside = match entry.side {
        Side::Left => edge + PORT_NAME_GAP,
        Side::Right => edge - PORT_NAME_GAP - cells(&entry.name, label::PORT),
    };
    match entry.what {
        What::Data(port) => {
            let ink = paint::NET_INKS[0];
            let tip = match entry.side {
                Side::Left => edge - 1,
                Side::Right => edge + 1,
            };
            paint::paint_wire(scene, &[[outer, row], [tip, row]], ink);
            let port = PlacedPort {
                owner: 0,
                at: [edge, row],
                side: entry.side,
                direction: port.direction,
                optional: port.optional,
                name_area: Area::default(),
                name: label::name(&port.name).into_owned(),
            };
            paint::paint_port(scene, &port, ink);
        }
        What::Flag => {
            let mut route = vec![[outer, row], [edge, row]];
            if entry.side == Side::Right {
                route.reverse();
            }
            let arrow = Arrow {
                from: 0,
                to: 0,
                route,
                label: None,
                span: Span::default(),
            };
            paint::paint_arrow(scene, &arrow);
            write(scene, &entry.name, [inside, row]);
        }
    }
    let beside = match entry.side {
        Side::Left => outer - GAP - cells(&entry.beside, label::PORT),
        Side::Right => outer + GAP,
    };
    write(scene, &entry.beside, [beside, row]);
}

/// Writes a line around a row.
fn write(scene: &mut Scene, line: &Line, [left, row]: Spot) {
    let at = [left, row - label::LINE_ROWS / 2];
    paint::write_at(scene, line, at, label::PORT, paint::INK);
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test that cannot go on has failed

    use super::*;
    use crate::lang::load_text;
    use crate::pictures::font;
    use crate::pictures::scene::{Anchor, Shape, Text};

    fn drawn(text: &str) -> (Scene, Vec<Text>) {
        let scene = draw(
            &load_text("case.esm", text).model.unwrap().tasks[0],
            Some(2),
        );
        let text_of = |shape: &Shape| match shape {
            Shape::Text(text) => Some(text.clone()),
            _ => None,
        };
        let texts = scene.shapes.iter().filter_map(text_of).collect();
        (scene, texts)
    }

    fn left_edge(text: &Text) -> f32 {
        let width = font::width(&text.words, text.size, text.weight);
        match text.anchor {
            Anchor::Start => text.at[0],
            Anchor::Middle => text.at[0] - width / 2.0,
            Anchor::End => text.at[0] - width,
        }
    }

    const TASK: &str = "task Follow slot 2 wcet 300 us endless {
        in data line: Line optional within 100 ms; inout data budget: Budget; out data twist: Twist;
        in flag left; out flag seen; param gain: f32 = 1.0 min 0.0 max 2.0; }";

    #[test]
    fn what_goes_in_stands_left_of_what_comes_out() {
        let (_, texts) = drawn(TASK);
        let at = |words: &str| {
            let text = texts.iter().find(|text| text.words == words);
            left_edge(text.unwrap_or_else(|| panic!("no {words}: {texts:?}")))
        };
        let middle = at("Follow");
        for words in [
            "Line optional within 100 ms",
            "line",
            "Budget",
            "budget",
            "left",
        ] {
            assert!(at(words) < middle, "{words}");
        }
        for words in ["twist", "Twist", "seen"] {
            assert!(at(words) > middle, "{words}");
        }
        assert!(at("slot 2 · wcet 300 us · endless") > at("Line optional within 100 ms"));
    }

    #[test]
    fn all_of_it_stands_on_the_sheet_and_nothing_on_another() {
        let long = "n".repeat(200);
        let ports: String = (0..8)
            .map(|at| {
                format!("in data {long}{at}: T{long} within 100 ms; out data o{long}{at}: U;")
            })
            .collect();
        let crowd = format!("task T{long} slot 2 {{ {ports} out flag f{long}; in flag g{long}; }}");
        for text in [TASK, "task T { }", &crowd] {
            let (scene, texts) = drawn(text);
            for (index, text) in texts.iter().enumerate() {
                let left = left_edge(text);
                let right = left + font::width(&text.words, text.size, text.weight);
                assert!(left >= 0.0 && right <= scene.width, "{text:?}");
                assert!(text.at[1] > 0.0 && text.at[1] < scene.height, "{text:?}");
                for other in &texts[..index] {
                    let from = left_edge(other);
                    let to = from + font::width(&other.words, other.size, other.weight);
                    let apart = right <= from || to <= left;
                    assert!(
                        apart || (text.at[1] - other.at[1]).abs() > 7.0,
                        "{text:?} {other:?}"
                    );
                }
            }
        }
    }
}
