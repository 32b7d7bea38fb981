//! One number of a selftest.

use serde::Serialize;

/// What is smaller is shown by its magnitude: three digits behind the point would show nothing.
const SHOWN_IN_FULL: f64 = 0.000_5;

/// A number that was measured, held against its limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is: a group, a dot, and what in it. It stays the same from version to version.
    pub name: String,
    /// What was measured; none where nothing was.
    pub value: Option<f64>,
    /// Its unit, which is empty for numbers and shares.
    pub unit: &'static str,
    /// What it is to be, in words.
    pub limit: String,
    /// Whether it is so; none where nothing was measured.
    pub pass: Option<bool>,
    /// What to do where it is not so, or why nothing was measured.
    pub advice: Option<String>,
}

impl Finding {
    /// A number and whether it is within its limit; what to do where it is not.
    pub fn judged(
        name: impl Into<String>,
        (value, unit): (f64, &'static str),
        limit: impl Into<String>,
        pass: bool,
        advice: impl Into<String>,
    ) -> Self {
        Finding {
            name: name.into(),
            value: value.is_finite().then_some(value),
            unit,
            limit: limit.into(),
            pass: Some(pass),
            advice: (!pass).then(|| advice.into()),
        }
    }

    /// What is not as it should be, and has no number.
    pub fn failed(
        name: impl Into<String>,
        limit: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Finding::judged(name, (f64::NAN, ""), limit, false, advice)
    }

    /// What was not measured, and why.
    pub fn not_measured(name: impl Into<String>, why: impl Into<String>) -> Self {
        Finding {
            name: name.into(),
            value: None,
            unit: "",
            limit: String::new(),
            pass: None,
            advice: Some(why.into()),
        }
    }

    /// The number as a person reads it.
    pub fn value_text(&self) -> String {
        let Some(value) = self.value else {
            return "-".to_owned();
        };
        let is_whole = libm::floor(value) == value;
        let digits = match value.abs() {
            _ if is_whole => 0,
            below if below < 10.0 => 3,
            below if below < 100.0 => 1,
            _ => 0,
        };
        if value != 0.0 && value.abs() < SHOWN_IN_FULL {
            return format!("{value:.0e} {}", self.unit).trim_end().to_owned();
        }
        let space = if self.unit.is_empty() { "" } else { " " };
        format!("{value:.digits$}{space}{}", self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_is_given_where_it_is_needed() {
        let good = Finding::judged("a.b", (1.0, "V"), "above 0", true, "charge it");
        assert_eq!((good.pass, good.advice), (Some(true), None));
        let bad = Finding::judged("a.b", (-1.0, "V"), "above 0", false, "charge it");
        assert_eq!(bad.pass, Some(false));
        assert_eq!(bad.advice.as_deref(), Some("charge it"));
        let failed = Finding::failed("a.c", "it answers", "plug it in");
        assert_eq!((failed.value, failed.pass), (None, Some(false)));
    }

    #[test]
    fn numbers_have_as_many_digits_as_say_something() {
        for (value, text) in [
            (0.0, "0 V"),
            (3.0, "3 V"),
            (0.98765, "0.988 V"),
            (-2.5, "-2.500 V"),
            (12.34, "12.3 V"),
            (10_000.4, "10000 V"),
            (-0.000_18, "-2e-4 V"),
        ] {
            let finding = Finding::judged("a", (value, "V"), "", true, "");
            assert_eq!(finding.value_text(), text);
        }
        assert_eq!(Finding::not_measured("a", "no task").value_text(), "-");
    }
}
