//! What `run`, `board` and `tasks` set a robot up with: the board by its name, the world, the
//! mission.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use esm_core::Verified;
use robot_file::{Measured, Robot};
use rt_firmware::rover::Measures;

use super::console::Console;
use super::exit::CommandError;
use super::file;
use super::mission::{self, Audience, BLOB_MARK};
use crate::boards;
use crate::compile::NameTable;
use crate::files;
use crate::files::MAX_BLOB_BYTES;
use crate::host_board::{self, RobotMaker};
use crate::inspect::refusal::Explained;
use crate::lang::Checked;
use crate::nearest::nearest;
use crate::plant::BodyParameters;
use crate::plant::flash::{Flash, FlashError};
use crate::qemu::firmware::{self, FirmwareError};
use crate::run::board::Board;
use crate::run::mission::Mission;
use crate::schedule::LaidOut;
use crate::schedule::handover::{self, Handover, SlotTable};
use crate::time::work_limit;
use crate::world::{World, WorldError};

/// The worlds that ship, by the names under which they are asked for. The first is driven in where
/// none is named.
const SHIPPED_WORLDS: [(&str, &str); 9] = [
    (
        "office",
        include_str!("../../shipped/missions/worlds/office.world"),
    ),
    (
        "corridor",
        include_str!("../../shipped/missions/worlds/corridor.world"),
    ),
    (
        "track",
        include_str!("../../shipped/missions/worlds/track.world"),
    ),
    (
        "empty",
        include_str!("../../shipped/missions/worlds/empty.world"),
    ),
    (
        "visitors",
        include_str!("../../shipped/missions/worlds/visitors.world"),
    ),
    (
        "office_floor",
        include_str!("../../shipped/missions/worlds/office_floor.world"),
    ),
    (
        "low_boxes",
        include_str!("../../shipped/missions/worlds/low_boxes.world"),
    ),
    (
        "shut_doors",
        include_str!("../../shipped/missions/worlds/shut_doors.world"),
    ),
    (
        "cluttered",
        include_str!("../../shipped/missions/worlds/cluttered.world"),
    ),
];

/// The world that is driven in where none is named.
pub const DEFAULT_WORLD: &str = {
    let [(default, _), ..] = SHIPPED_WORLDS;
    default
};

/// Where the worlds of a folder of missions are.
const WORLDS_FOLDER: &str = "worlds";

/// The board of that name, with its firmware found or built.
///
/// # Errors
/// If there is no such board, or no firmware for it.
pub fn board(
    name: &str,
    named_firmware: Option<&Path>,
    robot: RobotMaker,
    console: &mut Console,
) -> Result<Board, CommandError> {
    if name == host_board::BOARD {
        return Ok(Board::Host { robot });
    }
    let board = boards::find(name).map_err(|unknown| CommandError::Usage(unknown.into()))?;
    if board
        .firmware
        .is_some_and(|firmware| !firmware.is_emulated())
    {
        return Err(CommandError::Usage(anyhow!(
            "no emulator has the chip of the board {name}: put the firmware onto one with `esm flash --board {name}`, \
             and upload the mission with `esm upload`; or drive on the host with `--board host`"
        )));
    }
    let firmware = find_firmware_of(board, named_firmware, console)?;
    firmware::check(board, &firmware)?;
    Ok(Board::Emulated { board, firmware })
}

/// The body of the robot whose firmware is named: of the robot's file that stands beside it, or the
/// rover's. Wheels slip, motors pull and sonars sit as the rover's do, in proportion.
///
/// # Errors
/// If the robot's file cannot be read or has errors.
pub fn body(named_firmware: Option<&Path>) -> Result<BodyParameters, CommandError> {
    let robot = robot_beside(named_firmware)?;
    Ok(robot.map_or_else(BodyParameters::default, |robot| body_of(&robot.measured())))
}

/// The robot whose file stands beside its firmware; none where there is no such file.
///
/// # Errors
/// If the robot's file cannot be read or has errors.
pub fn robot_beside(named_firmware: Option<&Path>) -> Result<Option<Robot>, CommandError> {
    let file = named_firmware.map(|firmware| firmware.with_extension("toml"));
    let file = file.filter(|file| file.is_file());
    file.map(|file| robot(&file)).transpose()
}

