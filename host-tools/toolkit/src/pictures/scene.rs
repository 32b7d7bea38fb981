//! What a picture shows: shapes and words at places, in the order in which they are painted.
//!
//! Lengths are in units of a hundredth of an inch or so: a pixel where the picture is shown at its
//! own size. x grows to the right, y downwards.

use super::font::Weight;

/// A colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour {
    /// Red, green and blue, 0 to 255 each.
    pub rgb: [u8; 3],
    /// 255 hides what is below.
    pub alpha: u8,
}

impl Colour {
    /// A colour that hides what is below: `0xRRGGBB`.
    pub const fn opaque(rgb: u32) -> Self {
        let [_, red, green, blue] = rgb.to_be_bytes();
        Colour {
            rgb: [red, green, blue],
            alpha: 255,
        }
    }

    /// The colour with another alpha.
    pub const fn with_alpha(self, alpha: u8) -> Self {
        Colour { alpha, ..self }
    }
}

/// A point: x and y.
pub type Point = [f32; 2];

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Colour.
    pub colour: Colour,
    /// Width.
    pub width: f32,
    /// Length of the dashes and of the gaps between them; `None` for a solid line.
    pub dash: Option<[f32; 2]>,
}

impl Stroke {
    /// A solid line.
    pub const fn solid(colour: Colour, width: f32) -> Self {
        Stroke {
            colour,
            width,
            dash: None,
        }
    }
}

/// Which part of a text stands at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// Its start.
    Start,
    /// Its middle.
    Middle,
    /// Its end.
    End,
}

/// A line of words.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// Where the anchor's end of the base line is.
    pub at: Point,
    /// The words.
    pub words: String,
    /// Height of the letters' em.
    pub size: f32,
    /// Weight.
    pub weight: Weight,
    /// Colour.
    pub colour: Colour,
    /// What stands at `at`.
    pub anchor: Anchor,
}

/// A line of words, in one call.
pub(crate) fn words(
    at: Point,
    text: &str,
    size: f32,
    weight: Weight,
    colour: Colour,
    anchor: Anchor,
) -> Text {
    Text {
        at,
        words: text.into(),
        size,
        weight,
        colour,
        anchor,
    }
}

/// Something painted.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A polygon: closed, filled, with or without an outline.
    Polygon {
        /// Its corners.
        corners: Vec<Point>,
        /// What it is filled with.
        fill: Option<Colour>,
        /// Its outline.
        stroke: Option<Stroke>,
    },
    /// A rectangle with round corners.
    Rounded {
        /// Its upper left corner, before that is rounded.
        corner: Point,
        /// Width and height.
        size: [f32; 2],
        /// Radius of the corners.
        radius: f32,
        /// What it is filled with.
        fill: Option<Colour>,
        /// Its outline.
        stroke: Option<Stroke>,
    },
    /// Lines through points, open, with round bends.
    Track {
        /// The points.
        points: Vec<Point>,
        /// Radius of the bends; where lines are short it is less.
        radius: f32,
        /// How it is drawn; ends are flat.
        stroke: Stroke,
    },
    /// Lines through points, open.
    Line {
        /// The points.
        points: Vec<Point>,
        /// How it is drawn; ends and corners are round.
        stroke: Stroke,
    },
    /// A circle.
    Circle {
        /// Its centre.
        centre: Point,
        /// Its radius.
        radius: f32,
        /// What it is filled with.
        fill: Option<Colour>,
        /// Its outline.
        stroke: Option<Stroke>,
    },
    /// A line of words.
    Text(Text),
    /// What a pointer that rests on the next shape is told (SVG only).
    Tooltip(String),
    /// What the shapes up to the next of these are a part of; nothing where there is none (SVG
    /// only).
    Part(Option<Part>),
}

/// A part of a picture that a page finds again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Part {
    /// What kind of part it is.
    pub class: &'static str,
    /// What it is called: the path of a state, or source and target of a transition.
    pub names: Vec<String>,
    /// Index of its file, and its first byte there.
    pub place: Option<[u32; 2]>,
}

impl Shape {
    /// The same, moved down.
    fn lower(mut self, down: f32) -> Self {
        match &mut self {
            Shape::Polygon {
                corners: points, ..
            }
            | Shape::Track { points, .. }
            | Shape::Line { points, .. } => {
                for point in points {
                    point[1] += down;
                }
            }
            Shape::Rounded { corner: place, .. }
            | Shape::Circle { centre: place, .. }
            | Shape::Text(Text { at: place, .. }) => place[1] += down,
            Shape::Tooltip(_) | Shape::Part(_) => {}
        }
        self
    }
}

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Width.
    pub width: f32,
    /// Height.
    pub height: f32,
    /// What the picture is, for those who cannot see it and for the window's title.
    pub title: String,
    /// The shapes, first painted first.
    pub shapes: Vec<Shape>,
}

