//! The screen of a terminal, while a command has it: taken, drawn on, and given back as it was,
//! whatever ends the command.

use std::ops::ControlFlow;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Duration;

use anyhow::anyhow;
use ratatui::Frame;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::Show;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};

use super::console::{Console, process_out};
use super::exit::CommandError;
use crate::clean::is_harmful;
use crate::run::interrupt::Interrupt;

/// How long a wait for a key may last before the screen is drawn anew and Ctrl-C from elsewhere is
/// looked for.
pub const KEY_WAIT: Duration = Duration::from_millis(100);

/// Whether standard output is a terminal on which a cursor can be moved.
pub fn has_screen(console: &Console) -> bool {
    console.out_has_cursor()
}

/// Which colours the screen may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Palette {
    /// Whether it may have any.
    pub colour: bool,
}

impl Palette {
    /// A colour, if there may be one.
    pub fn of(self, colour: Color) -> Style {
        if self.colour {
            Style::new().fg(colour)
        } else {
            Style::new()
        }
    }

    /// What is as it should be.
    pub fn good(self) -> Style {
        self.of(Color::Green)
    }

    /// What is to be looked at.
    pub fn warning(self) -> Style {
        self.of(Color::Yellow).add_modifier(Modifier::BOLD)
    }

    /// What is wrong.
    pub fn bad(self) -> Style {
        self.of(Color::Red).add_modifier(Modifier::BOLD)
    }

    /// What matters less.
    pub fn quiet(self) -> Style {
        self.of(Color::DarkGray)
    }
}

/// Lines of what is [`broken`] at most, on a narrow screen.
const MOST_BROKEN_LINES: usize = 8;

/// Lines broken between words, so that all of them can be read on a screen of so many columns;
/// eight at most.
pub fn broken<'v>(lines: &[Line<'v>], width: u16) -> Vec<Line<'v>> {
    let mut all = Vec::new();
    for line in lines {
        let mut spans: Vec<Span<'v>> = Vec::new();
        let mut used = 0;
        for span in &line.spans {
            for word in span.content.split_inclusive(' ') {
                let length = Span::raw(word.trim_end()).width();
                if used > 0 && used + length > usize::from(width) && !word.trim().is_empty() {
                    all.push(Line::from(std::mem::take(&mut spans)));
                    used = 0;
                }
                used += Span::raw(word).width();
                spans.push(Span::styled(word.to_owned(), span.style));
            }
        }
        all.push(Line::from(spans));
    }
    all.truncate(MOST_BROKEN_LINES);
    all
}

/// What a command shows on the screen.
pub trait Shown {
    /// Takes what came since the last call; answers how long a wait for a key may last,
    /// [`KEY_WAIT`] at most.
    ///
    /// # Errors
    /// What ends the command.
    fn update(&mut self) -> Result<Duration, CommandError>;

    /// Draws it.
    fn draw(&mut self, frame: &mut Frame<'_>);

    /// The person pressed a key. Ctrl-C is not told: it ends the command.
    fn press(&mut self, key: KeyEvent) -> ControlFlow<()>;
}

/// Whether this process has the screen. Of those who end it (the command, a panic in any thread)
/// the first gives it back, and what the others say stays readable behind that.
static IS_TAKEN: AtomicBool = AtomicBool::new(false);

/// The screen while this command has it. Dropping it gives the terminal back as it was; a panic
/// does so before it says what it is.
struct Screen(ratatui::DefaultTerminal);

impl Screen {
    fn take() -> Result<Self, CommandError> {
        static HOOK: Once = Once::new();
        HOOK.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                give_back();
                before(panic);
            }));
        });
        IS_TAKEN.store(true, SeqCst);
        // From here on the terminal is given back, whatever part of it was done.
        let taken = enable_raw_mode()
            .and_then(|()| execute!(process_out(), EnterAlternateScreen))
            .and_then(|()| ratatui::Terminal::new(CrosstermBackend::new(process_out())));
        taken.map(Screen).map_err(|error| {
            give_back();
            error.into()
        })
    }

    /// Whether a panic in another thread has given it back.
    fn is_lost() -> bool {
        !IS_TAKEN.load(SeqCst)
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        give_back();
    }
}

/// Gives the terminal back as it was: lines and signals, what was on it, its cursor.
fn give_back() {
    if IS_TAKEN.swap(false, SeqCst) {
        // There is no better place to tell that the terminal has gone.
        let _ = disable_raw_mode();
        let _ = execute!(process_out(), LeaveAlternateScreen, Show);
    }
}

/// Has the screen until the person has seen enough.
///
/// # Errors
/// What ended the command, or what the system says of the terminal.
pub fn show(shown: &mut impl Shown, interrupt: Interrupt) -> Result<(), CommandError> {
    let mut screen = Screen::take()?;
    while !interrupt.is_requested() {
        let mut wait = shown.update()?.min(KEY_WAIT);
        if Screen::is_lost() {
            return Err(CommandError::World(anyhow!(
                "a part of this command has failed; its message is above"
            )));
        }
        screen.0.draw(|frame| draw_clean(shown, frame))?;
        // All that was typed or pasted meanwhile, before the next drawing.
        while event::poll(wait)? {
            wait = Duration::ZERO;
            let Event::Key(key) = event::read()? else {
                // Of another size the next drawing takes notice by itself.
                continue;
            };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            if is_interrupt(&key) || shown.press(key).is_break() {
                return Ok(());
            }
        }
    }
    Ok(())
}