/// The robot of a file.
///
/// # Errors
/// If it cannot be read or has errors.
pub fn robot(file: &Path) -> Result<Robot, CommandError> {
    let text = file::read_text(file, "robot's file")?;
    robot_file::check(file, &text).map_err(|error| CommandError::Input(error.into()))
}

/// The body that measures so.
fn body_of(robot: &Measured) -> BodyParameters {
    const ROVER: Measures = Measures::ROVER;
    // Equal measures are the factor 1, and the same body to the last bit.
    let part = |of: f32, rover: f32| f64::from(of) / f64::from(rover);
    let base = part(robot.wheel_base_m, ROVER.chassis.wheel_base_m);
    let wheel = part(robot.wheel_radius_m, Measures::WHEEL_RADIUS_M);
    let counts = part(robot.counts_per_revolution, Measures::COUNTS_PER_REVOLUTION);
    let speed = part(robot.full_speed_m_per_s, ROVER.chassis.full_speed_m_per_s);
    let mut body = BodyParameters::default();
    body.radius_m *= base;
    body.wheel_base_m *= base;
    body.sonar.rim_m *= base;
    body.floor.ahead_m *= base;
    body.wheel_radius_m *= wheel;
    body.counts_per_revolution *= counts;
    body.motor.speed_rad_per_s_v *= speed / wheel;
    body.motor.dead_v *= part(robot.friction_power, ROVER.chassis.friction_power);
    body.battery.full_scale_v *= part(robot.battery_full_scale_v, ROVER.battery_full_scale_v);
    body.floor.floor_counts += f64::from(robot.floor_counts) - f64::from(ROVER.floor_counts);
    body.floor.line_counts += f64::from(robot.line_counts) - f64::from(ROVER.line_counts);
    body
}

/// The flash that a board's robot has, if it is to be a file.
///
/// # Errors
/// If the file cannot be had, or is no flash of this board.
pub fn flash(path: Option<&Path>, board: &Board) -> Result<Option<Flash>, CommandError> {
    let opened = path.map(|path| Flash::open(path, board.flash_bytes()));
    opened.transpose().map_err(|error| match error {
        FlashError::Length { .. } => CommandError::Input(error.into()),
        FlashError::File { .. } | FlashError::InUse { .. } => CommandError::World(error.into()),
    })
}

/// The default board's firmware: the named one, or that of the checkout, which is built if need be.
///
/// # Errors
/// If there is none.
pub fn find_firmware(named: Option<&Path>, console: &mut Console) -> Result<PathBuf, CommandError> {
    let board = boards::find(boards::DEFAULT);
    let board = board.map_err(|unknown| CommandError::Usage(unknown.into()))?;
    find_firmware_of(board, named, console)
}

fn find_firmware_of(
    board: &boards::Board,
    named: Option<&Path>,
    console: &mut Console,
) -> Result<PathBuf, CommandError> {
    let here = std::env::current_dir()?;
    let tell = |told: &str| console.note(told);
    Ok(firmware::find(board, named, &here, tell)?)
}

impl From<FirmwareError> for CommandError {
    fn from(error: FirmwareError) -> Self {
        match error {
            FirmwareError::NoCheckout { .. } | FirmwareError::Build { .. } => {
                CommandError::World(error.into())
            }
            FirmwareError::Missing { .. }
            | FirmwareError::Unreadable { .. }
            | FirmwareError::NotElf { .. }
            | FirmwareError::Cut { .. }
            | FirmwareError::OtherProcessor { .. }
            | FirmwareError::OtherBoard { .. } => CommandError::Input(error.into()),
        }
    }
}

/// The world that was asked for, or the office: a file; the name of a file in the folder `worlds`
/// beside the mission; the name of a world that ships.
///
/// # Errors
/// If there is none, or the file cannot be read or has errors.
pub fn world(asked: Option<&Path>, mission: Option<&Path>) -> Result<World, CommandError> {
    let asked = asked.unwrap_or(Path::new(DEFAULT_WORLD));
    let beside_mission = mission.and_then(Path::parent).map(|folder| {
        folder
            .join(WORLDS_FOLDER)
            .join(asked)
            .with_extension("world")
    });
    let shipped = SHIPPED_WORLDS
        .iter()
        .find(|(name, _)| Path::new(name) == asked);
    let found = match (beside_mission, shipped) {
        _ if asked.is_file() => files::load_world(asked),
        (Some(path), _) if is_plain_name(asked) && path.is_file() => files::load_world(&path),
        (_, Some((_, text))) => World::parse(text),
        _ if is_plain_name(asked) && !asked.exists() => {
            let names = SHIPPED_WORLDS.map(|(name, _)| name);
            let meant = match nearest(&asked.to_string_lossy(), names) {
                Some(meant) => format!("; did you mean `{meant}`?"),
                None => String::new(),
            };
            return Err(CommandError::Input(anyhow!(
                "there is no world `{}`: name a world file, or one of the worlds that ship: {}{meant}",
                asked.display(),
                names.join(", ")
            )));
        }
        _ => files::load_world(asked),
    };
    found.map_err(|error| {
        CommandError::Input(match error {
            WorldError::Read { .. } => anyhow!("{error}{}", file::meant(asked)),
            _ => anyhow::Error::new(error).context(format!("world {}", asked.display())),
        })
    })
}

