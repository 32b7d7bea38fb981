"""The owner's client against a robot with a key, and against who answers in its place, in a time of their own. The robot's end is written anew here, from section 13 of docs/link.md."""

import hashlib
import hmac
import importlib.util
import random
import unittest
from unittest import mock

from esm_link import Client, Key, NotLocked, NotStopped, OtherKey, Refused, Unproven, client, frames, messages
from esm_link.frames import FrameReader
from test_robot import DONE, error, hello, status

PRIVATE, OTHER_PRIVATE = bytes(range(32)), bytes(range(1, 33))
SALT = bytes(range(100, 116))
BLOB = bytes(at * 7 % 256 for at in range(900))

# Errors, by their numbers.
WRONG_OFFSET, BUSY, NOT_ON_TRIAL, OLD_COUNTER, NO_CHALLENGE, NO_SESSION, WRONG_PROOF = 2, 13, 18, 22, 23, 38, 39

ERROR = b"\x01"


def mac(key: bytes, text: bytes, *parts: bytes) -> bytes:
    return hmac.new(key, text + bytes(16 - len(text)) + b"".join(parts), hashlib.sha256).digest()


def little(number: int, count: int) -> bytes:
    return number.to_bytes(count, "little")


class Robot:
    """A robot with a key, its line, and the module `time` of its client."""

    def __init__(self, public: bytes, secret: bytes, access: str = "locked") -> None:
        self.public, self.secret, self.salt, self.access = public, secret, SALT, access
        self.now = 0.0
        self.timeout = 0.0
        self.line = b""
        #: What came, in order: `plain` or the number in the session, and the kind of the request.
        self.came = []
        #: Requests that were signed.
        self.signed = []
        #: Called with a message before it is looked at.
        self.before = lambda message: None
        #: Whether the line loses the next frame, either way.
        self.loses = lambda: False
        # The last request of a session, and its answer.
        self._last = (0, b"", b"")
        #: Answers nothing.
        self.is_silent = False
        self.modes = [1]
        self.counter = 41
        self.blob = b""
        self.session = None
        self._nonce = bytes(16)
        self._reader = FrameReader()

    def monotonic(self) -> float:
        return self.now

    def time_ns(self) -> int:
        return 0

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def read(self, size: int) -> bytes:
        received, self.line = self.line[:size], self.line[size:]
        if not received:
            self.now += self.timeout + 1e-6
        return received

    def say(self, message: bytes) -> None:
        if not self.loses():
            self.line += frames.encode(message)

    def write(self, sent: bytes) -> None:
        self.now += 0.002
        for message in self._reader.feed(sent):
            self.before(message)
            if not self.is_silent and not self.loses():
                self._take(message)

    def reset(self) -> None:
        self.session = None

    def _take(self, message: bytes) -> None:
        seq, kind = message[:2]
        fields = messages.Fields(message[2:])
        if kind != messages.PROVEN:
            self.came.append(("plain", kind))
            return self._take_plain(seq, kind, fields)
        number, proof, request = fields.number(32), fields.take(16), fields.bytes()
        refusal = NO_SESSION if self.session is None else WRONG_PROOF
        if self.session is None or mac(self.session, b"esm request v1", little(number, 4), request)[:16] != proof:
            return self.say(bytes([0, seq]) + ERROR + bytes([refusal, messages.PROVEN]))
        last, sent, answered = self._last
        if number < last:
            return
        if number == last:
            assert message == sent, "a number has one message"
            return self.say(answered)
        self.came.append((number, request[0]))
        session = self.session
        behind = self._answer(request) + bytes([messages.innermost_kind(request)])
        answer = self.proven(seq, number, behind, session)
        self._last = (number, message, answer)
        self.say(answer)

    def proven(self, seq: int, number: int, behind: bytes, session: bytes) -> bytes:
        return bytes([3, seq]) + mac(session, b"esm answer v1", little(number, 4), behind)[:16] + behind

    def prove(self, seq: int, number: int, behind: bytes, session: bytes) -> None:
        self.say(self.proven(seq, number, behind, session))

    def _take_plain(self, seq: int, kind: int, fields: messages.Fields) -> None:
        if kind == messages.IDENTIFY:
            nonce, robot = fields.take(16), self._new_nonce()
            proof = mac(self.secret, b"esm identity v1", nonce, self.public, self.salt, robot, little(self.counter, 8))[:16]
            body = b"\0\x12" + self.public + self.salt + robot + messages.number(self.counter) + proof
        elif kind == messages.OPEN_SESSION:
            nonce, robot, proof = fields.take(16), fields.take(16), fields.take(16)
            session = mac(self.secret, b"esm session v1", nonce, robot)
            if session == self.session:
                # The answer to it was lost.
                pass
            elif robot != self._nonce or proof != mac(session, b"esm opening v1")[:16]:
                return self.say(bytes([0, seq]) + ERROR + bytes([NO_CHALLENGE, kind]))
            else:
                self.session, self._last = session, (0, b"", b"")
            return self.prove(seq, 0, b"\0" + DONE + bytes([kind]), session)
        else:
            request = bytes([kind]) + fields.rest()
            body, kind = self._answer(request), messages.innermost_kind(request)
        self.say(bytes([0, seq]) + body + bytes([kind]))

    def _new_nonce(self) -> bytes:
        self._nonce = hashlib.sha256(self._nonce).digest()[:16]
        return self._nonce

    def _answer(self, request: bytes) -> bytes:
        kind, fields = request[0], messages.Fields(request[1:])
        if kind == messages.HELLO:
            return hello(self.access)
        if kind == messages.SIGNED:
            signature, inner = fields.bytes(), fields.bytes()
            self.signed.append((signature, self._nonce, inner))
            return self._answer(inner)
        if kind == messages.WITHIN:
            fields.number()
            return self._answer(fields.bytes())
        if kind == messages.CHALLENGE:
            return b"\0\x0c" + self._new_nonce() + messages.number(self.counter)
        if kind == messages.STATUS:
            return status(self.modes.pop(0) if len(self.modes) > 1 else self.modes[0])
        if kind == messages.CLOCK:
            return b"\0\x10" + messages.number(int(self.now * 1e6))
        if kind == messages.FEATURES:
            return b"\0\x11" + messages.number(2**32 - 1) + messages.number(0)
        if kind == messages.COMMIT:
            return b"\0\2" + messages.number(7) + messages.number(0)
        if kind == messages.CHUNK:
            offset, data = fields.number(32), fields.bytes()
            if offset > len(self.blob):
                return ERROR + bytes([WRONG_OFFSET]) + messages.number(len(self.blob))
            self.blob += data[len(self.blob) - offset :]
        if kind in (messages.BEGIN, messages.CHUNK):
            return b"\0\1" + messages.number(len(self.blob))
        return b"\0" + DONE


