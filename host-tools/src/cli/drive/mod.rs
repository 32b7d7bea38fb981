//! `esm drive`: a robot steered by hand.
//!
//! | module | what it holds |
//! |---|---|
//! | [`steering`] | what keys mean, and for how long |
//! | [`gamepad`] | movements from the stick of a gamepad |
//! | [`hand`] | who sends movements to the robot, again and again, in a thread of its own |

pub mod gamepad;
pub mod hand;
pub mod steering;

use std::io::BufRead;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use clap::Args;
use esm_link::behaviours::{MAX_DRIVE_M_PER_S, MAX_DRIVE_RAD_PER_S};
use esm_link::features::Feature;
use ratatui::Frame;
use ratatui::crossterm::event::{KeyCode, KeyEvent};
use ratatui::text::Line;
use ratatui::widgets::Paragraph;
use rt_firmware::tasks::Twist;

use super::argument::Time;
use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use super::terminal::{self, KEY_WAIT, Meaning, Palette, Shown};
use crate::run::interrupt::Interrupt;
use gamepad::Gamepad;
use hand::{Hand, Told};
use steering::{Key, Steering};

/// How long a movement that a program asks for in a line holds without the next.
const LINE_HOLDS: Duration = Duration::from_millis(300);

/// Steers a robot by hand: before what it does otherwise, which goes on afterwards
///
/// Hold an arrow key to drive. Up and down drive, left and right turn, together they drive an arc;
/// space stops, plus and minus change the speed, q, Esc and Ctrl-C quit. The robot stands still
/// half a second after the last key. It stops by itself where something is in its way, and 300 ms
/// after the last word on a lost line. With --gamepad the left stick of a gamepad steers, and lets
/// go in its middle. Without a terminal name a movement with --twist, or let a program write
/// movements to standard input with --stdin: a line for each, metres per second ahead and radians
/// per second to the left, at least four times a second.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm drive --port /dev/ttyACM0
  esm drive --port /dev/ttyACM0 --speed 0.1
  esm drive --port /dev/ttyACM0 --twist 0.2,0.5 --for '2 s'
  esm drive --port /dev/ttyACM0 --gamepad --speed 0.4
  my_program | esm drive --port /dev/ttyACM0 --stdin")]
pub struct DriveArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// How fast it drives, in metres per second
    #[arg(long, value_name = "SPEED", default_value_t = 0.2, value_parser = within::<{ MAX_DRIVE_M_PER_S as u32 }>)]
    pub speed: f32,

    /// How fast it turns, in radians per second
    #[arg(long, value_name = "RATE", default_value_t = 1.0, value_parser = within::<{ MAX_DRIVE_RAD_PER_S as u32 }>)]
    pub rate: f32,

    /// A movement, without a terminal: metres per second ahead, a comma, radians per second to the
    /// left
    #[arg(
        long,
        value_name = "AHEAD,LEFT",
        requires = "time",
        allow_hyphen_values = true,
        value_parser = steering::twist
    )]
    pub twist: Option<Twist>,

    /// How long it moves so, such as '2 s'
    #[arg(id = "time", long = "for", value_name = "TIME", requires = "twist")]
    pub time: Option<Time>,

    /// Movements from standard input, a line each
    #[arg(long, conflicts_with = "twist")]
    pub stdin: bool,

    /// Movements from the left stick of a gamepad, up to --speed and --rate [default device: the
    /// first of /dev/input/js*]
    #[arg(
        long,
        value_name = "DEVICE",
        num_args = 0..=1,
        require_equals = true,
        conflicts_with_all = ["twist", "stdin"]
    )]
    pub gamepad: Option<Option<PathBuf>>,
}

