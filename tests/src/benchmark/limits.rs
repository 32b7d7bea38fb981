//! What has been promised of a figure, and whether it holds.

use std::fmt;

use crate::benchmark::table::{Table, number};

/// A promise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// No more than this.
    AtMost(f64),
    /// No less than this.
    AtLeast(f64),
}

impl Bound {
    /// Whether a figure keeps to it.
    pub fn holds(self, figure: f64) -> bool {
        match self {
            Bound::AtMost(bound) => figure <= bound,
            Bound::AtLeast(bound) => figure >= bound,
        }
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (words, bound) = match self {
            Bound::AtMost(bound) => ("at most", bound),
            Bound::AtLeast(bound) => ("at least", bound),
        };
        // A promise is a round number.
        let bound = number(Some(*bound));
        write!(to, "{words} {}", bound.strip_suffix(".0").unwrap_or(&bound))
    }
}

/// A figure that something was promised of.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// What is measured, in which unit.
    pub what: String,
    /// What was promised.
    pub bound: Bound,
    /// What was measured; none if it could not be.
    pub figure: Option<f64>,
}

impl Promise {
    /// Whether it holds. What was not measured does not.
    pub fn holds(&self) -> bool {
        self.figure.is_some_and(|figure| self.bound.holds(figure))
    }
}

/// How many do not hold.
pub fn broken(promises: &[Promise]) -> usize {
    promises.iter().filter(|promise| !promise.holds()).count()
}

/// The promises and what came of them.
pub fn table(promises: &[Promise]) -> Table {
    let row = |promise: &Promise| {
        let kept = match promise.figure {
            None => "not measured",
            Some(_) if promise.holds() => "yes",
            Some(_) => "**no**",
        };
        vec![
            promise.what.clone(),
            number(promise.figure),
            promise.bound.to_string(),
            kept.to_owned(),
        ]
    };
    Table {
        title: "What is promised".to_owned(),
        note: "`cargo xtask bench --gate` ends with status 1 if one of these does not hold."
            .to_owned(),
        head: ["figure", "measured", "promised", "holds"]
            .map(str::to_owned)
            .to_vec(),
        rows: promises.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn promise(bound: Bound, figure: Option<f64>) -> Promise {
        Promise {
            what: "it".to_owned(),
            bound,
            figure,
        }
    }

    #[test]
    fn a_bound_itself_holds_and_what_was_not_measured_does_not() {
        for (bound, figure, holds) in [
            (Bound::AtMost(12.0), Some(12.0), true),
            (Bound::AtMost(12.0), Some(12.1), false),
            (Bound::AtMost(12.0), Some(-1.0), true),
            (Bound::AtMost(12.0), None, false),
            (Bound::AtLeast(12.0), Some(12.0), true),
            (Bound::AtLeast(12.0), Some(11.9), false),
            (Bound::AtLeast(12.0), None, false),
            (Bound::AtMost(12.0), Some(f64::NAN), false),
            (Bound::AtLeast(12.0), Some(f64::NAN), false),
        ] {
            assert_eq!(promise(bound, figure).holds(), holds, "{bound}: {figure:?}");
        }
    }

    #[test]
    fn each_broken_promise_counts_and_is_told() {
        let promises = [
            promise(Bound::AtMost(280.0), Some(279.5)),
            promise(Bound::AtMost(6_144.0), Some(8_052.0)),
            promise(Bound::AtLeast(10.0), None),
        ];
        assert_eq!(broken(&promises), 2);
        let rows = table(&promises).rows;
        assert_eq!(rows[0], ["it", "279.5", "at most 280", "yes"]);
        assert_eq!(rows[1], ["it", "8,052", "at most 6,144", "**no**"]);
        assert_eq!(rows[2], ["it", "–", "at least 10", "not measured"]);
    }
}
