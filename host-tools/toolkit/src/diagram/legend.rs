//! What the symbols mean, below a picture that leaves the house without its manual.

use super::drawing::{Arrow, Placed, PlacedPort};
use super::face::{Kind, Side};
use super::grid::{Area, CELL, Spot};
use super::label::{self, Line, Piece, Symbol};
use super::paint;
use crate::model::{Direction, Span};
use crate::pictures::scene::Scene;

/// Cells of an entry: its sample, and the words beside it.
const SAMPLE: i32 = 12;
const COLUMN: i32 = 48;
/// Rows of an entry.
const ROW: i32 = 4;
/// Cells around the legend.
const MARGIN: i32 = 3;

/// What stands beside the words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sample {
    Box(Kind),
    Border,
    Transition,
    Data,
    Symbol(Symbol),
    Turn,
}

const ENTRIES: [(Sample, &str); 18] = [
    (Sample::Box(Kind::Simple), "simple state"),
    (Sample::Box(Kind::Task), "task state"),
    (Sample::Box(Kind::Super), "superstate, its inside not shown"),
    (Sample::Box(Kind::Initial), "initial"),
    (Sample::Box(Kind::Final), "final"),
    (Sample::Border, "border between two regions"),
    (Sample::Transition, "transition: event[guard]/actions"),
    (Sample::Data, "data path (hollow: optional)"),
    (
        Sample::Symbol(Symbol::Event),
        "the pulse; with a name, that event",
    ),
    (Sample::Symbol(Symbol::Exit), "the state has finished"),
    (
        Sample::Symbol(Symbol::Timeout),
        "its time limit; it is over",
    ),
    (Sample::Symbol(Symbol::Busy), "its task cannot be executed"),
    (
        Sample::Symbol(Symbol::Own),
        "flag of the state left, or entered",
    ),
    (
        Sample::Symbol(Symbol::Parent),
        "flag of the superstate around",
    ),
    (Sample::Symbol(Symbol::And), "and"),
    (Sample::Symbol(Symbol::Or), "or"),
    (
        Sample::Symbol(Symbol::Not),
        "not; among actions, the flag is cleared",
    ),
    (Sample::Turn, "turn among those on the same event"),
];

/// Adds the legend below what a scene shows; a narrow scene grows to hold it.
pub fn add(scene: &mut Scene) {
    let top = (scene.height / CELL) as i32;
    let across = ((scene.width / CELL) as i32 - 2 * MARGIN).max(COLUMN);
    let columns = (across / COLUMN).min(ENTRIES.len() as i32);
    let rows = (ENTRIES.len() as i32 + columns - 1) / columns;
    for (index, (sample, words)) in (0..).zip(ENTRIES) {
        let corner = [MARGIN + index / rows * COLUMN, top + index % rows * ROW];
        show(scene, sample, corner);
        let at = [corner[0] + SAMPLE + 2, corner[1] + ROW / 2 - 1];
        paint::write_at(scene, &Line::words(words), at, label::LABEL, paint::INK);
    }
    scene.width = scene.width.max(CELL * (across + 2 * MARGIN) as f32);
    scene.height += CELL * (rows * ROW + MARGIN) as f32;
}

/// Paints a sample into the cells from `corner` on.
fn show(scene: &mut Scene, sample: Sample, [left, top]: Spot) {
    let middle = top + ROW / 2;
    match sample {
        Sample::Box(kind) => {
            let size = match kind {
                Kind::Initial | Kind::Final => [4, 2],
                _ => [SAMPLE - 4, 3],
            };
            paint::paint_box(
                scene,
                &Placed {
                    area: Area::new(
                        [left + (SAMPLE - size[0]) / 2, middle - (size[1] + 1) / 2],
                        size,
                    ),
                    parent: None,
                    kind,
                    path: String::new(),
                    span: None,
                    is_open: false,
                    name: Line::default(),
                    details: Vec::new(),
                },
            );
        }
        Sample::Border => paint::paint_border(scene, [[left, middle], [left + SAMPLE, middle]]),
        Sample::Transition => paint::paint_arrow(
            scene,
            &Arrow {
                from: 0,
                to: 0,
                route: vec![[left, middle], [left + SAMPLE, middle]],
                label: None,
                span: Span::default(),
            },
        ),
        Sample::Data => {
            let ink = paint::NET_INKS[0];
            paint::paint_wire(
                scene,
                &[[left + 2, middle], [left + SAMPLE - 2, middle]],
                ink,
            );
            for (column, side, direction) in [
                (left + 1, Side::Right, Direction::Out),
                (left + SAMPLE - 1, Side::Left, Direction::In),
            ] {
                let port = PlacedPort {
                    owner: 0,
                    at: [column, middle],
                    side,
                    direction,
                    optional: false,
                    name_area: Area::default(),
                    name: String::new(),
                };
                paint::paint_port(scene, &port, ink);
            }
        }
        Sample::Turn | Sample::Symbol(_) => {
            let line = match sample {
                Sample::Symbol(symbol) => Line(vec![Piece::Symbol(symbol)]),
                _ => Line::words("1:"),
            };
            let at = [left + SAMPLE / 2 - 1, middle - 1];
            paint::write_at(scene, &line, at, label::LABEL, paint::INK);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::font;
    use crate::pictures::scene::Shape;

    #[test]
    fn every_word_of_the_legend_has_room_in_its_column() {
        for (_, words) in ENTRIES {
            let width = font::width(words, label::LABEL.size, label::LABEL.weight);
            assert!(
                width < CELL * (COLUMN - SAMPLE - 3) as f32,
                "{words}: {width}"
            );
        }
    }

    #[test]
    fn the_legend_stands_below_the_picture_and_inside_the_sheet() {
        for [width, height] in [[10.0, 10.0], [500.0, 300.0], [5000.0, 100.0]] {
            let mut scene = Scene::new(width, height, "");
            add(&mut scene);
            let texts: Vec<_> = scene
                .shapes
                .iter()
                .filter_map(|shape| match shape {
                    Shape::Text(text) => Some(text),
                    _ => None,
                })
                .collect();
            assert!(texts.len() >= ENTRIES.len());
            for text in texts {
                let right = text.at[0] + font::width(&text.words, text.size, text.weight);
                assert!(
                    text.at[1] > height - CELL && text.at[1] < scene.height,
                    "{text:?}"
                );
                assert!(right < scene.width, "{text:?} {}", scene.width);
            }
        }
    }
}
