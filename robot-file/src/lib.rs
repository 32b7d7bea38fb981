//! A robot's file, `robot.toml`: what the robot measures, and which pin of its board is what.
//!
//! Three things are made of it: the constants of a firmware ([`build`], for its build script), the
//! table of its wiring ([`Robot::wiring`]), and a picture of it ([`Robot::picture`]).
//!
//! ```
//! let robot = robot_file::read("../boards/pico/robot.toml".as_ref()).expect("the rover's");
//! assert!(robot.wiring().contains("| GP2, GP3 | left motor: forwards, backwards |"));
//! ```

mod check;
mod constants;
mod picture;
mod wiring;

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// What the boards say of their pins, one text each: a `board.toml`.
const BOARDS: &[&str] = &include!(concat!(env!("OUT_DIR"), "/boards.rs"));

/// Why a robot's file cannot be used.
#[derive(Debug)]
pub struct RobotFileError {
    file: PathBuf,
    /// What is wrong and what to do, one sentence or more each.
    problems: Vec<String>,
}

impl fmt::Display for RobotFileError {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, problem) in self.problems.iter().enumerate() {
            let line = if place == 0 { "" } else { "\n" };
            write!(to, "{line}{}: {}", self.file.display(), problem.trim_end())?;
        }
        Ok(())
    }
}

impl std::error::Error for RobotFileError {}

