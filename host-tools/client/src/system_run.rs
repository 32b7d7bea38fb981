//! A run of a system: a host board for each processor, all in one time, around one plant.

use std::thread;

use esm_toolkit::host_board::{HostMemory, about};
use esm_toolkit::host_run::{Ended, Given, RunError};
use esm_toolkit::plant::Plant;
use esm_toolkit::system::declaration::{Link, Pins};
use esm_toolkit::system::lock_step::{self, InStep, Member, RunningProcessor};
use esm_toolkit::system::shared_plant::SharedPlant;
use esm_toolkit::system::wiring::{self, Devices, Links};
use rt_firmware::body::PinImage;
use rt_firmware::{AnyTaskPool, Limits, Mailbox, RetainedRam, split};
use thiserror::Error;

use crate::host_board::RobotMaker;

/// The memory of a processor's runtime lies on the stack, that of the next one above it.
const STACK_BYTES_EACH: usize = 32 * 1024 * 1024;

/// What a run is made of.
pub struct Plan {
    /// Makes the tasks of each processor.
    pub robot: RobotMaker,
    /// The processors, and what each has of the body.
    pub members: Vec<(Member, Vec<Pins>)>,
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

/// A run that is over.
pub struct Outcome {
    /// How it ended for each processor; none where its mission never started.
    pub processors: Vec<Option<Ended>>,
    /// The plant at the end.
    pub plant: Plant,
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
    let stack_bytes = STACK_BYTES_EACH * (plan.members.len() + 1);
    thread::scope(|scope| {
        let boards = thread::Builder::new()
            .name("host boards".to_owned())
            .stack_size(stack_bytes)
            .spawn_scoped(scope, move || {
                let shared = SharedPlant::new(plan.plant.clone(), plan.stop_at_us);
                let links: Vec<Links> = (plan.members.iter())
                    .map(|(member, _)| Links {
                        clock: member.clock,
                        links: member.mission.links.clone(),
                    })
                    .collect();
                let devices = wiring::devices(&plan.links, &links, plan.seed);
                let mut ended = Vec::new();
                nest(&plan, Vec::new(), (&shared, devices), &mut ended, hear)?;
                // The innermost came to its end first.
                ended.reverse();
                Ok(Outcome {
                    processors: ended,
                    plant: shared.at(plan.until_us),
                })
            })?;
        boards.join().map_err(|_| SystemError::Panicked)?
    })
}

/// Makes the next processor around those that there are, since a robot's maker lends its tasks to a
/// function; lets all run when they are complete.
fn nest(
    plan: &Plan,
    mut running: Vec<&mut (dyn InStep + '_)>,
    (shared, mut devices): (&SharedPlant, Vec<Devices>),
    ended: &mut Vec<Option<Ended>>,
    hear: &mut Hear<'_>,
) -> Result<(), SystemError> {
    let Some((member, has)) = plan.members.get(running.len()) else {
        return Ok(lock_step::run(&mut running, plan.until_us, hear)?);
    };
    let pins = PinImage::new();
    let behind = shared.pins(has, member.clock);
    let own = devices
        .get_mut(running.len())
        .map(std::mem::take)
        .unwrap_or_default();
    let mut result = Err(SystemError::NoTasks);
    // The maker is bound to call this once, and may not.
    let mut given = Some((running, behind, own, devices));
    (plan.robot)(pins.parts(), &mut |banks| {
        let Some((running, behind, own, devices)) = given.take() else {
            return;
        };
        let processor = running.len() + 1;
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
                let member = member.clone();
                let run = RunningProcessor::switch_on(sides, &pins, behind, member, own, length);
                let mut run = run.map_err(of_board)?;
                let mut all: Vec<&mut dyn InStep> = running
                    .into_iter()
                    .map(|other| other as &mut dyn InStep)
                    .collect();
                all.push(&mut run);
                nest(plan, all, (shared, devices), ended, hear)?;
                ended.push(run.finish().map_err(of_board)?);
                Ok(())
            });
    });
    result
}
