//! What can stand where the cursor is.
//!
//! The file is read up to the cursor, token by token, and that is enough to know the body and the
//! statement in which it stands; the rest of the file may be in any state. What the names stand for
//! comes from the tree, which has all that could be read.

use std::collections::BTreeSet;

use lsp_types::{
    CompletionItem, CompletionItemKind as Kind, Documentation, MarkupContent, MarkupKind,
};

use crate::lang::lexer::{Lexer, Token, TokenKind as T, docs_text};
use crate::lang::tree::{self, FrameContent, Given, Name, State, StateKind};
use crate::model::{Direction, Span};

use super::sets::Set;

/// The body in which the cursor stands.
#[derive(Clone, Copy)]
struct Open {
    /// `task`, `container`, `machine` or `region`.
    word: T,
    /// Where its word starts.
    start: u32,
}

/// What can stand at a byte of a file.
pub(super) fn at(set: &Set, file: u32, offset: u32) -> Vec<CompletionItem> {
    let source = set.file_text(file);
    let mut bodies: Vec<Open> = Vec::new();
    let mut statement: Vec<Token> = Vec::new();
    let mut lexer = Lexer::new(source);
    loop {
        let token = lexer.next_token();
        // A word that the cursor stands in or behind is being written.
        let is_being_written =
            token.end >= offset && (token.kind == T::Identifier || token.kind.is_reserved());
        if token.kind == T::EndOfFile || token.start >= offset || is_being_written {
            break;
        }
        if token.kind == T::UnclosedComment || token.kind == T::UnclosedText {
            return Vec::new();
        }
        let last = statement.last().map(|token| token.kind);
        statement.push(token);
        match token.kind {
            T::Semicolon => statement.clear(),
            T::BraceOpen if last != Some(T::With) => {
                if let Some(first) = statement.first() {
                    bodies.push(Open {
                        word: first.kind,
                        start: first.start,
                    });
                }
                statement.clear();
            }
            T::BraceClose if !statement.iter().any(|token| token.kind == T::With) => {
                bodies.pop();
                statement.clear();
            }
            _ => {}
        }
    }
    if is_in_comment(source, &statement, offset) {
        return Vec::new();
    }
    let context = Context::new(set, file, &bodies, &statement);
    let mut items = Items::default();
    context.complete(&mut items);
    items.list
}

/// Whether the cursor stands in a comment: behind the last token, a `//` without the end of its
/// line or a `/*` without its own.
fn is_in_comment(source: &str, statement: &[Token], offset: u32) -> bool {
    let from = statement.last().map_or_else(
        || source.get(..offset as usize).map_or(0, line_start),
        |token| token.end as usize,
    );
    let gap = source.get(from..offset as usize).unwrap_or("");
    let line = gap.get(line_start(gap)..).unwrap_or("");
    line.contains("//") || gap.rfind("/*") > gap.rfind("*/")
}

fn line_start(text: &str) -> usize {
    text.rfind('\n').map_or(0, |at| at + 1)
}

/// How many proposals are made.
const MAX_PROPOSALS: usize = 2_000;

/// Proposals, each label once.
#[derive(Default)]
struct Items {
    list: Vec<CompletionItem>,
    labels: BTreeSet<String>,
}

impl Items {
    fn add(&mut self, label: impl Into<String>, kind: Kind, detail: &str) {
        let label = label.into();
        if self.list.len() < MAX_PROPOSALS && !label.is_empty() && self.labels.insert(label.clone())
        {
            self.list.push(CompletionItem {
                label,
                kind: Some(kind),
                detail: Some(detail.to_owned()),
                ..CompletionItem::default()
            });
        }
    }

    /// As [`Items::add`], with what the `///` lines say of it.
    fn add_described(
        &mut self,
        label: impl Into<String>,
        kind: Kind,
        detail: &str,
        docs: Option<String>,
    ) {
        let before = self.list.len();
        self.add(label, kind, detail);
        if let (Some(item), Some(docs)) = (self.list.get_mut(before), docs) {
            item.documentation = Some(Documentation::MarkupContent(MarkupContent {
                kind: MarkupKind::Markdown,
                value: docs,
            }));
        }
    }

