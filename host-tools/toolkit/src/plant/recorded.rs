//! Ranges that a robot has recorded, as a table: a column a sonar, a row a period.

use thiserror::Error;

/// The longest range that a table may have, in metres: a robot's hall.
const MOST_M: f64 = 1_000.0;

/// Recorded ranges.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedRanges {
    sonars: usize,
    /// Row by row, in metres; none where a sonar did not answer.
    ranges_m: Vec<Option<f64>>,
}

/// Why a text is no table of ranges.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum TableError {
    /// There is no row.
    #[error("it has no ranges: write a row for each period, with a range in metres for each sonar")]
    Empty,
    /// A row has another number of columns than the first one.
    #[error(
        "line {line}: {columns} columns, where line {first_line} has {expected}: a row has a column for each sonar"
    )]
    Columns {
        /// The line, from 1.
        line: usize,
        /// How many it has.
        columns: usize,
        /// How many the first row has.
        expected: usize,
        /// The first row's line.
        first_line: usize,
    },
    /// What stands there is no range.
    #[error(
        "line {line}, column {column}: `{word}` is no range: write metres, as in 1.25, \
         or nothing where the sonar did not answer{}", if *line == 1 { "; the table has no line with names" } else { "" }
    )]
    Range {
        /// The line, from 1.
        line: usize,
        /// The column, from 1.
        column: usize,
        /// What stands there.
        word: String,
    },
}

impl RecordedRanges {
    /// The table in a text: numbers in metres, with commas between them. Lines without anything
    /// mean nothing. Where nothing stands between two commas, that sonar did not answer.
    ///
    /// # Errors
    /// [`TableError`]
    pub fn parse(text: &str) -> Result<Self, TableError> {
        const BYTE_ORDER_MARK: char = '\u{feff}';
        const LONGEST_WORD: usize = 40;
        let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
        let mut first: Option<(usize, usize)> = None;
        let mut ranges_m = Vec::new();
        for (line, row) in (1..).zip(text.lines()) {
            if row.trim().is_empty() {
                continue;
            }
            let before = ranges_m.len();
            for (column, word) in (1..).zip(row.split(',')) {
                let word = word.trim();
                let wrong = || TableError::Range {
                    line,
                    column,
                    word: word.chars().take(LONGEST_WORD).collect(),
                };
                let range_m = if word.is_empty() {
                    None
                } else {
                    let range_m: f64 = word.parse().map_err(|_| wrong())?;
                    if !(0.0..=MOST_M).contains(&range_m) {
                        return Err(wrong());
                    }
                    Some(range_m)
                };
                ranges_m.push(range_m);
            }
            let columns = ranges_m.len() - before;
            let (first_line, expected) = *first.get_or_insert((line, columns));
            if columns != expected {
                return Err(TableError::Columns {
                    line,
                    columns,
                    expected,
                    first_line,
                });
            }
        }
        match first {
            Some((_, sonars)) => Ok(Self { sonars, ranges_m }),
            None => Err(TableError::Empty),
        }
    }

    /// The same of a ring whose sonars look elsewhere: column *i* is the one at place `places[i]`.
    /// Where no column is, no sonar answers.
    #[must_use]
    pub fn at_places(&self, places: &[usize]) -> Self {
        let sonars = places.iter().max().map_or(1, |last| last + 1);
        let mut ranges_m = vec![None; self.rows() * sonars];
        for (from, to) in
            (self.ranges_m.chunks_exact(self.sonars)).zip(ranges_m.chunks_exact_mut(sonars))
        {
            for (range_m, place) in from.iter().zip(places) {
                to[*place] = *range_m;
            }
        }
        Self { sonars, ranges_m }
    }

    /// How many sonars it has ranges of: its columns.
    pub fn sonars(&self) -> usize {
        self.sonars
    }

    /// How many rows it has.
    pub fn rows(&self) -> usize {
        self.ranges_m.len() / self.sonars
    }

    /// What a sonar measured in a row; none where it did not answer, or neither is there.
    fn range_m(&self, row: usize, sonar: usize) -> Option<f64> {
        let row = self.ranges_m.chunks_exact(self.sonars).nth(row)?;
        row.get(sonar).copied().flatten()
    }
}

