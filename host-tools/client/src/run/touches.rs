//! The touches of a run, as its summary tells them.

use std::fmt;

use serde::Serialize;

use esm_toolkit::plant::{Plant, Touch, Touched};

/// A touch of a wall or a person, and whether it could have been avoided.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TouchSummary {
    /// Robot time, in seconds.
    pub at_s: f64,
    /// Where the robot's centre was, to the right, in metres.
    pub x_m: f64,
    /// The same, upwards.
    pub y_m: f64,
    /// What was touched: `wall`, `low` or `person`.
    pub touched: &'static str,
    /// The person's line of the world's file, from 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<usize>,
    /// How fast the robot was, in metres per second.
    pub speed_m_per_s: f64,
    /// Since when what was touched had been there, in seconds of robot time.
    pub there_from_s: f64,
    /// What was free along the robot's movement when a person stepped in, up to that person, in
    /// metres; left out where that person was not in the way, and of what had been there from the
    /// start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_m: Option<f64>,
    /// What the robot needed then to react and to brake, in metres; left out of what had been there
    /// from the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub needed_m: Option<f64>,
    /// Whether a robot that obeys its stop distance could have avoided it.
    pub avoidable: bool,
}

impl TouchSummary {
    /// Those of a plant.
    pub fn all_of(plant: &Plant) -> Vec<Self> {
        let touches = plant.statistics().touches().iter();
        touches.map(Self::of).collect()
    }

    fn of(touch: &Touch) -> Self {
        let (touched, line) = match touch.touched {
            Touched::Wall => ("wall", None),
            Touched::Low => ("low", None),
            Touched::Person { line } => ("person", Some(line)),
        };
        let encounter = touch.encounter;
        TouchSummary {
            at_s: touch.t_us as f64 / 1e6,
            x_m: touch.place.x_m,
            y_m: touch.place.y_m,
            touched,
            line,
            speed_m_per_s: touch.speed_m_per_s,
            there_from_s: encounter.map_or(0.0, |it| it.t_us as f64 / 1e6),
            free_m: encounter.and_then(|it| it.free_m),
            needed_m: encounter.map(|it| it.needed_m),
            avoidable: touch.avoidable,
        }
    }
}

impl fmt::Display for TouchSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TouchSummary {
            at_s,
            x_m,
            y_m,
            speed_m_per_s,
            ..
        } = self;
        let touched = match (self.line, self.touched) {
            (Some(line), _) => format!("the person of line {line}"),
            (None, "low") => "something low".to_owned(),
            (None, _) => "a wall".to_owned(),
        };
        write!(
            f,
            "{touched} at {at_s:.3} s, {x_m:.2},{y_m:.2}, {speed_m_per_s:.2} m/s"
        )?;
        if let Some(needed_m) = self.needed_m {
            let there_from_s = self.there_from_s;
            write!(f, "; stepped in at {there_from_s:.3} s, ")?;
            match self.free_m {
                Some(free_m) => write!(f, "{free_m:.3} m free, {needed_m:.3} m needed")?,
                None => f.write_str("out of the way")?,
            }
        }
        f.write_str(match self.avoidable {
            true => ": avoidable",
            false => ": not avoidable",
        })
    }
}
