//! `esm top`: a robot's slots as they run.
//!
//! | module | what it holds |
//! |---|---|
//! | [`view`] | what a person sees, worked out from one reading after another, and what their keys do to it |
//! | [`screen`] | the view drawn on a terminal's screen |
//! | [`watch`] | the robot read in a thread of its own, and found again when it was lost |
//! | [`report`] | the same once: as a table for a person, as an object for a program |

pub mod report;
pub mod screen;
pub mod view;
pub mod watch;

use std::ffi::OsStr;
use std::time::{Duration, Instant};

use clap::Args;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use crate::reading::{Reader, Tasks};
use crate::run::interrupt::Interrupt;
use report::TopReport;
use screen::Palette;
use view::{Key, View};
use watch::{News, Watch};

/// How long a wait for a key may last before the screen is drawn anew and Ctrl-C from elsewhere is looked for.
const KEY_WAIT: Duration = Duration::from_millis(100);

/// The shortest time between two readings; an answer takes the robot some milliseconds.
const SHORTEST_INTERVAL: Duration = Duration::from_millis(50);

/// Shows a robot's slots as they run: executions, overruns, start delays, load
///
/// A row for each slot, start delays and tasks of the one that is looked at. Keys: arrows choose a slot, r counts from now on, p pauses,
/// q, Esc and Ctrl-C quit. A robot that does not answer is looked for until it does. Where standard output is no terminal, as with
/// --once, one table is printed. What the figures mean and what to do about them is in the book, under `Slots and timing`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm top --port /dev/ttyUSB0
  esm top --port /dev/ttyUSB0 --once
  esm top --port /dev/ttyUSB0 --json | jq '.slots[] | {slot, overruns, longest_delay_ns}'")]
pub struct TopArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// Time between two readings, such as '500 ms'
    #[arg(long, value_name = "TIME", default_value = "1 s")]
    pub interval: Time,

    /// One table, then end
    #[arg(long)]
    pub once: bool,

    /// One JSON object, for programs, then end
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &TopArgs, console: &mut Console) -> Result<(), CommandError> {
    if args.json || args.once || !has_screen(console) {
        let (mut robot, info) = args.robot.connect()?;
        let reading = Reader::default().read(&mut robot, Tasks::All)?;
        let report = TopReport::new(info, reading);
        return if args.json {
            console.json_line(&report)
        } else {
            console.text(&report.to_string())
        };
    }
    let interrupt = Interrupt::take_over()?;
    // What is wrong with the port is said before the screen is taken.
    let (robot, info) = args.robot.connect()?;
    let interval = Duration::from_micros(args.interval.us).max(SHORTEST_INTERVAL);
    let watch = Watch::start(args.robot.clone(), robot, interval)?;
    let palette = Palette {
        colour: console.colour_out(),
    };
    follow(watch, View::new(info), palette, interrupt)
}

/// Whether standard output is a terminal on which a cursor can be moved.
fn has_screen(console: &Console) -> bool {
    let is_dumb = std::env::var_os("TERM").as_deref() == Some(OsStr::new("dumb"));
    console.out_is_terminal() && !is_dumb
}

/// The terminal's screen while this command has it. Dropping it gives the terminal back as it was; a panic does so too.
struct Screen(ratatui::DefaultTerminal);

impl Screen {
    fn take() -> Result<Self, CommandError> {
        ratatui::try_init().map(Screen).map_err(|error| {
            // Half of it may be done.
            ratatui::restore();
            error.into()
        })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        ratatui::restore();
    }
}

/// Shows the view until the person has seen enough.
fn follow(
    watch: Watch,
    mut view: View,
    palette: Palette,
    interrupt: Interrupt,
) -> Result<(), CommandError> {
    let started = Instant::now();
    let mut screen = Screen::take()?;
    while !interrupt.is_requested() {
        view.set_time(started.elapsed());
        while let Some(news) = watch.news().map_err(CommandError::World)? {
            match news {
                News::Read(reading) => view.take(*reading),
                News::Found(robot) => view.found(robot),
                News::Lost(why) => view.lost(why),
            }
        }
        screen.0.draw(|frame| screen::draw(frame, &view, palette))?;
        // All that was typed or pasted meanwhile, before the next drawing.
        let mut wait = KEY_WAIT;
        while event::poll(wait)? {
            wait = Duration::ZERO;
            match meaning(&event::read()?) {
                Some(Meaning::Quit) => return Ok(()),
                Some(Meaning::Key(key)) => {
                    view.press(key);
                    watch.look_at(view.selected());
                }
                None => {}
            }
        }
    }
    Ok(())
}

/// What a person means by a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Meaning {
    Quit,
    Key(Key),
}

fn meaning(event: &Event) -> Option<Meaning> {
    let Event::Key(KeyEvent {
        code,
        modifiers,
        kind: KeyEventKind::Press | KeyEventKind::Repeat,
        ..
    }) = event
    else {
        return None;
    };
    if modifiers.contains(KeyModifiers::CONTROL) {
        return matches!(code, KeyCode::Char('c' | 'C')).then_some(Meaning::Quit);
    }
    let key = match code {
        KeyCode::Char('q' | 'Q') | KeyCode::Esc => return Some(Meaning::Quit),
        KeyCode::Char('r' | 'R') => Key::Reset,
        KeyCode::Char('p' | 'P') => Key::Pause,
        KeyCode::Up | KeyCode::Left => Key::Up,
        KeyCode::Down | KeyCode::Right => Key::Down,
        KeyCode::Home => Key::First,
        KeyCode::End => Key::Last,
        _ => return None,
    };
    Some(Meaning::Key(key))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_mean_what_the_help_says() {
        let press = |code, modifiers| meaning(&Event::Key(KeyEvent::new(code, modifiers)));
        let none = KeyModifiers::NONE;
        for (code, modifiers, expected) in [
            (KeyCode::Char('q'), none, Some(Meaning::Quit)),
            (KeyCode::Esc, none, Some(Meaning::Quit)),
            (
                KeyCode::Char('c'),
                KeyModifiers::CONTROL,
                Some(Meaning::Quit),
            ),
            (KeyCode::Char('c'), none, None),
            (KeyCode::Char('r'), KeyModifiers::CONTROL, None),
            (KeyCode::Char('r'), none, Some(Meaning::Key(Key::Reset))),
            (
                KeyCode::Char('P'),
                KeyModifiers::SHIFT,
                Some(Meaning::Key(Key::Pause)),
            ),
            (KeyCode::Up, none, Some(Meaning::Key(Key::Up))),
            (KeyCode::Down, none, Some(Meaning::Key(Key::Down))),
            (KeyCode::Home, none, Some(Meaning::Key(Key::First))),
            (KeyCode::End, none, Some(Meaning::Key(Key::Last))),
            (KeyCode::Tab, none, None),
        ] {
            assert_eq!(press(code, modifiers), expected, "{code:?} {modifiers:?}");
        }
        assert_eq!(meaning(&Event::Resize(80, 24)), None);
    }
}
