//! What keys mean, and for how long.

use std::time::Duration;

use esm_link::behaviours::{MAX_DRIVE_M_PER_S, MAX_DRIVE_RAD_PER_S};
use rt_firmware::tasks::Twist;

/// How long a movement holds after the last key: a terminal says that a key is pressed, and says so
/// again while it is, and never that it was let go. It says so for the second time after half a
/// second at most, as a rule.
const HOLD: Duration = Duration::from_millis(600);

/// By how much a key changes the speed.
const FASTER: f32 = 1.25;
/// The slowest, as a part of what was asked for on the command line.
const SLOWEST: f32 = 0.1;

/// What a person wants with a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Drive ahead.
    Ahead,
    /// Drive backwards.
    Back,
    /// Turn to the left.
    Left,
    /// Turn to the right.
    Right,
    /// Stand still.
    Stop,
    /// Faster from now on.
    Faster,
    /// Slower from now on.
    Slower,
}

/// Reads a movement: two numbers, with a comma or a space between, metres per second ahead and
/// radians per second to the left.
///
/// # Errors
/// What is expected.
pub fn twist(text: &str) -> Result<Twist, String> {
    let parts = text.split_once(',').or_else(|| text.split_once(' '));
    let number = |text: &str| text.trim().parse::<f32>().ok();
    let read = parts.and_then(|(ahead, left)| Some((number(ahead)?, number(left)?)));
    let is_within = |value: f32, most: f32| (-most..=most).contains(&value);
    match read {
        Some((forward_m_per_s, turn_rad_per_s))
            if is_within(forward_m_per_s, MAX_DRIVE_M_PER_S)
                && is_within(turn_rad_per_s, MAX_DRIVE_RAD_PER_S) =>
        {
            Ok(Twist {
                forward_m_per_s,
                turn_rad_per_s,
            })
        }
        _ => Err(format!(
            "two numbers: metres per second ahead, {MAX_DRIVE_M_PER_S} at most, and radians per second to the left, {MAX_DRIVE_RAD_PER_S} at most, such as 0.2,0.5"
        )),
    }
}

/// What the person wants.
#[derive(Clone, Copy, Debug)]
pub struct Steering {
    speed_m_per_s: f32,
    rate_rad_per_s: f32,
    /// What the speeds are multiplied by.
    part: f32,
    /// Ahead or backwards: 1, 0, -1; to the left or the right.
    ahead: f32,
    left: f32,
    pressed: Option<Duration>,
}

impl Steering {
    /// Nothing yet, with these speeds.
    pub fn new(speed_m_per_s: f32, rate_rad_per_s: f32) -> Self {
        Self {
            speed_m_per_s,
            rate_rad_per_s,
            part: 1.0,
            ahead: 0.0,
            left: 0.0,
            pressed: None,
        }
    }

    fn is_pressed(&self, now: Duration) -> bool {
        (self.pressed).is_some_and(|pressed| now.saturating_sub(pressed) < HOLD)
    }

    /// A key is pressed, at this time.
    pub fn press(&mut self, key: Key, now: Duration) {
        if !self.is_pressed(now) {
            (self.ahead, self.left) = (0.0, 0.0);
        }
        match key {
            // To drive straight on takes no other key.
            Key::Ahead => (self.ahead, self.left) = (1.0, 0.0),
            Key::Back => (self.ahead, self.left) = (-1.0, 0.0),
            Key::Left => self.left = 1.0,
            Key::Right => self.left = -1.0,
            Key::Stop => (self.ahead, self.left) = (0.0, 0.0),
            Key::Faster => {
                let most_m = MAX_DRIVE_M_PER_S / self.speed_m_per_s;
                let most_rad = MAX_DRIVE_RAD_PER_S / self.rate_rad_per_s;
                self.part = (self.part * FASTER).min(most_m).min(most_rad);
            }
            Key::Slower => self.part = (self.part / FASTER).max(SLOWEST),
        }
        if !matches!(key, Key::Faster | Key::Slower) {
            self.pressed = Some(now);
        }
    }

    /// How fast it drives and turns: in metres and radians per second.
    pub fn speeds(&self) -> (f32, f32) {
        (
            self.part * self.speed_m_per_s,
            self.part * self.rate_rad_per_s,
        )
    }

    /// How the robot is to move now; none where nobody wants anything of it, so that what it does
    /// otherwise goes on.
    pub fn wanted(&self, now: Duration) -> Option<Twist> {
        self.is_pressed(now).then_some(Twist {
            forward_m_per_s: self.ahead * self.part * self.speed_m_per_s,
            turn_rad_per_s: self.left * self.part * self.rate_rad_per_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn keys_drive_as_long_as_they_are_held() {
        let mut steering = Steering::new(0.2, 1.0);
        assert_eq!(steering.wanted(at(0)), None);
        let mut time_ms = 0;
        for (wait_ms, key, expected) in [
            (0, Key::Ahead, (0.2, 0.0)),
            (500, Key::Left, (0.2, 1.0)),
            (30, Key::Left, (0.2, 1.0)),
            (30, Key::Right, (0.2, -1.0)),
            (30, Key::Ahead, (0.2, 0.0)),
            (30, Key::Back, (-0.2, 0.0)),
            (30, Key::Stop, (0.0, 0.0)),
            (30, Key::Left, (0.0, 1.0)),
            // All were let go meanwhile.
            (700, Key::Right, (0.0, -1.0)),
        ] {
            time_ms += wait_ms;
            steering.press(key, at(time_ms));
            let wanted = steering.wanted(at(time_ms + 599)).unwrap();
            let wanted = (wanted.forward_m_per_s, wanted.turn_rad_per_s);
            assert_eq!(wanted, expected, "{key:?} at {time_ms} ms");
            assert_eq!(steering.wanted(at(time_ms + 600)), None);
        }
    }

    #[test]
    fn it_gets_faster_and_slower_within_what_a_robot_may() {
        let mut steering = Steering::new(0.2, 1.0);
        steering.press(Key::Faster, at(0));
        assert_eq!(steering.wanted(at(0)), None, "no movement by itself");
        steering.press(Key::Ahead, at(0));
        assert_eq!(steering.wanted(at(0)).unwrap().forward_m_per_s, 0.25);
        for _ in 0..100 {
            steering.press(Key::Faster, at(0));
        }
        steering.press(Key::Left, at(0));
        let wanted = steering.wanted(at(0)).unwrap();
        assert!(wanted.forward_m_per_s <= MAX_DRIVE_M_PER_S);
        assert!(wanted.turn_rad_per_s <= MAX_DRIVE_RAD_PER_S && wanted.turn_rad_per_s > 6.0);
        for _ in 0..100 {
            steering.press(Key::Slower, at(0));
        }
        let slowest = steering.wanted(at(0)).unwrap().forward_m_per_s;
        assert!((slowest - 0.02).abs() < 1e-6, "{slowest}");
    }

    #[test]
    fn a_movement_is_two_numbers_that_a_robot_may_be_driven_by() {
        let is = |forward_m_per_s, turn_rad_per_s| {
            Ok(Twist {
                forward_m_per_s,
                turn_rad_per_s,
            })
        };
        assert_eq!(twist("0.2,-0.5"), is(0.2, -0.5));
        assert_eq!(twist("-2 , 6.3"), is(-2.0, 6.3));
        assert_eq!(twist("0.1 0"), is(0.1, 0.0));
        for text in ["", "1", "1,", "NaN,0", "0,inf", "2.1,0", "0,6.4", "1,2,3"] {
            assert!(twist(text).is_err(), "{text}");
        }
    }
}
