//! Measures the ranges around the robot.

use core::array;
use core::f32::consts::TAU;

use embedded_hal::digital::OutputPin;

use super::values::{Bearing, MAX_SONARS, Pose, Ranges};
use crate::drivers::{Answer, EchoTimer, Sonar, Sound};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Sonars that look this many eighths of a turn apart, or fewer, hear each other. A sonar's beam is
/// 15° to each side, and its receiver hears loud sound from twice that: what lies between two beams
/// that are 45° apart echoes into both.
const HEARS_EIGHTHS: u8 = 1;

/// Windows between two pings of one sonar, at least: its data sheet asks for 60 ms, so that no late
/// echo of one ping is taken for an early one of the next, and a window is 40 ms.
const FEWEST_WINDOWS: u8 = 2;

/// The windows in which eight sonars ping that look to all sides: every other one in each.
pub const RING_WINDOWS: [u8; Bearing::COUNT] = firing_windows(&Bearing::ALL);

/// Answers to nothing but the second in a row is believed: what was seen a moment ago is not gone
/// because one echo was lost. Lost echoes are a few in a hundred; two in a row are one in a
/// thousand.
const EMPTY_BELIEVED_AFTER: u8 = 2;

/// So many answers before the newest one are remembered, for the median of three.
const EARLIER: usize = 2;

/// A sonar that left so many pings in a row without an answer is unknown: one may have been lost on
/// the wire.
const UNKNOWN_AFTER: u8 = 2;

/// A sonar that left so many pings in a row without an answer is dead. A sonar that works answers
/// each ping, also where nothing is there, so that no echo that is lost counts here; three pings
/// are 240 ms, longer than any dip of the supply while the motors start.
pub const DEAD_AFTER: u8 = 3;

/// A sonar that so often heard nothing where others heard something is deaf. One may be chance, a
/// lost echo or something that moved away; each further one is in another direction, and an echo in
/// between starts the count anew.
pub const DEAF_AFTER: u8 = 3;

/// What is nearer than this any sonar hears that looks at it, in metres.
const CERTAIN_M: f32 = 1.0;

/// What is nearer than this stands at the sonar's nose, in metres: a receiver that hears its own
/// burst says so, always.
const NOSE_M: f32 = 0.05;

/// Farther than this is certainly not at the nose of a sonar that looks there from the same place,
/// in metres.
const CLEAR_M: f32 = 0.3;

/// Whether sonars are found out that see something where others see none. A small robot does
/// without: such a sonar keeps it from moving, and from nothing worse.
const FINDS_BLIND: bool = cfg!(feature = "all-tasks");

/// Directions that the robot tells apart where it looks for deaf sonars: 15° each, a sonar's beam
/// to one side.
const DIRECTIONS: usize = 24;

/// How many maps a robot has of where nothing is near.
const CLEAR_MAPS: usize = FINDS_BLIND as usize;

/// What was heard counts at a place, and for a time: who drives on or waits looks at something
/// else.
const PLACE_M: f32 = 0.05;
const REMEMBERED_US: u32 = 3_000_000;

/// Pings some of its sonars in each activation of its slot and collects their answers in the next.
/// Those that would hear each other ping in different ones ([`firing_windows`]). The slot's period
/// must leave a sonar the time to answer: at least 40 ms.
///
/// Of each sonar it publishes its range, how old that is, and whether it is known. What is not
/// known is never far: a sonar that does not answer has no range ([`Ranges`]). An echo that is
/// missed once changes nothing but the age.
///
/// With `median` a range is the median of the last three answers, but where the newest is nearer
/// than that, it is the newest: what steps in the way is believed at once, and that it has gone
/// when two pings of three say so.
///
/// `faulty` is set while a sonar is dead (it does not answer) or deaf (it answers that nothing is
/// there, where others heard something, or that something is at its nose, where others heard none);
/// which one, the ranges say. A deaf sonar is found only where the robot turns on the spot with its
/// `pose` connected, so that one sonar comes to look where another one has just looked.
#[derive(Debug)]
pub struct SonarRing<T, E, const N: usize = MAX_SONARS> {
    channels: [Channel<T, E>; N],
    /// How many windows there are, and the one whose sonars ping next.
    windows: u8,
    window: u8,
    /// Windows since the state was entered.
    asked: u8,
    heard: Heard,
}