/// Draws, and sees to it that no cell does anything to the terminal: `ratatui` keeps control
/// characters out, and lets others that nobody sees hang on to those before them.
fn draw_clean(shown: &mut impl Shown, frame: &mut Frame<'_>) {
    shown.draw(frame);
    for cell in &mut frame.buffer_mut().content {
        if cell.symbol().contains(|it| it == '\n' || is_harmful(it)) {
            cell.set_char(char::REPLACEMENT_CHARACTER);
        }
    }
}

/// What a person means by a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning<K> {
    /// To quit: q and Esc.
    Quit,
    /// A key of the screen's own.
    Key(K),
}

/// What a person means by a key on a screen with keys of its own, none of them with Ctrl.
pub fn meaning<K>(key: KeyEvent, own: impl FnOnce(KeyCode) -> Option<K>) -> Option<Meaning<K>> {
    if key.modifiers.contains(KeyModifiers::CONTROL) {
        return None;
    }
    match key.code {
        KeyCode::Char('q' | 'Q') | KeyCode::Esc => Some(Meaning::Quit),
        code => own(code).map(Meaning::Key),
    }
}

/// Whether a key is Ctrl-C, which comes as a key while the command has the screen.
fn is_interrupt(key: &KeyEvent) -> bool {
    key.modifiers.contains(KeyModifiers::CONTROL) && matches!(key.code, KeyCode::Char('c' | 'C'))
}

/// A screen as text, and screens that were looked at once.
#[cfg(test)]
pub(super) mod tests {
    use std::path::Path;

    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use ratatui::buffer::Buffer;

    use super::*;

    /// What is drawn on a screen of a size.
    pub fn drawn(width: u16, height: u16, draw: impl FnOnce(&mut Frame<'_>)) -> Buffer {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(draw).unwrap();
        terminal.backend().buffer().clone()
    }

    /// Its lines.
    pub fn text(buffer: &Buffer) -> String {
        let width = usize::from(buffer.area.width);
        let mut text = String::new();
        for line in buffer.content.chunks(width) {
            let line: String = line.iter().map(|cell| cell.symbol()).collect();
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }

    /// Cells that have a colour.
    pub fn coloured(buffer: &Buffer) -> usize {
        let has_colour =
            |cell: &&ratatui::buffer::Cell| cell.fg != Color::Reset || cell.bg != Color::Reset;
        buffer.content.iter().filter(has_colour).count()
    }

    /// Compares with a screen that was looked at once. `ESM_BLESS=1` writes it anew, to be looked
    /// at again.
    #[track_caller]
    pub fn assert_golden(command: &str, name: &str, screen: &str) {
        let path = Path::new("src/cli")
            .join(command)
            .join("golden")
            .join(name)
            .with_extension("txt");
        if std::env::var_os("ESM_BLESS").is_some() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, screen).unwrap();
        }
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(
            screen,
            expected,
            "{} differs: look at it with ESM_BLESS=1",
            path.display()
        );
    }

    struct Hostile;

    impl Shown for Hostile {
        fn update(&mut self) -> Result<Duration, CommandError> {
            Ok(KEY_WAIT)
        }

        fn draw(&mut self, frame: &mut Frame<'_>) {
            let lines = [
                "a\u{202e}b\u{200b}",
                "\u{9b}2Jc",
                "\x1b]0;d\x07",
                "e\u{2066}\u{e0041}",
            ];
            let lines: Vec<Line<'_>> = lines.into_iter().map(Line::from).collect();
            frame.render_widget(ratatui::widgets::Paragraph::new(lines), frame.area());
            let [x, y] = [10, 0];
            frame.buffer_mut()[(x, y)].set_symbol("\x1b[2J");
        }

        fn press(&mut self, _: KeyEvent) -> ControlFlow<()> {
            ControlFlow::Continue(())
        }
    }

    #[test]
    fn no_cell_of_a_screen_does_anything_to_the_terminal() {
        let buffer = drawn(20, 4, |frame| draw_clean(&mut Hostile, frame));
        assert!(!text(&buffer).contains(is_harmful), "{buffer:?}");
        assert_eq!(buffer[(10, 0)].symbol(), "\u{fffd}");
        assert!(text(&buffer).contains('c'), "the rest is there");
        let raw = drawn(20, 4, |frame| Hostile.draw(frame));
        assert!(
            text(&raw).contains(is_harmful),
            "there was something to clean"
        );
    }

    #[test]
    fn ctrl_c_ends_any_command_that_has_the_screen() {
        for (code, modifiers, expected) in [
            (KeyCode::Char('c'), KeyModifiers::CONTROL, true),
            (KeyCode::Char('c'), KeyModifiers::NONE, false),
            (KeyCode::Char('q'), KeyModifiers::CONTROL, false),
        ] {
            let key = KeyEvent::new(code, modifiers);
            assert_eq!(is_interrupt(&key), expected, "{key:?}");
        }
    }
}
