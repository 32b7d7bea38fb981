//! Declarations: what is declared at a place, and how a file is made up of them.

use lsp_types::{DocumentSymbol, FoldingRange, FoldingRangeKind, SymbolKind};

use crate::lang::lexer::{Comments, Lexer, TokenKind as T};
use crate::lang::tree::{self, FrameContent, Given, Name, State, StateKind};
use crate::model::Span;

use super::sets::{Set, end_of_item};

/// How many declarations of one kind in one body are outlined.
const MAX_SYMBOLS: usize = 1_000;

/// How many bodies and comments can be folded.
const MAX_FOLDS: usize = 20_000;

/// What a name is declared as.
#[derive(Clone, Copy)]
pub(super) enum Declared<'t> {
    Slot(&'t tree::Slot),
    Link(&'t tree::Link),
    Frame(&'t tree::Frame),
    Task(&'t tree::Task),
    Container(&'t tree::Container),
    Region(&'t tree::Region),
    /// With its region.
    State(&'t State, &'t tree::Region),
    Event(&'t tree::Event),
    Flag(&'t tree::Flag),
    Data(&'t tree::DataPort),
    Param(&'t tree::Param),
}

impl Declared<'_> {
    /// Where the declaration starts, where that is not just before its name.
    pub(super) fn start(&self) -> Option<u32> {
        Some(match self {
            Declared::Slot(slot) => slot.span.start,
            Declared::Link(link) => link.span.start,
            Declared::Frame(frame) => frame.span.start,
            Declared::Task(task) => task.span.start,
            Declared::Container(container) => container.span.start,
            Declared::Region(region) => region.span.start,
            Declared::State(state, _) => state.span.start,
            Declared::Flag(flag) => flag.span.start,
            Declared::Data(port) => port.span.start,
            Declared::Param(param) => param.span.start,
            Declared::Event(_) => return None,
        })
    }

    /// The `///` lines before it.
    pub(super) fn docs(&self) -> Option<Span> {
        match self {
            Declared::Slot(slot) => slot.docs,
            Declared::Link(link) => link.docs,
            Declared::Frame(frame) => frame.docs,
            Declared::Task(task) => task.docs,
            Declared::Container(container) => container.docs,
            Declared::Region(region) => region.docs,
            Declared::State(state, _) => state.docs,
            Declared::Event(event) => event.docs,
            Declared::Flag(flag) => flag.docs,
            Declared::Data(port) => port.docs,
            Declared::Param(param) => param.docs,
        }
    }
}

/// What is declared with the name at a span; nothing for types of data and groups, which have no
/// declaration.
pub(super) fn declared(file: &tree::File, span: Span) -> Option<Declared<'_>> {
    let is = |name: Option<Name>| name == Some(Name(span));
    let number = |number: Option<tree::Number>| number.is_some_and(|number| number.span == span);
    if let Some(slot) = file.slots.iter().find(|slot| number(slot.number)) {
        return Some(Declared::Slot(slot));
    }
    if let Some(link) = file.links.iter().find(|link| is(link.name)) {
        return Some(Declared::Link(link));
    }
    for frame in &file.frames {
        let is_flag = match &frame.content {
            Given::Value(FrameContent::Flags(flags)) => flags.iter().any(|flag| is(Some(*flag))),
            _ => false,
        };
        if is_flag || is(frame.name) {
            return Some(Declared::Frame(frame));
        }
    }
    for task in &file.tasks {
        if is(task.name) {
            return Some(Declared::Task(task));
        }
        if let Some(found) = port(&task.flags, &task.data, span) {
            return Some(found);
        }
        if let Some(param) = task.params.iter().find(|param| is(param.name)) {
            return Some(Declared::Param(param));
        }
    }
    for container in &file.containers {
        if is(container.name) {
            return Some(Declared::Container(container));
        }
        if let Some(found) = port(&container.flags, &container.data, span) {
            return Some(found);
        }
        if let Some(event) = container.events.iter().find(|event| is(event.name)) {
            return Some(Declared::Event(event));
        }
        for region in &container.regions {
            if is(region.name) {
                return Some(Declared::Region(region));
            }
            if let Some(state) = region.states.iter().find(|state| is(state.name)) {
                return Some(Declared::State(state, region));
            }
        }
    }
    None
}

fn port<'t>(
    flags: &'t [tree::Flag],
    data: &'t [tree::DataPort],
    span: Span,
) -> Option<Declared<'t>> {
    let is = |name: Option<Name>| name == Some(Name(span));
    let flag = flags.iter().find(|flag| is(flag.name)).map(Declared::Flag);
    flag.or_else(|| data.iter().find(|port| is(port.name)).map(Declared::Data))
}

/// The declarations of a file, those with a body with what is in it.
pub(super) fn symbols(set: &Set, file: u32) -> Vec<DocumentSymbol> {
    let Some(tree) = set.checked.trees().get(file as usize) else {
        return Vec::new();
    };
    let mut symbols: Vec<DocumentSymbol> = Vec::new();
    let tasks = tree.tasks.iter().take(MAX_SYMBOLS).filter_map(|task| {
        let mut inside = ports(set, &task.flags, &task.data);
        inside.extend(task.params.iter().take(MAX_SYMBOLS).filter_map(|param| {
            symbol(set, param.name?, param.span, SymbolKind::CONSTANT, "param")
        }));
        with_body(
            set,
            task.name?,
            task.span,
            SymbolKind::FUNCTION,
            "task",
            inside,
        )
    });
    symbols.extend(tasks);
    let containers = tree
        .containers
        .iter()
        .take(MAX_SYMBOLS)
        .filter_map(|container| {
            let mut inside: Vec<DocumentSymbol> = container
                .events
                .iter()
                .take(MAX_SYMBOLS)
                .filter_map(|event| {
                    let name = event.name?;
                    symbol(set, name, name.0, SymbolKind::EVENT, "event")
                })
                .collect();
            inside.extend(ports(set, &container.flags, &container.data));
            inside.extend(
                container
                    .regions
                    .iter()
                    .take(MAX_SYMBOLS)
                    .filter_map(|region| {
                        let states = region.states.iter().take(MAX_SYMBOLS).filter_map(|state| {
                            let (kind, word) = match state.kind {
                                StateKind::Simple => (SymbolKind::ENUM_MEMBER, "state"),
                                StateKind::Task { .. } => (SymbolKind::FUNCTION, "task state"),
                                StateKind::Super { .. } => (SymbolKind::CLASS, "superstate"),
                            };
                            symbol(set, state.name?, state.span, kind, word)
                        });
                        with_body(
                            set,
                            region.name?,
                            region.span,
                            SymbolKind::NAMESPACE,
                            "region",
                            states.collect(),
                        )
                    }),
            );
            let (kind, word) = if container.is_machine {
                (SymbolKind::MODULE, "machine")
            } else {
                (SymbolKind::CLASS, "container")
            };
            with_body(set, container.name?, container.span, kind, word, inside)
        });
    symbols.extend(containers);
    let slots = tree.slots.iter().take(MAX_SYMBOLS).filter_map(|slot| {
        let number = Name(slot.number?.span);
        symbol(set, number, slot.span, SymbolKind::NUMBER, "slot")
    });
    symbols.extend(slots);
    let links = tree.links.iter().take(MAX_SYMBOLS);
    let links =
        links.filter_map(|link| symbol(set, link.name?, link.span, SymbolKind::INTERFACE, "link"));
    symbols.extend(links);
    let frames = tree.frames.iter().take(MAX_SYMBOLS);
    let frames = frames
        .filter_map(|frame| symbol(set, frame.name?, frame.span, SymbolKind::STRUCT, "frame"));
    symbols.extend(frames);
    symbols.sort_by_key(|symbol| symbol.range.start);
    symbols
}

fn ports(set: &Set, flags: &[tree::Flag], data: &[tree::DataPort]) -> Vec<DocumentSymbol> {
    let flags = flags
        .iter()
        .take(MAX_SYMBOLS)
        .filter_map(|flag| symbol(set, flag.name?, flag.span, SymbolKind::BOOLEAN, "flag"));
    let data = data
        .iter()
        .take(MAX_SYMBOLS)
        .filter_map(|port| symbol(set, port.name?, port.span, SymbolKind::FIELD, "data"));
    flags.chain(data).collect()
}

/// A symbol whose declaration has a body.
fn with_body(
    set: &Set,
    name: Name,
    span: Span,
    kind: SymbolKind,
    detail: &str,
    children: Vec<DocumentSymbol>,
) -> Option<DocumentSymbol> {
    let end = end_of_item(set.file_text(span.file), span.start);
    let whole = Span { end, ..span };
    let mut symbol = symbol(set, name, whole, kind, detail)?;
    symbol.children = Some(children);
    Some(symbol)
}

#[allow(
    deprecated,
    reason = "the protocol's type has a field that it no longer uses"
)]
fn symbol(
    set: &Set,
    name: Name,
    span: Span,
    kind: SymbolKind,
    detail: &str,
) -> Option<DocumentSymbol> {
    let text = set.text(span.file)?;
    let label = match detail {
        "slot" => format!("slot {}", set.source(name.0)),
        _ => set.source(name.0).to_owned(),
    };
    // The protocol wants the name inside the whole.
    let (start, end) = (span.start.min(name.0.start), span.end.max(name.0.end));
    Some(DocumentSymbol {
        // An empty name is refused by some editors.
        name: if label.is_empty() {
            "?".to_owned()
        } else {
            label
        },
        detail: Some(detail.to_owned()),
        kind,
        tags: None,
        deprecated: None,
        range: text.range(start, end),
        selection_range: text.range(name.0.start, name.0.end),
        children: None,
    })
}

/// Bodies and runs of comments, which an editor can fold.
pub(super) fn folding(set: &Set, file: u32) -> Vec<FoldingRange> {
    let (Some(lines), source) = (set.text(file), set.file_text(file)) else {
        return Vec::new();
    };
    let line = |offset: usize| lines.position(offset).line;
    let mut ranges = Vec::new();
    let mut add = |start_line: u32, end_line: u32, kind: Option<FoldingRangeKind>| {
        if end_line > start_line {
            ranges.push(FoldingRange {
                start_line,
                end_line,
                kind,
                ..FoldingRange::default()
            });
        }
    };
    let mut open = Vec::new();
    let mut lexer = Lexer::new(source);
    let mut gap_start = 0;
    loop {
        let token = lexer.next_token();
        let gap = source.get(gap_start..token.start as usize).unwrap_or("");
        let comments: Vec<_> = Comments::new(gap).collect();
        if let (Some(first), Some(last)) = (comments.first(), comments.last()) {
            let end = gap_start + last.start + last.text.len();
            let kind = Some(FoldingRangeKind::Comment);
            add(line(gap_start + first.start), line(end), kind);
        }
        gap_start = token.end as usize;
        match token.kind {
            T::EndOfFile => break,
            T::BraceOpen => open.push(line(token.start as usize)),
            T::BraceClose => {
                if let Some(start) = open.pop() {
                    // The closing brace stays to be seen.
                    add(start, line(token.start as usize).saturating_sub(1), None);
                }
            }
            _ => {}
        }
    }
    ranges.sort_by_key(|range| (range.start_line, range.end_line));
    ranges.truncate(MAX_FOLDS);
    ranges
}
