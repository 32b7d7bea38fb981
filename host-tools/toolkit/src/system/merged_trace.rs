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
    /// Robot time of the first macro step, in microseconds, from which the trace counts.
    pub start_us: u64,
    /// Its lines.
    pub lines: &'t str,
}

/// What all lines have.
#[derive(Deserialize)]
struct Line {
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
        for line in trace.lines.lines() {
            let read: Option<Line> = serde_json::from_str(line).ok();
            let parts = read.zip(line.strip_prefix('{'));
            let Some((Line { t_us }, rest)) = parts else {
                return Err(MergeError::NotALine {
                    processor: trace.name.to_owned(),
                    line: line.to_owned(),
                });
            };
            let plant_us = trace.clock.plant_ps(trace.start_us + t_us) / PS_IN_US;
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
        let trace = |name, clock, lines| ProcessorTrace {
            name,
            clock,
            start_us: 0,
            lines,
        };
        let base = "{\"kind\":\"step\",\"t_us\":0}\n{\"kind\":\"step\",\"t_us\":20}\n";
        let head = "{\"kind\":\"transition\",\"t_us\":0}\n{\"kind\":\"step\",\"t_us\":0}\n";
        let traces = [
            trace("base", Clock::new(0, 0), base),
            trace("head", Clock::new(20 * PS_IN_US, 0), head),
        ];
        let mut out = Vec::new();
        write(&traces, &mut out).unwrap();
        let expected = "{\"processor\":\"base\",\"plant_us\":0,\"kind\":\"step\",\"t_us\":0}\n\
            {\"processor\":\"base\",\"plant_us\":20,\"kind\":\"step\",\"t_us\":20}\n\
            {\"processor\":\"head\",\"plant_us\":20,\"kind\":\"transition\",\"t_us\":0}\n\
            {\"processor\":\"head\",\"plant_us\":20,\"kind\":\"step\",\"t_us\":0}\n";
        assert_eq!(String::from_utf8(out).unwrap(), expected);
        let wrong = [trace("base", Clock::new(0, 0), "[]")];
        assert!(write(&wrong, &mut Vec::new()).is_err());
    }
}
