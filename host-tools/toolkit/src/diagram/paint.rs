//! Colours and shapes for a finished layout.
//!
//! Kinds of lines differ in dashes and ends, and not in colour alone, so that they can be told
//! apart in black and white too: transitions are solid with an arrow head, data paths thin and
//! dashed between triangles, and borders of regions long-dashed and grey.

use super::drawing::{Arrow, Drawing, Placed, PlacedPort};
use super::face::{self, DETAIL_ROWS, Kind, MARGIN, NAME_ROWS, PORT_NAME_GAP, Side};
use super::grid::{self, Area, CELL, Spot};
use super::label::{self, LINE_ROWS, Line, Piece, Symbol, Type};
use crate::model::Direction;
use crate::pictures::scene::{Anchor, Colour, Part, Point, Scene, Shape, Stroke, Text};

pub(super) const INK: Colour = Colour::opaque(0x1a1a1a);
const SOFT_INK: Colour = Colour::opaque(0x555555);
const REGION_INK: Colour = Colour::opaque(0x6b6b6b);
const PAPER: Colour = Colour::opaque(0xffffff);
const TASK_FILL: Colour = Colour::opaque(0xe6eef7);
const SUPER_FILL: Colour = Colour::opaque(0xf8f6f0);
const HEADING_FILL: Colour = Colour::opaque(0xece7da);
const ROOT_HEADING_FILL: Colour = Colour::opaque(0xdfe3e8);
/// Colours of nets, in turn; all are dark enough to be read in grey.
pub(super) const NET_INKS: [Colour; 6] = [
    Colour::opaque(0x00695c),
    Colour::opaque(0x6a1b9a),
    Colour::opaque(0xa84300),
    Colour::opaque(0x1a4fa3),
    Colour::opaque(0x8a0f3c),
    Colour::opaque(0x4e6b00),
];

const OUTLINE: f32 = 1.1;
const TRANSITION: f32 = 1.15;
const WIRE: f32 = 1.0;
const WIRE_DASH: [f32; 2] = [3.5, 2.0];
const DIVIDER_DASH: [f32; 2] = [9.0, 5.0];
/// Radii of corners.
const STATE_RADIUS: f32 = 9.0;
const TASK_RADIUS: f32 = 2.0;
const BEND_RADIUS: f32 = 4.0;
const WIRE_BEND_RADIUS: f32 = 2.5;
const ARROW_LENGTH: f32 = 7.5;
const ARROW_HALF_WIDTH: f32 = 3.2;

/// Paints a drawing.
pub fn paint(drawing: &Drawing, title: &str, parts: bool) -> Scene {
    let [width, height] = grid::point(drawing.size);
    let mut scene = Scene::new(width, height, title);
    for placed in &drawing.boxes {
        if parts {
            scene.part(part_of_box(placed));
        }
        paint_box(&mut scene, placed);
    }
    if parts {
        scene.part(None);
    }
    for divider in &drawing.dividers {
        paint_border(&mut scene, divider.ends);
    }
    for region in &drawing.region_names {
        let line = Line::words(region.name.as_str());
        let at = [region.area.left, region.area.top];
        write_at(&mut scene, &line, at, label::REGION, REGION_INK);
    }
    let mut inks = vec![SOFT_INK; drawing.ports.len()];
    let mut nets_of = vec![0; drawing.boxes.len()];
    for net in &drawing.nets {
        let count: &mut usize = &mut nets_of[net.parent];
        let ink = NET_INKS[*count % NET_INKS.len()];
        *count += 1;
        for line in &net.lines {
            paint_wire(&mut scene, line, ink);
        }
        for joint in &net.joints {
            scene.circle(grid::point(*joint), 2.3, Some(ink), None);
        }
        for (port, _) in &net.ends {
            // A port of a superstate is on a net outside and on one inside: the outer one comes
            // first.
            if inks[*port] == SOFT_INK {
                inks[*port] = ink;
            }
        }
    }
    for arrow in &drawing.transitions {
        if parts {
            scene.part(Some(part_of_arrow(drawing, arrow)));
        }
        paint_arrow(&mut scene, arrow);
    }
    if parts {
        scene.part(None);
    }
    for (port, ink) in drawing.ports.iter().zip(inks) {
        paint_port(&mut scene, port, ink);
    }
    scene
}

