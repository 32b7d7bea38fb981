//! Tables in text files: a row a line, with commas between its columns.
//!
//! The first line may name the columns; then they are found by their names, in any order and among
//! others. Without such a line the columns are the wanted ones, in their order. Blanks around a
//! field, quotes around it, `\r` at the end of a line and a byte order mark mean nothing.

use crate::clean::counted;

/// Where the wanted columns of a table are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns<const N: usize> {
    /// Place of each wanted column in a row.
    places: [usize; N],
    /// Columns of a row.
    count: usize,
    /// Whether the first line named them.
    are_named: bool,
}

/// What is wrong with a row or with the names of the columns.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RowError {
    /// The line is not UTF-8.
    #[error("this is no text: it is not UTF-8; save the table as UTF-8")]
    NoText,
    /// The first line names some of the columns and not this one.
    #[error("there is no column `{name}`; the first line must name {wanted}, or be left out")]
    Missing {
        /// The column.
        name: &'static str,
        /// All columns that are wanted.
        wanted: String,
    },
    /// The first line names a column twice.
    #[error("there are two columns `{name}`; give one of them another name")]
    Twice {
        /// The column.
        name: &'static str,
    },
    /// The row has too few or too many columns.
    #[error("{} found, and {expected} expected, with commas between: {why}", counted(*found as u64, "column"))]
    Count {
        /// How many there are.
        found: usize,
        /// How many there should be.
        expected: usize,
        /// Where that number is from.
        why: String,
    },
}

/// The text of a line of a table, without a byte order mark and blanks around it. It is empty where
/// the line has nothing.
///
/// # Errors
/// [`RowError::NoText`]
pub fn text(line: &[u8]) -> Result<&str, RowError> {
    let text = std::str::from_utf8(line).map_err(|_| RowError::NoText)?;
    Ok(text.trim_start_matches('\u{feff}').trim())
}

/// A field without blanks and quotes around it.
fn field(text: &str) -> &str {
    let text = text.trim();
    let inner = text.strip_prefix('"').and_then(|it| it.strip_suffix('"'));
    inner.map_or(text, str::trim)
}

impl<const N: usize> Columns<N> {
    /// The columns of a table with this first line, which names them if one of the wanted names is
    /// in it.
    ///
    /// # Errors
    /// It names some of the columns and not all, or one of them twice.
    pub fn of_first_line(line: &str, names: [&'static str; N]) -> Result<Self, RowError> {
        let is_named = |found: &str, name: &str| field(found).eq_ignore_ascii_case(name);
        let mut columns = Self {
            places: std::array::from_fn(|place| place),
            count: N,
            are_named: (line.split(',')).any(|it| names.iter().any(|name| is_named(it, name))),
        };
        if columns.are_named {
            columns.count = line.split(',').count();
            for (place, name) in columns.places.iter_mut().zip(names) {
                let mut found = (line.split(',').enumerate()).filter(|(_, it)| is_named(it, name));
                let Some((first, _)) = found.next() else {
                    let wanted = names.map(|name| format!("`{name}`")).join(", ");
                    return Err(RowError::Missing { name, wanted });
                };
                if found.next().is_some() {
                    return Err(RowError::Twice { name });
                }
                *place = first;
            }
        }
        Ok(columns)
    }

    /// Whether the first line named the columns, and is no row.
    pub fn are_named(&self) -> bool {
        self.are_named
    }

    /// The wanted fields of a row.
    ///
    /// # Errors
    /// [`RowError::Count`]
    pub fn fields<'l>(&self, line: &'l str) -> Result<[&'l str; N], RowError> {
        let mut fields = [""; N];
        let mut found = 0;
        for (place, text) in line.split(',').enumerate() {
            found = place + 1;
            for (kept, wanted) in fields.iter_mut().zip(self.places) {
                if wanted == place {
                    *kept = field(text);
                }
            }
        }
        if found == self.count {
            return Ok(fields);
        }
        Err(RowError::Count {
            found,
            expected: self.count,
            why: match self.are_named {
                true => "as many as the first line names".to_owned(),
                false => "a table with others has their names in its first line".to_owned(),
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 3] = ["t_us", "left", "right"];

    #[test]
    fn columns_are_found_by_their_names_or_by_their_order() {
        for (first, row, expected) in [
            ("1,2,3", "4,5,6", ["4", "5", "6"]),
            ("t_us,left,right", "4,5,6", ["4", "5", "6"]),
            ("right,t_us,left", "4,5,6", ["5", "6", "4"]),
            ("T_US, Left ,\"right\"", " 4 , \"5\",6", ["4", "5", "6"]),
            ("mode,left,right,t_us", "x,5,6,4", ["4", "5", "6"]),
        ] {
            let columns = Columns::of_first_line(first, NAMES).unwrap();
            assert_eq!(columns.fields(row).unwrap(), expected, "{first}");
            assert_eq!(columns.are_named(), first != "1,2,3");
        }
    }

    #[test]
    fn columns_that_are_not_there_are_told() {
        for (first, row, said) in [
            ("t_us,left", "", "no column `right`"),
            ("left,right,left,t_us", "", "two columns `left`"),
            ("1,2,3", "1,2", "2 columns found, and 3 expected"),
            ("1,2,3", "1;2;3", "1 column found, and 3 expected"),
            ("1,2,3", "1,2,3,", "4 columns found, and 3 expected"),
            (
                "a,t_us,left,right",
                "1,2,3",
                "3 columns found, and 4 expected",
            ),
        ] {
            let error = Columns::of_first_line(first, NAMES)
                .and_then(|columns| columns.fields(row).map(|_| ()))
                .unwrap_err();
            assert!(error.to_string().contains(said), "{first}: {error}");
        }
    }

    #[test]
    fn marks_and_ends_of_lines_mean_nothing() {
        assert_eq!(text("\u{feff}1,2\r\n".as_bytes()), Ok("1,2"));
        assert_eq!(text(b" \t\r\n"), Ok(""));
        assert_eq!(text(b"1,\xff"), Err(RowError::NoText));
    }
}
