//! A run of a system: a board for each processor, on the host or in an emulator, all in one time,
//! around one plant.

mod emulated;

use std::thread;

use esm_toolkit::host_board::{HostMemory, about};
use esm_toolkit::host_run::{Ended, Given, RunError};
use esm_toolkit::plant::Plant;
use esm_toolkit::system::arrivals::Arrivals;
use esm_toolkit::system::declaration::{Link, Pins};
use esm_toolkit::system::lock_step::{self, InStep, Member, RunningProcessor};
use esm_toolkit::system::shared_plant::SharedPlant;
use esm_toolkit::system::wiring::{self, End, Links, Traffic};
use rt_firmware::body::PinImage;
use rt_firmware::{AnyTaskPool, Limits, Mailbox, RetainedRam, split};
use thiserror::Error;

use crate::host_board::RobotMaker;
use crate::run::drive;
pub use emulated::Emulated;
use emulated::EmulatedProcessor;

/// The memory of a processor's runtime lies on the stack, that of the next one above it.
const STACK_BYTES_EACH: usize = 32 * 1024 * 1024;

/// What a run is made of.
pub struct Plan {
    /// Makes the tasks of each processor.
    pub robot: RobotMaker,
    /// The processors, each as often as it is there: anew behind each reset.
    pub processors: Vec<Processor>,
    /// What lies between them.
    pub links: Vec<Link>,
    /// The body in its world.
    pub plant: Plant,
    /// Seed of what is random.
    pub seed: u64,
    /// Plant time at which the run ends, in microseconds.
    pub until_us: u64,
    /// Plant time at which the button of the emergency stop is pressed, in microseconds.
    pub stop_at_us: Option<u64>,
}

/// A processor between two resets.
pub struct Processor {
    /// Its index in the system.
    pub index: usize,
    /// Its mission, its clock, and when it is there.
    pub member: Member,
    /// What it has of the body.
    pub pins: Vec<Pins>,
    /// Where it is emulated; none for one that is a part of this process.
    pub emulated: Option<Emulated>,
}

/// A run that is over.
pub struct Outcome {
    /// How it ended for each of the plan's processors; none where its mission never started.
    pub processors: Vec<Option<Ended>>,
    /// The plant at the end.
    pub plant: Plant,
    /// What has crossed each link.
    pub traffic: Vec<Option<[wiring::Sent; 2]>>,
    /// What has arrived at both ends of each link.
    pub arrived: Vec<Option<[Arrivals; 2]>>,
}

/// Why a run did not come to its end.
#[derive(Debug, Error)]
pub enum SystemError {
    /// One of the boards did not do what it was asked for.
    #[error("processor {processor}: {error}")]
    Board {
        /// Its number, from 1.
        processor: usize,
        /// Why.
        #[source]
        error: RunError,
    },
    /// An emulated board did not do what it was asked for.
    #[error("processor {processor}: {error}")]
    Emulated {
        /// Its number, from 1.
        processor: usize,
        /// Why.
        #[source]
        error: drive::RunError,
    },
    /// An emulated board has more links than one.
    #[error(
        "processor {processor}: a board {board} has one link, over a UART, and the mission uses {links}: send over one link what goes the same way, and leave `over` out"
    )]
    Links {
        /// Its number, from 1.
        processor: usize,
        /// Its board.
        board: &'static str,
        /// How many links its mission uses.
        links: usize,
    },
    /// Something in the run of all.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The program that makes the robot's tasks did not hand them on.
    #[error("the robot's program made no tasks: it must call the function that it is given")]
    NoTasks,
    /// The system gives no thread.
    #[error("cannot start the boards: {0}")]
    Thread(#[from] std::io::Error),
    /// A task has panicked.
    #[error("the boards stopped: one of the robot's tasks panicked (its message is above)")]
    Panicked,
}

/// Hears what happens: to which processor, when by plant time, and what. Answers whether the run
/// goes on.
pub type Hear<'h> = dyn FnMut(usize, u64, Given) -> bool + Send + 'h;

