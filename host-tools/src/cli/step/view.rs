//! What a person sees of a recording: one moment of it, and what their keys do. Nothing here knows
//! a terminal.

use std::ops::ControlFlow;

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyModifiers};

use crate::cli::argument::Time;
use crate::recording::player::Recording;
use crate::recording::walk::{Moment, Search, Searched, Walk};
use crate::recording::{Stretch, Surroundings};

/// Moments that a page has.
const PAGE: u64 = 100;
/// Parts of a recording that are looked through before the next key is read.
const PARTS_AT_ONCE: usize = 16;
/// Letters that an answer may have.
const ANSWER_LETTERS: usize = 200;

/// A part of the screen that can be scrolled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// The tree of regions.
    Regions,
    /// The transitions of the micro step.
    Transitions,
    /// Flags and timers.
    Flags,
}

impl Panel {
    /// All of them, from left to right.
    pub const ALL: [Panel; 3] = [Panel::Regions, Panel::Transitions, Panel::Flags];

    fn next(self) -> Self {
        match self {
            Panel::Regions => Panel::Transitions,
            Panel::Transitions => Panel::Flags,
            Panel::Flags => Panel::Regions,
        }
    }
}

/// Where a person is asked where to go.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Question {
    /// Whether it is looked for what they name towards the beginning.
    pub is_backwards: bool,
    /// What they have typed.
    pub answer: String,
}

/// What a person sees.
pub struct View<'r> {
    recording: &'r Recording,
    name: String,
    walk: Walk<'r>,
    /// Why the walk ends before the recording does.
    ended: Option<String>,
    surroundings: Surroundings,
    focus: Panel,
    /// Lines that are scrolled over, by panel.
    scrolled: [u16; Panel::ALL.len()],
    question: Option<Question>,
    message: Option<String>,
    search: Option<Search>,
    /// What was looked for last.
    last: Option<String>,
}

impl<'r> View<'r> {
    /// The view of a recording that is called so, at its first moment. `ended` is why the walk ends
    /// before the recording does.
    pub fn new(
        recording: &'r Recording,
        name: String,
        mut walk: Walk<'r>,
        ended: Option<String>,
    ) -> Self {
        walk.forward();
        let mut view = View {
            recording,
            name,
            walk,
            ended,
            surroundings: Surroundings::default(),
            focus: Panel::Transitions,
            scrolled: [0; Panel::ALL.len()],
            question: None,
            message: None,
            search: None,
            last: None,
        };
        view.arrive();
        if view.moment().is_none() {
            view.message = Some(match &view.ended {
                Some(why) => format!("nothing to be seen: {why}"),
                None => "no transition was taken in this recording".to_owned(),
            });
        }
        view
    }

    /// The name of the recording.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The moment that is looked at.
    pub fn moment(&self) -> Option<&Moment> {
        self.walk.moment()
    }

    /// What the machine was behind it.
    pub fn surroundings(&self) -> &Surroundings {
        &self.surroundings
    }

    /// The stretch that it is in, its number from 1, and how many there are.
    pub fn stretch(&self) -> Option<(&'r Stretch, usize, usize)> {
        let stretches = &self.recording.stretches;
        let number = self.moment()?.stretch;
        Some((stretches.get(number)?, number + 1, stretches.len()))
    }

    /// Its number among all moments, from 1, and how many there are. None for a macro step in which
    /// no transition was taken.
    pub fn place(&self) -> (Option<u64>, u64) {
        let is_counted = self.moment().is_some_and(|moment| !moment.taken.is_empty());
        let number = is_counted.then(|| self.walk.number() + 1);
        (number, self.walk.count())
    }

    /// The panel that is scrolled.
    pub fn focus(&self) -> Panel {
        self.focus
    }

    /// Lines of a panel that are scrolled over.
    pub fn scrolled(&self, panel: Panel) -> u16 {
        self.scrolled.get(panel as usize).copied().unwrap_or(0)
    }