/// Recorded ranges on their way to the sonars. A row lasts until a sonar pings that has pinged in
/// it before.
#[derive(Clone, Debug)]
pub(super) struct Feed {
    ranges: RecordedRanges,
    row: usize,
    /// When the row began, in microseconds.
    began_us: u64,
    /// Bit *i* is set if sonar *i* has pinged in this row.
    pinged: u64,
    /// One row after the last row, in microseconds.
    end_us: Option<u64>,
}

impl Feed {
    pub fn new(ranges: RecordedRanges) -> Self {
        Self {
            ranges,
            row: 0,
            began_us: 0,
            pinged: 0,
            end_us: None,
        }
    }

    /// A sonar pings now. What it measures; behind the last row, what it measured there.
    pub fn ping(&mut self, sonar: usize, now_us: u64) -> Option<f64> {
        let bit = 1_u64.checked_shl(sonar as u32).unwrap_or(0);
        if self.pinged == 0 {
            self.began_us = now_us;
        } else if self.pinged & bit != 0 && self.began_us < now_us {
            self.pinged = 0;
            let lasted_us = now_us - self.began_us;
            self.began_us = now_us;
            if self.row + 1 < self.ranges.rows() {
                self.row += 1;
            } else {
                self.end_us.get_or_insert(now_us + lasted_us);
            }
        }
        self.pinged |= bit;
        self.ranges.range_m(self.row, sonar)
    }

    /// When it ends: one row after the last row, so that the robot has acted by it. None before
    /// the last row is over.
    pub fn end_us(&self) -> Option<u64> {
        self.end_us
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_rows_of_metres() {
        let ranges = RecordedRanges::parse("\u{feff}0.438, 5.000\r\n\n 1,\n").expect("a table");
        assert_eq!((ranges.sonars(), ranges.rows()), (2, 2));
        assert_eq!(ranges.range_m(0, 0), Some(0.438));
        assert_eq!(ranges.range_m(0, 1), Some(5.0));
        assert_eq!(ranges.range_m(1, 0), Some(1.0));
        assert_eq!(ranges.range_m(1, 1), None, "no answer");
        assert_eq!(ranges.range_m(2, 0), None);
    }

    #[test]
    fn columns_belong_to_the_sonars_of_the_robot() {
        let ranges = RecordedRanges::parse("1,2\n3,4").expect("a table");
        let ring = ranges.at_places(&[7, 1]);
        assert_eq!((ring.sonars(), ring.rows()), (8, 2));
        assert_eq!(
            [7, 1, 0].map(|sonar| ring.range_m(1, sonar)),
            [Some(3.0), Some(4.0), None]
        );
    }

    #[test]
    fn what_is_wrong_with_a_table_is_told_with_its_place() {
        let range = |line, column, word: &str| TableError::Range {
            line,
            column,
            word: word.to_owned(),
        };
        for (text, expected) in [
            ("", TableError::Empty),
            ("\n  \n", TableError::Empty),
            ("front,left\n1,2", range(1, 1, "front")),
            ("1,2\n1,-0.5", range(2, 2, "-0.5")),
            ("1,nan", range(1, 2, "nan")),
            ("1,inf", range(1, 2, "inf")),
            ("1;2", range(1, 1, "1;2")),
            (
                "1,2\n\n1,2,3",
                TableError::Columns {
                    line: 3,
                    columns: 3,
                    expected: 2,
                    first_line: 1,
                },
            ),
        ] {
            assert_eq!(RecordedRanges::parse(text), Err(expected), "{text:?}");
        }
    }

    #[test]
    fn each_sonar_measures_each_row_once_whenever_it_pings() {
        let ranges = RecordedRanges::parse("1,2\n3,4\n5,6").expect("a table");
        let mut feed = Feed::new(ranges);
        // In two windows of 40 ms, as a ring's sonars ping; then both at once.
        for (now_us, sonar, range_m, end_us) in [
            (40_000, 1, 2.0, None),
            (80_000, 0, 1.0, None),
            (120_000, 1, 4.0, None),
            (160_000, 0, 3.0, None),
            (200_000, 0, 5.0, None),
            (200_000, 1, 6.0, None),
            (260_000, 1, 6.0, Some(320_000)),
            (260_000, 0, 5.0, Some(320_000)),
            (300_000, 0, 5.0, Some(320_000)),
        ] {
            assert_eq!(feed.ping(sonar, now_us), Some(range_m), "at {now_us}");
            assert_eq!(feed.end_us(), end_us, "at {now_us}");
        }
    }
}
