"""A session with a robot (sections 4, 6 and 10 of docs/link.md)."""

import time
import zlib
from typing import Callable, Iterator, List, Optional, Tuple

from . import messages
from .frames import DELIMITER, FrameReader, encode
from .keys import NO_UPLOAD, Key, command_message, new_seed, upload_message
from .messages import Answer, Error, Malformed, Part
from .trace import Assembler
from .upload import Loss, Standing
from .values import Field, Sample, ask_fields, ask_values, fields_of, part_of, sample_of

FIRST_WAIT_S = 0.3
SHORTEST_WAIT_S = 0.04
LONGEST_WAIT_S = 1.0
BYTE_TIME_S = 0.0005
SPOILED_WAIT_S = 0.01
BUSY_WAIT_S = 0.005
LONGEST_LOOK_S = 1.0
# No robot looks at no signature for longer.
LONGEST_PAUSE_S = 2.0
SILENT_DEADLINE_S = 6.0
NOISY_DEADLINE_S = 30.0
# A robot does not do what it is asked for after nobody waits for it any more: a client gives up no sooner.
COMMAND_TIME_US = int(SILENT_DEADLINE_S * 1_000_000)

# Before their answers the robot may write its flash.
KEPT = (
    messages.COMMIT, messages.CONFIRM, messages.FALL_BACK, messages.SAVE_PARAMS, messages.RELEASE, messages.INSTALL_KEY, messages.REMOVE_KEY,
)  # fmt: skip

# Before their answers the robot verifies a signature, which takes it a tenth of a second or more.
VERIFIED = (messages.SIGNED, messages.SIGN, messages.INSTALL_KEY)
VERIFICATION_WAIT_S = 0.5

BLOB_READS = 5
MOST_DOUBLINGS = 2
BEGIN_LIMIT = 20


class LinkLost(Exception):
    """The line failed."""


class NoReply(Exception):
    """The robot did not answer in time."""


class OtherVersion(Exception):
    """The robot speaks another version of the protocol."""

    def __init__(self, robot: int) -> None:
        super().__init__(f"the robot speaks version {robot} of the link, this program version {messages.PROTOCOL_VERSION}")
        self.robot = robot


class OtherKey(Exception):
    """The robot has another key than this session, or this session has none."""

    def __init__(self, robot: bytes, ours: Optional[bytes]) -> None:
        have = "this session has none" if ours is None else f"this one is {ours.hex()}"
        super().__init__(f"the robot has the key {robot.hex()}, {have}")
        self.robot = robot
        self.ours = ours


class NotBuiltIn(Exception):
    """The robot's firmware was built without what was asked for."""

    def __init__(self, feature: str) -> None:
        super().__init__(f"the robot's firmware was built without the feature `{feature}`")
        self.feature = feature


class Refused(Exception):
    """The robot refused a request."""

    def __init__(self, name: str, error: Error) -> None:
        super().__init__(f"the robot refused `{name}`: {error}")
        self.error = error


def open_port(name: str, baud: int = 115_200):
    """Opens a serial line, or what else pyserial has a URL for (socket://HOST:PORT)."""
    import serial

    return serial.serial_for_url(name, baudrate=baud, timeout=0)


class _Patience:
    """A look at the clock counts for no more than a second: who looks seldomer was suspended, and has heard nothing meanwhile."""

    def __init__(self) -> None:
        self.started = self.looked = time.monotonic()
        self.spent = self.silent = 0.0
        self.spoiled = 0
        # The robot has answered `Malformed` already. Noise whose checksum is right comes once; a firmware that does not know the request never does.
        self.is_misunderstood = False

    def look(self) -> None:
        now = time.monotonic()
        self._count(min(now - self.looked, LONGEST_LOOK_S), now)

    def adopt(self, other: "_Patience") -> None:
        self._count(other.spent, other.looked)
        self.spoiled += other.spoiled

    def _count(self, seconds: float, now: float) -> None:
        self.looked = now
        self.spent += seconds
        self.silent += seconds

    def heard(self, spoiled: int, whole: int) -> None:
        """So many frames came, spoiled and whole."""
        self.spoiled += spoiled
        if spoiled or whole:
            self.silent = 0.0

    def lasts(self) -> bool:
        return self.silent < SILENT_DEADLINE_S and self.spent < NOISY_DEADLINE_S

    def check(self, name: str) -> None:
        if not self.lasts():
            what = f"the robot did not answer `{name}` within {self.spent:.1f} s"
            if self.spoiled:
                what += f"; {self.spoiled} frames came spoiled: look at cable, plugs and ground, or give the line a lower rate at both ends"
            raise NoReply(what)

    def is_fresh(self) -> bool:
        """Whether the person who asked still expects it: what was put off for longer is not sent anew."""
        return time.monotonic() - self.started < SILENT_DEADLINE_S


