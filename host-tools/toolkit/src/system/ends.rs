//! Both ends of a link, held against each other.
//!
//! Frames of both ends belong together by their identifiers: names are each mission's own.

use esm_link::frames::wire::{FRAMING_BYTES, HEADER_BYTES};

use super::declaration::{Link, Medium, System};
use crate::lang::{Code, Diagnostic};
use crate::medium::can;
use crate::model::{Content, Direction, Frame, Link as Declared, Model, Span};

/// Microseconds in a second.
const US_IN_S: u64 = 1_000_000;

/// What the mission of a processor declares.
#[derive(Clone, Copy, Debug)]
pub struct Mission<'m> {
    /// All of it. None where something is wrong with it, which was said elsewhere.
    pub model: Option<&'m Model>,
    /// Where its files begin among those that the system's diagnostics are about.
    pub first_file: u32,
}

impl<'m> Mission<'m> {
    /// A place of one of its files.
    fn place(&self, span: Span) -> Span {
        Span {
            file: span.file.saturating_add(self.first_file),
            ..span
        }
    }

    fn links(&self) -> &'m [Declared] {
        self.model.map_or(&[], |model| &model.links)
    }
}

/// One end: whose it is, and what its mission declares.
#[derive(Clone, Copy)]
struct Side<'m> {
    processor: &'m str,
    mission: Mission<'m>,
    index: usize,
    link: &'m Declared,
}

impl<'m> Side<'m> {
    fn frames(self, direction: Direction) -> impl Iterator<Item = &'m Frame> {
        let frames = self.mission.model.map_or(&[][..], |model| &model.frames);
        (frames.iter())
            .filter(move |frame| frame.link == self.index && frame.direction == direction)
    }
}

fn words(content: &Content) -> String {
    match content {
        Content::Value(type_name) => format!("a `{type_name}`"),
        Content::Flags(flags) if flags.len() == 1 => "1 flag".to_owned(),
        Content::Flags(flags) => format!("{} flags", flags.len()),
    }
}

/// Whether both are the same on the wire, where flags have no names.
fn are_alike(one: &Content, other: &Content) -> bool {
    match (one, other) {
        (Content::Value(one), Content::Value(other)) => one == other,
        (Content::Flags(one), Content::Flags(other)) => one.len() == other.len(),
        _ => false,
    }
}

/// Finds what does not fit between the ends of a system's links. `missions` has that of each
/// processor, in their order.
#[must_use]
pub fn check(system: &System, missions: &[Mission<'_>]) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    for link in &system.links {
        let mut sides = Vec::new();
        for end in &link.ends {
            let Some(mission) = missions.get(end.processor) else {
                continue;
            };
            let declared = mission.links();
            let processor = name(system, end.processor);
            match declared.iter().position(|it| it.name == end.link) {
                Some(index) => sides.extend(declared.get(index).map(|link| Side {
                    processor,
                    mission: *mission,
                    index,
                    link,
                })),
                None if mission.model.is_none() => {}
                None => found.push(unknown(processor, &end.link, end.span, declared)),
            }
        }
        for side in &sides {
            fits(link, *side, &mut found);
        }
        if let [first, second] = sides[..] {
            compare(link, first, second, &mut found);
        }
    }
    for (index, (processor, mission)) in system.processors.iter().zip(missions).enumerate() {
        let is_joined = |link: &Declared| {
            let mut ends = system.links.iter().flat_map(|it| &it.ends);
            ends.any(|end| end.processor == index && end.link == link.name)
        };
        for link in mission.links().iter().filter(|link| !is_joined(link)) {
            let name = &processor.name;
            let message = format!("link `{}` of `{}` leads nowhere", link.name, name.text);
            let hint = format!(
                "join it: `link {}.{} to PROCESSOR.LINK;`",
                name.text, link.name
            );
            found.push(
                Diagnostic::new(Code::W107, name.span, message)
                    .related(mission.place(link.span), "it is declared here")
                    .hint(hint),
            );
        }
    }
    found.sort_by_key(|it| (it.span, it.code));
    found
}

fn name(system: &System, processor: usize) -> &str {
    (system.processors.get(processor)).map_or("", |it| it.name.text.as_str())
}

fn unknown(processor: &str, link: &str, place: Span, declared: &[Declared]) -> Diagnostic {
    let message = format!("the mission of `{processor}` has no link `{link}`");
    let unknown = Diagnostic::new(Code::E002, place, message);
    let names: Vec<&str> = declared.iter().map(|it| it.name.as_str()).collect();
    unknown.hint(match names[..] {
        [] => format!("declare one there: `link {link} rate 115200 bps;`"),
        _ => format!("it has: {}", names.join(", ")),
    })
}

