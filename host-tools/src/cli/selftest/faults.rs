//! Faults that can be planted in a simulated robot, to see that they are found.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::nearest::nearest;
use crate::plant::{SonarFault, WiringFault};

/// How slow a slow crystal is, in millionths: a ceramic resonator in a crystal's place is off by so
/// much.
pub const SLOW_PPM: f64 = -3_000.0;

/// A fault to plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Something is wired wrongly.
    Wiring(WiringFault),
    /// A sonar is broken.
    Sonar(usize, SonarFault),
    /// The robot's clock is slow.
    SlowCrystal,
    /// A sector of the flash, in which records are, takes nothing.
    BadFlashSector,
    /// A sector of the flash, in which missions are, takes nothing.
    BadMissionSector,
    /// The battery is nearly empty.
    LowBattery,
    /// The line spoils bytes.
    NoisyLine,
}

/// The sonars that break: one ahead, to the left, and one behind, to the right.
const DEAD_SONAR: usize = 1;
const STUCK_SONAR: usize = 5;

/// A fault that can be planted: its name, and the row of the report that must find it.
#[derive(Clone, Copy, Debug)]
pub struct Plantable {
    /// Its name.
    pub name: &'static str,
    /// What is planted.
    pub fault: Fault,
    /// The row that does not pass with it.
    pub found_by: &'static str,
}

/// All of them.
pub const ALL: &[Plantable] = &[
    of(
        "left-encoder-backwards",
        Fault::Wiring(WiringFault::LeftEncoderBackwards),
        "encoders.left",
    ),
    of(
        "right-encoder-backwards",
        Fault::Wiring(WiringFault::RightEncoderBackwards),
        "encoders.right",
    ),
    of(
        "encoders-exchanged",
        Fault::Wiring(WiringFault::EncodersExchanged),
        "encoders.sides",
    ),
    of(
        "left-motor-backwards",
        Fault::Wiring(WiringFault::LeftMotorBackwards),
        "motors.left",
    ),
    of(
        "right-motor-backwards",
        Fault::Wiring(WiringFault::RightMotorBackwards),
        "motors.right",
    ),
    of(
        "motors-exchanged",
        Fault::Wiring(WiringFault::MotorsExchanged),
        "motors.sides",
    ),
    of(
        "dead-sonar",
        Fault::Sonar(DEAD_SONAR, SonarFault::Dead),
        "sonars.1",
    ),
    of(
        "stuck-sonar",
        Fault::Sonar(STUCK_SONAR, SonarFault::Blind),
        "sonars.5",
    ),
    of("slow-crystal", Fault::SlowCrystal, "clock"),
    of("bad-flash-sector", Fault::BadFlashSector, "flash.record"),
    of("low-battery", Fault::LowBattery, "battery"),
    of("noisy-line", Fault::NoisyLine, "line.bad_frames"),
    of(
        "left-encoder-dead",
        Fault::Wiring(WiringFault::LeftEncoderDead),
        "encoders.left",
    ),
    of(
        "right-encoder-dead",
        Fault::Wiring(WiringFault::RightEncoderDead),
        "encoders.right",
    ),
    of(
        "left-motor-dead",
        Fault::Wiring(WiringFault::LeftMotorDead),
        "motors.left",
    ),
    of(
        "right-motor-dead",
        Fault::Wiring(WiringFault::RightMotorDead),
        "motors.right",
    ),
    of(
        "battery-input-dead",
        Fault::Wiring(WiringFault::BatteryInputDead),
        "battery",
    ),
    of(
        "gyroscope-dead",
        Fault::Wiring(WiringFault::GyroDead),
        "gyroscope",
    ),
    of(
        "bad-mission-sector",
        Fault::BadMissionSector,
        "flash.mission",
    ),
];

const fn of(name: &'static str, fault: Fault, found_by: &'static str) -> Plantable {
    Plantable {
        name,
        fault,
        found_by,
    }
}

/// Why a text is no fault.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error(
    "there is no fault `{name}`{}; the faults are {}",
    meant(name),
    names()
)]
pub struct UnknownFault {
    name: String,
}

fn meant(name: &str) -> String {
    let near = nearest(name, ALL.iter().map(|it| it.name));
    near.map_or_else(String::new, |near| format!(", is `{near}` meant?"))
}

fn names() -> String {
    let names: Vec<&str> = ALL.iter().map(|it| it.name).collect();
    names.join(", ")
}

impl FromStr for Fault {
    type Err = UnknownFault;

    fn from_str(name: &str) -> Result<Self, UnknownFault> {
        let known = ALL.iter().find(|it| it.name == name);
        known.map(|it| it.fault).ok_or_else(|| UnknownFault {
            name: name.to_owned(),
        })
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = ALL.iter().find(|it| it.fault == *self);
        f.write_str(known.map_or("", |it| it.name))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn each_fault_has_a_name_of_its_own_and_is_read_from_it() {
        let names: BTreeSet<&str> = ALL.iter().map(|it| it.name).collect();
        assert_eq!(names.len(), ALL.len());
        for known in ALL {
            assert_eq!(known.name.parse(), Ok(known.fault));
            assert_eq!(known.fault.to_string(), known.name);
        }
        let Err(unknown) = "dead-sonars".parse::<Fault>() else {
            panic!("there is such a fault");
        };
        assert!(unknown.to_string().contains("`dead-sonar` meant"));
    }
}
