//! A run of the robot that ships, where nobody has a stack for it.

use rt_firmware::body::PinImage;
use rt_firmware::rover::{Measures, PinRover};
use rt_firmware::{AnyTaskPool, Limits, Mailbox, RetainedRam, split};

use super::run::{HostRun, Planned, Settings};
use super::session::RunError;
use crate::host_board::{HostMemory, about};

/// Makes a value and gives it to the process for as long as it lives. Each is made in a call of its
/// own: a build without optimisation makes it on the stack, and so never two of them at once.
#[inline(never)]
fn kept<T>(make: impl FnOnce() -> T) -> &'static mut T {
    Box::leak(Box::write(Box::new_uninit(), make()))
}

/// Starts a run that needs nobody else. Its runtime, of some megabytes, stays until the process
/// ends: this is for a process, or an instance of a module, that runs one mission. A build without
/// optimisation needs about 2 MB of stack here, which is as much as a thread has by default: give
/// it a thread with 8 MiB.
///
/// # Errors
/// [`RunError`]
pub fn start_rover(
    settings: Settings,
    missions: Vec<Planned>,
) -> Result<HostRun<'static, 'static, 'static>, RunError> {
    let pins: &'static PinImage = kept(PinImage::new);
    let rover = kept(|| PinRover::new(pins.parts().into(), &Measures::ROVER));
    let banks: Vec<&'static mut (dyn AnyTaskPool + 'static)> = (rover.banks().into_iter())
        .map(|bank| bank as &mut (dyn AnyTaskPool + 'static))
        .collect();
    let about = about(kept(RetainedRam::new));
    let (memory, mailbox) = (kept(HostMemory::new), kept(Mailbox::new));
    let sides = split(memory, Vec::leak(banks), mailbox, about, Limits::default())
        .map_err(RunError::Registry)?;
    HostRun::start(sides, pins, settings, missions)
}
