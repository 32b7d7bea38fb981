//! Both ends of a link, held against each other.
//!
//! What a mission declares of a link and its frames is a [`LinkDeclaration`]. Frames of both ends
//! belong together by their identifiers: names are each mission's own.

use super::declaration::{Link, System};
use crate::lang::{Code, Diagnostic};
use crate::model::Span;

/// A link as a mission declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkDeclaration {
    /// Its name.
    pub name: String,
    /// Where the name stands, in the set of files that is being checked.
    pub span: Span,
    /// Bits a second.
    pub rate_bps: u32,
    /// Bits that a byte takes.
    pub bits: u8,
    /// Bytes that medium and identifier take of each frame.
    pub header_bytes: u8,
    /// What stays silent between two frames, in microseconds: each sender's own business.
    pub gap_us: u32,
    /// Its frames.
    pub frames: Vec<FrameDeclaration>,
}

/// Which way a frame goes, seen from its mission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// It is sent.
    Out,
    /// It is received.
    In,
}

/// What a frame carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// The value of a port of this type.
    Value(String),
    /// Flags, the first in the lowest bit.
    Flags(Vec<String>),
}

impl Content {
    fn words(&self) -> String {
        match self {
            Content::Value(type_name) => format!("a `{type_name}`"),
            Content::Flags(flags) if flags.len() == 1 => "1 flag".to_owned(),
            Content::Flags(flags) => format!("{} flags", flags.len()),
        }
    }

    /// Whether both are the same on the wire, where flags have no names.
    fn is_as(&self, other: &Content) -> bool {
        match (self, other) {
            (Content::Value(one), Content::Value(other)) => one == other,
            (Content::Flags(one), Content::Flags(other)) => one.len() == other.len(),
            _ => false,
        }
    }
}

/// A frame as a mission declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameDeclaration {
    /// Its name.
    pub name: String,
    /// Where the name stands.
    pub span: Span,
    /// Its identifier.
    pub identifier: u16,
    /// Which way it goes.
    pub direction: Direction,
    /// What it carries.
    pub content: Content,
    /// Bytes of its payload.
    pub payload_bytes: u8,
    /// Its period, in microseconds.
    pub period_us: u32,
    /// How old a value may be that is received, in microseconds.
    pub late_us: Option<u32>,
}

/// Finds what does not fit between the ends of a system's links. `declared` has what the mission of
/// each processor declares, in their order.
#[must_use]
pub fn check(system: &System, declared: &[Vec<LinkDeclaration>]) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    for link in &system.links {
        let mut ends = Vec::new();
        for end in &link.ends {
            let of_mission = declared.get(end.processor).map_or(&[][..], Vec::as_slice);
            let processor = name(system, end.processor);
            match of_mission.iter().find(|it| it.name == end.link) {
                Some(declaration) => ends.push((processor, declaration)),
                None => found.push(unknown(processor, &end.link, end.span, of_mission)),
            }
        }
        if let [first, second] = ends[..] {
            compare(link, first, second, &mut found);
        }
    }
    found.sort_by_key(|it| (it.span, it.code));
    found
}

fn name(system: &System, processor: usize) -> &str {
    (system.processors.get(processor)).map_or("", |it| it.name.text.as_str())
}

fn unknown(processor: &str, link: &str, place: Span, declared: &[LinkDeclaration]) -> Diagnostic {
    let message = format!("the mission of `{processor}` has no link `{link}`");
    let unknown = Diagnostic::new(Code::E002, place, message);
    let names: Vec<&str> = declared.iter().map(|it| it.name.as_str()).collect();
    unknown.hint(match names[..] {
        [] => format!("declare one there: `link {link} rate 115200 bps;`"),
        _ => format!("it has: {}", names.join(", ")),
    })
}

/// A processor's name, and what its mission declares.
type Declared<'d> = (&'d str, &'d LinkDeclaration);