task! {
    /// Measures with sonars what is around the robot. Those that would hear each other ping in
    /// turn, so the slot's period is at least 40 ms. What is not known is never far.
    impl[T: OutputPin + Send, E: EchoTimer + Send, const N: usize] SonarRing<T, E, N> {
        slot 3;
        wcet 600 us;
        endless;
        data {
            /// Where the robot is. With it, a sonar that hears nothing is found out while the robot
            /// turns.
            in pose: Pose optional within 100 ms;
            /// The range of each sonar, how old it is, and whether it is known.
            out ranges: Ranges;
        }
        flags {
            /// A sonar does not answer, or hears nothing where others do.
            out faulty;
        }
        params {
            /// Ranges are the median of three pings, but what is nearer than that is believed at
            /// once.
            median: bool = false;
            /// Temperature of the air, in °C: sound is 0.17 % faster with each degree.
            air_c: f32 = 20.0, -20.0..=50.0;
        }
    }
}

/// The windows in which sonars ping that look there: no two that hear each other in one.
pub const fn firing_windows<const N: usize>(bearings: &[Bearing; N]) -> [u8; N] {
    let mut windows = [0; N];
    let mut sonar = 0;
    while sonar < N {
        let mut earlier = 0;
        // A window that is taken gives way to the next, which may be taken by one that was looked
        // at before.
        while earlier < sonar {
            let apart = bearings[sonar].eighths_to(bearings[earlier]);
            if apart <= HEARS_EIGHTHS && windows[earlier] == windows[sonar] {
                windows[sonar] += 1;
                earlier = 0;
            } else {
                earlier += 1;
            }
        }
        sonar += 1;
    }
    windows
}

/// How answers are taken.
#[derive(Clone, Copy, Debug)]
struct Hearing {
    /// By the median of three.
    median: bool,
    sound: Sound,
}

/// A sonar, and what it said.
#[derive(Debug)]
struct Channel<T, E> {
    sonar: Sonar<T, E>,
    bearing: Bearing,
    window: u8,
    /// 0 while it is not known.
    range_m: f32,
    /// Time since the ping that the range is from.
    age_us: u32,
    /// The bits of the answers before the newest one, in metres; 0 where there were none.
    earlier: [u32; EARLIER],
    /// Answers in a row that nothing is in range.
    empty: u8,
    /// Pings in a row without an answer.
    silent: u8,
    /// The last answer was something at its nose.
    at_nose: bool,
    /// How often others contradicted it, and in which direction the last time.
    contradicted: u8,
    contradicted_at: usize,
}

impl<T: OutputPin, E: EchoTimer> Channel<T, E> {
    fn forget(&mut self) {
        self.range_m = 0.0;
        self.age_us = u32::MAX;
        self.earlier = [0; EARLIER];
        self.empty = 0;
    }

    /// Remembers an answer: so far nothing is in the way. Returns what the range is by it: with the
    /// median no farther than the farther one of the two answers before, which is the median of
    /// three unless the newest is the nearest.
    fn remember(&mut self, range_m: f32, median: bool) -> f32 {
        // Ranges are not negative, and so have the order of their bits.
        let range = range_m.to_bits();
        let [last, before] = self.earlier;
        self.earlier = [range, last];
        let most = if median { last.max(before) } else { range };
        f32::from_bits(range.min(most))
    }

    /// Others contradict it, in this direction if they do. Again in the same one counts once.
    fn contradict(&mut self, direction: Option<usize>) {
        if let Some(direction) = direction
            && (self.contradicted == 0 || self.contradicted_at != direction)
        {
            self.contradicted = self.contradicted.saturating_add(1);
            self.contradicted_at = direction;
        }
    }

    fn is_dead(&self) -> bool {
        self.silent >= DEAD_AFTER
    }

    fn is_deaf(&self) -> bool {
        self.contradicted >= DEAF_AFTER
    }