    fn words(&mut self, words: &[&str]) {
        for word in words {
            self.add(*word, Kind::KEYWORD, "word of the language");
        }
    }
}

/// What has flags and data ports.
#[derive(Clone, Copy)]
struct Ports<'t> {
    flags: &'t [tree::Flag],
    data: &'t [tree::DataPort],
}

struct Context<'c> {
    set: &'c Set,
    file: u32,
    /// Kinds of the tokens of the statement before the cursor.
    kinds: Vec<T>,
    tokens: &'c [Token],
    body: Option<T>,
    container: Option<&'c tree::Container>,
    region: Option<&'c tree::Region>,
}

impl<'c> Context<'c> {
    fn new(set: &'c Set, file: u32, bodies: &[Open], tokens: &'c [Token]) -> Self {
        let tree = set.checked.trees().get(file as usize);
        let start_of = |words: &[T]| {
            let mut open = bodies.iter().rev();
            open.find(|open| words.contains(&open.word))
                .map(|open| open.start)
        };
        let container = start_of(&[T::Container, T::Machine]).and_then(|start| {
            let mut containers = tree?.containers.iter();
            containers.find(|container| container.span.start == start)
        });
        let region = start_of(&[T::Region]).and_then(|start| {
            let mut regions = container?.regions.iter();
            regions.find(|region| region.span.start == start)
        });
        Context {
            set,
            file,
            kinds: tokens.iter().map(|token| token.kind).collect(),
            tokens,
            body: bodies.last().map(|open| open.word),
            container,
            region,
        }
    }

    fn complete(&self, items: &mut Items) {
        match self.body {
            None => self.in_file(items),
            Some(T::Task) => self.in_task(items),
            Some(T::Region) => self.in_region(items),
            Some(T::Container | T::Machine) => self.in_container(items),
            Some(_) => {}
        }
    }

    fn in_file(&self, items: &mut Items) {
        match self.kinds.as_slice() {
            [] => items.words(&[
                "use",
                "interpreter",
                "queue",
                "slot",
                "task",
                "container",
                "machine",
                "link",
                "frame",
            ]),
            [T::Link, T::Identifier] => items.words(&["rate"]),
            [T::Link, .., T::Integer] if self.word(-2) == Some("rate") => items.words(&["bps"]),
            [T::Link, .., T::Integer] if self.word(-2) == Some("header") => {
                items.words(&["bytes"]);
            }
            [T::Link, .., T::Integer] if self.word(-2) == Some("gap") => {
                items.words(&["us", "ms", "s"]);
            }
            [T::Link, _, _, ..] => items.words(&["header", "gap", "bits"]),
            [T::Frame, T::Identifier, T::Integer] => items.words(&["in", "out"]),
            [T::Frame, .., T::In | T::Out] => items.words(&["on"]),
            [T::Frame, .., T::On] => {
                for link in self.links() {
                    if let Some(name) = link.name {
                        let docs = self.docs(link.docs);
                        items.add_described(self.text(name), Kind::INTERFACE, "link", docs);
                    }
                }
            }
            [T::Frame, _, _, _, T::On, T::Identifier] => items.words(&["flags"]),
            [T::Frame, .., T::Integer] if self.word(-2) == Some("payload") => {
                items.words(&["bytes"]);
            }
            [T::Frame, .., T::Integer] if self.word(-2) == Some("rate") => items.words(&["Hz"]),
            [T::Frame, .., T::Integer] => items.words(&["us", "ms", "s"]),
            [T::Frame, _, _, _, T::On, T::Identifier, _, ..] => {
                items.words(&["payload", "period", "rate", "late"]);
            }
            [T::Interpreter] => items.words(&["slot"]),
            [T::Interpreter, T::Slot] => self.slots(items),
            [T::Slot, T::Integer] => items.words(&["period", "rate"]),
            [T::Slot, .., T::Integer] => items.words(&["us", "ms", "s", "Hz"]),
            [T::Slot, .., T::Identifier]
                if self.word(-1) != Some("period") && self.word(-1) != Some("rate") =>
            {
                items.words(&["duration"]);
            }
            [T::Task, .., T::Slot] => {
                self.slots(items);
                items.add("0", Kind::VALUE, "not real-time");
            }
            [T::Task, .., T::Integer] if self.word(-2) == Some("wcet") => {
                items.words(&["us", "ms", "s"]);
            }
            [T::Task, .., T::Identifier] if self.word(-1) == Some("exclusive") => {
                for task in self.tasks() {
                    if let Some(group) = task.exclusive.value() {
                        items.add(self.text(group), Kind::VALUE, "exclusive group");
                    }
                }
            }
            [T::Task, T::Identifier, ..]
                if !matches!(self.word(-1), Some("wcet" | "count")) || self.kinds.len() == 2 =>
            {
                items.words(&["slot", "wcet", "exclusive", "count", "endless"]);
            }
            _ => {}
        }
    }

