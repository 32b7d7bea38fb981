//! A scene as SVG.

use std::fmt::Write;

use super::font::{self, Weight};
use super::scene::{self, Anchor, Colour, Leg, Part, Point, Scene, Shape, Stroke, Text};

/// The embedded font first, then what readers have that is of about the same width.
const FONT_FAMILY: &str = "'Noto Sans','Open Sans','DejaVu Sans',Verdana,sans-serif";

impl Scene {
    /// The picture as an SVG document.
    pub fn to_svg(&self) -> String {
        let mut svg = String::new();
        // Writing into a string does not fail.
        let _ = self.write_svg(&mut svg);
        svg
    }

    fn write_svg(&self, svg: &mut String) -> std::fmt::Result {
        let (width, height) = (Number(self.width), Number(self.height));
        writeln!(
            svg,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"{FONT_FAMILY}\" role=\"img\">"
        )?;
        writeln!(svg, "<title>{}</title>", Escaped(&self.title))?;
        writeln!(
            svg,
            "<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>"
        )?;
        let mut tooltip = None;
        let mut is_in_part = false;
        for shape in &self.shapes {
            if let Shape::Part(part) = shape {
                if std::mem::take(&mut is_in_part) {
                    writeln!(svg, "</g>")?;
                }
                if let Some(part) = part {
                    write_part(svg, part)?;
                    is_in_part = true;
                }
                continue;
            }
            if let Shape::Tooltip(words) = shape {
                tooltip = Some(words);
                continue;
            }
            match tooltip.take() {
                Some(words) => {
                    write!(svg, "<g><title>{}</title>", Escaped(words))?;
                    write_shape(svg, shape)?;
                    writeln!(svg, "</g>")?;
                }
                None => {
                    write_shape(svg, shape)?;
                    writeln!(svg)?;
                }
            }
        }
        if is_in_part {
            writeln!(svg, "</g>")?;
        }
        writeln!(svg, "</svg>")
    }
}

/// Begins a part.
fn write_part(svg: &mut String, part: &Part) -> std::fmt::Result {
    write!(svg, "<g class=\"{}\"", part.class)?;
    for (attribute, name) in ["data-path", "data-to"].iter().zip(&part.names) {
        write!(svg, " {attribute}=\"{}\"", Escaped(name))?;
    }
    if let Some([file, start]) = part.place {
        write!(svg, " data-file=\"{file}\" data-start=\"{start}\"")?;
    }
    writeln!(svg, ">")
}

fn write_shape(svg: &mut String, shape: &Shape) -> std::fmt::Result {
    match shape {
        Shape::Polygon {
            corners,
            fill,
            stroke,
        } => {
            write!(svg, "<polygon points=\"")?;
            write_points(svg, corners)?;
            write!(svg, "\"")?;
            write_fill(svg, *fill)?;
            write_stroke(svg, *stroke)?;
            write!(svg, "/>")
        }
        Shape::Rounded {
            corner: [x, y],
            size: [width, height],
            radius,
            fill,
            stroke,
        } => {
            write!(
                svg,
                "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" rx=\"{}\"",
                Number(*x),
                Number(*y),
                Number(*width),
                Number(*height),
                Number(*radius)
            )?;
            write_fill(svg, *fill)?;
            write_stroke(svg, *stroke)?;
            write!(svg, "/>")
        }
        Shape::Track {
            points,
            radius,
            stroke,
        } => {
            let Some(([x, y], legs)) = scene::legs(points, *radius) else {
                return Ok(());
            };
            write!(svg, "<path d=\"M{},{}", Number(x), Number(y))?;
            for leg in legs {
                match leg {
                    Leg::Line([x, y]) => write!(svg, "L{},{}", Number(x), Number(y))?,
                    Leg::Curve([cx, cy], [x, y]) => {
                        let (cx, cy) = (Number(cx), Number(cy));
                        write!(svg, "Q{cx},{cy} {},{}", Number(x), Number(y))?;
                    }
                }
            }
            write!(svg, "\"")?;
            write_fill(svg, None)?;
            write_stroke(svg, Some(*stroke))?;
            write!(svg, "/>")
        }
        Shape::Line { points, stroke } => {
            write!(svg, "<polyline points=\"")?;
            write_points(svg, points)?;
            write!(svg, "\"")?;
            write_fill(svg, None)?;
            write_stroke(svg, Some(*stroke))?;
            write!(svg, " stroke-linecap=\"round\" stroke-linejoin=\"round\"/>")
        }
        Shape::Circle {
            centre: [x, y],
            radius,
            fill,
            stroke,
        } => {
            write!(
                svg,
                "<circle cx=\"{}\" cy=\"{}\" r=\"{}\"",
                Number(*x),
                Number(*y),
                Number(*radius)
            )?;
            write_fill(svg, *fill)?;
            write_stroke(svg, *stroke)?;
            write!(svg, "/>")
        }
        Shape::Text(text) => write_text(svg, text),
        Shape::Tooltip(_) | Shape::Part(_) => Ok(()),
    }
}

