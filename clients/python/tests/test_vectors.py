"""The client against the protocol's vectors."""

import importlib.util
import itertools
import os
import struct
import tempfile
import unittest
from unittest import mock

import vectors
from esm_link import Client, Key, KeyProblem, NotBuiltIn, OtherVersion, Refused, frames, keys, messages, values
from esm_link.frames import FrameReader
from esm_link.messages import Answer, Error, Malformed, Part, Raw

JUNK = bytes((i * 31 + i // 256) % 256 for i in range(700))

HAS_KEYS = importlib.util.find_spec("cryptography") is not None


def test_vector() -> vectors.Vector:
    [vector] = vectors.of_kind("key")
    return vector


def test_key() -> Key:
    [private] = test_vector().all("private")
    return Key(private)


def nonces():
    """Those of the client's sessions in exchanges."""
    return (f"client nonce {number:03}".encode() for number in itertools.count(1))


def line(name: str) -> vectors.Line:
    return vectors.Line(name)


class Frames(unittest.TestCase):
    def test_messages_become_these_frames_and_come_back(self):
        found = vectors.of_kind("frame")
        self.assertGreater(len(found), 30)
        for vector in found:
            [message], [frame] = vector.all("message"), vector.all("bytes")
            with self.subTest(vector.name):
                self.assertEqual(frames.encode(message), frame)
                self.assertEqual(frames.decode(frame[:-1]), message)

    def test_spoiled_bytes_give_only_the_messages_that_are_whole(self):
        for vector in vectors.of_kind("spoiled"):
            [received] = vector.all("bytes")
            with self.subTest(vector.name):
                self.assertEqual(list(FrameReader().feed(received)), vector.all("message"))
                # However the bytes come.
                reader = FrameReader()
                singly = [message for byte in received for message in reader.feed(bytes([byte]))]
                self.assertEqual(singly, vector.all("message"))

    def test_every_changed_byte_is_noticed(self):
        [frame] = vectors.named("answer status").all("bytes")
        for at in range(len(frame) - 1):
            for bit in range(8):
                changed = bytearray(frame)
                changed[at] ^= 1 << bit
                self.assertEqual(list(FrameReader().feed(bytes(changed))), [])


class Messages(unittest.TestCase):
    def read(self, name: str):
        [message] = vectors.named(name).all("message")
        return messages.from_robot(message)

    def test_requests_are_encoded_as_the_vectors_say(self):
        chunk = bytes((i * 31 + i // 256) % 256 for i in range(176))
        watches = b"".join(bytes(numbers) + struct.pack("<f", 0.5) for numbers in ((0, 1), (4, 3)))
        call = (2**64 - 1, values.param_bits([0.25, -1.5]), watches)
        requests = {
            "request hello": (messages.HELLO,),
            "request begin": (messages.BEGIN, 4096, 0xCBF43926),
            "request chunk of nothing": (messages.CHUNK, 0, b""),
            "request chunk of zeros": (messages.CHUNK, 127, bytes(16)),
            "request chunk, the longest": (messages.CHUNK, 0xFFFFFFFF, chunk),
            "request commit": (messages.COMMIT, True, 10_000),
            "request abort": (messages.ABORT,),
            "request status": (messages.STATUS,),
            "request stop": (messages.STOP,),
            "request start": (messages.START,),
            "request task": (messages.TASK, messages.U8(255), 300),
            "request read blob": (messages.READ_BLOB, 70_000),
            "request states": (messages.STATES, 128),
            "request slot counters": (messages.SLOT_COUNTERS, messages.U8(3)),
            "request subscribe": (messages.SUBSCRIBE, True, False, True),
            "request task counters": (messages.TASK_COUNTERS, 1000),
            "request confirm": (messages.CONFIRM, 0x1234ABCD),
            "request fall back": (messages.FALL_BACK, 0x1234ABCD),
            "request last words": (messages.CRASH_REPORT,),
            "request watch": (messages.WATCH, True, 1000),
            "request emergency stop": (messages.EMERGENCY_STOP,),
            "request release": (messages.RELEASE,),
            "request black box from the oldest": (messages.BLACK_BOX, False),
            "request black box": (messages.BLACK_BOX, True, 70_000),
            "request challenge": (messages.CHALLENGE,),
            "request signed": (messages.SIGNED, bytes([0xA5] * 64), messages.without_number(messages.START)),
            "request sign": (messages.SIGN, 2**64 - 1, bytes([0x5A] * 64)),
            "request install key": (messages.INSTALL_KEY, bytes([0x11] * 32), bytes([0x22] * 16), bytes([0x44] * 16), bytes([0x33] * 64)),
            "request remove key": (messages.REMOVE_KEY,),
            "request param": (messages.PARAM, 0x1234ABCD, 300),
            "request clock": (messages.CLOCK,),
            "request features": (messages.FEATURES,),
            "request fields": (messages.VALUES, values.ask_fields(0x1234ABCD, 300, 128)),
            "request values": (messages.VALUES, values.ask_values(0x1234ABCD, 100, [3, 300])),
            "request no values": (messages.VALUES, b""),
            "request identify": (messages.IDENTIFY, Raw(bytes([0x66] * 16))),
            "request open session": (messages.OPEN_SESSION, *(Raw(bytes([byte] * 16)) for byte in (0x66, 0x77, 0x88))),
            "request proven": (messages.PROVEN, 300, Raw(bytes([0x99] * 16)), messages.without_number(messages.STATUS)),
            "request within a time": (messages.WITHIN, 2**40, messages.without_number(messages.START)),
            "request behaviour list": (messages.BEHAVIOUR_LIST,),
            "request insert at the tail": (messages.BEHAVIOURS, messages.U8(0), *call),
            "request insert at the head": (messages.BEHAVIOURS, messages.U8(1), *call[:2], b""),
            "request cancel": (messages.BEHAVIOURS, messages.U8(2), 300),
            "request drive": (messages.DRIVE, Raw(struct.pack("<ff", 0.25, -1.5)), 2**40),
            "request end drive": (messages.END_DRIVE,),
            "request selftest measures": (messages.SELFTEST, b"\0"),
            "request selftest line rate": (messages.SELFTEST, struct.pack("<BII", 1, 921_600, 2_000)),
            "request frame counters": (messages.FRAME_COUNTERS, 300),
        }
        for name, (kind, *fields) in requests.items():
            with self.subTest(name):
                [expected] = vectors.named(name).all("message")
                self.assertEqual(messages.request(expected[0], kind, *fields), expected)

    def test_all_answers_can_be_read(self):
        for vector in vectors.of_kind("frame"):
            if vector.name.startswith(("answer", "proven", "stream", "news")) and "version 300" not in vector.name:
                with self.subTest(vector.name):
                    read = self.read(vector.name)
                    self.assertIsInstance(read, (Answer, Part, messages.StatusEvent))
                    # To the last byte, and no further.
                    [message] = vector.all("message")
                    with self.assertRaises(Malformed):
                        messages.from_robot(message[:-1])
                    if "invalid" not in vector.name:
                        with self.assertRaises(Malformed):
                            messages.from_robot(message + b"\0")

    def test_fields_have_the_values_that_were_sent(self):
        hello = self.read("answer hello").body
        self.assertEqual((hello.protocol, hello.firmware, hello.board), (4, "a robot 1.2", "a board"))
        self.assertEqual((hello.nets, hello.mission, hello.reset), (23, 0x1234ABCD, "brown-out"))
        self.assertEqual((hello.chunk_bytes, hello.window_bytes), (176, 528))
        status = self.read("answer status").body
        self.assertEqual((status.mode, status.steps, status.missed), ("safe: low battery", 2**64 - 1, 1))
        self.assertEqual((status.stack_bytes, status.reset, status.max_delay_ns), (None, "watchdog", 16_384))
        self.assertEqual(status.flash, messages.FlashHealth("older", "anybody", 300, 70_000, 5))
        self.assertEqual(self.read("answer states").body.states, [1, 256, 65_535, 3])
        self.assertEqual(self.read("answer slot counters").body.delays, [65_535] * 8)
        words = self.read("answer last words").body
        self.assertEqual((words.reset, words.task, words.pc, words.file), ("processor fault", 300, 0x1234, b"src/tasks/cruise.rs"))
        self.assertEqual((words.silent, words.bad_starts), ("slot at place 200", 300))
        # A slot alone has its index behind it.
        [message] = vectors.named("answer last words").all("message")
        slot = bytes([1, 0, 200]) + messages.number(300)
        self.assertEqual(message.count(slot), 1)
        for silent, name in ((1, "link"), (2, "slot 0"), (3, "slot 0, for the link")):
            words = messages.from_robot(message.replace(slot, bytes([1, silent]) + messages.number(300))).body
            self.assertEqual((words.silent, words.bad_starts), (name, 300))
        box = self.read("answer black box").body
        self.assertEqual(box.end, 70_003)
        self.assertEqual([(record.sequence, record.kind) for record in box.records], [(70_000, 1), (70_001, 4), (70_002, 5)])
        self.assertEqual((box.records[1].t_us, box.records[1].large), (70_001 << 24, 300 << 16 | 2))
        features = self.read("answer features").body
        self.assertEqual((features.has("record"), features.has("keys"), features.flash_ms), (True, True, 300))
        self.assertEqual(features.left_out(), ["log", "news", "params", "warm", "store", "black-box", "telemetry", "behaviours", "links"])
        self.assertEqual(self.read("answer frame counters").body, messages.Frame(2**20, 300, 2, 3, 2**32 - 1, 5))
        self.assertEqual(self.read("answer behaviour").body, messages.Behaviour(300))
        listed = self.read("answer behaviour list").body
        self.assertEqual((listed.script, listed.steps, listed.ended, listed.state), (0xFEEDBEEF, 8, 2, "suspended"))
        idle, step = listed.entries
        self.assertEqual(idle, messages.ListEntry(0, 0, "RESUME", "IDLE", False))
        self.assertEqual(step, messages.ListEntry(300, 0xABCD, "RESUME", "script", True))
        self.assertEqual(self.read("answer error too fast").body, Error("TooFast", {}))
        identity = self.read("answer identity").body
        self.assertEqual((identity.key, identity.salt, identity.nonce), (bytes([0x11] * 32), bytes([0x22] * 16), bytes([0x77] * 16)))
        self.assertEqual((identity.counter, identity.proof), (2**40, bytes([0x88] * 16)))
        self.assertEqual(self.read("answer error counter too far").body, Error("CounterTooFar", {"last": 2**40}))
        self.assertEqual(self.read("answer error flash budget").body, Error("FlashBudget", {"s": 120}))
        self.assertEqual(messages.from_robot(bytes([0, 7, 1, 43, messages.START])).body, Error("StopCame", {}))
        proven = self.read("proven answer done")
        self.assertEqual((proven.seq, proven.body, proven.of), (200, messages.Done(), messages.STOP))
        self.assertEqual((proven.proof, proven.proven), (bytes([0x99] * 16), bytes([0, 3, messages.STOP])))
        self.assertEqual((self.read("answer identity").of, self.read("answer identity").proof), (messages.STATUS, None))
        self.assertEqual(self.read("answer to what is no request").of, messages.NO_REQUEST)
        error = self.read("answer error capacity exceeded").body
        self.assertEqual(error.fields, {"what": "nets", "needed": 400, "available": 24})
        news = self.read("news")
        self.assertEqual((news.seq, news.cause, news.mode, news.on_trial), (255, "trial", "running", True))
        self.assertEqual(self.read("news of an emergency stop").mode, "emergency stop")
        self.assertEqual((news.fell_back.reason, news.t_us, news.corrupt_frames), ("failed: overruns", 2**40, 3))
        part = self.read("stream trace")
        self.assertEqual((part.channel, part.part, part.continues, part.dropped), ("trace", 255, True, 300))


class Values(unittest.TestCase):
    def part(self, name: str) -> values.Part:
        [message] = vectors.named(name).all("message")
        return values.part_of(messages.from_robot(message).bytes)

    def test_a_sample_has_the_values_that_were_sent(self):
        fields = [values.fields_of(text) for text in ("x_m:f32\nlost:bool\n", ":u32\n", "left_um:i16\n")]
        part = self.part("stream values")
        self.assertEqual((part.number, part.ended, part.left_out, part.t_us), (7, False, 2, 2**40 + 3))
        sample = values.sample_of(part, fields)
        self.assertEqual(sample.values, [[-0.5, True], None, [-3]])
        self.assertEqual(values.as_dict(fields[0], sample.values[0]), {"x_m": -0.5, "lost": True})
        self.assertTrue(self.part("stream values that have ended").ended)
        with self.assertRaises(Malformed):
            values.sample_of(part, [fields[0]] * 3)

    def test_a_row_is_a_list_and_a_number_itself_has_no_name(self):
        self.assertEqual(values.as_dict(values.fields_of("r:[u32;2]\n"), [1, 2]), {"r": [1, 2]})
        self.assertEqual(values.as_dict(values.fields_of(":i32\n"), [-1]), -1)
        # Rows of small integers share words.
        fields = values.fields_of("a:[u8;5]\nb:[i16;3]\nc:u8\n")
        shared = values.Part(1, False, 0, 1, 0, struct.pack("<5I", 0x04030201, 5, 0x0002FFFF, 3, 7))
        self.assertEqual(values.sample_of(shared, [fields]).values, [[1, 2, 3, 4, 5, -1, 2, 3, 7]])
        for text in ("x", "x:f64", "x:[f32;N]", "x:[f32;2"):
            with self.assertRaises(Malformed):
                values.fields_of(text)

    def test_values_that_end_with_the_mission(self):
        name = "values of a mission, and their end"
        port = line(name)
        sent = [_bare(frames.decode(frame[1:-1])) for frame in vectors.named(name).all(">")]
        blob = b"".join(_data_of(bare) for bare in sent if bare[0] == messages.CHUNK)
        client = Client(port, number=0)
        client.hello()
        mission = client.upload(blob)
        fields = client.fields(mission, 0)
        self.assertEqual([(field.name, field.type) for field in fields], [("", "u32")])
        number = client.watch_values(mission, [0], period_ms=20)
        samples = list(client.values(number, [fields], 0.0))
        self.assertGreater(len(samples), 2)
        self.assertEqual([sample.t_us for sample in samples], [samples[0].t_us + 20_000 * at for at in range(len(samples))])
        client.end_values()
        self.assertTrue(port.is_done())


class WhatIsSigned(unittest.TestCase):
    def messages(self):
        [public], [salt] = test_vector().all("public"), test_vector().all("salt")
        [secret] = vectors.of_kind("session")[0].all("secret")
        nonce = bytes([0xC3] * 16)
        [upload] = vectors.named("upload").all("signature")
        start = messages.without_number(messages.START)
        commit = messages.without_number(messages.COMMIT, True, 10_000)
        return {
            "key": keys.install_message(public, salt, secret),
            "upload": keys.upload_message(salt, 300, JUNK[:100]),
            "start": keys.command_message(nonce, keys.NO_UPLOAD, start),
            "commit": keys.command_message(nonce, upload, commit),
        }

    def test_messages_are_as_the_vectors_say(self):
        made = self.messages()
        self.assertEqual(set(made), {vector.name for vector in vectors.of_kind("signed")})
        for name, message in made.items():
            with self.subTest(name):
                self.assertEqual([message], vectors.named(name).all("message"))

    @unittest.skipUnless(HAS_KEYS, "the package `cryptography` is not there")
    def test_signatures_are_as_the_vectors_say(self):
        key = test_key()
        self.assertEqual([key.public], test_vector().all("public"))
        for name, message in self.messages().items():
            with self.subTest(name):
                self.assertEqual([key.sign(message)], vectors.named(name).all("signature"))

    @unittest.skipUnless(HAS_KEYS, "the package `cryptography` is not there")
    def test_the_secret_is_as_the_vectors_say(self):
        [session], [salt] = vectors.of_kind("session"), test_vector().all("salt")
        self.assertEqual([test_key().secret(salt)], session.all("secret"))

    def test_proofs_are_as_the_vectors_say(self):
        [vector] = vectors.of_kind("session")
        [secret], [client], [robot], [key] = map(vector.all, ("secret", "client", "robot", "session"))
        [public], [salt] = test_vector().all("public"), test_vector().all("salt")
        self.assertEqual(keys.mac(secret, "esm session v1", client, robot), key)
        session = keys.OwnerSession(secret, salt, client, robot)
        stop = messages.without_number(messages.STOP)
        session.number = 70_000 - 1
        number, proven = session.prove(stop)
        made = {
            "identity": keys.identity_proof(secret, client, public, salt, robot, 300),
            "opening": session.opening(),
            "request": proven[4:20],
            "answer": session.answer_proof(number, bytes([0, 3, messages.STOP])),
            # Of a secret of zeros, that is the mask.
            "mask": session.mask(bytes(16), salt),
        }
        self.assertEqual(proven[:4] + proven[20:], bytes([messages.PROVEN]) + messages.number(70_000) + bytes([1]) + stop)
        self.assertEqual(set(made), {vector.name for vector in vectors.of_kind("proof")})
        for name, proof in made.items():
            with self.subTest(name):
                [vector] = [vector for vector in vectors.of_kind("proof") if vector.name == name]
                self.assertEqual([proof], vector.all("proof"))

    @unittest.skipUnless(HAS_KEYS, "the package `cryptography` is not there")
    def test_a_key_is_read_from_a_file_of_its_owner_alone(self):
        [private] = test_vector().all("private")
        secret = private.hex()
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "key")
            for text, mode, problem in (
                (f"mine\nesm-key-1 {secret}\n", 0o600, None),
                (f"esm-key-1 {secret}\n", 0o640, "chmod 600"),
                (f"esm-key-1 {secret}00\n", 0o600, "no key"),
                (f"esm-key-1 {secret[:-1]}x\n", 0o600, "no key"),
                (f"esm-key-1 {secret[:-2]}  \n", 0o600, "no key"),
                (f"{secret}\n", 0o600, "no key"),
                ("", 0o600, "no key"),
            ):
                with open(path, "w") as file:
                    file.write(text)
                os.chmod(path, mode)
                with self.subTest(text=text.replace(secret, "..."), mode=oct(mode)):
                    if problem is None:
                        key = Key.read(path)
                        self.assertEqual(key.public, test_key().public)
                        self.assertNotIn(secret[:12], repr(key) + repr(vars(key)))
                    else:
                        with self.assertRaises(KeyProblem) as raised:
                            Key.read(path)
                        self.assertIn(problem, str(raised.exception))
                        self.assertNotIn(secret[:12], str(raised.exception))
                        self.assertIsNone(raised.exception.__context__)
            with self.assertRaises(KeyProblem):
                Key.read(os.path.join(folder, "none"))


class Exchanges(unittest.TestCase):
    @unittest.skipUnless(HAS_KEYS, "the package `cryptography` is not there")
    def test_a_key_an_upload_and_a_start_that_it_signs(self):
        name = "a key, an upload and a start that it signs"
        sent = [_bare(frames.decode(frame[1:-1])) for frame in vectors.named(name).all(">")]
        blob = b"".join(_data_of(bare) for bare in sent if bare[0] == messages.CHUNK)
        [salt] = test_vector().all("salt")
        port = line(name)
        given = nonces()
        patched = mock.patch("esm_link.client.random_bytes", lambda: next(given))
        patched.start()
        self.addCleanup(patched.stop)
        client = Client(port, number=0)
        self.assertEqual(client.hello().access, "open")
        client.install_key(test_key(), salt)
        mission = client.upload(blob)
        # In the session alone, as this client had sent it.
        client._ask("stop", messages.Done, messages.STOP)
        client.start()
        self.assertEqual(client.status().mission, mission)
        client.remove_key()
        self.assertTrue(port.is_done())

    def test_a_robot_with_a_key_refuses(self):
        """Whatever the robot says in that exchange can be read, and each refusal says which."""
        robot = [answer for said in vectors.named("what a robot with a key refuses").all("<") for answer in FrameReader().feed(said)]
        told = [answer.body.name for answer in map(messages.from_robot, robot) if isinstance(answer.body, messages.Error)]
        self.assertEqual(
            told,
            [
                # To somebody else.
                *("NeedsKey", "NoSession", "NoSession", "WrongProof", "NoSession"),
                # To the owner without a signature, and to somebody else meanwhile.
                *("NeedsKey", "NoSession", "WrongProof"),
                *("WrongSignature", "TooSoon", "NoChallenge", "WrongSignature"),
                *("NeedsKey", "NotSigned", "OldCounter", "CounterTooFar", "WrongSignature", "NoChallenge", "DeadlineTooFar"),
            ],
        )

    def test_what_comes_too_late_is_refused_also_a_stop_that_was_done_in_time(self):
        said = [answer for said in vectors.named("requests that come too late").all("<") for answer in FrameReader().feed(said)]
        told = [answer.body for answer in map(messages.from_robot, said)]
        # The same stop twice: it is looked at anew each time that it comes.
        self.assertEqual(told[2:4], [messages.Done(), Error("Late", {})])
        self.assertEqual([body.name for body in told[4:]], ["Late", "Late", "Malformed", "Malformed"])

    def test_a_robot_without_a_mission(self):
        port = line("a robot without a mission")
        client = Client(port, number=0)
        self.assertEqual(client.hello().board, "bench")
        self.assertEqual(client.status().mode, "empty")
        with self.assertRaises(Refused) as refused:
            client.read_blob()
        self.assertEqual(refused.exception.error.name, "NoMission")
        self.assertTrue(client.task(0).startswith("task Source"))
        with self.assertRaises(Refused) as refused:
            client.task(99)
        self.assertEqual(refused.exception.error.name, "NoSuchIndex")
        client.abort()
        self.assertTrue(port.is_done())

    def test_uploads(self):
        told = []
        for name in (
            "an upload of 700 bytes that are no mission",
            "an upload of 700 bytes with chunks ahead",
            "an upload of 700 bytes whose second chunk is lost",
        ):
            with self.subTest(name):
                port = line(name)
                client = Client(port, number=0)
                client.hello()
                if name.endswith("no mission"):
                    with self.assertRaises(Refused) as refused:
                        client.upload(JUNK, told.append)
                    self.assertEqual(refused.exception.error.fields, {"refusal": "magic"})
                else:
                    client.stage(JUNK)
                client.abort()
                self.assertTrue(port.is_done())
        self.assertEqual(told, [0, 176, 352, 528, 700])

    def test_an_upload_that_goes_on_where_it_was(self):
        port = line("an upload that goes on where it was")

        class Gone(Exception):
            pass

        def go(there: int) -> None:
            if there > 0:
                raise Gone

        client = Client(port, number=0)
        client.hello()
        with self.assertRaises(Gone):
            client.stage(JUNK, go)
        told = []
        client = Client(port, number=3)
        client.hello()
        client.stage(JUNK, told.append)
        self.assertEqual(told[0], 176)
        client.abort()
        self.assertTrue(port.is_done())

    def test_what_the_firmware_lacks_is_not_asked_for(self):
        port = line("what the firmware was built with")
        client = Client(port, number=0)
        client.hello()
        with self.assertRaises(NotBuiltIn) as lacking:
            client.require("store")
        self.assertEqual(lacking.exception.feature, "store")
        # It is asked once.
        client.require("warm")
        self.assertTrue(port.is_done())

    def test_a_firmware_that_does_not_say_what_it_has_may_have_all(self):
        class Older:
            timeout = 0.0
            answer = b""
            asked = 0

            def write(self, sent: bytes) -> None:
                self.asked += 1
                seq = frames.decode(sent[1:-1])[0]
                self.answer = frames.encode(bytes([0, seq, 1, 0, messages.NO_REQUEST]))

            def read(self, size: int) -> bytes:
                answer, self.answer = self.answer[:size], self.answer[size:]
                return answer

        port = Older()
        self.assertEqual(Client(port).features(), messages.UNTOLD)
        self.assertEqual(port.asked, 2)

    def test_a_mission_its_trace_and_a_stop(self):
        port = line("a mission, its trace, a stop")
        sent = [_bare(frames.decode(frame[1:-1])) for frame in vectors.named("a mission, its trace, a stop").all(">")]
        blob = b"".join(_data_of(bare) for bare in sent if bare[0] == messages.CHUNK)
        client = Client(port, number=0)
        client.hello()
        client.subscribe(trace=True)
        mission = client.upload(blob)
        self.assertEqual(mission, int.from_bytes(blob[-4:], "little"))
        records = list(client.trace(0.0))
        status = client.status()
        records += list(client.trace(0.0))
        self.assertEqual((status.mode, status.mission), ("running", mission))
        self.assertEqual(client._ask("states", messages.States, messages.STATES, 0).total, 1)
        slot = client._ask("slot", messages.Slot, messages.SLOT_COUNTERS, messages.U8(1))
        self.assertEqual((slot.number, slot.missed), (2, 0))
        client._ask("task", messages.TaskInstance, messages.TASK_COUNTERS, 0)
        # It asks for the status, too.
        client.stop()
        client.start()
        client.subscribe()
        self.assertTrue(port.is_done())
        records += list(client.trace(0.0))
        kinds = [record["kind"] for record in records]
        self.assertEqual(kinds[:3], ["started", "transition", "step"])
        self.assertIn({"kind": "motors off", "reason": None}, records)
        self.assertEqual(records[0]["mission"], mission)

    def test_another_version_is_named(self):
        class Other:
            timeout = 0.0
            answer = b""

            def write(self, sent: bytes) -> None:
                seq = frames.decode(sent[1:-1])[0]
                [message] = vectors.named("answer hello of version 300").all("message")
                self.answer = frames.encode(message[:1] + bytes([seq]) + message[2:])

            def read(self, size: int) -> bytes:
                answer, self.answer = self.answer[:size], self.answer[size:]
                return answer

        with self.assertRaises(OtherVersion) as other:
            Client(Other()).hello()
        self.assertEqual(other.exception.robot, 300)


def _bare(message: bytes) -> bytes:
    """A request without its number, also where it is in the owner's session."""
    bare = message[1:]
    if bare[0] != messages.PROVEN:
        return bare
    fields = messages.Fields(bare[1:])
    fields.number(32)
    fields.take(messages.PROOF_BYTES)
    return fields.bytes()


def _data_of(bare: bytes) -> bytes:
    fields = messages.Fields(bare[1:])
    fields.number(32)
    return fields.bytes()


if __name__ == "__main__":
    unittest.main()
