//! Name spaces: what a name stands for, and what it may have been meant to be.

use std::collections::{HashMap, HashSet};

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Sink};
use crate::lang::lexer::{Lexer, docs_text};
use crate::lang::references::{Record, References, Undeclared};
use crate::lang::tree::Name;
use crate::model::{SourceFile, Span};
use crate::nearest::nearest;

/// One name space: each name stands for an index, the first that was declared.
#[derive(Debug, Default)]
pub(super) struct Scope<'f> {
    /// Index and place of each declared name; `None` for names in what was skipped.
    names: HashMap<&'f str, Option<(usize, Span)>>,
    /// Declared names in order, to propose.
    in_order: Vec<&'f str>,
    /// Something in it could not be read, so nothing is unknown for certain.
    is_incomplete: bool,
}

/// What a look-up came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The index that was declared.
    Index(usize),
    /// It may exist: what declares it could not be read.
    Perhaps,
    /// It does not exist.
    Nothing,
}

impl<'f> Scope<'f> {
    /// Adds a name. One that is there already keeps its meaning, and its first place is given back.
    pub(super) fn declare(&mut self, name: &'f str, span: Span, index: usize) -> Result<(), Span> {
        match self.names.get(name) {
            Some(Some((_, first))) => Err(*first),
            _ => {
                self.names.insert(name, Some((index, span)));
                self.in_order.push(name);
                Ok(())
            }
        }
    }

    /// Marks that something in this scope has a name that could not be read.
    pub(super) fn is_incomplete(&mut self) {
        self.is_incomplete = true;
    }

    /// Takes in what was skipped of the body whose names these are.
    pub(super) fn may_hide(&mut self, names: &Names<'f, '_>, skipped: &[Name], is_cut: bool) {
        for name in skipped {
            self.names.entry(names.text(name.0)).or_insert(None);
        }
        self.is_incomplete |= is_cut;
    }

    pub(super) fn find(&self, name: &str) -> Found {
        match self.names.get(name) {
            Some(Some((index, _))) => Found::Index(*index),
            Some(None) => Found::Perhaps,
            None if self.is_incomplete => Found::Perhaps,
            None => Found::Nothing,
        }
    }

    /// Where `name` is declared.
    fn place(&self, name: &str) -> Option<Span> {
        self.names
            .get(name)
            .copied()
            .flatten()
            .map(|(_, place)| place)
    }

    /// Whether `name` is declared here and stands for `index`, not for an earlier one.
    pub(super) fn is_first(&self, name: &str, index: usize) -> bool {
        self.find(name) == Found::Index(index)
    }

    /// The declared names, in order.
    pub(super) fn names(&self) -> &[&'f str] {
        &self.in_order
    }
}

/// How many names may be compared in all to find what was meant: enough for every text that a
/// person wrote, and a bound for those that nobody did.
const MAX_COMPARISONS: usize = 5_000_000;

/// Texts of names, and reports on them.
#[derive(Debug)]
pub(super) struct Names<'f, 's> {
    files: &'f [SourceFile],
    sink: &'s mut Sink,
    references: Record<'f>,
    comparisons: usize,
    /// Numbers of slots that were reported as unknown.
    unknown_slots: HashSet<u32>,
}

impl<'f, 's> Names<'f, 's> {
    pub(super) fn new(files: &'f [SourceFile], sink: &'s mut Sink) -> Self {
        Names {
            files,
            sink,
            references: Record::default(),
            comparisons: 0,
            unknown_slots: HashSet::new(),
        }
    }

