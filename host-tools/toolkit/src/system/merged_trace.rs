//! Traces of all processors as one: each line says whose it is, and when it was by plant time.

use std::io::{self, Write};

use serde::Deserialize;

use crate::medium::PS_IN_US;
use crate::medium::clock::Clock;

/// The trace of one processor.
pub struct ProcessorTrace<'t> {
    /// The processor's name.
    pub name: &'t str,
    /// Its clock.
    pub clock: Clock,
    /// Robot time of the first macro step of each mission that ran, in microseconds: from there
    /// the trace counts.
    pub starts_us: Vec<u64>,
    /// Its lines.
    pub lines: &'t str,
}

/// What all lines have.
#[derive(Deserialize)]
struct Line<'l> {
    kind: &'l str,
    step: u64,
    t_us: u64,
}

/// Why traces cannot be made one.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// A line is none of a trace.
    #[error("the trace of `{processor}` has a line that is none: {line}")]
    NotALine {
        /// Whose.
        processor: String,
        /// The line.
        line: String,
    },
    /// The trace cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// Writes all lines in the order of plant time; at one time in the order of the processors. Each
/// has `processor` and `plant_us` before what the processor's own trace has.
///
/// # Errors
/// [`MergeError`]
pub fn write(traces: &[ProcessorTrace<'_>], out: &mut impl Write) -> Result<(), MergeError> {
    let mut lines = Vec::new();
    for (index, trace) in traces.iter().enumerate() {
        let mut starts_us = trace.starts_us.iter();
        let mut start_us = starts_us.next();
        // The last macro step that was told of to its end.
        let mut told = None;
        for line in trace.lines.lines() {
            let read: Option<Line<'_>> = serde_json::from_str(line).ok();
            let parts = read.zip(line.strip_prefix('{'));
            // Each mission counts from 0.
            if let Some((Line { step, .. }, _)) = &parts
                && told.is_some_and(|told| *step <= told)
            {
                (start_us, told) = (starts_us.next(), None);
            }
            let (Some((Line { kind, step, t_us }, rest)), Some(start_us)) = (parts, start_us)
            else {
                return Err(MergeError::NotALine {
                    processor: trace.name.to_owned(),
                    line: line.to_owned(),
                });
            };
            if kind == "step" {
                told = Some(step);
            }
            let plant_us = trace.clock.plant_ps(start_us + t_us) / PS_IN_US;
            lines.push((plant_us, index, trace.name, rest));
        }
    }
    // Lines of one processor at one time stay in their order.
    lines.sort_by_key(|(plant_us, index, ..)| (*plant_us, *index));
    for (plant_us, _, name, rest) in lines {
        writeln!(
            out,
            "{{\"processor\":\"{name}\",\"plant_us\":{plant_us},{rest}"
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stand_in_the_order_of_plant_time() {
        let trace = |name, clock, starts_us: &[u64], lines| ProcessorTrace {
            name,
            clock,
            starts_us: starts_us.to_vec(),
            lines,
        };
        let line = |kind: &str, step: u64, t_us: u64| {
            format!("\"kind\":\"{kind}\",\"step\":{step},\"t_us\":{t_us}}}\n")
        };
        let lines = |all: &[(&str, u64, u64)]| -> String {
            let all = all.iter();
            all.map(|(kind, step, t_us)| format!("{{{}", line(kind, *step, *t_us)))
                .collect()
        };
        let base = lines(&[("step", 0, 0), ("step", 1, 20)]);
        // Another mission takes over, twice.
        let head = lines(&[
            ("transition", 0, 0),
            ("step", 0, 0),
            ("step", 0, 0),
            ("step", 1, 10),
            ("transition", 0, 0),
        ]);
        let later = Clock::new(20 * PS_IN_US, 0);
        let traces = [
            trace("base", Clock::new(0, 0), &[0], &base),
            trace("head", later, &[0, 5, 40], &head),
        ];
        let mut out = Vec::new();
        write(&traces, &mut out).unwrap();
        let expected: String = [
            ("base", 0, "step", 0, 0),
            ("base", 20, "step", 1, 20),
            ("head", 20, "transition", 0, 0),
            ("head", 20, "step", 0, 0),
            ("head", 25, "step", 0, 0),
            ("head", 35, "step", 1, 10),
            ("head", 60, "transition", 0, 0),
        ]
        .map(|(name, plant_us, kind, step, t_us)| {
            let rest = line(kind, step, t_us);
            format!("{{\"processor\":\"{name}\",\"plant_us\":{plant_us},{rest}")
        })
        .concat();
        assert_eq!(String::from_utf8(out).unwrap(), expected);
        let known = lines(&[("step", 0, 0), ("step", 0, 0)]);
        for wrong in ["[]", &known] {
            let wrong = [trace("base", Clock::new(0, 0), &[0], wrong)];
            assert!(write(&wrong, &mut Vec::new()).is_err());
        }
    }
}
