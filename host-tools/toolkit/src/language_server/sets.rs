//! Sets of files as the front end sees them, with open texts over those on disk.

use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::Duration;

pub(super) use crate::lang::cure::end_of_item;
use crate::lang::{self, Checked, Code, Overlay, Store as _};
use crate::model::Span;
use crate::schedule::{Limit, Now, Outcome};

use super::text::{Encoding, Text};
use super::uri;

/// How long start times of slots are searched for. Where that does not suffice nothing is said
/// about them.
const LAY_OUT_LIMIT: Duration = Duration::from_millis(200);

/// A file that an editor has open.
#[derive(Debug)]
pub(super) struct Document {
    /// As the editor named it.
    pub(super) uri: String,
    /// Where it lies, if it is a file.
    pub(super) path: Option<PathBuf>,
    pub(super) version: i32,
    pub(super) text: Text,
}

/// What an editor has open, by what tells files apart; the URI stands for what is no file.
pub(super) type Documents = BTreeMap<String, Document>;

/// A set of files, checked, and its places as the editor counts them.
pub(super) struct Set {
    pub(super) checked: Checked,
    /// What tells each file from others.
    pub(super) identities: Vec<String>,
    texts: Vec<OnceCell<Text>>,
    pub(super) encoding: Encoding,
}

impl Set {
    /// Checks the set of files that starts with an open one.
    pub(super) fn of_document(
        identity: &str,
        document: &Document,
        files: &Overlay<'_>,
        encoding: Encoding,
    ) -> Self {
        match &document.path {
            Some(path) => Self::of_path(path, files, encoding),
            None => None,
        }
        .unwrap_or_else(|| {
            // What is no file uses none.
            let checked = lang::load_text(&document.uri, document.text.as_str());
            Self::new(checked, vec![identity.to_owned()], encoding)
        })
    }

    /// Checks the set of files that starts with a path; none if that cannot be read.
    pub(super) fn of_path(path: &Path, files: &Overlay<'_>, encoding: Encoding) -> Option<Self> {
        let checked = lang::load_from(&path.to_string_lossy(), files).ok()?;
        let identities = checked
            .files
            .iter()
            .map(|file| files.identity(&file.path))
            .collect();
        Some(Self::new(checked, identities, encoding))
    }

    pub(super) fn new(checked: Checked, identities: Vec<String>, encoding: Encoding) -> Self {
        Set {
            texts: identities.iter().map(|_| OnceCell::new()).collect(),
            checked,
            identities,
            encoding,
        }
    }

    /// Adds what there is to say about start times of the slots, where that is found out soon.
    pub(super) fn lay_out(&mut self, now: Now) {
        let limit = Limit::new(LAY_OUT_LIMIT, now);
        if !self.checked.has_errors() && self.checked.solve_slots(limit) == Some(Outcome::Undecided)
        {
            // A longer search may find them: `esm check` says.
            let diagnostics = &mut self.checked.diagnostics;
            diagnostics.retain(|diagnostic| diagnostic.code != Code::E011);
        }
    }

    /// The index of a file in the set.
    pub(super) fn file(&self, identity: &str) -> Option<u32> {
        self.identities
            .iter()
            .position(|other| other == identity)
            .map(|index| index as u32)
    }

    /// The text of a file of the set.
    pub(super) fn text(&self, file: u32) -> Option<&Text> {
        let source = self.checked.files.get(file as usize)?;
        let cell = self.texts.get(file as usize)?;
        Some(cell.get_or_init(|| Text::new(source.text.clone(), self.encoding)))
    }

    /// What a span covers.
    pub(super) fn source(&self, span: Span) -> &str {
        self.checked
            .files
            .get(span.file as usize)
            .and_then(|file| file.text.get(span.start as usize..span.end as usize))
            .unwrap_or("")
    }

    /// The text of a file of the set as a string.
    pub(super) fn file_text(&self, file: u32) -> &str {
        self.checked
            .files
            .get(file as usize)
            .map_or("", |file| file.text.as_str())
    }

    /// Where a span is: the identity of the file, and the range there.
    pub(super) fn range(&self, span: Span) -> Option<(&str, lsp_types::Range)> {
        let identity = self.identities.get(span.file as usize)?;
        Some((identity, self.text(span.file)?.range(span.start, span.end)))
    }

    /// All places that mean the same as a declaration. For an event these are its places in every
    /// container through which it goes.
    pub(super) fn places(&self, declaration: Span) -> Vec<Span> {
        let references = self.checked.references();
        let mut declarations = self.joined_events(declaration);
        declarations.insert(declaration);
        let mut places: Vec<Span> = declarations
            .into_iter()
            .flat_map(|declaration| references.of(declaration))
            .collect();
        places.sort_unstable();
        places.dedup();
        places
    }

    /// The declarations of the event in the containers that it reaches from that of `declaration`,
    /// up and down; nothing for what is no event.
    fn joined_events(&self, declaration: Span) -> BTreeSet<Span> {
        let containers: Vec<_> = self
            .checked
            .trees()
            .iter()
            .flat_map(|file| &file.containers)
            .collect();
        let name = self.source(declaration);
        // Per container, where it declares an event of this name, and whether that is forwarded.
        let listings: Vec<Vec<(Span, bool)>> = containers
            .iter()
            .map(|container| {
                let events = container.events.iter();
                events
                    .filter_map(|event| {
                        let is_forwarded = event.listing != lang::tree::EventListing::Local;
                        Some((event.name?.0, is_forwarded))
                    })
                    .filter(|(span, _)| self.source(*span) == name)
                    .collect()
            })
            .collect();
        let home = listings
            .iter()
            .position(|listing| listing.iter().any(|(span, _)| *span == declaration));
        let Some(home) = home else {
            return BTreeSet::new();
        };
        let by_name: BTreeMap<Span, usize> = containers
            .iter()
            .enumerate()
            .filter_map(|(index, container)| Some((container.name?.0, index)))
            .collect();
        // An event goes between a container and one inside it if the inner one forwards it.
        let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); containers.len()];
        for (outside, container) in containers.iter().enumerate() {
            for state in container.regions.iter().flat_map(|region| &region.states) {
                let lang::tree::StateKind::Super {
                    container: Some(name),
                } = &state.kind
                else {
                    continue;
                };
                let inside = self
                    .checked
                    .references()
                    .at(name.0.file, name.0.start)
                    .and_then(|(_, declaration)| by_name.get(&declaration).copied());
                if let Some(inside) = inside
                    && listings
                        .get(inside)
                        .is_some_and(|listing| listing.iter().any(|(_, forwarded)| *forwarded))
                {
                    if let Some(list) = neighbours.get_mut(outside) {
                        list.push(inside);
                    }
                    if let Some(list) = neighbours.get_mut(inside) {
                        list.push(outside);
                    }
                }
            }
        }
        let mut reached = vec![false; containers.len()];
        let mut to_visit = vec![home];
        let mut declarations = BTreeSet::new();
        while let Some(index) = to_visit.pop() {
            let Some(is_reached) = reached.get_mut(index) else {
                continue;
            };
            if std::mem::replace(is_reached, true) {
                continue;
            }
            let listing = listings.get(index).into_iter().flatten();
            declarations.extend(listing.map(|(span, _)| *span));
            to_visit.extend(neighbours.get(index).into_iter().flatten());
        }
        declarations
    }
}

/// The URI of a file: as the editor named it, if it is open.
pub(super) fn uri_of(identity: &str, documents: &Documents) -> String {
    documents.get(identity).map_or_else(
        || uri::of_path(Path::new(identity)),
        |document| document.uri.clone(),
    )
}
