//! Which places of a set of files name the same thing.

use std::collections::HashMap;

use crate::model::Span;

/// Every place that names something that is declared, and where that is. A declaration names
/// itself. Places whose meaning could not be found out are missing. Names that are declared
/// nowhere, types of data and `exclusive` groups, count as declared at their first use.
#[derive(Clone, Debug, Default)]
pub struct References {
    /// Place and declaration, by place.
    uses: Vec<(Span, Span)>,
    /// The same the other way round: declaration and place.
    places: Vec<(Span, Span)>,
}

impl References {
    /// The place at a byte of a file, if it names something, and where that is declared. The byte
    /// directly behind a name counts.
    pub fn at(&self, file: u32, offset: u32) -> Option<(Span, Span)> {
        let behind = self
            .uses
            .partition_point(|(place, _)| (place.file, place.start) <= (file, offset));
        let (place, declaration) = *self.uses.get(behind.checked_sub(1)?)?;
        (place.file == file && offset <= place.end).then_some((place, declaration))
    }

    /// All places that name what is declared there, in order, the declaration among them.
    pub fn of(&self, declaration: Span) -> impl Iterator<Item = Span> {
        let first = self
            .places
            .partition_point(|(other, _)| *other < declaration);
        self.places
            .iter()
            .skip(first)
            .take_while(move |(other, _)| *other == declaration)
            .map(|&(_, place)| place)
    }

    /// All places with their declarations, in order.
    pub fn all(&self) -> &[(Span, Span)] {
        &self.uses
    }
}

/// Which kind of name is declared by its first use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Undeclared {
    /// A type of data.
    Type,
    /// An `exclusive` group.
    Group,
}

/// Takes references down while names are resolved.
#[derive(Debug, Default)]
pub(super) struct Record<'f> {
    uses: Vec<(Span, Span)>,
    undeclared: HashMap<(Undeclared, &'f str), Span>,
}

impl<'f> Record<'f> {
    /// `place` names what is declared at `declaration`.
    pub(super) fn refer(&mut self, place: Span, declaration: Span) {
        self.uses.push((place, declaration));
    }

    /// `place` names something that has no declaration.
    pub(super) fn mention(&mut self, kind: Undeclared, name: &'f str, place: Span) {
        let first = *self.undeclared.entry((kind, name)).or_insert(place);
        self.refer(place, first);
    }

    /// All that was taken down.
    pub(super) fn finish(mut self) -> References {
        self.uses.sort_unstable();
        // A second definition names itself too, but what counts is the first thing that a place was
        // found to mean.
        self.uses.dedup_by_key(|(place, _)| *place);
        let mut places: Vec<(Span, Span)> = self
            .uses
            .iter()
            .map(|&(place, declaration)| (declaration, place))
            .collect();
        places.sort_unstable();
        References {
            uses: self.uses,
            places,
        }
    }
}