impl Scene {
    /// An empty, white picture.
    pub fn new(width: f32, height: f32, title: &str) -> Self {
        Scene {
            width,
            height,
            title: title.into(),
            shapes: Vec::new(),
        }
    }

    /// Adds a line through points.
    pub fn line(&mut self, points: impl Into<Vec<Point>>, stroke: Stroke) {
        self.shapes.push(Shape::Line {
            points: points.into(),
            stroke,
        });
    }

    /// Adds a filled rectangle; `corner` is its upper left one.
    pub fn rectangle(
        &mut self,
        corner: Point,
        size: [f32; 2],
        fill: Colour,
        stroke: Option<Stroke>,
    ) {
        let [left, top] = corner;
        let (right, bottom) = (left + size[0], top + size[1]);
        let corners = vec![[left, top], [right, top], [right, bottom], [left, bottom]];
        self.shapes.push(Shape::Polygon {
            corners,
            fill: Some(fill),
            stroke,
        });
    }

    /// Adds a rectangle with round corners.
    pub fn rounded(
        &mut self,
        corner: Point,
        size: [f32; 2],
        radius: f32,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    ) {
        self.shapes.push(Shape::Rounded {
            corner,
            size,
            radius,
            fill,
            stroke,
        });
    }

    /// Adds a line through points, with round bends.
    pub fn track(&mut self, points: Vec<Point>, radius: f32, stroke: Stroke) {
        self.shapes.push(Shape::Track {
            points,
            radius,
            stroke,
        });
    }

    /// Adds a circle.
    pub fn circle(
        &mut self,
        centre: Point,
        radius: f32,
        fill: Option<Colour>,
        stroke: Option<Stroke>,
    ) {
        self.shapes.push(Shape::Circle {
            centre,
            radius,
            fill,
            stroke,
        });
    }

    /// Adds a line of words.
    pub fn text(&mut self, text: Text) {
        self.shapes.push(Shape::Text(text));
    }

    /// Adds another picture below this one, which grows as it needs to.
    pub fn below(&mut self, other: Scene) {
        let top = self.height;
        self.width = self.width.max(other.width);
        self.height += other.height;
        let moved = other.shapes.into_iter().map(|shape| shape.lower(top));
        self.shapes.extend(moved);
    }

    /// Says what the shapes from here on are a part of.
    pub fn part(&mut self, part: Option<Part>) {
        self.shapes.push(Shape::Part(part));
    }

    /// Says what the next shape is, to a pointer that rests on it.
    pub fn tooltip(&mut self, words: impl Into<String>) {
        self.shapes.push(Shape::Tooltip(words.into()));
    }
}

/// A part of a path that is made of lines and curves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Leg {
    /// A line to a point.
    Line(Point),
    /// A quadratic curve: its control point, and the point that it leads to.
    Curve(Point, Point),
}

/// The path of a [`Shape::Track`]: where it begins, and how it goes on. `None` for fewer than two
/// points.
pub(super) fn legs(points: &[Point], radius: f32) -> Option<(Point, Vec<Leg>)> {
    let (first, rest) = points.split_first()?;
    let last = rest.last()?;
    let mut legs = Vec::with_capacity(2 * rest.len());
    for [before, bend, after] in points.array_windows() {
        let room = distance(*before, *bend).min(distance(*bend, *after)) / 2.0;
        let radius = radius.min(room);
        if radius > 0.0 {
            legs.push(Leg::Line(towards(*bend, *before, radius)));
            legs.push(Leg::Curve(*bend, towards(*bend, *after, radius)));
        } else {
            legs.push(Leg::Line(*bend));
        }
    }
    legs.push(Leg::Line(*last));
    Some((*first, legs))
}

fn distance(from: Point, to: Point) -> f32 {
    libm::hypotf(to[0] - from[0], to[1] - from[1])
}

/// The point at a distance from another one in the direction of a third, which is elsewhere.
fn towards(from: Point, to: Point, length: f32) -> Point {
    let share = length / distance(from, to);
    [
        from[0] + (to[0] - from[0]) * share,
        from[1] + (to[1] - from[1]) * share,
    ]
}
