//! Containers, machines, and their data paths.

use crate::model::Span;

use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Edit, Fix};
use crate::lang::lexer::{Lexer, TokenKind as T};
use crate::lang::tree::{Container, Event, EventListing, Path, PathEnd};

use super::{Body, Parser};

impl<'t> Parser<'t, '_> {
    pub(super) fn container(&mut self, is_machine: bool) -> Container {
        let start = self.here();
        let docs = self.docs_before(start);
        self.bump();
        let name = self.name(if is_machine {
            "the name of the machine"
        } else {
            "the name of the container"
        });
        let mut container = Container {
            docs,
            is_machine,
            span: self.since(start),
            name,
            events: Vec::new(),
            flags: Vec::new(),
            data: Vec::new(),
            regions: Vec::new(),
            paths: Vec::new(),
            skipped: Vec::new(),
            is_cut: false,
            has_gaps: false,
        };
        self.body = Body::Container;
        if self.open_body() {
            self.container_body(&mut container);
        } else {
            container.has_gaps = true;
        }
        container
    }

    pub(super) fn container_body(&mut self, container: &mut Container) {
        const WORDS: [(&str, T); 6] = [
            ("event", T::Event),
            ("in", T::In),
            ("out", T::Out),
            ("inout", T::InOut),
            ("region", T::Region),
            ("path", T::Path),
        ];
        let expected = if container.is_machine {
            "`event`, `region`, `path` or `}`"
        } else {
            "`event`, `in`, `out`, `inout`, `region`, `path` or `}`"
        };
        loop {
            container.has_gaps |= self.is_lost;
            self.is_lost = std::mem::take(&mut self.stays_lost);
            self.body = Body::Container;
            let kind = self.misspelt(&WORDS).unwrap_or(self.token.kind);
            match kind {
                T::BraceClose => {
                    if !container.is_machine
                        && container.regions.is_empty()
                        && container.skipped.is_empty()
                    {
                        self.expected_with(
                            "`region`",
                            Some("a container has at least one region".into()),
                        );
                    }
                    return self.bump();
                }
                T::Event => {
                    let docs = self.docs_before(self.here());
                    self.bump();
                    self.event_names(container, EventListing::Local, docs);
                    self.end_statement("`,` or `;`");
                }
                T::In | T::Out | T::InOut => self.container_port(container, kind, expected),
                T::Region => container.regions.push(self.region()),
                T::Path => {
                    let start = self.here();
                    self.bump();
                    container.paths.push(self.path(start));
                }
                T::Task if !self.at_task_state() => return self.missing_close(expected),
                T::EndOfFile
                | T::Use
                | T::Interpreter
                | T::Queue
                | T::Link
                | T::Frame
                | T::Slot
                | T::Container
                | T::Machine => {
                    container.is_cut = self.is_cut;
                    container.has_gaps |= self.is_cut || self.at(T::EndOfFile);
                    return self.missing_close(expected);
                }
                T::State | T::Super | T::Initial | T::Task => {
                    self.outside_of_region(container, expected);
                }
                T::Identifier if self.at_path() => {
                    let start = self.here();
                    let cure = Cure::say("a data path starts with `path`");
                    let insert = Edit::before(start, "path ");
                    self.mended(expected, cure.fix(Fix::one("write `path`", insert)));
                    container.paths.push(self.path(start));
                }
                T::Identifier if self.next.kind == T::Arrow => {
                    self.outside_of_region(container, expected);
                }
                _ => {
                    self.expected(expected);
                    self.skip_foreign_item(&mut container.skipped);
                }
            }
        }
    }

    /// A state or transition between the regions: it is taken for one of the region before, so that
    /// its names are known.
    pub(super) fn outside_of_region(&mut self, container: &mut Container, expected: &str) {
        if self.loose_closes > 0 {
            // It is in the region that was left before.
            self.loose_closes -= 1;
            self.report_nothing_here();
        }
        self.corrected(
            expected,
            Some(
                "states and transitions stand in a `region`: is there a `}` too many before it?"
                    .into(),
            ),
        );
        match container.regions.last_mut() {
            Some(region) => {
                // Whether the next `}` is the region's or the container's nobody knows: one more
                // may follow.
                self.loose_closes += 1;
                self.region_items(region);
                self.tell_limits(region);
            }
            None => self.skip_foreign_item(&mut container.skipped),
        }
    }

    /// Whether `task` starts a task state (`task A: …`), not the declaration of a task.
    pub(super) fn at_task_state(&self) -> bool {
        let mut behind = self.lexer_behind_next();
        self.next.kind == T::Identifier && behind.next_token().kind == T::Colon
    }

    /// Whether a data path starts here without its word: `A.x …`, `x -> A.y`, `x -> y, …`.
    pub(super) fn at_path(&self) -> bool {
        match self.next.kind {
            T::Dot => true,
            T::Arrow => {
                let mut behind = self.lexer_behind_next();
                behind.next_token().kind == T::Identifier
                    && matches!(behind.next_token().kind, T::Dot | T::Comma)
            }
            _ => false,
        }
    }

    /// A lexer that stands behind the two tokens that are read.
    pub(super) fn lexer_behind_next(&self) -> Lexer<'t> {
        Lexer::new_at(self.text, self.next.end)
    }

    /// A list of event names.
    pub(super) fn event_names(
        &mut self,
        container: &mut Container,
        listing: EventListing,
        docs: Option<Span>,
    ) {
        loop {
            let name = self.name("the name of an event");
            container.events.push(Event {
                docs,
                listing,
                name,
            });
            if self.eat(T::Comma) {
                continue;
            }
            let behind = self.behind_last();
            if self.at(T::Unknown) && self.next.kind == T::Identifier {
                let sign = self.span_between(behind.start, self.token.end);
                self.mended("`,` or `;`", comma(Edit::replace(sign, ",")));
                self.bump();
            } else if self.at(T::Identifier) {
                self.mended("`,` or `;`", comma(Edit::replace(behind, ",")));
            } else {
                return;
            }
        }
    }

    /// `in`, `out` or `inout` of a container. A machine has none, but what it lists is known all
    /// the same.
    pub(super) fn container_port(
        &mut self,
        container: &mut Container,
        direction: T,
        expected: &str,
    ) {
        if container.is_machine {
            self.corrected(
                expected,
                Some(
                    "nothing is around a machine that could use its ports, flags or events".into(),
                ),
            );
        }
        let start = self.here();
        self.bump();
        match self.token.kind {
            T::Flag => container.flags.push(self.flag(start, direction)),
            T::Data => container.data.push(self.data_port(start, direction)),
            T::Event => {
                let listing = match direction {
                    T::In => EventListing::In,
                    T::Out => EventListing::Out,
                    _ => {
                        let hint = "write `in event` and `out event`, one below the other";
                        self.corrected("`data`", Some(hint.into()));
                        EventListing::In
                    }
                };
                let docs = self.docs_before(start);
                self.bump();
                let name = self.name("the name of an event");
                container.events.push(Event {
                    docs,
                    listing,
                    name,
                });
                if self.at(T::Comma) {
                    let cure = Cure::say("each forwarded event has its own line");
                    let word = if listing == EventListing::In {
                        "in"
                    } else {
                        "out"
                    };
                    let again = format!("; {word} event");
                    self.mended("`;`", cure.edit(Edit::replace(self.here(), again)));
                    self.bump();
                    self.event_names(container, listing, docs);
                }
                self.end_statement("`;`");
            }
            T::Identifier if self.next.kind == T::Colon => {
                let insert = Edit::before(self.here(), "data ");
                let cure = Cure::say("a port is declared with `data`").edit(insert);
                self.lost("`event`, `flag` or `data`", cure);
                self.skip_item(&mut container.skipped);
            }
            _ => {
                self.expected("`event`, `flag` or `data`");
                self.skip_item(&mut container.skipped);
            }
        }
    }

    /// A data path, behind its word.
    pub(super) fn path(&mut self, start: Span) -> Path {
        let mut path = Path {
            span: start,
            from: Vec::new(),
            to: Vec::new(),
            broken: false,
        };
        let is_read = self.path_ends(&mut path.from)
            && self.expect(T::Arrow, "`.`, `,` or `->`")
            && self.path_ends(&mut path.to);
        self.end_statement("`.`, `,` or `;`");
        path.broken = !is_read || self.is_lost;
        path.span = self.since(start);
        path
    }

    /// Whether an end can be over here. Behind an end that is cut short nobody knows what its names
    /// mean.
    pub(super) fn at_end_of_path_end(&mut self) -> bool {
        let is_over = matches!(self.token.kind, T::Comma | T::Arrow | T::Semicolon)
            || self.at_start_of_item()
            || self.at(T::BraceClose);
        if !is_over {
            self.expected("`.`, `,`, `->` or `;`");
        }
        is_over
    }

    pub(super) fn path_ends(&mut self, ends: &mut Vec<PathEnd>) -> bool {
        loop {
            match self.path_end() {
                Some(end) => ends.push(end),
                None => return false,
            }
            if !self.eat(T::Comma) {
                return true;
            }
        }
    }

    pub(super) fn path_end(&mut self) -> Option<PathEnd> {
        let first = self.name("a port, as `port`, `state.port` or `region.state.port`")?;
        if !self.eat(T::Dot) {
            return self
                .at_end_of_path_end()
                .then_some(PathEnd::Container(first));
        }
        let second = self.name("the name of a port or state")?;
        if !self.eat(T::Dot) {
            return self
                .at_end_of_path_end()
                .then_some(PathEnd::State(first, second));
        }
        let third = self.name("the name of a port")?;
        self.at_end_of_path_end()
            .then_some(PathEnd::Region(first, second, third))
    }
}

/// A comma that is missing between names.
fn comma(edit: Edit) -> Cure {
    Cure::default().fix(Fix::one("write the missing `,`", edit))
}
