//! A board whose body is the plant's, as the real-time side sees it: its pins are an image that one
//! exchange an activation carries to the plant and back.

use core::marker::PhantomData;

use esm_link::message::SafeReason;
use rt_firmware::body::{Freshness, PinImage, PlantExchange};
#[cfg(feature = "links")]
use rt_firmware::frames::LinkDevice;
use rt_firmware::{ActivationStart, Board};

#[cfg(not(feature = "links"))]
use crate::chip::Chip as BoardChip;
#[cfg(feature = "links")]
use crate::frames::{self, FrameDevice, FrameLine, FrameUart as BoardChip};
use crate::{last_exchange, plant, sys_tick};

/// The pins. Drivers are built on their [`parts`](PinImage::parts) by the robot; the slot timer's
/// handler carries them to the plant.
pub static PINS: PinImage = PinImage::new();

/// Time, body and pins for the slot timer's handler.
pub struct PlantBoard<C> {
    exchange: PlantExchange,
    /// Plant time when this run of the firmware began its first mission: where the last run left
    /// it.
    plant_epoch_us: u64,
    #[cfg(feature = "links")]
    frames: Option<FrameDevice<C>>,
    chip: PhantomData<C>,
}

impl<C> PlantBoard<C> {
    /// The board of a firmware that starts when the plant's time is `plant_epoch_us`.
    pub fn new(plant_epoch_us: u64) -> Self {
        Self {
            exchange: PlantExchange::new(),
            plant_epoch_us,
            #[cfg(feature = "links")]
            frames: None,
            chip: PhantomData,
        }
    }
}

#[cfg(feature = "links")]
impl<C: BoardChip> FrameLine<C> {
    /// Starts a mission's link, and gives the board its device.
    ///
    /// # Panics
    /// Where it is called twice.
    pub fn start(board: &mut PlantBoard<C>) -> Self {
        let (line, device) = frames::start();
        board.frames = Some(device);
        line
    }
}

#[cfg(feature = "links")]
impl<C: BoardChip> PlantBoard<C> {
    /// Lets the device of a mission's link know how robot time goes with the clock.
    pub fn note_time(&mut self, activation: &ActivationStart) {
        if let Some(frames) = &mut self.frames {
            frames.note(activation.start_us, activation.start_ticks);
        }
    }
}

impl<C: BoardChip> Board for PlantBoard<C> {
    const TICKS_PER_US: u32 = C::TICKS_PER_US;
    const COUNT_BITS: u32 = sys_tick::BITS;

    fn now_ticks(&mut self) -> u64 {
        sys_tick::advance()
    }

    #[inline(always)]
    fn now_low_ticks(&mut self) -> u32 {
        sys_tick::low_ticks()
    }

    #[inline(always)]
    fn count(&mut self) -> u32 {
        sys_tick::count()
    }

    // Not inlined: no task should run on top of the exchange's messages.
    #[inline(never)]
    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        #[cfg(feature = "links")]
        self.note_time(activation);
        let request = self.exchange.request(
            &PINS,
            self.plant_epoch_us + activation.start_us,
            self.plant_epoch_us + activation.previous_end_us,
        );
        last_exchange::note(&request);
        let reply = plant::exchange(&request);
        match self.exchange.accept(&PINS, reply.as_ref()) {
            Freshness::Fresh | Freshness::Stale => Ok(()),
            Freshness::Lost => Err(SafeReason::BodyLost),
        }
    }

    fn feed_watchdog(&mut self) {
        C::feed_watchdog();
    }

    #[cfg(feature = "links")]
    fn link(&mut self, index: usize) -> Option<&mut dyn LinkDevice> {
        let device = self.frames.as_mut().filter(|_| index == 0)?;
        Some(device)
    }

    fn motors_off(&mut self) {
        PINS.safe();
    }
}