    /// The text of the file in which a span lies.
    pub(super) fn file_text(&self, span: Span) -> &'f str {
        self.files
            .get(span.file as usize)
            .map_or("", |file| file.text.as_str())
    }

    /// The text that a span covers.
    pub(super) fn text(&self, span: Span) -> &'f str {
        self.files
            .get(span.file as usize)
            .and_then(|file| file.text.get(span.start as usize..span.end as usize))
            .unwrap_or("")
    }

    /// What the `///` lines at a place say.
    pub(super) fn docs(&self, lines: Option<Span>) -> String {
        lines.map_or_else(String::new, |lines| docs_text(self.text(lines)))
    }

    /// Takes down that `place` names what is declared at `declaration`.
    pub(super) fn refer(&mut self, place: Span, declaration: Span) {
        self.references.refer(place, declaration);
    }

    /// Takes down that a name means what it stands for in a scope. Of a flag that comes with a frame
    /// by itself, the frame's name is what it begins with.
    pub(super) fn refer_into(&mut self, scope: &Scope<'f>, name: Name) {
        let text = self.text(name.0);
        let Some(declaration) = scope.place(text) else {
            return;
        };
        let declared = self.text(declaration);
        let behind = text.strip_prefix(declared);
        if behind.is_some_and(|behind| behind.is_empty() || behind.starts_with('_')) {
            let end = name.0.start + declared.len() as u32;
            self.refer(Span { end, ..name.0 }, declaration);
        }
    }

    /// Takes down a name of something that has no declaration.
    pub(super) fn mention(&mut self, kind: Undeclared, name: Option<Name>) {
        if let Some(Name(place)) = name {
            self.references.mention(kind, self.text(place), place);
        }
    }

    /// What was taken down.
    pub(super) fn into_references(self) -> References {
        self.references.finish()
    }

    /// Whether a slot's number was not reported as unknown yet. It counts as reported from then on.
    pub(super) fn is_news(&mut self, slot: u32) -> bool {
        self.unknown_slots.insert(slot)
    }

    /// Whether so many errors were found that another one would not be shown.
    pub(super) fn omits_error(&mut self) -> bool {
        self.sink.omits_error()
    }

    pub(super) fn report(&mut self, diagnostic: Diagnostic) {
        self.sink.push(diagnostic);
    }

    /// Declares a name that was read, and reports one that is there already. `what` is the kind of
    /// thing, as in "state".
    pub(super) fn declare(
        &mut self,
        scope: &mut Scope<'f>,
        name: Option<Name>,
        index: usize,
        what: &str,
    ) {
        let Some(Name(span)) = name else {
            return scope.is_incomplete();
        };
        let text = self.text(span);
        self.refer(span, span);
        if let Err(first) = scope.declare(text, span, index) {
            self.defined_twice(what, text, span, first);
        }
    }

    /// Reports a second definition.
    pub(super) fn defined_twice(&mut self, what: &str, name: &str, second: Span, first: Span) {
        self.report(
            Diagnostic::new(
                Code::E003,
                second,
                format!("{what} `{name}` is defined twice"),
            )
            .hint("give the second one another name or remove it")
            .related(first, "first defined here"),
        );
    }

    /// The index of a name that must be in a scope. An unknown one is reported with the nearest
    /// name of the scope, or, where none is near, with `otherwise`.
    pub(super) fn resolve<C: Into<Cure>>(
        &mut self,
        scope: &Scope<'f>,
        name: Name,
        what: &str,
        otherwise: impl FnOnce(&str) -> C,
    ) -> Option<usize> {
        self.resolve_or(scope, name, what, |text, names| {
            names.meant(text, scope.names()).map_or_else(
                || otherwise(text).into(),
                |meant| Cure::meant(name.0, meant),
            )
        })
    }

    /// The index of a name that must be in a scope. An unknown one is reported with the cure that
    /// is given for it.
    pub(super) fn resolve_or(
        &mut self,
        scope: &Scope<'f>,
        name: Name,
        what: &str,
        cure: impl FnOnce(&str, &mut Self) -> Cure,
    ) -> Option<usize> {
        let text = self.text(name.0);
        match scope.find(text) {
            Found::Index(index) => {
                self.refer_into(scope, name);
                Some(index)
            }
            Found::Perhaps => None,
            Found::Nothing => {
                let cure = cure(text, self);
                self.unknown(name, what, cure);
                None
            }
        }
    }

    /// Reports an unknown name. Of a word that cannot be a name that is reported already.
    pub(super) fn unknown(&mut self, name: Name, what: &str, cure: impl Into<Cure>) {
        self.unknown_related(name, what, cure, None);
    }

    /// As [`Names::unknown`], with another place that has to do with it.
    pub(super) fn unknown_related(
        &mut self,
        name: Name,
        what: &str,
        cure: impl Into<Cure>,
        related: Option<(Span, &str)>,
    ) {
        let text = self.text(name.0);
        if Lexer::new(text).next_token().kind.is_no_name() {
            return;
        }
        let cure = cure.into();
        let mut diagnostic =
            Diagnostic::new(Code::E002, name.0, format!("unknown {what} `{text}`"));
        if let Some(hint) = cure.hint {
            diagnostic = diagnostic.hint(hint);
        }
        if let Some((place, why)) = related {
            diagnostic = diagnostic.related(place, why);
        }
        diagnostic.fixes = cure.fixes;
        self.report(diagnostic);
    }

    /// The name that was probably meant.
    pub(super) fn meant<'n>(&mut self, text: &str, names: &[&'n str]) -> Option<&'n str> {
        self.comparisons = self.comparisons.saturating_add(names.len());
        if self.comparisons > MAX_COMPARISONS {
            return None;
        }
        let other_case = names.iter().find(|name| name.eq_ignore_ascii_case(text));
        if other_case.is_some() {
            return other_case.copied();
        }
        nearest(text, names.iter().copied())
    }
}
