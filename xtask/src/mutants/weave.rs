//! Source with all mutants in it: each changed expression becomes a choice.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use super::table::{Change, Table};
use crate::process::Failure;

/// Why source cannot be woven.
#[derive(Debug)]
pub enum WeaveError {
    /// A file cannot be read.
    File(Failure),
    /// The change of this line of the table does not fit.
    Change(usize, String),
}

impl WeaveError {
    /// The same, with the table's path.
    pub fn or_at(self, path: &Path) -> Failure {
        match self {
            WeaveError::File(failure) => failure,
            WeaveError::Change(line, problem) => Failure::Mutant {
                place: format!("{}:{line}", path.display()),
                problem,
            },
        }
    }
}

/// A change at its place in a file.
struct Placed<'t> {
    mutant: usize,
    change: &'t Change,
    range: Range<usize>,
}

/// The files that a table changes, with all changes in them.
///
/// # Errors
/// A text that is not there, or more than once; changes that overlap.
pub fn weave(
    table: &Table,
    read: impl Fn(&str) -> Result<String, Failure>,
) -> Result<BTreeMap<String, String>, WeaveError> {
    let mut files: BTreeMap<&str, Vec<(usize, &Change)>> = BTreeMap::new();
    for (number, mutant) in table.mutants.iter().enumerate() {
        for change in &mutant.changes {
            files
                .entry(&change.file)
                .or_default()
                .push((number, change));
        }
    }
    let mut woven = BTreeMap::new();
    for (file, changes) in files {
        let source = read(file).map_err(WeaveError::File)?;
        let mut placed = Vec::new();
        for (mutant, change) in changes {
            let range = find(&source, change).map_err(|problem| {
                WeaveError::Change(change.line, format!("{problem} in {file}"))
            })?;
            placed.push(Placed {
                mutant,
                change,
                range,
            });
        }
        // What is around others comes first.
        placed.sort_by_key(|it| (it.range.start, usize::MAX - it.range.end, it.mutant));
        woven.insert(
            file.to_owned(),
            with_choices(&source, 0..source.len(), &placed)?,
        );
    }
    Ok(woven)
}