    fn in_task(&self, items: &mut Items) {
        match self.kinds.as_slice() {
            [] => items.words(&["in", "out", "inout", "param"]),
            [T::In | T::Out] => items.words(&["data", "flag"]),
            [T::InOut] => items.words(&["data"]),
            [T::Param, T::Identifier, T::Colon] => items.words(&["bool", "i32", "u32", "f32"]),
            [T::Param, T::Identifier, T::Colon, T::Identifier, ..] => {
                items.words(&["min", "max", "true", "false"]);
            }
            _ => self.data_port(items),
        }
    }

    fn data_port(&self, items: &mut Items) {
        // A container's port asks for nothing: that is for the task that reads.
        let is_input = matches!(self.kinds.first(), Some(T::In | T::InOut));
        let takes_within = self.body == Some(T::Task) && is_input;
        match self.kinds.as_slice() {
            [.., T::Data, T::Identifier, T::Colon] => {
                let ports = self
                    .tasks()
                    .flat_map(|task| &task.data)
                    .chain(self.containers().flat_map(|container| &container.data));
                for name in ports.filter_map(|port| port.type_name) {
                    items.add(self.text(name), Kind::STRUCT, "type of data");
                }
            }
            [
                _,
                T::Data,
                T::Identifier,
                T::Colon,
                T::Identifier,
                rest @ ..,
            ] => {
                let given = self.tokens.len() - rest.len();
                let words: Vec<&str> = self.tokens[given..]
                    .iter()
                    .map(|token| self.token_text(*token))
                    .collect();
                match words.as_slice() {
                    [.., "within"] => {}
                    [.., "within", _] => items.words(&["us", "ms", "s"]),
                    words => {
                        if !words.contains(&"optional") {
                            items.words(&["optional"]);
                        }
                        if takes_within && !words.contains(&"within") {
                            items.words(&["within"]);
                        }
                    }
                }
            }
            _ => {}
        }
    }

    fn in_container(&self, items: &mut Items) {
        let is_machine = self.container.is_some_and(|container| container.is_machine);
        match self.kinds.as_slice() {
            [] if is_machine => items.words(&["event", "region", "path"]),
            [] => items.words(&["event", "in", "out", "inout", "region", "path"]),
            [T::In | T::Out] => items.words(&["event", "data", "flag"]),
            [T::InOut] => items.words(&["data"]),
            [T::In | T::Out, T::Event] => {
                let events = self.containers().flat_map(|container| &container.events);
                for name in events.filter_map(|event| event.name) {
                    items.add(self.text(name), Kind::EVENT, "event");
                }
            }
            [T::Path, ..] => self.path_end(items),
            _ => self.data_port(items),
        }
    }

