"""The client against a robot that says what a test needs it to say, in a time of their own."""

import unittest
from unittest import mock

from esm_link import Client, Refused, client, frames, messages
from esm_link.frames import FrameReader

# Errors, by their numbers.
MALFORMED, NO_ANSWER, TOO_SOON = 0, 14, 27

DONE = b"\x03"


def error(kind: int, *fields: int) -> bytes:
    return b"\x01" + bytes([kind]) + b"".join(map(messages.number, fields))


class Robot:
    """A line and the robot at its end; it is the module `time` of the client, too. `says` gets the kind of a request and its fields, and gives the message of the answer behind its number."""

    def __init__(self, says) -> None:
        self.now = 0.0
        self.timeout = 0.0
        self.asked = []
        self.line = b""
        self._says = says
        self._reader = FrameReader()

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def write(self, sent: bytes) -> None:
        self.now += 0.002
        for message in self._reader.feed(sent):
            seq, kind = message[:2]
            self.asked.append(kind)
            answer = self._says(kind, message[2:])
            if answer is not None:
                self.send(bytes([0, seq]) + answer)

    def read(self, size: int) -> bytes:
        received, self.line = self.line[:size], self.line[size:]
        if not received:
            self.now += self.timeout + 1e-6
        return received

    def send(self, message: bytes) -> None:
        self.line += frames.encode(message)


class Scripted(unittest.TestCase):
    def session(self, says, **options):
        robot = Robot(says)
        patched = mock.patch.object(client, "time", robot)
        patched.start()
        self.addCleanup(patched.stop)
        return robot, Client(robot, number=0, **options)


class Refusals(Scripted):
    def test_what_no_robot_understands_is_sent_again_once(self):
        robot, session = self.session(lambda *_: error(MALFORMED))
        with self.assertRaises(Refused) as refused:
            session.abort()
        self.assertEqual(refused.exception.error.name, "Malformed")
        self.assertEqual(len(robot.asked), 2)

    def test_a_robot_that_looks_at_no_signature_is_asked_after_its_time(self):
        answers = [error(NO_ANSWER), error(TOO_SOON, 300), b"\0" + DONE]
        robot, session = self.session(lambda *_: answers.pop(0))
        session.abort()
        self.assertGreater(robot.now, 0.3)
        self.assertLess(robot.now, 0.4)


if __name__ == "__main__":
    unittest.main()
