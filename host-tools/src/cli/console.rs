//! Standard output and standard error, as a person or a program sees them.
//!
//! Results go to standard output through a buffer; words for people go to standard error. A command
//! never uses `println!`, which panics when the reader has gone: it writes to [`Console::out`] and
//! passes the error on, which ends the command quietly.
//!
//! *Invariant:* nobody else has the streams of the process (`clippy.toml` sees to that), and what
//! passes here is [clean](crate::clean): of control characters a terminal gets ends of lines, this
//! program's own colours, and what draws a screen or a bar.

use std::backtrace::{Backtrace, BacktraceStatus};
use std::ffi::OsStr;
use std::fmt;
use std::io::{self, BufWriter, IsTerminal, Stderr, Stdout, Write};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use terminal_size::Width;

use super::exit::CommandError;
use crate::clean::{Clean, Form, clean};

const OUTPUT_BUFFER_BYTES: usize = 64 * 1024;
const SPINNER_TICK: Duration = Duration::from_millis(100);

/// Work that ends sooner shows no heartbeat: it would only flicker.
const SPINNER_DELAY: Duration = Duration::from_millis(300);

/// Letters of a line where no terminal says how many it has.
const COLUMNS: usize = 100;

/// The streams of the process and how they may be used.
pub struct Console {
    out: Clean<BufWriter<Box<dyn Write + Send>>>,
    error: Clean<Box<dyn Write + Send>>,
    out_is_terminal: bool,
    error_is_terminal: bool,
    colour_allowed: bool,
    /// Whether terminals have a cursor that can be moved, so that a line can be taken back.
    cursor_moves: bool,
}

impl Console {
    /// The console of this process: colour only on a terminal, and not where `NO_COLOR` is set or
    /// `TERM` is `dumb`; progress only on one whose cursor moves.
    pub fn of_this_process() -> Self {
        let term = std::env::var_os("TERM");
        let (out, error) = (process_out(), process_error());
        Console {
            out_is_terminal: out.is_terminal(),
            error_is_terminal: error.is_terminal(),
            colour_allowed: colour_allowed(
                std::env::var_os("NO_COLOR").as_deref(),
                term.as_deref(),
            ),
            cursor_moves: !is_dumb(term.as_deref()),
            ..Console::onto(out, error)
        }
    }

    /// A console of this process whose standard output goes nowhere: for a part of a command that
    /// tells what nobody has asked for.
    pub fn without_output() -> Self {
        let out: Box<dyn Write + Send> = Box::new(io::sink());
        Console {
            out: Clean::new(BufWriter::new(out), Form::Text),
            out_is_terminal: false,
            ..Self::of_this_process()
        }
    }

    /// A console whose streams go elsewhere, to where there is no terminal: for a program that has
    /// commands run within it.
    pub fn onto(out: impl Write + Send + 'static, error: impl Write + Send + 'static) -> Self {
        let out: Box<dyn Write + Send> = Box::new(out);
        let error: Box<dyn Write + Send> = Box::new(error);
        let out = BufWriter::with_capacity(OUTPUT_BUFFER_BYTES, out);
        Console {
            out: Clean::new(out, Form::Text),
            error: Clean::new(error, Form::Text),
            out_is_terminal: false,
            error_is_terminal: false,
            colour_allowed: false,
            cursor_moves: false,
        }
    }

    /// Standard output for text, buffered. It is flushed when the command ends and by
    /// [`Console::flush`].
    pub fn out(&mut self) -> &mut impl Write {
        self.out.set_form(Form::Text);
        &mut self.out
    }

    /// Standard output for lines of JSON.
    pub fn json_out(&mut self) -> &mut impl Write {
        self.out.set_form(Form::Json);
        &mut self.out
    }

    /// Writes one JSON object as a line of its own to standard output.
    ///
    /// # Errors
    /// When standard output cannot be written to.
    pub fn json_line(&mut self, value: &impl Serialize) -> Result<(), CommandError> {
        // Encoding plain data fails only where the writer does.
        let out = self.json_out();
        serde_json::to_writer(&mut *out, value).map_err(io::Error::from)?;
        out.write_all(b"\n")?;
        Ok(())
    }

    /// Writes text to standard output.
    ///
    /// # Errors
    /// When standard output cannot be written to.
    pub fn text(&mut self, text: &str) -> Result<(), CommandError> {
        self.out().write_all(text.as_bytes())?;
        Ok(())
    }

    /// Hands what was written so far to whoever reads it.
    ///
    /// # Errors
    /// When standard output cannot be written to.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Whether standard output may carry colours.
    pub fn colour_out(&self) -> bool {
        self.out_is_terminal && self.colour_allowed
    }

