//! The drive of the simulated rover.

use std::io;

use anyhow::anyhow;

use super::tune_mission::ROVER;
use crate::cli::exit::CommandError;
use crate::cli::memory::Recorded;
use crate::cli::mission;
use crate::compile::NameTable;
use crate::host_board::RobotMaker;
use crate::lang;
use crate::recording::player::Recording;
use crate::run::board::{Board, LinkWay};
use crate::run::drive::{Plan, Planned, drive as run};
use crate::run::interrupt::Interrupt;
use crate::run::mission::Mission;
use crate::world::World;

/// Far more than the drive takes.
const UNTIL_US: u64 = 180_000_000;

/// Free floor.
const HALL: &str = "world hall\nstart 0,0 0\nwall -3,-3 3,-3 3,3 -3,3 -3,-3\n";

/// Drives the mission, and records it.
///
/// # Errors
/// The drive does not come to its end.
pub fn drive(text: &str, seed: u64, robot: RobotMaker) -> Result<Recording, CommandError> {
    const NAME: &str = "tune.esm";
    let mut checked = lang::load_texts(&[(NAME, text), ("rover.esm", ROVER)]);
    let blob = mission::lay_out_and_compile(&mut checked, None, NameTable::Kept)?;
    let defect = || CommandError::Input(anyhow!("{}", checked.render(false)));
    let mission = Mission::new(NAME.as_ref(), blob.ok_or_else(defect)?);
    let mission = mission.map_err(|error| CommandError::Input(error.into()))?;
    let recorded = Recorded::default();
    let plan = Plan {
        link: LinkWay::Exchange,
        seed,
        until_us: Some(UNTIL_US),
        record: Some(Box::new(recorded.clone())),
        sample_period: Some(std::time::Duration::ZERO),
        ..Plan::new(
            Board::Host { robot },
            World::parse(HALL).map_err(|error| CommandError::Input(error.into()))?,
            vec![Planned::first(mission)],
        )
    };
    let done = run(plan, io::sink(), Interrupt::take_over()?, &mut |_| ())?;
    if done.summary.interrupted {
        return Err(CommandError::World(anyhow!(
            "ended by Ctrl-C before the drive was over"
        )));
    }
    if let Some(fault) = done.summary.fault {
        return Err(CommandError::Input(anyhow!(
            "the drive ended early: {fault}"
        )));
    }
    recorded.read()
}
