"""The client against a robot that says what a test needs it to say, in a time of their own."""

import unittest
import zlib
from unittest import mock

import vectors
from esm_link import Client, Malformed, NoReply, NotBuiltIn, NotStopped, Refused, client, frames, messages
from esm_link.frames import FrameReader

# Errors, by their numbers.
MALFORMED, NO_ANSWER, TOO_SOON, STOP_NOT_KEPT = 0, 14, 27, 36

DONE = b"\x03"

# Channels.
TRACE, LOG, RECORD = 0, 1, 2


def error(kind: int, *fields: int) -> bytes:
    return b"\x01" + bytes([kind]) + b"".join(map(messages.number, fields))


def hello(access: str = "open", blob_bytes: int = 4096) -> bytes:
    name, numbers = b"a robot", [messages.number(number) for number in (blob_bytes, 1000, 8, 8, 8, 8)]
    uploads = messages.number(176) + messages.number(528)
    return bytes([0, 0, messages.PROTOCOL_VERSION, len(name)]) + name + bytes([0, 3]) + b"".join(numbers) + bytes(2) + uploads + bytes([messages.ACCESS.index(access)])


def status(mode: int) -> bytes:
    """Of a robot that keeps nothing; all 20 fields behind the mode are one byte here."""
    return bytes([0, 4, mode]) + bytes(20)


def part(channel: int, number: int, stream: bytes) -> bytes:
    return bytes([1, channel, number, False]) + messages.number(7) + messages.number(len(stream)) + stream


def same(micro_steps: int) -> bytes:
    """A record of the trace."""
    return bytes([3, micro_steps])


class Robot:
    """A line and the robot at its end; it is the module `time` of the client, too. `says` gets the kind of a request and its fields, and gives the message of the answer behind its number."""

    def __init__(self, says) -> None:
        self.now = 0.0
        self.timeout = 0.0
        self.asked = []
        self.numbers = []
        self.line = b""
        #: Messages behind the answer to a request, by its kind.
        self.behind = {}
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
            self.numbers.append(seq)
            answer = self._says(kind, message[2:])
            if answer is not None:
                self.send(bytes([0, seq]) + answer + bytes([kind]))
            for message in self.behind.get(kind, []):
                self.send(message)

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
            session.crash_report()
        self.assertEqual(refused.exception.error.name, "Malformed")
        self.assertEqual(len(robot.asked), 2)

    def test_a_robot_that_looks_at_no_signature_is_asked_after_its_time(self):
        answers = [error(NO_ANSWER), error(TOO_SOON, 300), b"\0" + DONE]
        robot, session = self.session(lambda *_: answers.pop(0))
        session._ask("anything", messages.Done, messages.SUBSCRIBE, False, False, False)
        self.assertGreater(robot.now, 0.3)
        self.assertLess(robot.now, 0.4)


class Sessions(Scripted):
    def test_a_session_has_its_own_streams_alone(self):
        robot, session = self.session(lambda kind, _: hello() if kind == messages.HELLO else b"\0" + DONE)
        robot.behind = {
            # The robot still sends to the session before when the new one begins.
            messages.HELLO: [part(TRACE, 40, same(1)), part(LOG, 40, b"old")],
            messages.SUBSCRIBE: [part(TRACE, 0, same(2)), part(LOG, 0, b"new")],
        }
        for _ in range(2):
            robot.send(part(TRACE, 39, same(1)))
            robot.send(part(LOG, 39, b"old"))
            session.hello()
            session.subscribe()
            self.assertEqual([record["micro_steps"] for record in session.trace(0.1)], [2])
            self.assertEqual(session._trace.lost_parts, 0)
            self.assertEqual(session.log, b"new")
            # Of this session, and not asked for before the next one begins.
            robot.send(part(TRACE, 1, same(3)))
            session.abort()

    def test_parts_of_a_recording_are_no_log(self):
        robot, session = self.session(lambda *_: b"\0" + DONE)
        robot.behind = {messages.SUBSCRIBE: [part(RECORD, 0, b"recorded"), part(LOG, 0, b"logged")]}
        session.subscribe()
        self.assertEqual([part.bytes for part in session.record(0.1)], [b"recorded"])
        self.assertEqual(session.log, b"logged")


