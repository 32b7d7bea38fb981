//! The plant as a board and an onlooker share it: the board exchanges pins with it, the onlooker
//! asks how the drive went.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rt_firmware::body::{Reply, Request, SONARS};

use super::in_system::BoardSide;
use super::pace::Pace;
use crate::flash::Flash;
use esm_toolkit::plant::behind_pins::{BehindPins, PlantBehindPins};
pub use esm_toolkit::plant::behind_pins::{PlantFault, SonarBreak, StuckWheel};
use esm_toolkit::plant::{Plant, Pulse, RecordedRanges, WiringFault};

/// A plant behind a board's pins, shared by the thread that answers the board and the one that
/// watches.
#[derive(Clone)]
pub struct PlantSide {
    shared: Arc<Mutex<PlantBehindPins>>,
    pace: Arc<Pace>,
    flash: Option<Flash>,
    /// Who has the body instead, where several boards share one.
    system: Option<Arc<BoardSide>>,
}

impl PlantSide {
    /// Puts `plant` at the pace of `pace`. Robot time is of interest up to `until_us`.
    pub fn new(plant: Plant, pace: Arc<Pace>, until_us: Option<u64>) -> Self {
        PlantSide {
            shared: Arc::new(Mutex::new(PlantBehindPins::new(plant, until_us))),
            pace,
            flash: None,
            system: None,
        }
    }

    /// A board of a system, whose body is not here.
    #[must_use]
    pub fn in_system(self, system: Option<Arc<BoardSide>>) -> Self {
        PlantSide { system, ..self }
    }

    /// Who answers a board of a system.
    pub fn system(&self) -> Option<Arc<BoardSide>> {
        self.system.clone()
    }

    /// The same plant, with this flash beside it.
    #[must_use]
    pub fn with_flash(self, flash: Option<Flash>) -> Self {
        PlantSide { flash, ..self }
    }

    /// The flash beside it: the one that it was given, or a blank one of so many bytes.
    pub fn flash(&self, bytes: u32) -> Flash {
        self.flash.clone().unwrap_or_else(|| Flash::blank(bytes))
    }

    /// Lets this happen to the plant.
    pub fn inject(&self, fault: PlantFault) {
        self.lock().inject(fault);
    }

    /// Breaks these sonars, each at its time.
    pub fn break_sonars(&self, breaks: Vec<SonarBreak>) {
        self.lock().break_sonars(breaks);
    }

    /// Wires something of the body as it should not be.
    pub fn miswire(&self, fault: WiringFault) {
        self.lock().miswire(fault);
    }

    /// How far the wheels have turned forwards since the start, left and right, in radians.
    pub fn wheels_turned_rad(&self) -> [f64; 2] {
        self.lock().plant().wheels_turned_rad()
    }

    /// Lets something hold these wheels, each from its time on.
    pub fn stick_wheels(&self, stuck: Vec<StuckWheel>) {
        self.lock().stick_wheels(stuck);
    }

    /// Lets the sonars measure what was recorded. Where that ends, the time of interest does,
    /// unless it ends before.
    pub fn measure_from(&self, ranges: RecordedRanges) {
        self.lock().measure_from(ranges);
    }

    /// Robot time up to which there is interest, in microseconds, as far as that is known: set
    /// before robot time reaches it.
    pub fn until_us(&self) -> Option<u64> {
        self.lock().until_us()
    }

    /// Presses the button of the emergency stop from the next exchange on, or lets go of it.
    pub fn press_stop(&self, pressed: bool) {
        self.lock().press_stop(pressed);
    }

    /// One exchange with the board; waits first where robot time must not run ahead of the wall
    /// clock.
    pub fn exchange(&self, request: &Request) -> Reply {
        self.pace.reach(request.start_us);
        if let Some(system) = &self.system {
            return system.exchange(request);
        }
        self.lock().exchange(request)
    }

    /// What the sonars answer to their last triggers.
    pub fn pulses(&self) -> [Option<Pulse>; SONARS] {
        self.lock().plant().pulses()
    }

    /// The plant at the end of the time of interest, or as it is where that has not come yet.
    pub fn at_end(&self) -> Plant {
        self.lock().at_end()
    }

