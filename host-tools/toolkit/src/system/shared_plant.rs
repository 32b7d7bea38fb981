//! One plant for several processors: each has some of the body's pins, and its own clock.
//!
//! A processor reads the plant as it was at an activation's nominal start, and what it leaves at
//! its pins takes effect at the nominal end. Others may look at the plant between the two. So a
//! processor [announces](Behind::announce) what it has left as soon as its activation is
//! over, and whoever lets the plant's time pass puts all that in the order of its times.

use std::cell::RefCell;
use std::rc::Rc;

use rt_firmware::body::{Actuators, Reply, Request, Sensors};

use super::declaration::Pins;
use crate::host_run::Behind;
use crate::medium::PS_IN_US;
use crate::medium::clock::{Clock, Life};
use crate::plant::Plant;
use crate::plant::behind_pins::BehindPins;

/// What a processor has left at its pins.
#[derive(Clone, Copy, Default)]
struct Left {
    /// When it takes effect, in microseconds of plant time.
    effect_us: u64,
    actuators: Actuators,
    is_applied: bool,
}

struct Shared {
    plant: Plant,
    /// The levels that all processors together have set. Triggers are none.
    levels: Actuators,
    /// Of each processor.
    left: Vec<Left>,
    /// When each is reset, in microseconds of plant time, until it is.
    resets_us: Vec<Option<u64>>,
    /// Whether each is there: what one that was reset says has no effect.
    is_there: Vec<bool>,
    has: Vec<Vec<Pins>>,
    stop_pressed_from_us: Option<u64>,
}

impl Shared {
    /// Lets plant time pass, with all that takes effect until then.
    fn advance_to(&mut self, time_us: u64) {
        while let Some((at_us, index)) = (self.resets_us.iter().enumerate())
            .filter_map(|(index, at_us)| Some(((*at_us)?, index)))
            .filter(|(at_us, _)| *at_us <= time_us)
            .min()
        {
            self.put_until(at_us.saturating_sub(1));
            self.plant.advance_to(at_us);
            // Its pins are let go of, and nothing drives.
            self.apply(index, Actuators::default());
            if let Some(left) = self.left.get_mut(index) {
                left.is_applied = true;
            }
            if let Some(is_there) = self.is_there.get_mut(index) {
                *is_there = false;
            }
            if let Some(reset_us) = self.resets_us.get_mut(index) {
                *reset_us = None;
            }
        }
        self.put_until(time_us);
        self.plant.advance_to(time_us);
    }

    /// Puts all that takes effect until then.
    fn put_until(&mut self, time_us: u64) {
        loop {
            let due = (self.left.iter().enumerate())
                .filter(|(_, left)| !left.is_applied && left.effect_us <= time_us);
            let next = due.min_by_key(|(index, left)| (left.effect_us, *index));
            let Some((index, left)) = next.map(|(index, left)| (index, *left)) else {
                break;
            };
            self.plant.advance_to(left.effect_us);
            self.apply(index, left.actuators);
            if let Some(left) = self.left.get_mut(index) {
                left.is_applied = true;
            }
        }
    }

    fn apply(&mut self, index: usize, actuators: Actuators) {
        let has = self.has.get(index).map_or(&[][..], Vec::as_slice);
        let mut now = self.levels;
        if has.contains(&Pins::Motors) {
            now.left_duty = actuators.left_duty;
            now.right_duty = actuators.right_duty;
        }
        if has.contains(&Pins::Outputs) {
            now.aux_outputs = actuators.aux_outputs;
        }
        self.levels = now;
        if has.contains(&Pins::Sonars) {
            now.sonar_triggers = actuators.sonar_triggers;
            now.array_triggers = actuators.array_triggers;
        }
        self.plant.apply(&now);
    }