/// A robot, as its file says, which holds.
#[derive(Clone, Debug)]
pub struct Robot {
    file: RobotFile,
    board: Board,
    pins: Pins,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    name: String,
    board: String,
    /// Outputs for the robot's own drivers.
    #[serde(default)]
    outputs: Vec<u8>,
    wheels: Wheels,
    left: Wheel,
    right: Wheel,
    sonars: Vec<Sonar>,
    battery: Battery,
    #[serde(default)]
    floor: Floor,
    stop_button: Button,
    bumpers: Option<Bumpers>,
    i2c: Option<I2c>,
    gyro: Option<Gyro>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wheels {
    base_m: f32,
    radius_m: f32,
    counts_per_revolution: f32,
    full_speed_m_per_s: f32,
    friction_power: f32,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Wheel {
    motor: Motor,
    encoder: Encoder,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "a motor is { forwards = PIN, backwards = PIN }, \
                 or { pwm = PIN, direction = PIN, backwards_is = \"high\" }"
)]
enum Motor {
    TwoInputs(TwoInputs),
    PwmAndDirection(PwmAndDirection),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TwoInputs {
    forwards: u8,
    backwards: u8,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PwmAndDirection {
    pwm: u8,
    direction: u8,
    backwards_is: Level,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Level {
    High,
    Low,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Encoder {
    a: u8,
    b: u8,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sonar {
    looks_deg: i32,
    /// Of one with two pins.
    trigger: Option<u8>,
    echo: Option<u8>,
    /// Of one at the bus.
    chip: Option<SonarChip>,
    address: Option<u8>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
enum SonarChip {
    Srf08,
    Srf02,
}

impl SonarChip {
    fn name(self) -> &'static str {
        match self {
            SonarChip::Srf08 => "SRF08",
            SonarChip::Srf02 => "SRF02",
        }
    }
}

impl Sonar {
    /// Trigger and echo, if it has both.
    fn pins(&self) -> Option<(u8, u8)> {
        self.trigger.zip(self.echo)
    }

    /// Which one it is, and at which address, if it is at the bus.
    fn at_bus(&self) -> Option<(SonarChip, u8)> {
        self.chip.zip(self.address)
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Battery {
    pin: u8,
    full_scale_v: f32,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Floor {
    left: Option<u8>,
    middle: Option<u8>,
    right: Option<u8>,
    floor_counts: u16,
    line_counts: u16,
}

impl Default for Floor {
    /// No sensors. The counts are those of the shipped rover's.
    fn default() -> Self {
        Floor {
            left: None,
            middle: None,
            right: None,
            floor_counts: 500,
            line_counts: 3_300,
        }
    }
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Button {
    pin: u8,
    pressed: Level,
}

/// Contact switches behind the plate before the body.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Bumpers {
    left: u8,
    right: u8,
    pressed: Level,
}

impl Bumpers {
    /// Where each is, and its pin.
    fn switches(self) -> [(&'static str, u8); 2] {
        [("left", self.left), ("right", self.right)]
    }
}

/// The bus of sensors.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct I2c {
    sda: u8,
    scl: u8,
}

/// A gyroscope at the bus.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Gyro {
    chip: GyroChip,
}

#[derive(Clone, Copy, Debug, Deserialize)]
enum GyroChip {
    #[serde(rename = "BMI160")]
    Bmi160,
}

impl GyroChip {
    /// Its name, and its address at the bus.
    fn at(self) -> (&'static str, u8) {
        match self {
            GyroChip::Bmi160 => ("BMI160", 0x68),
        }
    }
}

impl RobotFile {
    /// What is at the I2C bus: as the file names it, what it is, and at which address.
    fn at_the_bus(&self) -> Vec<(String, String, u8)> {
        let gyro = self.gyro.map(|gyro| {
            let (chip, address) = gyro.chip.at();
            ("gyro".to_owned(), format!("gyroscope {chip}"), address)
        });
        let sonars = self.sonars.iter().enumerate();
        let sonars = sonars.filter_map(|(place, sonar)| {
            let (chip, address) = sonar.at_bus()?;
            let what = format!("sonar {place} {}", chip.name());
            Some((format!("sonars[{place}]"), what, address))
        });
        gyro.into_iter().chain(sonars).collect()
    }

    /// The wheels, and on which side each is.
    fn sides(&self) -> [(&'static str, &Wheel); 2] {
        [("left", &self.left), ("right", &self.right)]
    }

    /// The echo pins in the order of their first sonars, and the places of the sonars of each.
    fn echoes(&self) -> Vec<(u8, Vec<usize>)> {
        let mut echoes: Vec<(u8, Vec<usize>)> = Vec::new();
        for (place, sonar) in self.sonars.iter().enumerate() {
            let Some((_, echo)) = sonar.pins() else {
                continue;
            };
            match echoes.iter_mut().find(|(pin, _)| *pin == echo) {
                Some((_, places)) => places.push(place),
                None => echoes.push((echo, vec![place])),
            }
        }
        echoes
    }
}

impl Floor {
    /// The sensors that there are: where each looks, and its pin.
    fn sensors(&self) -> impl Iterator<Item = (&'static str, u8)> {
        [
            ("left", self.left),
            ("middle", self.middle),
            ("right", self.right),
        ]
        .into_iter()
        .filter_map(|(place, pin)| Some((place, pin?)))
    }
}

/// What `board.toml` says of a board; the rest is of others.
#[derive(Clone, Debug, Deserialize)]
struct Board {
    name: String,
    pins: Option<Pins>,
}

/// What a robot's file may connect on a board.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pins {
    prefix: String,
    free: Vec<u8>,
    analog: Vec<u8>,
    analog_full_scale: u16,
    pwm_repeats: u8,
    echo_pins: usize,
    /// Pairs of pins that an I2C bus can have: data and clock.
    i2c: Vec<[u8; 2]>,
    own: Vec<Own>,
}

/// A part of the board itself, and its pins: one at least.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Own {
    pins: Vec<u8>,
    part: String,
}

/// What a robot measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// From one wheel to the other, in metres.
    pub wheel_base_m: f32,
    /// Of the wheels, as they roll, in metres.
    pub wheel_radius_m: f32,
    /// Edges of an encoder in one turn of its wheel.
    pub counts_per_revolution: f32,
    /// Of a wheel at full power, in metres per second.
    pub full_speed_m_per_s: f32,
    /// The share of full power at which a wheel begins to turn.
    pub friction_power: f32,
    /// Volts at the battery that read as the converter's full scale.
    pub battery_full_scale_v: f32,
    /// Counts over bare floor.
    pub floor_counts: u16,
    /// Counts over a line.
    pub line_counts: u16,
}

/// Eighths of a turn, counter-clockwise from straight ahead.
fn eighths(degrees: i32) -> usize {
    degrees.rem_euclid(360) as usize / 45
}

/// Reads and checks a robot's file.
///
/// # Errors
/// The file cannot be read or is no TOML, or all that is wrong with it: a key that there is not, a
/// board that has no pins, a pin that it does not have or that has two parts, a measure that cannot
/// be.
pub fn read(file: &Path) -> Result<Robot, RobotFileError> {
    let text = std::fs::read_to_string(file).map_err(|cause| RobotFileError {
        file: file.to_owned(),
        problems: vec![cause.to_string()],
    })?;
    check(file, &text)
}

/// Checks the text of a robot's file. `file` is its name in errors.
///
/// # Errors
/// As [`read`].
pub fn check(file: &Path, text: &str) -> Result<Robot, RobotFileError> {
    parse(text).map_err(|problems| RobotFileError {
        file: file.to_owned(),
        problems,
    })
}

/// Whether a board's pins are connected by a robot's file.
pub fn has_pins(board: &str) -> bool {
    let boards = BOARDS.iter().filter_map(|text| toml::from_str(text).ok());
    boards
        .filter(|known: &Board| known.pins.is_some())
        .any(|known| known.name == board)
}

fn parse(text: &str) -> Result<Robot, Vec<String>> {
    let file: RobotFile = toml::from_str(text).map_err(|cause| vec![cause.to_string()])?;
    let boards = BOARDS.iter().filter_map(|text| toml::from_str(text).ok());
    let boards: Vec<Board> = boards
        .filter(|board: &Board| board.pins.is_some())
        .collect();
    let named = boards.iter().find(|board| board.name == file.board);
    let Some((board, pins)) = named.and_then(|board| Some((board, board.pins.clone()?))) else {
        let names: Vec<&str> = boards.iter().map(|board| &*board.name).collect();
        return Err(vec![format!(
            "there is no board `{}` with pins; the boards with pins are: {}",
            file.board,
            names.join(", ")
        )]);
    };
    let robot = Robot {
        board: board.clone(),
        pins,
        file,
    };
    match check::problems(&robot) {
        problems if problems.is_empty() => Ok(robot),
        problems => Err(problems),
    }
}

/// For the build script of a firmware: turns a robot's file, which is relative to the package, into
/// `robot.rs` in the build's folder. It has `MEASURES`, `WIRING` and the type `Robot`, for a
/// package that knows the board's crate by its name:
///
/// ```ignore
/// mod robot {
///     include!(concat!(env!("OUT_DIR"), "/robot.rs"));
/// }
/// ```
///
/// If the file cannot be used, cargo shows why, and the build ends.
///
/// # Panics
/// If it is called by something else than a build script.
pub fn build(file: &str) {
    println!("cargo:rerun-if-changed={file}");
    let robot = read(Path::new(file)).unwrap_or_else(|error| {
        for line in error.to_string().lines() {
            println!("cargo::error={line}");
        }
        std::process::exit(1)
    });
    let out = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets its variables"));
    std::fs::write(out.join("robot.rs"), robot.constants()).expect("OUT_DIR can be written to");
}

impl Robot {
    /// Its name, as its file says.
    pub fn name(&self) -> &str {
        &self.file.name
    }

    /// Its board's name.
    pub fn board(&self) -> &str {
        &self.board.name
    }

    /// Where each sonar looks, in eighths of a turn, counter-clockwise from straight ahead.
    pub fn sonars_look(&self) -> Vec<usize> {
        let looks = |sonar: &Sonar| eighths(sonar.looks_deg);
        self.file.sonars.iter().map(looks).collect()
    }

    /// What it measures.
    pub fn measured(&self) -> Measured {
        let wheels = &self.file.wheels;
        Measured {
            wheel_base_m: wheels.base_m,
            wheel_radius_m: wheels.radius_m,
            counts_per_revolution: wheels.counts_per_revolution,
            full_speed_m_per_s: wheels.full_speed_m_per_s,
            friction_power: wheels.friction_power,
            battery_full_scale_v: self.file.battery.full_scale_v,
            floor_counts: self.file.floor.floor_counts,
            line_counts: self.file.floor.line_counts,
        }
    }

    /// How the board prints the number of a pin.
    fn pin(&self, number: u8) -> String {
        format!("{}{number}", self.pins.prefix)
    }
}
