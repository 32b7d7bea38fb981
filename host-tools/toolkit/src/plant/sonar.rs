//! The ring of sonars: what their echo pins do after a trigger, and what breaks.

use core::f64::consts::TAU;
use core::fmt;
use core::str::FromStr;

use rt_firmware::body::{ARRAY_BANKS, Actuators, SONARS};
use rt_firmware::tasks::ARRAY_SONARS;

use crate::world::Point;

use super::noise::{Noise, Source};
use super::obstacles::Obstacles;
use super::parameters::SonarParameters;
use super::pose::BodyPose;
use super::recorded::Feed;

/// Speed of sound at 20 °C.
const SOUND_M_PER_S: f64 = 343.2;

/// 20 °C and 0 °C in kelvin.
const ROOM_K: f64 = 293.15;
const ZERO_C_K: f64 = 273.15;

/// Time from a trigger to the rising edge of the echo pin, in microseconds: eight periods of the
/// burst of 40 kHz, and as much again to get ready.
const BURST_US: u64 = 400;

/// How long the echo pin stays high where nothing is heard, in microseconds: what the data sheet of
/// the HC-SR04 says.
pub const PATIENCE_US: u64 = 38_000;

/// The longest echo that a sonar hears, in microseconds: from a little more than 4 m.
const LONGEST_ECHO_US: u64 = 24_000;

/// Echo time of a blind sonar, in microseconds: it hears its own burst, from 3 cm.
const BLIND_ECHO_US: u64 = 175;

/// The part of its pings to which a noisy sonar hears something else.
const STRAY_PROBABILITY: f64 = 0.1;

/// Rays that stand for one beam.
const RAYS: u8 = 7;

/// What can break in a sonar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SonarFault {
    /// Its echo pin stays low, whatever is asked.
    Dead,
    /// It sends, but its receiver hears nothing: it waits in vain, each time.
    Deaf,
    /// It hears its own burst, each time, and so sees something at its nose.
    Blind,
    /// One ping in ten brings an echo that is not of what is before it: of another sonar's burst,
    /// or of its own one before (Borenstein and Koren, "Error eliminating rapid ultrasonic firing
    /// for mobile robot obstacle avoidance", IEEE Trans. Robotics and Automation 11(1), 1995,
    /// section II). It may be from anywhere in its reach, nearer or farther.
    Noisy,
}

impl SonarFault {
    /// All of them, with their names.
    pub const NAMES: [(Self, &'static str); 4] = [
        (Self::Dead, "dead"),
        (Self::Deaf, "deaf"),
        (Self::Blind, "blind"),
        (Self::Noisy, "noisy"),
    ];
}

impl fmt::Display for SonarFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::NAMES.iter().find(|(fault, _)| fault == self);
        f.write_str(name.map_or("", |(_, name)| name))
    }
}

impl FromStr for SonarFault {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let found = Self::NAMES.iter().find(|(_, name)| *name == text);
        found.map(|(fault, _)| *fault).ok_or(())
    }
}

/// One sonar.
#[derive(Clone, Copy, Debug, Default)]
struct Sonar {
    /// The pulse that answers its last trigger, if it does.
    pulse: Option<TimedPulse>,
    pings: u64,
    fault: Option<SonarFault>,
}

impl Sonar {
    /// Sends a ping towards `heading_rad` off the body's heading, unless the pulse of the last one
    /// is not over.
    fn ping(
        &mut self,
        parameters: &SonarParameters,
        feed: &mut Option<Feed>,
        index: u8,
        heading_rad: f64,
        place: &Place<'_>,
    ) {
        let now_us = place.now_us;
        if self.pulse.is_some_and(|pulse| pulse.falls_at_us > now_us) {
            return;
        }
        let answer_us = match feed {
            Some(feed) => (feed.ping(index.into(), now_us)).map(recorded_us),
            None => {
                let heard_us = parameters.echo_us(index, heading_rad, self.pings, place);
                Some(heard_us.unwrap_or(PATIENCE_US))
            }
        };
        let ping = self.pings;
        self.pings += 1;
        let width_us = match self.fault {
            None => answer_us,
            Some(SonarFault::Noisy) => parameters.stray_us(index, ping, place).or(answer_us),
            Some(SonarFault::Deaf) => Some(PATIENCE_US),
            Some(SonarFault::Blind) => Some(BLIND_ECHO_US),
            Some(SonarFault::Dead) => None,
        };
        let rises_at_us = now_us + BURST_US;
        self.pulse = width_us.map(|width_us| TimedPulse {
            rises_at_us,
            falls_at_us: rises_at_us + width_us,
        });
    }
}

