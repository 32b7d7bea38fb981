//! The I2C bus of a [`PinImage`](super::PinImage), with an inertial measurement unit at its other
//! end: as much of a BMI160 as its driver asks for where it is to measure how fast the robot turns.
//!
//! | register | what |
//! |---|---|
//! | 0x00 | which chip it is: 0xD1 |
//! | 0x03 | bits 2 and 3: 1 while the gyroscope measures |
//! | 0x0C … 0x11 | rates of turn about x, y and z in counts, 2 bytes each; about x and y nothing |
//! | 0x43 | range of the gyroscope: 0 is 2,000 °/s at full scale, 4 is 125 °/s |
//! | 0x7E | commands: 0x15 lets the gyroscope measure, 0x14 stops it, 0xB6 is a reset |
//!
//! Source: Bosch Sensortec, data sheet BST-BMI160-DS000, section 2.11. What the gyroscope takes to
//! start is left out: no time passes on a pin image.

use core::sync::atomic::{AtomicU16, Ordering::Relaxed};

use embedded_hal::i2c::{self, ErrorKind, I2c, NoAcknowledgeSource, Operation};

/// The address of a BMI160 whose pin SDO is at ground.
const ADDRESS: u8 = 0x68;

const CHIP_ID: u8 = 0x00;
const PMU_STATUS: u8 = 0x03;
const YAW_LOW: u8 = 0x10;
const YAW_HIGH: u8 = 0x11;
const GYRO_RANGE: u8 = 0x43;
const COMMAND: u8 = 0x7E;

const IS_BMI160: u8 = 0xD1;
const GYRO_MEASURES: u8 = 1 << 2;
const START_GYRO: u8 = 0x15;
const STOP_GYRO: u8 = 0x14;
const RESET: u8 = 0xB6;

/// The range of 250 °/s, in which counts are exchanged with the plant.
const EXCHANGED_RANGE: u8 = 3;

/// The narrowest range, 125 °/s.
const NARROWEST_RANGE: u8 = 4;

/// The bus.
#[derive(Debug)]
pub struct ImuBus<'a> {
    yaw_counts: &'a AtomicU16,
    register: u8,
    measures: bool,
    range: u8,
}

/// Nobody at the bus has that address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAnswer;

impl i2c::Error for NoAnswer {
    fn kind(&self) -> ErrorKind {
        ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address)
    }
}

impl<'a> ImuBus<'a> {
    /// The bus, with a chip that was just switched on. It measures what is in `yaw_counts`: 16 bits
    /// with a sign, in the range of 250 °/s.
    pub(super) const fn new(yaw_counts: &'a AtomicU16) -> Self {
        Self {
            yaw_counts,
            register: 0,
            measures: false,
            range: 0,
        }
    }

    fn put(&mut self, value: u8) {
        match (self.register, value) {
            (GYRO_RANGE, 0..=NARROWEST_RANGE) => self.range = value,
            (COMMAND, START_GYRO) => self.measures = true,
            (COMMAND, STOP_GYRO) => self.measures = false,
            (COMMAND, RESET) => *self = Self::new(self.yaw_counts),
            _ => {}
        }
    }

    fn get(&self) -> u8 {
        let [low, high] = self.counts().to_le_bytes();
        match self.register {
            CHIP_ID => IS_BMI160,
            PMU_STATUS if self.measures => GYRO_MEASURES,
            YAW_LOW => low,
            YAW_HIGH => high,
            GYRO_RANGE => self.range,
            _ => 0,
        }
    }

    /// The rate about z, in the range that was chosen.
    fn counts(&self) -> i16 {
        if !self.measures {
            return 0;
        }
        let exchanged = self.yaw_counts.load(Relaxed).cast_signed();
        match EXCHANGED_RANGE.checked_sub(self.range) {
            Some(wider) => exchanged >> wider,
            None => exchanged.saturating_mul(2),
        }
    }
}

impl i2c::ErrorType for ImuBus<'_> {
    type Error = NoAnswer;
}

impl I2c for ImuBus<'_> {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), NoAnswer> {
        if address != ADDRESS {
            return Err(NoAnswer);
        }
        for operation in operations {
            match operation {
                Operation::Write(bytes) => {
                    let Some((register, values)) = bytes.split_first() else {
                        continue;
                    };
                    self.register = *register;
                    for value in values {
                        self.put(*value);
                        self.register = self.register.wrapping_add(1);
                    }
                }
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        *byte = self.get();
                        self.register = self.register.wrapping_add(1);
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn register(bus: &mut ImuBus<'_>, register: u8) -> u8 {
        let mut byte = [0];
        bus.write_read(ADDRESS, &[register], &mut byte).unwrap();
        byte[0]
    }

    fn yaw(bus: &mut ImuBus<'_>) -> i16 {
        let mut bytes = [0; 6];
        bus.write_read(ADDRESS, &[0x0C], &mut bytes).unwrap();
        assert_eq!(bytes[..4], [0; 4]);
        i16::from_le_bytes([bytes[4], bytes[5]])
    }

    #[test]
    fn a_chip_measures_when_it_was_told_to_in_the_range_that_was_chosen() {
        let counts = AtomicU16::new((-1_000_i16).cast_unsigned());
        let mut bus = ImuBus::new(&counts);
        assert_eq!(register(&mut bus, CHIP_ID), IS_BMI160);
        assert_eq!((register(&mut bus, PMU_STATUS), yaw(&mut bus)), (0, 0));
        bus.write(ADDRESS, &[COMMAND, START_GYRO]).unwrap();
        assert_eq!(register(&mut bus, PMU_STATUS), GYRO_MEASURES);
        for (range, expected) in [(0, -125), (1, -250), (2, -500), (3, -1_000), (4, -2_000)] {
            bus.write(ADDRESS, &[GYRO_RANGE, range]).unwrap();
            assert_eq!(register(&mut bus, GYRO_RANGE), range);
            assert_eq!(yaw(&mut bus), expected, "range {range}");
        }
        counts.store(30_000, Relaxed);
        assert_eq!(yaw(&mut bus), i16::MAX, "faster than the range");
        for command in [STOP_GYRO, RESET] {
            bus.write(ADDRESS, &[COMMAND, START_GYRO]).unwrap();
            bus.write(ADDRESS, &[COMMAND, command]).unwrap();
            assert_eq!(yaw(&mut bus), 0);
        }
        assert_eq!(register(&mut bus, GYRO_RANGE), 0);
    }

    #[test]
    fn nobody_else_is_at_the_bus() {
        let counts = AtomicU16::new(0);
        assert_eq!(ImuBus::new(&counts).write(0x69, &[CHIP_ID]), Err(NoAnswer));
    }
}
