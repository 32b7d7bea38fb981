//! Runs of one mission on the host board.

use std::path::Path;

use host_tools::files::load_world;
use host_tools::host_board;
use host_tools::run::board::{Board, LinkWay};
use host_tools::run::drive::{self, Plan, Planned, Run};
use host_tools::run::interrupt::Interrupt;
use host_tools::run::mission::Mission;
use host_tools::world::World;

use crate::command::root;
use crate::subject;

/// A world that ships.
///
/// # Panics
/// If there is none of this name.
#[track_caller]
pub fn world(name: &str) -> World {
    let file = root().join(format!("missions/worlds/{name}.world"));
    load_world(&file).expect("a world that ships")
}

/// A run of the mission in a file, which repeats to the byte, without an end.
///
/// # Panics
/// If the mission does not compile.
#[track_caller]
pub fn plan(file: &Path, world: World) -> Plan {
    let blob = subject::build_file(file).expect("a mission").blob;
    let verified = esm_core::verify(blob).expect("a valid blob");
    let mission = Mission::new(file, verified).expect("a mission with names");
    Plan {
        link: LinkWay::Exchange,
        ..Plan::new(
            Board::Host {
                robot: host_board::rover,
            },
            world,
            vec![Planned::first(mission)],
        )
    }
}

/// Drives by a plan, and keeps the trace.
///
/// # Panics
/// If the run does not come to its end, or a fault ends it.
#[track_caller]
pub fn driven(plan: Plan) -> Run<Vec<u8>> {
    let interrupt = Interrupt::take_over().expect("signals can be taken over");
    let run = drive::drive(plan, Vec::new(), interrupt, &mut |_| ()).expect("a whole run");
    assert_eq!(run.summary.fault, None);
    run
}