/// The text of a range, with the changes in it as choices.
fn with_choices(
    source: &str,
    range: Range<usize>,
    mut placed: &[Placed<'_>],
) -> Result<String, WeaveError> {
    let mut text = String::new();
    let mut at = range.start;
    while let Some(first) = placed.first() {
        let Range { start, end } = first.range;
        let same = placed
            .iter()
            .take_while(|it| it.range == first.range)
            .count();
        let inside = (placed.iter().skip(same))
            .take_while(|it| it.range.start < end)
            .count();
        if let Some(crossing) = placed
            .get(same..same + inside)
            .and_then(|inside| inside.iter().find(|it| it.range.end > end))
        {
            let problem = format!("overlaps the change of line {}", first.change.line);
            return Err(WeaveError::Change(crossing.change.line, problem));
        }
        text += source.get(at..start).unwrap_or_default();
        text += "(";
        for it in placed.iter().take(same) {
            let (mutant, new) = (it.mutant, it.change.new.trim_end());
            text += &format!("if crate::esm_mutant::is_on({mutant}) {{ {new} }} else ");
        }
        let inside = placed.get(same..same + inside).unwrap_or_default();
        text += &format!("{{ {} }})", with_choices(source, start..end, inside)?);
        placed = placed.get(same + inside.len()..).unwrap_or_default();
        at = end;
    }
    text += source.get(at..range.end).unwrap_or_default();
    Ok(text)
}

/// Where the text of a change is. Blanks do not count.
fn find(source: &str, change: &Change) -> Result<Range<usize>, String> {
    let dense: Vec<(usize, char)> = source
        .char_indices()
        .filter(|(_, char)| !char.is_whitespace())
        .collect();
    let from = match &change.after {
        None => 0,
        Some(after) => match places(&dense, 0, after)[..] {
            [only] => only + length(after),
            [] => return Err(format!("`{after}` is not")),
            _ => return Err(format!("`{after}` is more than once")),
        },
    };
    let old = change.old.trim();
    let found = places(&dense, from, old);
    let first = match (&found[..], &change.after) {
        ([only], _) => *only,
        ([first, ..], Some(_)) => *first,
        ([], _) => return Err(format!("`{old}` is not")),
        (_, None) => {
            return Err(format!(
                "`{old}` is more than once, so `after` must say where,"
            ));
        }
    };
    let place = |at: usize| dense.get(at).copied().unwrap_or_default();
    let (start, _) = place(first);
    let (last, char) = place(first + length(old) - 1);
    Ok(start..last + char.len_utf8())
}

/// Characters of a text that count.
fn length(text: &str) -> usize {
    text.chars().filter(|char| !char.is_whitespace()).count()
}

/// Where a text begins among characters that count, from `from` on.
fn places(dense: &[(usize, char)], from: usize, text: &str) -> Vec<usize> {
    let wanted: Vec<char> = text.chars().filter(|char| !char.is_whitespace()).collect();
    if wanted.is_empty() {
        return Vec::new();
    }
    let rest = dense.get(from..).unwrap_or_default();
    let is_word = |char: Option<&(usize, char)>| {
        char.is_some_and(|(_, char)| char.is_alphanumeric() || *char == '_')
    };
    // A name is not a part of another one: `is_old` is not in `is_older`.
    let is_alone = |at: usize| {
        let (before, first) = (from + at)
            .checked_sub(1)
            .map_or((None, dense.get(from + at)), |before| {
                (dense.get(before), dense.get(from + at))
            });
        let (last, after) = (
            dense.get(from + at + wanted.len() - 1),
            dense.get(from + at + wanted.len()),
        );
        let touches = |a: Option<&(usize, char)>, b: Option<&(usize, char)>| {
            is_word(a)
                && is_word(b)
                && matches!((a, b), (Some((a, _)), Some((b, _))) if a + 1 == *b)
        };
        !touches(before, first) && !touches(last, after)
    };
    (rest.windows(wanted.len()).enumerate())
        .filter(|(at, window)| {
            (window.iter())
                .map(|(_, char)| *char)
                .eq(wanted.iter().copied())
                && is_alone(*at)
        })
        .map(|(at, _)| from + at)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::table::Table;
    use super::weave;

    /// The source with this table's changes in it, or what is wrong.
    fn woven(source: &str, changes: &str) -> Result<String, String> {
        let text = format!("package p\ntest t\nfile f\n{changes}");
        let table = Table::parse(&text).unwrap();
        weave(&table, |_| Ok(source.to_owned()))
            .map(|mut files| files.remove("f").unwrap())
            .map_err(|error| format!("{error:?}"))
    }

    const CHOICE: &str = "crate::esm_mutant::is_on";

    #[test]
    fn an_expression_becomes_a_choice_whatever_its_layout() {
        assert_eq!(
            woven("if a\n    && b() { c }", "mutant A: a\n- a && b()\n+ false").unwrap(),
            format!("if (if {CHOICE}(0) {{ false }} else {{ a\n    && b() }}) {{ c }}")
        );
    }

    #[test]
    fn mutants_of_one_place_and_in_each_other_are_woven_into_each_other() {
        let changes = "mutant A: a\n- x + y\n+ 0\nmutant B: b\n- y\n+ 1\nmutant C: c\n- x + y\n+ 2";
        assert_eq!(
            woven("z(x + y);", changes).unwrap(),
            format!(
                "z((if {CHOICE}(0) {{ 0 }} else if {CHOICE}(2) {{ 2 }} else \
                 {{ x + (if {CHOICE}(1) {{ 1 }} else {{ y }}) }}));"
            )
        );
    }

    #[test]
    fn a_text_is_looked_for_behind_another_and_as_whole_words() {
        let changes = "mutant A: a\nafter fn g\n- old\n+ new";
        assert_eq!(
            woven("fn f() { old } fn g() { older; old; old }", changes).unwrap(),
            format!(
                "fn f() {{ old }} fn g() {{ older; \
                 (if {CHOICE}(0) {{ new }} else {{ old }}); old }}"
            )
        );
    }

    #[test]
    fn a_text_that_is_not_there_once_is_told() {
        for (source, changes, problem) in [
            ("a", "mutant A: a\n- b\n+ c", "`b` is not"),
            ("b b", "mutant A: a\n- b\n+ c", "more than once"),
            ("b", "mutant A: a\nafter x\n- b\n+ c", "`x` is not"),
            ("x x b", "mutant A: a\nafter x\n- b\n+ c", "more than once"),
            (
                "a b c",
                "mutant A: a\n- a b\n+ 0\nmutant B: b\n- b c\n+ 0",
                "overlaps",
            ),
        ] {
            let told = woven(source, changes).unwrap_err();
            assert!(told.contains(problem), "{told}");
        }
    }
}
