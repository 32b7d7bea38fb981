//! Tables of figures, for a terminal and for the documentation.

/// Rows of cells under a head, with a title and what to know of it.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// What it shows.
    pub title: String,
    /// What to know of it; may have several lines.
    pub note: String,
    /// The headings of the columns.
    pub head: Vec<String>,
    /// As many cells each as the head has.
    pub rows: Vec<Vec<String>>,
}

/// A number as people read it; a dash where there is none.
pub fn number(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        Some(value) if value.abs() < 999.95 => {
            let shown = format!("{value:.1}");
            // What is rounded to nothing has no sign.
            shown
                .strip_prefix('-')
                .filter(|rest| *rest == "0.0")
                .map(str::to_owned)
                .unwrap_or(shown)
        }
        Some(value) => grouped(&format!("{value:.0}")),
    }
}

/// A number in groups of three digits.
pub fn grouped(number: &str) -> String {
    let (sign, digits) = match number.strip_prefix('-') {
        Some(digits) => ("-", digits),
        None => ("", number),
    };
    let mut text = sign.to_owned();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

impl Table {
    /// For a terminal.
    pub fn text(&self) -> String {
        let rows = self.aligned("  ", false);
        format!("\n{}\n{}\n{rows}", self.title, self.note)
    }

    /// For the documentation.
    pub fn markdown(&self) -> String {
        let rows = self.aligned(" | ", true);
        format!("\n## {}\n\n{}\n\n{rows}", self.title, self.note)
    }

    /// The rows alone, as Markdown.
    pub fn rows_as_markdown(&self) -> String {
        self.aligned(" | ", true)
    }

    /// The rows with equal widths of columns; `ruled` as Markdown wants it.
    fn aligned(&self, between: &str, ruled: bool) -> String {
        let mut widths = vec![0; self.head.len()];
        for row in std::iter::once(&self.head).chain(&self.rows) {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = cell.chars().count().max(*width);
            }
        }
        let line = |row: &[String]| {
            let cells: Vec<String> = row
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(column, (cell, width))| match column {
                    0 => format!("{cell:<width$}"),
                    _ => format!("{cell:>width$}"),
                })
                .collect();
            let cells = cells.join(between);
            if ruled {
                format!("| {cells} |\n")
            } else {
                format!("{}\n", cells.trim_end())
            }
        };
        let mut text = line(&self.head);
        if ruled {
            let rules = widths
                .iter()
                .enumerate()
                .map(|(column, width)| match column {
                    0 => "-".repeat(*width),
                    _ => format!("{}:", "-".repeat(width.saturating_sub(1))),
                });
            text += &line(&rules.collect::<Vec<_>>());
        }
        for row in &self.rows {
            text += &line(row);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_rounded_and_grouped() {
        for (value, shown) in [
            (None, "–"),
            (Some(0.04), "0.0"),
            (Some(-0.04), "0.0"),
            (Some(-0.06), "-0.1"),
            (Some(999.94), "999.9"),
            (Some(999.96), "1,000"),
            (Some(-12_345.0), "-12,345"),
            (Some(544_456.4), "544,456"),
            (Some(123_456_789.0), "123,456,789"),
        ] {
            assert_eq!(number(value), shown);
        }
    }

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let table = Table {
            title: "T".to_owned(),
            note: "n".to_owned(),
            head: ["what", "x"].map(str::to_owned).to_vec(),
            rows: vec![
                ["a", "1.0"].map(str::to_owned).to_vec(),
                ["größer", "–"].map(str::to_owned).to_vec(),
            ],
        };
        assert_eq!(
            table.text(),
            "\nT\nn\nwhat      x\na       1.0\ngrößer    –\n"
        );
        assert_eq!(
            table.markdown(),
            "\n## T\n\nn\n\n| what   |   x |\n| ------ | --: |\n| a      | 1.0 |\n| größer |   – |\n"
        );
    }
}
