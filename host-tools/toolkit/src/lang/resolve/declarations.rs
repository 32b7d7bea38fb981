//! The files whose declarations are resolved, and what tasks and containers both declare.

use super::scope::{Names, Scope};
use crate::lang::cure::remove_item;
use crate::lang::diagnostic::Fix;
use crate::lang::references::Undeclared;
use crate::lang::tree::{self, File};
use crate::model::{DataPort, Direction, Flag, SourceFile, Span};

/// A file of the set as the loader hands it over.
pub(in crate::lang) struct Trees<'f> {
    /// The files.
    pub(in crate::lang) files: &'f [SourceFile],
    /// The tree of each.
    pub(in crate::lang) trees: &'f [File],
    /// Whether a file of the set could not be read, or not rightly.
    pub(in crate::lang) lacks_files: bool,
}

impl<'f> Trees<'f> {
    /// The tasks of all files.
    pub(super) fn tasks(&self) -> impl Iterator<Item = &'f tree::Task> + use<'f> {
        self.trees.iter().flat_map(|file| &file.tasks)
    }

    /// The links of all files.
    pub(super) fn links(&self) -> impl Iterator<Item = &'f tree::Link> + use<'f> {
        self.trees.iter().flat_map(|file| &file.links)
    }

    /// The frames of all files.
    pub(super) fn frames(&self) -> impl Iterator<Item = &'f tree::Frame> + use<'f> {
        self.trees.iter().flat_map(|file| &file.frames)
    }

    /// The containers and machines of all files.
    pub(super) fn containers(&self) -> impl Iterator<Item = &'f tree::Container> + use<'f> {
        self.trees.iter().flat_map(|file| &file.containers)
    }

    /// The states of all of these.
    pub(super) fn states(&self) -> impl Iterator<Item = &'f tree::State> + use<'f> {
        self.containers()
            .flat_map(|container| &container.regions)
            .flat_map(|region| &region.states)
    }

    /// Whether declarations may be missing: then no task, container or slot is unknown for certain.
    pub(super) fn is_incomplete(&self) -> bool {
        self.lacks_files || self.trees.iter().any(|file| file.is_cut)
    }
}

/// The fix that removes a declaration or statement.
pub(super) fn remove(title: &str, span: Span, names: &Names<'_, '_>) -> Fix {
    Fix::one(title, remove_item(names.file_text(span), span))
}

/// Declares flags; gives them with their directions, which are `None` where they could not be read.
pub(super) fn declare_flags<'f>(
    trees: &[tree::Flag],
    scope: &mut Scope<'f>,
    names: &mut Names<'f, '_>,
) -> (Vec<Flag>, Vec<Option<Direction>>) {
    trees
        .iter()
        .enumerate()
        .map(|(index, flag)| {
            names.declare(scope, flag.name, index, "flag");
            let name = flag.name.map_or("", |name| names.text(name.0));
            let model = Flag {
                name: name.to_owned(),
                direction: flag.direction.unwrap_or(Direction::In),
                docs: names.docs(flag.docs),
                span: flag.span,
            };
            (model, flag.direction)
        })
        .unzip()
}

/// Declares data ports. A type that could not be read is the empty name.
pub(super) fn declare_data<'f>(
    trees: &[tree::DataPort],
    scope: &mut Scope<'f>,
    names: &mut Names<'f, '_>,
) -> Vec<DataPort> {
    trees
        .iter()
        .enumerate()
        .map(|(index, port)| {
            names.declare(scope, port.name, index, "data port");
            names.mention(Undeclared::Type, port.type_name);
            let text = |name: Option<tree::Name>| name.map_or("", |name| names.text(name.0));
            DataPort {
                name: text(port.name).to_owned(),
                direction: port.direction,
                type_name: text(port.type_name).to_owned(),
                optional: port.optional,
                within_us: port.within_us.value(),
                docs: names.docs(port.docs),
                span: port.span,
            }
        })
        .collect()
}
