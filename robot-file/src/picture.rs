//! A robot's chassis from above, with the pins of its parts.

use std::fmt::Write as _;

use crate::{Motor, PwmAndDirection, Robot, TwoInputs, eighths};

/// Where the directions lie, counter-clockwise from straight ahead, which is up: to the right and
/// down. Of a table, so that each machine draws the same.
const WAYS: [(f32, f32); 8] = [
    (0.0, -1.0),
    (-0.707, -0.707),
    (-1.0, 0.0),
    (-0.707, 0.707),
    (0.0, 1.0),
    (0.707, 0.707),
    (1.0, 0.0),
    (0.707, -0.707),
];

/// The picture's size and its middle.
const SIZE: (u32, u32) = (720, 560);
const MIDDLE: (f32, f32) = (360.0, 280.0);
/// Radius of the body.
const BODY: f32 = 130.0;
/// How far from the middle sonars and their labels are.
const SONAR: f32 = 130.0;
const LABEL: f32 = 205.0;

impl Robot {
    /// The chassis from above, its parts and their pins, as SVG.
    pub fn picture(&self) -> String {
        let file = &self.file;
        let (width, height) = SIZE;
        let (x, y) = MIDDLE;
        let mut svg = format!(
            r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="14" text-anchor="middle">
<rect width="{width}" height="{height}" fill="#ffffff"/>
<circle cx="{x}" cy="{y}" r="{BODY}" fill="#f2f2f2" stroke="#333333" stroke-width="2"/>
<path d="M {x} 172 l -9 16 h 18 z" fill="#333333"/>
"##
        );
        // Writing to a string cannot fail.
        for (side, wheel, wheel_x, text_x) in [
            ("left", &file.left, x - BODY + 6.0, x - 68.0),
            ("right", &file.right, x + BODY - 6.0, x + 68.0),
        ] {
            let left = wheel_x - 12.0;
            let top = y - 36.0;
            let motor = match wheel.motor {
                Motor::TwoInputs(TwoInputs {
                    forwards,
                    backwards,
                }) => [forwards, backwards],
                Motor::PwmAndDirection(PwmAndDirection { pwm, direction, .. }) => [pwm, direction],
            };
            let _ = writeln!(
                svg,
                r##"<rect x="{left}" y="{top}" width="24" height="72" rx="4" fill="#333333"/>"##
            );
            let lines = [
                format!("{side} motor"),
                motor.map(|pin| self.pin(pin)).join(" "),
                "encoder".to_owned(),
                [wheel.encoder.a, wheel.encoder.b]
                    .map(|pin| self.pin(pin))
                    .join(" "),
            ];
            text(&mut svg, (text_x, y - 22.0), &lines);
        }
        let _ = writeln!(
            svg,
            r##"<rect x="{}" y="{}" width="34" height="84" rx="3" fill="#2e7d4f"/>"##,
            x - 17.0,
            y - 42.0
        );
        let board = [self.board.name.clone()];
        text(&mut svg, (x, y + 60.0), &board);
        let battery = [format!("battery {}", self.pin(file.battery.pin))];
        text(&mut svg, (x, y + 84.0), &battery);
        let button = [format!("stop {}", self.pin(file.stop_button.pin))];
        text(&mut svg, (x, y + 108.0), &button);
        let floor: Vec<String> = (file.floor.sensors())
            .map(|(_, pin)| self.pin(pin))
            .collect();
        if !floor.is_empty() {
            text(
                &mut svg,
                (x, y - 72.0),
                &[format!("floor {}", floor.join(" "))],
            );
        }
        if let Some(bumpers) = file.bumpers {
            let [left, right] = bumpers.switches().map(|(_, pin)| self.pin(pin));
            let bumpers = [format!("bumpers {left} {right}")];
            text(&mut svg, (x, y - 52.0), &bumpers);
        }
        if let Some(bus) = file.i2c {
            let pins = [bus.sda, bus.scl].map(|pin| self.pin(pin)).join(" ");
            text(&mut svg, (x + 74.0, y + 52.0), &["I2C".to_owned(), pins]);
        }
        if !file.outputs.is_empty() {
            let outputs: Vec<String> = file.outputs.iter().map(|&pin| self.pin(pin)).collect();
            let outputs = [format!("outputs {}", outputs.join(" "))];
            text(&mut svg, (x, y - 92.0), &outputs);
        }
        for (place, sonar) in file.sonars.iter().enumerate() {
            let (right, down) = WAYS[eighths(sonar.looks_deg)];
            let (at_x, at_y) = (x + SONAR * right, y + SONAR * down);
            let _ = writeln!(
                svg,
                r##"<circle cx="{at_x:.1}" cy="{at_y:.1}" r="11" fill="#2f6fb3"/><path d="M {:.1} {:.1} L {:.1} {:.1}" stroke="#2f6fb3" stroke-width="2"/>"##,
                x + (SONAR + 11.0) * right,
                y + (SONAR + 11.0) * down,
                x + (SONAR + 30.0) * right,
                y + (SONAR + 30.0) * down,
            );
            let mut lines = vec![format!("sonar {place}")];
            if let Some((trigger, echo)) = sonar.pins() {
                lines.push(format!("trigger {}", self.pin(trigger)));
                lines.push(format!("echo {}", self.pin(echo)));
            }
            if let Some((chip, address)) = sonar.at_bus() {
                lines.push(chip.name().to_owned());
                lines.push(format!("at 0x{address:02X}"));
            }
            text(
                &mut svg,
                (
                    x + (LABEL + 15.0 * right.abs()) * right,
                    y + LABEL * down - 8.0,
                ),
                &lines,
            );
        }
        svg + "</svg>\n"
    }
}

/// Lines of text below each other.
fn text(svg: &mut String, (x, y): (f32, f32), lines: &[String]) {
    for (line, text) in lines.iter().enumerate() {
        let y = y + 17.0 * line as f32;
        let _ = writeln!(
            svg,
            r##"<text x="{x:.1}" y="{y:.1}" fill="#111111">{text}</text>"##
        );
    }
}