    /// Takes the answer to the ping of `age_us` ago. `heard` is what all have heard from here, if
    /// the robot knows where that is; `bit` is this sonar's among them.
    fn collect(&mut self, age_us: u32, bit: u8, hearing: Hearing, heard: Option<&mut Heard>) {
        match self.sonar.answer(hearing.sound) {
            Answer::Echo { range_m } => {
                self.range_m = self.remember(range_m.min(Ranges::FAR_M), hearing.median);
                self.age_us = age_us;
                (self.silent, self.empty) = (0, 0);
                let at_nose = FINDS_BLIND && range_m < NOSE_M;
                if at_nose != self.at_nose || !at_nose {
                    self.contradicted = 0;
                }
                self.at_nose = at_nose;
                let Some(heard) = heard else {
                    return;
                };
                if at_nose {
                    let contradiction = heard.clear_to_others(self.bearing, bit);
                    self.contradict(contradiction);
                } else if range_m < CERTAIN_M {
                    heard.note(self.bearing, bit);
                }
                if FINDS_BLIND && range_m > CLEAR_M {
                    heard.note_clear(self.bearing, bit);
                }
            }
            Answer::NothingInRange => {
                self.silent = 0;
                if self.at_nose {
                    (self.at_nose, self.contradicted) = (false, 0);
                }
                self.empty = self.empty.saturating_add(1);
                let range_m = self.remember(Ranges::FAR_M, hearing.median);
                if self.empty >= EMPTY_BELIEVED_AFTER {
                    self.range_m = range_m;
                    self.age_us = age_us;
                }
                let contradiction = heard.and_then(|heard| heard.by_others(self.bearing, bit));
                self.contradict(contradiction);
            }
            Answer::None => {
                self.silent = self.silent.saturating_add(1);
                if self.silent >= UNKNOWN_AFTER {
                    self.forget();
                }
            }
        }
    }
}

/// Which sonars have heard something near in which direction, from the place where the robot is.
#[derive(Debug)]
struct Heard {
    /// Counter-clockwise from the x axis of the pose. Bit *i* is sonar *i*.
    by: [u8; DIRECTIONS],
    /// The same for those that have heard that nothing is near.
    clear: [[u8; DIRECTIONS]; CLEAR_MAPS],
    place: Pose,
    /// Where the robot looks now, in directions.
    heading: usize,
    age_us: u32,
}

impl Heard {
    const NOTHING: Self = Self {
        by: [0; DIRECTIONS],
        clear: [[0; DIRECTIONS]; CLEAR_MAPS],
        place: Pose::START,
        heading: 0,
        age_us: u32::MAX,
    };

    /// The robot is there now.
    fn go_on(&mut self, pose: &Pose, passed_us: u32) {
        let (x_m, y_m) = (pose.x_m - self.place.x_m, pose.y_m - self.place.y_m);
        self.age_us = self.age_us.saturating_add(passed_us);
        let elsewhere = x_m * x_m + y_m * y_m > PLACE_M * PLACE_M;
        if elsewhere || self.age_us > REMEMBERED_US {
            *self = Self {
                place: *pose,
                age_us: 0,
                ..Self::NOTHING
            };
        }
        // Headings lie within half a turn to each side; the cast cuts, so all of them are made
        // positive before.
        let turns = pose.heading_rad / TAU + 1.5;
        self.heading = (turns * DIRECTIONS as f32) as usize;
    }

    /// Where a sonar looks.
    fn direction(&self, bearing: Bearing) -> usize {
        (self.heading + bearing as usize * (DIRECTIONS / Bearing::COUNT)) % DIRECTIONS
    }

    fn note(&mut self, bearing: Bearing, bit: u8) {
        self.by[self.direction(bearing)] |= bit;
    }

    fn note_clear(&mut self, bearing: Bearing, bit: u8) {
        let direction = self.direction(bearing);
        for clear in &mut self.clear {
            clear[direction] |= bit;
        }
    }

    /// The direction, if others than this sonar have heard that nothing is near there, nor to both
    /// sides of it.
    fn clear_to_others(&self, bearing: Bearing, bit: u8) -> Option<usize> {
        let direction = self.direction(bearing);
        let known = |clear| known_to_others(clear, direction, bit);
        self.clear.iter().any(known).then_some(direction)
    }

    /// The direction, if others than this sonar have heard something there and to both sides of it:
    /// not only an edge.
    fn by_others(&self, bearing: Bearing, bit: u8) -> Option<usize> {
        let direction = self.direction(bearing);
        known_to_others(&self.by, direction, bit).then_some(direction)
    }
}

/// Whether others than the sonar of this bit know something of a direction, and of those to both
/// sides of it.
fn known_to_others(known: &[u8; DIRECTIONS], direction: usize, bit: u8) -> bool {
    [DIRECTIONS - 1, 0, 1]
        .into_iter()
        .all(|side| known[(direction + side) % DIRECTIONS] & !bit != 0)
}

