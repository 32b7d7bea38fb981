//! What a robot's file may not say.

use std::ops::RangeInclusive;

use crate::{Motor, PwmAndDirection, Robot, Sonar, TwoInputs, eighths};

/// Directions that sonars look, or more than one: a robot tells eight apart.
const MOST_SONARS: usize = 8;

/// Outputs that the runtime gives a robot's own drivers: `AUX_OUTPUTS` of `rt_firmware::body`.
pub(crate) const OUTPUTS: usize = 4;

/// Addresses that a device on an I2C bus may have (UM10204, table 4).
const ADDRESSES: RangeInclusive<u8> = 0x08..=0x77;

/// A pin, and what it is for, as the file names it.
struct Use {
    pin: u8,
    part: String,
}

/// All that is wrong.
pub(crate) fn problems(robot: &Robot) -> Vec<String> {
    let mut problems = measures(robot);
    problems.extend(pins(robot));
    problems.extend(sonars(robot));
    problems.extend(bus(robot));
    if robot.file.outputs.len() > OUTPUTS {
        problems.push(format!(
            "there are {} `outputs`: a robot has up to {OUTPUTS}",
            robot.file.outputs.len()
        ));
    }
    problems
}

fn measures(robot: &Robot) -> Vec<String> {
    let file = &robot.file;
    let within = |name: &str, value: f32, range: RangeInclusive<f32>| {
        // What is no number is in no range.
        (!range.contains(&value)).then(|| {
            format!(
                "`{name}` is {value}: it is between {} and {}",
                range.start(),
                range.end()
            )
        })
    };
    let wheels = &file.wheels;
    let mut problems: Vec<String> = [
        within("wheels.base_m", wheels.base_m, 0.02..=2.0),
        within("wheels.radius_m", wheels.radius_m, 0.005..=0.5),
        within(
            "wheels.counts_per_revolution",
            wheels.counts_per_revolution,
            4.0..=100_000.0,
        ),
        within(
            "wheels.full_speed_m_per_s",
            wheels.full_speed_m_per_s,
            0.02..=10.0,
        ),
        within("wheels.friction_power", wheels.friction_power, 0.0..=0.9),
        within(
            "battery.full_scale_v",
            file.battery.full_scale_v,
            1.0..=100.0,
        ),
    ]
    .into_iter()
    .flatten()
    .collect();
    let full_scale = robot.pins.analog_full_scale;
    for (name, counts) in [
        ("floor.floor_counts", file.floor.floor_counts),
        ("floor.line_counts", file.floor.line_counts),
    ] {
        if counts > full_scale {
            problems.push(format!(
                "`{name}` is {counts}: the converter counts to {full_scale}"
            ));
        }
    }
    if file.floor.floor_counts == file.floor.line_counts {
        problems
            .push("`floor.floor_counts` and `floor.line_counts` differ, or no line is seen".into());
    }
    let is_word = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if file.name.is_empty() || !file.name.chars().all(is_word) {
        problems.push(format!(
            "`name` is {:?}: it is of letters, digits, `_` and `-`",
            file.name
        ));
    }
    problems
}

/// Every pin's part; that of an echo pin is of its first sonar.
fn uses(robot: &Robot) -> Vec<Use> {
    let file = &robot.file;
    let mut uses = Vec::new();
    let mut add = |pin: u8, part: String| uses.push(Use { pin, part });
    for (side, wheel) in file.sides() {
        match wheel.motor {
            Motor::TwoInputs(TwoInputs {
                forwards,
                backwards,
            }) => {
                add(forwards, format!("{side}.motor.forwards"));
                add(backwards, format!("{side}.motor.backwards"));
            }
            Motor::PwmAndDirection(PwmAndDirection { pwm, direction, .. }) => {
                add(pwm, format!("{side}.motor.pwm"));
                add(direction, format!("{side}.motor.direction"));
            }
        }
        add(wheel.encoder.a, format!("{side}.encoder.a"));
        add(wheel.encoder.b, format!("{side}.encoder.b"));
    }
    for (place, sonar) in file.sonars.iter().enumerate() {
        if let Some((trigger, _)) = sonar.pins() {
            add(trigger, format!("sonars[{place}].trigger"));
        }
    }
    for (pin, places) in file.echoes() {
        add(pin, format!("sonars[{}].echo", places[0]));
    }
    add(file.battery.pin, "battery.pin".to_owned());
    for (place, pin) in file.floor.sensors() {
        add(pin, format!("floor.{place}"));
    }
    add(file.stop_button.pin, "stop_button.pin".to_owned());
    for (place, pin) in file.bumpers.iter().flat_map(|it| it.switches()) {
        add(pin, format!("bumpers.{place}"));
    }
    if let Some(bus) = file.i2c {
        add(bus.sda, "i2c.sda".to_owned());
        add(bus.scl, "i2c.scl".to_owned());
    }
    for (place, pin) in file.outputs.iter().enumerate() {
        add(*pin, format!("outputs[{place}]"));
    }
    uses
}

