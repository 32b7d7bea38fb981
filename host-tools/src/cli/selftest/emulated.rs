//! A simulated robot, with faults planted in what is around its board. The board and its firmware
//! are as they are.

use std::path::Path;

use super::faults::{Fault, SLOW_PPM};
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::robot::Robot;
use crate::cli::stage;
use crate::host_board::RobotMaker;
use crate::link_client::{LinkClient, RobotInfo};
use crate::lockstep::pace::Pace;
use crate::lockstep::plant_side::{PlantSide, SonarBreak};
use crate::plant::Plant;
use crate::run::board::{LinkWay, RunningBoard};
use crate::serial::ByteLink;
use crate::serial::crystal::Detuned;
use crate::serial::noise::{Noise, Noisy};
use crate::world::World;

/// A hall in which each sonar has something before it.
const HALL: &str = "world hall\nstart 0,0 0\nwall -1.2,-1.2 1.2,-1.2 1.2,1.2 -1.2,1.2 -1.2,-1.2\n";

/// The voltage of a battery that is nearly empty, and does not know it.
const LOW_V: f64 = 6.45;

/// Bytes that a noisy line spoils: one in 480.
const NOISE: Noise = Noise::of_each(700);

/// A simulated robot that runs. Dropping it ends it.
pub struct Emulated {
    // Dropped first: the line has a reader as long as the board lives.
    _board: RunningBoard,
    /// Its body.
    pub plant: PlantSide,
    /// A session with it, and what it says of itself.
    pub robot: Robot,
    pub info: RobotInfo,
}

/// Starts the board of this name with these faults.
///
/// # Errors
/// There is no such board, or it does not start.
pub fn start(
    name: &str,
    firmware: Option<&Path>,
    faults: &[Fault],
    seed: u64,
    maker: RobotMaker,
    console: &mut Console,
) -> Result<Emulated, CommandError> {
    let board = stage::board(name, firmware, maker, console)?;
    let world = World::parse(HALL).map_err(|error| CommandError::Input(error.into()))?;
    let mut body = stage::body(firmware)?;
    if faults.contains(&Fault::LowBattery) {
        body.battery.full_v = LOW_V;
    }
    let plant = Plant::new(world, body, seed).map_err(|error| CommandError::Input(error.into()))?;
    let flash = board.flash_of_a_run();
    if faults.contains(&Fault::BadMissionSector) {
        // The first slot for missions begins there.
        flash.wear_out(0..1);
    }
    if faults.contains(&Fault::BadFlashSector) {
        flash.wear_out(board.second_records());
    }
    let plant = PlantSide::new(plant, Pace::new(false), None).with_flash(Some(flash));
    let mut breaks = Vec::new();
    for fault in faults {
        match fault {
            Fault::Wiring(fault) => plant.miswire(*fault),
            Fault::Sonar(sonar, fault) => breaks.push(SonarBreak {
                sonar: *sonar,
                fault: *fault,
                robot_us: 0,
            }),
            _ => {}
        }
    }
    plant.break_sonars(breaks);
    let (board, mut line) = RunningBoard::start(board, &plant, None, LinkWay::Exchange)?;
    if faults.contains(&Fault::SlowCrystal) {
        line = Box::new(Detuned::new(line, SLOW_PPM)) as Box<dyn ByteLink>;
    }
    if faults.contains(&Fault::NoisyLine) {
        line = Box::new(Noisy::new(line, NOISE, seed));
    }
    let (robot, info) = LinkClient::connect(line)?;
    Ok(Emulated {
        _board: board,
        plant,
        robot,
        info,
    })
}