impl<T: OutputPin, E: EchoTimer, const N: usize> SonarRing<T, E, N> {
    /// Sonars on these pins, which look there.
    pub fn new(triggers: [T; N], echo_timers: [E; N], bearings: [Bearing; N]) -> Self {
        const { assert!(N <= MAX_SONARS, "more sonars than ranges have room for") };
        let windows = firing_windows(&bearings);
        let mut parts = triggers.into_iter().zip(echo_timers);
        let mut places = bearings.into_iter().zip(windows);
        let channels = array::from_fn(|_| {
            let ((trigger, echo_timer), (bearing, window)) =
                parts.next().zip(places.next()).expect("each has N of them");
            Channel {
                sonar: Sonar::new(trigger, echo_timer),
                bearing,
                window,
                range_m: 0.0,
                age_us: u32::MAX,
                earlier: [0; EARLIER],
                empty: 0,
                silent: 0,
                at_nose: false,
                contradicted: 0,
                contradicted_at: 0,
            }
        });
        let last = windows.into_iter().fold(0, u8::max);
        Self {
            channels,
            windows: FEWEST_WINDOWS.max(last + 1),
            window: 0,
            asked: 0,
            heard: Heard::NOTHING,
        }
    }

    fn collect(&mut self, pose: Option<&Pose>, period_us: u32, hearing: Hearing) {
        let mut heard = pose.map(|pose| {
            self.heard.go_on(pose, period_us);
            &mut self.heard
        });
        let mut bit = 1;
        for channel in &mut self.channels {
            channel.age_us = channel.age_us.saturating_add(period_us);
            if self.asked > 0 && channel.window == self.window {
                channel.collect(period_us, bit, hearing, heard.as_deref_mut());
            }
            bit <<= 1;
        }
    }

    fn ping(&mut self) {
        for channel in &mut self.channels {
            if channel.window == self.window {
                // A ping that cannot be sent has no answer, and so says what is wrong by itself.
                let _ = channel.sonar.ping();
            }
        }
    }

    fn ranges(&self) -> Ranges {
        const US_PER_MS: u32 = 1_000;
        let mut ranges = Ranges {
            sonars: N as u8,
            ..Ranges::NONE
        };
        let rows = (ranges.range_m.iter_mut().zip(&mut ranges.age_ms)).zip(&mut ranges.bearings);
        let mut bit = 1;
        for (channel, ((range_m, age_ms), bearing)) in self.channels.iter().zip(rows) {
            *bearing = channel.bearing;
            if channel.is_dead() {
                ranges.dead |= bit;
            } else if channel.is_deaf() {
                ranges.deaf |= bit;
            } else {
                *range_m = channel.range_m;
                *age_ms = (channel.age_us / US_PER_MS).min(Ranges::NEVER_MS.into()) as u16;
            }
            bit <<= 1;
        }
        ranges
    }
}

impl<T: OutputPin + Send, E: EchoTimer + Send, const N: usize> Task for SonarRing<T, E, N> {
    fn reset(&mut self) {
        for channel in &mut self.channels {
            (channel.silent, channel.contradicted) = (0, 0);
        }
    }

    // What was seen before is old, by nobody knows how much. What is broken is not mended by that.
    fn enter(&mut self) {
        self.asked = 0;
        self.heard = Heard::NOTHING;
        for channel in &mut self.channels {
            channel.forget();
        }
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let pose = io.try_read(Self::POSE).copied();
        let hearing = Hearing {
            median: io.param(Self::MEDIAN),
            sound: Sound::at(io.param(Self::AIR_C)),
        };
        self.collect(pose.as_ref(), io.period_us(), hearing);
        // Nobody shall act on half a picture: each sonar has been asked twice, so that the second
        // can bear out the first.
        if self.asked >= 2 * self.windows {
            let ranges = self.ranges();
            io.set(Self::FAULTY, ranges.dead | ranges.deaf != 0);
            *io.write(Self::RANGES) = ranges;
        }
        self.window = (self.window + 1) % self.windows;
        self.ping();
        self.asked = self.asked.saturating_add(1);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::TaskBench;
    use crate::body::{EchoCapture, PinImage, SONARS, Sensors, TriggerPin};

    type Ring<'a> = SonarRing<TriggerPin<'a>, EchoCapture<'a>>;

    /// The echo pin's time where a sonar has waited in vain.
    const EMPTY_US: u16 = 38_000;

    /// A ring on a bench, and all that it has seen so far answered in the same way.
    struct Rig<'a> {
        pins: &'a PinImage,
        bench: TaskBench<'a>,
    }