/// A state as a part of the picture; none of a container, which is no state.
fn part_of_box(placed: &Placed) -> Option<Part> {
    let class = match placed.kind {
        Kind::Root => return None,
        Kind::Initial | Kind::Final => "mark",
        Kind::Simple | Kind::Task => "state",
        Kind::Super if placed.is_open => "state open",
        Kind::Super => "state folded",
    };
    Some(Part {
        class,
        names: vec![placed.path.clone()],
        place: placed.span.map(|span| [span.file, span.start]),
    })
}

/// A transition as a part of the picture.
fn part_of_arrow(drawing: &Drawing, arrow: &Arrow) -> Part {
    let path = |index: usize| drawing.boxes.get(index).map(|it| it.path.clone());
    Part {
        class: "transition",
        names: [arrow.from, arrow.to]
            .into_iter()
            .filter_map(path)
            .collect(),
        place: Some([arrow.span.file, arrow.span.start]),
    }
}

/// Paints the border between two regions.
pub(super) fn paint_border(scene: &mut Scene, ends: [Spot; 2]) {
    let stroke = Stroke {
        colour: REGION_INK,
        width: 0.9,
        dash: Some(DIVIDER_DASH),
    };
    scene.line(ends.map(grid::point), stroke);
}

/// Paints a line of a net.
pub(super) fn paint_wire(scene: &mut Scene, corners: &[Spot], ink: Colour) {
    let stroke = Stroke {
        colour: ink,
        width: WIRE,
        dash: Some(WIRE_DASH),
    };
    let points = corners.iter().map(|spot| grid::point(*spot)).collect();
    scene.track(points, WIRE_BEND_RADIUS, stroke);
}

/// Paints a box with what is written in it.
pub(super) fn paint_box(scene: &mut Scene, placed: &Placed) {
    let Area { left, top, .. } = placed.area;
    let corner = grid::point([left, top]);
    let size = grid::point([placed.area.width(), placed.area.height()]);
    let outline = Some(Stroke::solid(INK, OUTLINE));
    match placed.kind {
        Kind::Initial => {
            let (corner, size) = mark(corner, size);
            scene.rounded(corner, size, size[1] / 2.0, Some(INK), None);
            return;
        }
        Kind::Final => {
            let (corner, size) = mark(corner, size);
            scene.rounded(corner, size, size[1] / 2.0, Some(PAPER), outline);
            let inner = [corner[0] + 2.7, corner[1] + 2.7];
            let inner_size = [size[0] - 5.4, size[1] - 5.4];
            scene.rounded(inner, inner_size, inner_size[1] / 2.0, Some(INK), None);
            return;
        }
        Kind::Simple => scene.rounded(corner, size, STATE_RADIUS, Some(PAPER), outline),
        Kind::Task => scene.rounded(corner, size, TASK_RADIUS, Some(TASK_FILL), outline),
        Kind::Super | Kind::Root => {
            let (fill, heading_fill) = match placed.kind {
                Kind::Root => (PAPER, ROOT_HEADING_FILL),
                _ => (SUPER_FILL, HEADING_FILL),
            };
            scene.rounded(corner, size, STATE_RADIUS, Some(fill), None);
            if placed.is_open {
                let heading = grid::point([0, placed.heading().height()])[1];
                paint_heading(scene, corner, size[0], heading, heading_fill);
            }
            scene.rounded(corner, size, STATE_RADIUS, None, outline);
            if !placed.is_open {
                // A second line inside the first: there is more in it than is shown.
                let inner = [corner[0] + 2.5, corner[1] + 2.5];
                let inner_size = [size[0] - 5.0, size[1] - 5.0];
                let thin = Some(Stroke::solid(SOFT_INK, 0.6));
                scene.rounded(inner, inner_size, STATE_RADIUS - 2.5, None, thin);
            }
        }
    }
    let middle = corner[0] + size[0] / 2.0;
    if placed.is_open {
        let column = corner[0] + CELL * MARGIN as f32;
        let mut row = corner[1] + CELL * face::heading_rows(0) as f32 / 2.0;
        write_line(scene, &placed.name, [column, row], label::NAME, INK);
        row += 1.0;
        for line in &placed.details {
            row += CELL * DETAIL_ROWS as f32;
            write_line(scene, line, [column, row], label::DETAIL, SOFT_INK);
        }
        return;
    }
    let mut row = corner[1] + CELL * NAME_ROWS as f32 / 2.0 + 1.0;
    write_centred(scene, &placed.name, [middle, row], label::NAME, INK);
    row += CELL * (NAME_ROWS + DETAIL_ROWS) as f32 / 2.0 - 1.5;
    for line in &placed.details {
        write_centred(scene, line, [middle, row], label::DETAIL, SOFT_INK);
        row += CELL * DETAIL_ROWS as f32;
    }
}

