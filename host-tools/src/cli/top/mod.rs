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

use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use clap::Args;
use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent};

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::terminal::{self, KEY_WAIT, Meaning, Palette, Shown};
use crate::reading::{Reader, Tasks};
use crate::run::interrupt::Interrupt;
use report::TopReport;
use view::{Key, View};
use watch::{Change, Watch};

/// The shortest time between two readings; an answer takes the robot some milliseconds.
const SHORTEST_INTERVAL: Duration = Duration::from_millis(50);

/// Shows a robot's slots as they run: executions, overruns, start delays, load
///
/// A row for each slot, start delays and tasks of the one that is looked at. Keys: arrows choose a
/// slot, r counts from now on, p pauses, q, Esc and Ctrl-C quit. A robot that does not answer is
/// looked for until it does. Where standard output is no terminal, as with --once, one table is
/// printed. What the figures mean and what to do about them is in the book, under
/// `Slots and timing`.
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
    if args.json || args.once || !terminal::has_screen(console) {
        let (mut robot, info) = args.robot.connect(console)?;
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
    let (mut robot, info) = args.robot.connect(console)?;
    robot.limit_waits(None);
    let interval = Duration::from_micros(args.interval.us).max(SHORTEST_INTERVAL);
    let watch = Watch::start(args.robot.clone(), robot, interval)?;
    let mut following = Following {
        watch,
        view: View::new(info),
        palette: Palette {
            colour: console.colour_out(),
        },
        started: Instant::now(),
    };
    terminal::show(&mut following, interrupt)
}

/// A robot that is watched on the screen.
struct Following {
    watch: Watch,
    view: View,
    palette: Palette,
    started: Instant,
}

impl Shown for Following {
    fn update(&mut self) -> Result<Duration, CommandError> {
        self.view.set_time(self.started.elapsed());
        while let Some(news) = self.watch.news().map_err(CommandError::World)? {
            match news {
                Change::Read(reading, nets) => {
                    self.view.take(*reading);
                    self.view.take_nets(nets);
                }
                Change::Found(robot) => self.view.found(robot),
                Change::Lost(why) => self.view.lost(why),
            }
        }
        Ok(KEY_WAIT)
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        screen::draw(frame, &self.view, self.palette);
    }

    fn press(&mut self, key: KeyEvent) -> ControlFlow<()> {
        match meaning(key) {
            Some(Meaning::Quit) => return ControlFlow::Break(()),
            Some(Meaning::Key(key)) => {
                self.view.press(key);
                self.watch.look_at(self.view.selected());
            }
            None => {}
        }
        ControlFlow::Continue(())
    }
}

fn meaning(key: KeyEvent) -> Option<Meaning<Key>> {
    terminal::meaning(key, own_key)
}

fn own_key(code: KeyCode) -> Option<Key> {
    Some(match code {
        KeyCode::Char('r' | 'R') => Key::Reset,
        KeyCode::Char('p' | 'P') => Key::Pause,
        KeyCode::Up | KeyCode::Left => Key::Up,
        KeyCode::Down | KeyCode::Right => Key::Down,
        KeyCode::Home => Key::First,
        KeyCode::End => Key::Last,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use ratatui::crossterm::event::KeyModifiers;

    use super::*;

    #[test]
    fn keys_mean_what_the_help_says() {
        let press = |code, modifiers| meaning(KeyEvent::new(code, modifiers));
        let none = KeyModifiers::NONE;
        for (code, modifiers, expected) in [
            (KeyCode::Char('q'), none, Some(Meaning::Quit)),
            (KeyCode::Esc, none, Some(Meaning::Quit)),
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
    }
}