    impl<'a> Rig<'a> {
        fn new(pins: &'a PinImage) -> Self {
            let parts = pins.parts();
            let ring = SonarRing::new(parts.sonar_triggers, parts.echo_timers, Bearing::ALL);
            let mut bench = TaskBench::new(ring);
            bench.period_us(40_000).param(Ring::AIR_C, 20.0);
            Self { pins, bench }
        }

        /// Each sonar is asked once more, and answers with these times.
        fn round(&mut self, echo_us: [u16; SONARS]) -> &mut Self {
            self.pins.set_sensors(&Sensors {
                echo_us,
                ..Sensors::default()
            });
            self.bench.step();
            self.bench.step();
            self
        }

        fn look_from(&mut self, heading_rad: f32) -> &mut Self {
            let pose = Pose {
                heading_rad,
                ..Pose::START
            };
            self.bench.give(Ring::POSE, pose);
            self
        }

        fn ranges(&mut self) -> Ranges {
            self.bench.output(Ring::RANGES).expect("a picture")
        }
    }

    /// All with this answer, but for the one ahead.
    fn ahead(ahead_us: u16, others_us: u16) -> [u16; SONARS] {
        array::from_fn(|sonar| if sonar == 0 { ahead_us } else { others_us })
    }

    #[test]
    fn no_two_that_hear_each_other_ping_in_one_window() {
        assert_eq!(RING_WINDOWS, [0, 1, 0, 1, 0, 1, 0, 1]);
        // Any four sonars, wherever they look.
        let any = |number: usize| array::from_fn(|sonar| Bearing::ALL[number >> (3 * sonar) & 7]);
        for bearings in (0..1 << 12).map(any) {
            let windows: [u8; 4] = firing_windows(&bearings);
            for (a, b) in (0..4).flat_map(|a| (0..a).map(move |b| (a, b))) {
                let hears = bearings[a].eighths_to(bearings[b]) <= HEARS_EIGHTHS;
                assert!(
                    !hears || windows[a] != windows[b],
                    "{bearings:?} {windows:?}"
                );
            }
        }
    }

