//! Links and frames, and the tasks that their dispatchers are.
//!
//! A dispatcher is a task whose ports and flags follow from the frames of its link, so that all
//! that is known of tasks holds for it. Its task stands behind those that files declare.

use std::collections::HashMap;

use esm_core::frames::{MAX_BITS, MAX_FRAMES, MAX_ID, MAX_PAYLOAD_BYTES, MAX_RATE_BPS};

use crate::lang::analysis::holes::TaskHoles;
use crate::lang::cure::Cure;
use crate::lang::diagnostic::{Code, Diagnostic, Fix};
use crate::lang::references::Undeclared;
use crate::lang::tree::{self, FrameContent, Given, Name, Number, Rate};
use crate::model::{
    Content, DataPort, Direction, Dispatcher, Flag, Frame, Link, Model, Span, Task,
};
use crate::schedule::{SlotSpec, overcommitted};

use super::declarations::Trees;
use super::scope::{Found, Names, Scope};
use super::slots::period_of_rate;
use super::tasks::{TaskFacts, TaskTable};

/// What a medium and the identifier take, where the link does not say it.
const DEFAULT_HEADER_BYTES: u8 = 4;

/// Bits that a byte takes on the wire, where the link does not say it.
const DEFAULT_BITS: u8 = 10;

/// Bits of a byte of a payload.
const FLAGS_PER_BYTE: usize = 8;

/// The flag of `receive` that comes with no frame.
const ERRORS: &str = "errors";

/// The flags that a frame brings by itself, for each frame of the set: their names stand in no
/// file.
pub(super) struct FlagNames {
    /// For each frame, the flag of `transmit`, and the two of `receive`.
    names: Vec<[String; 3]>,
}

impl FlagNames {
    pub(super) fn of(set: &Trees<'_>) -> Self {
        let text = |name: Option<Name>| {
            let span = name?.0;
            let file = set.files.get(span.file as usize)?;
            file.text.get(span.start as usize..span.end as usize)
        };
        let names = set.frames().map(|frame| {
            let name = text(frame.name).unwrap_or_default();
            ["full", "available", "delayed"].map(|what| format!("{name}_{what}"))
        });
        FlagNames {
            names: names.collect(),
        }
    }
}

/// The name space of links.
pub(super) struct LinkTable<'f> {
    names: Scope<'f>,
    /// For each link, what else is known of it than its model.
    links: Vec<LinkFacts>,
}

#[derive(Clone, Copy)]
struct LinkFacts {
    /// Its name is another's, too.
    is_twin: bool,
    /// Frames of it may be missing.
    has_gaps: bool,
}

impl<'f> LinkTable<'f> {
    /// Declares links and frames of all files, and the tasks of the dispatchers.
    pub(super) fn declare(
        set: &Trees<'f>,
        flag_names: &'f FlagNames,
        model: &mut Model,
        tasks: &mut TaskTable<'f>,
        names: &mut Names<'f, '_>,
    ) -> Self {
        let mut table = LinkTable {
            names: Scope::default(),
            links: Vec::new(),
        };
        if set.is_incomplete() {
            table.names.is_incomplete();
        }
        for (index, tree) in set.links().enumerate() {
            names.declare(&mut table.names, tree.name, index, "link");
            let first = 2 * index + model.tasks.len();
            table.links.push(LinkFacts {
                is_twin: false,
                has_gaps: set.trees.iter().any(|file| file.has_gaps),
            });
            model.links.push(declare_link(tree, first, names));
        }
        for file in set.trees {
            table.names.may_hide(names, &file.skipped, file.is_cut);
        }
        for (index, (facts, tree)) in table.links.iter_mut().zip(set.links()).enumerate() {
            facts.is_twin = tree
                .name
                .is_none_or(|name| !table.names.is_first(names.text(name.0), index));
        }
        let frames = table.declare_frames(set, flag_names, model, names);
        table.declare_dispatchers(&frames, model, tasks, names);
        check_times(model, names);
        table
    }

