//! A robot as constants of Rust.

use std::fmt::Write as _;

use crate::check::OUTPUTS;
use crate::{Level, Motor, PwmAndDirection, Robot, TwoInputs, Wheel, eighths};

/// The variants of `Bearing`, counter-clockwise from straight ahead.
const BEARINGS: [&str; 8] = [
    "Ahead",
    "AheadLeft",
    "Left",
    "BehindLeft",
    "Behind",
    "BehindRight",
    "Right",
    "AheadRight",
];

impl Robot {
    /// `MEASURES`, `WIRING` and `Robot`, as Rust.
    pub(crate) fn constants(&self) -> String {
        let file = &self.file;
        let board = &self.board.name;
        let sonars = file.sonars.len();
        let wheels = &file.wheels;
        let mut bearings = String::new();
        let mut pins = String::new();
        for sonar in &file.sonars {
            // Writing to a string cannot fail.
            let bearing = BEARINGS[eighths(sonar.looks_deg)];
            let _ = write!(bearings, "Bearing::{bearing}, ");
            if let Some((trigger, echo)) = sonar.pins() {
                let _ = write!(
                    pins,
                    "Sonar::Pulse {{ trigger: {trigger}, echo: {echo} }}, "
                );
            }
            if let Some((chip, address)) = sonar.at_bus() {
                let _ = write!(
                    pins,
                    "Sonar::AtBus {{ kind: {board}::wiring::BusSonarKind::{chip:?}, address: {address} }}, "
                );
            }
        }
        let mut outputs = String::new();
        for place in 0..OUTPUTS {
            let _ = write!(outputs, "{:?}, ", file.outputs.get(place));
        }
        let floor = &file.floor;
        let needed = self.needed();
        let i2c = match file.i2c {
            Some(bus) => format!("Some(I2cPins {{ sda: {}, scl: {} }})", bus.sda, bus.scl),
            None => "None".to_owned(),
        };
        let bumpers = match file.bumpers {
            Some(bumpers) => {
                let [left, right] = bumpers
                    .switches()
                    .map(|(_, pin)| button(pin, bumpers.pressed));
                format!("Some([{left}, {right}])")
            }
            None => "None".to_owned(),
        };
        format!(
            "/// What the robot measures.
pub const MEASURES: {board}::rt_firmware::rover::Measures<{sonars}> = {{
    use {board}::rt_firmware::tasks::{{Bearing, Chassis}};
    {board}::rt_firmware::rover::Measures {{
        chassis: Chassis {{
            wheel_base_m: {:?},
            metres_per_count: core::f32::consts::TAU * {:?} / {:?},
            full_speed_m_per_s: {:?},
            friction_power: {:?},
        }},
        battery_full_scale_v: {:?},
        floor_counts: {},
        line_counts: {},
        sonars: [{bearings}],
    }}
}};

/// Which pin is what.
pub const WIRING: {board}::wiring::Wiring<{sonars}> = {{
    #[allow(unused_imports, reason = \"not every robot has a bus\")]
    use {board}::wiring::I2cPins;
    use {board}::wiring::{{Bridge, Button, Sonar, Wheel, Wiring}};
    Wiring {{
        left: {},
        right: {},
        sonars: [{pins}],
        battery: {},
        floor: [{:?}, {:?}, {:?}],
        stop_button: {},
        bumpers: {},
        i2c: {i2c},
        has_gyro: {},
        outputs: [{outputs}],
    }}
}};

/// The rover with these parts.
#[allow(dead_code, reason = \"a robot with tasks of its own is another\")]
pub type Robot = {board}::pins::BoardRover<{sonars}>;
{needed}",
            wheels.base_m,
            wheels.radius_m,
            wheels.counts_per_revolution,
            wheels.full_speed_m_per_s,
            wheels.friction_power,
            file.battery.full_scale_v,
            floor.floor_counts,
            floor.line_counts,
            wheel(&file.left),
            wheel(&file.right),
            file.battery.pin,
            floor.left,
            floor.middle,
            floor.right,
            button(file.stop_button.pin, file.stop_button.pressed),
            bumpers,
            file.gyro.is_some(),
        )
    }
}

impl Robot {
    /// What a firmware is refused without, in words that say what to do.
    fn needed(&self) -> String {
        let board = &self.board.name;
        let parts = [
            ("bumpers", "bumpers", self.file.bumpers.is_some()),
            ("gyro", "imu", self.file.gyro.is_some()),
            (
                "sonars` with `chip",
                "ranges",
                self.file.sonars.iter().any(|it| it.at_bus().is_some()),
            ),
        ];
        let needed = parts.into_iter().filter(|(.., has)| *has);
        let needed = needed.map(|(part, feature, _)| {
            let has = feature.to_uppercase();
            format!(
                "
const _: () = assert!(
    {board}::wiring::HAS_{has},
    \"the robot's file has `{part}`: give the board's crate, or `esm`, the feature `{feature}`\"
);
"
            )
        });
        needed.collect()
    }
}

fn button(pin: u8, pressed: Level) -> String {
    let is_pressed_high = pressed == Level::High;
    format!("Button {{ pin: {pin}, is_pressed_high: {is_pressed_high} }}")
}

fn wheel(wheel: &Wheel) -> String {
    let motor = match wheel.motor {
        Motor::TwoInputs(TwoInputs {
            forwards,
            backwards,
        }) => {
            format!("Bridge::TwoInputs {{ forwards: {forwards}, backwards: {backwards} }}")
        }
        Motor::PwmAndDirection(PwmAndDirection {
            pwm,
            direction,
            backwards_is,
        }) => format!(
            "Bridge::PwmAndDirection {{ pwm: {pwm}, direction: {direction}, is_backwards_low: {} }}",
            backwards_is == Level::Low
        ),
    };
    let encoder = wheel.encoder;
    format!(
        "Wheel {{ motor: {motor}, encoder: {}, encoder_reversed: {} }}",
        encoder.a.min(encoder.b),
        encoder.a > encoder.b
    )
}
