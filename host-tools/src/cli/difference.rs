//! Where two texts differ first, for a person.

use std::fmt::Write as _;

use crate::clean::clean;

/// How many lines from the first difference on are compared; their product bounds the work.
const MAX_COMPARED_LINES: usize = 60;

/// How many lines are shown.
const MAX_SHOWN_LINES: usize = 12;

/// How much of a line is shown, in characters.
const MAX_SHOWN_CHARACTERS: usize = 120;

/// The first lines in which two texts differ: those that go with `-`, those that come with `+`,
/// under the number of the first one.
pub fn first(before: &str, after: &str) -> String {
    let same = before
        .split_inclusive('\n')
        .zip(after.split_inclusive('\n'))
        .take_while(|(before, after)| before == after)
        .count();
    let from = |text| -> Vec<&str> {
        let lines = str::split_inclusive(text, '\n');
        lines.skip(same).take(MAX_COMPARED_LINES).collect()
    };
    let (before, after) = (from(before), from(after));
    let mut text = format!("  line {}:\n", same + 1);
    for (shown, (sign, line)) in first_changes(&before, &after).into_iter().enumerate() {
        if shown == MAX_SHOWN_LINES {
            text.push_str("  …\n");
            break;
        }
        let _ = writeln!(text, "  {sign}{}", visible(line));
    }
    text
}

/// Two lines that differ, one below the other; an empty text is none. Of long ones the part is
/// shown in which they differ first.
pub fn of_lines(before: &str, after: &str) -> String {
    let pairs = before.chars().zip(after.chars());
    let same = pairs.take_while(|(before, after)| before == after).count();
    let left_out = match same + MAX_SHOWN_CHARACTERS / 4 > MAX_SHOWN_CHARACTERS {
        true => same - MAX_SHOWN_CHARACTERS / 2,
        false => 0,
    };
    let lines = [('-', before), ('+', after)];
    let shown = lines.iter().filter(|(_, line)| !line.is_empty());
    shown.fold(String::new(), |mut text, (sign, line)| {
        let ellipsis = if left_out > 0 { "…" } else { "" };
        let rest: String = line.chars().skip(left_out).collect();
        let _ = writeln!(text, "  {sign}{ellipsis}{}", visible(&rest));
        text
    })
}

/// The changed lines up to the first line that both have.
fn first_changes<'t>(before: &[&'t str], after: &[&'t str]) -> Vec<(char, &'t str)> {
    // The shortest way to a common line, by the lines that are left out on both sides.
    let nearest = (0..before.len())
        .flat_map(|gone| (0..after.len()).map(move |come| (gone, come)))
        .filter(|&(gone, come)| before.get(gone) == after.get(come))
        .min_by_key(|&(gone, come)| (gone + come, gone));
    let (gone, come) = nearest.unwrap_or((before.len(), after.len()));
    let gone = before.iter().take(gone).map(|&line| ('-', line));
    let come = after.iter().take(come).map(|&line| ('+', line));
    gone.chain(come).collect()
}

/// A line with its blanks made visible where they are all that differs: at its end.
fn visible(line: &str) -> String {
    let kept = line.trim_end();
    let shown: String = kept.chars().take(MAX_SHOWN_CHARACTERS).collect();
    let mut shown = clean(&shown);
    if kept.chars().nth(MAX_SHOWN_CHARACTERS).is_some() {
        shown.push('…');
        return shown;
    }
    for blank in line
        .get(kept.len()..)
        .unwrap_or("")
        .chars()
        .take(MAX_SHOWN_CHARACTERS)
    {
        match blank {
            '\n' => {}
            '\r' => shown.push('␍'),
            '\t' => shown.push('→'),
            _ => shown.push('·'),
        }
    }
    if !line.ends_with('\n') {
        shown.push_str(" (no line end)");
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_and_their_first_difference() {
        let cases = [
            ("a\nb\nc\n", "a\nx\nc\n", "  line 2:\n  -b\n  +x\n"),
            ("a\nb\n", "a\n\nb\n", "  line 2:\n  +\n"),
            ("a", "a\n", "  line 1:\n  -a (no line end)\n  +a\n"),
            ("a \r\n", "a\n", "  line 1:\n  -a·␍\n  +a\n"),
            ("a\n\n\nb\n", "a\n\nb\n", "  line 3:\n  -\n"),
        ];
        for (before, after, expected) in cases {
            assert_eq!(first(before, after), expected, "{before:?} {after:?}");
        }
    }

    #[test]
    fn lines_are_shown_where_they_differ() {
        let (x, y) = ("x".repeat(1_000), "y".repeat(1_000));
        for (before, after, expected) in [
            (
                "a\n".to_owned(),
                "b\n".to_owned(),
                "  -a\n  +b\n".to_owned(),
            ),
            ("a\n".to_owned(), String::new(), "  -a\n".to_owned()),
            (
                "\u{1b}[2J\n".to_owned(),
                "a".to_owned(),
                "  -\\u{1b}[2J\n  +a (no line end)\n".to_owned(),
            ),
            (
                format!("{x}\n"),
                format!("{x}{y}\n"),
                format!("  -…{}\n  +…{}{}…\n", &x[..60], &x[..60], &y[..60]),
            ),
        ] {
            assert_eq!(of_lines(&before, &after), expected);
        }
    }

    #[test]
    fn little_is_shown_of_much() {
        let before = "x\n".repeat(1_000);
        let after = format!("{}\n", "y".repeat(1_000)).repeat(1_000);
        let shown = first(&before, &after);
        assert_eq!(shown.lines().count(), MAX_SHOWN_LINES + 2);
        let long: String = first("", &after);
        assert!(
            long.lines()
                .all(|line| line.chars().count() <= MAX_SHOWN_CHARACTERS + 4)
        );
    }
}
