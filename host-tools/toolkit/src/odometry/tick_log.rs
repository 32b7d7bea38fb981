//! Tick logs: tables with the columns `t_us,left,right`, a row each time that somebody has looked
//! at the counters of both encoders.
//!
//! Counters wrap, and a table does not say where. A row is taken for the shortest way from the row
//! before: a wheel turns by less than half of its counter's range between two rows. How wide the
//! counters are is the least of 16, 32 and 64 bits that all values of both columns fit in, signed
//! or unsigned. A log of a wider counter whose values all fit in 16 bits has the same ways under
//! either width, unless a wheel turned by 32,768 ticks from one row to the next.
//!
//! Lines are taken one by one, and none is kept: the way is worked out for each width that is still
//! possible.

use super::arc::{ArcPose, wrapped_deg};
use crate::table::{self, Columns, RowError};

/// The columns of a tick log.
const COLUMNS: [&str; 3] = ["t_us", "left", "right"];

/// The measures that turn ticks into a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measures {
    /// Ticks of an encoder for one turn of its wheel.
    pub ticks_per_rev: f64,
    /// Radius of the wheels, in millimetres.
    pub wheel_radius_mm: f64,
    /// Distance between the wheels, in millimetres.
    pub base_mm: f64,
}

impl Measures {
    /// Way of a wheel's rim for one tick.
    pub fn mm_per_tick(&self) -> f64 {
        std::f64::consts::TAU * self.wheel_radius_mm / self.ticks_per_rev
    }
}

/// How wide the counters of a log are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CounterWidth {
    /// 16 bits.
    Bits16,
    /// 32 bits.
    Bits32,
    /// 64 bits.
    Bits64,
}

impl CounterWidth {
    /// All of them, narrow ones first.
    pub const ALL: [Self; 3] = [Self::Bits16, Self::Bits32, Self::Bits64];

    /// The width in bits.
    pub fn bits(self) -> u32 {
        match self {
            Self::Bits16 => 16,
            Self::Bits32 => 32,
            Self::Bits64 => 64,
        }
    }

    /// Ticks from one count to another, the shorter way round.
    fn ticks(self, from: i64, to: i64) -> i64 {
        let ticks = to.wrapping_sub(from);
        match self {
            Self::Bits16 => i64::from(ticks as i16),
            Self::Bits32 => i64::from(ticks as i32),
            Self::Bits64 => ticks,
        }
    }
}

/// The least and the greatest count of a wheel.
#[derive(Clone, Copy, Debug)]
struct Span {
    least: i64,
    most: i64,
}

impl Span {
    fn with(self, count: i64) -> Self {
        Self {
            least: self.least.min(count),
            most: self.most.max(count),
        }
    }

    /// Whether a counter of that width has all of it, counting from zero or around it.
    fn fits(self, width: CounterWidth) -> bool {
        let Some(range) = 1_i64.checked_shl(width.bits()).filter(|range| *range > 1) else {
            return true;
        };
        let is_unsigned = self.least >= 0 && self.most < range;
        let is_signed = self.least >= -range / 2 && self.most < range / 2;
        is_unsigned || is_signed
    }
}

/// The way so far, if counters have one width.
#[derive(Clone, Copy, Debug)]
struct Way {
    width: CounterWidth,
    pose: ArcPose,
    /// What each wheel has turned, forwards less backwards. Sums of whole numbers lose nothing.
    ticks: [i128; 2],
    /// The most that a wheel turned between two rows, and where.
    fastest: Fastest,
}

/// The longest way of a wheel from one row to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Fastest {
    /// How far, whichever way.
    pub ticks: u64,
    /// The line of the second row, from 1.
    pub line: u64,
}

/// A tick log that is being read.
#[derive(Clone, Debug)]
pub struct TickLog {
    measures: Measures,
    /// What the counters' width was said to be.
    given: Option<CounterWidth>,
    columns: Option<Columns<3>>,
    lines: u64,
    rows: u64,
    spans: [Span; 2],
    counts: [i64; 2],
    ways: Vec<Way>,
}