    /// The frames that are known whole, by link and direction.
    fn declare_frames(
        &mut self,
        set: &Trees<'f>,
        flag_names: &'f FlagNames,
        model: &mut Model,
        names: &mut Names<'f, '_>,
    ) -> Vec<Declared<'f>> {
        let mut scope = Scope::default();
        let mut identifiers: HashMap<(usize, Direction, u32), Span> = HashMap::new();
        let mut frames = Vec::new();
        for (index, (tree, by_itself)) in set.frames().zip(&flag_names.names).enumerate() {
            names.declare(&mut scope, tree.name, index, "frame");
            let is_first = tree
                .name
                .is_some_and(|name| scope.is_first(names.text(name.0), index));
            let link = tree.link.and_then(|name| self.resolve(name, names));
            let period_us = match tree.rate {
                Given::Value(Rate::PeriodUs(period_us)) => Some(period_us),
                Given::Value(Rate::Hertz(hertz)) => period_of_rate(hertz, tree.span, names),
                Given::Absent | Given::Broken => None,
            };
            check_numbers(tree, names);
            if let (Some(link), Some(direction), Some(number)) = (link, tree.direction, tree.number)
                && number.value <= u32::from(MAX_ID)
            {
                match identifiers.get(&(link, direction, number.value)) {
                    Some(&first) => report_identifier(number, first, names),
                    None => drop(identifiers.insert((link, direction, number.value), number.span)),
                }
            }
            if let Some(FrameContent::Value(type_name)) = content(tree) {
                names.mention(Undeclared::Type, Some(*type_name));
            }
            if let (Some(link), Some(direction), Some(content), true) =
                (link, tree.direction, content(tree), is_first)
            {
                let is_whole = model.frames.len();
                model
                    .frames
                    .push(declare_frame(tree, link, direction, period_us, names));
                frames.push(Declared {
                    frame: is_whole,
                    tree,
                    content,
                    by_itself,
                });
            } else if let Some(facts) = link.and_then(|link| self.links.get_mut(link)) {
                facts.has_gaps = true;
            } else {
                // It may belong to any of them.
                self.links
                    .iter_mut()
                    .for_each(|facts| facts.has_gaps = true);
            }
        }
        frames
    }

    fn declare_dispatchers(
        &self,
        frames: &[Declared<'f>],
        model: &mut Model,
        tasks: &mut TaskTable<'f>,
        names: &mut Names<'f, '_>,
    ) {
        for (link, facts) in self.links.iter().enumerate() {
            for direction in [Direction::Out, Direction::In] {
                let of_it = frames.iter().filter(|declared| {
                    (model.frames.get(declared.frame))
                        .is_some_and(|frame| frame.link == link && frame.direction == direction)
                });
                let of_it: Vec<&Declared<'f>> = of_it.collect();
                let (task, task_facts) = dispatcher(link, direction, &of_it, model, names);
                let holes = TaskHoles {
                    declarations: facts.has_gaps,
                    is_twin: facts.is_twin,
                };
                tasks.push_dispatcher(task_facts, holes);
                model.tasks.push(task);
            }
        }
    }

    /// The link of a name; an unknown one is reported.
    fn resolve(&self, name: Name, names: &mut Names<'f, '_>) -> Option<usize> {
        names.resolve(&self.names, name, "link", |link| {
            Cure::say(format!(
                "declare it: `link {link} rate 115200 bps;`, or `use` the file that does"
            ))
        })
    }

    /// The task of a dispatcher; a link that is unknown is reported.
    pub(super) fn dispatcher(
        &self,
        link: Name,
        direction: Direction,
        model: &Model,
        names: &mut Names<'f, '_>,
    ) -> Option<usize> {
        let link = model.links.get(self.resolve(link, names)?)?;
        Some(match direction {
            Direction::Out => link.transmit,
            _ => link.receive,
        })
    }

    /// Whether a name is that of a link.
    pub(super) fn has(&self, name: &str) -> bool {
        matches!(self.names.find(name), Found::Index(_))
    }
}

/// A frame of the model, and what is written of it.
struct Declared<'f> {
    /// Index into [`Model::frames`].
    frame: usize,
    tree: &'f tree::Frame,
    content: &'f FrameContent,
    by_itself: &'f [String; 3],
}

fn content(tree: &tree::Frame) -> Option<&FrameContent> {
    match &tree.content {
        Given::Value(content) => Some(content),
        Given::Absent | Given::Broken => None,
    }
}

fn declare_link(tree: &tree::Link, first_task: usize, names: &mut Names<'_, '_>) -> Link {
    let mut number = |given: Given<Number>, what: &str, least: u32, greatest: u32, unit: &str| {
        let number = given.value()?;
        let is_in_range = (least..=greatest).contains(&number.value);
        if !is_in_range {
            out_of_range(number, what, least, greatest, unit, names);
        }
        is_in_range.then_some(number.value)
    };
    let byte = |value: Option<u32>| value.and_then(|value| u8::try_from(value).ok());
    let rate_bps = number(tree.rate_bps, "the rate of a link", 1, MAX_RATE_BPS, " bps");
    let header = number(
        tree.header_bytes,
        "the header of a frame",
        0,
        u8::MAX.into(),
        " bytes",
    );
    let bits = number(
        tree.bits,
        "the number of bits of a byte on the wire",
        1,
        MAX_BITS,
        "",
    );
    let span = tree.name.map_or(tree.span, |name| name.0);
    // With a number that is wrong nobody knows how long a frame takes.
    let is_right =
        header.is_some() == tree.header_bytes.is_given() && bits.is_some() == tree.bits.is_given();
    Link {
        name: names.text(span).to_owned(),
        rate_bps: rate_bps.filter(|_| is_right),
        header_bytes: byte(header).unwrap_or(DEFAULT_HEADER_BYTES),
        bits: byte(bits).unwrap_or(DEFAULT_BITS),
        gap_us: tree.gap_us.value().unwrap_or(0),
        transmit: first_task,
        receive: first_task + 1,
        docs: names.docs(tree.docs),
        span,
        declaration: tree.span,
    }
}

