//! The bars of a row on a time axis: what is too narrow and too near to be told apart is one.

use crate::timetable::Activation;

/// Bars are at least so wide, that none is lost.
pub const LEAST_BAR: f32 = 0.9;
/// What is narrower becomes one with a neighbour that is nearer than [`TOUCHING`].
const NARROW: f32 = 2.0;
const TOUCHING: f32 = 1.0;

/// Activations that are drawn as one.
pub struct Bar<'a> {
    /// Its left end.
    pub left: f32,
    /// Its right end.
    pub right: f32,
    /// At least one, in their order.
    pub activations: &'a [Activation],
}

impl Bar<'_> {
    /// Its first and its last microsecond.
    pub fn ends_us(&self) -> [i64; 2] {
        let starts_us = self.activations.iter().map(|one| one.start_us);
        let ends_us = self.activations.iter().map(|one| one.end_us);
        [
            starts_us.min().unwrap_or_default(),
            ends_us.max().unwrap_or_default(),
        ]
    }
}

/// The bars of activations in the order of their starts, from left to right. `x` gives the place of
/// a time; no bar ends behind `most_right`.
pub fn bars(activations: &[Activation], x: impl Fn(i64) -> f32, most_right: f32) -> Vec<Bar<'_>> {
    let mut bars: Vec<Bar<'_>> = Vec::new();
    for (at, one) in activations.iter().enumerate() {
        let left = x(one.start_us);
        let right = x(one.end_us).max(left + LEAST_BAR).min(most_right);
        let is_narrow = right - left < NARROW;
        let of_bar = |count: usize| activations.get(at + 1 - count..=at).unwrap_or_default();
        match bars.last_mut() {
            Some(last)
                if left - last.right < TOUCHING
                    && (is_narrow || last.right - last.left < NARROW) =>
            {
                last.right = last.right.max(right);
                last.activations = of_bar(last.activations.len() + 1);
            }
            _ => bars.push(Bar {
                left,
                right,
                activations: of_bar(1),
            }),
        }
    }
    bars
}