    fn path_end(&self, items: &mut Items) {
        let Some(container) = self.container else {
            return;
        };
        match self.kinds.as_slice() {
            [.., T::Path | T::Comma | T::Arrow] => {
                for port in &container.data {
                    if let Some(name) = port.name {
                        let (docs, detail) = (self.docs(port.docs), "port of this container");
                        items.add_described(self.text(name), Kind::FIELD, detail, docs);
                    }
                }
                for region in &container.regions {
                    for state in &region.states {
                        let (Some(name), Some(ports)) = (state.name, self.ports(state)) else {
                            continue;
                        };
                        items.add(self.text(name), Kind::ENUM_MEMBER, "state");
                        for port in ports.data {
                            if let Some(port_name) = port.name {
                                let end = format!("{}.{}", self.text(name), self.text(port_name));
                                let docs = self.docs(port.docs);
                                items.add_described(end, Kind::FIELD, "port of a state", docs);
                            }
                        }
                    }
                }
            }
            [.., T::Identifier, T::Dot] => {
                let before = self.word(-2).unwrap_or("");
                for region in &container.regions {
                    let is_region = region.name.is_some_and(|name| self.text(name) == before);
                    for state in &region.states {
                        let Some(name) = state.name else {
                            continue;
                        };
                        if is_region {
                            items.add(self.text(name), Kind::ENUM_MEMBER, "state");
                        }
                        if self.text(name) == before {
                            let ports = self.ports(state);
                            for port in ports.into_iter().flat_map(|ports| ports.data) {
                                if let Some(name) = port.name {
                                    let docs = self.docs(port.docs);
                                    let label = self.text(name);
                                    items.add_described(label, Kind::FIELD, "data port", docs);
                                }
                            }
                        }
                    }
                }
            }
            _ => {}
        }
    }

    fn in_region(&self, items: &mut Items) {
        match self.kinds.as_slice() {
            [] => {
                items.words(&["state", "task", "super", "initial"]);
                self.states(items);
            }
            [T::State, ..] | [T::Task, ..] | [T::Super, ..] => self.state(items),
            [T::Identifier | T::Initial, T::Arrow] => {
                items.words(&["final"]);
                self.states(items);
            }
            [T::Identifier | T::Initial, T::Arrow, ..] => self.transition(items),
            [T::Identifier | T::Initial] => items.add("->", Kind::OPERATOR, "to the next state"),
            _ => {}
        }
    }

    fn state(&self, items: &mut Items) {
        let with = self.kinds.iter().position(|kind| *kind == T::With);
        match self.kinds.as_slice() {
            [T::Task, T::Identifier, T::Colon] => {
                for task in self.tasks() {
                    if let Some(name) = task.name {
                        let docs = self.docs(task.docs);
                        items.add_described(self.text(name), Kind::FUNCTION, "task", docs);
                    }
                }
                for link in self.links() {
                    if let Some(name) = link.name {
                        let docs = self.docs(link.docs);
                        items.add_described(self.text(name), Kind::INTERFACE, "link", docs);
                    }
                }
            }
            [T::Task, T::Identifier, T::Colon, T::Identifier, T::Dot] => {
                items.words(&["transmit", "receive"]);
            }
            [T::Super, T::Identifier, T::Colon] => {
                let containers = self.containers().filter(|container| !container.is_machine);
                for container in containers {
                    if let Some(name) = container.name {
                        let docs = self.docs(container.docs);
                        items.add_described(self.text(name), Kind::CLASS, "container", docs);
                    }
                }
            }
            [.., T::Timeout] => {}
            [.., T::Timeout, T::Integer] => items.words(&["us", "ms", "s"]),
            [T::Task, .., T::Slot] => {
                self.slots(items);
                items.add("0", Kind::VALUE, "not real-time");
            }
            [.., T::BraceOpen | T::Comma] if with.is_some() => {
                let task = self.word(3).unwrap_or("");
                let task = self
                    .tasks()
                    .find(|it| it.name.is_some_and(|name| self.text(name) == task));
                for param in task.into_iter().flat_map(|task| &task.params) {
                    if let Some(name) = param.name {
                        let detail = self.set.source(param.span).to_owned();
                        let docs = self.docs(param.docs);
                        items.add_described(self.text(name), Kind::PROPERTY, &detail, docs);
                    }
                }
            }
            [.., T::Equals] => items.words(&["true", "false"]),
            [T::State, T::Identifier, ..] => items.words(&["timeout"]),
            [T::Super, T::Identifier, T::Colon, T::Identifier, ..] => items.words(&["timeout"]),
            [T::Task, T::Identifier, T::Colon, T::Identifier, ..] if with.is_none() => {
                items.words(&["slot", "timeout", "with"]);
            }
            _ => {}
        }
    }