/// Whether it is a name and no path to a file.
fn is_plain_name(asked: &Path) -> bool {
    asked.components().count() == 1 && asked.extension().is_none()
}

/// A mission from a file, and what it takes to lay its slots out anew.
pub struct Staged {
    /// The mission, as if it started from standing still.
    pub mission: Mission,
    slots: SlotTable,
    /// What it was compiled from; a blob is what it is.
    source: Option<Checked>,
}

/// The mission in a file: a source is compiled, a blob taken as it is.
///
/// # Errors
/// If it cannot be read, or has errors.
pub fn mission(path: &Path, console: &mut Console) -> Result<Staged, CommandError> {
    let bytes = file::read(path, MAX_BLOB_BYTES, "mission")?;
    let (source, verified) = if bytes.starts_with(BLOB_MARK) {
        (None, verified(path, bytes)?)
    } else {
        // The robot itself says what it has room for.
        let (checked, verified) =
            mission::compiled_from(path, None, NameTable::Kept, Audience::Person, console)?;
        (Some(checked), verified)
    };
    Ok(Staged {
        slots: SlotTable::of(&verified.tables()),
        mission: staged(path, verified)?,
        source,
    })
}

fn staged(path: &Path, verified: Verified<Vec<u8>>) -> Result<Mission, CommandError> {
    Mission::named_or_numbered(path, verified).map_err(|error| CommandError::Input(error.into()))
}

/// Refuses to record a mission whose names were left out: what it does could not be told.
///
/// # Errors
/// If they were.
pub fn require_names(mission: &Mission) -> Result<(), CommandError> {
    if mission.has_names {
        return Ok(());
    }
    Err(CommandError::Input(anyhow!(
        "{} was built without names, so that a recording of it could not be replayed: leave out `--record`, or build it again with its names",
        mission.file.display()
    )))
}

/// What is said before a warm change to or from a mission whose names were left out.
pub fn nothing_goes_on(which: &dyn fmt::Display) -> String {
    format!(
        "{which} has no names, by which it is decided what goes on: all begins anew, as without `--warm`"
    )
}

impl Staged {
    /// The mission's slots.
    pub fn slots(&self) -> &SlotTable {
        &self.slots
    }

    /// Lets the mission follow the one that runs with these slots: what both have goes on as it
    /// runs, as far as that is possible. Tells the person which slots do not, and answers what
    /// becomes of each.
    ///
    /// # Errors
    /// Slots move, and `seamless` says that none may.
    pub fn follow(
        &mut self,
        running: &SlotTable,
        seamless: bool,
        console: &mut Console,
    ) -> Result<Handover, CommandError> {
        if let Some(checked) = &mut self.source {
            let limit = work_limit(mission::LAY_OUT_LIMIT);
            let schedule = handover::lay_out(running, &self.slots, limit);
            if schedule.starts_us != self.slots.starts_us() {
                let schedule = LaidOut {
                    starts_us: schedule.starts_us,
                    frame_starts_us: checked.lay_out_frames(limit).unwrap_or_default(),
                };
                let blob = mission::compile(checked, &schedule, None, NameTable::Kept)?;
                let verified = blob.ok_or(CommandError::Told)?;
                self.slots = SlotTable::of(&verified.tables());
                self.mission = staged(&self.mission.file, verified)?;
            }
        }
        let handover = Handover::between(running, &self.slots);
        if handover.is_seamless() {
            return Ok(handover);
        }
        let file = self.mission.file.display();
        let hint = match &self.source {
            None if !handover.interpreter_period_changes => {
                "\nthe starts in a blob are fixed; given the mission's source, `esm` looks for starts that go on"
            }
            _ => "",
        };
        if seamless {
            return Err(CommandError::Input(anyhow!(
                "{file} cannot follow without a gap, and nothing was sent:\n{handover}{hint}"
            )));
        }
        console.note(&format!("{file}: {handover}{hint}"));
        Ok(handover)
    }
}

