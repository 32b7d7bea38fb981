//! What a system file says.

use crate::medium::chance::Chance;
use crate::medium::clock::{Clock, Life};
use crate::medium::{Cut, PS_IN_US};
use crate::model::Span;

/// Greatest number of processors.
pub const MAX_PROCESSORS: usize = 16;
/// Greatest number of links.
pub const MAX_LINKS: usize = 64;

/// Greatest number of resets of a processor.
pub const MAX_RESETS: usize = 8;

/// A word or a text, and where it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// Without quotes.
    pub text: String,
    /// Where.
    pub span: Span,
}

/// Pins of the robot's body that go to one processor together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Pins {
    /// The motors of both wheels.
    Motors,
    /// The encoders of both wheels.
    Encoders,
    /// Triggers and echoes of all sonars.
    Sonars,
    /// The analogue inputs: battery, contact, current, floor.
    Analog,
    /// The gyroscope.
    Gyro,
    /// The switches of both bumpers.
    Bumpers,
    /// The auxiliary outputs.
    Outputs,
}

impl Pins {
    /// All of them, as a file names them.
    pub const ALL: [(&'static str, Pins); 7] = [
        ("motors", Pins::Motors),
        ("encoders", Pins::Encoders),
        ("sonars", Pins::Sonars),
        ("analog", Pins::Analog),
        ("gyro", Pins::Gyro),
        ("bumpers", Pins::Bumpers),
        ("outputs", Pins::Outputs),
    ];
}

/// A processor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Processor {
    /// Its name.
    pub name: Named,
    /// The file of its mission.
    pub mission: Named,
    /// The board that it is; the host board where none is named.
    pub board: Option<Named>,
    /// What it has of the body. All processors hear the button of the emergency stop.
    pub pins: Vec<Pins>,
    /// By how much its clock gains on plant time, in billionths.
    pub drift_ppb: i32,
    /// Plant time at which its mission starts, in microseconds.
    pub start_us: u64,
    /// When it is in reset, by plant time, one behind the other. Behind each its mission starts
    /// anew.
    pub resets: Vec<Cut>,
}

impl Processor {
    /// From when to when it is there, between two resets: its clock begins anew each time.
    #[must_use]
    pub fn lives(&self) -> Vec<Life> {
        let mut life = Life::whole(Clock::new(self.start_us * PS_IN_US, self.drift_ppb));
        let mut lives = Vec::new();
        for reset in &self.resets {
            lives.push(Life {
                to_ps: reset.from_ps,
                ..life
            });
            life = Life {
                clock: Clock::new(reset.to_ps, self.drift_ppb),
                from_ps: reset.to_ps,
                to_ps: u64::MAX,
            };
        }
        lives.push(life);
        lives
    }
}

/// What a link's frames cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Medium {
    /// A serial line.
    Line,
    /// Memory that both processors share.
    Memory,
    /// A CAN bus.
    Can,
}

impl Medium {
    /// All of them.
    pub const ALL: [Medium; 3] = [Medium::Line, Medium::Memory, Medium::Can];

    /// As a file names it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Medium::Line => "line",
            Medium::Memory => "memory",
            Medium::Can => "can",
        }
    }
}

/// One end of a link.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    /// Index of its processor.
    pub processor: usize,
    /// The name of the link in the processor's mission.
    pub link: String,
    /// Where `PROCESSOR.LINK` stands.
    pub span: Span,
}

/// What lies between a link of one mission and a link of another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// The first one that is named, and the other.
    pub ends: [End; 2],
    /// What it is made of.
    pub medium: Medium,
    /// From one end to the other, in microseconds.
    pub delay_us: u64,
    /// How probable it is that a bit is another one.
    pub noise: Chance,
    /// How probable it is that a frame is lost.
    pub loss: Chance,
    /// How probable it is that a byte is lost.
    pub byte_loss: Chance,
    /// When it is cut.
    pub cuts: Vec<Cut>,
}

/// A system.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct System {
    /// The world around the robot; where none is named, whoever runs the system says it.
    pub world: Option<Named>,
    /// The processors, in the file's order.
    pub processors: Vec<Processor>,
    /// The links, in the file's order.
    pub links: Vec<Link>,
}