    fn transition(&self, items: &mut Items) {
        let is_guard = self
            .kinds
            .iter()
            .filter(|kind| **kind == T::BracketOpen)
            .count()
            > self
                .kinds
                .iter()
                .filter(|kind| **kind == T::BracketClose)
                .count();
        match self.kinds.as_slice() {
            [.., T::On] => {
                items.words(&["pulse"]);
                items.add("*", Kind::OPERATOR, "when the state has finished");
                self.events(items);
            }
            [.., T::Send] => self.events(items),
            [.., T::Set | T::Clear] => {
                self.flags(self.target(), Direction::In, ".", items);
                self.parent_flags(false, "^", items);
            }
            [.., T::Dot] if is_guard => self.flags(self.source(), Direction::Out, "", items),
            [.., T::Dot] => self.flags(self.target(), Direction::In, "", items),
            [.., T::Caret] => self.parent_flags(is_guard, "", items),
            [
                ..,
                T::BracketOpen | T::And | T::Or | T::Not | T::ParenthesisOpen,
            ] if is_guard => {
                items.words(&["timeout", "not"]);
                if self
                    .source()
                    .is_some_and(|state| self.ports(state).is_some())
                {
                    items.words(&["exit", "busy"]);
                }
                self.flags(self.source(), Direction::Out, ".", items);
                self.parent_flags(true, "^", items);
            }
            _ if is_guard => items.words(&["and", "or"]),
            [.., T::Slash | T::Comma] => items.words(&["send", "set", "clear"]),
            [_, T::Arrow, _] => items.words(&["on"]),
            _ => {}
        }
    }

    // ─── What there is ───────────────────────────────────────────────────────────────────────────

    fn states(&self, items: &mut Items) {
        let states = self.region.into_iter().flat_map(|region| &region.states);
        for state in states {
            if let Some(name) = state.name {
                let docs = self.docs(state.docs);
                items.add_described(self.text(name), Kind::ENUM_MEMBER, "state", docs);
            }
        }
    }

    fn events(&self, items: &mut Items) {
        let events = self.container.into_iter().flat_map(|it| &it.events);
        for event in events {
            if let Some(name) = event.name {
                let docs = self.docs(event.docs);
                items.add_described(self.text(name), Kind::EVENT, "event", docs);
            }
        }
    }

    fn slots(&self, items: &mut Items) {
        let slots = self.set.checked.trees().iter().flat_map(|file| &file.slots);
        for slot in slots {
            if let Some(number) = slot.number {
                let detail = self.set.source(slot.span).to_owned();
                let docs = self.docs(slot.docs);
                items.add_described(number.value.to_string(), Kind::VALUE, &detail, docs);
            }
        }
    }

    /// Flags of a state in one direction.
    fn flags(&self, state: Option<&State>, direction: Direction, sign: &str, items: &mut Items) {
        if let Some(StateKind::Task {
            task: Some(link),
            dispatcher: Given::Value((of, _)),
            ..
        }) = state.map(|state| &state.kind)
        {
            return self.flags_of_dispatcher(self.text(*link), *of, direction, sign, items);
        }
        let ports = state.and_then(|state| self.ports(state));
        for flag in ports.into_iter().flat_map(|ports| ports.flags) {
            if let (Some(name), Some(given)) = (flag.name, flag.direction)
                && given == direction
            {
                let label = format!("{sign}{}", self.text(name));
                let docs = self.docs(flag.docs);
                items.add_described(label, Kind::VARIABLE, "flag of the state", docs);
            }
        }
    }