/// Where a log ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reckoned {
    /// Ahead of the start, in millimetres.
    pub x_mm: f64,
    /// To the left of the start, in millimetres.
    pub y_mm: f64,
    /// Heading, counter-clockwise from the start's, above -180 and up to 180.
    pub theta_deg: f64,
    /// The way of the robot's centre, forwards less backwards.
    pub distance_mm: f64,
    /// All that it has turned, counter-clockwise positive.
    pub rotation_deg: f64,
    /// Rows of the log.
    pub rows: u64,
    /// The width that the counters were taken to have.
    pub counter_width: CounterWidth,
    /// The longest way of a wheel from one row to the next.
    pub fastest: Fastest,
}

/// What is wrong with a line of a log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// It is no row of the table.
    #[error(transparent)]
    Row(#[from] RowError),
    /// A field is no number.
    #[error("{column} is `{found}`: expected a number")]
    NoNumber {
        /// The column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
    /// The first line is neither a row nor names of columns.
    #[error(
        "`{found}` is neither a number nor the name of a column: a log begins with a row, or with `t_us,left,right`"
    )]
    NoBeginning {
        /// What stands there.
        found: String,
    },
    /// A count is not whole.
    #[error("{column} is `{found}`: expected a whole number, for a counter counts ticks")]
    Broken {
        /// The column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
    /// A count is beyond all counters.
    #[error("{column} is `{found}`: expected a count that fits in 64 bits with a sign")]
    TooLarge {
        /// The column.
        column: &'static str,
        /// What stands there.
        found: String,
    },
    /// A count does not fit into the counter that the log is said to be of.
    #[error(
        "{column} is {count}, with counts from {least} to {most} so far: no counter of {bits} bits has both; name a wider one, or none"
    )]
    TooWide {
        /// The column.
        column: &'static str,
        /// What stands there.
        count: i64,
        /// The least count so far.
        least: i64,
        /// The greatest count so far.
        most: i64,
        /// The width.
        bits: u32,
    },
}

/// The log has no rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there are no rows: a log has a line `t_us,left,right` for each look at the counters")]
pub struct NoRows;

impl TickLog {
    /// A log of which nothing was read, of a robot with these measures, and with counters of a
    /// width if it is known.
    pub fn new(measures: Measures, counter_width: Option<CounterWidth>) -> Self {
        let possible = CounterWidth::ALL.into_iter();
        let possible = possible.filter(|width| counter_width.is_none_or(|given| given == *width));
        Self {
            measures,
            given: counter_width,
            columns: None,
            lines: 0,
            rows: 0,
            spans: [Span { least: 0, most: 0 }; 2],
            counts: [0; 2],
            ways: possible.map(Way::new).collect(),
        }
    }

    /// Lines that were read so far: the number of the last one.
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// Takes the next line.
    ///
    /// # Errors
    /// [`LineError`]; then the log is of no use any more.
    pub fn line(&mut self, line: &[u8]) -> Result<(), LineError> {
        self.lines += 1;
        let line = table::text(line)?;
        if line.is_empty() {
            return Ok(());
        }
        let is_first = self.columns.is_none();
        let columns = match self.columns {
            Some(columns) => columns,
            None => *(self.columns).insert(Columns::of_first_line(line, COLUMNS)?),
        };
        if is_first && columns.are_named() {
            return Ok(());
        }
        let [time, left, right] = columns.fields(line)?;
        if !time.parse::<f64>().is_ok_and(f64::is_finite) {
            let found = time.to_owned();
            return Err(match is_first {
                true => LineError::NoBeginning { found },
                false => LineError::NoNumber {
                    column: COLUMNS[0],
                    found,
                },
            });
        }
        self.row([count(COLUMNS[1], left)?, count(COLUMNS[2], right)?])
    }