class Readings(Scripted):
    def test_a_blob_is_that_of_one_mission(self):
        def blob(salt: int) -> bytes:
            content = bytes(at ^ salt for at in range(100))
            return content + zlib.crc32(content).to_bytes(4, "little")

        asked = []

        def says(kind, fields):
            if kind == messages.HELLO:
                return hello()
            offset = messages.Fields(fields).number(32)
            asked.append(offset)
            # The robot falls back behind the first part, or all the time.
            mission = blob(len(asked) if always else min(len(asked), 2))
            data = mission[offset : offset + 60]
            return b"\0\x06" + messages.number(len(mission)) + messages.number(len(data)) + data

        always = False
        _, session = self.session(says)
        self.assertEqual(session.read_blob(), blob(2))
        always = True
        with self.assertRaises(Malformed):
            session.read_blob()
        self.assertLess(len(asked), 20)

    def black_box(self, answers):
        """What is read from a robot that gives the end and sequence numbers of these records."""

        def says(*_):
            end, sequence = answers.pop(0)
            records = b"".join(number.to_bytes(4, "little") + bytes(12) for number in sequence)
            return b"\0\x0b" + messages.number(end) + messages.number(len(records)) + records

        _, session = self.session(says)
        return [record.sequence for record in session.black_box()]

    def test_a_black_box_ends_where_it_did_when_it_was_asked(self):
        self.assertEqual(self.black_box([(3, [0, 1]), (6, [2, 3, 4])]), [0, 1, 2])
        last = 2**32 - 1
        self.assertEqual(self.black_box([(1, [last]), (2, [0, 1])]), [last, 0])
        # A robot that goes back is not asked forever.
        self.assertEqual(self.black_box([(9, [3]), (9, [1]), (9, [1])]), [3, 1])

    def test_what_the_firmware_lacks_is_not_asked_for(self):
        robot, session = self.session(lambda *_: b"\0\x11" + messages.number(0) + messages.number(0))
        for feature, act in (
            ("telemetry", lambda: session.fields(1, 0)),
            ("telemetry", lambda: session.watch_values(1, [0])),
            ("keys", lambda: session.install_key(None)),
            ("keys", session.remove_key),
        ):
            with self.assertRaises(NotBuiltIn) as lacking:
                act()
            self.assertEqual(lacking.exception.feature, feature)
        session._features.built_in = 1 << messages.FEATURE_NAMES.index("params")
        with self.assertRaises(NotBuiltIn) as lacking:
            session.save_params(1)
        self.assertEqual(lacking.exception.feature, "store")
        self.assertEqual(robot.asked, [messages.FEATURES])


    def parts(self, *parts):
        """What is read from a robot that answers with these totals and parts of a text, the last one for ever."""
        left = list(parts)

        def says(kind, _):
            if kind == messages.HELLO:
                return hello(blob_bytes=1000)
            total, data = left.pop(0) if len(left) > 1 else left[0]
            answer = 6 if kind == messages.READ_BLOB else 5
            return bytes([0, answer]) + messages.number(total) + messages.number(len(data)) + data

        return self.session(says)

    def test_parts_that_do_not_fit_together_are_refused(self):
        robot, session = self.parts((5, b"abc"), (5, b"de"))
        self.assertEqual(session.task(0), "abcde")
        for parts in (
            # No progress, another length, more than was told.
            [(5, b"abc"), (5, b"")],
            [(5, b"abc"), (6, b"de")],
            [(5, b"abc"), (5, b"def")],
            [(3, b"ab\xff")],
        ):
            robot, session = self.parts(*parts)
            with self.assertRaises(Malformed):
                session.task(0)
            self.assertLess(len(robot.asked), 5)
        # More than a blob of this robot can have, and other lengths each time.
        robot, session = self.parts((1001, b"a"))
        with self.assertRaises(Malformed):
            session.read_blob()
        self.assertEqual(robot.asked.count(messages.READ_BLOB), 1)
        robot, session = self.parts(*((900 + at, b"a") for at in range(20)))
        with self.assertRaises(Malformed):
            session.read_blob()
        self.assertLess(len(robot.asked), 20)

    def test_an_upload_that_has_more_than_there_is_is_refused(self):
        robot, session = self.session(lambda kind, _: hello() if kind == messages.HELLO else b"\0\1" + messages.number(11))
        with self.assertRaises(Malformed):
            session.stage(bytes(10))
        self.assertEqual(robot.asked, [messages.HELLO, messages.BEGIN])