fn compare(link: &Link, first: Declared<'_>, second: Declared<'_>, found: &mut Vec<Diagnostic>) {
    let place = link_place(link);
    let (one, other) = (first.1, second.1);
    let differ = |what: &str, of_one: u32, of_other: u32, unit: &str| {
        (of_one != of_other).then(|| {
            let message = format!(
                "both ends of this link have another {what}: {of_one} {unit} at `{}`, {of_other} {unit} at `{}`",
                first.0, second.0
            );
            let hint = "declare both ends alike";
            Diagnostic::new(Code::E008, place, message)
                .related(one.span, format!("`{}` declares it here", first.0))
                .related(other.span, format!("`{}` declares it here", second.0))
                .hint(hint)
        })
    };
    found.extend(differ("rate", one.rate_bps, other.rate_bps, "bps"));
    found.extend(differ(
        "length of a byte",
        one.bits.into(),
        other.bits.into(),
        "bits",
    ));
    let (header, of_other) = (one.header_bytes.into(), other.header_bytes.into());
    found.extend(differ("header", header, of_other, "bytes"));
    frames(place, first, second, found);
    frames(place, second, first, found);
}

/// Looks at the frames that one end sends, and at what the other one receives of them.
fn frames(place: Span, sender: Declared<'_>, receiver: Declared<'_>, found: &mut Vec<Diagnostic>) {
    let of = |declared: Declared<'_>, direction| {
        let frames = declared.1.frames.clone().into_iter();
        frames.filter(move |it| it.direction == direction)
    };
    for sent in of(sender, Direction::Out) {
        let (name, identifier) = (&sent.name, sent.identifier);
        let mut others = of(receiver, Direction::In);
        let Some(received) = others.find(|it| it.identifier == identifier) else {
            let message = format!(
                "frame {identifier}, `{name}` of `{}`, is received by nobody at `{}`",
                sender.0, receiver.0
            );
            let hint = format!(
                "declare it there, as in `frame {name} {identifier} in on {} …`",
                receiver.1.name
            );
            found.push(
                Diagnostic::new(Code::E008, place, message)
                    .related(sent.span, "it is sent here")
                    .related(receiver.1.span, "this is the link's other end")
                    .hint(hint),
            );
            continue;
        };
        let mut differ = |what: &str, at_sender: String, at_receiver: String| {
            let message = format!(
                "both ends mean another {what} by frame {identifier}: {at_sender} at `{}`, {at_receiver} at `{}`",
                sender.0, receiver.0
            );
            found.push(
                Diagnostic::new(Code::E008, place, message)
                    .related(sent.span, format!("`{}` sends it", sender.0))
                    .related(received.span, format!("`{}` receives it", receiver.0))
                    .hint("declare it alike at both ends: else nothing of it is taken"),
            );
        };
        if !sent.content.is_as(&received.content) {
            differ("content", sent.content.words(), received.content.words());
        }
        if sent.payload_bytes != received.payload_bytes {
            let bytes = |frame: &FrameDeclaration| format!("{} bytes", frame.payload_bytes);
            differ("payload", bytes(&sent), bytes(&received));
        }
        if sent.period_us != received.period_us {
            let time = |frame: &FrameDeclaration| crate::duration::time(frame.period_us.into());
            differ("period", time(&sent), time(&received));
        }
    }
    for received in of(receiver, Direction::In) {
        let identifier = received.identifier;
        if of(sender, Direction::Out).any(|it| it.identifier == identifier) {
            continue;
        }
        let message = format!(
            "frame {identifier}, `{}` of `{}`, is sent by nobody at `{}`",
            received.name, receiver.0, sender.0
        );
        found.push(
            Diagnostic::new(Code::E008, place, message)
                .related(received.span, "it is received here")
                .related(sender.1.span, "this is the link's other end")
                .hint(format!(
                    "declare it there, as in `frame {} {identifier} out on {} …`",
                    received.name, sender.1.name
                )),
        );
    }
}

