//! Reads a system file: every mistake at once, and the rest all the same.

use super::declaration::{
    End, Link, MAX_LINKS, MAX_PROCESSORS, MAX_RESETS, Medium, Named, Pins, Processor, System,
};
use super::token::{Kind, Token, span, tokens};
use crate::boards;
use crate::lang::lexer::RESERVED_WORDS;
use crate::lang::{Code, Diagnostic, is_name};
use crate::medium::chance::Chance;
use crate::medium::clock::MAX_DRIFT_PPM;
use crate::medium::{Cut, PS_IN_US};
use crate::model::Span;
use crate::nearest::nearest;

/// The longest time that a file may say, in microseconds: ten days.
const MAX_TIME_US: u64 = 10 * 24 * 3_600 * 1_000_000;
/// Billionths in a millionth.
const PPB_IN_PPM: f64 = 1_000.0;
/// Words of a processor and of a link, for whoever has mistyped one.
const PROCESSOR_WORDS: [&str; 6] = ["mission", "board", "pins", "drift", "start", "reset"];
const LINK_WORDS: [&str; 6] = ["over", "delay", "noise", "loss", "byte_loss", "cut"];
const STATEMENTS: [&str; 3] = ["world", "processor", "link"];

/// Reads the text of a system file. The system is there where nothing is wrong; places of
/// diagnostics are those of file 0.
#[must_use]
pub fn read(text: &str) -> (Option<System>, Vec<Diagnostic>) {
    let mut reader = Reader {
        tokens: tokens(text),
        at: 0,
        end: span(text.len(), text.len()),
        found: Vec::new(),
        system: System::default(),
        links: Vec::new(),
    };
    reader.file();
    reader.resolve();
    let Reader {
        mut found, system, ..
    } = reader;
    found.sort_by_key(|it| (it.span, it.code));
    (found.is_empty().then_some(system), found)
}

/// A statement cannot be read on: what is wrong was said.
struct Broken;

/// A link before its ends were looked up.
struct ReadLink {
    ends: [Named; 2],
    link: Link,
}

struct Reader<'t> {
    tokens: Vec<Token<'t>>,
    at: usize,
    end: Span,
    found: Vec<Diagnostic>,
    system: System,
    links: Vec<ReadLink>,
}

impl<'t> Reader<'t> {
    fn file(&mut self) {
        while let Some(first) = self.peek() {
            let is_read = match (first.kind, first.text) {
                (Kind::Word, "world") => self.world(),
                (Kind::Word, "processor") => self.processor(),
                (Kind::Word, "link") => self.link(),
                (Kind::Word, word) if RESERVED_WORDS.contains(&word) => {
                    // One message says all: each statement would be as wrong.
                    self.mission_in_place_of_system(first);
                    return;
                }
                _ => {
                    let wanted = "`world`, `processor` or `link`";
                    self.unexpected(Some(first), wanted, &STATEMENTS)
                }
            };
            if is_read.is_err() {
                self.skip_statement();
            }
        }
        if self.system.processors.is_empty() && self.found.is_empty() {
            let message = "a system has a processor at least";
            let hint = "declare one: `processor base mission \"base.esm\" pins motors, encoders;`";
            self.found
                .push(Diagnostic::new(Code::E013, self.end, message).hint(hint));
        }
    }