    /// Where the person is asked where to go.
    pub fn question(&self) -> Option<&Question> {
        self.question.as_ref()
    }

    /// What there is to say.
    pub fn message(&self) -> Option<&str> {
        self.message.as_deref()
    }

    /// Goes on with a search; false where there is none that goes on.
    pub fn look(&mut self) -> bool {
        let Some(mut search) = self.search.take() else {
            return false;
        };
        let text = search.sought().text.clone();
        for _ in 0..PARTS_AT_ONCE {
            match self.walk.look(&mut search) {
                Searched::Found => {
                    self.message = Some(format!("found: {text}"));
                    self.arrive();
                    return false;
                }
                Searched::Nothing => {
                    self.message = Some(match search.is_backwards() {
                        true => format!("before this, nothing of {text}"),
                        false => format!("behind this, nothing of {text}"),
                    });
                    return false;
                }
                Searched::GoesOn { percent } => {
                    self.message = Some(format!("looking for {text}: at {percent}%"));
                }
            }
        }
        self.search = Some(search);
        true
    }

    /// The person pressed a key.
    pub fn press(&mut self, key: KeyEvent) -> ControlFlow<()> {
        if self.question.is_some() {
            self.answer(key);
            return ControlFlow::Continue(());
        }
        if key.modifiers.contains(KeyModifiers::CONTROL) {
            return ControlFlow::Continue(());
        }
        self.search = None;
        self.message = None;
        let last = self.walk.count().checked_sub(1);
        let number = self.walk.number();
        match key.code {
            KeyCode::Char('q' | 'Q') => return ControlFlow::Break(()),
            KeyCode::Char('n') | KeyCode::Right => {
                // Where no transition was taken, the number is that of the next moment already.
                let next = number + u64::from(self.place().0.is_some());
                self.go(
                    Some(next).filter(|next| last.is_some_and(|last| *next <= last)),
                    Edge::End,
                );
            }
            KeyCode::Char('b') | KeyCode::Left => self.go(number.checked_sub(1), Edge::Beginning),
            KeyCode::Char('N') => {
                let next = self.walk.next_macro_step();
                self.go(next, Edge::End);
            }
            KeyCode::Char('B') => {
                let before = self.walk.macro_step_before();
                self.go(before, Edge::Beginning);
            }
            KeyCode::PageDown => {
                let next = last.map(|last| last.min(number.saturating_add(PAGE)));
                self.go(next.filter(|next| *next > number), Edge::End);
            }
            KeyCode::PageUp => {
                let before = number.saturating_sub(PAGE);
                self.go(
                    Some(before).filter(|before| *before < number),
                    Edge::Beginning,
                );
            }
            KeyCode::Char('g') | KeyCode::Home => self.go(last.map(|_| 0), Edge::Beginning),
            KeyCode::Char('G') | KeyCode::End => self.go(last, Edge::End),
            KeyCode::Tab => self.focus = self.focus.next(),
            KeyCode::BackTab => self.focus = self.focus.next().next(),
            KeyCode::Up => self.scroll(|line| line.saturating_sub(1)),
            KeyCode::Down => self.scroll(|line| line.saturating_add(1)),
            KeyCode::Char(way @ ('/' | '?')) => {
                self.question = Some(Question {
                    is_backwards: way == '?',
                    answer: String::new(),
                });
            }
            _ => {}
        }
        ControlFlow::Continue(())
    }

