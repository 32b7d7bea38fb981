"""Uploads over a bad line, in a time of their own: they take as long on any machine, and the same each time."""

import random
import sys
import unittest
from unittest import mock

from esm_link import Client, NoReply, client, frames, messages
from esm_link.frames import FrameReader
from esm_link.upload import Loss, Standing

BLOB = bytes(i * 7 % 256 for i in range(4096))

BYTE_S = 10 / 115_200
# Until the robot comes to a request.
ANSWER_S = 0.004

# Its number among the errors.
WRONG_OFFSET = 2


class Line:
    """A line with a clock, and a robot at its end. So many of all bytes are corrupted, dropped or doubled."""

    def __init__(self, noise: float, seed: int) -> None:
        self.now = 0.0
        self.timeout = 0.0
        self.blob = b""
        self.sent = 0
        self._noise = noise
        self._random = random.Random(seed)
        self._reader = FrameReader()
        self._answers = []
        self._free_at = 0.0

    # The clock.

    def monotonic(self) -> float:
        return self.now

    def time_ns(self) -> int:
        return 0

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    # The port.

    def write(self, sent: bytes) -> None:
        self.now += len(sent) * BYTE_S
        self.sent += len(sent)
        for message in self._reader.feed(self._spoiled(sent)):
            answer = frames.encode(self._answer(message))
            self._free_at = max(self._free_at, self.now + ANSWER_S) + len(answer) * BYTE_S
            self._answers.append((self._free_at, self._spoiled(answer)))

    def read(self, size: int) -> bytes:
        received = b""
        end = self.now + self.timeout
        while self._answers and self._answers[0][0] <= end and not received:
            at, received = self._answers.pop(0)
            self.now = max(self.now, at)
        if not received:
            # A little more, which rounding does not swallow.
            self.now = end + 1e-6
        if len(received) > size:
            self._answers.insert(0, (self.now, received[size:]))
        return received[:size]

    def _spoiled(self, sent: bytes) -> bytes:
        spoiled = bytearray()
        for byte in sent:
            lot = self._random.random() * 3
            if lot < self._noise:
                byte ^= 1 << self._random.randrange(8)
            elif lot < 2 * self._noise:
                continue
            elif lot < 3 * self._noise:
                spoiled.append(byte)
            spoiled.append(byte)
        return bytes(spoiled)

    # The robot.

    def _answer(self, message: bytes) -> bytes:
        number, kind = message[:2]
        fields = messages.Fields(message[2:])
        if kind == messages.HELLO:
            capacities = bytes(7)
            uploads = messages.number(176) + messages.number(528)
            return bytes([0, number, 0, 0, messages.PROTOCOL_VERSION, 5]) + b"robot" + bytes([30]) + b"line" * 7 + b"li" + capacities + bytes(2) + uploads + bytes([0, kind])
        if kind == messages.CHUNK:
            offset, data = fields.number(32), fields.bytes()
            if offset > len(self.blob):
                return bytes([0, number, 1, WRONG_OFFSET]) + messages.number(len(self.blob)) + bytes([kind])
            self.blob += data[len(self.blob) - offset :]
        return bytes([0, number, 0, 1]) + messages.number(len(self.blob)) + bytes([kind])


class Noise(unittest.TestCase):
    def upload(self, noise: float, seed: int):
        """Uploads to a robot at the end of such a line. Returns the line, how long it took, and the client."""
        line = Line(noise, seed)
        with mock.patch.object(client, "time", line):
            robot = Client(line, number=0)
            robot.hello()
            begun = line.now
            robot.stage(BLOB)
        self.assertEqual(line.blob, BLOB)
        return line, line.now - begun, robot

    def test_an_upload_takes_seconds_and_the_same_each_time(self):
        # Parts of all bytes that are spoiled, and how long half of the uploads take at most.
        for noise, most_s in ((0.0, 0.40), (0.01, 2.5), (0.05, 12.0)):
            took = []
            for seed in range(3):
                line, seconds, robot = self.upload(noise, seed)
                took.append(seconds)
                print(f"{len(BLOB)} bytes at {100 * noise:g} % in {seconds:.2f} s, {robot.retries} chunks sent again", file=sys.stderr)
                if noise == 0.0:
                    self.assertEqual(robot.retries, 0)
            self.assertLess(sorted(took)[1], most_s)
            again, seconds, _ = self.upload(noise, 2)
            self.assertEqual((again.sent, seconds), (line.sent, took[2]))

    def test_a_line_that_spoils_every_frame_is_given_up_with_advice(self):
        line = Line(0.3, 1)
        with mock.patch.object(client, "time", line):
            with self.assertRaisesRegex(NoReply, "frames came spoiled: look at cable"):
                Client(line, number=0).hello()
        self.assertLess(line.now, 40.0)

    def test_the_next_chunk_is_the_one_that_brings_most(self):
        loss = Loss()
        standing = Standing(1000, 0, 100, 250)
        sent = []
        while (chunk := standing.next_chunk(loss)) is not None:
            sent.append(chunk)
            standing.chunk_sent(len(sent), chunk, 0.0)
        self.assertEqual(sent, [(0, 100), (100, 200)])
        standing.take(2, 0, loss)
        self.assertEqual(standing.next_chunk(loss)[0], 0)
        for _ in range(20):
            loss.chunk_lost(loss.best_chunk(100))
        self.assertLess(loss.best_chunk(100), 30)


if __name__ == "__main__":
    unittest.main()
