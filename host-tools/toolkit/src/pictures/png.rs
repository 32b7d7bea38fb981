//! A scene as PNG.

use thiserror::Error;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, StrokeDash, Transform,
};
use ttf_parser::OutlineBuilder;

use super::font;
use super::scene::{self, Anchor, Colour, Leg, Point, Scene, Shape, Stroke, Text};

/// Dots for each unit of a scene: sharp on today's screens and fit to print.
const DOTS_PER_UNIT: f32 = 2.0;

/// Dots of a picture at most: they take four bytes each while it is drawn.
pub const MAX_DOTS: u64 = 100_000_000;

/// Why a scene cannot become a PNG.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum PngError {
    /// It has no area, or more than `MAX_DOTS`.
    #[error(
        "a PNG of {width} × {height} dots cannot be made, {MAX_DOTS} in all are the most: an SVG has no such limit"
    )]
    Size {
        /// Dots across.
        width: u32,
        /// Dots down.
        height: u32,
    },
    /// The encoder failed.
    #[error("the picture could not be encoded: {0}")]
    Encoding(String),
}

impl Scene {
    /// The picture as a PNG file, two dots a unit.
    ///
    /// # Errors
    /// If the picture has no area or more than `MAX_DOTS`.
    pub fn to_png(&self) -> Result<Vec<u8>, PngError> {
        // Float to integer conversions saturate, so that absurd sizes are refused below.
        let (width, height) = (
            (self.width * DOTS_PER_UNIT) as u32,
            (self.height * DOTS_PER_UNIT) as u32,
        );
        let too_large = PngError::Size { width, height };
        if u64::from(width) * u64::from(height) > MAX_DOTS {
            return Err(too_large);
        }
        let mut pixmap = Pixmap::new(width, height).ok_or(too_large)?;
        pixmap.fill(Color::WHITE);
        for shape in &self.shapes {
            draw(&mut pixmap, shape);
        }
        pixmap
            .encode_png()
            .map_err(|error| PngError::Encoding(error.to_string()))
    }
}

fn draw(pixmap: &mut Pixmap, shape: &Shape) {
    match shape {
        Shape::Polygon {
            corners,
            fill,
            stroke,
        } => {
            if let Some(path) = polyline(corners, true) {
                paint(pixmap, &path, *fill, *stroke);
            }
        }
        Shape::Rounded {
            corner,
            size,
            radius,
            fill,
            stroke,
        } => {
            if let Some(path) = rounded(*corner, *size, *radius) {
                paint(pixmap, &path, *fill, *stroke);
            }
        }
        Shape::Track {
            points,
            radius,
            stroke,
        } => {
            if let Some(path) = track(points, *radius) {
                paint(pixmap, &path, None, Some(*stroke));
            }
        }
        Shape::Line { points, stroke } => {
            if let Some(path) = polyline(points, false) {
                paint(pixmap, &path, None, Some(*stroke));
            }
        }
        Shape::Circle {
            centre: [x, y],
            radius,
            fill,
            stroke,
        } => {
            if let Some(path) = PathBuilder::from_circle(*x, *y, *radius) {
                paint(pixmap, &path, *fill, *stroke);
            }
        }
        Shape::Text(text) => draw_text(pixmap, text),
        Shape::Tooltip(_) | Shape::Part(_) => {}
    }
}

fn draw_text(pixmap: &mut Pixmap, text: &Text) {
    let width = font::width(&text.words, text.size, text.weight);
    let [x, y] = text.at;
    let start = match text.anchor {
        Anchor::Start => x,
        Anchor::Middle => x - width / 2.0,
        Anchor::End => x - width,
    };
    let mut letters = Letters(PathBuilder::new());
    font::outline(
        &text.words,
        [start, y],
        text.size,
        text.weight,
        &mut letters,
    );
    // Words of blanks alone have no outline.
    if let Some(path) = letters.0.finish() {
        paint(pixmap, &path, Some(text.colour), None);
    }
}