fn pins(robot: &Robot) -> Vec<String> {
    let uses = uses(robot);
    let pins = &robot.pins;
    let mut problems = Vec::new();
    for (place, Use { pin, part }) in uses.iter().enumerate() {
        if !pins.free.contains(pin) {
            problems.push(format!(
                "`{part}` is pin {pin}, which the board {} does not leave to a robot; it leaves {}",
                robot.board(),
                list(&pins.free)
            ));
        }
        if let Some(earlier) = uses[..place].iter().find(|earlier| earlier.pin == *pin) {
            problems.push(format!(
                "`{}` and `{part}` are both {}: give one of them another pin",
                earlier.part,
                robot.pin(*pin)
            ));
        }
        let is_analog = part == "battery.pin" || part.starts_with("floor.");
        if is_analog && !pins.analog.contains(pin) {
            problems.push(format!(
                "`{part}` is {}, which the converter does not read; it reads {}",
                robot.pin(*pin),
                list(&pins.analog)
            ));
        }
    }
    let is_duty = |part: &str| {
        [".forwards", ".backwards", ".pwm"]
            .iter()
            .any(|end| part.ends_with(end))
    };
    let duties: Vec<&Use> = uses.iter().filter(|it| is_duty(&it.part)).collect();
    for (place, duty) in duties.iter().enumerate() {
        let same = |other: &&&Use| {
            other.pin != duty.pin && other.pin % pins.pwm_repeats == duty.pin % pins.pwm_repeats
        };
        if let Some(other) = duties[..place].iter().find(same) {
            problems.push(format!(
                "`{}` and `{}` have one output of the PWM, for {} and {} lie {} apart: give one of them another pin",
                other.part,
                duty.part,
                robot.pin(other.pin),
                robot.pin(duty.pin),
                pins.pwm_repeats
            ));
        }
    }
    for (side, wheel) in robot.file.sides() {
        if wheel.encoder.a.abs_diff(wheel.encoder.b) != 1 {
            problems.push(format!(
                "`{side}.encoder` is at {} and {}: its pins lie beside each other, as 6 and 7 do",
                robot.pin(wheel.encoder.a),
                robot.pin(wheel.encoder.b)
            ));
        }
    }
    problems
}

fn sonars(robot: &Robot) -> Vec<String> {
    let sonars = &robot.file.sonars;
    let mut problems = Vec::new();
    if sonars.is_empty() || sonars.len() > MOST_SONARS {
        problems.push(format!(
            "there are {} `[[sonars]]`: a robot has 1 to {MOST_SONARS}",
            sonars.len()
        ));
    }
    for (place, sonar) in sonars.iter().enumerate() {
        if sonar.looks_deg % 45 != 0 {
            problems.push(format!(
                "`sonars[{place}].looks_deg` is {}: it is a multiple of 45, counter-clockwise from straight ahead",
                sonar.looks_deg
            ));
        }
        let has = [
            sonar.trigger.is_some(),
            sonar.echo.is_some(),
            sonar.chip.is_some(),
            sonar.address.is_some(),
        ];
        if !matches!(has, [true, true, false, false] | [false, false, true, true]) {
            problems.push(format!(
                "`sonars[{place}]` has `trigger` and `echo`, where it has two pins, \
                 or `chip` and `address`, where it is at the I2C bus"
            ));
        }
        for (earlier, other) in sonars[..place].iter().enumerate() {
            let way = eighths(sonar.looks_deg).abs_diff(eighths(other.looks_deg));
            let echo = |sonar: &Sonar| sonar.pins().map(|(_, echo)| echo);
            let is_shared = echo(sonar).is_some() && echo(sonar) == echo(other);
            if is_shared && way.min(8 - way) > 1 {
                problems.push(format!(
                    "`sonars[{earlier}]` and `sonars[{place}]` share an echo pin and look more than 45° apart: \
                     they ping at once, so give one of them another pin"
                ));
            }
        }
    }
    let echoes = robot.file.echoes();
    if echoes.len() > robot.pins.echo_pins {
        problems.push(format!(
            "the sonars have {} echo pins, and the board {} times {}: let neighbours share one",
            echoes.len(),
            robot.board(),
            robot.pins.echo_pins
        ));
    }
    problems
}

fn bus(robot: &Robot) -> Vec<String> {
    let file = &robot.file;
    let devices = file.at_the_bus();
    let mut problems = Vec::new();
    match (file.i2c, &devices[..]) {
        (None, [(part, what, _), ..]) => problems.push(format!(
            "`{part}` is a {what}, and the file has no bus for it: add `[i2c]` with `sda` and `scl`"
        )),
        (Some(_), []) => problems.push(
            "`i2c` is a bus that nothing is at: leave it out, or add what is at it".to_owned(),
        ),
        _ => {}
    }
    for (place, (part, _, address)) in devices.iter().enumerate() {
        if !ADDRESSES.contains(address) {
            problems.push(format!(
                "`{part}` is at address 0x{address:02X}: it is one of 7 bits, between 0x{:02X} and 0x{:02X}; \
                 Devantech prints twice that",
                ADDRESSES.start(),
                ADDRESSES.end()
            ));
        }
        if let Some((earlier, ..)) = devices[..place].iter().find(|it| it.2 == *address) {
            problems.push(format!(
                "`{earlier}` and `{part}` are both at address 0x{address:02X} of the bus: \
                 give one of them another address"
            ));
        }
    }
    if let Some(bus) = file.i2c
        && !robot.pins.i2c.contains(&[bus.sda, bus.scl])
    {
        let pair = |[sda, scl]: &[u8; 2]| format!("{sda} and {scl}");
        let pairs: Vec<String> = robot.pins.i2c.iter().map(pair).collect();
        problems.push(format!(
            "`i2c` is at {} and {}, which are no data and clock of one bus; those that are: {}",
            robot.pin(bus.sda),
            robot.pin(bus.scl),
            pairs.join(", ")
        ));
    }
    problems
}

/// Pins as a person writes them.
fn list(pins: &[u8]) -> String {
    let mut texts: Vec<String> = Vec::new();
    let mut rest = pins;
    while let [first, ..] = rest {
        let run = (1..rest.len()).find(|&place| rest[place] != first + place as u8);
        let run = run.unwrap_or(rest.len());
        texts.push(match run {
            1 => first.to_string(),
            _ => format!("{first} to {}", rest[run - 1]),
        });
        rest = &rest[run..];
    }
    texts.join(", ")
}