fn write_text(svg: &mut String, text: &Text) -> std::fmt::Result {
    let Text {
        at: [x, y],
        words,
        size,
        weight,
        colour,
        anchor,
    } = text;
    write!(
        svg,
        "<text x=\"{}\" y=\"{}\" font-size=\"{}\"",
        Number(*x),
        Number(*y),
        Number(*size)
    )?;
    if *weight == Weight::Bold {
        write!(svg, " font-weight=\"bold\"")?;
    }
    match anchor {
        Anchor::Start => {}
        Anchor::Middle => write!(svg, " text-anchor=\"middle\"")?,
        Anchor::End => write!(svg, " text-anchor=\"end\"")?,
    }
    write_fill(svg, Some(*colour))?;
    // The layout rests on the embedded font's widths; a reader with another font squeezes or
    // spreads its letters to them.
    let length = font::width(words, *size, *weight);
    write!(
        svg,
        " textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\">{}</text>",
        Number(length),
        Escaped(words)
    )
}

fn write_points(svg: &mut String, points: &[Point]) -> std::fmt::Result {
    for (index, [x, y]) in points.iter().enumerate() {
        let gap = if index == 0 { "" } else { " " };
        write!(svg, "{gap}{},{}", Number(*x), Number(*y))?;
    }
    Ok(())
}

fn write_fill(svg: &mut String, fill: Option<Colour>) -> std::fmt::Result {
    match fill {
        None => write!(svg, " fill=\"none\""),
        Some(colour) => {
            write!(svg, " fill=\"{}\"", Hex(colour))?;
            write_alpha(svg, "fill-opacity", colour)
        }
    }
}

fn write_stroke(svg: &mut String, stroke: Option<Stroke>) -> std::fmt::Result {
    let Some(Stroke {
        colour,
        width,
        dash,
    }) = stroke
    else {
        return Ok(());
    };
    write!(
        svg,
        " stroke=\"{}\" stroke-width=\"{}\"",
        Hex(colour),
        Number(width)
    )?;
    write_alpha(svg, "stroke-opacity", colour)?;
    match dash {
        None => Ok(()),
        Some([on, off]) => write!(svg, " stroke-dasharray=\"{} {}\"", Number(on), Number(off)),
    }
}

fn write_alpha(svg: &mut String, attribute: &str, colour: Colour) -> std::fmt::Result {
    if colour.alpha == u8::MAX {
        return Ok(());
    }
    write!(
        svg,
        " {attribute}=\"{}\"",
        Number(f32::from(colour.alpha) / f32::from(u8::MAX))
    )
}

/// A number with at most two decimals and nothing that carries no information.
struct Number(f32);

impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = format!("{:.2}", self.0);
        let text = text.trim_end_matches('0').trim_end_matches('.');
        f.write_str(if text == "-0" { "0" } else { text })
    }
}

struct Hex(Colour);

impl std::fmt::Display for Hex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [red, green, blue] = self.0.rgb;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}

/// Text as XML carries it.
struct Escaped<'a>(&'a str);

impl std::fmt::Display for Escaped<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for letter in self.0.chars() {
            match letter {
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '&' => f.write_str("&amp;")?,
                '"' => f.write_str("&quot;")?,
                // XML 1.0 has no way to write the other control characters.
                control if control.is_control() => f.write_char(' ')?,
                other => f.write_char(other)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_negative_zero() {
        let cases = [
            (0.0, "0"),
            (-0.001, "0"),
            (1.0, "1"),
            (10.0, "10"),
            (1.5, "1.5"),
            (1.256, "1.26"),
            (-2.25, "-2.25"),
        ];
        for (number, text) in cases {
            assert_eq!(Number(number).to_string(), text);
        }
    }

    #[test]
    fn words_cannot_break_the_document() {
        assert_eq!(
            Escaped("a<b> & \"c\"\u{7}").to_string(),
            "a&lt;b&gt; &amp; &quot;c&quot; "
        );
    }

    #[test]
    fn shapes_become_elements() {
        let mut scene = Scene::new(20.0, 10.0, "a & b");
        scene.tooltip("here");
        scene.circle(
            [1.0, 2.5],
            3.0,
            Some(Colour::opaque(0xff8000).with_alpha(51)),
            None,
        );
        scene.line(
            [[0.0, 0.0], [4.0, 5.0]],
            Stroke {
                colour: Colour::opaque(0),
                width: 1.0,
                dash: Some([2.0, 1.0]),
            },
        );
        let svg = scene.to_svg();
        let lines: Vec<&str> = svg.lines().collect();
        assert_eq!(lines[1], "<title>a &amp; b</title>");
        assert_eq!(
            lines[3],
            "<g><title>here</title><circle cx=\"1\" cy=\"2.5\" r=\"3\" fill=\"#ff8000\" fill-opacity=\"0.2\"/></g>"
        );
        assert_eq!(
            lines[4],
            "<polyline points=\"0,0 4,5\" fill=\"none\" stroke=\"#000000\" stroke-width=\"1\" stroke-dasharray=\"2 1\" \
             stroke-linecap=\"round\" stroke-linejoin=\"round\"/>"
        );
        assert_eq!(lines[5], "</svg>");
    }
}