    /// Flags of a dispatcher, which follow from its frames.
    fn flags_of_dispatcher(
        &self,
        link: &str,
        of: Direction,
        direction: Direction,
        sign: &str,
        items: &mut Items,
    ) {
        let is_sent = of == Direction::Out;
        let mut add = |flag: &str, frame: &str| {
            let detail = format!("flag of frame `{frame}`");
            items.add(format!("{sign}{flag}"), Kind::VARIABLE, &detail);
        };
        let trees = self.set.checked.trees().iter();
        let frames = trees.flat_map(|file| &file.frames).filter(|frame| {
            let on = frame.link.map(|name| self.text(name));
            on == Some(link) && frame.direction == Some(of)
        });
        for frame in frames {
            let Some(name) = frame.name.map(|name| self.text(name)) else {
                continue;
            };
            if let Given::Value(FrameContent::Flags(flags)) = &frame.content
                && (direction == Direction::In) == is_sent
            {
                flags.iter().for_each(|flag| add(self.text(*flag), name));
            }
            if direction == Direction::Out {
                let by_itself: &[&str] = if is_sent {
                    &["full"]
                } else {
                    &["available", "delayed"]
                };
                for what in by_itself {
                    add(&format!("{name}_{what}"), name);
                }
            }
        }
        if direction == Direction::Out && !is_sent {
            items.add(format!("{sign}errors"), Kind::VARIABLE, "flag of the link");
        }
    }

    /// Flags of the container around: all can be read, `out` flags written.
    fn parent_flags(&self, is_read: bool, sign: &str, items: &mut Items) {
        let container = self.container.filter(|container| !container.is_machine);
        for flag in container.into_iter().flat_map(|it| &it.flags) {
            if let Some(name) = flag.name
                && (is_read || flag.direction == Some(Direction::Out))
            {
                let label = format!("{sign}{}", self.text(name));
                let docs = self.docs(flag.docs);
                items.add_described(label, Kind::VARIABLE, "flag of this container", docs);
            }
        }
    }

    /// The state before the arrow.
    fn source(&self) -> Option<&'c State> {
        self.state_named(self.word(0)?)
    }

    /// The state behind the arrow.
    fn target(&self) -> Option<&'c State> {
        self.state_named(self.word(2)?)
    }

    fn state_named(&self, name: &str) -> Option<&'c State> {
        let mut states = self.region?.states.iter();
        states.find(|state| state.name.is_some_and(|it| self.text(it) == name))
    }

    /// Flags and ports of what a state is made of; none for a simple state.
    fn ports(&self, state: &State) -> Option<Ports<'c>> {
        match &state.kind {
            StateKind::Simple => None,
            StateKind::Task { task, .. } => {
                let name = self.text((*task)?);
                let task = self
                    .tasks()
                    .find(|it| it.name.is_some_and(|it| self.text(it) == name))?;
                Some(Ports {
                    flags: &task.flags,
                    data: &task.data,
                })
            }
            StateKind::Super { container } => {
                let name = self.text((*container)?);
                let container = self
                    .containers()
                    .find(|it| !it.is_machine && it.name.is_some_and(|it| self.text(it) == name))?;
                Some(Ports {
                    flags: &container.flags,
                    data: &container.data,
                })
            }
        }
    }

    fn tasks(&self) -> impl Iterator<Item = &'c tree::Task> + use<'c> {
        self.set.checked.trees().iter().flat_map(|file| &file.tasks)
    }

    fn links(&self) -> impl Iterator<Item = &'c tree::Link> + use<'c> {
        self.set.checked.trees().iter().flat_map(|file| &file.links)
    }

    fn containers(&self) -> impl Iterator<Item = &'c tree::Container> + use<'c> {
        self.set
            .checked
            .trees()
            .iter()
            .flat_map(|file| &file.containers)
    }

    fn text(&self, name: Name) -> &'c str {
        self.set.source(name.0)
    }

    /// The text of a token of the statement, from its start or, below 0, from the cursor.
    fn word(&self, index: isize) -> Option<&'c str> {
        let index = if index < 0 {
            self.tokens.len().checked_sub(index.unsigned_abs())?
        } else {
            index.unsigned_abs()
        };
        Some(self.token_text(*self.tokens.get(index)?))
    }

    fn token_text(&self, token: Token) -> &'c str {
        let source = self.set.file_text(self.file);
        let text = source.get(token.start as usize..token.end as usize);
        text.unwrap_or("")
    }

    /// What the `///` lines of a declaration say.
    fn docs(&self, lines: Option<Span>) -> Option<String> {
        lines.map(|lines| docs_text(self.set.source(lines)))
    }
}