/// A number above 0, up to so many.
fn within<const MOST: u32>(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(value) if value > 0.0 && value <= MOST as f32 => Ok(value),
        _ => Err(format!("a number above 0, {MOST} at most")),
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &DriveArgs, console: &mut Console) -> Result<(), CommandError> {
    let has_screen = terminal::has_screen(console);
    if args.twist.is_none() && !args.stdin && args.gamepad.is_none() && !has_screen {
        return Err(CommandError::Usage(anyhow!(
            "there is no terminal to read keys from: name a movement with --twist and --for, write movements to standard input with --stdin, or steer with --gamepad"
        )));
    }
    let gamepad = match &args.gamepad {
        Some(device) => Some(Gamepad::open(device.as_deref())?),
        None => None,
    };
    let interrupt = Interrupt::take_over()?;
    let (mut robot, _) = args.robot.connect_to_upload(console)?;
    robot.require(Feature::Behaviours)?;
    // That it can be steered is said before anything moves.
    robot.behaviour_list()?;
    robot.limit_waits(None);
    let hand = Hand::start(robot)?;
    let driven = if let (Some(twist), Some(time)) = (args.twist, args.time) {
        let until = Instant::now() + Duration::from_micros(time.us);
        for_a_time(&hand, twist, until, interrupt)
    } else if args.stdin {
        from_lines(&hand, interrupt)
    } else if let Some(gamepad) = &gamepad {
        console.note("the gamepad steers: Ctrl-C ends it");
        from_gamepad(&hand, gamepad, (args.speed, args.rate), interrupt)
    } else {
        let mut driving = Driving {
            hand: &hand,
            steering: Steering::new(args.speed, args.rate),
            started: Instant::now(),
            told: Told::default(),
            palette: Palette {
                colour: console.colour_out(),
            },
        };
        terminal::show(&mut driving, interrupt)
    };
    let ended = hand.end();
    driven?;
    ended
}

/// How often who waits looks around.
const LOOK: Duration = Duration::from_millis(20);

fn for_a_time(
    hand: &Hand,
    twist: Twist,
    until: Instant,
    interrupt: Interrupt,
) -> Result<(), CommandError> {
    hand.ask(Some(twist));
    while Instant::now() < until && !interrupt.is_requested() {
        if hand.has_ended() {
            return Ok(());
        }
        std::thread::sleep(LOOK);
    }
    hand.ask(None);
    Ok(())
}

/// Movements from a gamepad, until Ctrl-C.
fn from_gamepad(
    hand: &Hand,
    gamepad: &Gamepad,
    (speed_m_per_s, rate_rad_per_s): (f32, f32),
    interrupt: Interrupt,
) -> Result<(), CommandError> {
    let steer = || {
        while !interrupt.is_requested() && !hand.has_ended() {
            hand.ask(gamepad.wanted(speed_m_per_s, rate_rad_per_s)?);
            std::thread::sleep(LOOK);
        }
        Ok(())
    };
    let steered = steer();
    hand.ask(None);
    steered
}

/// Movements from standard input: each holds until the next, for a moment at most.
fn from_lines(hand: &Hand, interrupt: Interrupt) -> Result<(), CommandError> {
    let (lines, read) = std::sync::mpsc::channel();
    let is_over = Arc::new(AtomicBool::new(false));
    let over = Arc::clone(&is_over);
    std::thread::Builder::new()
        .name("movements".to_owned())
        .spawn(move || {
            for line in std::io::stdin().lock().lines() {
                if over.load(Ordering::Relaxed) || lines.send(line).is_err() {
                    return;
                }
            }
        })?;
    let mut number = 0;
    let mut holds_until = Instant::now();
    let result = loop {
        if interrupt.is_requested() || hand.has_ended() {
            break Ok(());
        }
        match read.recv_timeout(LOOK) {
            Ok(Ok(line)) => {
                number += 1;
                match steering::twist(line.trim()) {
                    Ok(twist) => hand.ask(Some(twist)),
                    Err(expected) => {
                        break Err(CommandError::Input(anyhow!(
                            "line {number} of standard input is no movement: {expected}"
                        )));
                    }
                }
                holds_until = Instant::now() + LINE_HOLDS;
            }
            Ok(Err(error)) => break Err(error.into()),
            Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {
                if Instant::now() >= holds_until {
                    hand.ask(None);
                }
            }
            Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => {
                // The last one holds as long as it may.
                while Instant::now() < holds_until && !interrupt.is_requested() {
                    std::thread::sleep(LOOK);
                }
                break Ok(());
            }
        }
    };
    is_over.store(true, Ordering::Relaxed);
    hand.ask(None);
    result
}