    /// Whether standard error may carry colours.
    pub fn colour_error(&self) -> bool {
        self.error_is_terminal && self.colour_allowed
    }

    /// Whether a person reads standard error on a terminal, and can do what is asked there.
    pub fn has_person(&self) -> bool {
        self.error_is_terminal
    }

    /// Whether standard output is a terminal on which a cursor can be moved.
    pub fn out_has_cursor(&self) -> bool {
        self.out_is_terminal && self.cursor_moves
    }

    /// Whether standard error is one.
    fn error_has_cursor(&self) -> bool {
        self.error_is_terminal && self.cursor_moves
    }

    /// How wide standard output is, in letters: the terminal's width, or 100 where there is none.
    pub fn columns(&self) -> usize {
        let size = self
            .out_is_terminal
            .then(|| terminal_size::terminal_size_of(process_out()));
        size.flatten()
            .map_or(COLUMNS, |(Width(columns), _)| columns.into())
    }

    /// A word for the person on standard error. Output written before comes before it, where both
    /// end on one screen.
    pub fn note(&mut self, text: &str) {
        self.say(Form::Text, &text);
    }

    /// The same of a text whose colours are of this program. Words of others in it were
    /// [cleaned](crate::clean::clean) before it was coloured.
    pub fn coloured(&mut self, text: &str) {
        self.say(Form::Coloured, &text);
    }

    fn say(&mut self, form: Form, text: &dyn fmt::Display) {
        let _ = self.flush();
        self.error.set_form(form);
        // There is no better place to tell that standard error is closed.
        let _ = writeln!(self.error, "{text}");
    }

    /// Tells why the command failed, where it has not said so itself.
    pub fn report(&mut self, error: &CommandError) {
        if let Some(reason) = error.message() {
            let (red, plain) = if self.colour_error() {
                ("\x1b[1;31m", "\x1b[0m")
            } else {
                ("", "")
            };
            let reason = clean(&chain(reason));
            self.coloured(&format!("{red}error{plain}: {reason}"));
        }
    }

    /// A progress bar on standard error over `length` units of work. Hidden where standard error is
    /// no terminal with a cursor.
    pub fn progress(&self, label: &str, length: u64) -> Progress {
        let bar = ProgressBar::with_draw_target(Some(length), self.progress_target());
        bar.set_style(bar_style("{msg} [{bar:32}] {percent:>3} % {elapsed}"));
        let progress = Progress(bar);
        progress.set_message(label);
        progress
    }

    /// Shows what the parser of arguments says: help, or what is wrong with them.
    pub fn usage(&mut self, said: &clap::Error) {
        let said_of_help = said.render();
        if said.use_stderr() {
            // Words of the command line are in it, so that it has no colours.
            self.note(said_of_help.to_string().trim_end());
        } else {
            let colour = self.colour_out();
            self.out.set_form(Form::Coloured);
            // Help that nobody reads any more is not a failure: `esm --help | head -1`.
            let _ = match colour {
                true => write!(self.out, "{}", said_of_help.ansi()),
                false => write!(self.out, "{said_of_help}"),
            };
            let _ = self.flush();
        }
    }

    /// A heartbeat on standard error for work of unknown length, once it has lasted 0.3 s. None
    /// where standard error is no terminal with a cursor.
    pub fn spinner(&self, label: &str) -> Spinner {
        Spinner {
            watch: self
                .error_has_cursor()
                .then(|| Watch::begin(label))
                .flatten(),
        }
    }

    fn progress_target(&self) -> ProgressDrawTarget {
        if self.error_has_cursor() {
            ProgressDrawTarget::stderr()
        } else {
            ProgressDrawTarget::hidden()
        }
    }
}

/// A progress bar.
pub struct Progress(ProgressBar);

impl Progress {
    /// What stands in front of the bar.
    pub fn set_message(&self, label: &str) {
        self.0.set_message(clean(label));
    }

    /// So much of the work is done.
    pub fn set_position(&self, position: u64) {
        self.0.set_position(position);
    }

    /// Takes the bar away; what is written next stands in its place.
    pub fn finish_and_clear(&self) {
        self.0.finish_and_clear();
    }
}

/// A heartbeat on a terminal, taken away when the work ends.
#[must_use = "it goes away when it is dropped"]
pub struct Spinner {
    /// `None` where nobody would see it.
    watch: Option<Watch>,
}

/// The thread that shows a heartbeat.
struct Watch {
    /// Dropped when the work has ended.
    work: Sender<()>,
    thread: JoinHandle<()>,
}

