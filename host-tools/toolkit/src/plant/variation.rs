//! What is around a robot, varied with the seed: when people step in and away, and a sonar that
//! dies.
//!
//! A mission that does well in one world may do so by luck: the person came when the robot was
//! elsewhere. So a mission is judged over many seeds, and each seed has other times.

use crate::world::{Person, World};

use super::noise::{Noise, Source};

/// The most by which a time of a person is shifted, earlier or later, in microseconds.
pub const SHIFT_US: u64 = 2_000_000;

/// The part of the seeds in which a sonar dies.
pub const DEAD_SONAR_PART: f64 = 0.1;

/// When it dies at the latest, in microseconds.
pub const DEAD_SONAR_BY_US: u64 = 30_000_000;

/// People step in and away at whole milliseconds.
const MS_US: u64 = 1_000;

/// The surroundings that belong to a seed.
#[derive(Clone, Copy, Debug)]
pub struct Variation {
    noise: Noise,
}

impl Variation {
    /// Those of `seed`.
    pub fn new(seed: u64) -> Self {
        Self {
            noise: Noise::new(seed),
        }
    }

    /// The same world with other times: who steps in later than at the start does so up to 2 s
    /// earlier or later, and steps away up to 2 s earlier or later, each by itself. Nobody who was
    /// not there at the start is, and nobody stays away.
    #[must_use]
    pub fn world(&self, world: &World) -> World {
        let people = (0_u16..).zip(&world.people);
        let people = people.map(|(person, as_written)| self.shifted(person, as_written));
        World {
            people: people.collect(),
            ..world.clone()
        }
    }

    fn shifted(&self, index: u16, person: &Person) -> Person {
        let from_us = match person.from_us {
            0 => 0,
            from_us => self.shifted_us(Source::StepIn { person: index }, from_us, MS_US),
        };
        let away = Source::StepAway { person: index };
        let to_us = (person.to_us).map(|to_us| self.shifted_us(away, to_us, from_us + MS_US));
        Person {
            from_us,
            to_us,
            ..*person
        }
    }

    /// A time with its shift, in whole milliseconds, at the earliest `least_us`.
    fn shifted_us(&self, source: Source, time_us: u64, least_us: u64) -> u64 {
        let span_ms = 2 * SHIFT_US / MS_US;
        let later_us = (self.noise.uniform(source, 0) * span_ms as f64) as u64 * MS_US;
        let shifted_us = time_us.saturating_add(later_us).saturating_sub(SHIFT_US);
        shifted_us.max(least_us)
    }

    /// The sonar that dies, of so many, and when, in microseconds of robot time: in one seed of
    /// ten, within the first 30 s.
    pub fn dead_sonar(&self, sonars: usize) -> Option<(usize, u64)> {
        let draw = |index| self.noise.uniform(Source::DeadSonar, index);
        if draw(0) >= DEAD_SONAR_PART {
            return None;
        }
        let sonar = (draw(1) * sonars as f64) as usize;
        let at_ms = draw(2) * (DEAD_SONAR_BY_US / MS_US) as f64;
        Some((sonar, at_ms as u64 * MS_US))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEDS: core::ops::RangeInclusive<u64> = 1..=2_000;

    #[test]
    fn people_step_in_and_away_at_other_times_at_the_same_places() {
        let world = World::parse(
            "world cell\nstart 1,1 0\nwall 0,0 9,0\nperson 3,1 0.2 from 5 s to 6 s\n\
             person 4,1 0.2 to 3 s\nperson 5,1 0.2 from 1 s\nperson 6,1 0.2",
        )
        .unwrap();
        let mut spans = vec![(u64::MAX, 0); 4];
        for seed in SEEDS {
            let varied = Variation::new(seed).world(&world);
            assert_eq!(varied.walls, world.walls);
            for (person, as_written) in varied.people.iter().zip(&world.people) {
                assert_eq!(person.circle, as_written.circle);
                assert_eq!(person.from_us == 0, as_written.from_us == 0);
                assert_eq!(person.to_us.is_none(), as_written.to_us.is_none());
                assert!(person.to_us.is_none_or(|to_us| person.from_us < to_us));
                assert_eq!(person.from_us % MS_US, 0);
            }
            let times = [
                varied.people[0].from_us,
                varied.people[0].to_us.unwrap(),
                varied.people[1].to_us.unwrap(),
                varied.people[2].from_us,
            ];
            for ((least_us, most_us), time_us) in spans.iter_mut().zip(times) {
                (*least_us, *most_us) = ((*least_us).min(time_us), (*most_us).max(time_us));
            }
        }
        // All of the span is used, and it ends where somebody would not come any more.
        for ((least_us, most_us), (from_us, to_us)) in spans.into_iter().zip([
            (3_000_000, 7_000_000),
            (4_000_000, 8_000_000),
            (1_000_000, 5_000_000),
            (MS_US, 3_000_000),
        ]) {
            assert!(
                least_us >= from_us && least_us < from_us + 20_000,
                "{least_us}"
            );
            assert!(most_us < to_us && most_us > to_us - 20_000, "{most_us}");
        }
    }

    #[test]
    fn a_sonar_dies_in_one_seed_of_ten_any_of_them_at_any_time() {
        let dead: Vec<_> = SEEDS
            .filter_map(|seed| Variation::new(seed).dead_sonar(8))
            .collect();
        assert!((150..250).contains(&dead.len()), "{}", dead.len());
        for sonar in 0..8 {
            let times = dead.iter().filter(|(dead, _)| *dead == sonar);
            assert!((10..50).contains(&times.count()), "{sonar}");
        }
        let late = dead
            .iter()
            .filter(|(_, at_us)| *at_us >= DEAD_SONAR_BY_US / 2);
        assert!((60..140).contains(&late.count()));
        assert!(dead.iter().all(|(_, at_us)| *at_us < DEAD_SONAR_BY_US));
    }
}
