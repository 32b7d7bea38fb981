//! The board's life: link, timer, background, in turn.

use esm_link::message::Mode;
use rt_firmware::body::PinImage;
use rt_firmware::frames::LinkDevice;
use rt_firmware::{LinkPort, LinkSide, RealTime, Sides, StopListener};

use super::body::{Body, Outputs, RecordedEnds};
use crate::plant::behind_pins::BehindPins;

/// Steps of background tasks between two slots. One that needs more goes on after the slot, as on a
/// real board.
const BACKGROUND_STEPS: u32 = 10_000;

/// The byte link of a host board.
pub trait HostPort: LinkPort {
    /// The board's clock says this.
    fn set_clock(&mut self, now_us: u64);

    /// Whether it takes a byte to be sent.
    fn has_room(&self) -> bool;

    /// Whether a stop was heard since this was asked last.
    fn has_heard_stop(&mut self) -> bool;

    /// When the next bytes are swapped by the board's virtual time, where they are.
    fn swaps_at_us(&self) -> Option<u64> {
        None
    }

    /// Swaps bytes with the client at `at_us` of the board's virtual time.
    fn swap(&mut self, at_us: u64) {
        let _ = at_us;
    }
}

/// A host board that is switched on.
pub struct HostLife<'p, 'q, 'm, P> {
    real_time: RealTime<'q, 'm>,
    link: LinkSide<'q, 'm>,
    body: Body<'p, 'q, 'm, P>,
    /// When the next slot begins, by the board's clock.
    due_us: u64,
}

impl<'p, 'q, 'm, P: BehindPins> HostLife<'p, 'q, 'm, P> {
    /// A board of these sides of a runtime, with `plant` behind its pins. Runs of background tasks
    /// end where `ends` says, if it is given.
    pub fn new(
        (real_time, background, link): Sides<'q, 'm>,
        pins: &'p PinImage,
        plant: P,
        ends: Option<RecordedEnds>,
    ) -> Self {
        HostLife {
            real_time,
            link,
            body: Body::new(pins, plant, background, ends),
            due_us: 0,
        }
    }

    /// Gives the links of its missions devices, in their order; without any, they lead nowhere.
    pub fn connect(&mut self, links: Vec<Box<dyn LinkDevice>>) {
        self.body.connect(links);
    }

    /// Hears stops among the bytes of the line.
    pub fn stop_listener(&self) -> StopListener<'m> {
        self.link.stop_listener()
    }

    /// Starts the mission that the board has kept, if it has. To be called once, before all else.
    pub fn start(&mut self, port: &mut impl HostPort) {
        self.link.start(port);
    }

    /// Whether it has no mission.
    pub fn is_empty(&self) -> bool {
        self.real_time.mode() == Mode::Empty
    }

    /// Whether the link waits for an answer of the real-time side.
    pub fn is_asked(&self) -> bool {
        self.link.is_waiting()
    }

    /// Robot time at which the next slot begins; 0 as long as there is none.
    pub fn next_robot_us(&self) -> u64 {
        self.body.robot_us_at(self.due_us)
    }

    /// What the last activation has left at its pins.
    pub fn outputs(&self) -> Option<Outputs> {
        self.body.outputs()
    }

    /// What is behind its pins.
    pub fn plant(&mut self) -> &mut P {
        self.body.plant()
    }

    /// Lets the link take what has come, and send what there is to be said. No time passes.
    pub fn serve(&mut self, port: &mut impl HostPort) {
        if port.has_heard_stop() {
            // As on a real board, ahead of whatever the link is at.
            self.activate();
        }
        port.set_clock(self.body.now_us());
        while self.link.poll(port) && port.has_room() {}
    }

    /// Lets the real-time side take what the link has for it, and go on from there: before the time
    /// of a gate, since what is asked for at a macro step's time waits for the next.
    pub fn activate(&mut self) {
        self.due_us = self.real_time.on_timer(&mut self.body);
    }

    /// Lets the real-time side answer the link while time stands still.
    pub fn answer(&mut self) {
        self.real_time.on_timer(&mut self.body);
    }

    /// Lets time pass up to what comes next: bytes of the line, or a slot with the background
    /// behind it. As on a real board, the slots come first.
    pub fn pass(&mut self, port: &mut impl HostPort) {
        if let Some(swap_us) = (port.swaps_at_us()).filter(|swap_us| *swap_us < self.due_us) {
            self.body.pass_time_to(swap_us);
            port.swap(swap_us);
            return;
        }
        self.body.pass_time_to(self.due_us);
        self.activate();
        self.body.run_background(BACKGROUND_STEPS);
    }
}
