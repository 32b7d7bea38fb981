//! The letters: widths for the layout, outlines for the PNG.
//!
//! Noto Sans (Apache-2.0) comes with the program, so that a picture does not depend on the fonts of
//! the machine that makes it. Widths are a table of their own: what makes no PNG does without the
//! outlines.

use std::sync::LazyLock;

use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Weight of the letters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// For text.
    Regular,
    /// For headings.
    Bold,
}

/// `None` only if the embedded file were broken, which a test rules out; text would then be
/// missing, not the program.
static REGULAR: LazyLock<Option<Face<'static>>> =
    LazyLock::new(|| Face::parse(ttf_noto_sans::REGULAR, 0).ok());
static BOLD: LazyLock<Option<Face<'static>>> =
    LazyLock::new(|| Face::parse(ttf_noto_sans::BOLD, 0).ok());

fn face(weight: Weight) -> Option<&'static Face<'static>> {
    match weight {
        Weight::Regular => REGULAR.as_ref(),
        Weight::Bold => BOLD.as_ref(),
    }
}

/// Font units of the size of a letter.
const UNITS_PER_EM: f32 = 2048.0;

/// Each letter from which on letters have another width, and that width in font units; of each
/// weight.
static WIDTHS: [&[(u32, u16)]; 2] = include!(concat!(env!("OUT_DIR"), "/widths.rs"));

/// Width of `words` set at `size`, in the unit of `size`.
pub fn width(words: &str, size: f32, weight: Weight) -> f32 {
    let units: u32 = words
        .chars()
        .map(|letter| u32::from(units(letter, weight)))
        .sum();
    units as f32 * size / UNITS_PER_EM
}

/// Distance from a letter to the next one, in font units.
fn units(letter: char, weight: Weight) -> u16 {
    let [regular, bold] = WIDTHS;
    let widths = match weight {
        Weight::Regular => regular,
        Weight::Bold => bold,
    };
    let behind = widths.partition_point(|(first, _)| *first <= u32::from(letter));
    (widths.get(behind.wrapping_sub(1))).map_or(0, |(_, units)| *units)
}

/// `words`, shortened with an ellipsis until they fit into `room`; `None` where not even one letter
/// does.
pub fn fitted(words: &str, room: f32, size: f32, weight: Weight) -> Option<String> {
    if width(words, size, weight) <= room {
        return Some(words.into());
    }
    let mut shortened = String::new();
    let mut fits = None;
    for letter in words.chars() {
        shortened.push(letter);
        let candidate = format!("{shortened}…");
        if width(&candidate, size, weight) > room {
            break;
        }
        fits = Some(candidate);
    }
    fits
}

/// Draws the outlines of `words`, which start at `at` on the base line, set at `size`, y downwards.
pub fn outline(
    words: &str,
    at: [f32; 2],
    size: f32,
    weight: Weight,
    builder: &mut dyn OutlineBuilder,
) {
    let Some(face) = face(weight) else { return };
    let scale = size / f32::from(face.units_per_em());
    let mut x = at[0];
    for letter in words.chars() {
        let (glyph, units) = advance(face, letter);
        face.outline_glyph(
            glyph,
            &mut Placed {
                x,
                y: at[1],
                scale,
                builder,
            },
        );
        x += f32::from(units) * scale;
    }
}

/// The glyph of a letter and the distance to the next one, in font units. A letter that the font
/// lacks is its box for such.
fn advance(face: &Face<'_>, letter: char) -> (GlyphId, u16) {
    let glyph = face.glyph_index(letter).unwrap_or(GlyphId(0));
    (glyph, face.glyph_hor_advance(glyph).unwrap_or(0))
}

/// Moves a glyph from font units, y upwards, to its place.
struct Placed<'a> {
    x: f32,
    y: f32,
    scale: f32,
    builder: &'a mut dyn OutlineBuilder,
}

impl Placed<'_> {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + x * self.scale, self.y - y * self.scale)
    }
}

impl OutlineBuilder for Placed<'_> {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.builder.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.builder.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.builder.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) =
            (self.place(x1, y1), self.place(x2, y2), self.place(x, y));
        self.builder.curve_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.builder.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_fonts_hold_the_letters_that_pictures_use() {
        for weight in [Weight::Regular, Weight::Bold] {
            let face = face(weight).unwrap();
            for letter in ('!'..='~').chain("·–…°äöüµ×".chars()) {
                assert!(face.glyph_index(letter).is_some(), "{letter} {weight:?}");
            }
        }
    }

    #[test]
    fn the_widths_are_those_of_the_embedded_fonts() {
        for weight in [Weight::Regular, Weight::Bold] {
            let face = face(weight).unwrap();
            assert_eq!(f32::from(face.units_per_em()), UNITS_PER_EM);
            for letter in '\0'..=char::MAX {
                assert_eq!(units(letter, weight), advance(face, letter).1, "{letter:?}");
            }
        }
    }

    #[test]
    fn words_that_do_not_fit_are_shortened() {
        let full = width("Cruise", 10.0, Weight::Regular);
        assert_eq!(
            fitted("Cruise", full, 10.0, Weight::Regular).as_deref(),
            Some("Cruise")
        );
        let shortened = fitted("Cruise", full - 1.0, 10.0, Weight::Regular).unwrap();
        assert!(
            shortened.ends_with('…') && shortened.starts_with('C'),
            "{shortened}"
        );
        assert!(width(&shortened, 10.0, Weight::Regular) <= full - 1.0);
        assert_eq!(fitted("Cruise", 3.0, 10.0, Weight::Regular), None);
    }
}