class Answers(Scripted):
    def test_an_answer_to_another_request_is_passed_over(self):
        robot, session = self.session(lambda kind, _: b"\0\x10" + messages.number(7))
        for stale in (bytes([0, 1, 0, 3, messages.STOP]), bytes([0, 1, 1, NO_ANSWER, messages.NO_REQUEST]), bytes([3, 1]) + bytes(16) + b"\0\x10\1" + bytes([messages.CLOCK])):
            robot.send(stale)
        self.assertEqual(session.clock(), 7)
        self.assertEqual(len(robot.asked), 1)
        # What was no request, the robot cannot tell the kind of.
        robot.send(bytes([0, 2, 1, MALFORMED, messages.NO_REQUEST]))
        self.assertEqual(session.clock(), 7)
        self.assertEqual(len(robot.asked), 3)

    def test_the_kind_is_that_of_the_innermost_request(self):
        start = messages.without_number(messages.START)
        within = messages.without_number(messages.WITHIN, 2**40, start)
        signed = messages.without_number(messages.SIGNED, bytes(64), within)
        proven = messages.without_number(messages.PROVEN, 300, messages.Raw(bytes(16)), signed)
        for request in (start, within, signed, proven):
            self.assertEqual(messages.innermost_kind(request), messages.START)


class Stops(Scripted):
    def robot(self, modes, **options):
        """A robot whose modes are these, one after the other, when it is asked."""
        left = list(modes)

        def says(kind, _):
            if kind == messages.HELLO:
                return hello()
            return status(left.pop(0)) if kind == messages.STATUS else b"\0" + DONE

        return self.session(says, **options)

    def test_a_stop_goes_out_first_and_the_robot_says_how_it_is(self):
        robot, session = self.robot([2, 1, 4, 0])
        session.stop()
        self.assertEqual(robot.asked, [messages.STOP, messages.HELLO, messages.STOP, messages.STATUS])
        robot.asked.clear()
        with self.assertRaises(NotStopped) as running:
            session.stop()
        self.assertEqual((running.exception.mode, robot.asked), ("running", [messages.STOP, messages.STATUS]))
        session.emergency_stop()
        with self.assertRaises(NotStopped):
            session.emergency_stop()

    def test_a_stop_that_the_flash_did_not_take_is_told_and_is_one(self):
        left = [4, 2]
        says = {messages.HELLO: lambda: hello(), messages.STATUS: lambda: status(left.pop(0)), messages.EMERGENCY_STOP: lambda: error(STOP_NOT_KEPT)}
        robot, session = self.session(lambda kind, _: says[kind]())
        with self.assertRaises(Refused) as refused:
            session.emergency_stop()
        self.assertEqual(refused.exception.error.name, "StopNotStored")
        with self.assertRaises(NotStopped):
            session.emergency_stop()


class Listening(Scripted):
    def test_a_robot_hears_of_who_listens(self):
        """The same frame until it is answered, and then another one."""
        answers = [None, None, b"\0\x10" + messages.number(1), None]
        robot, session = self.session(lambda kind, _: answers.pop(0) if answers else None)
        list(session.trace(0.9))
        self.assertEqual(robot.asked, [messages.CLOCK] * 4)
        self.assertEqual(robot.numbers, [1, 1, 1, 2])


class Waits(Scripted):
    def test_a_signature_takes_its_time_to_be_verified(self):
        clock = b"\0\x10" + messages.number(0)
        for kind, fields in ((messages.SIGN, (1, bytes(64))), (messages.SIGNED, (bytes(64), b"\x07")), (messages.INSTALL_KEY, (bytes(32), bytes(16), bytes(16), bytes(64)))):
            robot, session = self.session(lambda kind, _: {messages.CLOCK: clock, messages.HELLO: hello()}.get(kind))
            session.hello()
            for _ in range(20):
                session.clock()
            robot.asked.clear()
            with self.assertRaises(NoReply):
                session._ask("a signature", messages.Done, kind, *fields)
            self.assertLess(len(robot.asked), 14)


if __name__ == "__main__":
    unittest.main()
