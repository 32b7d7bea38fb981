//! The sides of a robot's runtime, in their places.

use core::mem::MaybeUninit;

use esm_link::message::ResetReason;
use rt_firmware::{Background, LinkSide, RealTime, RegistryFault};

/// The sides of a runtime: for the slot timer's interrupt, for the idle loop, for the link's task.
/// The large ones by reference: RTIC moves what it is given on the stack.
pub struct Sides {
    /// For the slot timer's interrupt.
    pub real_time: &'static mut RealTime<'static, 'static>,
    /// For the idle loop.
    pub background: Background<'static, 'static>,
    /// For the link's task.
    pub link: &'static mut LinkSide<'static, 'static>,
}

/// What the first code of a firmware finds out and makes.
pub struct Start<B, P> {
    /// Why the firmware starts.
    pub reset: ResetReason,
    /// The board for the slot timer's handler.
    pub board: B,
    /// The robot's pins.
    pub parts: P,
}

/// Makes a runtime, and puts its sides into their places. `split` is a call of
/// [`split`](rt_firmware::split) with the memory and the banks of a robot.
///
/// # Panics
/// If two tasks have one name, or two port types do.
// Not inlined, so that what making them takes of the stack is given back.
#[inline(never)]
pub fn make(
    real_time_place: &'static mut MaybeUninit<RealTime<'static, 'static>>,
    link_place: &'static mut MaybeUninit<LinkSide<'static, 'static>>,
    split: impl FnOnce() -> Result<rt_firmware::Sides<'static, 'static>, RegistryFault>,
) -> Sides {
    match split() {
        Ok((real_time, background, link)) => Sides {
            real_time: real_time_place.write(real_time),
            background,
            link: link_place.write(link),
        },
        Err(_) => panic!("two tasks have one name, or two port types do"),
    }
}
