//! What is asked of a diagram.

use std::collections::BTreeSet;

/// What a diagram shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// This container alone; else the machine, or where there is none, all containers.
    pub container: Option<String>,
    /// Levels of superstates whose inside is shown; else all.
    pub depth: Option<u32>,
    /// Superstates of which that is not so: their inside is hidden where others of their level show
    /// it, and shown where others hide it. Paths from the container that stands on the sheet.
    pub otherwise: BTreeSet<String>,
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
            otherwise: BTreeSet::new(),
            data: true,
            legend: false,
            notes: false,
            parts: false,
        }
    }
}

/// Which superstates in a container show their inside.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Shown {
    /// Levels of them that do.
    levels: u32,
    /// Those that do so otherwise, in order: paths from this container.
    otherwise: Vec<String>,
}

impl Shown {
    pub(super) fn new(levels: u32, otherwise: &BTreeSet<String>) -> Self {
        Shown {
            levels,
            otherwise: otherwise.iter().cloned().collect(),
        }
    }

    pub(super) fn levels(&self) -> u32 {
        self.levels
    }

    /// Whether the levels alone say it.
    pub(super) fn is_plain(&self) -> bool {
        self.otherwise.is_empty()
    }

    /// What is shown in a superstate, where that shows its inside.
    pub(super) fn inside(&self, region: &str, state: &str) -> Option<Shown> {
        if self.is_plain() {
            let levels = self.levels.checked_sub(1)?;
            return Some(Shown {
                levels,
                otherwise: Vec::new(),
            });
        }
        let path = format!("{region}/{state}");
        let is_otherwise = self.otherwise.contains(&path);
        if (self.levels > 0) == is_otherwise {
            return None;
        }
        let below = format!("{path}/");
        let inner = self
            .otherwise
            .iter()
            .filter_map(|it| it.strip_prefix(&below));
        Some(Shown {
            levels: self.levels.saturating_sub(1),
            otherwise: inner.map(str::to_owned).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_superstate_shows_its_inside_as_its_level_says_or_otherwise() {
        let shown = |levels, paths: &[&str]| {
            let otherwise = paths.iter().map(|path| (*path).to_owned()).collect();
            Shown::new(levels, &otherwise)
        };
        assert_eq!(shown(0, &[]).inside("r", "A"), None);
        assert_eq!(shown(2, &[]).inside("r", "A"), Some(shown(1, &[])));
        assert_eq!(shown(2, &["r/A"]).inside("r", "A"), None);
        assert_eq!(shown(0, &["r/A"]).inside("r", "A"), Some(shown(0, &[])));
        let inner = shown(1, &["r/A/s/B", "r/B", "r/AB/s/C"]);
        assert_eq!(inner.inside("r", "A"), Some(shown(0, &["s/B"])));
        assert_eq!(inner.inside("r", "B"), None);
    }
}