    #[test]
    fn neighbours_ping_in_turns_and_the_first_picture_is_a_whole_one() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        pins.set_sensors(&Sensors {
            echo_us: [5_828; SONARS],
            ..Sensors::default()
        });
        for (step, triggers) in [0b1010_1010, 0b0101_0101]
            .into_iter()
            .cycle()
            .take(8)
            .enumerate()
        {
            rig.bench.step();
            assert_eq!(pins.take_actuators().sonar_triggers, triggers);
            assert_eq!(rig.bench.output(Ring::RANGES).is_some(), step >= 4);
        }
        let ranges = rig.ranges();
        assert_eq!(ranges.readings().count(), SONARS);
        for reading in ranges.readings() {
            let range_m = reading.range_m.unwrap();
            assert!((range_m - 1.0).abs() < 1e-3, "{reading:?}");
            assert!([40, 80].contains(&reading.age_ms), "{reading:?}");
        }
        assert!(!rig.bench.flag(Ring::FAULTY));
    }

    #[test]
    fn one_missed_echo_is_not_believed_and_two_are() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.round([2_914; SONARS]).round([2_914; SONARS]);
        // A range, and its age where the sonar ahead has been asked just now.
        for (echo_us, expected_m, age_ms) in [
            (2_914, 0.5, 80),
            (EMPTY_US, 0.5, 160),
            (2_914, 0.5, 80),
            (EMPTY_US, 0.5, 160),
            (EMPTY_US, 4.0, 80),
            (EMPTY_US, 4.0, 80),
            (2_914, 0.5, 80),
        ] {
            let ranges = rig.round([echo_us; SONARS]).ranges();
            let reading = ranges.readings().next().unwrap();
            let seen_m = reading.range_m.unwrap();
            assert!((seen_m - expected_m).abs() < 1e-3, "{echo_us}: {seen_m}");
            assert!(reading.age_ms.abs_diff(age_ms) <= 40, "{reading:?}");
        }
        assert!(!rig.bench.flag(Ring::FAULTY));
    }

    #[test]
    fn with_the_median_what_is_nearer_is_believed_at_once_and_what_is_farther_at_the_second_ping() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.bench.param(Ring::MEDIAN, true);
        // What it reads, and what that becomes.
        for (echo_us, expected_m) in [
            (2_914, None),
            (2_914, None),
            (2_914, Some(0.5)),
            // A false long one, or none at all.
            (11_655, Some(0.5)),
            (2_914, Some(0.5)),
            (2_914, Some(0.5)),
            (EMPTY_US, Some(0.5)),
            (2_914, Some(0.5)),
            (EMPTY_US, Some(0.5)),
            (2_914, Some(0.5)),
            // A false short one is gone with the next ping.
            (583, Some(0.1)),
            (2_914, Some(0.5)),
            // Somebody steps in, and away again.
            (1_166, Some(0.2)),
            (1_166, Some(0.2)),
            (EMPTY_US, Some(0.2)),
            (EMPTY_US, Some(4.0)),
        ] {
            rig.round([echo_us; SONARS]);
            let reading = (rig.bench.output(Ring::RANGES)).map(|ranges| {
                let reading = ranges.readings().next().unwrap();
                reading.range_m.unwrap()
            });
            match (reading, expected_m) {
                (Some(range_m), Some(expected_m)) => {
                    assert!((range_m - expected_m).abs() < 1e-3, "{echo_us}: {range_m}");
                }
                _ => assert_eq!(reading, expected_m, "{echo_us}"),
            }
        }
    }

    #[test]
    fn the_same_echo_is_from_nearer_in_cold_air() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        for (air_c, expected_m) in [(20.0, 1.0), (0.0, 0.9653), (40.0, 1.0335)] {
            rig.bench.param(Ring::AIR_C, air_c);
            rig.round([5_828; SONARS]).round([5_828; SONARS]);
            let range_m = rig.round([5_828; SONARS]).ranges().ahead_m();
            assert!((range_m - expected_m).abs() < 1e-3, "{air_c}: {range_m}");
        }
    }

    #[test]
    fn a_sonar_that_does_not_answer_is_unknown_and_then_dead() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.round([2_914; SONARS]).round([2_914; SONARS]);
        rig.round([2_914; SONARS]);
        // Pings without an answer; whether its range is known, whether it is dead.
        for (silent, known, dead) in [
            (1, true, false),
            (2, false, false),
            (3, false, true),
            (4, false, true),
        ] {
            let ranges = rig.round(ahead(0, EMPTY_US)).ranges();
            let reading = ranges.readings().next().unwrap();
            assert_eq!(reading.range_m.is_some(), known, "{silent}");
            assert_eq!(reading.dead, dead, "{silent}");
            assert_eq!(rig.bench.flag(Ring::FAULTY), dead, "{silent}");
            assert_eq!(ranges.dead, u8::from(dead), "{silent}");
        }
        // No sonar at all, and what was known is old: entered anew, it knows nothing.
        rig.bench.enter_anew();
        let silent = [0; SONARS];
        let ranges = rig
            .round(silent)
            .round(silent)
            .round(silent)
            .round(silent)
            .ranges();
        assert_eq!(ranges.nearest_m(), 0.0);
        assert_eq!(ranges.dead, 0xFF);
        // It answers again.
        let ranges = rig.round([2_914; SONARS]).round([2_914; SONARS]).ranges();
        assert!((ranges.ahead_m() - 0.5).abs() < 1e-3);
        assert!(!rig.bench.flag(Ring::FAULTY));
    }

    #[test]
    fn a_sonar_that_never_answered_is_not_far() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        let mut round = || rig.round(ahead(0, EMPTY_US)).bench.output(Ring::RANGES);
        let first = (0..10).find_map(|_| round()).unwrap();
        assert_eq!((first.ahead_m(), first.left_m()), (0.0, Ranges::FAR_M));
    }

    /// A robot in the middle of a round room turns on the spot. Its sonar ahead hears nothing.
    #[test]
    fn a_sonar_that_hears_nothing_where_others_do_is_deaf() {
        let pins = PinImage::new();
        for (room_us, others_hear) in [(2_914, true), (EMPTY_US, false)] {
            let mut rig = Rig::new(&pins);
            let mut turned = Vec::new();
            for step in 0..20 {
                let heading_rad = step as f32 * 0.1;
                rig.look_from(heading_rad).round(ahead(EMPTY_US, room_us));
                if rig.bench.flag(Ring::FAULTY) {
                    turned.push(heading_rad);
                }
            }
            assert_eq!(!turned.is_empty(), others_hear, "{room_us}: {turned:?}");
            assert_eq!(rig.ranges().deaf, u8::from(others_hear));
            if others_hear {
                // Within a third of a turn, and then its range is unknown.
                assert!(turned[0] < 2.0, "{turned:?}");
                assert_eq!(rig.ranges().ahead_m(), 0.0);
                // One echo, and it hears.
                let ranges = rig.round([2_914; SONARS]).ranges();
                assert!((ranges.ahead_m() - 0.5).abs() < 1e-3);
                assert!(!rig.bench.flag(Ring::FAULTY));
            }
        }
    }

    /// A robot that stands, or drives past things, has no reason to doubt a sonar that sees
    /// nothing.
    #[test]
    fn a_sonar_that_sees_something_at_its_nose_where_others_see_none_is_told() {
        /// From 3 cm: its own burst.
        const BLIND_US: u16 = 175;
        let pins = PinImage::new();
        // What the others see, half a metre away or at their noses too; whether it is told.
        for (others_us, told) in [(2_914, FINDS_BLIND), (BLIND_US, false), (EMPTY_US, false)] {
            let mut rig = Rig::new(&pins);
            let mut turned = Vec::new();
            for step in 0..20 {
                let heading_rad = step as f32 * 0.1;
                rig.look_from(heading_rad).round(ahead(BLIND_US, others_us));
                if rig.bench.flag(Ring::FAULTY) {
                    turned.push(heading_rad);
                }
            }
            assert_eq!(!turned.is_empty(), told, "{others_us}: {turned:?}");
            assert_eq!(rig.ranges().deaf, u8::from(told));
            if told {
                assert!(turned[0] < 2.0, "{turned:?}");
                assert_eq!(rig.ranges().ahead_m(), 0.0);
                // One range that is another, and it sees.
                let ranges = rig.round([2_914; SONARS]).ranges();
                assert!((ranges.ahead_m() - 0.5).abs() < 1e-3);
                assert!(!rig.bench.flag(Ring::FAULTY));
            }
        }
        // A robot that stands turns nobody's eyes to where it looks.
        let mut rig = Rig::new(&pins);
        for _ in 0..200 {
            rig.look_from(0.0).round(ahead(BLIND_US, 2_914));
            assert!(!rig.bench.flag(Ring::FAULTY));
        }
    }

    #[test]
    fn a_free_way_is_not_taken_for_a_deaf_sonar() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        for step in 0..200 {
            let pose = Pose {
                x_m: step as f32 * 0.02,
                heading_rad: 0.1 * (step % 3) as f32,
                ..Pose::START
            };
            rig.bench.give(Ring::POSE, pose);
            rig.round(ahead(EMPTY_US, 2_914));
            assert!(!rig.bench.flag(Ring::FAULTY), "{step}");
        }
        for step in 0..200 {
            rig.look_from(0.1 * (step % 3) as f32);
            rig.round(ahead(EMPTY_US, 2_914));
            assert!(!rig.bench.flag(Ring::FAULTY), "{step}");
        }
    }

    #[test]
    fn a_robot_may_have_two_sonars() {
        type Two<'a> = SonarRing<TriggerPin<'a>, EchoCapture<'a>, 2>;
        let pins = PinImage::new();
        let parts = pins.parts();
        let [trigger_0, trigger_1, ..] = parts.sonar_triggers;
        let [echo_0, echo_1, ..] = parts.echo_timers;
        let mut bench = TaskBench::new(Two::new(
            [trigger_0, trigger_1],
            [echo_0, echo_1],
            [Bearing::Ahead, Bearing::Behind],
        ));
        bench.param(Two::AIR_C, 20.0);
        let mut sensors = Sensors::default();
        (sensors.echo_us[0], sensors.echo_us[1]) = (5_828, EMPTY_US);
        pins.set_sensors(&sensors);
        for triggers in [0b00, 0b11, 0b00, 0b11, 0b00, 0b11] {
            bench.step();
            assert_eq!(pins.take_actuators().sonar_triggers, triggers);
        }
        let ranges = bench.output(Two::RANGES).unwrap();
        assert_eq!(ranges.readings().count(), 2);
        assert!((ranges.ahead_m() - 1.0).abs() < 1e-3, "{ranges:?}");
        assert_eq!(ranges.behind_m(), Ranges::FAR_M);
        assert_eq!(ranges.left_m(), 0.0, "nobody looks there");
        assert_eq!(ranges.nearest_m(), ranges.ahead_m());
    }
}