    /// A key of somebody who was asked where to go.
    fn answer(&mut self, key: KeyEvent) {
        let Some(question) = &mut self.question else {
            return;
        };
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Char('u' | 'U') if is_control => question.answer.clear(),
            KeyCode::Char(letter)
                if !is_control && question.answer.chars().count() < ANSWER_LETTERS =>
            {
                question.answer.push(letter);
            }
            KeyCode::Backspace => {
                question.answer.pop();
            }
            KeyCode::Esc => {
                self.question = None;
                self.message = None;
            }
            KeyCode::Enter => {
                let question = self.question.take().map(|it| (it.answer, it.is_backwards));
                if let Some((answer, is_backwards)) = question {
                    self.message = None;
                    self.ask(answer.trim(), is_backwards);
                }
            }
            _ => {}
        }
    }

    /// Goes where the person wants to be: to a macro step, a time, or what they name. Nothing
    /// stands for what was looked for last.
    fn ask(&mut self, answer: &str, is_backwards: bool) {
        let begins_with_digit = answer.starts_with(|letter: char| letter.is_ascii_digit());
        if answer.is_empty() {
            if let Some(last) = self.last.clone() {
                self.look_for(&last, is_backwards);
            }
        } else if let Ok(step) = answer.parse() {
            let stretch = self.moment().map_or(0, |moment| moment.stretch);
            let number = self.walk.at_step(stretch, step);
            self.go(number, Edge::End);
        } else if begins_with_digit {
            match answer.parse::<Time>() {
                Ok(time) => {
                    let number = self.walk.at_time(time.us);
                    self.go(number, Edge::End);
                }
                Err(error) => self.message = Some(error.to_string()),
            }
        } else {
            self.look_for(answer, is_backwards);
        }
    }

    fn look_for(&mut self, text: &str, is_backwards: bool) {
        match self.walk.sought(text) {
            Ok(sought) => {
                self.last = Some(text.to_owned());
                self.message = Some(format!("looking for {text}"));
                self.search = Some(self.walk.search(sought, is_backwards));
            }
            Err(error) => self.message = Some(error.to_string()),
        }
    }

    /// Goes to a moment, or says that there is none on that side.
    fn go(&mut self, number: Option<u64>, edge: Edge) {
        let found = number.and_then(|number| self.walk.to_number(number));
        if found.is_some() {
            self.arrive();
            return;
        }
        self.message = Some(match edge {
            Edge::Beginning => "the beginning of the recording".to_owned(),
            Edge::End => self.end(),
        });
    }

    /// What there is behind the last moment.
    fn end(&self) -> String {
        if let Some(why) = &self.ended {
            return format!("the end of what can be replayed: {why}");
        }
        let last = self.recording.stretches.len().saturating_sub(1);
        match self.walk.fault_of(last) {
            Some((step, fault)) => {
                let fault = fault.code();
                format!("the end: {fault} stopped the machine in macro step {step}")
            }
            None => "the end of the recording".to_owned(),
        }
    }

    fn arrive(&mut self) {
        self.surroundings = self.walk.surroundings().unwrap_or_default();
        if let Some(line) = self.scrolled.get_mut(Panel::Transitions as usize) {
            *line = 0;
        }
    }

    fn scroll(&mut self, to: impl FnOnce(u16) -> u16) {
        if let Some(line) = self.scrolled.get_mut(self.focus as usize) {
            *line = to(*line);
        }
    }

    /// No more lines of a panel can be scrolled over than this.
    pub fn keep_within(&mut self, panel: Panel, most: u16) {
        if let Some(line) = self.scrolled.get_mut(panel as usize) {
            *line = (*line).min(most);
        }
    }
}

