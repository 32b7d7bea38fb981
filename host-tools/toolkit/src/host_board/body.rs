//! What the host board gives its runtime: virtual time, the plant, and the background's turn.

use std::collections::VecDeque;

use esm_link::frames::receiver::InFrames;
use esm_link::frames::wire::{Header, MAX_PAYLOAD_BYTES};
use esm_link::message::SafeReason;
use rt_firmware::body::{Actuators, Freshness, PinImage, PlantExchange, StopPin};
use rt_firmware::drivers::StopButton;
use rt_firmware::frames::{LINKS, LinkDevice, Taken};
use rt_firmware::{ActivationStart, Background, Board};

use crate::plant::behind_pins::BehindPins;
use crate::recording::entered::Entered;

/// Where runs of background tasks ended in an earlier run: mission and activation, in order.
pub struct RecordedEnds(VecDeque<(u32, u64)>);

impl RecordedEnds {
    /// Those of a run.
    pub fn of(entered: &Entered) -> Self {
        let ends = entered.ends.iter();
        RecordedEnds(ends.map(|end| (end.mission, end.activation)).collect())
    }
}

/// What an activation has left at the pins, before the next one tells the plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outputs {
    /// Index of its slot in the blob of the mission that runs.
    pub slot: usize,
    /// Its nominal start, in microseconds of robot time.
    pub start_us: u64,
    /// The pins.
    pub actuators: Actuators,
}

/// Time, pins and background of a host board. A tick of its clock is a microsecond.
pub struct Body<'p, 'q, 'm, P> {
    now_us: u64,
    /// The board's time when robot time was 0; known from the first activation on.
    robot_start_us: Option<u64>,
    pins: &'p PinImage,
    stop_button: StopButton<StopPin<'p>>,
    exchange: PlantExchange,
    plant: P,
    background: Background<'q, 'm>,
    ends: Option<RecordedEnds>,
    /// Missions that have started.
    missions: u32,
    /// Slot and start of the last activation.
    last: Option<(usize, u64)>,
    /// What carries the frames of links.
    links: Vec<Box<dyn LinkDevice>>,
}

impl<'p, 'q, 'm, P> Body<'p, 'q, 'm, P> {
    /// A body before its first activation.
    pub fn new(
        pins: &'p PinImage,
        plant: P,
        background: Background<'q, 'm>,
        ends: Option<RecordedEnds>,
    ) -> Self {
        Body {
            now_us: 0,
            robot_start_us: None,
            pins,
            stop_button: StopButton::new(pins.stop_button()),
            exchange: PlantExchange::new(),
            plant,
            background,
            ends,
            missions: 0,
            last: None,
            links: Vec::new(),
        }
    }

    /// What the last activation has left at the pins.
    pub fn outputs(&self) -> Option<Outputs> {
        self.last.map(|(slot, start_us)| Outputs {
            slot,
            start_us,
            actuators: self.pins.actuators(),
        })
    }

    /// Gives links devices, in their order; without any, they lead nowhere.
    pub fn connect(&mut self, links: Vec<Box<dyn LinkDevice>>) {
        self.links = links;
    }

    /// Robot time at a time of the board's clock; 0 as long as there is none.
    pub fn robot_us_at(&self, board_us: u64) -> u64 {
        self.robot_start_us
            .map_or(0, |start_us| board_us.saturating_sub(start_us))
    }

    /// What is behind the pins.
    pub fn plant(&mut self) -> &mut P {
        &mut self.plant
    }

    /// The board's time.
    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    /// Lets virtual time pass.
    pub fn pass_time_to(&mut self, board_us: u64) {
        self.now_us = self.now_us.max(board_us);
    }

    /// Gives background tasks the time that is left before the next slot, unless a recording says
    /// when they end.
    pub fn run_background(&mut self, steps: u32) {
        if self.ends.is_none() {
            for _ in 0..steps {
                if !self.background.poll() {
                    break;
                }
            }
        }
    }

    /// Ends the run that ended before this activation in the recording.
    fn end_recorded_run(&mut self, activation: u64) {
        let Some(RecordedEnds(ends)) = &mut self.ends else {
            return;
        };
        let Some(mission) = self.missions.checked_sub(1) else {
            return;
        };
        while ends
            .front()
            .is_some_and(|end| *end <= (mission, activation))
        {
            ends.pop_front();
            while self.background.poll() {}
        }
    }
}

impl<P: BehindPins> Board for Body<'_, '_, '_, P> {
    const TICKS_PER_US: u32 = 1;

    fn now_ticks(&mut self) -> u64 {
        self.now_us
    }

    fn begin_activation(&mut self, activation: &ActivationStart) -> Result<(), SafeReason> {
        let ActivationStart {
            slot,
            number,
            start_us,
            previous_end_us,
            ..
        } = *activation;
        self.robot_start_us
            .get_or_insert(self.now_us.saturating_sub(start_us));
        if number == 0 {
            self.missions += 1;
        }
        self.last = Some((slot, start_us));
        let request = self.exchange.request(self.pins, start_us, previous_end_us);
        let reply = self.plant.exchange(&request);
        self.end_recorded_run(number);
        match self.exchange.accept(self.pins, Some(&reply.encode())) {
            Freshness::Fresh | Freshness::Stale => Ok(()),
            Freshness::Lost => Err(SafeReason::BodyLost),
        }
    }

    fn is_emergency_stop_pressed(&mut self) -> bool {
        let Body {
            stop_button,
            now_us,
            ..
        } = self;
        stop_button.is_pressed(|| *now_us as u32, Self::TICKS_PER_US)
    }

    fn link(&mut self, index: usize) -> Option<&mut dyn LinkDevice> {
        while self.links.len() <= index && index < LINKS {
            self.links.push(Box::new(OpenLine));
        }
        self.links
            .get_mut(index)
            .map(|link| &mut **link as &mut dyn LinkDevice)
    }

    fn motors_off(&mut self) {
        self.pins.safe();
    }
}

/// A line with nobody at its other end: what is sent is gone, and nothing comes.
#[derive(Clone, Copy, Debug)]
pub struct OpenLine;

impl LinkDevice for OpenLine {
    fn send(
        &mut self,
        _start_us: u64,
        _header: Header,
        payload_bytes: usize,
        write: &mut dyn FnMut(&mut [u8]),
    ) -> bool {
        let mut payload = [0; MAX_PAYLOAD_BYTES];
        if let Some(payload) = payload.get_mut(..payload_bytes) {
            write(payload);
        }
        true
    }

    fn receive(&mut self, _until_us: u64, _frames: &dyn InFrames, _take: Taken<'_>) {}
}
