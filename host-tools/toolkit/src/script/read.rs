//! From a text to a script.

use esm_link::behaviours::{MAX_SCRIPT_STEPS, MAX_WATCHES, Reaction, Situation, Watch};

use super::steps::{Reading, Script, Step, is_behaviour, script_name, signature_hash};
use super::words::{self, Word};
use crate::lang::{Code, Diagnostic, Fix};
use crate::model::{Param, ParamType, SourceFile, Span, Task, Value};
use crate::nearest::nearest;

/// What the paper calls a behaviour, where it is not the name in lower case.
const OTHER_NAMES: [(&str, &str); 1] = [("turn", "turn_to")];

const UNLESS: &str = "unless";
const ARROW: &str = "->";
/// Behind the name of a place in a script.
const COLON: &str = ":";

/// Reads a script, for a firmware with these tasks.
pub fn read(name: &str, text: &str, tasks: &[Task]) -> Reading {
    let lines = words::lines(text);
    let mut reader = Reader::new(tasks);
    let (labels, lines) = reader.labels(&lines);
    reader.labels = labels;
    reader.steps = Some(lines.len());
    let mut all = Vec::new();
    let mut last = Span::default();
    for (index, (line, words)) in lines.into_iter().enumerate() {
        last = words.first().map_or(last, |word| word.span);
        reader.index = index;
        if let Some(step) = reader.line(line, words) {
            all.push(step);
        }
    }
    let steps = all.len();
    all.append(&mut reader.inserted);
    if all.len() > MAX_SCRIPT_STEPS {
        reader.say(
            Diagnostic::new(
                Code::E012,
                last,
                format!(
                    "the script has {} steps, with those that situations insert, and there is room for {MAX_SCRIPT_STEPS}",
                    all.len()
                ),
            )
            .hint("make two scripts of it"),
        );
    } else if all.is_empty() && reader.diagnostics.is_empty() {
        reader.say(
            Diagnostic::new(Code::E001, last, "the script has no step")
                .hint("write a behaviour a line: `go_to x_m = 1`"),
        );
    }
    reader.end(name, text, Script { all, steps })
}

/// Reads one behaviour that is to be inserted by itself.
pub fn read_line(name: &str, text: &str, tasks: &[Task]) -> Reading {
    let mut reader = Reader::new(tasks);
    let lines = words::lines(text);
    let mut script = Script::default();
    match &lines[..] {
        [(line, words)] => {
            script.all.extend(reader.line(*line, words));
            script.steps = 1;
        }
        _ => reader.say(Diagnostic::new(
            Code::E001,
            Span::default(),
            "one behaviour is expected, in one line",
        )),
    }
    reader.end(name, text, script)
}

/// A line of a script without its label: its number, and its words.
type Line<'w, 't> = (u32, &'w [Word<'t>]);

/// A label, and the index of the step that follows it.
type Label<'t> = (Word<'t>, usize);

struct Reader<'m, 't> {
    tasks: &'m [Task],
    diagnostics: Vec<Diagnostic>,
    /// What situations insert.
    inserted: Vec<Step>,
    /// How many steps the script has, behind which those are that situations insert; none where
    /// there is no script.
    steps: Option<usize>,
    /// Places that reactions go on with.
    labels: Vec<Label<'t>>,
    /// Which step is read.
    index: usize,
}

/// The words of a line from somewhere on.
struct Rest<'w, 't> {
    words: &'w [Word<'t>],
    /// Where the line ends.
    end: Span,
}

impl<'t> Rest<'_, 't> {
    fn peek(&self) -> Option<Word<'t>> {
        self.words.first().copied()
    }

    fn next(&mut self) -> Option<Word<'t>> {
        let (first, rest) = self.words.split_first()?;
        self.words = rest;
        Some(*first)
    }

    fn takes(&mut self, text: &str) -> bool {
        let is_there = self.peek().is_some_and(|word| word.text == text);
        if is_there {
            self.next();
        }
        is_there
    }

    /// Where the next word is, or the end of the line.
    fn place(&self) -> Span {
        self.peek().map_or(self.end, |word| word.span)
    }
}

/// A parameter as it is written.
struct Given<'t> {
    name: Word<'t>,
    value: Word<'t>,
}

/// That something is wrong, which was said.
struct Told;

impl<'m, 't> Reader<'m, 't> {
    fn new(tasks: &'m [Task]) -> Self {
        Self {
            tasks,
            diagnostics: Vec::new(),
            inserted: Vec::new(),
            steps: None,
            labels: Vec::new(),
            index: 0,
        }
    }