/// Looks whether what a mission plans for a link is what its medium needs.
fn fits(link: &Link, side: Side<'_>, found: &mut Vec<Diagnostic>) {
    let (place, declared) = (link_place(link), side.link);
    match link.medium {
        Medium::Line => {
            let header_bytes = HEADER_BYTES + FRAMING_BYTES;
            let missing = header_bytes.saturating_sub(declared.header_bytes.into());
            let bits = missing as u64 * u64::from(declared.bits);
            let rate_bps = u64::from(declared.rate_bps.unwrap_or(1).max(1));
            let gap_us = (bits * US_IN_S).div_ceil(rate_bps);
            if u64::from(declared.gap_us) >= gap_us {
                return;
            }
            let message = format!(
                "a frame takes {header_bytes} bytes of a line before and behind payload and checksum, and `{}` of `{}` plans {}",
                declared.name, side.processor, declared.header_bytes
            );
            let hint = format!("write `header {header_bytes} bytes` there, or `gap {gap_us} us`");
            found.push(
                Diagnostic::new(Code::E014, place, message)
                    .related(side.mission.place(declared.span), "it is declared here")
                    .hint(hint),
            );
        }
        Medium::Can => {
            let frames = side
                .frames(Direction::Out)
                .chain(side.frames(Direction::In));
            for frame in frames {
                let payload_bytes = frame.payload_bytes.unwrap_or(0);
                if usize::from(payload_bytes) <= can::MAX_DATA_BYTES {
                    continue;
                }
                let message = format!(
                    "a frame of CAN carries at most {} bytes, and `{}` of `{}` has {payload_bytes}",
                    can::MAX_DATA_BYTES,
                    frame.name,
                    side.processor
                );
                found.push(
                    Diagnostic::new(Code::E014, place, message)
                        .related(side.mission.place(frame.span), "it is declared here")
                        .hint("let the link go `over line`, or send less"),
                );
            }
        }
        Medium::Memory => {}
    }
}

fn compare(link: &Link, first: Side<'_>, second: Side<'_>, found: &mut Vec<Diagnostic>) {
    let place = link_place(link);
    let (one, other) = (first.link, second.link);
    let mut differ = |what: &str, of_one: u32, of_other: u32, unit: &str| {
        if of_one == of_other {
            return;
        }
        let message = format!(
            "the ends of this link have another {what} each: {of_one} {unit} at `{}`, {of_other} {unit} at `{}`",
            first.processor, second.processor
        );
        let mut differ =
            Diagnostic::new(Code::E008, place, message).hint("declare both ends alike");
        for side in [first, second] {
            let what = format!("`{}` declares it here", side.processor);
            differ = differ.related(side.mission.place(side.link.span), what);
        }
        found.push(differ);
    };
    let rate = |it: &Declared| it.rate_bps.unwrap_or(0);
    differ("rate", rate(one), rate(other), "bps");
    differ(
        "length of a byte",
        one.bits.into(),
        other.bits.into(),
        "bits",
    );
    differ(
        "header",
        one.header_bytes.into(),
        other.header_bytes.into(),
        "bytes",
    );
    frames(place, first, second, found);
    frames(place, second, first, found);
    if link.medium == Medium::Can {
        one_sender(place, first, second, found);
    }
}

