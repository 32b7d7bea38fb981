//! The ring of sonars: what a ping brings back, and when.

use core::f64::consts::TAU;

use rt_firmware::body::SONARS;

use crate::world::{Point, Segment};

use super::drive::BodyPose;
use super::noise::{Noise, Source};
use super::parameters::SonarParameters;

/// Speed of sound at 20 °C.
const SOUND_M_PER_S: f64 = 343.2;

/// How long a sonar listens, in microseconds: a little longer than an echo from the farthest range takes.
const LISTEN_US: u64 = 24_000;

/// Rays that stand for one beam.
const RAYS: u8 = 7;

/// One sonar.
#[derive(Clone, Copy, Debug, Default)]
struct Sonar {
    /// What its timer shows: the last finished ping's echo time, 0 for none.
    shown_us: u16,
    in_flight: Option<Ping>,
    pings: u64,
}

/// A ping that was sent and not yet answered.
#[derive(Clone, Copy, Debug)]
struct Ping {
    over_at_us: u64,
    echo_us: u16,
}

/// All sonars, counter-clockwise from the one that looks ahead, evenly spread.
#[derive(Clone, Debug)]
pub(super) struct SonarRing {
    parameters: SonarParameters,
    sonars: [Sonar; SONARS],
}

impl SonarRing {
    pub fn new(parameters: SonarParameters) -> Self {
        Self {
            parameters,
            sonars: [Sonar::default(); SONARS],
        }
    }

    /// Sends a ping from each sonar whose bit is set in `triggers`. A sonar that still listens ignores it.
    pub fn trigger(
        &mut self,
        triggers: u8,
        now_us: u64,
        pose: BodyPose,
        walls: &[Segment],
        noise: &Noise,
    ) {
        self.finish_pings(now_us);
        let parameters = self.parameters;
        for (index, sonar) in (0..).zip(self.sonars.iter_mut()) {
            if triggers & 1 << index == 0 || sonar.in_flight.is_some() {
                continue;
            }
            let echo_us = parameters.echo_us(index, sonar.pings, pose, walls, noise);
            sonar.pings += 1;
            sonar.in_flight = Some(Ping {
                over_at_us: now_us + echo_us.map_or(LISTEN_US, u64::from),
                echo_us: echo_us.unwrap_or(0),
            });
        }
    }

    /// What the echo timers show at `now_us`, in microseconds; 0 for no echo.
    pub fn echo_us(&mut self, now_us: u64) -> [u16; SONARS] {
        self.finish_pings(now_us);
        self.sonars.map(|sonar| sonar.shown_us)
    }

    fn finish_pings(&mut self, now_us: u64) {
        for sonar in &mut self.sonars {
            if let Some(ping) = sonar.in_flight.filter(|ping| ping.over_at_us <= now_us) {
                sonar.shown_us = ping.echo_us;
                sonar.in_flight = None;
            }
        }
    }
}

impl SonarParameters {
    /// Time to the echo of a ping that is sent now, if one will be heard.
    fn echo_us(
        &self,
        sonar: u8,
        ping: u64,
        pose: BodyPose,
        walls: &[Segment],
        noise: &Noise,
    ) -> Option<u16> {
        if noise.uniform(Source::Miss { sonar }, ping) < self.miss_probability {
            return None;
        }
        let heading_rad = pose.heading_rad + f64::from(sonar) * TAU / SONARS as f64;
        let true_range_m = self.range_m(pose.position, heading_rad, walls)?;
        let deviation_m = self.noise_m + self.noise_part * true_range_m;
        let range_m = true_range_m + deviation_m * noise.bell(Source::Range { sonar }, ping);
        let echo_us = 2e6 * range_m.max(self.min_range_m) / SOUND_M_PER_S;
        // Ranges end at a few metres, so the time fits in 16 bits; one that is beyond what is listened for is not heard.
        (echo_us < LISTEN_US as f64).then_some(echo_us as u16)
    }

    /// The nearest wall in the beam, in metres from the rim.
    fn range_m(&self, centre: Point, heading_rad: f64, walls: &[Segment]) -> Option<f64> {
        let (sin, cos) = libm::sincos(heading_rad);
        let rim = Point::new(centre.x_m + self.rim_m * cos, centre.y_m + self.rim_m * sin);
        let ray_step_rad = 2.0 * self.half_beam_rad / f64::from(RAYS - 1);
        (0..RAYS)
            .filter_map(|ray| {
                let angle_rad = heading_rad - self.half_beam_rad + f64::from(ray) * ray_step_rad;
                let (sin, cos) = libm::sincos(angle_rad);
                self.ray_range_m(rim, Point::new(cos, sin), walls)
            })
            .reduce(f64::min)
    }

    /// How far a ray goes before a wall sends it back; `None` if none does.
    fn ray_range_m(&self, origin: Point, direction: Point, walls: &[Segment]) -> Option<f64> {
        walls
            .iter()
            .filter_map(|wall| wall.hit_by_ray(origin, direction))
            .reduce(|a, b| if b.distance_m < a.distance_m { b } else { a })
            .filter(|hit| hit.incidence_cos >= self.min_incidence_cos)
            .map(|hit| hit.distance_m)
            .filter(|distance_m| *distance_m <= self.max_range_m)
    }
}