    /// The labels of a script, and its lines without them. A label stands alone in its line, or
    /// before a step.
    fn labels<'w>(
        &mut self,
        lines: &'w [(u32, Vec<Word<'t>>)],
    ) -> (Vec<Label<'t>>, Vec<Line<'w, 't>>) {
        let mut labels: Vec<Label<'t>> = Vec::new();
        let mut steps = Vec::new();
        for (line, words) in lines {
            let rest = match &words[..] {
                [label, colon, rest @ ..] if colon.text == COLON => {
                    let mut earlier = labels.iter().map(|(label, _)| label);
                    if let Some(first) = earlier.find(|first| first.text == label.text) {
                        let twice = format!("label `{}` is given twice", label.text);
                        let found = Diagnostic::new(Code::E003, label.span, twice);
                        self.say(found.related(first.span, "first here"));
                    }
                    labels.push((*label, steps.len()));
                    rest
                }
                words => words,
            };
            if !rest.is_empty() {
                steps.push((*line, rest));
            }
        }
        for (label, step) in &labels {
            if *step == steps.len() {
                self.say(
                    Diagnostic::new(
                        Code::E001,
                        label.span,
                        format!("no step stands behind label `{}`", label.text),
                    )
                    .hint("write one, or take the label away"),
                );
            }
        }
        (labels, steps)
    }

    fn say(&mut self, diagnostic: Diagnostic) {
        self.diagnostics.push(diagnostic);
    }

    fn end(mut self, name: &str, text: &str, script: Script) -> Reading {
        self.diagnostics
            .sort_by_key(|found| (found.span, found.code));
        Reading {
            files: [SourceFile {
                path: name.to_owned(),
                text: text.to_owned(),
            }],
            script: self.diagnostics.is_empty().then_some(script),
            diagnostics: self.diagnostics,
        }
    }

    fn line(&mut self, line: u32, words: &[Word<'_>]) -> Option<Step> {
        let end = words.last().map_or(Span::default(), |word| Span {
            start: word.span.end,
            ..word.span
        });
        let mut rest = Rest { words, end };
        let mut step = self.behaviour(line, &mut rest).ok()?;
        while let Some(word) = rest.peek() {
            if word.text != UNLESS {
                self.say(
                    Diagnostic::new(
                        Code::E001,
                        word.span,
                        format!("`{}` is not expected here", word.text),
                    )
                    .hint("after a behaviour and its parameters comes the end of the line, or `unless`; between parameters stands a comma"),
                );
                return None;
            }
            let watch = self.situation(line, &mut rest).ok()?;
            step.watches.extend(watch.to_bytes());
        }
        let watches = step.watches().count();
        if watches > MAX_WATCHES {
            self.say(Diagnostic::new(
                Code::E012,
                words.first().map_or(end, |word| word.span),
                format!(
                    "{watches} situations are watched beside this, and there is room for {MAX_WATCHES}"
                ),
            ));
        }
        Some(step)
    }

    /// A behaviour with its parameters.
    fn behaviour(&mut self, line: u32, rest: &mut Rest<'_, '_>) -> Result<Step, Told> {
        let place = rest.place();
        let Some(word) = rest.next() else {
            self.say(
                Diagnostic::new(Code::E001, place, "a behaviour is missing here")
                    .hint("`esm behaviours` lists those of a firmware"),
            );
            return Err(Told);
        };
        let task = self.task(word)?;
        let given = self.given(rest)?;
        let mut params = Vec::new();
        let mut is_whole = true;
        for given in &given {
            is_whole &= self.is_of(
                given,
                task.params.iter().map(|param| &*param.name),
                &task.name,
            );
        }
        is_whole &= self.are_different(&given);
        for param in &task.params {
            let of_param = given.iter().find(|given| given.name.text == param.name);
            match self.value(param, of_param, word) {
                Ok(bits) => params.extend(bits.to_le_bytes()),
                Err(Told) => is_whole = false,
            }
        }
        if !is_whole {
            return Err(Told);
        }
        Ok(Step {
            line,
            name: task.name.clone(),
            task: signature_hash(task),
            params,
            watches: Vec::new(),
        })
    }

    /// The behaviour of a name.
    fn task(&mut self, word: Word<'_>) -> Result<&'m Task, Told> {
        let tasks = self.tasks;
        let behaviours = || tasks.iter().filter(|task| is_behaviour(task));
        let other = OTHER_NAMES.iter().find(|(name, _)| *name == word.text);
        let name = other.map_or(word.text, |(_, name)| name);
        let is_it = |task: &&Task| task.name == name || script_name(&task.name) == name;
        if let Some(task) = behaviours().find(is_it) {
            return Ok(task);
        }
        let names: Vec<String> = behaviours().map(|task| script_name(&task.name)).collect();
        let mut found = Diagnostic::new(
            Code::E002,
            word.span,
            format!("this firmware has no behaviour `{}`", word.text),
        );
        found = match nearest(&script_name(word.text), names.iter().map(String::as_str)) {
            Some(near) => found
                .hint(format!("did you mean `{near}`?"))
                .fix(Fix::write(word.span, near)),
            None if names.is_empty() => found.hint("it has none at all: build it with behaviours"),
            None => found.hint(format!("it has {}", names.join(", "))),
        };
        self.say(found);
        Err(Told)
    }

    /// Parameters as they are written: `name = value`, with commas between.
    fn given<'g>(&mut self, rest: &mut Rest<'_, 'g>) -> Result<Vec<Given<'g>>, Told> {
        let mut given = Vec::new();
        let ends = |word: Option<Word<'_>>| {
            word.is_none_or(|word| word.text == UNLESS || word.text == ARROW)
        };
        if ends(rest.peek()) {
            return Ok(given);
        }
        loop {
            let place = rest.place();
            let name = rest.next();
            let has_sign = rest.takes("=");
            let value = if has_sign { rest.next() } else { None };
            let (Some(name), Some(value)) = (name, value) else {
                self.say(
                    Diagnostic::new(Code::E001, place, "a parameter is expected here")
                        .hint("write `name = value`, with a comma before the next"),
                );
                return Err(Told);
            };
            given.push(Given { name, value });
            if !rest.takes(",") {
                return Ok(given);
            }
        }
    }

    fn is_of<'n>(
        &mut self,
        given: &Given<'_>,
        names: impl Iterator<Item = &'n str> + Clone,
        owner: &str,
    ) -> bool {
        let is_there = names.clone().any(|name| name == given.name.text);
        if !is_there {
            let mut found = Diagnostic::new(
                Code::E002,
                given.name.span,
                format!("`{owner}` has no parameter `{}`", given.name.text),
            );
            found = match nearest(given.name.text, names.clone()) {
                Some(near) => found
                    .hint(format!("did you mean `{near}`?"))
                    .fix(Fix::write(given.name.span, near)),
                None if names.clone().next().is_none() => found.hint("it has none"),
                None => found.hint(format!("it has {}", names.collect::<Vec<_>>().join(", "))),
            };
            self.say(found);
        }
        is_there
    }

    fn are_different(&mut self, given: &[Given<'_>]) -> bool {
        for (place, later) in given.iter().enumerate() {
            let earlier = given.iter().take(place);
            if let Some(first) = earlier.clone().find(|it| it.name.text == later.name.text) {
                self.say(
                    Diagnostic::new(
                        Code::E003,
                        later.name.span,
                        format!("`{}` is given twice", later.name.text),
                    )
                    .related(first.name.span, "first here"),
                );
                return false;
            }
        }
        true
    }

    /// The bits of a parameter: of what is given, or of its default.
    fn value(
        &mut self,
        param: &Param,
        given: Option<&Given<'_>>,
        owner: Word<'_>,
    ) -> Result<u32, Told> {
        let value = match given {
            Some(given) => match parsed(param.param_type, given.value.text) {
                Some(value) => value,
                None => {
                    self.say(Diagnostic::new(
                        Code::E009,
                        given.value.span,
                        format!(
                            "`{}` is no value of parameter `{}`: {} is expected",
                            given.value.text,
                            param.name,
                            kind(param.param_type)
                        ),
                    ));
                    return Err(Told);
                }
            },
            None => match param.default {
                Some(value) => value,
                None => {
                    self.say(
                        Diagnostic::new(
                            Code::E009,
                            owner.span,
                            format!(
                                "parameter `{}` of `{}` has no value",
                                param.name, owner.text
                            ),
                        )
                        .hint(format!("it has no default: write `{} = …`", param.name)),
                    );
                    return Err(Told);
                }
            },
        };
        if let (Some((min, max)), Some(given)) = (param.range, given)
            && !(number(min)..=number(max)).contains(&number(value))
        {
            self.say(
                Diagnostic::new(
                    Code::E009,
                    given.value.span,
                    format!(
                        "{} is out of the range of parameter `{}`",
                        given.value.text, param.name
                    ),
                )
                .hint(format!("it takes {} to {}", shown(min), shown(max))),
            );
            return Err(Told);
        }
        Ok(match value {
            Value::Bool(value) => u32::from(value),
            Value::I32(value) => value.cast_unsigned(),
            Value::U32(value) => value,
            Value::F32(value) => value.to_bits(),
        })
    }

    /// `unless SITUATION name = value -> REACTION`.
    fn situation(&mut self, line: u32, rest: &mut Rest<'_, '_>) -> Result<Watch, Told> {
        rest.next();
        let names = Situation::ALL.map(|situation| situation.names().0);
        let place = rest.place();
        let word = rest.next();
        let found = word.and_then(|word| {
            let mut all = Situation::ALL.into_iter();
            let situation = all.find(|situation| situation.names().0 == word.text)?;
            Some((word, situation))
        });
        let Some((word, situation)) = found else {
            let near = word.and_then(|word| nearest(word.text, names));
            let mut found = match word {
                Some(word) => Diagnostic::new(
                    Code::E002,
                    word.span,
                    format!("there is no situation `{}`", word.text),
                ),
                None => Diagnostic::new(Code::E001, place, "a situation is missing here"),
            };
            found = match (near, word) {
                (Some(near), Some(word)) => found
                    .hint(format!("did you mean `{near}`?"))
                    .fix(Fix::write(word.span, near)),
                _ => found.hint(format!("there are {}", names.join(", "))),
            };
            self.say(found);
            return Err(Told);
        };
        let (name, parameter) = situation.names();
        let given = self.given(rest)?;
        for given in &given {
            let parameters = [parameter].into_iter().filter(|name| !name.is_empty());
            if !self.is_of(given, parameters, name) {
                return Err(Told);
            }
        }
        if !self.are_different(&given) {
            return Err(Told);
        }
        if parameter.is_empty() {
            return self.watch(line, rest, situation, 0.0);
        }
        let Some(given) = given.first() else {
            self.say(
                Diagnostic::new(
                    Code::E009,
                    word.span,
                    format!("parameter `{parameter}` of `{name}` has no value"),
                )
                .hint(format!("write `{name} {parameter} = …`")),
            );
            return Err(Told);
        };
        let value = given.value.text.parse::<f32>().ok();
        let most = situation.most();
        let Some(value) = value.filter(|value| (0.0..=most).contains(value)) else {
            let expected = if most < f32::MAX {
                format!("0 to {most}")
            } else {
                "0 on".to_owned()
            };
            self.say(Diagnostic::new(
                Code::E009,
                given.value.span,
                format!(
                    "`{}` is no value of `{parameter}`: a number from {expected} is expected",
                    given.value.text
                ),
            ));
            return Err(Told);
        };
        self.watch(line, rest, situation, value)
    }

    /// A situation with what is done about it.
    fn watch(
        &mut self,
        line: u32,
        rest: &mut Rest<'_, '_>,
        situation: Situation,
        value: f32,
    ) -> Result<Watch, Told> {
        let place = rest.words.get(1).map_or(rest.end, |word| word.span);
        let reaction = self.reaction(line, rest)?;
        if !situation.takes(reaction) {
            let (name, _) = situation.names();
            self.say(
                Diagnostic::new(
                    Code::E009,
                    place,
                    format!(
                        "a behaviour that has `{name}` is over: nothing else can be done with it"
                    ),
                )
                .hint("write cancel, which goes on with the next line, end, go_on with a label, or replace with a behaviour"),
            );
            return Err(Told);
        }
        Ok(Watch {
            situation,
            value,
            reaction,
        })
    }

    /// The step that a reaction goes on with.
    fn target(&mut self, rest: &mut Rest<'_, '_>) -> Result<Reaction, Told> {
        let place = rest.place();
        let word = rest.next();
        let label = word.and_then(|word| {
            let mut labels = self.labels.iter();
            labels.find(|(label, _)| label.text == word.text)
        });
        let found = match (label, word) {
            (Some((_, step)), _) if *step > self.index => {
                // A robot has room for fewer, which is said when all are known.
                let step = (*step).min(MAX_SCRIPT_STEPS - 1) as u8;
                return Ok(Reaction::GoOn(step));
            }
            (Some((label, _)), _) => Diagnostic::new(
                Code::E009,
                place,
                format!(
                    "`{}` is not behind this line, and a script goes on only with what is",
                    label.text
                ),
            )
            .related(label.span, "it is here"),
            (None, None) => Diagnostic::new(Code::E001, place, "a label is missing here")
                .hint("write `NAME:` before the line that it is to go on with, and its name here"),
            (None, Some(word)) => {
                let found = Diagnostic::new(
                    Code::E002,
                    place,
                    format!("this script has no label `{}`", word.text),
                );
                match nearest(word.text, self.labels.iter().map(|(label, _)| label.text)) {
                    Some(near) => found
                        .hint(format!("did you mean `{near}`?"))
                        .fix(Fix::write(place, near)),
                    None => found.hint("write it with a colon before the line that is to follow"),
                }
            }
        };
        self.say(found);
        Err(Told)
    }

    /// The behaviour that a reaction brings onto the list: which step of the script it is.
    fn other(&mut self, line: u32, rest: &mut Rest<'_, '_>, place: Span) -> Result<u8, Told> {
        let Some(steps) = self.steps else {
            self.say(
                Diagnostic::new(
                    Code::E001,
                    place,
                    "only a script can bring another behaviour",
                )
                .hint("write it into a file, and `esm script run` it"),
            );
            return Err(Told);
        };
        let step = self.behaviour(line, rest)?;
        let index = steps + self.inserted.len();
        self.inserted.push(step);
        // A robot has room for fewer, which is said when all are known.
        Ok(index.min(MAX_SCRIPT_STEPS - 1) as u8)
    }

    fn reaction(&mut self, line: u32, rest: &mut Rest<'_, '_>) -> Result<Reaction, Told> {
        let place = rest.place();
        if !rest.takes(ARROW) {
            self.say(
                Diagnostic::new(Code::E001, place, "what is to happen then is missing here").hint(
                    format!("write `-> ` and one of {}", Reaction::NAMES.join(", ")),
                ),
            );
            return Err(Told);
        }
        let place = rest.place();
        let word = rest.next();
        Ok(match word.map(|word| word.text) {
            Some("suspend") => Reaction::Suspend,
            Some("cancel") => Reaction::Cancel,
            Some("end") => Reaction::EndScript,
            Some("flag") => Reaction::Flag,
            Some("go_on") if self.steps.is_none() => {
                self.say(
                    Diagnostic::new(Code::E001, place, "only a script can go on elsewhere")
                        .hint("write it into a file, and `esm script run` it"),
                );
                return Err(Told);
            }
            Some("go_on") => self.target(rest)?,
            Some(word @ ("insert" | "replace")) => {
                let step = self.other(line, rest, place)?;
                if word == "insert" {
                    Reaction::Insert(step)
                } else {
                    Reaction::Replace(step)
                }
            }
            other => {
                let mut found = match other {
                    Some(word) => {
                        Diagnostic::new(Code::E002, place, format!("there is no reaction `{word}`"))
                    }
                    None => Diagnostic::new(Code::E001, place, "a reaction is missing here"),
                };
                found = match other.and_then(|word| nearest(word, Reaction::NAMES)) {
                    Some(near) => found
                        .hint(format!("did you mean `{near}`?"))
                        .fix(Fix::write(place, near)),
                    None => found.hint(format!("there are {}", Reaction::NAMES.join(", "))),
                };
                self.say(found);
                return Err(Told);
            }
        })
    }
}