/// Looks at the frames that one end sends, and at what the other one receives of them.
fn frames(place: Span, sender: Side<'_>, receiver: Side<'_>, found: &mut Vec<Diagnostic>) {
    let place_of = |side: Side<'_>, frame: &Frame| side.mission.place(frame.span);
    let alone = |frame: &Frame, side: Side<'_>, other: Side<'_>, does: &str, way: &str| {
        let Frame { id, name, .. } = frame;
        let message = format!(
            "frame {id}, `{name}` of `{}`, is {does} by nobody at `{}`",
            side.processor, other.processor
        );
        let hint = format!(
            "declare it there, as in `frame {name} {id} {way} on {} …`",
            other.link.name
        );
        let there = other.mission.place(other.link.span);
        Diagnostic::new(Code::E008, place, message)
            .related(place_of(side, frame), "it is declared here")
            .related(there, "this is the link's other end")
            .hint(hint)
    };
    for sent in sender.frames(Direction::Out) {
        let mut others = receiver.frames(Direction::In);
        let Some(received) = others.find(|it| it.id == sent.id) else {
            found.push(alone(sent, sender, receiver, "received", "in"));
            continue;
        };
        let mut differ = |what: &str, at_sender: String, at_receiver: String| {
            let message = format!(
                "the ends mean another {what} each by frame {}: {at_sender} at `{}`, {at_receiver} at `{}`",
                sent.id, sender.processor, receiver.processor
            );
            let sends = format!("`{}` sends it", sender.processor);
            let receives = format!("`{}` receives it", receiver.processor);
            found.push(
                Diagnostic::new(Code::E008, place, message)
                    .related(place_of(sender, sent), sends)
                    .related(place_of(receiver, received), receives)
                    .hint("declare it alike at both ends: else nothing of it is taken"),
            );
        };
        if !are_alike(&sent.content, &received.content) {
            differ("content", words(&sent.content), words(&received.content));
        }
        if sent.payload_bytes != received.payload_bytes {
            let bytes = |frame: &Frame| format!("{} bytes", frame.payload_bytes.unwrap_or(0));
            differ("payload", bytes(sent), bytes(received));
        }
        if sent.period_us != received.period_us {
            let time = |it: &Frame| crate::duration::time(it.period_us.unwrap_or(0).into());
            differ("period", time(sent), time(received));
        }
    }
    for received in receiver.frames(Direction::In) {
        if !sender.frames(Direction::Out).any(|it| it.id == received.id) {
            found.push(alone(received, receiver, sender, "sent", "out"));
        }
    }
}

