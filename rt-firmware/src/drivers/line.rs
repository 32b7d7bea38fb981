//! A row of reflectance sensors that look at the floor: the less light comes back, the higher their
//! voltage.

use super::AnalogIn;

/// Number of reflectance sensors that look at the floor.
pub const LINE_SENSORS: usize = 3;

/// Darkness of a line, in thousandths: what a whole line under a sensor reads.
const DARK: u16 = 1_000;

/// A row of reflectance sensors.
#[derive(Debug)]
pub struct LineArray<A> {
    inputs: [A; LINE_SENSORS],
    floor_counts: u16,
    line_counts: u16,
}

impl<A: AnalogIn> LineArray<A> {
    /// The sensors on these inputs, from the left to the right, and what they read over bare floor
    /// and over a line, in ADC counts.
    pub fn new(inputs: [A; LINE_SENSORS], floor_counts: u16, line_counts: u16) -> Self {
        Self {
            inputs,
            floor_counts,
            line_counts,
        }
    }

    /// How dark it is under each sensor, from the left to the right: 0 for bare floor to 1,000 for
    /// a line.
    pub fn darkness(&mut self) -> [u16; LINE_SENSORS] {
        let (floor_counts, line_counts) = (self.floor_counts, self.line_counts);
        let span = u32::from(line_counts.saturating_sub(floor_counts)).max(1);
        self.inputs.each_mut().map(|input| {
            let above = u32::from(input.counts().saturating_sub(floor_counts));
            // The cast is exact: the quotient is limited first.
            (above * u32::from(DARK) / span).min(u32::from(DARK)) as u16
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{PinImage, Sensors};

    #[test]
    fn counts_become_thousandths_between_floor_and_line() {
        let pins = PinImage::new();
        let [_, _, _, _, left, middle, right] = pins.parts().analog;
        let mut array = LineArray::new([left, middle, right], 500, 3_300);
        for (counts, expected) in [
            ([500, 1_900, 3_300], [0, 500, 1_000]),
            ([0, 4_095, 780], [0, 1_000, 100]),
        ] {
            let mut sensors = Sensors::default();
            sensors.adc_counts[4..].copy_from_slice(&counts);
            pins.set_sensors(&sensors);
            assert_eq!(array.darkness(), expected, "{counts:?}");
        }
    }
}
