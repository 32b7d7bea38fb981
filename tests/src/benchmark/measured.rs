//! Running the programs that are measured: on the host under callgrind and against the clock, on
//! the emulated Cortex-M4.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use super::emulated::emulator;

/// What one program told.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// By row: what one event takes, in each of the measurements, the least first.
    rows: BTreeMap<String, Vec<f64>>,
    /// By row: numbers.
    told: BTreeMap<String, Vec<u32>>,
}

impl Measured {
    /// What an event takes: the least, for what disturbs only adds.
    pub fn event(&self, row: &str) -> Option<f64> {
        self.rows.get(row)?.first().copied()
    }

    /// What an event took in the measurement that was disturbed most.
    pub fn most(&self, row: &str) -> Option<f64> {
        self.rows.get(row)?.last().copied()
    }

    /// What an event takes that a row has more than another one.
    pub fn difference(&self, row: &str, less: &str) -> Option<f64> {
        Some(self.event(row)? - self.event(less)?)
    }

    /// Numbers that were told.
    pub fn told(&self, row: &str) -> Option<&[u32]> {
        self.told.get(row).map(Vec::as_slice)
    }

    /// All that two programs told.
    pub fn and(mut self, other: Self) -> Self {
        self.rows.extend(other.rows);
        self.told.extend(other.told);
        self
    }

    /// The measurements of the same rows at another time, beside those that are here.
    pub fn again(&mut self, other: Self) {
        for (row, took) in other.rows {
            let all = self.rows.entry(row).or_default();
            all.extend(took);
            all.sort_by(f64::total_cmp);
        }
    }

    /// Reads what a program printed. `amounts` says what a row took, by its place among the rows
    /// and the numbers behind its events.
    ///
    /// # Errors
    /// The line that is neither a row nor told numbers.
    pub fn read(
        text: &str,
        amounts: impl Fn(usize, &[f64]) -> Option<Vec<f64>>,
    ) -> Result<Self, String> {
        let mut measured = Self::default();
        for line in text.lines() {
            let mut words = line.split_whitespace();
            match words.next() {
                Some("row") => {
                    let place = measured.rows.len();
                    let (name, took) = row(words, |numbers| amounts(place, numbers))
                        .ok_or_else(|| format!("no row: {line}"))?;
                    measured.rows.insert(name, took);
                }
                Some("tell") => {
                    let (name, numbers) =
                        told(words).ok_or_else(|| format!("no numbers: {line}"))?;
                    measured.told.insert(name, numbers);
                }
                // The emulator and the kernel of the emulated board remark this and that; what ends
                // a program early says so at the end of its output.
                _ => return Err(format!("the program says: {line}")),
            }
        }
        Ok(measured)
    }

    /// What a program printed that took the time itself.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub fn timed(text: &str) -> Result<Self, String> {
        Self::read(text, |_, times| (!times.is_empty()).then(|| times.to_vec()))
    }
}

/// The words behind `row`: a name, a number of events, numbers.
fn row<'w>(
    mut words: impl Iterator<Item = &'w str>,
    amounts: impl FnOnce(&[f64]) -> Option<Vec<f64>>,
) -> Option<(String, Vec<f64>)> {
    let name = words.next()?.to_owned();
    let events: f64 = words.next()?.parse().ok().filter(|events| *events > 0.0)?;
    let numbers: Option<Vec<f64>> = words.map(|word| word.parse().ok()).collect();
    let mut took = amounts(&numbers?)?;
    for amount in &mut took {
        *amount /= events;
    }
    took.sort_by(f64::total_cmp);
    Some((name, took))
}

/// The words behind `tell`: a name, numbers.
fn told<'w>(mut words: impl Iterator<Item = &'w str>) -> Option<(String, Vec<u32>)> {
    let name = words.next()?.to_owned();
    let numbers: Option<Vec<u32>> = words.map(|word| word.parse().ok()).collect();
    Some((name, numbers?))
}

/// What a command printed.
///
/// # Errors
/// If it cannot be started, or ends badly: what it said.
pub fn output(command: &mut Command) -> Result<Output, String> {
    let shown = format!("{command:?}");
    let output = command
        .output()
        .map_err(|error| format!("{shown}: {error}"))?;
    if output.status.success() {
        Ok(output)
    } else {
        Err(format!(
            "{shown}: {}\n{}",
            output.status,
            String::from_utf8_lossy(&output.stderr)
        ))
    }
}

/// Nanoseconds on the host.
///
/// # Errors
/// What the program or the system says.
pub fn nanoseconds(program: &Path, folder: &Path) -> Result<Measured, String> {
    let output = output(Command::new(program).arg(folder).arg("time"))?;
    Measured::timed(&String::from_utf8_lossy(&output.stdout))
}