    fn peek(&self) -> Option<Token<'t>> {
        self.tokens.get(self.at).copied()
    }

    /// To the next statement: behind a `;`, or before a word that begins one.
    fn skip_statement(&mut self) {
        while let Some(token) = self.peek() {
            let begins = token.kind == Kind::Word && STATEMENTS.contains(&token.text);
            if begins {
                break;
            }
            self.at += 1;
            if token.kind == Kind::Sign(';') {
                break;
            }
        }
    }

    fn unexpected<T>(
        &mut self,
        token: Option<Token<'t>>,
        wanted: &str,
        words: &[&'static str],
    ) -> Result<T, Broken> {
        let (place, message) = match token {
            None => (self.end, format!("the file ends where {wanted} is missing")),
            Some(token) => {
                let what = match token.kind {
                    Kind::OpenText => "a text without its second `\"`".to_owned(),
                    Kind::Text => format!("the text \"{}\"", token.text),
                    _ => format!("`{}`", token.text),
                };
                (token.span, format!("expected {wanted}, found {what}"))
            }
        };
        let mut diagnostic = Diagnostic::new(Code::E001, place, message);
        let word = token.map_or("", |token| token.text);
        if let Some(meant) = nearest(word, words.iter().copied()) {
            diagnostic = diagnostic.hint(format!("did you mean `{meant}`?"));
        }
        self.found.push(diagnostic);
        Err(Broken)
    }

    fn mission_in_place_of_system(&mut self, first: Token<'t>) {
        let message = format!("`{}` begins a statement of a mission", first.text);
        let hint = "a system file names the files of missions: \
                    `processor base mission \"base.esm\" pins motors, encoders;`";
        self.found
            .push(Diagnostic::new(Code::E001, first.span, message).hint(hint));
    }

    fn word(&mut self, wanted: &str) -> Result<Token<'t>, Broken> {
        match self.peek() {
            Some(token) if token.kind == Kind::Word => {
                self.at += 1;
                Ok(token)
            }
            other => self.unexpected(other, wanted, &[]),
        }
    }

    fn text(&mut self, wanted: &str) -> Result<Named, Broken> {
        match self.peek() {
            Some(token) if token.kind == Kind::Text && !token.text.is_empty() => {
                self.at += 1;
                Ok(named(token))
            }
            other => self.unexpected(other, wanted, &[]),
        }
    }

    fn keyword(&mut self, word: &'static str) -> Result<Span, Broken> {
        match self.peek() {
            Some(token) if token.kind == Kind::Word && token.text == word => {
                self.at += 1;
                Ok(token.span)
            }
            other => self.unexpected(other, &format!("`{word}`"), &[word]),
        }
    }

    /// The next word of a statement, or none at its `;`.
    fn clause(&mut self, words: &[&'static str]) -> Result<Option<Token<'t>>, Broken> {
        match self.peek() {
            Some(token) if token.kind == Kind::Sign(';') => {
                self.at += 1;
                Ok(None)
            }
            Some(token) if token.kind == Kind::Word && words.contains(&token.text) => {
                self.at += 1;
                Ok(Some(token))
            }
            other => self.unexpected(
                other,
                &format!("`;` or one of: {}", words.join(", ")),
                words,
            ),
        }
    }

    /// Says so where a clause comes twice.
    fn once(&mut self, seen: &mut Vec<&'t str>, clause: Token<'t>) {
        if seen.contains(&clause.text) {
            let message = format!("`{}` stands twice in this statement", clause.text);
            let twice = Diagnostic::new(Code::E003, clause.span, message);
            self.found.push(twice.hint("remove one of them"));
        }
        seen.push(clause.text);
    }

    fn number(&mut self, wanted: &str) -> Result<(f64, Span), Broken> {
        let token = self.word(wanted)?;
        match token.text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok((number, token.span)),
            _ => self.unexpected(Some(token), wanted, &[]),
        }
    }

    fn out_of_range<T>(&mut self, place: Span, message: String) -> Result<T, Broken> {
        self.found.push(Diagnostic::new(Code::E001, place, message));
        Err(Broken)
    }

    /// A time with its unit, in whole microseconds.
    fn time(&mut self) -> Result<u64, Broken> {
        let token = self.word("a time, such as `200 us`")?;
        let Ok(number) = token.text.parse::<u64>() else {
            return self.unexpected(
                Some(token),
                "a whole number of `us`, `ms`, `s` or `min`",
                &[],
            );
        };
        let unit = self.word("a unit: `us`, `ms`, `s` or `min`")?;
        let unit_us = match unit.text {
            "us" => 1,
            "ms" => 1_000,
            "s" => 1_000_000,
            "min" => 60_000_000,
            _ => return self.unexpected(Some(unit), "`us`, `ms`, `s` or `min`", &[]),
        };
        match number.checked_mul(unit_us).filter(|us| *us <= MAX_TIME_US) {
            Some(us) => Ok(us),
            None => self.out_of_range(token.span, "a time is at most ten days".to_owned()),
        }
    }

    /// A probability, as a number from 0 to 1 or in per cent.
    fn chance(&mut self) -> Result<Chance, Broken> {
        let (number, place) = self.number("a probability, such as `1e-5` or `1 %`")?;
        let mut probability = number;
        if self.peek().is_some_and(|it| it.kind == Kind::Sign('%')) {
            self.at += 1;
            probability /= 100.0;
        }
        match Chance::new(probability) {
            Some(chance) => Ok(chance),
            None => self.out_of_range(place, "a probability is 0 to 1, or 0 to 100 %".to_owned()),
        }
    }

    fn world(&mut self) -> Result<(), Broken> {
        let place = self.keyword("world")?;
        let world = self.text("a world in quotes, such as `\"office\"`")?;
        self.clause(&[])?;
        if let Some(first) = &self.system.world {
            let twice = Diagnostic::new(Code::E003, place, "the world is named twice")
                .related(first.span, "it is named here first")
                .hint("remove one of them");
            self.found.push(twice);
            return Ok(());
        }
        self.system.world = Some(world);
        Ok(())
    }

    fn name(&mut self, wanted: &str) -> Result<Named, Broken> {
        let token = self.word(wanted)?;
        if is_name(token.text) {
            return Ok(named(token));
        }
        self.unexpected(Some(token), wanted, &[])
    }

    fn processor(&mut self) -> Result<(), Broken> {
        self.keyword("processor")?;
        let name = self.name("the processor's name")?;
        self.keyword("mission")?;
        let mission = self.text("the mission's file in quotes")?;
        let mut processor = Processor {
            name,
            mission,
            board: None,
            pins: Vec::new(),
            drift_ppb: 0,
            start_us: 0,
            resets: Vec::new(),
        };
        let mut seen = vec!["mission"];
        while let Some(clause) = self.clause(&PROCESSOR_WORDS)? {
            if clause.text != "reset" {
                self.once(&mut seen, clause);
            }
            match clause.text {
                "board" => {
                    let board = self.word("a board's name")?;
                    if let Err(unknown) = boards::find(board.text) {
                        let message = unknown.to_string();
                        let unknown = Diagnostic::new(Code::E002, board.span, message);
                        self.found.push(unknown);
                    }
                    processor.board = Some(named(board));
                }
                "pins" => self.pins(&mut processor)?,
                "drift" => processor.drift_ppb = self.drift()?,
                "start" => processor.start_us = self.time()?,
                "reset" => {
                    let place = clause.span;
                    let reset = self.cut()?;
                    if processor.resets.len() == MAX_RESETS {
                        let message = format!("a processor has at most {MAX_RESETS} resets");
                        (self.found).push(Diagnostic::new(Code::E012, place, message));
                        continue;
                    }
                    processor.resets.push(reset);
                }
                _ => {
                    self.text("a file")?;
                }
            }
        }
        processor.resets.sort_by_key(|it| it.from_ps);
        let start_ps = processor.start_us * PS_IN_US;
        let ends = processor.resets.iter().map(|it| it.to_ps);
        let begins = processor.resets.iter().map(|it| it.from_ps);
        if (begins.zip([start_ps].into_iter().chain(ends))).any(|(begin, end)| begin <= end) {
            let message =
                "a reset begins after its processor has started, at first and after each reset";
            (self.found).push(Diagnostic::new(Code::E001, processor.name.span, message));
        }
        let of_name = |it: &&Processor| it.name.text == processor.name.text;
        if let Some(first) = self.system.processors.iter().find(of_name) {
            let message = format!("processor `{}` is defined twice", processor.name.text);
            let twice = Diagnostic::new(Code::E003, processor.name.span, message)
                .related(first.name.span, "it is defined here first")
                .hint("give the second one another name or remove it");
            self.found.push(twice);
        } else if self.system.processors.len() == MAX_PROCESSORS {
            let message = format!("a system has at most {MAX_PROCESSORS} processors");
            let many = Diagnostic::new(Code::E012, processor.name.span, message);
            self.found.push(many);
        } else {
            self.system.processors.push(processor);
        }
        Ok(())
    }

    fn pins(&mut self, processor: &mut Processor) -> Result<(), Broken> {
        loop {
            let word = self.word("pins of the body, such as `motors`")?;
            let known = Pins::ALL.iter().find(|(name, _)| *name == word.text);
            let others = self.system.processors.iter();
            match known {
                None => {
                    let names = Pins::ALL.map(|(name, _)| name);
                    let message = format!("the body has no pins `{}`", word.text);
                    let hint = match nearest(word.text, names) {
                        Some(meant) => format!("did you mean `{meant}`?"),
                        None => format!("there are: {}", names.join(", ")),
                    };
                    let unknown = Diagnostic::new(Code::E002, word.span, message);
                    self.found.push(unknown.hint(hint));
                }
                Some((name, pins)) => {
                    let mut owners = others.filter(|other| other.pins.contains(pins));
                    if let Some(owner) = owners.next() {
                        let message = format!("`{name}` are pins of two processors");
                        let twice = Diagnostic::new(Code::E003, word.span, message)
                            .related(owner.name.span, "this one has them, too")
                            .hint("a pin leads to one processor: let the other one send a frame");
                        self.found.push(twice);
                    } else if processor.pins.contains(pins) {
                        let message = format!("`{name}` stands twice");
                        let twice = Diagnostic::new(Code::E003, word.span, message);
                        self.found.push(twice.hint("remove one of them"));
                    } else {
                        processor.pins.push(*pins);
                    }
                }
            }
            if self.peek().is_none_or(|it| it.kind != Kind::Sign(',')) {
                return Ok(());
            }
            self.at += 1;
        }
    }

    /// By how much a clock gains, in billionths.
    fn drift(&mut self) -> Result<i32, Broken> {
        let (ppm, place) = self.number("a number of `ppm`, such as `-80 ppm`")?;
        self.keyword("ppm")?;
        if ppm.abs() > f64::from(MAX_DRIFT_PPM) {
            let message = format!("a drift is at most {MAX_DRIFT_PPM} ppm, fast or slow");
            return self.out_of_range(place, message);
        }
        Ok(libm::round(ppm * PPB_IN_PPM) as i32)
    }

    fn link(&mut self) -> Result<(), Broken> {
        const END: &str = "an end of the link, as PROCESSOR.LINK";
        self.keyword("link")?;
        let first = named(self.word(END)?);
        self.keyword("to")?;
        let second = named(self.word(END)?);
        let end = |of: &Named| End {
            processor: 0,
            link: String::new(),
            span: of.span,
        };
        let mut link = Link {
            ends: [end(&first), end(&second)],
            medium: Medium::Line,
            delay_us: 0,
            noise: Chance::NEVER,
            loss: Chance::NEVER,
            byte_loss: Chance::NEVER,
            cuts: Vec::new(),
        };
        let mut seen = Vec::new();
        let mut clauses = Vec::new();
        while let Some(clause) = self.clause(&LINK_WORDS)? {
            if clause.text != "cut" {
                self.once(&mut seen, clause);
            }
            match clause.text {
                "over" => link.medium = self.medium()?,
                "delay" => link.delay_us = self.time()?,
                "noise" => link.noise = self.chance()?,
                "loss" => link.loss = self.chance()?,
                "byte_loss" => link.byte_loss = self.chance()?,
                _ => link.cuts.push(self.cut()?),
            }
            clauses.push(clause);
        }
        let is_strange = |clause: &&Token<'_>| match link.medium {
            Medium::Line => false,
            Medium::Memory => clause.text != "over",
            Medium::Can => matches!(clause.text, "delay" | "byte_loss"),
        };
        if let Some(strange) = clauses.iter().find(is_strange) {
            let message = format!("this medium has no `{}`", strange.text);
            let wrong = Diagnostic::new(Code::E001, strange.span, message);
            let hint = "remove it, or let the link go `over line`";
            self.found.push(wrong.hint(hint));
        }
        if self.links.len() == MAX_LINKS {
            let message = format!("a system has at most {MAX_LINKS} links");
            self.found
                .push(Diagnostic::new(Code::E012, first.span, message));
            return Ok(());
        }
        let ends = [first, second];
        self.links.push(ReadLink { ends, link });
        Ok(())
    }

    fn medium(&mut self) -> Result<Medium, Broken> {
        let names = Medium::ALL.map(Medium::name);
        let word = self.word("`line`, `memory` or `can`")?;
        match Medium::ALL.into_iter().find(|it| it.name() == word.text) {
            Some(medium) => Ok(medium),
            None => self.unexpected(Some(word), "`line`, `memory` or `can`", &names),
        }
    }

    fn cut(&mut self) -> Result<Cut, Broken> {
        let place = self.peek().map_or(self.end, |token| token.span);
        let from_us = self.time()?;
        self.keyword("to")?;
        let to_us = self.time()?;
        if to_us <= from_us {
            return self.out_of_range(place, "the second time is after the first".to_owned());
        }
        Ok(Cut {
            from_ps: from_us * PS_IN_US,
            to_ps: to_us * PS_IN_US,
        })
    }

    /// Looks the ends of links up.
    fn resolve(&mut self) {
        let mut taken: Vec<Named> = Vec::new();
        for ReadLink { ends, mut link } in std::mem::take(&mut self.links) {
            let mut is_whole = true;
            for (end, of) in link.ends.iter_mut().zip(&ends) {
                match self.end(of, &taken) {
                    Ok((processor, name)) => {
                        end.processor = processor;
                        end.link = name;
                    }
                    Err(wrong) => {
                        self.found.push(wrong);
                        is_whole = false;
                    }
                }
                taken.push(of.clone());
            }
            let [first, second] = &link.ends;
            if is_whole && first.processor == second.processor {
                let message = "a link leads from a processor to itself";
                let itself = Diagnostic::new(Code::E008, second.span, message);
                let hint = "name the other processor, or join the ports with a `path`";
                self.found.push(itself.hint(hint));
                is_whole = false;
            }
            if is_whole {
                self.system.links.push(link);
            }
        }
    }

    fn end(&self, of: &Named, taken: &[Named]) -> Result<(usize, String), Diagnostic> {
        let parts: Vec<&str> = of.text.split('.').collect();
        let [processor, link] = parts[..] else {
            let message = format!("expected PROCESSOR.LINK, found `{}`", of.text);
            return Err(Diagnostic::new(Code::E001, of.span, message));
        };
        let names = self
            .system
            .processors
            .iter()
            .map(|it| it.name.text.as_str());
        let Some(index) = names.clone().position(|name| name == processor) else {
            let message = format!("there is no processor `{processor}`");
            let unknown = Diagnostic::new(Code::E002, of.span, message);
            return Err(match nearest(processor, names) {
                Some(meant) => unknown.hint(format!("did you mean `{meant}`?")),
                None => unknown.hint("declare it: `processor NAME mission \"FILE\";`"),
            });
        };
        if !is_name(link) {
            let message = format!("`{link}` cannot be the name of a link");
            return Err(Diagnostic::new(Code::E001, of.span, message));
        }
        if let Some(first) = taken.iter().find(|it| it.text == of.text) {
            let message = format!("`{}` is an end of two links", of.text);
            return Err(Diagnostic::new(Code::E003, of.span, message)
                .related(first.span, "here it is, too")
                .hint("a line has two ends: declare another link in the mission"));
        }
        Ok((index, link.to_owned()))
    }
}

