//! A robot's wiring as a table.

use crate::{Level, Motor, PwmAndDirection, Robot, TwoInputs};

/// Names of directions, counter-clockwise from straight ahead.
const DIRECTIONS: [&str; 8] = [
    "ahead",
    "ahead left",
    "left",
    "behind left",
    "behind",
    "behind right",
    "right",
    "ahead right",
];

impl Robot {
    /// Which pin is what, as a table of Markdown, ordered by pins.
    pub fn wiring(&self) -> String {
        let mut rows = self.rows();
        for own in &self.pins.own {
            rows.push((own.pins[0], self.row(&own.pins, &own.part)));
        }
        rows.sort_by_key(|(pin, _)| *pin);
        let mut table = vec!["| pin | part |".to_owned(), "|---|---|".to_owned()];
        table.extend(rows.into_iter().map(|(_, row)| row));
        table.join("\n") + "\n"
    }

    /// A row of the table.
    fn row(&self, pins: &[u8], part: &str) -> String {
        let names: Vec<String> = pins.iter().map(|&pin| self.pin(pin)).collect();
        format!("| {} | {part} |", names.join(", "))
    }

    /// The rows of the robot's parts, with their first pins.
    fn rows(&self) -> Vec<(u8, String)> {
        let file = &self.file;
        let mut rows = Vec::new();
        let mut add = |pins: &[u8], part: String| {
            rows.push((pins[0], self.row(pins, &part)));
        };
        for (side, wheel) in file.sides() {
            match wheel.motor {
                Motor::TwoInputs(TwoInputs {
                    forwards,
                    backwards,
                }) => {
                    add(
                        &[forwards, backwards],
                        format!("{side} motor: forwards, backwards"),
                    );
                }
                Motor::PwmAndDirection(PwmAndDirection {
                    pwm,
                    direction,
                    backwards_is,
                }) => {
                    let level = level(backwards_is);
                    let part =
                        format!("{side} motor: power (PWM), direction ({level} is backwards)");
                    add(&[pwm, direction], part);
                }
            }
            add(
                &[wheel.encoder.a, wheel.encoder.b],
                format!("{side} encoder: A, B"),
            );
        }
        for (place, sonar) in file.sonars.iter().enumerate() {
            let direction = DIRECTIONS[crate::eighths(sonar.looks_deg)];
            if let Some((trigger, _)) = sonar.pins() {
                add(&[trigger], format!("sonar {place} ({direction}): trigger"));
            }
        }
        for (pin, places) in file.echoes() {
            let part = match &places[..] {
                [place] => format!("sonar {place}: echo, behind its divider"),
                _ => {
                    let places: Vec<String> = places.iter().map(usize::to_string).collect();
                    let places = places.join(" and ");
                    format!("sonars {places}: echo, behind dividers and diodes")
                }
            };
            add(&[pin], part);
        }
        let volts = file.battery.full_scale_v;
        add(
            &[file.battery.pin],
            format!("battery, behind a divider: full scale is {volts} V"),
        );
        for (place, pin) in file.floor.sensors() {
            add(&[pin], format!("line sensor: {place}"));
        }
        let to = closes_to(file.stop_button.pressed);
        add(
            &[file.stop_button.pin],
            format!("button of the emergency stop, to {to}"),
        );
        if let Some(bumpers) = file.bumpers {
            let to = closes_to(bumpers.pressed);
            for (place, pin) in bumpers.switches() {
                add(&[pin], format!("{place} bumper: contact switch, to {to}"));
            }
        }
        if let Some(bus) = file.i2c {
            let devices = file.at_the_bus().into_iter();
            let devices: Vec<String> = devices
                .map(|(_, what, address)| format!("{what} at address 0x{address:02X}"))
                .collect();
            let devices = devices.join(", ");
            add(
                &[bus.sda, bus.scl],
                format!("I2C: SDA, SCL, each with 4.7 kΩ to 3.3 V; {devices}"),
            );
        }
        for (place, pin) in file.outputs.iter().enumerate() {
            add(
                &[*pin],
                format!("output {place} of the robot's own drivers"),
            );
        }
        rows
    }
}

/// Where a switch leads that makes its pin's level this one while it is pressed.
fn closes_to(level: Level) -> &'static str {
    match level {
        Level::Low => "ground",
        Level::High => "the board's supply of 3.3 V",
    }
}

/// As a file says it.
fn level(level: Level) -> &'static str {
    match level {
        Level::High => "high",
        Level::Low => "low",
    }
}
