"""The client against the host board behind a pseudo-terminal: `esm board`, where ESM_BINARY names the command and ESM_LINK_BLOB a mission's blob."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import unittest
import zlib
from unittest import mock

from esm_link import Client, Key, NoReply, NotLocked, OtherKey, Refused, messages, open_port

ESM = os.environ.get("ESM_BINARY")
BLOB = os.environ.get("ESM_LINK_BLOB")

# Longer than a loaded machine takes over anything.
LONG_S = 90


@unittest.skipUnless(ESM and BLOB, "ESM_BINARY and ESM_LINK_BLOB name no command and no blob")
class HostBoard(unittest.TestCase):
    def setUp(self):
        self.board = subprocess.Popen([ESM, "board", "--board", "host"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.addCleanup(self._end)
        found = re.search(r"the robot is at (\S+);", self.board.stdout.readline())
        self.assertIsNotNone(found, "the board names its port")
        self.port = found.group(1)
        with open(BLOB, "rb") as file:
            self.blob = file.read()

    def _end(self):
        self.board.terminate()
        self.board.stdout.close()
        self.board.wait(LONG_S)

    def test_a_session(self):
        with open_port(self.port) as port:
            client = Client(port)
            robot = client.hello()
            self.assertEqual((robot.protocol, robot.board, robot.mission), (4, "host", None))
            self.assertTrue(all("\ntask " in "\n" + client.task(index) for index in range(robot.task_types)))
            with self.assertRaises(Refused) as refused:
                client.upload(self.blob[:-1] + b"?")
            self.assertEqual(refused.exception.error.fields["refusal"], "checksum")
            client.subscribe(trace=True)
            told = []
            started = time.monotonic()
            mission = client.upload(self.blob, told.append)
            took = time.monotonic() - started
            print(f"{len(self.blob)} bytes in {took:.3f} s, {client.retries} sent again", file=sys.stderr)
            self.assertEqual((told[0], told[-1]), (0, len(self.blob)))
            self.assertEqual(client.read_blob(), self.blob)
            records = []
            deadline = time.monotonic() + LONG_S
            while sum(record["kind"] in ("step", "same") for record in records) <= 20:
                self.assertLess(time.monotonic(), deadline, records)
                records += client.trace(0.5)
            self.assertEqual((records[0]["kind"], records[0]["mission"]), ("started", mission))
            status = client.status()
            self.assertEqual((status.mode, status.mission, status.missed), ("running", mission, 0))
            client.stop()
            self.assertEqual(client.status().mode, "stopped")
            client.start()
            self.assertEqual(client.status().mode, "running")

    def test_an_upload_of_a_client_that_has_gone_goes_on(self):
        class Gone(Exception):
            pass

        def go(there: int) -> None:
            if there > len(self.blob) // 2:
                raise Gone

        with open_port(self.port) as port:
            client = Client(port)
            client.hello()
            with self.assertRaises(Gone):
                client.upload(self.blob, go)
        with open_port(self.port) as port:
            told = []
            client = Client(port)
            client.hello()
            client.upload(self.blob, told.append)
            self.assertGreater(told[0], len(self.blob) // 2)

    @unittest.skipUnless(importlib.util.find_spec("cryptography"), "the package `cryptography` is not there")
    def test_a_robot_with_a_key(self):
        mine, other = Key(os.urandom(32)), Key(os.urandom(32))
        with open_port(self.port) as port:
            client = Client(port)
            self.assertEqual(client.hello().access, "open")
            client.install_key(mine)
            mission = client.upload(self.blob)
            # The robot has seen the number of this upload: the next one has another.
            self.assertEqual(client.upload(self.blob), mission)
            # Somebody else's bytes under the checksum of the owner's are in nobody's way.
            client._ask("upload", messages.Received, messages.BEGIN, len(self.blob), zlib.crc32(self.blob))
            for at in range(0, len(self.blob), 64):
                client._ask("upload", messages.Received, messages.CHUNK, at, bytes(len(self.blob[at : at + 64])))
            self.assertEqual(client.upload(self.blob), mission)
            client.stop()
            client.start()
            self.assertEqual(client.status().mode, "running")
        for key in (None, other):
            with open_port(self.port) as port:
                client = Client(port, key=key, insist=False)
                self.assertEqual(client.hello().access, "locked")
                for act in (lambda: client.upload(self.blob), client.start, client.remove_key, client.abort):
                    with self.assertRaises(OtherKey):
                        act()
                self.assertEqual((client.status().mission, client.status().mode), (mission, "running"))
        with open_port(self.port) as port:
            client = Client(port, key=other)
            client.hello()
            with self.assertRaises(OtherKey):
                client.status()
        with open_port(self.port) as port:
            Client(port).stop()  # Whoever sees it do harm may.
            owner = Client(port, key=mine)
            owner.hello()
            self.assertEqual(owner.status().mode, "stopped")
            owner.start()
            with self.assertRaises(OtherKey):
                Client(port, key=other).stop()
            self.assertEqual(owner.status().mode, "stopped")
            owner.emergency_stop()
            owner.release()
            owner.start()
            owner.install_key(other)
            # The robot has the secret that belongs to it: the owner's session is open again.
            self.assertEqual(owner.status().mode, "running")
            owner.remove_key()
            self.assertEqual(owner.hello().access, "open")
            owner.upload(self.blob)
            owner.use_key(mine)
            with self.assertRaises(NotLocked):
                owner.status()

    @unittest.skipUnless(importlib.util.find_spec("cryptography"), "the package `cryptography` is not there")
    def test_a_session_that_another_one_has_ended(self):
        key = Key(os.urandom(32))
        with open_port(self.port) as port:
            first = Client(port)
            first.hello()
            first.install_key(key)
            first.status()
            second = Client(port, key=key)
            second.hello()
            second.upload(self.blob)
            mission = first.upload(self.blob)
            self.assertEqual(second.status().mission, mission)
            # The salt is another one now, and so are secret and session.
            second.install_key(key)
            self.assertEqual(first.status().mode, "running")

    @unittest.skipUnless(importlib.util.find_spec("cryptography"), "the package `cryptography` is not there")
    def test_the_command_with_a_key(self):
        def esm_link(*arguments):
            return subprocess.run([sys.executable, "-m", "esm_link", self.port, *arguments], capture_output=True, text=True, timeout=LONG_S)

        with tempfile.TemporaryDirectory() as folder:
            key, other = os.path.join(folder, "key"), os.path.join(folder, "other")
            for path in (key, other):
                subprocess.run([ESM, "key", "new", "-o", path], check=True, capture_output=True)
            subprocess.run([ESM, "key", "install", "--key", key, "--port", self.port], check=True, capture_output=True)
            ran = {
                0: esm_link("--key", key, "upload", BLOB),
                1: esm_link("--key", other, "upload", BLOB),
                3: esm_link("--key", os.path.join(folder, "none"), "upload", BLOB),
            }
            # A stop needs no key, and who cannot read it is told so all the same.
            self.assertEqual(json.loads(esm_link("status").stdout)["mode"], "running")
            stopped = esm_link("--key", os.path.join(folder, "none"), "stop")
            self.assertEqual((stopped.returncode, json.loads(esm_link("status").stdout)["mode"]), (3, "stopped"))
            for at, status in ((key, 0), (other, 1)):
                self.assertEqual(esm_link("--key", key, "start").returncode, 0)
                self.assertEqual(esm_link("--key", at, "stop").returncode, status)
                self.assertEqual(json.loads(esm_link("status").stdout)["mode"], "stopped")
            for status, run in ran.items():
                self.assertEqual(run.returncode, status, run.stderr)
            for path in (key, other):
                with open(path) as file:
                    secret = file.read().split()[1]
                said = "".join(run.stdout + run.stderr for run in ran.values())
                self.assertFalse([at for at in range(0, 52, 2) if secret[at : at + 12] in said])

    def test_the_command(self):
        def run(*arguments):
            command = [sys.executable, "-m", "esm_link", self.port, *arguments]
            return subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)

        self.assertEqual(json.loads(run("hello").stdout)["board"], "host")
        uploaded = json.loads(run("upload", BLOB).stdout)
        self.assertEqual(uploaded["bytes"], len(self.blob))
        self.assertEqual(run("stop").returncode, 0)
        self.assertEqual(json.loads(run("status").stdout)["mode"], "stopped")
        self.assertEqual(run("start").returncode, 0)
        seconds = 0.5
        while len([json.loads(line) for line in run("trace", "--seconds", str(seconds)).stdout.splitlines()]) <= 5:
            # A loaded machine has given the board no processor.
            seconds *= 2
            self.assertLess(seconds, LONG_S)
        with tempfile.NamedTemporaryFile() as file:
            file.write(b"no mission")
            file.flush()
            refused = run("upload", file.name)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("Invalid", refused.stderr)


class NoRobot(unittest.TestCase):
    class Silent:
        """A line on which nothing comes, in a time of its own: it is the module `time` of the client, too."""

        timeout = 0.0
        now = 0.0

        def write(self, sent: bytes) -> None:
            pass

        def read(self, size: int) -> bytes:
            self.sleep(self.timeout)
            return b""

        def sleep(self, seconds: float) -> None:
            self.now += seconds

        def monotonic(self) -> float:
            return self.now

    def test_silence_ends_in_time(self):
        line = self.Silent()
        with mock.patch("esm_link.client.time", line), self.assertRaises(NoReply):
            Client(line, number=0).hello()
        self.assertTrue(5 < line.now < 10)

    def test_a_process_that_was_suspended_asks_on(self):
        class Suspended(self.Silent):
            reads = 0

            def read(self, size: int) -> bytes:
                self.reads += 1
                if self.reads == 1:
                    self.sleep(60)
                return super().read(size)

        line = Suspended()
        with mock.patch("esm_link.client.time", line), self.assertRaises(NoReply):
            Client(line, number=0).hello()
        self.assertGreater(line.now, 65)


if __name__ == "__main__":
    unittest.main()
