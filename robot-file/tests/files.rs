//! Robots' files: what is made of one that holds, and what is said of one that does not.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::Path;

use robot_file::{check, read};

const ROVER: &str = "../boards/pico/robot.toml";

/// The shipped rover's file, changed in one place.
fn changed(from: &str, to: &str) -> String {
    let text = std::fs::read_to_string(ROVER).unwrap();
    assert_eq!(text.matches(from).count(), 1, "{from}");
    text.replace(from, to)
}

/// What is said of the rover's file after a change.
fn said(from: &str, to: &str) -> String {
    let error = check(Path::new("robot.toml"), &changed(from, to)).expect_err(to);
    error.to_string()
}

#[test]
fn the_shipped_rovers_file_holds() {
    let robot = read(Path::new(ROVER)).unwrap();
    assert_eq!((robot.name(), robot.board()), ("rover", "pico"));
    let table = robot.wiring();
    assert_eq!(table.lines().count(), 24, "{table}");
    assert!(table.contains("| GP18 | sonars 0 and 1: echo, behind dividers and diodes |"));
    // Ordered by pins, the board's own among them.
    let pins: Vec<u8> = table
        .lines()
        .filter_map(|row| {
            row.strip_prefix("| GP")?
                .split([',', ' '])
                .next()?
                .parse()
                .ok()
        })
        .collect();
    assert!(pins.is_sorted() && pins.contains(&25), "{pins:?}");
}

#[test]
fn each_mistake_is_said_with_what_to_do() {
    for (from, to, expected) in [
        (
            "a = 6, b = 7",
            "a = 6, b = 10",
            "robot.toml: `left.encoder.b` and `sonars[0].trigger` are both GP10: give one of them another pin\n\
             robot.toml: `left.encoder` is at GP6 and GP10: its pins lie beside each other, as 6 and 7 do",
        ),
        (
            "pin = 22",
            "pin = 23",
            "robot.toml: `stop_button.pin` is pin 23, which the board pico does not leave to a robot; it leaves 2 to 22, 26 to 28",
        ),
        (
            "left = 27",
            "left = 22",
            "robot.toml: `floor.left` is GP22, which the converter does not read; it reads 26 to 28\n\
             robot.toml: `floor.left` and `stop_button.pin` are both GP22: give one of them another pin",
        ),
        (
            "forwards = 2, backwards = 3",
            "forwards = 20, backwards = 3",
            "robot.toml: `left.motor.forwards` and `sonars[4].echo` are both GP20: give one of them another pin\n\
             robot.toml: `left.motor.forwards` and `right.motor.forwards` have one output of the PWM, for GP20 and GP4 lie \
             16 apart: give one of them another pin",
        ),
        (
            "looks_deg = 45\n",
            "looks_deg = 50\n",
            "robot.toml: `sonars[1].looks_deg` is 50: it is a multiple of 45, counter-clockwise from straight ahead",
        ),
        (
            "looks_deg = 45\n",
            "looks_deg = 180\n",
            "robot.toml: `sonars[0]` and `sonars[1]` share an echo pin and look more than 45° apart: they ping at once, so \
             give one of them another pin",
        ),
        (
            "base_m = 0.2015 ",
            "base_m = 201.5 ",
            "robot.toml: `wheels.base_m` is 201.5: it is between 0.02 and 2",
        ),
        (
            "radius_m = 0.0323 ",
            "radius_m = nan ",
            "robot.toml: `wheels.radius_m` is NaN: it is between 0.005 and 0.5",
        ),
        (
            "line_counts = 3300",
            "line_counts = 4096",
            "robot.toml: `floor.line_counts` is 4096: the converter counts to 4095",
        ),
        (
            "line_counts = 3300",
            "line_counts = 500",
            "robot.toml: `floor.floor_counts` and `floor.line_counts` differ, or no line is seen",
        ),
        (
            "board = \"pico\"\n",
            "board = \"pico\"\noutputs = [22, 23]\n",
            "robot.toml: `stop_button.pin` and `outputs[0]` are both GP22: give one of them another pin\n\
             robot.toml: `outputs[1]` is pin 23, which the board pico does not leave to a robot; it leaves 2 to 22, 26 to 28",
        ),
        (
            "name = \"rover\"",
            "name = \"my robot\"",
            "robot.toml: `name` is \"my robot\": it is of letters, digits, `_` and `-`",
        ),
        (
            "board = \"pico\"",
            "board = \"host\"",
            "robot.toml: there is no board `host` with pins; the boards with pins are: pico, pico2",
        ),
    ] {
        assert_eq!(said(from, to), expected, "{to}");
    }
}

#[test]
fn outputs_of_own_drivers_are_shown_and_are_four_at_most() {
    let text = changed("[floor]\nleft = 27\nright = 28\n", "[floor]\n");
    let with =
        |outputs: &str| text.replace("board = \"pico\"", &format!("board = \"pico\"\n{outputs}"));
    let robot = check(Path::new("robot.toml"), &with("outputs = [27, 28]")).unwrap();
    let table = robot.wiring();
    assert!(
        table.contains("| GP28 | output 1 of the robot's own drivers |"),
        "{table}"
    );
    assert!(robot.picture().contains(">outputs GP27 GP28<"));
    let many = with("outputs = [27, 28, 27, 28, 27]");
    let said = check(Path::new("robot.toml"), &many)
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("there are 5 `outputs`: a robot has up to 4"),
        "{said}"
    );
}

/// The rover with bumpers and sensors at a bus.
const SENSORS: &str = "../boards/pico/sensors.toml";