/// Runs a system from its start to its end.
///
/// # Errors
/// [`SystemError`]
pub fn run(plan: Plan, hear: &mut Hear<'_>) -> Result<Outcome, SystemError> {
    let stack_bytes = STACK_BYTES_EACH * (plan.processors.len() + 1);
    thread::scope(|scope| {
        let boards = thread::Builder::new()
            .name("host boards".to_owned())
            .stack_size(stack_bytes)
            .spawn_scoped(scope, move || {
                let shared = SharedPlant::new(plan.plant.clone(), plan.stop_at_us);
                let links: Vec<Links> = (plan.processors.iter())
                    .map(|it| Links {
                        processor: it.index,
                        life: it.member.life,
                        links: it.member.mission.links.clone(),
                    })
                    .collect();
                let wires = wiring::wires(&plan.links, &links, plan.seed);
                let traffic: Traffic = wires.traffic;
                let mut ended = Vec::new();
                nest(&plan, Vec::new(), (&shared, wires.ends), &mut ended, hear)?;
                // The innermost came to its end first.
                ended.reverse();
                Ok(Outcome {
                    processors: ended,
                    plant: shared.at(plan.until_us),
                    traffic: traffic.sent(),
                    arrived: traffic.arrived(),
                })
            })?;
        boards.join().map_err(|_| SystemError::Panicked)?
    })
}

/// One more beside those that run, each of which may live longer than it.
fn joined<'r, 'l: 'r>(
    running: Vec<&'r mut (dyn InStep + 'l)>,
    run: &'r mut (dyn InStep + 'r),
) -> Vec<&'r mut (dyn InStep + 'r)> {
    let running = running.into_iter();
    let mut all: Vec<_> = running
        .map(|other| other as &mut (dyn InStep + 'r))
        .collect();
    all.push(run);
    all
}

/// Makes the next processor around those that there are, since a robot's maker lends its tasks to a
/// function; lets all run when they are complete.
fn nest(
    plan: &Plan,
    mut running: Vec<&mut (dyn InStep + '_)>,
    (shared, mut ends): (&SharedPlant, Vec<Vec<End>>),
    ended: &mut Vec<Option<Ended>>,
    hear: &mut Hear<'_>,
) -> Result<(), SystemError> {
    let Some(next) = plan.processors.get(running.len()) else {
        return Ok(lock_step::run(&mut running, plan.until_us, hear)?);
    };
    let processor = next.index + 1;
    let behind = shared.pins(&next.pins, next.member.life);
    let own = ends
        .get_mut(running.len())
        .map(std::mem::take)
        .unwrap_or_default();
    if let Some(emulated) = &next.emulated {
        let of_board = |error| SystemError::Emulated { processor, error };
        let mut uarts = own.into_iter().map(|end| end.uart);
        let uart = uarts.next().flatten();
        let links = 1 + uarts.count();
        if links > 1 || (uart.is_none() && !next.member.mission.links.is_empty()) {
            let board = emulated.board.name;
            return Err(SystemError::Links {
                processor,
                board,
                links,
            });
        }
        let (emulated, member) = (emulated.clone(), next.member.clone());
        let length = (plan.seed, plan.until_us);
        let run = EmulatedProcessor::switch_on(
            emulated,
            member,
            plan.plant.world(),
            (behind, uart),
            length,
        );
        let mut run = run.map_err(of_board)?;
        let all = joined(running, &mut run);
        nest(plan, all, (shared, ends), ended, hear)?;
        ended.push(run.finish().map_err(of_board)?);
        return Ok(());
    }
    let pins = PinImage::new();
    let mut result = Err(SystemError::NoTasks);
    let own = own.into_iter().map(|end| end.device).collect();
    // The maker is bound to call this once, and may not.
    let mut given = Some((running, behind, own, ends));
    (plan.robot)(pins.parts(), &mut |banks| {
        let Some((running, behind, own, ends)) = given.take() else {
            return;
        };
        let of_board = |error| SystemError::Board { processor, error };
        let mut banks: Vec<&mut dyn AnyTaskPool> = (banks.iter_mut())
            .map(|bank| &mut **bank as &mut dyn AnyTaskPool)
            .collect();
        let kept = RetainedRam::new();
        let mut memory = HostMemory::new();
        let mut mailbox = Mailbox::new();
        let limits = Limits::default();
        result = split(&mut memory, &mut banks, &mut mailbox, about(&kept), limits)
            .map_err(|fault| of_board(RunError::Registry(fault)))
            .and_then(|sides| {
                let length = (plan.seed, plan.until_us);
                let member = next.member.clone();
                let run = RunningProcessor::switch_on(sides, &pins, behind, member, own, length);
                let mut run = run.map_err(of_board)?;
                let all = joined(running, &mut run);
                nest(plan, all, (shared, ends), ended, hear)?;
                ended.push(run.finish().map_err(of_board)?);
                Ok(())
            });
    });
    result
}