/// `None` where fewer than two points remain, or where a point is not finite.
fn polyline(points: &[Point], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    let (first, others) = points.split_first()?;
    builder.move_to(first[0], first[1]);
    for [x, y] in others {
        builder.line_to(*x, *y);
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

/// A rectangle with round corners, as SVG has it: no radius is more than half a side. `None` where
/// a number is not finite.
fn rounded([left, top]: Point, [width, height]: [f32; 2], radius: f32) -> Option<Path> {
    /// Length of the control arm of a cubic curve that is a quarter of a circle, in radii.
    const QUARTER: f32 = 0.552_284_8;
    let radius = radius.min(width / 2.0).min(height / 2.0).max(0.0);
    let (right, bottom) = (left + width, top + height);
    let arm = radius * (1.0 - QUARTER);
    let mut builder = PathBuilder::new();
    builder.move_to(left + radius, top);
    builder.line_to(right - radius, top);
    builder.cubic_to(right - arm, top, right, top + arm, right, top + radius);
    builder.line_to(right, bottom - radius);
    builder.cubic_to(
        right,
        bottom - arm,
        right - arm,
        bottom,
        right - radius,
        bottom,
    );
    builder.line_to(left + radius, bottom);
    builder.cubic_to(
        left + arm,
        bottom,
        left,
        bottom - arm,
        left,
        bottom - radius,
    );
    builder.line_to(left, top + radius);
    builder.cubic_to(left, top + arm, left + arm, top, left + radius, top);
    builder.close();
    builder.finish()
}

fn track(points: &[Point], radius: f32) -> Option<Path> {
    let ([x, y], legs) = scene::legs(points, radius)?;
    let mut builder = PathBuilder::new();
    builder.move_to(x, y);
    for leg in legs {
        match leg {
            Leg::Line([x, y]) => builder.line_to(x, y),
            Leg::Curve([cx, cy], [x, y]) => builder.quad_to(cx, cy, x, y),
        }
    }
    builder.finish()
}

fn paint(pixmap: &mut Pixmap, path: &Path, fill: Option<Colour>, stroke: Option<Stroke>) {
    let transform = Transform::from_scale(DOTS_PER_UNIT, DOTS_PER_UNIT);
    if let Some(colour) = fill {
        pixmap.fill_path(path, &paint_of(colour), FillRule::Winding, transform, None);
    }
    if let Some(stroke) = stroke {
        let outline = tiny_skia::Stroke {
            width: stroke.width,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            dash: stroke
                .dash
                .and_then(|dash| StrokeDash::new(dash.to_vec(), 0.0)),
            ..tiny_skia::Stroke::default()
        };
        pixmap.stroke_path(path, &paint_of(stroke.colour), &outline, transform, None);
    }
}

fn paint_of(colour: Colour) -> Paint<'static> {
    let [red, green, blue] = colour.rgb;
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, colour.alpha);
    paint
}

/// Glyph outlines become one path.
struct Letters(PathBuilder);

impl OutlineBuilder for Letters {
    fn move_to(&mut self, x: f32, y: f32) {
        self.0.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.0.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.0.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.0.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.0.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_without_area_is_refused() {
        for (width, height) in [
            (0.0, 10.0),
            (10.0, 0.1),
            (-5.0, 10.0),
            (f32::NAN, 10.0),
            (1e9, 1e9),
        ] {
            assert!(
                matches!(
                    Scene::new(width, height, "").to_png(),
                    Err(PngError::Size { .. })
                ),
                "{width} × {height}"
            );
        }
    }

    #[test]
    fn what_is_painted_shows() {
        let blank = Scene::new(10.0, 10.0, "");
        let mut marked = blank.clone();
        marked.rectangle([2.0, 2.0], [4.0, 4.0], Colour::opaque(0x204060), None);
        let dot = |scene: &Scene| {
            let pixmap = Pixmap::decode_png(&scene.to_png().unwrap()).unwrap();
            let dot = pixmap.pixel(8, 8).unwrap();
            [dot.red(), dot.green(), dot.blue(), dot.alpha()]
        };
        assert_eq!(dot(&blank), [255, 255, 255, 255]);
        assert_eq!(dot(&marked), [0x20, 0x40, 0x60, 255]);
    }

    #[test]
    fn points_that_are_no_numbers_paint_nothing_and_break_nothing() {
        let mut scene = Scene::new(10.0, 10.0, "");
        scene.line(
            [[f32::NAN, 0.0], [1.0, 1.0]],
            Stroke::solid(Colour::opaque(0), 1.0),
        );
        scene.line([], Stroke::solid(Colour::opaque(0), 1.0));
        scene.circle([0.0, f32::INFINITY], 1.0, Some(Colour::opaque(0)), None);
        assert_eq!(scene.to_png(), Scene::new(10.0, 10.0, "").to_png());
    }
}