/// Looks whether each identifier has one sender: on a bus, who sends the same one at the same time
/// damages both frames.
fn one_sender(place: Span, first: Side<'_>, second: Side<'_>, found: &mut Vec<Diagnostic>) {
    for sent in first.frames(Direction::Out) {
        let mut others = second.frames(Direction::Out);
        let Some(other) = others.find(|it| it.id == sent.id) else {
            continue;
        };
        let message = format!(
            "both ends send a frame {}: `{}` of `{}` and `{}` of `{}`",
            sent.id, sent.name, first.processor, other.name, second.processor
        );
        found.push(
            Diagnostic::new(Code::E014, place, message)
                .related(first.mission.place(sent.span), "it is declared here")
                .related(second.mission.place(other.span), "and here")
                .hint("on CAN each identifier has one sender: give one of both another number"),
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
    use crate::lang::load_text;
    use crate::system::read::read;

    const FILE: &str = "processor base mission \"base.esm\";\n\
        processor head mission \"head.esm\";\n\
        link base.radio to head.line;";
    const BASE: &str = "link radio rate 115200 bps header 6 bytes;\n\
        frame pose 7 out on radio: Pose payload 12 bytes period 100 ms;\n\
        frame alarm 8 in on radio flags lost, low payload 1 bytes rate 20 Hz;\n";
    // Names are each end's own.
    const HEAD: &str = "link line rate 115200 bps header 6 bytes;\n\
        frame spot 7 in on line: Pose payload 12 bytes period 100 ms;\n\
        frame trouble 8 out on line flags gone, flat payload 1 bytes period 50 ms;\n";

    fn found(base: &str, head: &str) -> Vec<Diagnostic> {
        found_over("", base, head)
    }

    fn found_over(medium: &str, base: &str, head: &str) -> Vec<Diagnostic> {
        let (base, head) = (load_text("base.esm", base), load_text("head.esm", head));
        let mission = |model, first_file| Mission { model, first_file };
        let missions = [
            mission(base.model.as_ref(), 1),
            mission(head.model.as_ref(), 2),
        ];
        let file = FILE.replace("head.line", &format!("head.line {medium}"));
        check(&read(&file).0.unwrap(), &missions)
    }

    #[test]
    fn a_medium_has_its_needs() {
        let without = |text: &str, words: &str| text.replace(" header 6 bytes", words);
        let short = found(&without(BASE, ""), &without(HEAD, ""));
        let messages: Vec<&str> = short.iter().map(|it| it.message.as_str()).collect();
        assert_eq!(
            messages,
            [
                "a frame takes 6 bytes of a line before and behind payload and checksum, and `radio` of `base` plans 4",
                "a frame takes 6 bytes of a line before and behind payload and checksum, and `line` of `head` plans 4",
            ]
        );
        assert!(short.iter().all(|it| it.code == Code::E014));
        let hint = short[0].hint.as_deref();
        assert_eq!(hint, Some("write `header 6 bytes` there, or `gap 174 us`"));
        // A gap that is long enough does as well; memory needs nothing, and CAN has its own limit.
        let gap = " gap 174 us";
        assert_eq!(found(&without(BASE, gap), &without(HEAD, gap)), []);
        let memory = found_over("over memory", &without(BASE, ""), &without(HEAD, ""));
        assert_eq!(memory, []);
        let long = found_over("over can", BASE, HEAD);
        let messages: Vec<&str> = long.iter().map(|it| it.message.as_str()).collect();
        assert_eq!(
            messages,
            [
                "a frame of CAN carries at most 8 bytes, and `pose` of `base` has 12",
                "a frame of CAN carries at most 8 bytes, and `spot` of `head` has 12",
            ]
        );
    }

    #[test]
    fn an_identifier_has_one_sender_on_a_bus() {
        let one = "link radio rate 500000 bps;\n\
            frame there 7 out on radio flags a payload 1 bytes period 50 ms;\n\
            frame back 7 in on radio flags b payload 1 bytes period 50 ms;\n";
        let other = one.replace("radio", "line");
        let doubled = found_over("over can", one, &other);
        let messages: Vec<&str> = doubled.iter().map(|it| it.message.as_str()).collect();
        assert_eq!(
            messages,
            ["both ends send a frame 7: `there` of `base` and `there` of `head`"]
        );
        assert_eq!((doubled[0].code, doubled[0].related.len()), (Code::E014, 2));
        // Each direction of a line has identifiers of its own.
        assert_eq!(found_over("over memory", one, &other), []);
    }

    #[test]
    fn ends_that_fit_are_silent() {
        assert_eq!(found(BASE, HEAD), []);
        // What is wrong with a mission itself is said elsewhere.
        assert_eq!(found("link", HEAD), []);
    }

    #[test]
    fn each_difference_is_told_with_both_sides() {
        let cases = [
            (
                BASE.replace("115200", "9600"),
                HEAD.to_owned(),
                "the ends of this link have another rate each: 9600 bps at `base`, 115200 bps at `head`",
            ),
            (
                BASE.to_owned(),
                HEAD.replace("bps", "bps bits 11"),
                "the ends of this link have another length of a byte each: 10 bits at `base`",
            ),
            (
                BASE.to_owned(),
                HEAD.replace("6 bytes", "8 bytes"),
                "the ends of this link have another header each: 6 bytes at `base`, 8 bytes at `head`",
            ),
            (
                BASE.replace("12 bytes", "8 bytes"),
                HEAD.to_owned(),
                "the ends mean another payload each by frame 7: 8 bytes at `base`, 12 bytes at `head`",
            ),
            (
                BASE.to_owned(),
                HEAD.replace("100 ms", "2500 us"),
                "the ends mean another period each by frame 7: 100 ms at `base`, 2.5 ms at `head`",
            ),
            (
                BASE.to_owned(),
                HEAD.replace("Pose", "Twist"),
                "the ends mean another content each by frame 7: a `Pose` at `base`, a `Twist` at `head`",
            ),
            (
                BASE.replace("lost, low", "lost"),
                HEAD.to_owned(),
                "the ends mean another content each by frame 8: 2 flags at `head`, 1 flag at `base`",
            ),
        ];
        for (base, head, expected) in cases {
            let found = found(&base, &head);
            assert_eq!(found.len(), 1, "{found:#?}");
            assert!(found[0].message.starts_with(expected), "{found:#?}");
            assert_eq!(
                &FILE[found[0].span.start as usize..],
                "base.radio to head.line;"
            );
            let files: Vec<u32> = found[0].related.iter().map(|it| it.0.file).collect();
            assert!(
                [[1, 2], [2, 1]].contains(&[files[0], files[1]]),
                "{found:#?}"
            );
        }
    }

    #[test]
    fn a_frame_and_a_link_without_their_other_end_are_told() {
        let without = |text: &str, frame: &str| -> String {
            let lines = text.lines().filter(|line| !line.contains(frame));
            lines.map(|line| format!("{line}\n")).collect()
        };
        let open = found(
            BASE,
            &format!("{HEAD}link spare rate 9600 bps header 6 bytes;"),
        );
        let cases = [
            (open, "link `spare` of `head` leads nowhere"),
            (
                found(BASE, &without(HEAD, "spot")),
                "frame 7, `pose` of `base`, is received by nobody at `head`",
            ),
            (
                found(BASE, &without(HEAD, "trouble")),
                "frame 8, `alarm` of `base`, is sent by nobody at `head`",
            ),
            (found(BASE, ""), "the mission of `head` has no link `line`"),
        ];
        for (found, expected) in cases {
            assert_eq!(found.len(), 1, "{found:#?}");
            assert_eq!(found[0].message, expected);
        }
    }
}