/// How long the echo pin is high for a recorded range. A sonar that has something at its nose says
/// so with the shortest pulse.
fn recorded_us(range_m: f64) -> u64 {
    let echo_us = libm::round(2e6 * range_m / SOUND_M_PER_S) as u64;
    echo_us.clamp(1, PATIENCE_US)
}

/// A pulse on an echo pin, seen from now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pulse {
    /// When it rises, in microseconds from now; 0 where it is high already.
    pub rises_in_us: u16,
    /// How long it is high in all, in microseconds.
    pub width_us: u16,
}

/// A pulse on an echo pin.
#[derive(Clone, Copy, Debug)]
struct TimedPulse {
    rises_at_us: u64,
    falls_at_us: u64,
}

/// All sonars: the ring, counter-clockwise from the one that looks ahead, evenly spread; and the
/// array, counter-clockwise from the one that looks behind, evenly spread.
///
/// Sonar *i* of each bank of the array, and of the ring, share an echo pin.
#[derive(Clone, Debug)]
pub(super) struct Sonars {
    parameters: SonarParameters,
    ring: [Sonar; SONARS],
    array: [Sonar; ARRAY_SONARS],
    /// The bank of the array that was triggered last; none where the ring was.
    bank: Option<usize>,
    /// What they measure instead of the world.
    feed: Option<Feed>,
}

/// Where a ping is sent.
struct Place<'a> {
    now_us: u64,
    pose: BodyPose,
    obstacles: &'a Obstacles,
    noise: &'a Noise,
}

impl Sonars {
    pub fn new(parameters: SonarParameters) -> Self {
        Self {
            parameters,
            ring: [Sonar::default(); SONARS],
            array: [Sonar::default(); ARRAY_SONARS],
            bank: None,
            feed: None,
        }
    }

    /// From the next trigger on this sonar of the ring has this fault. There is no other sonar to
    /// have it.
    pub fn break_sonar(&mut self, sonar: usize, fault: SonarFault) {
        if let Some(sonar) = self.ring.get_mut(sonar) {
            sonar.fault = Some(fault);
        }
    }

    /// From now on they measure what was recorded.
    pub fn measure_from(&mut self, feed: Feed) {
        self.feed = Some(feed);
    }

    /// When what was recorded ends, in microseconds; none before its last row is over.
    pub fn recorded_end_us(&self) -> Option<u64> {
        self.feed.as_ref().and_then(Feed::end_us)
    }

    /// Sends a ping from each sonar that is triggered. A sonar whose pulse is not over ignores it.
    pub fn trigger(
        &mut self,
        actuators: &Actuators,
        now_us: u64,
        pose: BodyPose,
        obstacles: &Obstacles,
        noise: &Noise,
    ) {
        let place = Place {
            now_us,
            pose,
            obstacles,
            noise,
        };
        let Self {
            parameters, feed, ..
        } = self;
        for (index, sonar) in (0..).zip(&mut self.ring) {
            if actuators.sonar_triggers >> index & 1 != 0 {
                let heading_rad = f64::from(index) * TAU / SONARS as f64;
                sonar.ping(parameters, feed, index, heading_rad, &place);
                self.bank = None;
            }
        }
        for bank in 0..ARRAY_BANKS {
            if actuators.array_triggers >> bank & 1 == 0 {
                continue;
            }
            for (index, sonar) in (0..).zip(&mut self.array).skip(bank * SONARS).take(SONARS) {
                let turns = f64::from(index) / ARRAY_SONARS as f64 - 0.5;
                sonar.ping(parameters, feed, index, turns * TAU, &place);
            }
            self.bank = Some(bank);
        }
    }

    /// The sonars that answer on the echo pins.
    fn heard(&self) -> [Sonar; SONARS] {
        let bank = self
            .bank
            .and_then(|bank| self.array.chunks_exact(SONARS).nth(bank));
        bank.and_then(|bank| bank.try_into().ok())
            .unwrap_or(self.ring)
    }

