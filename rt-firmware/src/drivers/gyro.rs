//! A gyroscope that measures how fast the robot turns about its upright axis.
//!
//! The chip is a BMI160, an inertial measurement unit of 3 euros that many small boards carry. Its
//! driver is the crate `bmi160`: MIT or Apache-2.0, `embedded-hal` 1.0 and nothing else, a version
//! 1 that is kept, and no `unsafe`. Of `mpu6050-dmp`, `icm42670`, `lsm6dso` and `lsm6ds3tr` each
//! lacks one of these.

use core::f32::consts::PI;

use bmi160::interface::I2cInterface;
use bmi160::{Bmi160, GyroscopePowerMode, GyroscopeRange, SensorSelector, SlaveAddr};
use embedded_hal::i2c::I2c;

/// Radians per second for each count, in the range of 250 °/s: 131.2 counts are a degree per second
/// (Bosch Sensortec, data sheet BST-BMI160-DS000, section 1). A robot that turns faster than
/// 4.3 rad/s reads as one that turns at that.
pub const RAD_PER_S_PER_COUNT: f32 = PI / 180.0 / 131.2;

/// What a BMI160 says that it is.
const CHIP_ID: u8 = 0xD1;

/// How long the gyroscope takes until it measures after it was woken, in microseconds: 55 ms, and
/// 80 ms at most (data sheet, section 1).
pub const WAKES_IN_US: u32 = 80_000;

/// Why a gyroscope does not measure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroError {
    /// The bus failed, or nobody answered: look at its two wires and at the supply.
    Bus,
    /// Another chip answers: this is no BMI160.
    OtherChip {
        /// What it says that it is.
        id: u8,
    },
}

/// The gyroscope of a BMI160, at the address that it has with its pin SDO at ground.
#[derive(Debug)]
pub struct YawGyro<B> {
    imu: Bmi160<I2cInterface<B>>,
}

impl<B: I2c> YawGyro<B> {
    /// The one at this bus.
    pub fn new(bus: B) -> Self {
        Self {
            imu: Bmi160::new_with_i2c(bus, SlaveAddr::default()),
        }
    }

    /// Lets it measure, in [`WAKES_IN_US`].
    ///
    /// # Errors
    /// [`GyroError`].
    pub fn wake(&mut self) -> Result<(), GyroError> {
        let id = self.imu.chip_id().map_err(|_| GyroError::Bus)?;
        if id != CHIP_ID {
            return Err(GyroError::OtherChip { id });
        }
        (self.imu.set_gyro_range(GyroscopeRange::Scale250))
            .and_then(|()| self.imu.set_gyro_power_mode(GyroscopePowerMode::Normal))
            .map_err(|_| GyroError::Bus)
    }

    /// How fast it turns counter-clockwise, in counts of [`RAD_PER_S_PER_COUNT`], with its bias.
    ///
    /// # Errors
    /// [`GyroError::Bus`].
    pub fn counts(&mut self) -> Result<i16, GyroError> {
        let data = self.imu.data(SensorSelector::new().gyro());
        let gyro = data.map_err(|_| GyroError::Bus)?.gyro;
        gyro.map(|rates| rates.z).ok_or(GyroError::Bus)
    }
}

#[cfg(test)]
mod tests {
    use embedded_hal::i2c::{ErrorKind, NoAcknowledgeSource};
    use embedded_hal_mock::eh1::i2c::{Mock, Transaction};

    use super::*;
    use crate::body::{PinImage, Sensors};

    /// Bosch Sensortec, BST-BMI160-DS000, sections 2.11 and 3.2.1: address with SDO at ground, and
    /// registers. A read is the register, a repeated start, and the bytes.
    const AT: u8 = 0x68;
    const CHIP_ID: u8 = 0x00;
    const GYRO_X: u8 = 0x0C;
    const RANGE: u8 = 0x43;
    const COMMAND: u8 = 0x7E;

    /// What a driver does on a bus where this is to happen.
    fn on<T>(expected: &[Transaction], act: impl FnOnce(&mut YawGyro<Mock>) -> T) -> T {
        let mut bus = Mock::new(expected);
        let done = act(&mut YawGyro::new(bus.clone()));
        bus.done();
        done
    }

    #[test]
    fn it_is_asked_who_it_is_set_to_250_degrees_a_second_and_woken() {
        let expected = [
            Transaction::write_read(AT, [CHIP_ID].into(), [0xD1].into()),
            Transaction::write(AT, [RANGE, 0b011].into()),
            Transaction::write(AT, [COMMAND, 0x15].into()),
        ];
        assert_eq!(on(&expected, YawGyro::wake), Ok(()));
    }

    #[test]
    fn a_reading_is_one_transaction_of_nine_bytes_and_tells_the_rate_about_z() {
        // Address, register, address, and three rates of two bytes, the lower one first: 9 bytes,
        // 0.2 ms at 400 kHz.
        for (z, counts) in [([0x20, 0x05], 1_312), ([0x00, 0x80], -32_768)] {
            let rates = [1, 2, 3, 4, z[0], z[1]];
            let expected = [Transaction::write_read(AT, [GYRO_X].into(), rates.into())];
            assert_eq!(on(&expected, YawGyro::counts), Ok(counts));
        }
    }

    #[test]
    fn nobody_or_another_chip_is_told() {
        let read = |id: u8| Transaction::write_read(AT, [CHIP_ID].into(), [id].into());
        // An MPU-6050 has the same address.
        let other = on(&[read(0x68)], YawGyro::wake);
        assert_eq!(other, Err(GyroError::OtherChip { id: 0x68 }));
        let nobody = ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address);
        let none = on(&[read(0).with_error(nobody)], YawGyro::wake);
        assert_eq!(none, Err(GyroError::Bus));
    }

    #[test]
    fn what_the_plant_counts_is_a_rate() {
        let pins = PinImage::new();
        let mut gyro = YawGyro::new(pins.parts().imu);
        assert_eq!(gyro.counts(), Ok(0), "it sleeps");
        assert_eq!(gyro.wake(), Ok(()));
        for yaw_counts in [0, 1_312, -32_768] {
            pins.set_sensors(&Sensors {
                yaw_counts,
                ..Sensors::default()
            });
            assert_eq!(gyro.counts(), Ok(yaw_counts));
        }
        let deg_per_s = 1_312.0 * RAD_PER_S_PER_COUNT * 180.0 / PI;
        assert!((deg_per_s - 10.0).abs() < 1e-4, "{deg_per_s}");
    }
}