fn declare_frame(
    tree: &tree::Frame,
    link: usize,
    direction: Direction,
    period_us: Option<u32>,
    names: &Names<'_, '_>,
) -> Frame {
    let span = tree.name.map_or(tree.span, |name| name.0);
    let payload = tree.payload_bytes.value().map(|number| number.value);
    Frame {
        name: names.text(span).to_owned(),
        id: tree.number.map_or(0, |number| number.value) as u16,
        link,
        direction,
        content: match content(tree) {
            Some(FrameContent::Flags(flags)) => Content::Flags(
                (flags.iter())
                    .map(|flag| names.text(flag.0).to_owned())
                    .collect(),
            ),
            Some(FrameContent::Value(name)) => Content::Value(names.text(name.0).to_owned()),
            None => Content::Value(String::new()),
        },
        payload_bytes: payload.and_then(|bytes| u8::try_from(bytes).ok()),
        period_us,
        late_us: tree.late_us.value(),
        docs: names.docs(tree.docs),
        span,
        declaration: tree.span,
    }
}

/// Ports and flags of a dispatcher, by the frames that it sends or receives.
fn dispatcher<'f>(
    link: usize,
    direction: Direction,
    frames: &[&Declared<'f>],
    model: &Model,
    names: &mut Names<'f, '_>,
) -> (Task, TaskFacts<'f>) {
    let (name, span) = model.links.get(link).map_or(("", Span::default()), |link| {
        (link.name.as_str(), link.span)
    });
    let word = match direction {
        Direction::Out => "transmit",
        _ => "receive",
    };
    let mut facts = TaskFacts::new(span);
    let mut task = Task {
        name: format!("{name}.{word}"),
        slot: None,
        wcet_us: None,
        exclusive: None,
        count: None,
        endless: true,
        data: Vec::new(),
        flags: Vec::new(),
        params: Vec::new(),
        dispatcher: Some(Dispatcher { link, direction }),
        docs: String::new(),
        span,
    };
    // Declared flags stand before those that come by themselves; of two of one name the one that
    // stands later in the text is the second.
    let declared: usize = frames
        .iter()
        .map(|declared| match declared.content {
            FrameContent::Flags(flags) => flags.len(),
            FrameContent::Value(_) => 0,
        })
        .sum();
    let by_itself = |frame: &Declared<'f>| -> &'f [String] {
        match direction {
            Direction::Out => &frame.by_itself[..1],
            _ => &frame.by_itself[1..],
        }
    };
    let of_frames: usize = frames.iter().map(|frame| by_itself(frame).len()).sum();
    if direction == Direction::In {
        // Nothing is declared before it.
        let _ = facts.flags.declare(ERRORS, span, declared + of_frames);
    }
    let mut all_flags = vec![None; declared + of_frames];
    let (mut next_declared, mut next_by_itself) = (0, declared);
    for frame in frames {
        let docs = names.docs(frame.tree.docs);
        let frame_span = frame.tree.name.map_or(frame.tree.span, |name| name.0);
        for flag in by_itself(frame) {
            if let Err(first) = facts.flags.declare(flag, frame_span, next_by_itself) {
                names.defined_twice("flag", flag, frame_span, first);
            }
            if let Some(place) = all_flags.get_mut(next_by_itself) {
                *place = Some(Flag {
                    name: flag.clone(),
                    direction: Direction::Out,
                    docs: String::new(),
                    span: frame_span,
                });
            }
            next_by_itself += 1;
        }
        match frame.content {
            FrameContent::Flags(flags) => {
                for &flag in flags {
                    names.declare(&mut facts.flags, Some(flag), next_declared, "flag");
                    if let Some(place) = all_flags.get_mut(next_declared) {
                        *place = Some(Flag {
                            name: names.text(flag.0).to_owned(),
                            direction: opposite(direction),
                            docs: docs.clone(),
                            span: flag.0,
                        });
                    }
                    next_declared += 1;
                }
            }
            FrameContent::Value(type_name) => {
                let text = names.text(frame_span);
                // Of a name that was declared twice the second is reported with the frames.
                let _ = facts.data.declare(text, frame_span, task.data.len());
                task.data.push(DataPort {
                    name: text.to_owned(),
                    direction: opposite(direction),
                    type_name: names.text(type_name.0).to_owned(),
                    optional: direction == Direction::Out,
                    within_us: None,
                    docs,
                    span: frame.tree.span,
                });
            }
        }
    }
    task.flags = all_flags.into_iter().flatten().collect();
    if direction == Direction::In {
        task.flags.push(Flag {
            name: ERRORS.to_owned(),
            direction: Direction::Out,
            docs: String::new(),
            span,
        });
    }
    facts.flag_directions = task.flags.iter().map(|flag| Some(flag.direction)).collect();
    if let Some(frame) = frames.get(MAX_FRAMES) {
        names.report(
            Diagnostic::new(
                Code::E012,
                frame.tree.span,
                format!(
                    "`{}` has {} frames, at most {MAX_FRAMES} are possible",
                    task.name,
                    frames.len()
                ),
            )
            .hint("send several values in one frame, or use a second link"),
        );
    }
    (task, facts)
}