/// The visible part of the box of `initial` or `final`: as wide as its lines need it.
fn mark(corner: Point, size: [f32; 2]) -> (Point, [f32; 2]) {
    (
        [corner[0] + CELL, corner[1]],
        [size[0] - 2.0 * CELL, size[1]],
    )
}

/// The ground of a heading: round above, straight below.
fn paint_heading(scene: &mut Scene, corner: Point, width: f32, height: f32, fill: Colour) {
    scene.rounded(corner, [width, height], STATE_RADIUS, Some(fill), None);
    let lower = [corner[0], corner[1] + height / 2.0];
    scene.rectangle(lower, [width, height / 2.0], fill, None);
    let row = corner[1] + height;
    scene.line(
        [[corner[0], row], [corner[0] + width, row]],
        Stroke::solid(SOFT_INK, 0.6),
    );
}

/// Paints a transition and its label.
pub(super) fn paint_arrow(scene: &mut Scene, arrow: &Arrow) {
    let mut points: Vec<Point> = arrow.route.iter().map(|spot| grid::point(*spot)).collect();
    let [.., before, end] = points[..] else {
        return;
    };
    let length = (end[0] - before[0]).abs() + (end[1] - before[1]).abs();
    if length > 0.0 {
        let towards = [(end[0] - before[0]) / length, (end[1] - before[1]) / length];
        let base = [
            end[0] - towards[0] * ARROW_LENGTH,
            end[1] - towards[1] * ARROW_LENGTH,
        ];
        let across = [
            -towards[1] * ARROW_HALF_WIDTH,
            towards[0] * ARROW_HALF_WIDTH,
        ];
        if let Some(last) = points.last_mut() {
            // The line ends inside the head, so that the tip stays sharp.
            *last = [
                end[0] - towards[0] * ARROW_LENGTH * 0.6,
                end[1] - towards[1] * ARROW_LENGTH * 0.6,
            ];
        }
        scene.track(points, BEND_RADIUS, Stroke::solid(INK, TRANSITION));
        scene.shapes.push(Shape::Polygon {
            corners: vec![
                end,
                [base[0] + across[0], base[1] + across[1]],
                [base[0] - across[0], base[1] - across[1]],
            ],
            fill: Some(INK),
            stroke: None,
        });
    }
    if let Some((area, lines)) = &arrow.label {
        for (row, line) in (area.top..).step_by(LINE_ROWS as usize).zip(lines) {
            write_at(scene, line, [area.left, row], label::LABEL, INK);
        }
    }
}