fn named(token: Token<'_>) -> Named {
    Named {
        text: token.text.to_owned(),
        span: token.span,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::SourceFile;
    use proptest::prelude::*;

    fn messages(text: &str) -> Vec<String> {
        let file = SourceFile {
            path: "robot.system".to_owned(),
            text: text.to_owned(),
        };
        let positions = [file];
        let positions = crate::lang::Positions::new(&positions);
        let found = read(text).1.into_iter().map(|it| {
            let place = positions.of(it.span);
            format!("{}:{} {} {}", place.line, place.col, it.code, it.text())
        });
        found.collect()
    }

    #[test]
    fn a_system_is_what_its_file_says() {
        let text = "// Two processors.\nworld \"office\";\n\
            processor base mission \"base.esm\" board host pins motors, encoders;\n\
            processor head mission \"head.esm\" pins sonars drift -80.5 ppm start 20 ms\n\
            reset 7 s to 8 s reset 4 s to 4100 ms;\n\
            link base.radio to head.base over line delay 200 us noise 1e-5 loss 1 %\n\
            cut 3 s to 5 s cut 1 min to 70 s;";
        let (system, found) = read(text);
        assert_eq!(found, []);
        let system = system.unwrap();
        assert_eq!(system.world.unwrap().text, "office");
        let [base, head] = &system.processors[..] else {
            panic!("two processors");
        };
        assert_eq!(
            (&base.name.text[..], &base.mission.text[..]),
            ("base", "base.esm")
        );
        assert_eq!(base.board.as_ref().unwrap().text, "host");
        assert_eq!(base.pins, [Pins::Motors, Pins::Encoders]);
        assert_eq!((head.drift_ppb, head.start_us), (-80_500, 20_000));
        let resets = head.resets.iter().map(|it| [it.from_ps, it.to_ps]);
        let ms = PS_IN_US * 1_000;
        assert_eq!(
            resets.collect::<Vec<_>>(),
            [[4_000 * ms, 4_100 * ms], [7_000 * ms, 8_000 * ms]]
        );
        // It is there three times, and its clock begins anew.
        let lives: Vec<_> = (head.lives().iter())
            .map(|it| (it.clock.plant_ps(0) / ms, it.from_ps / ms, it.to_ps / ms))
            .collect();
        let end_ms = u64::MAX / ms;
        assert_eq!(
            lives,
            [
                (20, 0, 4_000),
                (4_100, 4_100, 7_000),
                (8_000, 8_000, end_ms)
            ]
        );
        assert_eq!(base.lives().len(), 1);
        let [link] = &system.links[..] else {
            panic!("a link");
        };
        let ends: Vec<_> = link
            .ends
            .iter()
            .map(|it| (it.processor, &it.link[..]))
            .collect();
        assert_eq!(ends, [(0, "radio"), (1, "base")]);
        assert_eq!((link.medium, link.delay_us), (Medium::Line, 200));
        assert_eq!(Some(link.noise), Chance::new(1e-5));
        assert_eq!(Some(link.loss), Chance::new(0.01));
        let cuts: Vec<_> = link.cuts.iter().map(|it| (it.from_ps, it.to_ps)).collect();
        let second = PS_IN_US * 1_000_000;
        assert_eq!(cuts, [(3 * second, 5 * second), (60 * second, 70 * second)]);
    }

    #[test]
    fn each_mistake_has_its_code_and_its_place() {
        let base = "processor base mission \"base.esm\" pins motors;";
        let head = "processor head mission \"head.esm\";";
        let cases = [
            ("", "1:1 E013 a system has a processor at least"),
            (
                "procesor",
                "1:1 E001 expected `world`, `processor` or `link`, found `procesor`: did",
            ),
            (
                "use \"rover.esm\";\nmachine M {\n",
                "1:1 E001 `use` begins a statement of a mission: a system file names",
            ),
            (
                "world \"a\"; world \"b\";",
                "1:12 E003 the world is named twice",
            ),
            ("world \"a;\n", "1:7 E001 expected a world in quotes"),
            (
                "processor 1a mission \"a\";",
                "1:11 E001 expected the processor's name, found `1a`",
            ),
            (
                "processor a mision \"a\";",
                "1:13 E001 expected `mission`, found `mision`: did",
            ),
            (
                "processor a mission \"a\" pin motors;",
                "1:25 E001 expected `;` or one of",
            ),
            (
                "processor a mission \"a\" pins motor;",
                "1:30 E002 the body has no pins `motor`: did",
            ),
            (
                "processor a mission \"a\" pins gyro, gyro;",
                "1:36 E003 `gyro` stands twice",
            ),
            ("processor a mission \"a\" board hst;", "1:31 E002 "),
            (
                "processor a mission \"a\" drift 1e9 ppm;",
                "1:31 E001 a drift is at most",
            ),
            (
                "processor a mission \"a\" drift 1 pm;",
                "1:33 E001 expected `ppm`",
            ),
            (
                "processor a mission \"a\" start 1 h;",
                "1:33 E001 expected `us`, `ms`, `s` or `min`",
            ),
            (
                "processor a mission \"a\" start 20000 min;",
                "1:31 E001 a time is at most ten days",
            ),
            (
                "processor a mission \"a\" start 1 s start 2 s;",
                "1:35 E003 `start` stands twice",
            ),
            (
                "processor a mission \"a\" reset 1 s to 2 s reset 2 s to 3 s;",
                "1:11 E001 a reset begins after",
            ),
            (
                "processor a mission \"a\" start 5 s reset 4 s to 6 s;",
                "1:11 E001 a reset begins after",
            ),
            (
                "processor a mission \"a\"",
                "1:24 E001 the file ends where `;` or one of",
            ),
            (
                "BASE processor base mission \"b\";",
                "1:58 E003 processor `base` is defined twice",
            ),
            (
                "BASE processor head mission \"h\" pins motors;",
                "1:80 E003 `motors` are pins of two processors",
            ),
            (
                "BASE HEAD link base.a head.b;",
                "1:95 E001 expected `to`, found `head.b`",
            ),
            (
                "BASE HEAD link base.a to hed.b;",
                "1:98 E002 there is no processor `hed`: did you",
            ),
            (
                "BASE HEAD link base to head.b;",
                "1:88 E001 expected PROCESSOR.LINK, found `base`",
            ),
            (
                "BASE HEAD link base.a to base.b;",
                "1:98 E008 a link leads from a processor to",
            ),
            (
                "BASE HEAD link base.a to head.b; link head.b to base.c;",
                "1:111 E003 `head.b` is an end of two links",
            ),
            (
                "BASE HEAD link base.a to head.b loss 2;",
                "1:110 E001 a probability is 0 to 1",
            ),
            (
                "BASE HEAD link base.a to head.b over memory delay 1 s;",
                "1:117 E001 this medium has no `delay`",
            ),
            (
                "BASE HEAD link base.a to head.b over air;",
                "1:110 E001 expected `line`, `memory`",
            ),
            (
                "BASE HEAD link base.a to head.b cut 5 s to 3 s;",
                "1:109 E001 the second time is after",
            ),
        ];
        for (text, expected) in cases {
            let text = text.replace("BASE", base).replace("HEAD", head);
            let found = messages(&text);
            assert_eq!(found.len(), 1, "{text}\n{found:#?}");
            assert!(found[0].starts_with(expected), "{text}\n{found:#?}");
        }
    }

    #[test]
    fn one_mistake_does_not_hide_the_next() {
        let text = "world 5;\nprocessor a mission \"a\" pins wings;\nlink a.x to b.y\nworld;";
        let codes: Vec<String> = (messages(text).iter())
            .map(|it| it[..8].to_owned())
            .collect();
        assert_eq!(codes, ["1:7 E001", "2:30 E00", "4:1 E001", "4:6 E001"]);
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_panic(
            words in proptest::collection::vec(
                prop_oneof![
                    Just("world"), Just("processor"), Just("link"), Just("mission"), Just("a.b"),
                    Just("\"a\""), Just(";"), Just(","), Just("%"), Just("to"), Just("cut"), Just("reset"),
                    Just("pins"), Just("motors"), Just("drift"), Just("-1e300"), Just("ppm"),
                    Just("\""), Just("\u{e9}"), Just("18446744073709551615"), Just("min"),
                ],
                0..40,
            ),
            tail in ".{0,20}",
        ) {
            let text = words.join(" ") + &tail;
            let (system, found) = read(&text);
            prop_assert_eq!(system.is_some(), found.is_empty());
            prop_assert!(found.iter().all(|it| it.span.end as usize <= text.len()));
        }
    }
}
