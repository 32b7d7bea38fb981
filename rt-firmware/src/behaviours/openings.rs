//! Door openings in a wall that the robot drives past: LANDMARK.
//!
//! Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section
//! 3.2, `LANDMARK`.

use super::beams::BEAM_TANGENT;
use super::corridor::{Look, Seen};
use crate::tasks::RIM_M;

/// The narrowest and the widest opening that is a door, in metres: 0.7 to 1.3 m, and what a sonar
/// every 80 ms can tell.
const LEAST_M: f32 = 0.58;
const MOST_M: f32 = 1.42;

/// An edge is known where a wall was seen no farther than this before the opening, in metres.
const EDGE_M: f32 = 0.15;

/// The openings on one side.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Openings {
    /// Where the wall was seen last, along the way.
    wall_m: Option<f32>,
    /// Where the opening beside the robot was seen first and last.
    open_m: Option<(f32, f32)>,
    doors: u32,
}

/// A door opening.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Door {
    /// Which one it is on its side, counted from 1.
    pub number: u32,
    /// Where its middle is, along the way.
    pub middle_m: f32,
    /// How wide it is, in metres.
    pub width_m: f32,
}

impl Openings {
    /// Nothing was seen.
    pub const NONE: Self = Self {
        wall_m: None,
        open_m: None,
        doors: 0,
    };

    /// Takes a look to the side. Returns the door whose end it shows.
    pub fn look(&mut self, look: &Look) -> Option<Door> {
        match look.seen {
            Seen::Beyond => {
                self.open_m = match (self.open_m, self.wall_m) {
                    (Some((first_m, _)), _) => Some((first_m, look.along_m)),
                    (None, Some(wall_m)) if look.along_m - wall_m < EDGE_M => {
                        Some(((wall_m + look.along_m) / 2.0, look.along_m))
                    }
                    // Where it begins nobody has seen.
                    (None, _) => None,
                };
                None
            }
            Seen::Unsure => None,
            Seen::Before => {
                // Somebody stands there: what is behind nobody sees.
                (self.open_m, self.wall_m) = (None, None);
                None
            }
            Seen::Wall => {
                self.wall_m = look.is_along.then_some(look.along_m);
                let (first_m, last_m) = self.open_m.take()?;
                if look.along_m - last_m > EDGE_M {
                    return None;
                }
                let end_m = (last_m + look.along_m) / 2.0;
                let narrower_m = 2.0 * BEAM_TANGENT * (look.wall_m - RIM_M);
                let width_m = end_m - first_m + narrower_m;
                if !(LEAST_M..=MOST_M).contains(&width_m) {
                    return None;
                }
                self.doors += 1;
                Some(Door {
                    number: self.doors,
                    middle_m: (first_m + end_m) / 2.0,
                    width_m,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// A robot drives past, a look every 2 cm, 0.9 m from a wall that is open, or behind somebody,
    /// from one place to another.
    fn doors(open: &[(f32, f32)], before: &[(f32, f32)]) -> Vec<Door> {
        let is_in = |spans: &[(f32, f32)], along_m: f32, edge_m: f32| {
            (spans.iter())
                .any(|(from_m, to_m)| (*from_m + edge_m..*to_m - edge_m).contains(&along_m))
        };
        let mut openings = Openings::default();
        let looks = (0..400).map(|step| {
            let along_m = step as f32 * 0.02;
            let edge_m = BEAM_TANGENT * (0.9 - RIM_M);
            let seen = if is_in(before, along_m, 0.0) {
                Seen::Before
            } else if is_in(open, along_m, edge_m) {
                Seen::Beyond
            } else {
                Seen::Wall
            };
            Look::new(seen, along_m, 0.9)
        });
        looks.filter_map(|look| openings.look(&look)).collect()
    }

    #[test]
    fn doors_are_counted_and_what_is_too_narrow_or_too_wide_is_none() {
        for (open, before, middles) in [
            (&[(1.0, 1.9)][..], &[][..], &[1.45][..]),
            (&[(1.0, 1.7), (3.0, 4.3)], &[], &[1.35, 3.65]),
            (&[(1.0, 1.5)], &[], &[]),
            (&[(1.0, 2.6)], &[], &[]),
            // It begins beside an opening, and stops beside one.
            (&[(-0.5, 0.5)], &[], &[]),
            (&[(7.0, 9.0)], &[], &[]),
            // Somebody stands beside the door, and in it.
            (&[(1.0, 1.9)], &[(0.3, 0.7)], &[1.45]),
            (&[(1.0, 1.9)], &[(1.3, 1.6)], &[]),
        ] {
            let found = doors(open, before);
            assert_eq!(found.len(), middles.len(), "{open:?} {before:?}: {found:?}");
            for ((number, door), middle_m) in (1..).zip(&found).zip(middles) {
                assert_eq!(door.number, number);
                assert!((door.middle_m - middle_m).abs() < 0.015, "{found:?}");
            }
        }
    }
}
