//! The plant as it stands behind a board's pins: what becomes of an exchange, and what happens to
//! the robot's body that its world knows nothing of.

use rt_firmware::body::{Reply, Request};

use super::drive::WheelSide;
use super::recorded::RecordedRanges;
use super::sonar::SonarFault;
use super::{Plant, WiringFault};

/// What is behind the pins of a board that has none of its own.
pub trait BehindPins {
    /// One exchange: what the board sets at its pins, for what it finds there.
    fn exchange(&mut self, request: &Request) -> Reply;
}

/// A sonar that breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SonarBreak {
    /// Which one, counter-clockwise from the one that looks ahead.
    pub sonar: usize,
    /// What breaks in it.
    pub fault: SonarFault,
    /// From this robot time on, in microseconds.
    pub robot_us: u64,
}

/// A wheel that something holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StuckWheel {
    /// Which one.
    pub side: WheelSide,
    /// From this robot time on, in microseconds.
    pub robot_us: u64,
}

/// What happens to the robot's body that its world knows nothing of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlantFault {
    /// From this robot time on, in microseconds, the plant answers every exchange with its last
    /// answer before.
    FrozenFrom {
        /// Robot time in microseconds.
        robot_us: u64,
    },
    /// From this robot time on the button of the emergency stop is pressed: it locks, as such
    /// buttons do.
    StopPressedFrom {
        /// Robot time in microseconds.
        robot_us: u64,
    },
}

/// A plant, what is to happen to it, and how it was at the end of the time of interest.
pub struct PlantBehindPins {
    plant: Plant,
    fault: Option<PlantFault>,
    /// Sonars that are still to break.
    breaks: Vec<SonarBreak>,
    /// Wheels that are still to be held.
    stuck: Vec<StuckWheel>,
    last_reply: Reply,
    until_us: Option<u64>,
    /// Exchanges up to `until_us`.
    exchanges: u64,
    /// The plant as it was when robot time reached `until_us`.
    at_end: Option<Box<Plant>>,
}

impl PlantBehindPins {
    /// A plant before its first exchange. Robot time is of interest up to `until_us`.
    pub fn new(plant: Plant, until_us: Option<u64>) -> Self {
        PlantBehindPins {
            plant,
            fault: None,
            breaks: Vec::new(),
            stuck: Vec::new(),
            last_reply: Reply::default(),
            until_us,
            exchanges: 0,
            at_end: None,
        }
    }

    /// Lets this happen to the plant.
    pub fn inject(&mut self, fault: PlantFault) {
        self.fault = Some(fault);
    }

    /// Breaks these sonars, each at its time.
    pub fn break_sonars(&mut self, breaks: Vec<SonarBreak>) {
        self.breaks = breaks;
    }

    /// Wires something of the body as it should not be.
    pub fn miswire(&mut self, fault: WiringFault) {
        self.plant.miswire(fault);
    }

    /// Lets something hold these wheels, each from its time on.
    pub fn stick_wheels(&mut self, stuck: Vec<StuckWheel>) {
        self.stuck = stuck;
    }

    /// Lets the sonars measure what was recorded. Where that ends, the time of interest does,
    /// unless it ends before.
    pub fn measure_from(&mut self, ranges: RecordedRanges) {
        self.plant.measure_from(ranges);
    }

    /// Robot time up to which there is interest, in microseconds, as far as that is known: set
    /// before robot time reaches it.
    pub fn until_us(&self) -> Option<u64> {
        self.until_us
    }

    /// Presses the button of the emergency stop from the next exchange on, or lets go of it.
    pub fn press_stop(&mut self, pressed: bool) {
        self.fault = pressed.then_some(PlantFault::StopPressedFrom { robot_us: 0 });
    }

    /// The plant as it is.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The plant at the end of the time of interest, or as it is where that has not come yet.
    pub fn at_end(&self) -> Plant {
        match &self.at_end {
            Some(plant) => (**plant).clone(),
            None => self.plant.clone(),
        }
    }

    /// Exchanges in the time of interest: the slot activations that were executed, one each.
    pub fn exchanges(&self) -> u64 {
        self.exchanges
    }
}

impl BehindPins for PlantBehindPins {
    fn exchange(&mut self, request: &Request) -> Reply {
        if let Some(until_us) = self.until_us
            && request.start_us > until_us
            && self.at_end.is_none()
        {
            let mut plant = self.plant.clone();
            if request.effect_us <= until_us {
                plant.advance_to(request.effect_us);
                plant.apply(&request.actuators);
            }
            plant.advance_to(until_us);
            self.at_end = Some(Box::new(plant));
        }
        if self.at_end.is_none() {
            self.exchanges += 1;
        }
        if let Some(PlantFault::FrozenFrom { robot_us }) = self.fault
            && request.start_us >= robot_us
        {
            return self.last_reply;
        }
        let (now, later): (Vec<_>, Vec<_>) = (self.breaks.drain(..))
            .partition(|sonar_break| request.start_us >= sonar_break.robot_us);
        self.breaks = later;
        for SonarBreak { sonar, fault, .. } in now {
            self.plant.break_sonar(sonar, fault);
        }
        for StuckWheel { side, .. } in
            (self.stuck.iter()).filter(|stuck| request.start_us >= stuck.robot_us)
        {
            self.plant.stick_wheel(*side);
        }
        self.last_reply = self.plant.exchange(request);
        let ends_us = (self.until_us.into_iter()).chain(self.plant.recorded_end_us());
        self.until_us = ends_us.min();
        if let Some(PlantFault::StopPressedFrom { robot_us }) = self.fault {
            self.last_reply.sensors.stop_is_low = request.start_us >= robot_us;
        }
        self.last_reply
    }
}
