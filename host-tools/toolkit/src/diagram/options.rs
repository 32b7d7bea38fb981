//! What is asked of a diagram.

/// What a diagram shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// This container alone; else the machine, or where there is none, all containers.
    pub container: Option<String>,
    /// Levels of superstates whose inside is shown; else all.
    pub depth: Option<u32>,
    /// Whether data ports and data paths are shown.
    pub data: bool,
    /// Whether the meaning of the symbols stands below.
    pub legend: bool,
    /// Whether what the `///` lines say stands below.
    pub notes: bool,
    /// Whether states and transitions are parts of the picture that a page finds again.
    pub parts: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            container: None,
            depth: None,
            data: true,
            legend: false,
            notes: false,
            parts: false,
        }
    }
}