class _ReplyTime:
    """What answers took, and how long the next one is waited for."""

    def __init__(self) -> None:
        self._estimate: Optional[Tuple[float, float]] = None

    def is_known(self) -> bool:
        return self._estimate is not None

    def seen(self, took: float) -> None:
        if self._estimate is None:
            self._estimate = (took, took / 2)
        else:
            mean, deviation = self._estimate
            self._estimate = ((mean * 7 + took) / 8, (deviation * 3 + abs(mean - took)) / 4)

    def wait(self, attempt: int, request_bytes: int) -> float:
        if self._estimate is None:
            base = FIRST_WAIT_S
        else:
            mean, deviation = self._estimate
            base = max(SHORTEST_WAIT_S, mean + 4 * deviation)
        return min(LONGEST_WAIT_S, (base + BYTE_TIME_S * request_bytes) * 2 ** min(MOST_DOUBLINGS, attempt // 3))


class Client:
    """Talks to the robot behind `port`, which has `read(size)`, `write(bytes)` and `timeout` as a `serial.Serial` has. `hello` comes first.

    `key` signs what a robot that has a key takes from nobody else.
    """

    def __init__(self, port, number: Optional[int] = None, key: Optional[Key] = None) -> None:
        self._port = port
        self._key = key
        # Of the upload that was signed last.
        self._signed_upload = NO_UPLOAD
        # Not the number that the client before began with: its answers may still be on the line.
        self._seq = time.time_ns() // 1_000_000 % 256 if number is None else number
        self._reader = FrameReader()
        self._reply_time = _ReplyTime()
        self._robot: Optional[messages.Hello] = None
        self._features: Optional[messages.Features] = None
        self._other_version: Optional[int] = None
        #: Requests and chunks that were sent again.
        self.retries = 0
        self._end_streams()

    def _end_streams(self) -> None:
        """Streams end here; those that come from now on are numbered anew."""
        self._trace = Assembler()
        self._records: List[dict] = []
        self._news: List[messages.News] = []
        self._recorded: List[Part] = []
        self._values: List[Part] = []
        #: Log bytes that came in this session.
        self.log = bytearray()
        # What comes before this session has asked for streams is of another one.
        self._has_asked_for_streams = False

    # What a robot can be asked.

    def hello(self) -> messages.Hello:
        self._end_streams()
        robot = self._ask("hello", messages.Hello, messages.HELLO)
        if robot.protocol != messages.PROTOCOL_VERSION:
            raise OtherVersion(robot.protocol)
        self._robot = robot
        # It may have another firmware than before.
        self._features = None
        return robot

    def features(self) -> messages.Features:
        """What the robot's firmware was built with. It is asked once a session."""
        if self._features is None:
            patience = _Patience()
            # A firmware of before there was this request does not understand it, however often it is sent; noise comes once.
            for _ in range(2):
                body = self._exchange("features", patience, messages.FEATURES)
                if isinstance(body, messages.Features):
                    break
                if not isinstance(body, Error):
                    raise Malformed(f"the robot answered `features` with {body}")
                if body.name != "Malformed":
                    raise Refused("features", body)
                body = messages.UNTOLD
            self._features = body
        return self._features

    def require(self, feature: str) -> None:
        """Raises NotBuiltIn where the robot's firmware was built without this, before anything is asked for that needs it."""
        if not self.features().has(feature):
            raise NotBuiltIn(feature)

    def status(self) -> messages.Status:
        return self._ask("status", messages.Status, messages.STATUS)

    def clock(self) -> int:
        """Microseconds since the robot started, by its own clock."""
        return self._ask("clock", messages.Clock, messages.CLOCK).now_us

    def stop(self) -> None:
        self._ask("stop", messages.Done, messages.STOP)

    def emergency_stop(self) -> None:
        """Motors off, over missions and resets, until `release`."""
        self._ask("emergency stop", messages.Done, messages.EMERGENCY_STOP)

    def release(self) -> None:
        """Ends an emergency stop: the robot is stopped then, and `start` starts it."""
        self._command("release", messages.Done, messages.RELEASE)

    def start(self) -> None:
        self._command("start", messages.Done, messages.START)

    def last_words(self) -> messages.LastWords:
        """How the robot's run before this one ended."""
        return self._ask("last words", messages.LastWords, messages.LAST_WORDS)

    def black_box(self) -> List[messages.Record]:
        """What the flight recorder holds, oldest first."""

        def is_before(sequence: int, other: int) -> bool:
            # They wrap.
            return (sequence - other) % 2**32 >= 2**31

        records: List[messages.Record] = []
        asked = end = None
        while True:
            begin = (False,) if asked is None else (True, asked)
            part = self._ask("black box", messages.BlackBox, messages.BLACK_BOX, *begin)
            # What is written while this reads is for the next time.
            end = part.end if end is None else end
            if not part.records:
                return records
            records += [record for record in part.records if is_before(record.sequence, end)]
            following = (part.records[-1].sequence + 1) % 2**32
            # A robot that goes back would be asked forever.
            if not is_before(following, end) or (asked is not None and not is_before(asked, following)):
                return records
            asked = following

    def param(self, mission: int, index: int) -> messages.Param:
        """Bits of a parameter of the running mission, and of the value that the mission gives it."""
        self.require("params")
        return self._ask("param", messages.Param, messages.PARAM, mission, index)

    def set_param(self, mission: int, index: int, value: int) -> int:
        """Gives a parameter of the running mission another value, by its bits. Returns the bits of the value before."""
        self.require("params")
        return self._command("set param", messages.ParamSet, messages.SET_PARAM, mission, index, value).before

    def save_params(self, mission: int) -> int:
        """Lets the robot keep the values that differ now, and start the mission with them from now on. Returns how many there are."""
        self.require("params")
        self.require("store")
        return self._command("save params", messages.ParamsSaved, messages.SAVE_PARAMS, mission).count

    def abort(self) -> None:
        self._ask("abort", messages.Done, messages.ABORT)

    def subscribe(self, trace: bool = False, log: bool = False, record: bool = False) -> None:
        for feature, wanted in (("log", log), ("record", record)):
            if wanted:
                self.require(feature)
        self._ask("subscribe", messages.Done, messages.SUBSCRIBE, trace, log, record)

    def watch(self, period_ms: Optional[int] = 0) -> None:
        """Lets the robot tell whenever its mission, the trial of that or its mode changes, and each period of the mission's time; with None no more."""
        if period_ms is not None:
            self.require("news")
        self._ask("watch", messages.Done, messages.WATCH, period_ms is not None, period_ms or 0)

    def news(self, seconds: float) -> Iterator[messages.News]:
        """News as they come, for so long. `watch` asks for them."""
        return self._listen(seconds, self._news)

    def fields(self, mission: int, net: int) -> List[Field]:
        """What values on a net of the mission are made of, by its index in the blob."""
        self.require("telemetry")
        text, total = b"", 1
        while len(text) < total:
            part = self._ask("fields", messages.TaskText, messages.VALUES, ask_fields(mission, net, len(text)))
            text, total = text + part.text, part.total
            if not part.text:
                break
        return fields_of(text.decode())

    def watch_values(self, mission: int, nets: List[int], period_ms: int = 0) -> int:
        """Lets the robot send values on these nets of the mission, by their indices in its blob, each period of the mission's time at most, or after each macro step.

        Returns the number that these samples have.
        """
        self.require("telemetry")
        self._ask("values", messages.Done, messages.VALUES, ask_values(mission, period_ms, nets))
        return self._seq

    def end_values(self) -> None:
        self._ask("values", messages.Done, messages.VALUES, b"")

    def values(self, number: int, nets: List[List[Field]], seconds: float) -> Iterator[Sample]:
        """Samples of this number as they come, for so long or until the mission is another one. `watch_values` asks for them; `nets` is what `fields` said of each."""
        for part in map(part_of, map(lambda part: part.bytes, self._listen(seconds, self._values))):
            if part.number != number:
                continue
            if part.ended:
                return
            yield sample_of(part, nets)

    def task(self, index: int) -> str:
        """The declaration of a task type, as `.esm` text."""
        text, total = b"", 1
        while len(text) < total:
            part = self._ask("task", messages.TaskText, messages.TASK, messages.U8(index), len(text))
            text, total = text + part.text, part.total
            if not part.text:
                break
        return text.decode()

    def read_blob(self) -> bytes:
        """The blob of the mission that runs."""
        # A robot that falls back while it is read gives parts of two missions, whose checksum is that of neither.
        for _ in range(BLOB_READS):
            blob = self._read_blob_once()
            if zlib.crc32(blob[:-4]) == int.from_bytes(blob[-4:], "little"):
                return blob
        raise Malformed(f"the blob of the running mission has not its checksum, {BLOB_READS} times in a row")

    def _read_blob_once(self) -> bytes:
        blob, total = b"", 1
        while len(blob) < total:
            part = self._ask("read the mission", messages.Blob, messages.READ_BLOB, len(blob))
            blob, total = blob + part.data, part.total
            if not part.data:
                break
        return blob

    def trace(self, seconds: float) -> Iterator[dict]:
        """Trace records as they come, for so long. `subscribe` asks for them."""
        return self._listen(seconds, self._records)

    def record(self, seconds: float) -> Iterator[Part]:
        """Parts of the recording as they come, for so long; section 9 says what is in them. `subscribe` asks for them."""
        return self._listen(seconds, self._recorded)

    def _listen(self, seconds: float, came: list) -> Iterator:
        end = time.monotonic() + seconds
        while True:
            yield from came
            came.clear()
            left = end - time.monotonic()
            if left <= 0:
                return
            self._receive(left)

    # Uploads.

    def upload(self, blob: bytes, progress: Optional[Callable[[int], None]] = None, trial_ms: int = 0, warm: bool = False) -> int:
        """Brings a mission to the robot and lets it take over, on trial for so long if that is above 0. Returns its hash when it runs."""
        if warm:
            self.require("warm")
        self.stage(blob, progress)
        return self._command("commit", messages.Committed, messages.COMMIT, warm, trial_ms).mission

    def confirm(self, mission: int) -> None:
        """The mission of this hash, which is on trial, is to stay."""
        self._command("confirm", messages.Done, messages.CONFIRM, mission)

    def fall_back(self, mission: int) -> None:
        """Back to the mission before the one of this hash, which is on trial."""
        self._command("fall back", messages.Done, messages.FALL_BACK, mission)

    def stage(self, blob: bytes, progress: Optional[Callable[[int], None]] = None) -> None:
        """Brings a mission to the robot without letting it take over."""
        robot = self._robot or self.hello()
        loss = Loss()
        stuck = Refused("upload", Error("NoUpload", {}))
        for _ in range(BEGIN_LIMIT):
            there = self._ask("upload", messages.Received, messages.BEGIN, len(blob), zlib.crc32(blob)).len
            standing = Standing(len(blob), there, robot.chunk_bytes, robot.window_bytes)
            if not self._send_from(blob, standing, loss, progress or (lambda _: None)):
                continue
            if not self._is_locked():
                return
            try:
                return self._sign_upload(blob)
            except Refused as refused:
                # The key is the robot's, so that the bytes are others: somebody has sent them under this checksum, or something else meanwhile.
                if refused.error.name not in ("WrongSignature", "NoUpload", "Incomplete"):
                    raise
                stuck = refused
        raise stuck

    def _send_from(self, blob: bytes, standing: Standing, loss: Loss, progress: Callable[[int], None]) -> bool:
        """Sends what the robot lacks. False where it has forgotten the upload."""
        chunk_time = _ReplyTime()
        attempt = 0
        patience = _Patience()
        last_sign = time.monotonic()
        progress(standing.there)
        while standing.there < len(blob):
            before = standing.there
            wait = None
            chunk = standing.next_chunk(loss)
            if chunk is not None:
                self.retries += chunk[0] < standing.unsent
                self._seq = (self._seq + 1) % 256
                self._write(messages.request(self._seq, messages.CHUNK, chunk[0], blob[chunk[0] : chunk[1]]))
                last_sign = time.monotonic()
                standing.chunk_sent(self._seq, chunk, last_sign)
            elif chunk_time.is_known():
                wait = chunk_time.wait(attempt, 0)
            else:
                wait = self._reply_time.wait(attempt, standing.on_the_way())
            left = 0.0 if wait is None else max(0.0, last_sign + wait - time.monotonic())
            spoiled = self._reader.spoiled
            answers = self._receive(left, patience)
            now = time.monotonic()
            patience.heard(self._reader.spoiled - spoiled, len(answers))
            if answers or self._reader.spoiled != spoiled:
                attempt = 0
            for answer in answers:
                body = answer.body
                if isinstance(body, messages.Received):
                    there = body.len
                elif isinstance(body, Error) and body.name == "WrongOffset":
                    there = body.fields["expected"]
                elif isinstance(body, Error) and body.name == "Malformed":
                    there = standing.there
                elif isinstance(body, Error) and standing.is_sent(answer.seq):
                    if body.name == "NoUpload":
                        return False
                    raise Refused("upload", body)
                else:
                    continue
                sent = standing.take(answer.seq, there, loss)
                if sent is not None:
                    chunk_time.seen(now - sent)
                    last_sign = now
            if standing.there > before:
                progress(standing.there)
                patience = _Patience()
            else:
                patience.check("upload")
            if wait is not None and time.monotonic() - last_sign >= wait:
                attempt += 1
                standing.give_up_what_was_sent(loss)
                last_sign = time.monotonic()
        return True

    # Keys (section 13).

    def install_key(self, key: Key, seed: Optional[bytes] = None) -> None:
        """From now on the robot takes commands only if this key has signed them. It must have none, or the session's.

        The seed is what the robot makes its nonces from: 16 bytes that nobody can guess, or those of the system.
        """
        self.require("keys")
        seed = new_seed() if seed is None else seed
        self._change_key("install a key", messages.INSTALL_KEY, key.public, seed, key.sign_installation(seed))
        self._key = key

    def remove_key(self) -> None:
        """From now on the robot takes commands from anyone."""
        self.require("keys")
        self._change_key("remove the key", messages.REMOVE_KEY)

    def _change_key(self, name: str, kind: int, *fields) -> None:
        """Has the key changed, and asks what holds then: also where the flash is said not to have taken it."""
        try:
            self._key_command(name, messages.Done, kind, *fields)
        except Refused as refused:
            if refused.error.name == "NotKept":
                self.hello()
            raise
        self.hello()

    def _is_locked(self) -> bool:
        return (self._robot or self.hello()).access == "locked"

    def _challenge(self) -> Tuple[Key, messages.Challenge]:
        challenge = self._ask("challenge", messages.Challenge, messages.CHALLENGE)
        if self._key is None or self._key.public != challenge.key:
            raise OtherKey(challenge.key, None if self._key is None else self._key.public)
        return self._key, challenge

    def _sign_upload(self, blob: bytes) -> None:
        key, challenge = self._challenge()
        counter = challenge.counter + 1
        signature = key.sign(upload_message(counter, blob))
        self._ask("sign", messages.Done, messages.SIGN, counter, signature)
        self._signed_upload = signature

    def _command(self, name: str, wanted: type, kind: int, *fields):
        """Asks for something that changes what the robot does. It is not done after its answer was waited for, and a robot that has a key takes it signed only."""
        longer = self._longer(kind)
        begun = _Patience()
        while True:
            by_us = self.clock() + COMMAND_TIME_US
            # From here on, so that nobody gives up before that time.
            patience = _Patience()
            fields_in_time = (by_us, messages.without_number(kind, *fields))
            if self._is_locked():
                upload = self._signed_upload if kind == messages.COMMIT else NO_UPLOAD
                body = self._exchange_signed(name, patience, upload, messages.WITHIN, *fields_in_time, longer=longer)
            else:
                body = self._exchange(name, patience, messages.WITHIN, *fields_in_time, longer=longer)
            begun.adopt(patience)
            if not self._is_to_repeat(name, wanted, body, begun):
                return body

    def _key_command(self, name: str, wanted: type, kind: int, *fields):
        """Asks for something that is about keys. A robot that has one takes it signed only."""
        longer = self._longer(kind)
        patience = _Patience()
        while True:
            if self._is_locked():
                body = self._exchange_signed(name, patience, NO_UPLOAD, kind, *fields, longer=longer)
            else:
                body = self._exchange(name, patience, kind, *fields, longer=longer)
            if not self._is_to_repeat(name, wanted, body, patience):
                return body

    def _longer(self, kind: int) -> float:
        """Seconds that the robot may take longer for this than for others."""
        return self.features().flash_ms / 1000 if kind in KEPT else 0.0

    def _exchange_signed(self, name: str, patience: _Patience, upload: bytes, kind: int, *fields, longer: float) -> object:
        """One exchange: it cannot be sent a second time after an answer, for the nonce is used up."""
        request = messages.without_number(kind, *fields)
        key, challenge = self._challenge()
        signature = key.sign(command_message(challenge.nonce, upload, request))
        return self._exchange(name, patience, messages.SIGNED, signature, request, longer=longer)

    # Requests.

    def _is_to_repeat(self, name: str, wanted: type, body: object, patience: _Patience) -> bool:
        """Whether an answer says to ask once more; otherwise it is the one that was wanted, or the end."""
        if isinstance(body, wanted):
            return False
        if not isinstance(body, Error):
            raise Malformed(f"the robot answered `{name}` with {body}")
        if body.name == "Malformed":
            is_worth_while = not patience.is_misunderstood
            patience.is_misunderstood = True
        elif body.name == "Late":
            is_worth_while = patience.is_fresh()
        else:
            # Somebody else has sent it a wrong signature, where it is too soon.
            is_worth_while = body.name in ("Busy", "NoAnswer", "TooSoon") and patience.lasts()
        if not is_worth_while:
            raise Refused(name, body)
        time.sleep(min(body.fields["ms"] / 1000, LONGEST_PAUSE_S) if body.name == "TooSoon" else BUSY_WAIT_S)
        patience.look()
        return True

    def _ask(self, name: str, wanted: type, kind: int, *fields):
        patience = _Patience()
        while True:
            body = self._exchange(name, patience, kind, *fields)
            if not self._is_to_repeat(name, wanted, body, patience):
                return body

    def _exchange(self, name: str, patience: _Patience, kind: int, *fields, longer: float = 0.0) -> object:
        self._seq = (self._seq + 1) % 256
        request = messages.request(self._seq, kind, *fields)
        self._other_version = None
        self._has_asked_for_streams |= kind in (messages.SUBSCRIBE, messages.WATCH, messages.VALUES)
        is_first = True
        # Sendings in a row of which nothing was heard: a line that brings spoiled frames is bad, and not slow.
        attempt = 0
        heard_within = None
        while True:
            self._write(request)
            sent = time.monotonic()
            known = self._reply_time
            if heard_within is not None and not known.is_known():
                known = _ReplyTime()
                known.seen(heard_within)
            wait = known.wait(attempt, len(request) + 7)
            deadline = sent + (max(wait, VERIFICATION_WAIT_S) if kind in VERIFIED else wait) + longer
            attempt += 1
            while time.monotonic() < deadline:
                spoiled = self._reader.spoiled
                answers = self._receive(max(0.0, deadline - time.monotonic()), patience)
                if kind == messages.HELLO and self._other_version is not None:
                    raise OtherVersion(self._other_version)
                patience.heard(self._reader.spoiled - spoiled, len(answers))
                if self._reader.spoiled != spoiled:
                    attempt = 0
                    heard_within = max(heard_within or 0.0, time.monotonic() - sent)
                    deadline = min(deadline, time.monotonic() + SPOILED_WAIT_S)
                for answer in answers:
                    # With the number that a session happens to begin with, an answer of the session before may still be on its way.
                    is_old = kind == messages.HELLO and not isinstance(answer.body, messages.Hello)
                    if answer.seq == self._seq and not is_old:
                        took = time.monotonic() - sent
                        if longer or kind in VERIFIED:
                            # It says nothing of others.
                            pass
                        elif is_first:
                            self._reply_time.seen(took)
                        elif heard_within is not None and not self._reply_time.is_known():
                            # On a bad line few are answered the first time: better this than nothing.
                            self._reply_time.seen(max(took, heard_within))
                        return answer.body
            patience.check(name)
            is_first = False
            self.retries += 1

    # Bytes.

    def _write(self, message: bytes) -> None:
        try:
            # The delimiter in front gives noise an end.
            self._port.write(DELIMITER + encode(message))
        except OSError as cause:
            raise LinkLost(f"the line to the robot is lost: {cause}") from cause

    def _receive(self, timeout: float, patience: Optional[_Patience] = None) -> List[Answer]:
        """Takes what the line has, waiting so long for its first byte. Streams are kept, answers returned."""
        try:
            self._port.timeout = timeout
            received = self._port.read(1)
            if received:
                self._port.timeout = 0
                received += self._port.read(4096)
        except OSError as cause:
            raise LinkLost(f"the line to the robot is lost: {cause}") from cause
        if patience is not None:
            patience.look()
        answers = []
        for message in self._reader.feed(received):
            try:
                read = messages.from_robot(message)
            except Malformed:
                self._other_version = messages.version_in_hello(message)
                self._reader.spoiled += 1
                continue
            if isinstance(read, Answer):
                answers.append(read)
            elif not self._has_asked_for_streams:
                continue
            elif isinstance(read, messages.News):
                self._news.append(read)
            elif read.channel == "trace":
                self._records += self._trace.take(read)
            elif read.channel == "log":
                self.log += read.bytes
            elif read.channel == "record":
                self._recorded.append(read)
            else:
                self._values.append(read)
        return answers
