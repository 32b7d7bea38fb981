"""The I2C bus of the board, at the pins of the emulated chip, with what may be at it.

The firmware is src/bin/pins.rs with the feature `sensors`, whose file ESM_SENSORS_FIRMWARE names.
"""

import os
import struct
import unittest

from test_pins import Chip, emulate

FIRMWARE = os.environ["ESM_SENSORS_FIRMWARE"]
SENSORS = emulate.Wiring(emulate.ROVER.with_name("sensors.toml"))

DONE, FAILED, OTHER_CHIP = range(3)

# What the chapter says of a reading: that of ten bytes at 400 kHz, and what it takes at most where
# the bus hangs, in microseconds.
READING_US = 260
HANGS_US = 700


class Gyroscope(unittest.TestCase):
    """BMI160, data sheet BST-BMI160-DS000: it measures 80 ms after it was woken."""

    def setUp(self):
        self.chip = Chip(FIRMWARE)
        self.gyro = emulate.Bmi160(self.chip.clock)
        devices = {self.gyro.ADDRESS: self.gyro}
        self.bus = emulate.Bus(self.chip.chip, SENSORS.bus, devices)

    def wake(self):
        return struct.unpack("<BH", self.chip.ask(b"g", 3))

    def read(self):
        return struct.unpack("<BhH", self.chip.ask(b"y", 5))

    def test_it_tells_how_fast_it_is_turned_when_it_has_woken(self):
        state, took_us = self.wake()
        print(f"waking takes {took_us} us")
        self.assertEqual(state, DONE)
        self.assertLessEqual(took_us, READING_US)
        self.gyro.yaw = 1_312
        self.assertEqual(self.read()[:2], (DONE, 0), "it is not awake yet")
        self.chip.run_us(80_000)
        for yaw in (1_312, -1, -32_768, 32_767):
            self.gyro.yaw = yaw
            state, counts, took_us = self.read()
            self.assertEqual((state, counts), (DONE, yaw))
            self.assertLessEqual(took_us, READING_US)
        print(f"a reading takes {took_us} us")

    def test_the_bus_has_400_kilohertz(self):
        self.wake()
        block = self.chip.chip.i2c[SENSORS.bus]
        low, high = block.scl_low_period, block.scl_high_period
        self.assertAlmostEqual(emulate.CLOCK_MHZ * 1e6 / (low + high), 400e3, delta=4e3)
        # UM10204, table 10: low for 1.3 us at least, high for 0.6 us.
        self.assertGreaterEqual(low / emulate.CLOCK_MHZ, 1.3)
        self.assertGreaterEqual(high / emulate.CLOCK_MHZ, 0.6)

    def test_nobody_at_the_address_and_another_chip_are_told(self):
        self.bus.devices.clear()
        for state, took_us in (self.wake(), self.read()[::2]):
            self.assertEqual(state, FAILED)
            self.assertLess(took_us, READING_US, "no answer is told at once")
        self.bus.devices[self.gyro.ADDRESS] = self.gyro
        self.gyro.IS_BMI160 = 0x68
        self.assertEqual(self.wake()[0], OTHER_CHIP)

    def test_a_bus_that_hangs_is_given_up_and_begun_anew(self):
        self.wake()
        self.chip.run_us(80_000)
        self.gyro.yaw = 77
        for _ in range(3):
            self.bus.hangs = True
            state, _, took_us = self.read()
            self.assertEqual(state, FAILED)
            self.assertLessEqual(took_us, HANGS_US)
            self.bus.hangs = False
            # Who asks behind it in the same slot does not wait for it, too.
            state, _, at_once_us = self.read()
            self.assertEqual(state, FAILED)
            self.assertLess(at_once_us, 20)
            self.chip.run_us(4_000)
            self.assertEqual(self.read()[:2], (DONE, 77))
        print(f"a bus that hangs is given up after {took_us} us")


class Sonars(unittest.TestCase):
    """SRF08: an echo in microseconds, within the time that it was told to listen."""

    # Of the file: the first one at the bus.
    PLACE, (KIND, ADDRESS) = next(iter(SENSORS.at_bus.items()))

    def setUp(self):
        self.chip = Chip(FIRMWARE)
        self.echo_us = 0
        self.sonar = emulate.BusSonar(self.chip.clock, self.KIND, lambda: (0, self.echo_us))
        self.bus = emulate.Bus(self.chip.chip, SENSORS.bus, {self.ADDRESS: self.sonar})

    def ping(self):
        self.chip.ask(b"p" + bytes([self.PLACE]), 1)

    def answer(self):
        return struct.unpack("<BH", self.chip.ask(b"w" + bytes([self.PLACE]), 3))

    def test_an_echo_is_told_to_a_microsecond_after_26_ms(self):
        for echo_us in (1_000, 5_828, 5_829, 24_999):
            self.echo_us = echo_us
            self.ping()
            self.chip.run_us(10_000)
            self.assertEqual(self.answer()[0], 0, "it still listens")
            self.chip.run_us(16_000)
            self.assertEqual(self.answer(), (2, echo_us))
            self.chip.run_us(5_000)

    def test_nothing_in_range_and_no_sonar_are_told_apart(self):
        self.echo_us = 38_000
        self.ping()
        self.chip.run_us(26_000)
        self.assertEqual(self.answer(), (2, 0xFFFF))
        self.bus.devices.clear()
        self.ping()
        self.chip.run_us(26_000)
        self.assertEqual(self.answer(), (0, 0))


if __name__ == "__main__":
    unittest.main()