/// Instructions on the host, by callgrind.
///
/// # Errors
/// What the program or the system says.
pub fn host_instructions(program: &Path, folder: &Path) -> Result<Measured, String> {
    // Callgrind numbers its files in the order of the calls, and the program prints a row before
    // each.
    let counts = folder.join("callgrind");
    let output = output(
        Command::new("valgrind")
            .args(["--tool=callgrind", "--quiet", "--collect-atstart=no"])
            .args(["--toggle-collect=counted", "--dump-after=counted"])
            .arg(format!("--callgrind-out-file={}", counts.display()))
            .arg(program)
            .arg(folder)
            .arg("count"),
    )?;
    let total = |row: usize, _: &[f64]| {
        let file = fs::read_to_string(folder.join(format!("callgrind.{}", row + 1))).ok()?;
        let line = file
            .lines()
            .find_map(|line| line.strip_prefix("totals: "))?;
        Some(vec![line.trim().parse().ok()?])
    };
    Measured::read(&String::from_utf8_lossy(&output.stdout), total)
}

/// Nanoseconds that an instruction takes in the emulator, as a power of two: 25.6 ticks of the
/// board's timer.
const SHIFT: u32 = 10;
/// Nanoseconds that a tick of the board's timer takes.
const TICK_NS: u64 = 40;

/// Instructions on the emulated Cortex-M4.
///
/// # Errors
/// What the program or the system says.
pub fn board_instructions(program: &Path, folder: &Path) -> Result<Measured, String> {
    let program = program.canonicalize().map_err(|error| error.to_string())?;
    let output = output(emulator("mps2-an386", SHIFT, &program, folder).args(["-serial", "null"]))?;
    // Where the emulator puts what the firmware prints.
    let text = String::from_utf8_lossy(&output.stderr);
    let instruction_ns = 1_u64 << SHIFT;
    Measured::read(&text, |_, ticks| {
        // Reading the timer itself is half an instruction more or less.
        let ticks = *ticks.first()? as u64;
        Some(vec![
            ((ticks * TICK_NS + instruction_ns / 2) / instruction_ns) as f64,
        ])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_for_one_event_and_the_least_counts() {
        let measured =
            Measured::timed("row a 2 30 10 20\ntell a 1 2 3\nrow b 1 4\ntell none\n").unwrap();
        assert_eq!(measured.event("a"), Some(5.0));
        assert_eq!(measured.most("a"), Some(15.0));
        assert_eq!(measured.difference("a", "b"), Some(1.0));
        assert_eq!(measured.difference("a", "c"), None);
        assert_eq!(measured.told("a"), Some(&[1, 2, 3][..]));
        assert_eq!(measured.told("none"), Some(&[][..]));
        assert_eq!(measured.told("c"), None);
    }

    #[test]
    fn a_line_that_is_neither_row_nor_told_is_an_error_that_shows_it() {
        for (text, shown) in [
            ("row a\n", "row a"),
            ("row a 0 1\n", "row a 0 1"),
            ("row a 1\n", "row a 1"),
            ("row a 1 x\n", "row a 1 x"),
            ("tell a -1\n", "tell a -1"),
            ("tell\n", "tell"),
            ("panic 12\n", "panic 12"),
        ] {
            let error = Measured::timed(text).unwrap_err();
            assert!(error.ends_with(shown), "{error}");
        }
    }

    #[test]
    fn a_program_may_leave_the_amounts_to_who_runs_it() {
        let places = Measured::read("row a 1\nrow b 2\n", |place, numbers| {
            assert!(numbers.is_empty());
            Some(vec![10.0 * (place + 1) as f64])
        });
        let measured = places.unwrap();
        assert_eq!(measured.event("a"), Some(10.0));
        assert_eq!(measured.event("b"), Some(10.0));
    }

    #[test]
    fn a_row_that_is_measured_again_has_all_measurements() {
        let mut measured = Measured::timed("row a 1 2 5\n").unwrap();
        measured.again(Measured::timed("row a 1 9 1\nrow b 1 3\n").unwrap());
        assert_eq!(
            [measured.event("a"), measured.most("a")],
            [Some(1.0), Some(9.0)]
        );
        assert_eq!(measured.event("b"), Some(3.0));
    }

    #[test]
    fn of_two_programs_the_later_one_counts() {
        let first = Measured::timed("row a 1 1\nrow b 1 2\n").unwrap();
        let both = first.and(Measured::timed("row b 1 3\n").unwrap());
        assert_eq!([both.event("a"), both.event("b")], [Some(1.0), Some(3.0)]);
    }
}