/// The place of a link in the system file: both ends.
fn link_place(link: &Link) -> Span {
    let [first, second] = &link.ends;
    Span {
        end: second.span.end,
        ..first.span
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::system::read::read;

    const FILE: &str = "processor base mission \"base.esm\";\n\
        processor head mission \"head.esm\";\n\
        link base.radio to head.line;";

    fn frame(name: &str, identifier: u16, direction: Direction) -> FrameDeclaration {
        FrameDeclaration {
            name: name.to_owned(),
            span: Span::default(),
            identifier,
            direction,
            content: Content::Value("Pose".to_owned()),
            payload_bytes: 12,
            period_us: 100_000,
            late_us: None,
        }
    }

    fn link(name: &str, frames: Vec<FrameDeclaration>) -> LinkDeclaration {
        LinkDeclaration {
            name: name.to_owned(),
            span: Span::default(),
            rate_bps: 115_200,
            bits: 10,
            header_bytes: 4,
            gap_us: 0,
            frames,
        }
    }

    /// Both ends alike: one frame each way.
    fn alike() -> [Vec<LinkDeclaration>; 2] {
        let flags = |names: [&str; 2]| Content::Flags(names.map(str::to_owned).to_vec());
        let alarm = |direction, names| FrameDeclaration {
            content: flags(names),
            payload_bytes: 1,
            ..frame("alarm", 8, direction)
        };
        let base = vec![
            frame("pose", 7, Direction::Out),
            alarm(Direction::In, ["lost", "low"]),
        ];
        // Names are each end's own.
        let head = vec![
            frame("where", 7, Direction::In),
            alarm(Direction::Out, ["gone", "flat"]),
        ];
        [vec![link("radio", base)], vec![link("line", head)]]
    }

    fn messages(declared: &[Vec<LinkDeclaration>; 2]) -> Vec<String> {
        let system = read(FILE).0.unwrap();
        let found = check(&system, declared);
        for it in &found {
            let place = &FILE[it.span.start as usize..it.span.end as usize];
            assert!("base.radio to head.line".contains(place), "{place}");
        }
        found.into_iter().map(|it| it.message).collect()
    }

    #[test]
    fn ends_that_fit_are_silent() {
        assert_eq!(messages(&alike()), [""; 0]);
    }

    #[test]
    fn each_difference_is_told_with_both_sides() {
        type Change = fn(&mut [Vec<LinkDeclaration>; 2]);
        let cases: [(Change, &str); 10] = [
            (
                |it| it[0][0].rate_bps = 9_600,
                "both ends of this link have another rate: 9600 bps at `base`, 115200 bps at `head`",
            ),
            (
                |it| it[1][0].bits = 11,
                "both ends of this link have another length of a byte",
            ),
            (
                |it| it[1][0].header_bytes = 6,
                "both ends of this link have another header: 4 bytes",
            ),
            (
                |it| it[0][0].frames[0].payload_bytes = 8,
                "both ends mean another payload by frame 7: 8 bytes at `base`, 12 bytes at `head`",
            ),
            (
                |it| it[1][0].frames[0].period_us = 2_500,
                "both ends mean another period by frame 7: 100 ms at `base`, 2.5 ms at `head`",
            ),
            (
                |it| it[1][0].frames[0].content = Content::Value("Twist".to_owned()),
                "both ends mean another content by frame 7: a `Pose` at `base`, a `Twist` at `head`",
            ),
            (
                |it| it[0][0].frames[1].content = Content::Flags(vec!["lost".to_owned()]),
                "both ends mean another content by frame 8: 2 flags at `head`, 1 flag at `base`",
            ),
            (
                |it| drop(it[1][0].frames.remove(0)),
                "frame 7, `pose` of `base`, is received by nobody at `head`",
            ),
            (
                |it| drop(it[1][0].frames.remove(1)),
                "frame 8, `alarm` of `base`, is sent by nobody at `head`",
            ),
            (
                |it| it[1][0].name = "other".to_owned(),
                "the mission of `head` has no link `line`",
            ),
        ];
        for (change, expected) in cases {
            let mut declared = alike();
            change(&mut declared);
            let found = messages(&declared);
            assert_eq!(found.len(), 1, "{found:#?}");
            assert!(found[0].starts_with(expected), "{found:#?}");
        }
    }
}