/// What is sent comes in at a port of the dispatcher, and what is received goes out.
fn opposite(direction: Direction) -> Direction {
    match direction {
        Direction::Out => Direction::In,
        _ => Direction::Out,
    }
}

fn out_of_range(
    number: Number,
    what: &str,
    least: u32,
    greatest: u32,
    unit: &str,
    names: &mut Names<'_, '_>,
) {
    let message = format!("{what} is from {least} to {greatest}{unit}");
    let value = number.value.clamp(least, greatest);
    names.report(
        Diagnostic::new(Code::E014, number.span, message)
            .fix(Fix::write(number.span, value.to_string())),
    );
}

fn report_identifier(number: Number, first: Span, names: &mut Names<'_, '_>) {
    let message = format!(
        "identifier {} is used twice in this direction of the link",
        number.value
    );
    names.report(
        Diagnostic::new(Code::E014, number.span, message)
            .hint("give each frame of a direction a number of its own")
            .related(first, "used first here"),
    );
}

/// The numbers of a frame, and the words that only some frames have.
fn check_numbers(tree: &tree::Frame, names: &mut Names<'_, '_>) {
    if let Some(number) = tree.number
        && number.value > u32::from(MAX_ID)
    {
        out_of_range(number, "an identifier", 0, MAX_ID.into(), "", names);
    }
    if let Some(payload) = tree.payload_bytes.value() {
        let greatest = MAX_PAYLOAD_BYTES as u32;
        if !(1..=greatest).contains(&payload.value) {
            out_of_range(
                payload,
                "the payload of a frame",
                1,
                greatest,
                " bytes",
                names,
            );
        } else if let Some(FrameContent::Flags(flags)) = content(tree)
            && flags.len() > payload.value as usize * FLAGS_PER_BYTE
        {
            let needed = flags.len().div_ceil(FLAGS_PER_BYTE);
            let message = format!(
                "{} flags do not fit {} byte{}: they need {needed}",
                flags.len(),
                payload.value,
                if payload.value == 1 { "" } else { "s" }
            );
            names.report(
                Diagnostic::new(Code::E014, payload.span, message)
                    .hint(format!("write `payload {needed} bytes`"))
                    .fix(Fix::write(payload.span, needed.to_string())),
            );
        }
    }
    if let (Some(word), Some(Direction::Out)) = (tree.late_word, tree.direction) {
        let message = "`late` says how old a received value may be, and this frame is sent";
        names.report(
            Diagnostic::new(Code::E014, word, message)
                .hint("remove it, or write it at the `in` frame of the other end"),
        );
    }
}

/// What takes more time than there is.
fn check_times(model: &Model, names: &mut Names<'_, '_>) {
    for (index, link) in model.links.iter().enumerate() {
        let mut first = None;
        for frame in model.frames_out(index) {
            first.get_or_insert(frame.declaration);
            let (Some(duration_us), Some(period_us)) = (frame.duration_us(link), frame.period_us)
            else {
                continue;
            };
            if duration_us > u64::from(period_us) {
                let message = format!(
                    "frame `{}` takes {duration_us} us on link `{}`, its period is {period_us} us",
                    frame.name, link.name
                );
                names.report(
                    Diagnostic::new(Code::E010, frame.declaration, message).hint(
                        "send it less often, give it a smaller payload, or use a faster link",
                    ),
                );
            }
        }
        let mut specs = SlotSpec::of_link(model, index);
        specs.retain(|frame| frame.duration_us <= frame.period_us);
        if let (Some(first), Some(reason)) = (first, overcommitted(&specs)) {
            let reason = reason.of_frames();
            let cure =
                "send some of them less often, give them smaller payloads, or use a faster link";
            let message = format!("the frames cannot all cross link `{}`: {reason}", link.name);
            names.report(Diagnostic::new(Code::E010, first, message).hint(cure));
        }
    }
}
