//! The link of missions over CAN: what lies between a chip's controller and
//! [`rt_firmware::frames::can`].
//!
//! Two interrupts, both above the slots, have the bus: that of a timer starts frames at their
//! times, that of the controller brings what has come.

use core::marker::PhantomData;

use embedded_can::nb::Can;
use rt_firmware::frames::can::{CanBus, CanDevice, CanQueues};

use crate::chip::Chip;
use crate::sys_tick;

/// While the controller has no place for a frame that is due, the timer looks again so soon, in
/// microseconds: three frames of 8 bytes take as long at 1 Mbit/s.
const LOOK_AGAIN_US: u32 = 400;

/// A chip with a CAN controller and a timer for it.
pub trait CanChip: Chip {
    /// The controller.
    type Controller: Can + 'static;

    /// Starts both, with their interrupts.
    fn start() -> Self::Controller;

    /// Sets the rate of the bus, in bits a second.
    fn set_rate(controller: &mut Self::Controller, rate_bps: u32);

    /// Lets the timer's interrupt come after so many ticks of the clock, or before.
    fn set_timer(ticks: u32);

    /// Takes the timer's interrupt back, and stops it.
    fn acknowledge_timer();

    /// Lets the timer's interrupt come at once. From any context below it.
    fn call();
}

/// What a controller sends and receives.
pub type FrameOf<C> = <<C as CanChip>::Controller as Can>::Frame;
/// The dispatchers' end.
pub type Device<C> = CanDevice<'static, FrameOf<C>>;

/// The interrupts' end.
pub struct CanLine<C: CanChip> {
    bus: CanBus<'static, C::Controller>,
    chip: PhantomData<C>,
}

/// Makes the two ends of a link, and starts what moves its frames.
pub fn start<C: CanChip>(queues: &'static mut CanQueues<FrameOf<C>>) -> (CanLine<C>, Device<C>) {
    let (bus, device) = queues.split(C::start(), C::TICKS_PER_US, C::call);
    let chip = PhantomData;
    (CanLine { bus, chip }, device)
}

impl<C: CanChip> CanLine<C> {
    /// Takes over what is to be sent, and starts what is due. To be called by the timer's
    /// interrupt.
    pub fn start_due(&mut self) {
        C::acknowledge_timer();
        if let Some((controller, rate_bps)) = self.bus.new_rate() {
            C::set_rate(controller, rate_bps);
        }
        self.go_on();
    }

    /// Takes what has come. To be called by the controller's interrupt.
    pub fn serve(&mut self) {
        self.bus.hear(sys_tick::now_ticks());
        self.go_on();
    }

    fn go_on(&mut self) {
        let now_ticks = sys_tick::now_ticks();
        if let Some(next_ticks) = self.bus.start_due(now_ticks) {
            let ticks = next_ticks.saturating_sub(now_ticks);
            C::set_timer(u32::try_from(ticks).unwrap_or(u32::MAX));
        } else if self.bus.is_waiting() {
            C::set_timer(LOOK_AGAIN_US * C::TICKS_PER_US);
        }
    }
}