#[test]
fn sensors_at_a_bus_and_bumpers_are_shown_and_checked() {
    let robot = read(Path::new(SENSORS)).unwrap();
    let (table, picture) = (robot.wiring(), robot.picture());
    for row in [
        "| GP12, GP13 | I2C: SDA, SCL, each with 4.7 kΩ to 3.3 V; gyroscope BMI160 at address 0x68, \
         sonar 1 SRF08 at address 0x70, sonar 3 SRF08 at address 0x71 |",
        "| GP14 | left bumper: contact switch, to ground |",
        "| GP15 | right bumper: contact switch, to ground |",
    ] {
        assert!(table.contains(row), "{table}");
    }
    for text in [">bumpers GP14 GP15<", ">GP12 GP13<", ">at 0x71<"] {
        assert!(picture.contains(text), "{text}");
    }
    let whole = std::fs::read_to_string(SENSORS).unwrap();
    for (from, to, expected) in [
        (
            "left = 14\n",
            "left = 12\n",
            "robot.toml: `bumpers.left` and `i2c.sda` are both GP12: give one of them another pin",
        ),
        (
            "sda = 12\n",
            "sda = 17\n",
            "robot.toml: `i2c` is at GP17 and GP13, which are no data and clock of one bus; those that are: 2 and 3, 4 and 5, \
             6 and 7, 8 and 9, 10 and 11, 12 and 13, 14 and 15, 16 and 17, 18 and 19, 20 and 21, 26 and 27",
        ),
        (
            "[i2c]\nsda = 12\nscl = 13\n",
            "",
            "robot.toml: `gyro` is a gyroscope BMI160, and the file has no bus for it: add `[i2c]` with `sda` and `scl`",
        ),
        (
            "address = 0x71\n",
            "address = 0x68\n",
            "robot.toml: `gyro` and `sonars[3]` are both at address 0x68 of the bus: give one of them another address",
        ),
        (
            "address = 0x71\n",
            "address = 0xE2\n",
            "robot.toml: `sonars[3]` is at address 0xE2: it is one of 7 bits, between 0x08 and 0x77; Devantech prints twice that",
        ),
        (
            "address = 0x71\n",
            "trigger = 17\n",
            "robot.toml: `sonars[3]` has `trigger` and `echo`, where it has two pins, or `chip` and `address`, where it is \
             at the I2C bus",
        ),
    ] {
        assert_eq!(whole.matches(from).count(), 1, "{from}");
        let text = whole.replace(from, to);
        let said = check(Path::new("robot.toml"), &text).expect_err(to);
        assert_eq!(said.to_string(), expected, "{to}");
    }
    let empty = std::fs::read_to_string(ROVER).unwrap() + "[i2c]\nsda = 12\nscl = 13\n";
    let empty = empty
        .replace("trigger = 12", "trigger = 23")
        .replace("trigger = 13", "trigger = 24");
    let said = check(Path::new("robot.toml"), &empty).unwrap_err();
    let said = said.to_string();
    let expected = "`i2c` is a bus that nothing is at: leave it out, or add what is at it";
    assert!(said.contains(expected), "{said}");
    let other = whole.replace("BMI160", "MPU-6050");
    let said = check(Path::new("robot.toml"), &other).unwrap_err();
    let said = said.to_string();
    assert!(
        said.contains("unknown variant `MPU-6050`, expected `BMI160`"),
        "{said}"
    );
}

#[test]
fn what_is_no_robots_file_is_said_at_its_line() {
    let text = said("radius_m = 0.0323", "radius = 0.0323");
    assert!(
        text.contains("line 9") && text.contains("unknown field `radius`"),
        "{text}"
    );
    let text = said("a = 6, b = 7", "a = 6");
    assert!(text.contains("missing field `b`"), "{text}");
    let text = said("forwards = 2, backwards = 3", "forward = 2");
    assert!(
        text.contains("a motor is { forwards = PIN, backwards = PIN }"),
        "{text}"
    );
    let text = said("trigger = 10", "trigger = 1000");
    assert!(text.contains("1000"), "{text}");
    let text = read(Path::new("none.toml")).unwrap_err().to_string();
    assert!(text.starts_with("none.toml: "), "{text}");
    assert!(check(Path::new("robot.toml"), "").is_err());
}

#[test]
fn a_robot_has_one_sonar_to_eight() {
    let text = std::fs::read_to_string(ROVER).unwrap();
    let (head, sonars) = text.split_once("[[sonars]]").unwrap();
    let (_, tail) = sonars.split_once("[battery]").unwrap();
    let with = |count: usize| {
        let sonar = "[[sonars]]\nlooks_deg = 0\ntrigger = 10\necho = 18\n\n";
        let none = if count == 0 { "sonars = []\n" } else { "" };
        let text = format!("{none}{head}{}[battery]{tail}", sonar.repeat(count));
        check(Path::new("robot.toml"), &text)
    };
    assert!(with(1).is_ok());
    let none = with(0).unwrap_err().to_string();
    assert_eq!(
        none,
        "robot.toml: there are 0 `[[sonars]]`: a robot has 1 to 8"
    );
    let many = with(9).unwrap_err().to_string();
    assert!(many.contains("there are 9 `[[sonars]]`"), "{many}");
}

#[test]
fn a_picture_is_the_same_each_time() {
    let robot = read(Path::new(ROVER)).unwrap();
    let picture = robot.picture();
    assert_eq!(picture, robot.picture());
    assert_eq!(picture.matches("sonar ").count(), 8);
    for pin in [
        "GP2 GP3",
        "GP6 GP7",
        "trigger GP17",
        "echo GP21",
        "battery GP26",
        "stop GP22",
    ] {
        assert!(picture.contains(pin), "{pin}");
    }
}