@unittest.skipUnless(importlib.util.find_spec("cryptography"), "the package `cryptography` is not there")
class Owned(unittest.TestCase):
    def setUp(self):
        self.key = Key(PRIVATE)

    def robot(self, key=None, insist=None, access="locked", number=0):
        robot = Robot(self.key.public, mac(PRIVATE, b"esm secret v1", SALT)[:16], access)
        patched = mock.patch.object(client, "time", robot)
        patched.start()
        self.addCleanup(patched.stop)
        session = Client(robot, number=number, key=key, insist=insist)
        session.hello()
        return robot, session

    def verify(self, signature: bytes, message: bytes) -> None:
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        Ed25519PublicKey.from_public_bytes(self.key.public).verify(signature, message)


class Sessions(Owned):
    def test_all_goes_within_the_session_once_it_is_open(self):
        robot, owner = self.robot(self.key)
        self.assertEqual(owner.upload(BLOB), 7)
        self.assertEqual(robot.blob, BLOB)
        self.assertEqual(robot.came[:3], [("plain", messages.HELLO), ("plain", messages.IDENTIFY), ("plain", messages.OPEN_SESSION)])
        numbers, kinds = zip(*robot.came[3:])
        self.assertEqual(list(numbers), list(range(1, len(numbers) + 1)))
        self.assertIn(messages.CHUNK, kinds)
        # The blob, in front of it the counter and the salt; then what commits it.
        [(signature, nonce, request)] = robot.signed
        self.assertEqual(messages.innermost_kind(request), messages.COMMIT)
        upload = owner._signed_upload
        self.verify(upload, b"esm upload v2" + bytes(3) + SALT + little(42, 8) + BLOB)
        self.verify(signature, b"esm command v1" + bytes(2) + nonce + upload + request)
        owner.hello()
        owner.start()
        signature, nonce, request = robot.signed[-1]
        self.verify(signature, b"esm command v1" + bytes(2) + nonce + bytes(64) + request)
        self.assertEqual(robot.came.count(("plain", messages.IDENTIFY)), 1)

    def test_answers_without_the_right_proof_are_passed_over(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        clock = b"\0\x10\1" + bytes([messages.CLOCK])
        stranger = mac(OTHER_PRIVATE, b"esm session v1")

        def forge(message):
            seq, number = message[0], messages.Fields(message[2:]).number(32)
            robot.say(bytes([0, seq]) + clock)
            for refusal in (BUSY, OLD_COUNTER, NO_CHALLENGE):
                robot.say(bytes([0, seq]) + ERROR + bytes([refusal]) + bytes(refusal == OLD_COUNTER) + bytes([messages.CLOCK]))
            robot.say(bytes([0, seq]) + ERROR + bytes([0, messages.NO_REQUEST]))
            robot.prove(seq, number, clock, stranger)
            # The robot's own, of another request.
            robot.prove(seq, number - 1, clock, robot.session)

        robot.before = forge
        before = robot.now
        self.assertGreater(owner.clock(), 1)
        self.assertEqual((owner.retries, len(robot.came)), (0, 5))
        self.assertLess(robot.now - before, 0.1)
        robot.is_silent = True
        with self.assertRaises(Unproven):
            owner.clock()
        robot.before = lambda message: robot.say(bytes([0, message[0]]) + b"\0\1\1" + bytes([messages.CHUNK]))
        with self.assertRaises(Unproven):
            owner._send_from(BLOB, client.Standing(len(BLOB), 0, 176, 528), client.Loss(), lambda _: None)

    def test_a_robot_that_knows_nothing_of_the_session_has_another_one_opened(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        robot.reset()
        owner.clock()
        # Another client of the owner's.
        second = Client(robot, number=50, key=self.key)
        second.hello()
        second.clock()
        owner.clock()
        self.assertEqual(robot.came.count(("plain", messages.OPEN_SESSION)), 4)
        # In the middle of an upload, and while a nonce is waited for.
        for kind in (messages.CHUNK, messages.CHALLENGE, messages.SIGNED):
            left = [kind]

            def reset_once(message):
                if left and message[1] == messages.PROVEN:
                    fields = messages.Fields(message[2:])
                    fields.number(), fields.take(16)
                    if fields.bytes()[0] == left[0]:
                        left.pop()
                        robot.reset()

            robot.before = reset_once
            robot.blob = b""
            self.assertEqual(owner.upload(BLOB), 7)
            self.assertEqual((robot.blob, left), (BLOB, []))

    def test_who_says_that_there_is_no_session_can_do_no_more_than_that(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        robot.before = lambda message: robot.say(bytes([0, message[0]]) + ERROR + bytes([NO_SESSION, messages.CLOCK]))
        with self.assertRaises((Refused, Unproven)):
            owner.start()
        self.assertEqual(robot.signed, [])
        self.assertLess(robot.now, 40)

    def test_what_was_done_before_a_session_ended_is_not_told_as_refused_alone(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        answer, confirmed = robot._answer, []

        def once(request):
            if request[0] != messages.CONFIRM:
                return answer(request)
            confirmed.append(request)
            return b"\0" + DONE if len(confirmed) == 1 else ERROR + bytes([NOT_ON_TRIAL])

        def instead(message):
            # The robot takes it, and somebody else answers.
            if message[1] == messages.PROVEN and not confirmed:
                robot._take(message)
                if confirmed:
                    robot.line = b""
                    robot.say(bytes([0, message[0]]) + ERROR + bytes([NO_SESSION, messages.CONFIRM]))

        robot._answer, robot.before = once, instead
        with self.assertRaisesRegex(Refused, "may have been done") as refused:
            owner.confirm(7)
        self.assertTrue(refused.exception.may_be_done)
        with self.assertRaises(Refused) as refused:
            owner.confirm(7)
        self.assertFalse(refused.exception.may_be_done)

    def test_a_nonce_that_is_too_old_is_asked_for_anew(self):
        robot, owner = self.robot(self.key)
        left = [None]

        def too_late(message):
            if message[1] == messages.OPEN_SESSION and left:
                left.pop()
                robot._new_nonce()

        robot.before = too_late
        owner.clock()
        self.assertEqual(robot.came.count(("plain", messages.IDENTIFY)), 2)

    def test_who_answers_in_the_robots_place_without_its_secret(self):
        robot, owner = self.robot(self.key)
        robot.secret = bytes(16)
        with self.assertRaises(Unproven):
            owner.status()
        self.assertLess(robot.now, 40)
        self.assertNotIn(("plain", messages.OPEN_SESSION), robot.came)

    def test_a_line_that_loses_frames_costs_time_and_nothing_else(self):
        for seed in range(3):
            robot, owner = self.robot(self.key)
            lots = random.Random(seed)
            robot.loses = lambda: lots.random() < 0.2
            self.assertEqual(owner.upload(BLOB), 7)
            owner.start()
            self.assertEqual(robot.blob, BLOB)
            self.assertEqual([messages.innermost_kind(request) for _, _, request in robot.signed], [messages.COMMIT, messages.START])
            self.assertGreater(owner.retries, 0)

    def test_numbers_do_not_wrap(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        owner._session.number = 2**32 - 2
        owner.clock()
        owner.clock()
        self.assertEqual([number for number, kind in robot.came if kind == messages.CLOCK], [1, 2**32 - 1, 1])

    def test_a_key_and_a_session_show_themselves_to_nobody(self):
        _, owner = self.robot(self.key)
        owner.clock()
        secret = mac(PRIVATE, b"esm secret v1", SALT)[:16]
        shown = " ".join(repr(thing) + repr(vars(thing)) for thing in (self.key, owner._session))
        for hidden in (PRIVATE, secret):
            self.assertNotIn(repr(hidden)[2:-1], shown)
            self.assertNotIn(hidden.hex(), shown)


class Access(Owned):
    def test_a_robot_that_says_that_it_has_no_key_is_refused(self):
        for access, what_to_do in (
            ("open", "without a key named here it takes commands"),
            ("unsupported", "cannot have a key"),
            ("unreadable", "erase its flash"),
            ("damaged", "without a key named here it can be given one"),
        ):
            robot, owner = self.robot(self.key, access=access)
            for act in (owner.status, owner.start, lambda: owner.stage(BLOB), lambda: owner.install_key(Key(OTHER_PRIVATE))):
                with self.assertRaisesRegex(NotLocked, what_to_do):
                    act()
            self.assertEqual({kind for _, kind in robot.came}, {messages.HELLO})
        robot, owner = self.robot(self.key, insist=False, access="open")
        owner.start()
        self.assertIn(("plain", messages.WITHIN), robot.came)

    def test_what_is_said_outside_ends_no_session(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        robot.access = "open"
        owner.hello()
        owner.start()
        self.assertEqual(len(robot.signed), 1)

    def test_a_session_is_that_of_its_key(self):
        robot, owner = self.robot(self.key)
        owner.clock()
        owner.use_key(None)
        robot.came.clear()
        owner.clock()
        self.assertEqual(robot.came, [("plain", messages.CLOCK)])

    def test_another_key_than_the_robots_changes_nothing(self):
        robot, other = self.robot(Key(OTHER_PRIVATE))
        for act in (other.status, other.start, other.abort):
            with self.assertRaises(OtherKey):
                act()
        for key in (None, Key(OTHER_PRIVATE)):
            robot, other = self.robot(key, insist=False)
            for act in (lambda: other.stage(BLOB), other.start, other.abort, lambda: other.install_key(Key(OTHER_PRIVATE))):
                with self.assertRaises(OtherKey):
                    act()
            self.assertEqual(other.status().mode, "running")
            other.subscribe(trace=True)
            told = {kind for _, kind in robot.came}
            self.assertTrue(told <= {messages.HELLO, messages.IDENTIFY, messages.STATUS, messages.SUBSCRIBE, messages.FEATURES}, told)

    def test_a_robot_that_recovers_has_its_owner(self):
        robot, owner = self.robot(self.key, access="recovering")
        owner.install_key(self.key)
        self.assertEqual(len(robot.signed), 1)

    def test_a_damaged_robot_that_had_no_key_takes_one_as_it_is(self):
        for key, insist in ((None, None), (Key(OTHER_PRIVATE), False)):
            robot, other = self.robot(key, insist=insist, access="damaged")
            requests = []
            robot.before = lambda message: message[1] == messages.INSTALL_KEY and requests.append(message[1:])
            other.install_key(self.key)
            self.assertEqual((len(requests), robot.signed), (1, []))
            self.assertNotIn(("plain", messages.IDENTIFY), robot.came)
            fields = messages.Fields(requests[0][1:])
            public, salt, secret = fields.bytes(), fields.bytes(), fields.bytes()
            # Without a mask: there is no session.
            self.assertEqual((public, secret), (self.key.public, mac(PRIVATE, b"esm secret v1", salt)[:16]))
            # The robot has begun its records anew, with this key.
            robot.access = "locked"
            other.hello()
            other.clock()
            self.assertEqual(robot.came[-1], (1, messages.CLOCK))


class Installing(Owned):
    def fields(self, request: bytes):
        fields = messages.Fields(request[1:])
        key, salt, secret, signature = [fields.bytes() for _ in range(4)]
        fields.end()
        return key, salt, secret, signature

    def test_the_secret_is_masked_with_the_session_in_which_it_arrives(self):
        other = Key(OTHER_PRIVATE)
        for kind in (None, messages.CHALLENGE, messages.SIGNED):
            robot, owner = self.robot(self.key)
            owner.clock()
            left = [kind]
            sessions = []

            def reset_once(message):
                if message[1] == messages.PROVEN:
                    fields = messages.Fields(message[2:])
                    fields.number(), fields.take(16)
                    inner = fields.bytes()[0]
                    if left and inner == left[0]:
                        left.pop()
                        robot.reset()
                    elif inner == messages.SIGNED:
                        sessions.append(robot.session)

            robot.before = reset_once
            owner.install_key(other, SALT)
            [(_, _, request)] = robot.signed
            key, salt, sent, signature = self.fields(request)
            mask = mac(sessions[-1], b"esm mask v1", salt)
            secret = bytes(a ^ b for a, b in zip(sent, mask))
            self.assertEqual((key, salt), (other.public, SALT))
            self.assertEqual(secret, mac(OTHER_PRIVATE, b"esm secret v1", SALT)[:16])
            self.key, mine = other, self.key
            self.verify(signature, b"esm install v2" + bytes(2) + key + salt + sent)
            self.key = mine

    def test_salts_are_new_each_time(self):
        robot, nobody = self.robot(None, access="open")
        requests = []
        robot.before = lambda message: message[1] == messages.INSTALL_KEY and requests.append(message[1:])
        for _ in range(2):
            nobody.use_key(None)
            nobody.install_key(self.key)
        first, second = map(self.fields, requests)
        self.assertNotEqual(first[1], second[1])
        for _, salt, secret, _ in (first, second):
            self.assertEqual(secret, mac(PRIVATE, b"esm secret v1", salt)[:16])


class Stops(Owned):
    def test_a_stop_goes_out_plain_and_first_and_then_in_the_session(self):
        robot, owner = self.robot(self.key)
        robot.modes = [2, 2, 1, 4]
        robot.came.clear()
        owner.stop()
        session = [("plain", messages.IDENTIFY), ("plain", messages.OPEN_SESSION)]
        self.assertEqual(robot.came, [("plain", messages.STOP), *session, (1, messages.STOP), (2, messages.STATUS)])
        owner.stop()
        self.assertEqual(robot.came[5:], [("plain", messages.STOP), (3, messages.STOP), (4, messages.STATUS)])
        with self.assertRaises(NotStopped):
            owner.stop()
        owner.emergency_stop()

    def test_who_has_not_the_robots_key_stops_it_and_is_told(self):
        for key, access, problem in ((Key(OTHER_PRIVATE), "locked", OtherKey), (self.key, "open", NotLocked), (None, "locked", None)):
            robot, other = self.robot(key, access=access)
            robot.modes = [2, 1]
            robot.came.clear()
            if problem is None:
                other.stop()
            else:
                with self.assertRaises(problem):
                    other.stop()
            self.assertEqual(robot.came[0], ("plain", messages.STOP))
            self.assertEqual(robot.came[-2:], [("plain", messages.STOP), ("plain", messages.STATUS)])
            with self.assertRaises(NotStopped):
                other.stop()

    def test_a_stop_is_sent_before_anything_is_waited_for(self):
        robot, _ = self.robot(None)
        robot.came.clear()
        Client(robot, number=9, key=self.key).send_stop()
        self.assertEqual(robot.came, [("plain", messages.STOP)])


class Listening(Owned):
    def test_the_robot_hears_its_owner_with_one_number_until_it_answers(self):
        robot, owner = self.robot(self.key)
        owner.subscribe(trace=True)
        heard = []
        robot.before = lambda message: heard.append(message)
        robot.is_silent = True
        list(owner.trace(0.7))
        self.assertEqual((len(heard), len(set(heard))), (3, 1))
        # Nobody else's answer is one.
        robot.before = lambda message: (heard.append(message), robot.say(bytes([0, message[0]]) + b"\0\x10\1" + bytes([messages.CLOCK])))
        list(owner.trace(0.5))
        self.assertEqual(len(set(heard)), 1)
        robot.is_silent = False
        robot.before = lambda message: heard.append(message)
        list(owner.trace(1.0))
        self.assertGreater(len(set(heard)), 3)
        self.assertEqual({message[1] for message in heard}, {messages.PROVEN})
        # A request takes the place of a call that was not answered: numbers do not go back.
        robot.is_silent = True
        list(owner.trace(0.3))
        robot.is_silent = False
        owner.clock()
        list(owner.trace(0.3))
        numbers = [number for number, kind in robot.came if kind == messages.CLOCK]
        self.assertEqual(numbers, sorted(set(numbers)))


if __name__ == "__main__":
    unittest.main()
