//! New names for things, in all files that use them.
//!
//! Whether a new name is free is not worked out by rules beside those of the language: the texts
//! are edited, checked again, and every name must then mean what it meant before.

use std::collections::BTreeMap;

use crate::lang::lexer::{Lexer, TokenKind as T};
use crate::lang::{self, Severity};
use crate::model::Span;

use super::sets::Set;
use super::use_index::MAX_ENTRIES;

/// Why a name cannot be changed so.
#[derive(Debug, thiserror::Error)]
pub(super) enum Refusal {
    /// It is no identifier.
    #[error("`{0}` is no name: write letters, digits and `_`, beginning with no digit")]
    NoName(String),
    /// It is a word of the language.
    #[error("`{0}` is a reserved word")]
    Reserved(String),
    /// A slot is named by its number.
    #[error("a slot is named by its number, which is more than a name: it cannot be renamed")]
    Slot,
    /// Nothing with a name stands there.
    #[error("there is no name here that is known")]
    Nothing,
    /// The name is taken, or would be caught by something else of that name.
    #[error("`{0}` is already the name of something else that is seen from here")]
    Taken(String),
    /// Files that may use the name were not looked at.
    #[error(
        "the folders hold more than {MAX_ENTRIES} files and folders: nobody can tell which of them \
            use the name; open a smaller folder"
    )]
    TooManyFiles,
}

/// Whether a text can be a name.
pub(super) fn check_name(name: &str) -> Result<(), Refusal> {
    let token = Lexer::new(name).next_token();
    if token.end as usize != name.len() || token.start != 0 {
        return Err(Refusal::NoName(name.to_owned()));
    }
    match token.kind {
        T::Identifier => Ok(()),
        kind if kind.is_reserved() => Err(Refusal::Reserved(name.to_owned())),
        _ => Err(Refusal::NoName(name.to_owned())),
    }
}

/// Places to edit, by what tells files apart.
pub(super) type Places = BTreeMap<String, Vec<(u32, u32)>>;

/// Checks that with all places edited every name of a set means what it meant.
pub(super) fn check_meaning(
    set: &Set,
    declaration: Span,
    places: &Places,
    new: &str,
) -> Result<(), Refusal> {
    let files: Vec<(&str, String)> = set
        .checked
        .files
        .iter()
        .zip(&set.identities)
        .map(|(file, identity)| {
            let edits = places.get(identity).map_or(&[][..], Vec::as_slice);
            (file.path.as_str(), edited(&file.text, edits, new))
        })
        .collect();
    let texts: Vec<(&str, &str)> = files
        .iter()
        .map(|(path, text)| (*path, text.as_str()))
        .collect();
    let after = lang::load_texts(&texts);
    let taken = || Refusal::Taken(new.to_owned());
    if after.files.len() != set.checked.files.len() {
        return Err(taken());
    }
    let errors = |checked: &lang::Checked| {
        let errors = checked.diagnostics.iter();
        errors.filter(|it| it.severity() == Severity::Error).count()
    };
    if errors(&after) != errors(&set.checked) {
        return Err(taken());
    }
    let moved = |span: Span| {
        let edits = set
            .identities
            .get(span.file as usize)
            .and_then(|identity| places.get(identity))
            .map_or(&[][..], Vec::as_slice);
        let before = edits.partition_point(|&(start, _)| start < span.start);
        // All places have the same name.
        let longer = edits.first().map_or(0, |&(start, end)| {
            new.len() as i64 - i64::from(end.saturating_sub(start))
        });
        i64::from(span.start) + before as i64 * longer
    };
    // Both lists are sorted by place, and the edits keep the order of places.
    let before = set.checked.references().all();
    let same = before.len() == after.references().all().len()
        && before.iter().zip(after.references().all()).all(
            |(&(place, declaration), &(new_place, new_declaration))| {
                place.file == new_place.file
                    && moved(place) == i64::from(new_place.start)
                    && declaration.file == new_declaration.file
                    && moved(declaration) == i64::from(new_declaration.start)
            },
        );
    if !same {
        return Err(taken());
    }
    // An event may meet another of its new name where it goes from container to container.
    let start = u32::try_from(moved(declaration)).unwrap_or(0);
    let new_declaration = Span {
        start,
        end: start + new.len() as u32,
        ..declaration
    };
    let after = Set::new(after, set.identities.clone(), set.encoding);
    if after.places(new_declaration).len() == set.places(declaration).len() {
        Ok(())
    } else {
        Err(taken())
    }
}

/// A text with places replaced; these are sorted and do not overlap.
pub(super) fn edited(text: &str, places: &[(u32, u32)], new: &str) -> String {
    let mut edited = String::with_capacity(text.len());
    let mut from = 0;
    for &(start, end) in places {
        edited.push_str(text.get(from..start as usize).unwrap_or(""));
        edited.push_str(new);
        from = end as usize;
    }
    edited.push_str(text.get(from..).unwrap_or(""));
    edited
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_can_be_given() {
        for (name, is_free) in [
            ("A", true),
            ("a_1", true),
            ("period", true),
            ("", false),
            ("1a", false),
            ("a b", false),
            (" a", false),
            ("a;", false),
            ("state", false),
            ("history", false),
            ("ä", false),
            ("//", false),
        ] {
            assert_eq!(check_name(name).is_ok(), is_free, "{name:?}");
        }
    }
}