    /// Takes the next row.
    fn row(&mut self, counts: [i64; 2]) -> Result<(), LineError> {
        for ((span, count), column) in self.spans.iter_mut().zip(counts).zip(&COLUMNS[1..]) {
            *span = match self.rows {
                0 => Span {
                    least: count,
                    most: count,
                },
                _ => span.with(count),
            };
            if let Some(width) = self.given
                && !span.fits(width)
            {
                return Err(LineError::TooWide {
                    column,
                    count,
                    least: span.least,
                    most: span.most,
                    bits: width.bits(),
                });
            }
        }
        let spans = self.spans;
        (self.ways).retain(|way| spans.iter().all(|span| span.fits(way.width)));
        if self.rows > 0 {
            for way in &mut self.ways {
                way.go(self.counts, counts, &self.measures, self.lines);
            }
        }
        self.counts = counts;
        self.rows += 1;
        Ok(())
    }

    /// Where the log ends, when all lines were taken.
    ///
    /// # Errors
    /// [`NoRows`]
    pub fn end(&self) -> Result<Reckoned, NoRows> {
        // All values fit in 64 bits, so that there is always a way.
        let way = self.ways.first().filter(|_| self.rows > 0).ok_or(NoRows)?;
        let [left, right] = way.ticks.map(|ticks| ticks as f64);
        let mm_per_tick = self.measures.mm_per_tick();
        let turn_rad = (right - left) * (mm_per_tick / self.measures.base_mm);
        let rotation_deg = turn_rad.to_degrees();
        Ok(Reckoned {
            x_mm: way.pose.x_mm,
            y_mm: way.pose.y_mm,
            theta_deg: wrapped_deg(rotation_deg),
            distance_mm: (left + right) / 2.0 * mm_per_tick,
            rotation_deg,
            rows: self.rows,
            counter_width: way.width,
            fastest: way.fastest,
        })
    }
}

impl Way {
    fn new(width: CounterWidth) -> Self {
        Self {
            width,
            pose: ArcPose::default(),
            ticks: [0; 2],
            fastest: Fastest::default(),
        }
    }

    /// Goes on from a row to the next one, in that line.
    fn go(&mut self, from: [i64; 2], to: [i64; 2], measures: &Measures, line: u64) {
        let [left, right] = [0, 1].map(|wheel| self.width.ticks(from[wheel], to[wheel]));
        let fastest = left.unsigned_abs().max(right.unsigned_abs());
        if fastest > self.fastest.ticks {
            self.fastest = Fastest {
                ticks: fastest,
                line,
            };
        }
        self.ticks[0] += i128::from(left);
        self.ticks[1] += i128::from(right);
        let mm_per_tick = measures.mm_per_tick();
        let [left_mm, right_mm] = [left, right].map(|ticks| ticks as f64 * mm_per_tick);
        self.pose = self.pose.rolled(left_mm, right_mm, measures.base_mm);
        // The heading from whole sums, so that roundings do not add up.
        let turned = (self.ticks[1] - self.ticks[0]) as f64;
        self.pose.heading_rad = turned * (mm_per_tick / measures.base_mm);
    }
}

/// A count, as a whole number or as a decimal whose fraction is zero.
fn count(column: &'static str, text: &str) -> Result<i64, LineError> {
    /// Beyond it, neighbouring whole numbers are one in `f64`.
    const MOST_EXACT: f64 = 9_007_199_254_740_992.0;
    if let Ok(count) = text.parse() {
        return Ok(count);
    }
    let found = || text.to_owned();
    match text.parse::<f64>() {
        Ok(count) if count.is_nan() => Err(LineError::NoNumber {
            column,
            found: found(),
        }),
        Ok(count) if count.abs() > MOST_EXACT => Err(LineError::TooLarge {
            column,
            found: found(),
        }),
        Ok(count) if libm::rint(count) != count => Err(LineError::Broken {
            column,
            found: found(),
        }),
        Ok(count) => Ok(count as i64),
        Err(_) => Err(LineError::NoNumber {
            column,
            found: found(),
        }),
    }
}

#[cfg(test)]
mod tests;
