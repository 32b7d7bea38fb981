//! Movements from the stick of a gamepad.
//!
//! A gamepad is a device of the Linux kernel's joystick interface, `/dev/input/js0` and on, which
//! tells events of eight bytes: a time (`u32`, ms), a value (`i16`), a type (`u8`: 1 a button, 2 an
//! axis, with 128 added where it tells how things are at the start), a number (`u8`); in the byte
//! order of the machine. Source: the kernel's documentation, "Joystick API Documentation",
//! section 2. Axis 0 of nearly all gamepads is the left stick's to the right, axis 1 its towards
//! the person.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, TryRecvError};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::anyhow;
use rt_firmware::tasks::Twist;

use crate::cli::exit::CommandError;

/// Where gamepads are, and how their names begin.
const FOLDER: &str = "/dev/input";
const PREFIX: &str = "js";

/// Bytes of an event.
const EVENT_BYTES: usize = 8;
/// The type of an axis.
const AXIS: u8 = 2;
/// Added to the type of what is so at the start.
const AT_START: u8 = 128;
/// The axes of the left stick.
const TO_THE_RIGHT: u8 = 0;
const TOWARDS_ME: u8 = 1;
/// An axis that is pushed to its end.
const FULL: f32 = 32_767.0;
/// A stick that is nearer to its middle than this part of its way is let go: few come back to
/// exactly 0.
const LET_GO: f32 = 0.12;

/// Where a stick is: the axes' values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Stick {
    to_the_right: i16,
    towards_me: i16,
}

impl Stick {
    /// Takes an event.
    fn take(&mut self, event: [u8; EVENT_BYTES]) {
        let [_, _, _, _, low, high, kind, number] = event;
        let value = i16::from_ne_bytes([low, high]);
        match (kind & !AT_START, number) {
            (AXIS, TO_THE_RIGHT) => self.to_the_right = value,
            (AXIS, TOWARDS_ME) => self.towards_me = value,
            _ => {}
        }
    }

    /// The movement that it asks for, at these speeds at its end; none where it is let go.
    fn wanted(self, speed_m_per_s: f32, rate_rad_per_s: f32) -> Option<Twist> {
        let part = |value: i16| {
            let part = (f32::from(value) / FULL).clamp(-1.0, 1.0);
            let beyond = (part.abs() - LET_GO).max(0.0) / (1.0 - LET_GO);
            beyond.copysign(part)
        };
        let (right, back) = (part(self.to_the_right), part(self.towards_me));
        (right != 0.0 || back != 0.0).then_some(Twist {
            forward_m_per_s: -back * speed_m_per_s,
            turn_rad_per_s: -right * rate_rad_per_s,
        })
    }
}

/// A gamepad that is read, in a thread of its own.
pub struct Gamepad {
    stick: Arc<Mutex<Stick>>,
    /// Why it is not read any more.
    gone: Receiver<io::Error>,
    path: PathBuf,
}

impl Gamepad {
    /// The gamepad at a path, or the first that is plugged in.
    ///
    /// # Errors
    /// There is none, or it cannot be read.
    pub fn open(path: Option<&Path>) -> Result<Self, CommandError> {
        let path = match path {
            Some(path) => path.to_owned(),
            None => first()?,
        };
        let unread = |error: &io::Error| {
            CommandError::World(anyhow!(
                "the gamepad at {} cannot be read: {error}; it is a device such as /dev/input/js0, and may take membership in the group `input`",
                path.display()
            ))
        };
        let mut device = File::open(&path).map_err(|error| unread(&error))?;
        let stick = Arc::new(Mutex::new(Stick::default()));
        let (tell, gone) = mpsc::channel();
        let read = Arc::clone(&stick);
        std::thread::Builder::new()
            .name("gamepad".to_owned())
            .spawn(move || {
                let mut event = [0; EVENT_BYTES];
                let error = loop {
                    if let Err(error) = device.read_exact(&mut event) {
                        break error;
                    }
                    read.lock()
                        .unwrap_or_else(PoisonError::into_inner)
                        .take(event);
                };
                let _ = tell.send(error);
            })?;
        Ok(Self { stick, gone, path })
    }