/// Paints a data port and its name.
pub(super) fn paint_port(scene: &mut Scene, port: &PlacedPort, ink: Colour) {
    let [x, y] = grid::point(port.at);
    let (half, reach) = (3.4, CELL);
    // Outside of the box, from its edge to where the wire begins.
    let (outer, inner) = match port.side {
        Side::Left => (x - reach, x),
        Side::Right => (x + reach, x),
    };
    let corners = match (port.side, port.direction) {
        (_, Direction::In) => vec![[inner, y], [outer, y - half], [outer, y + half]],
        (_, Direction::Out) => vec![[outer, y], [inner, y - half], [inner, y + half]],
        (_, Direction::InOut) => {
            let middle = (outer + inner) / 2.0;
            vec![
                [outer, y],
                [middle, y - half],
                [inner, y],
                [middle, y + half],
            ]
        }
    };
    scene.shapes.push(Shape::Polygon {
        corners,
        fill: Some(if port.optional { PAPER } else { ink }),
        stroke: Some(Stroke::solid(ink, 0.8)),
    });
    let row = y + label::PORT.size * 0.36;
    let gap = CELL * PORT_NAME_GAP as f32;
    let (at, anchor) = match port.side {
        Side::Left => ([x + gap, row], Anchor::Start),
        Side::Right => ([x - gap, row], Anchor::End),
    };
    scene.text(Text {
        at,
        words: port.name.clone(),
        size: label::PORT.size,
        weight: label::PORT.weight,
        colour: SOFT_INK,
        anchor,
    });
}

/// Writes a line whose upper left corner is at a place.
pub(super) fn write_at(scene: &mut Scene, line: &Line, at: Spot, set: Type, ink: Colour) {
    let [x, y] = grid::point(at);
    let middle = y + CELL * LINE_ROWS as f32 / 2.0;
    write_line(scene, line, [x, middle], set, ink);
}

fn write_centred(scene: &mut Scene, line: &Line, [x, y]: Point, set: Type, ink: Colour) {
    write_line(scene, line, [x - line.width(set) / 2.0, y], set, ink);
}

/// Writes a line that begins at `x`, its letters around the height `y`.
fn write_line(scene: &mut Scene, line: &Line, [x, y]: Point, set: Type, ink: Colour) {
    let mut x = x;
    // Capitals of the embedded font are 0.71 em high.
    let base = y + 0.357 * set.size;
    for piece in &line.0 {
        match piece {
            Piece::Words(words) => {
                scene.text(Text {
                    at: [x, base],
                    words: words.clone(),
                    size: set.size,
                    weight: set.weight,
                    colour: ink,
                    anchor: Anchor::Start,
                });
                x += crate::pictures::font::width(words, set.size, set.weight);
            }
            Piece::Symbol(symbol) => {
                let width = symbol.width_em() * set.size;
                paint_symbol(scene, *symbol, [x + width / 2.0, base], set.size, ink);
                x += width;
            }
        }
    }
}

/// Draws a symbol around a column, on a base line.
fn paint_symbol(scene: &mut Scene, symbol: Symbol, [x, base]: Point, em: f32, ink: Colour) {
    let pen = Stroke::solid(ink, 0.095 * em);
    // Half-way up a capital; symbols stand around it.
    let y = base - 0.357 * em;
    let at = |right: f32, down: f32| [x + right * em, y + down * em];
    let ring = 0.33 * em;
    match symbol {
        Symbol::Event => {
            scene.line([at(0.0, 0.36), at(0.0, -0.36)], pen);
            scene.line([at(-0.2, -0.12), at(0.0, -0.38), at(0.2, -0.12)], pen);
        }
        Symbol::Exit => {
            scene.circle([x, y], ring, None, Some(pen));
            scene.circle([x, y], 0.12 * em, Some(ink), None);
        }
        Symbol::Timeout => {
            scene.circle([x, y], ring, None, Some(pen));
            scene.line([at(-0.23, -0.23), at(0.23, 0.23)], pen);
            scene.line([at(-0.23, 0.23), at(0.23, -0.23)], pen);
        }
        Symbol::Busy => {
            scene.circle([x, y], ring, None, Some(pen));
            scene.line([at(-0.23, 0.23), at(0.23, -0.23)], pen);
        }
        Symbol::Own => scene.circle([x, y], 0.17 * em, Some(ink), None),
        Symbol::Parent => scene.circle([x, y], 0.16 * em, None, Some(pen)),
        Symbol::And => scene.line([at(-0.26, 0.3), at(0.0, -0.3), at(0.26, 0.3)], pen),
        Symbol::Or => scene.line([at(-0.26, -0.3), at(0.0, 0.3), at(0.26, -0.3)], pen),
        Symbol::Not => scene.line([at(-0.24, 0.0), at(0.24, 0.0)], pen),
    }
}