/// A person who steers with keys.
struct Driving<'h> {
    hand: &'h Hand,
    steering: Steering,
    started: Instant,
    told: Told,
    palette: Palette,
}

impl Shown for Driving<'_> {
    fn update(&mut self) -> Result<Duration, CommandError> {
        if self.hand.has_ended() {
            // Why, is said when the screen is given back.
            return Err(CommandError::Told);
        }
        self.hand.ask(self.steering.wanted(self.started.elapsed()));
        self.told = self.hand.told();
        Ok(KEY_WAIT / 2)
    }

    fn draw(&mut self, frame: &mut Frame<'_>) {
        let wanted = match self.steering.wanted(self.started.elapsed()) {
            None => "nobody steers: the robot does what its mission says".to_owned(),
            Some(twist) => format!(
                "ahead {:+.2} m/s, to the left {:+.2} rad/s",
                twist.forward_m_per_s, twist.turn_rad_per_s
            ),
        };
        let style = if self.told.is_good() {
            self.palette.good()
        } else {
            self.palette.warning()
        };
        let (speed, rate) = self.steering.speeds();
        let keys = format!(
            "hold arrows: drive ({speed:.2} m/s, {rate:.2} rad/s)   space: stop   + -: faster, slower   q: quit"
        );
        let lines = vec![
            Line::raw(wanted),
            Line::styled(self.told.to_string(), style),
            Line::raw(""),
            Line::styled(keys, self.palette.quiet()),
        ];
        let lines = terminal::broken(&lines, frame.area().width);
        frame.render_widget(Paragraph::new(lines), frame.area());
    }

    fn press(&mut self, key: KeyEvent) -> ControlFlow<()> {
        match meaning(key) {
            Some(Meaning::Quit) => return ControlFlow::Break(()),
            Some(Meaning::Key(key)) => {
                self.steering.press(key, self.started.elapsed());
                self.hand.ask(self.steering.wanted(self.started.elapsed()));
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
        KeyCode::Up | KeyCode::Char('w' | 'W') => Key::Ahead,
        KeyCode::Down | KeyCode::Char('s' | 'S') => Key::Back,
        KeyCode::Left | KeyCode::Char('a' | 'A') => Key::Left,
        KeyCode::Right | KeyCode::Char('d' | 'D') => Key::Right,
        KeyCode::Char(' ') => Key::Stop,
        KeyCode::Char('+') => Key::Faster,
        KeyCode::Char('-') => Key::Slower,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use ratatui::crossterm::event::KeyModifiers;

    use super::*;

    #[test]
    fn keys_mean_what_the_help_says() {
        let none = KeyModifiers::NONE;
        for (code, modifiers, expected) in [
            (KeyCode::Up, none, Some(Meaning::Key(Key::Ahead))),
            (KeyCode::Char('s'), none, Some(Meaning::Key(Key::Back))),
            (KeyCode::Left, none, Some(Meaning::Key(Key::Left))),
            (KeyCode::Char('D'), none, Some(Meaning::Key(Key::Right))),
            (KeyCode::Char(' '), none, Some(Meaning::Key(Key::Stop))),
            (KeyCode::Char('+'), none, Some(Meaning::Key(Key::Faster))),
            (KeyCode::Char('-'), none, Some(Meaning::Key(Key::Slower))),
            (KeyCode::Esc, none, Some(Meaning::Quit)),
            (KeyCode::Char('s'), KeyModifiers::CONTROL, None),
            (KeyCode::Tab, none, None),
        ] {
            assert_eq!(
                meaning(KeyEvent::new(code, modifiers)),
                expected,
                "{code:?}"
            );
        }
    }
}