    /// The movement that it asks for now, at these speeds at the stick's end; none where it is let
    /// go.
    ///
    /// # Errors
    /// It is not there any more.
    pub fn wanted(
        &self,
        speed_m_per_s: f32,
        rate_rad_per_s: f32,
    ) -> Result<Option<Twist>, CommandError> {
        match self.gone.try_recv() {
            Err(TryRecvError::Empty) => {}
            Ok(_) | Err(TryRecvError::Disconnected) => {
                return Err(CommandError::World(anyhow!(
                    "the gamepad at {} is not there any more: the robot does what it did before",
                    self.path.display()
                )));
            }
        }
        let stick = *self.stick.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(stick.wanted(speed_m_per_s, rate_rad_per_s))
    }
}

/// The first gamepad that is plugged in.
fn first() -> Result<PathBuf, CommandError> {
    let entries = fs::read_dir(FOLDER).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let is_gamepad = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.is_some_and(|name| name.starts_with(PREFIX))
    };
    paths.filter(is_gamepad).min().ok_or_else(|| {
        CommandError::World(anyhow!(
            "there is no gamepad at {FOLDER}/{PREFIX}*: plug one in, or name its device with `--gamepad=DEVICE`"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(value: i16, kind: u8, number: u8) -> [u8; EVENT_BYTES] {
        let [low, high] = value.to_ne_bytes();
        [1, 2, 3, 4, low, high, kind, number]
    }

    fn wanted(events: &[[u8; EVENT_BYTES]]) -> Option<(f32, f32)> {
        let mut stick = Stick::default();
        for event in events {
            stick.take(*event);
        }
        let twist = stick.wanted(0.2, 1.0)?;
        Some((twist.forward_m_per_s, twist.turn_rad_per_s))
    }

    #[test]
    fn a_stick_drives_where_it_is_pushed_and_lets_go_in_its_middle() {
        for (events, expected) in [
            (&[][..], None),
            (&[event(-32_767, AXIS, TOWARDS_ME)], Some((0.2, 0.0))),
            (&[event(32_767, AXIS, TOWARDS_ME)], Some((-0.2, 0.0))),
            (&[event(-32_768, AXIS, TO_THE_RIGHT)], Some((0.0, 1.0))),
            (
                &[event(32_767, AXIS | AT_START, TO_THE_RIGHT)],
                Some((0.0, -1.0)),
            ),
            (
                &[
                    event(3_000, AXIS, TO_THE_RIGHT),
                    event(-3_900, AXIS, TOWARDS_ME),
                ],
                None,
            ),
            // Other axes and buttons mean nothing.
            (&[event(-32_767, AXIS, 3), event(1, 1, TOWARDS_ME)], None),
            (
                &[event(-32_767, AXIS, TOWARDS_ME), event(0, AXIS, TOWARDS_ME)],
                None,
            ),
        ] {
            assert_eq!(wanted(events), expected, "{events:?}");
        }
        // Half beyond the middle's part is half of the speed.
        let half = ((LET_GO + (1.0 - LET_GO) / 2.0) * FULL) as i16;
        let (ahead, left) = wanted(&[event(-half, AXIS, TOWARDS_ME)]).expect("a movement");
        assert!((ahead - 0.1).abs() < 1e-4 && left == 0.0, "{ahead} {left}");
    }

    #[test]
    fn a_gamepad_that_is_not_there_is_said_so() {
        let error = Gamepad::open(Some(Path::new("/dev/input/none")))
            .err()
            .expect("none");
        assert!(
            error
                .message()
                .expect("a message")
                .to_string()
                .contains("cannot be read")
        );
        // One that ends: a file with two events.
        let file = tempfile::NamedTempFile::new().expect("a file");
        let events = [
            event(-32_767, AXIS, TOWARDS_ME),
            event(0, AXIS, TO_THE_RIGHT),
        ]
        .concat();
        fs::write(file.path(), events).expect("written");
        let gamepad = Gamepad::open(Some(file.path())).expect("a gamepad");
        let until = std::time::Instant::now() + std::time::Duration::from_secs(10);
        let error = loop {
            assert!(std::time::Instant::now() < until, "it never ends");
            if let Err(error) = gamepad.wanted(0.2, 1.0) {
                break error;
            }
        };
        assert!(
            error
                .message()
                .expect("a message")
                .to_string()
                .contains("not there any more")
        );
    }
}
