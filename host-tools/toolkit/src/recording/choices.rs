//! What a machine had to choose from in a macro step: the transitions that lead from its current
//! states, each with its guard, evaluated term by term, in each micro step.

/// A transition that leads from a current state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Path of its source.
    pub from: String,
    /// Path of its target.
    pub to: String,
    /// The event that it is taken on; `pulse` also for `*`.
    pub event: String,
    /// Whether that is the event of the micro step, and is heard here.
    pub is_heard: bool,
    /// Its guard as in the source, if it has one.
    pub guard: Option<String>,
    /// The flags in it, each with its value.
    pub terms: Vec<(String, bool)>,
    /// Whether the guard is true of these values.
    pub holds: bool,
    /// Whether it was taken.
    pub is_taken: bool,
}

/// A micro step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MicroStep {
    /// Its event.
    pub event: String,
    /// What there was to choose from before it, region by region.
    pub choices: Vec<Choice>,
}

/// A macro step.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choices {
    /// Number of the stretch of the recording.
    pub stretch: usize,
    /// Number of the macro step in its mission.
    pub step: u64,
    /// Nominal time of it, in microseconds since the first macro step of the first mission.
    pub t_us: u64,
    /// Its micro steps, in order; those behind a fault are not there.
    pub micro_steps: Vec<MicroStep>,
}