impl Watch {
    /// `None` where the system has no thread for it: the work goes on without.
    fn begin(label: &str) -> Option<Self> {
        let (work, end) = mpsc::channel::<()>();
        let label = clean(label);
        let shown = move || {
            if end.recv_timeout(SPINNER_DELAY) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr())
                .with_elapsed(SPINNER_DELAY);
            bar.set_style(bar_style("{spinner} {msg} {elapsed}"));
            bar.set_message(label);
            while end.recv_timeout(SPINNER_TICK) == Err(RecvTimeoutError::Timeout) {
                bar.tick();
            }
            bar.finish_and_clear();
        };
        let thread = thread::Builder::new().spawn(shown).ok()?;
        Some(Watch { work, thread })
    }
}

impl Spinner {
    /// Takes the sign away; what is written next stands in its place.
    pub fn finish_and_clear(self) {}
}

impl Drop for Spinner {
    fn drop(&mut self) {
        if let Some(Watch { work, thread }) = self.watch.take() {
            drop(work);
            // It ends as soon as it sees that the work has. Had it failed, there would only be no
            // heartbeat.
            let _ = thread.join();
        }
    }
}

/// An error and what caused it, from the outside in. A cause that the error before it repeats is
/// told once.
fn chain(error: &anyhow::Error) -> String {
    let mut told = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if told.is_empty() {
            told = cause;
        } else if !told.ends_with(&cause) {
            told = format!("{told}: {cause}");
        }
    }
    told
}

/// Standard output as it is: for a screen, whose cells are clean, and for what is cleaned here.
#[expect(clippy::disallowed_methods, reason = "the one place")]
pub(super) fn process_out() -> Stdout {
    io::stdout()
}

/// Standard error as it is.
#[expect(clippy::disallowed_methods, reason = "the one place")]
fn process_error() -> Stderr {
    io::stderr()
}

/// Standard output for lines of JSON that are written beside a console.
pub fn json_output() -> Clean<Stdout> {
    Clean::new(process_out(), Form::Json)
}

/// A word for the person on standard error, from where there is no console.
pub fn warn(text: &str) {
    // There is no better place to tell that standard error is closed.
    let _ = writeln!(Clean::new(process_error(), Form::Text), "{text}");
}

/// Lets panics say what they are through here: words of others may stand in them.
pub fn take_over_panics() {
    std::panic::set_hook(Box::new(|panic| {
        let trace = Backtrace::capture();
        match trace.status() {
            BacktraceStatus::Captured => warn(&format!("{panic}\n{trace}")),
            _ => warn(&panic.to_string()),
        }
    }));
}

/// A style for a bar; the plain one should the template not parse, since a bar is never worth a
/// failure.
fn bar_style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Whether the environment lets a terminal be coloured. An empty `NO_COLOR` counts as not set
/// (no-color.org).
fn colour_allowed(no_color: Option<&OsStr>, term: Option<&OsStr>) -> bool {
    no_color.is_none_or(OsStr::is_empty) && !is_dumb(term)
}

/// Whether terminals are said to do nothing but write one line after the other.
fn is_dumb(term: Option<&OsStr>) -> bool {
    term == Some(OsStr::new("dumb"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_told_once() {
        let named = anyhow::anyhow!("gone").context("cannot read `a`");
        assert_eq!(chain(&named), "cannot read `a`: gone");
        let repeated = anyhow::anyhow!("gone").context("cannot read `a`: gone");
        assert_eq!(chain(&repeated), "cannot read `a`: gone");
    }

    #[test]
    fn signs_of_life_are_shown_where_they_can_be_taken_away() {
        for (error_is_terminal, cursor_moves, colour_allowed, expected) in [
            (true, true, true, true),
            (true, true, false, true),
            (true, false, false, false),
            (false, true, true, false),
        ] {
            let console = Console {
                error_is_terminal,
                colour_allowed,
                cursor_moves,
                ..Console::of_this_process()
            };
            let spinner = console.spinner("work");
            assert_eq!(spinner.watch.is_some(), expected, "{cursor_moves}");
        }
    }

    #[test]
    fn colour_follows_the_environment() {
        let cases: [(Option<&str>, Option<&str>, bool); 6] = [
            (None, None, true),
            (None, Some("xterm-256color"), true),
            (None, Some("dumb"), false),
            (Some(""), Some("xterm"), true),
            (Some("1"), Some("xterm"), false),
            (Some("0"), None, false),
        ];
        for (no_color, term, expected) in cases {
            let allowed = colour_allowed(no_color.map(OsStr::new), term.map(OsStr::new));
            assert_eq!(allowed, expected, "NO_COLOR={no_color:?} TERM={term:?}");
        }
    }
}