    /// Exchanges in the time of interest: the slot activations that were executed, one each.
    pub fn exchanges(&self) -> u64 {
        self.lock().exchanges()
    }

    /// The clock that this plant keeps.
    pub fn pace(&self) -> &Arc<Pace> {
        &self.pace
    }

    /// A thread that panicked while it held the lock has left a plant between two of its steps,
    /// which still is one.
    fn lock(&self) -> MutexGuard<'_, PlantBehindPins> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl BehindPins for PlantSide {
    fn exchange(&mut self, request: &Request) -> Reply {
        PlantSide::exchange(self, request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_toolkit::plant::BodyParameters;
    use esm_toolkit::world::World;
    use rt_firmware::body::{Actuators, Sensors};

    fn corridor(until_us: Option<u64>) -> PlantSide {
        let world =
            World::parse("world cell\n start 1,1 0\n wall 0,0 9,0 9,3 0,3 0,0").expect("a world");
        let plant = Plant::new(world, BodyParameters::default(), 1).expect("room to stand");
        PlantSide::new(plant, Pace::new(false), until_us)
    }

    fn request(sequence: u32, start_us: u64) -> Request {
        Request {
            sequence,
            start_us,
            effect_us: start_us.saturating_sub(9_000),
            actuators: Actuators {
                left_duty: 400,
                right_duty: 400,
                ..Actuators::default()
            },
        }
    }

    #[test]
    fn the_end_of_interest_is_kept_while_the_plant_goes_on() {
        let ends_in_time = corridor(None);
        let goes_on = corridor(Some(1_000_000));
        for sequence in 0..=100 {
            ends_in_time.exchange(&request(sequence, u64::from(sequence) * 10_000));
        }
        for sequence in 0..300 {
            goes_on.exchange(&request(sequence, u64::from(sequence) * 10_000));
        }
        let expected = ends_in_time.at_end();
        let kept = goes_on.at_end();
        assert_eq!(kept.now_us(), 1_000_000);
        assert_eq!(kept.pose(), expected.pose());
        assert!(kept.distance_m() > 0.0);
        assert_eq!(goes_on.pace().robot_us(), 2_990_000);
    }

    #[test]
    fn the_time_of_interest_ends_a_row_after_recorded_ranges() {
        for (asked_us, end_us) in [
            (None, Some(120_000)),
            (Some(90_000), Some(90_000)),
            (Some(900_000), Some(120_000)),
        ] {
            let plant = corridor(asked_us);
            plant.measure_from(RecordedRanges::parse("1,1\n2,2").expect("a table"));
            for sequence in 0..8 {
                let mut request = request(sequence, u64::from(sequence) * 40_000);
                request.effect_us = request.start_us;
                request.actuators.sonar_triggers = 0b11;
                plant.exchange(&request);
                let known = if sequence < 2 { asked_us } else { end_us };
                assert_eq!(plant.until_us(), known, "after {sequence}");
            }
        }
    }

    #[test]
    fn a_frozen_plant_repeats_its_last_answer() {
        let plant = corridor(None);
        plant.inject(PlantFault::FrozenFrom { robot_us: 20_000 });
        let replies: Vec<u32> = (0..5)
            .map(|sequence| {
                plant
                    .exchange(&request(sequence, u64::from(sequence) * 10_000))
                    .sequence
            })
            .collect();
        assert_eq!(replies, [0, 1, 1, 1, 1]);
    }

    #[test]
    fn a_button_that_is_pressed_stays_pressed_and_changes_nothing_else() {
        let pressed = corridor(None);
        pressed.inject(PlantFault::StopPressedFrom { robot_us: 20_000 });
        let other = corridor(None);
        for sequence in 0..5 {
            let request = request(sequence, u64::from(sequence) * 10_000);
            let (told, expected) = (pressed.exchange(&request), other.exchange(&request));
            assert_eq!(told.sensors.stop_is_low, sequence >= 2);
            assert_eq!(
                Sensors {
                    stop_is_low: false,
                    ..told.sensors
                },
                expected.sensors
            );
        }
    }
}