/// A blob that is one.
///
/// # Errors
/// If it is none.
pub fn verified(path: &Path, blob: Vec<u8>) -> Result<Verified<Vec<u8>>, CommandError> {
    let refused = |refusal| {
        CommandError::Input(anyhow!(
            "{} is no valid blob: {}",
            path.display(),
            Explained(refusal)
        ))
    };
    let verified = esm_core::verify(blob).map_err(|(_, refusal)| refused(refusal))?;
    // A firmware compares texts with those of its own tasks; here there are none to compare with.
    esm_core::texts::check(&verified.tables()).map_err(refused)?;
    Ok(verified)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_world_is_a_file_or_a_name() {
        let folder = tempfile::tempdir().unwrap();
        let mission = folder.path().join("patrol.esm");
        let worlds = folder.path().join(WORLDS_FOLDER);
        std::fs::create_dir(&worlds).unwrap();
        let text =
            |name: &str| format!("world {name}\nstart 0,0 0\nwall 5,5 6,6\nroom r 0,0 1,0 1,1\n");
        std::fs::write(worlds.join("yard.world"), text("my-yard")).unwrap();
        std::fs::write(worlds.join("corridor.world"), text("my-corridor")).unwrap();
        let yard = worlds.join("yard.world");
        // What is asked for, the mission, and the world's name or the beginning of the error.
        type Case<'a> = (Option<&'a Path>, Option<&'a Path>, Result<&'a str, &'a str>);
        let cases: &[Case<'_>] = &[
            (None, None, Ok("office")),
            (Some(Path::new("office")), None, Ok("office")),
            (Some(Path::new("corridor")), None, Ok("corridor")),
            (
                Some(Path::new("corridor")),
                Some(&mission),
                Ok("my-corridor"),
            ),
            (Some(Path::new("yard")), Some(&mission), Ok("my-yard")),
            (Some(&yard), None, Ok("my-yard")),
            (
                Some(Path::new("yard")),
                None,
                Err(
                    "there is no world `yard`: name a world file, or one of the worlds that ship: office, corridor, track, empty",
                ),
            ),
            (
                Some(Path::new("gone.world")),
                Some(&mission),
                Err("cannot read the world gone.world"),
            ),
        ];
        for (asked, mission, expected) in cases {
            let found = world(*asked, *mission);
            match (found, expected) {
                (Ok(world), Ok(name)) => assert_eq!(world.name, *name),
                (Err(error), Err(start)) => {
                    assert!(error.to_string().starts_with(start), "{asked:?}: {error}");
                }
                (Ok(world), Err(_)) => panic!("{asked:?} is {}", world.name),
                (Err(error), Ok(_)) => panic!("{asked:?}: {error}"),
            }
        }
    }

    #[test]
    fn a_robot_that_measures_as_the_rover_has_its_body() {
        let rover = Measured {
            wheel_base_m: Measures::ROVER.chassis.wheel_base_m,
            wheel_radius_m: Measures::WHEEL_RADIUS_M,
            counts_per_revolution: Measures::COUNTS_PER_REVOLUTION,
            full_speed_m_per_s: Measures::ROVER.chassis.full_speed_m_per_s,
            friction_power: Measures::ROVER.chassis.friction_power,
            battery_full_scale_v: Measures::ROVER.battery_full_scale_v,
            floor_counts: Measures::ROVER.floor_counts,
            line_counts: Measures::ROVER.line_counts,
        };
        assert_eq!(body_of(&rover), BodyParameters::default());
        let smaller = Measured {
            wheel_base_m: rover.wheel_base_m / 2.0,
            wheel_radius_m: rover.wheel_radius_m / 2.0,
            ..rover
        };
        let body = body_of(&smaller);
        let whole = BodyParameters::default();
        assert_eq!(body.wheel_base_m, whole.wheel_base_m / 2.0);
        assert_eq!(body.radius_m, whole.radius_m / 2.0);
        // As fast as before, on wheels of half the size.
        assert_eq!(
            body.motor.speed_rad_per_s_v,
            whole.motor.speed_rad_per_s_v * 2.0
        );
    }
}
