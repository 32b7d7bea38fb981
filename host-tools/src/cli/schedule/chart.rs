//! The bar chart under the table: what each slot takes of each column's time, and what is free.

use std::fmt::Write;

use crate::pictures::axis::{self, Unit};
use crate::timetable::{Row, Timetable, gaps};

/// Rows that the chart has at most: of more slots those of one period share one.
pub const MAX_ROWS: usize = 24;

/// A terminal that is narrower gets lines that are longer than it.
const LEAST_COLUMNS: usize = 40;
/// No chart is wider.
const MOST_COLUMNS: usize = 160;
/// A shortest period has at least so many columns.
const COLUMNS_A_PERIOD: usize = 4;
/// Columns between two marks of the time axis, at least.
const COLUMNS_A_MARK: usize = 10;
/// From next to nothing to the whole column.
const EIGHTHS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// A row of the chart: what stands before it, and the indices of its slots.
pub type Lane = (String, Vec<usize>);

/// The chart of a schedule, as wide as a terminal of so many columns; empty without slots.
pub fn chart(timetable: &Timetable, columns: usize) -> String {
    let label = |row: &Row| match (row.slots.as_slice(), row.period_us) {
        ([slot], _) => format!(
            "slot {}",
            timetable.slots().get(*slot).map_or(0, |slot| slot.number)
        ),
        (slots, Some(period_us)) => format!("{} × {}", slots.len(), axis::time(period_us.into())),
        (slots, None) => format!("{} longer", slots.len()),
    };
    let rows = timetable.rows(MAX_ROWS).into_iter();
    let lanes: Vec<Lane> = rows.map(|row| (label(&row), row.slots)).collect();
    of_lanes(timetable, &lanes, Some("free"), columns)
}

/// The same with rows of the caller's, and a row for what all leave free where that has a name.
pub fn of_lanes(
    timetable: &Timetable,
    lanes: &[Lane],
    free: Option<&str>,
    columns: usize,
) -> String {
    if lanes.is_empty() {
        return String::new();
    }
    let labels = lanes.iter().map(|(label, _)| label.as_str());
    let label_width = labels
        .chain(free)
        .map(|label| label.chars().count())
        .fold(0, usize::max);
    let cells = columns
        .clamp(LEAST_COLUMNS, MOST_COLUMNS)
        .saturating_sub(label_width + 3)
        .max(COLUMNS_A_PERIOD);
    let window = timetable.window((cells / COLUMNS_A_PERIOD) as u64);
    // As many columns for each period.
    let periods = usize::try_from(window.length_us / timetable.frame_us().max(1))
        .unwrap_or(1)
        .max(1);
    let cells = (cells / periods).max(1) * periods;
    let activations = timetable.activations(window.start_us, window.end_us());
    let scale = Scale {
        from_us: window.start_us,
        length_us: window.length_us.max(1),
        cells,
    };
    let mut of_row = vec![0; timetable.slots().len()];
    for (place, (_, slots)) in lanes.iter().enumerate() {
        for &slot in slots {
            if let Some(of_row) = of_row.get_mut(slot) {
                *of_row = place;
            }
        }
    }
    let mut shares = vec![vec![0; cells]; lanes.len()];
    for one in &activations {
        if let Some(shares) = of_row.get(one.slot).and_then(|&row| shares.get_mut(row)) {
            let [from_us, to_us] =
                [one.start_us, one.end_us].map(|us| u64::try_from(us).unwrap_or(0));
            scale.add(from_us, to_us, shares);
        }
    }
    let mut text = format!("\n{}:\n", timetable.describe(&window));
    for ((label, _), shares) in lanes.iter().zip(&shares) {
        let _ = writeln!(text, "{label:>label_width$} │{}│", scale.bars(shares));
    }
    if let Some(label) = free {
        let mut free = vec![0; cells];
        for gap in gaps(&activations, window.start_us, window.end_us()) {
            let end_us = gap.start_us.saturating_add(gap.length_us);
            scale.add(gap.start_us, end_us, &mut free);
        }
        let _ = writeln!(text, "{label:>label_width$} │{}│", scale.bars(&free));
    }
    let (unit, numbers) = scale.axis();
    let _ = writeln!(text, "{unit:>label_width$}  {numbers}");
    text
}

/// A stretch of time in columns.
struct Scale {
    from_us: u64,
    length_us: u64,
    cells: usize,
}