    /// The pulses that answer the last triggers, and are not over at `now_us`.
    pub fn pulses(&self, now_us: u64) -> [Option<Pulse>; SONARS] {
        self.heard().map(|sonar| {
            let pulse = sonar.pulse.filter(|pulse| pulse.falls_at_us > now_us)?;
            // Neither is ever as long as 16 bits can hold.
            Some(Pulse {
                rises_in_us: pulse.rises_at_us.saturating_sub(now_us) as u16,
                width_us: (pulse.falls_at_us - pulse.rises_at_us) as u16,
            })
        })
    }

    /// What the timers at the echo pins show at `now_us`: how long each has been high since its
    /// last trigger, in microseconds, and a bit for each that is.
    pub fn echoes(&self, now_us: u64) -> ([u16; SONARS], u8) {
        let pulses = self.heard().map(|sonar| sonar.pulse);
        // A pulse is never as long as 16 bits can hold.
        let width_us = |pulse: TimedPulse| {
            let until_us = now_us.min(pulse.falls_at_us);
            until_us.saturating_sub(pulse.rises_at_us) as u16
        };
        let is_high = |pulse: TimedPulse| (pulse.rises_at_us..pulse.falls_at_us).contains(&now_us);
        let high = (pulses.iter().rev()).fold(0, |bits, pulse| {
            bits << 1 | u8::from(pulse.is_some_and(is_high))
        });
        (pulses.map(|pulse| pulse.map_or(0, width_us)), high)
    }
}

impl SonarParameters {
    /// Time to the echo of a ping that is sent now, if one will be heard.
    fn echo_us(&self, sonar: u8, heading_rad: f64, ping: u64, place: &Place<'_>) -> Option<u64> {
        let Place {
            pose,
            obstacles,
            noise,
            ..
        } = place;
        if noise.uniform(Source::Miss { sonar }, ping) < self.miss_probability {
            return None;
        }
        let heading_rad = pose.heading_rad + heading_rad;
        let true_range_m = self.range_m(pose.position, heading_rad, obstacles)?;
        let deviation_m = self.noise_m + self.noise_part * true_range_m;
        let range_m = true_range_m + deviation_m * noise.bell(Source::Range { sonar }, ping);
        let echo_us = (2e6 * range_m.max(self.min_range_m) / self.sound_m_per_s()) as u64;
        (echo_us < LONGEST_ECHO_US).then_some(echo_us)
    }

    /// How fast sound is: it grows with the root of the absolute temperature, as in an ideal gas.
    fn sound_m_per_s(&self) -> f64 {
        SOUND_M_PER_S * libm::sqrt((self.air_c + ZERO_C_K) / ROOM_K)
    }

    /// Time to an echo of something else, if a noisy sonar hears one to this ping.
    fn stray_us(&self, sonar: u8, ping: u64, place: &Place<'_>) -> Option<u64> {
        let draw = |index| place.noise.uniform(Source::Stray { sonar }, index);
        if draw(2 * ping) >= STRAY_PROBABILITY {
            return None;
        }
        let reach_m = self.max_range_m - self.min_range_m;
        let range_m = self.min_range_m + reach_m * draw(2 * ping + 1);
        Some((2e6 * range_m / self.sound_m_per_s()) as u64)
    }

    /// The nearest wall or person in the beam, in metres from the rim.
    fn range_m(&self, centre: Point, heading_rad: f64, obstacles: &Obstacles) -> Option<f64> {
        let (sin, cos) = libm::sincos(heading_rad);
        let rim = Point::new(centre.x_m + self.rim_m * cos, centre.y_m + self.rim_m * sin);
        let ray_step_rad = 2.0 * self.half_beam_rad / f64::from(RAYS - 1);
        (0..RAYS)
            .filter_map(|ray| {
                let angle_rad = heading_rad - self.half_beam_rad + f64::from(ray) * ray_step_rad;
                let (sin, cos) = libm::sincos(angle_rad);
                self.ray_range_m(rim, Point::new(cos, sin), obstacles)
            })
            .reduce(f64::min)
    }

    /// How far a ray goes before a wall or a person sends it back; `None` if none does. One rule
    /// of incidence holds for both: what clothes scatter and swallow is left out.
    fn ray_range_m(&self, origin: Point, direction: Point, obstacles: &Obstacles) -> Option<f64> {
        (obstacles.hit_by_ray(origin, direction))
            .filter(|hit| hit.incidence_cos >= self.min_incidence_cos)
            .map(|hit| hit.distance_m)
            .filter(|distance_m| *distance_m <= self.max_range_m)
    }
}