    fn sensors(&self, index: usize, start_us: u64) -> Sensors {
        let all = self.plant.sensors();
        let mut sensors = Sensors {
            stop_is_low: self
                .stop_pressed_from_us
                .is_some_and(|from_us| start_us >= from_us),
            ..Sensors::default()
        };
        for pins in self.has.get(index).map_or(&[][..], Vec::as_slice) {
            match pins {
                Pins::Encoders => {
                    sensors.left_count = all.left_count;
                    sensors.right_count = all.right_count;
                }
                Pins::Sonars => {
                    sensors.echo_us = all.echo_us;
                    sensors.echo_high = all.echo_high;
                }
                Pins::Analog => sensors.adc_counts = all.adc_counts,
                Pins::Gyro => sensors.yaw_counts = all.yaw_counts,
                Pins::Bumpers => sensors.bumper_is_low = all.bumper_is_low,
                Pins::Motors | Pins::Outputs => {}
            }
        }
        sensors
    }
}

/// A plant that processors share.
#[derive(Clone)]
pub struct SharedPlant(Rc<RefCell<Shared>>);

impl SharedPlant {
    /// A plant whose emergency stop is pressed from a plant time on, if one is given.
    #[must_use]
    pub fn new(plant: Plant, stop_pressed_from_us: Option<u64>) -> Self {
        SharedPlant(Rc::new(RefCell::new(Shared {
            plant,
            levels: Actuators::default(),
            left: Vec::new(),
            resets_us: Vec::new(),
            is_there: Vec::new(),
            has: Vec::new(),
            stop_pressed_from_us,
        })))
    }

    /// The pins of one more processor, or of one that was reset, with its clock and when it is
    /// there.
    #[must_use]
    pub fn pins(&self, has: &[Pins], life: Life) -> ProcessorPins {
        let Life { clock, to_ps, .. } = life;
        let mut shared = self.0.borrow_mut();
        shared.has.push(has.to_vec());
        let is_reset = to_ps < u64::MAX;
        shared.resets_us.push(is_reset.then_some(to_ps / PS_IN_US));
        shared.is_there.push(true);
        shared.left.push(Left {
            is_applied: true,
            ..Left::default()
        });
        ProcessorPins {
            shared: Rc::clone(&self.0),
            index: shared.left.len() - 1,
            clock,
        }
    }

    /// The plant at a time of interest, which no processor is beyond.
    #[must_use]
    pub fn at(&self, plant_us: u64) -> Plant {
        let mut shared = self.0.borrow_mut();
        shared.advance_to(plant_us);
        shared.plant.clone()
    }
}

/// What is behind the pins of one processor.
pub struct ProcessorPins {
    shared: Rc<RefCell<Shared>>,
    index: usize,
    clock: Clock,
}

impl ProcessorPins {
    fn plant_us(&self, local_us: u64) -> u64 {
        self.clock.plant_ps(local_us) / PS_IN_US
    }
}

impl BehindPins for ProcessorPins {
    fn exchange(&mut self, request: &Request) -> Reply {
        let effect_us = self.plant_us(request.effect_us);
        let start_us = self.plant_us(request.start_us);
        let mut shared = self.shared.borrow_mut();
        let mut actuators = request.actuators;
        if shared.is_there.get(self.index) != Some(&true) {
            return Reply {
                sequence: request.sequence,
                sensors: shared.sensors(self.index, start_us),
            };
        }
        if let Some(left) = shared.left.get_mut(self.index) {
            if left.is_applied && left.effect_us == effect_us {
                // It was announced, and its pings are on their way.
                actuators.sonar_triggers &= !left.actuators.sonar_triggers;
                actuators.array_triggers &= !left.actuators.array_triggers;
            }
            *left = Left {
                effect_us,
                actuators,
                is_applied: false,
            };
        }
        shared.advance_to(start_us);
        Reply {
            sequence: request.sequence,
            sensors: shared.sensors(self.index, start_us),
        }
    }
}

impl Behind for ProcessorPins {
    fn look<T>(&self, at: impl FnOnce(&Plant) -> T) -> T {
        at(&self.shared.borrow().plant)
    }

    fn at_end(&self) -> Plant {
        self.shared.borrow().plant.clone()
    }

    fn announce(&mut self, effect_us: u64, actuators: &Actuators) {
        let effect_us = self.plant_us(effect_us);
        let mut shared = self.shared.borrow_mut();
        if shared.is_there.get(self.index) != Some(&true) {
            return;
        }
        if let Some(left) = shared.left.get_mut(self.index) {
            *left = Left {
                effect_us,
                actuators: *actuators,
                is_applied: false,
            };
        }
    }
}