impl Scale {
    /// Adds a part of the stretch to what its columns hold, in microseconds times the number of
    /// columns: so a full one holds `length_us`.
    fn add(&self, from_us: u64, to_us: u64, shares: &mut [u64]) {
        let within = |us: u64| {
            us.saturating_sub(self.from_us)
                .min(self.length_us)
                .saturating_mul(self.cells as u64)
        };
        let (mut from, to) = (within(from_us), within(to_us));
        while from < to {
            let cell = from / self.length_us;
            let end = to.min((cell + 1) * self.length_us);
            if let Some(share) = usize::try_from(cell)
                .ok()
                .and_then(|cell| shares.get_mut(cell))
            {
                *share += end - from;
            }
            from = end;
        }
    }

    /// Columns as high as their shares, and none of nothing.
    fn bars(&self, shares: &[u64]) -> String {
        let bar = |share: &u64| {
            let eighths = (u128::from(*share) * 8).div_ceil(self.length_us.into());
            let place = usize::try_from(eighths)
                .ok()
                .and_then(|eighths| eighths.checked_sub(1));
            place
                .and_then(|place| EIGHTHS.get(place).copied())
                .unwrap_or(' ')
        };
        shares.iter().map(bar).collect()
    }

    /// The unit, and numbers that begin below the columns of their times; the last ends where the
    /// bars do.
    fn axis(&self) -> (&'static str, String) {
        let unit = Unit::of(self.length_us);
        let (from, to) = (
            unit.of_us(self.from_us),
            unit.of_us(self.from_us.saturating_add(self.length_us)),
        );
        let mut line = String::new();
        let mut width = 0;
        for mark in axis::ticks(from, to, (self.cells / COLUMNS_A_MARK).max(1)) {
            let cell = libm::round((mark - from) / (to - from) * self.cells as f64) as usize;
            let number = axis::number(mark);
            let cell = cell.min((self.cells + 1).saturating_sub(number.chars().count()));
            if cell > width || width == 0 {
                let _ = write!(
                    line,
                    "{:pad$}{number}",
                    "",
                    pad = cell.saturating_sub(width)
                );
                width = cell.max(width) + number.chars().count();
            }
        }
        (unit.name(), line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_toolkit::samples::timetable;

    #[test]
    fn a_chart_shows_each_slot_and_what_is_free() {
        let slots = timetable(&[
            (0, 20_000, 2_000),
            (2_000, 20_000, 4_000),
            (6_000, 40_000, 2_000),
        ]);
        assert_eq!(
            chart(&slots, 49),
            "
one hyperperiod of 40 ms:
slot 1 │██                  ██                  │
slot 2 │  ████                ████              │
slot 3 │      ██                                │
  free │        ████████████      ██████████████│
    ms  0         10        20        30       40
"
        );
    }

    #[test]
    fn what_takes_a_part_of_a_column_is_a_part_as_high_and_never_nothing() {
        let slots = timetable(&[(0, 40_000, 500), (500, 40_000, 1), (1_000, 40_000, 39_000)]);
        let text = chart(&slots, 49);
        let bars: Vec<&str> = text
            .lines()
            .filter_map(|line| line.split('│').nth(1))
            .collect();
        assert_eq!(bars[0].trim_end(), "▄");
        assert_eq!(bars[1].trim_end(), "▁");
        assert_eq!(bars[2], format!(" {}", "█".repeat(39)));
        assert_eq!(bars[3].trim_end(), "▄");
    }

    #[test]
    fn charts_of_anything_are_bounded() {
        let primes = [999_983, 999_979, 999_961, 999_959, 999_953];
        let primes: Vec<_> = primes
            .iter()
            .zip(0..)
            .map(|(&period, at)| (at * 10, period, 5))
            .collect();
        let many: Vec<_> = (0..4_000)
            .map(|at| (at * 10, 40_000 * (1 + at % 100), 10))
            .collect();
        for slots in [
            &primes[..],
            &many,
            &[(0, 1, 1)],
            &[(0, 4_000_000_000, 4_000_000_000)],
            &[],
        ] {
            for columns in [0, 1, 40, 80, 10_000] {
                let text = chart(&timetable(slots), columns);
                assert!(text.lines().count() <= MAX_ROWS + 4, "{text}");
                // All that the terminal's width bounds: the bars, and the axis below them.
                let lines = text.lines().skip_while(|line| !line.contains('│'));
                assert!(
                    lines
                        .map(|line| line.chars().count())
                        .all(|width| width <= columns.clamp(LEAST_COLUMNS, MOST_COLUMNS)),
                    "{text}"
                );
            }
        }
    }
}