fn parsed(kind: ParamType, text: &str) -> Option<Value> {
    match kind {
        ParamType::Bool => text.parse().ok().map(Value::Bool),
        ParamType::I32 => text.parse().ok().map(Value::I32),
        ParamType::U32 => text.parse().ok().map(Value::U32),
        ParamType::F32 => (text.parse::<f32>().ok())
            .filter(|value| value.is_finite())
            .map(Value::F32),
    }
}

fn kind(kind: ParamType) -> &'static str {
    match kind {
        ParamType::Bool => "`true` or `false`",
        ParamType::I32 => "a whole number",
        ParamType::U32 => "a whole number from 0 on",
        ParamType::F32 => "a number",
    }
}

/// A value as it is written.
fn shown(value: Value) -> String {
    match value {
        Value::Bool(value) => value.to_string(),
        Value::I32(value) => value.to_string(),
        Value::U32(value) => value.to_string(),
        Value::F32(value) => value.to_string(),
    }
}

/// A value as a number that says where it lies. A single-precision number is the same in double
/// precision.
fn number(value: Value) -> f64 {
    match value {
        Value::Bool(value) => f64::from(u8::from(value)),
        Value::I32(value) => value.into(),
        Value::U32(value) => value.into(),
        Value::F32(value) => value.into(),
    }
}
