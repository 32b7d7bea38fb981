//! A run of the robot that ships, where nobody has a stack for it.

use rt_firmware::body::PinImage;
use rt_firmware::rover::{Measures, PinRover};
use rt_firmware::{AnyTaskPool, Limits, Mailbox, RetainedRam, split};

use super::run::{HostRun, Planned, Settings};
use super::session::RunError;
use crate::host_board::{HostMemory, about};

/// Gives a value to the process for as long as it lives.
fn kept<T>(value: T) -> &'static mut T {
    Box::leak(Box::new(value))
}

/// Starts a run that needs nobody else. Its runtime, of some megabytes, stays until the process
/// ends: this is for a process, or an instance of a module, that runs one mission.
///
/// # Errors
/// [`RunError`]
pub fn start_rover(
    settings: Settings,
    missions: Vec<Planned>,
) -> Result<HostRun<'static, 'static, 'static>, RunError> {
    let pins: &'static PinImage = kept(PinImage::new());
    let rover = kept(PinRover::new(pins.parts().into(), &Measures::ROVER));
    let banks: Vec<&'static mut (dyn AnyTaskPool + 'static)> = (rover.banks().into_iter())
        .map(|bank| bank as &mut (dyn AnyTaskPool + 'static))
        .collect();
    let about = about(kept(RetainedRam::new()));
    let (memory, mailbox) = (kept(HostMemory::new()), kept(Mailbox::new()));
    let sides = split(memory, Vec::leak(banks), mailbox, about, Limits::default())
        .map_err(RunError::Registry)?;
    HostRun::start(sides, pins, settings, missions)
}
