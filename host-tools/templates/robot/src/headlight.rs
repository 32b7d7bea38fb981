//! The task of the headlight: light where something is near.

use embedded_hal::digital::OutputPin;
use esm::rt_firmware::tasks::Ranges;
use esm::rt_firmware::{Io, Step, Task, task};

use crate::lamp::Lamp;

/// The light goes out only where the way is free by this factor more than what lit it, so that it
/// does not flicker.
const RELEASE_FACTOR: f32 = 1.25;

/// Lights the lamp while something is nearer than `near_m` ahead; `lit` tells the mission so.
#[derive(Debug)]
pub struct Headlight<P> {
    lamp: Lamp<P>,
}

task! {
    /// Lights the lamp while something is near ahead, or nobody knows whether something is.
    impl[P: OutputPin + Send] Headlight<P> {
        slot 2;
        wcet 100 us;
        endless;
        data {
            /// What is around the robot. Five periods of the sonars' slot.
            in ranges: Ranges optional within 200 ms;
        }
        flags {
            /// The lamp is lit.
            out lit;
        }
        params {
            /// How near is near, in metres from the rim.
            near_m: f32 = 0.6, 0.1..=2.0;
        }
    }
}

impl<P: OutputPin> Headlight<P> {
    /// The task with its lamp.
    pub fn new(lamp: Lamp<P>) -> Self {
        Self { lamp }
    }
}

impl<P: OutputPin + Send> Task for Headlight<P> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let near_m = io.param(Self::NEAR_M);
        let limit_m = if self.lamp.is_lit() {
            near_m * RELEASE_FACTOR
        } else {
            near_m
        };
        // Who does not know what is ahead has the light on.
        let ranges = io.try_read(Self::RANGES).unwrap_or(&Ranges::NONE);
        let near = ranges.ahead_m() < limit_m;
        // A pin that does not answer leaves the lamp as it is, and the flag says what it is.
        let _ = self.lamp.set(near);
        io.set(Self::LIT, self.lamp.is_lit());
        Step::Run
    }
}