/// A side of the recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Edge {
    Beginning,
    End,
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use esm_toolkit::recording::planted::{BLINK, FLOOD, Planted};
    use esm_toolkit::samples::ROVER;

    /// A rover that meets an obstacle, is lost sight of, seen again, and followed by another
    /// mission.
    pub fn drive() -> Recording {
        let reports = [
            (5, "set motion/Cruise.near"),
            (12, "exit motion/Escape/turn/Turn"),
            (20, "exit motion/Again/turn/Turn"),
            (2_020, "set motion/Cruise.near"),
            (2_022, "clear motion/Cruise.near"),
        ];
        Planted::new()
            .run(("rover", ROVER), 0, 0..40, &reports)
            .gap()
            .run(("rover", ROVER), 0, 2_000..2_030, &reports)
            .run(("blink", BLINK), 20_400_000, 0..3_000, &[])
            .recording()
    }

    pub fn view_of(recording: &Recording, over_gaps: bool) -> View<'_> {
        let (walk, ended) = Walk::new(recording, over_gaps);
        let why = ended.map(|error| error.to_string());
        View::new(recording, "drive.rec".to_owned(), walk, why)
    }

    /// Presses keys: letters as they are, `<` and `>` for the arrows, `^` and `v` for those up and
    /// down, `{` and `}` for the pages, `!` for Enter, `~` for Esc, `|` for Tab, `#` for the key
    /// that erases.
    pub fn press(view: &mut View<'_>, keys: &str) -> ControlFlow<()> {
        for key in keys.chars() {
            let code = match key {
                '<' => KeyCode::Left,
                '>' => KeyCode::Right,
                '^' => KeyCode::Up,
                'v' => KeyCode::Down,
                '{' => KeyCode::PageUp,
                '}' => KeyCode::PageDown,
                '!' => KeyCode::Enter,
                '~' => KeyCode::Esc,
                '|' => KeyCode::Tab,
                '#' => KeyCode::Backspace,
                letter => KeyCode::Char(letter),
            };
            view.press(KeyEvent::new(code, KeyModifiers::NONE))?;
            while view.look() {}
        }
        ControlFlow::Continue(())
    }

    /// Where a view is: stretch, macro step, micro step.
    fn at(view: &View<'_>) -> (usize, u64, u8) {
        let moment = view.moment().unwrap();
        (moment.stretch, moment.step, moment.micro)
    }

    #[test]
    fn keys_go_where_the_bottom_line_says() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        assert_eq!(at(&view), (0, 0, 0));
        for (keys, expected) in [
            ("n", (0, 4, 0)),
            (">", (0, 5, 0)),
            ("n", (0, 5, 1)),
            ("n", (0, 6, 0)),
            ("b", (0, 5, 1)),
            ("<", (0, 5, 0)),
            ("N", (0, 6, 0)),
            ("NB", (0, 6, 0)),
            ("B", (0, 5, 0)),
            ("nB", (0, 4, 0)),
            ("bb", (0, 0, 0)),
            ("G", (2, 2_997, 0)),
            ("nn", (2, 2_997, 0)),
            ("g", (0, 0, 0)),
            ("BB", (0, 0, 0)),
            ("}{", (0, 0, 0)),
            ("}", (2, 255, 0)),
            ("}{", (2, 255, 0)),
            ("}}}}}}}}}}}}}", (2, 2_997, 0)),
            ("{{{{{{{{{{{{{", (0, 0, 0)),
            ("/7!", (0, 9, 0)),
            ("/20 s!", (1, 2_020, 0)),
            ("/20400 ms!", (2, 0, 0)),
            ("/9!", (2, 9, 0)),
        ] {
            assert_eq!(press(&mut view, keys), ControlFlow::Continue(()));
            assert_eq!(at(&view), expected, "{keys}: {:?}", view.message());
        }
        for keys in ["q", "Q"] {
            assert_eq!(press(&mut view, keys), ControlFlow::Break(()));
        }
    }

    #[test]
    fn what_is_looked_for_is_found_on_both_sides() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        for (keys, expected, message) in [
            ("/Escape!", (0, 5, 0), "found: Escape"),
            ("/!", (1, 2_020, 0), "found: Escape"),
            ("/!", (1, 2_020, 0), "behind this, nothing of Escape"),
            ("?!", (0, 5, 0), "found: Escape"),
            ("/turn/Back!", (0, 6, 0), "found: turn/Back"),
            (
                "g/motion/Escape.done!",
                (0, 9, 0),
                "found: motion/Escape.done",
            ),
            ("g/light/Off!", (2, 3, 0), "found: light/Off"),
            ("?Again!", (0, 13, 0), "found: Again"),
        ] {
            assert_eq!(press(&mut view, keys), ControlFlow::Continue(()));
            assert_eq!(at(&view), expected, "{keys}: {:?}", view.message());
            assert_eq!(view.message(), Some(message), "{keys}");
        }
    }

    #[test]
    fn a_flag_that_no_transition_waited_for_is_found_where_it_changed() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        // Cleared by its task when another state was current.
        let _ = press(&mut view, "G?motion/Cruise.near!");
        assert_eq!(at(&view), (1, 2_022, 0));
        assert!(view.moment().unwrap().taken.is_empty());
        assert_eq!(view.place().0, None);
        // Neither side is passed over.
        for (keys, expected) in [("n", (1, 2_024, 0)), ("b", (1, 2_021, 0))] {
            let _ = press(&mut view, "G?motion/Cruise.near!");
            let _ = press(&mut view, keys);
            assert_eq!(at(&view), expected, "{keys}");
        }
        let _ = press(&mut view, "g/.near!");
        assert_eq!(at(&view), (0, 5, 0));
    }

    #[test]
    fn what_cannot_be_found_is_said_and_nothing_moves() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        let _ = press(&mut view, "nn");
        for (answer, said) in [
            (
                "Escaep",
                "no mission of the recording has a state `Escaep`: did you mean `Escape`?",
            ),
            (
                "Cruise.neer",
                "no state that is called so has a flag `neer`: did you mean `near`?",
            ),
            ("12 h", "the unit of a time is"),
            ("99999 s", "the end of the recording"),
        ] {
            let here = at(&view);
            let _ = press(&mut view, &format!("/{answer}!"));
            assert_eq!(at(&view), here, "{answer}");
            let message = view.message().unwrap();
            assert!(message.starts_with(said), "{answer}: {message}");
        }
    }

    #[test]
    fn an_answer_can_be_mended_and_taken_back() {
        let recording = drive();
        let mut view = view_of(&recording, true);
        let answer = |view: &View<'_>| view.question().map(|question| question.answer.clone());
        let _ = press(&mut view, "/Escq");
        assert_eq!(
            answer(&view).as_deref(),
            Some("Escq"),
            "q is a letter there"
        );
        let _ = press(&mut view, "#ape");
        assert_eq!(answer(&view).as_deref(), Some("Escape"));
        let _ = view.press(KeyEvent::new(KeyCode::Char('u'), KeyModifiers::CONTROL));
        assert_eq!(answer(&view).as_deref(), Some(""));
        let _ = press(&mut view, &"x".repeat(2 * ANSWER_LETTERS));
        assert_eq!(answer(&view).map(|it| it.len()), Some(ANSWER_LETTERS));
        let _ = press(&mut view, "~");
        assert_eq!((answer(&view), at(&view)), (None, (0, 0, 0)));
        let _ = press(&mut view, "/!");
        assert_eq!(
            (answer(&view), view.message()),
            (None, None),
            "nothing was looked for yet"
        );
    }

    #[test]
    fn what_ends_the_walk_is_said_at_its_end() {
        let flood = Planted::new()
            .run(("flood", FLOOD), 0, 0..20, &[(9, "set clock/Wait.near")])
            .recording();
        let drive = drive();
        let quiet = Planted::new().recording();
        for (recording, over_gaps, said) in [
            (&drive, true, "the end of the recording"),
            (
                &drive,
                false,
                "the end of what can be replayed: the recording has a gap after macro step 39",
            ),
            (
                &flood,
                false,
                "the end: macro-step-limit stopped the machine in macro step 9",
            ),
            (&quiet, false, "the end of the recording"),
        ] {
            let mut view = view_of(recording, over_gaps);
            let _ = press(&mut view, "Gn");
            let message = view.message().unwrap();
            assert!(message.starts_with(said), "{message}");
        }
        let view = view_of(&quiet, false);
        assert_eq!(
            view.message(),
            Some("no transition was taken in this recording")
        );
        let mut view = view_of(&flood, false);
        let _ = press(&mut view, "G");
        let moment = view.moment().unwrap();
        assert_eq!((moment.micro, moment.fault.is_some()), (254, true));
    }
}
