"""A session with a robot (sections 4, 6 and 10 of docs/link.md)."""

import struct
import time
import zlib
from dataclasses import dataclass
from typing import Callable, Dict, Iterator, List, Optional, Sequence, Tuple, Union

from . import messages
from .frames import DELIMITER, FrameReader, encode
from .keys import LAST_NUMBER, NO_UPLOAD, Key, OwnerSession, command_message, identity_proof, is_same, random_bytes, upload_message
from .messages import Answer, Error, Malformed, Part, Raw
from .trace import Assembler
from .upload import Loss, Standing
from .values import Field, Sample, ask_fields, ask_values, fields_of, param_bits, part_of, sample_of

FIRST_WAIT_S = 0.3
SHORTEST_WAIT_S = 0.04
LONGEST_WAIT_S = 1.0
BYTE_TIME_S = 0.0005
SPOILED_WAIT_S = 0.01
# A robot hears of a client that listens as often as this: a mission may watch for its host.
CALL_INTERVAL_S = 0.2
BUSY_WAIT_S = 0.005
LONGEST_LOOK_S = 1.0
# No robot looks at no signature for longer.
LONGEST_PAUSE_S = 2.0
SILENT_DEADLINE_S = 6.0
NOISY_DEADLINE_S = 30.0
# A robot does not do what it is asked for after nobody waits for it any more: a client gives up no sooner.
COMMAND_TIME_US = int(SILENT_DEADLINE_S * 1_000_000)

# How long a movement by hand may last, and how long the robot's clock is believed before it is asked again.
DRIVE_US = 300_000
CLOCK_BELIEVED_S = 10.0
DRIVE = "drive"

# Before their answers the robot may write its flash.
KEPT = (
    messages.COMMIT, messages.CONFIRM, messages.FALL_BACK, messages.SAVE_PARAMS, messages.RELEASE, messages.INSTALL_KEY, messages.REMOVE_KEY,
)  # fmt: skip

# Before their answers the robot verifies a signature, which takes it a tenth of a second or more.
VERIFIED = (messages.SIGNED, messages.SIGN, messages.INSTALL_KEY)
VERIFICATION_WAIT_S = 0.5

BLOB_READS = 5
# Its length is told in 16 bits.
LONGEST_TEXT = 2**16 - 1
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


class Unproven(Exception):
    """Answers came, and none with the proof that it is the robot's own."""

    def __init__(self, name: str) -> None:
        super().__init__(
            f"answers to `{name}` came, but none is proven to be the robot's own: "
            "somebody answers in its place, or the robot has lost what it shares with its owner"
        )


class NotLocked(Exception):
    """A key was named, and the robot says that it has none, or that it cannot read it."""

    #: Why that may be, and what to do if it is true, for each `access`.
    _HINTS = {
        "unsupported": ("it has other firmware", "with this firmware it cannot have a key: name none here"),
        "open": ("its memory was erased", "without a key named here it takes commands as they are, and can be given a key again"),
        "unreadable": ("its memory is damaged", "it takes no key and no commands but stops: erase its flash at the programmer"),
        "damaged": (
            "its memory is damaged, and had no key",
            "without a key named here it can be given one, which begins its memory anew; until then it takes no commands but stops",
        ),
    }

    def __init__(self, access: str) -> None:
        reason, what_to_do = self._HINTS[access]
        super().__init__(
            f"a key was named, and the robot does not say that it has one (its access is `{access}`): {reason}, "
            f"or somebody answers in its place. If it is the robot, {what_to_do}"
        )
        self.access = access


class NotStopped(Exception):
    """The robot took a stop, and does not stand still."""

    def __init__(self, name: str, mode: str) -> None:
        super().__init__(f"the robot took `{name}`, but its mode is `{mode}`: somebody else commands it. Switch it off by hand")
        self.mode = mode


class OtherKey(Exception):
    """The robot has another key than this client, or this client has none."""

    def __init__(self, robot: bytes, ours: Optional[bytes]) -> None:
        have = "this client has none" if ours is None else f"this one is {ours.hex()}"
        super().__init__(f"the robot has the key {robot.hex()}, {have}")
        self.robot = robot
        self.ours = ours


class NotBuiltIn(Exception):
    """The robot's firmware was built without what was asked for."""

    def __init__(self, feature: str) -> None:
        super().__init__(f"the robot's firmware was built without the feature `{feature}`")
        self.feature = feature


class _OtherTotal(Exception):
    """Parts of the same told that it has different lengths."""


class Refused(Exception):
    """The robot refused a request."""

    def __init__(self, name: str, error: Error, may_be_done: bool = False) -> None:
        lost = "; a session ended before it was answered, so that it may have been done before: `status` tells"
        super().__init__(f"the robot refused `{name}`: {error}{lost if may_be_done else ''}")
        self.error = error
        #: It was asked for in a session before, and was not answered there.
        self.may_be_done = may_be_done


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
        # It was asked for in a session that has ended, or of which somebody said so.
        self.has_lost_session = False

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

    def check(self, name: str, is_unproven: bool = False) -> None:
        """Raises once it is over; where answers came without the right proof, it says so."""
        if not self.lasts():
            if is_unproven:
                raise Unproven(name)
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


@dataclass
class _Frame:
    """A request as it is sent, and what its answer must be."""

    seq: int
    message: bytes
    #: Its kind, or that of the request that it holds.
    kind: int
    #: With which its answer is proven, if it must be, and its number there.
    session: Optional[OwnerSession] = None
    number: int = 0

    def is_answered_by(self, answer: Answer) -> bool:
        """Whether an answer says that it is to this request. Who said so is another question."""
        return answer.seq == self.seq and answer.is_to(self.kind)

    def accepts(self, answer: Answer) -> bool:
        """Whether an answer is the robot's own, as far as anybody can tell."""
        if self.session is None or answer.proof is None:
            return self.session is None and answer.proof is None
        return is_same(answer.proof, self.session.answer_proof(self.number, answer.proven))

    def is_ended_by(self, answer: Answer) -> bool:
        """Whether the robot knows nothing of the session. Whoever says so without a proof can do no more than have another one opened."""
        # A robot that does not take the proof does not look at what is in `Proven`.
        is_to_it = answer.seq == self.seq and answer.of in (self.kind, messages.PROVEN)
        if self.session is None or not is_to_it or answer.proof is not None or not isinstance(answer.body, Error):
            return False
        has_expired = self.kind == messages.OPEN_SESSION and answer.body.name == "NoChallenge"
        return has_expired or answer.body.name in ("NoSession", "WrongProof")


class Client:
    """Talks to the robot behind `port`, which has `read(size)`, `write(bytes)` and `timeout` as a `serial.Serial` has. `hello` comes first.

    `key` is that of the robot's owner: it opens a session, and signs what the robot takes from nobody else. With `insist`, which is so where
    a key is given and nothing else is said, a robot that says that it has no key, or shows another one, is refused: somebody may answer in its
    place. Without a key a robot that has one can be read and stopped.
    """

    def __init__(self, port, number: Optional[int] = None, key: Optional[Key] = None, insist: Optional[bool] = None) -> None:
        self._port = port
        # Of the robot's owner, once it is open.
        self._session: Optional[OwnerSession] = None
        self.use_key(key, insist)
        # Lets the robot hear that somebody is here, until it is answered.
        self._calling: Optional[_Frame] = None
        self._sent_at = time.monotonic()
        # Of the upload that was signed last.
        self._signed_upload = NO_UPLOAD
        # Not the number that the client before began with: its answers may still be on the line.
        self._seq = time.time_ns() // 1_000_000 % 256 if number is None else number
        self._reader = FrameReader()
        self._reply_time = _ReplyTime()
        self._robot: Optional[messages.Hello] = None
        # What its clock said, and when that was here.
        self._robot_clock: Optional[Tuple[int, float]] = None
        self._features: Optional[messages.Features] = None
        self._other_version: Optional[int] = None
        #: Requests and chunks that were sent again.
        self.retries = 0
        self._end_streams()

    def _end_streams(self) -> None:
        """Streams end here; those that come from now on are numbered anew."""
        self._trace = Assembler()
        self._records: List[dict] = []
        self._news: List[messages.StatusEvent] = []
        self._recorded: List[Part] = []
        self._values: List[Part] = []
        #: Log bytes that came in this session.
        self.log = bytearray()
        # What comes before this session has asked for streams is of another one.
        self._has_asked_for_streams = False

    def use_key(self, key: Optional[Key], insist: Optional[bool] = None) -> None:
        """From now on this client has that key, or none; `insist` as in `Client`. A session with another one ends."""
        self._key = key
        self._insists = key is not None if insist is None else insist
        # There is no session to be had with this key.
        self._only_reads = False
        self._session = None

    # What a robot can be asked.

    def hello(self) -> messages.Hello:
        self._end_streams()
        robot = self._ask("hello", messages.Hello, messages.HELLO)
        self._robot = robot
        # It may have another firmware than before. Its session goes on: anybody may have said this.
        self._features = None
        self._only_reads = False
        return robot

    def features(self) -> messages.Features:
        """What the robot's firmware was built with. It is asked once a session."""
        if self._features is None:
            try:
                self._features = self._ask("features", messages.Features, messages.FEATURES)
            except Refused as refused:
                # A firmware of before there was this request does not understand it, however often it is sent.
                if refused.error.name != "Malformed":
                    raise
                self._features = messages.UNTOLD
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
        """Motors off, until `start`. This goes out before anything else; only a robot that says then that it does not run counts as stopped."""
        self._halt("stop", messages.STOP, lambda mode: mode != "running")

    def emergency_stop(self) -> None:
        """Motors off, over missions and resets, until `release`."""
        self._halt("emergency stop", messages.EMERGENCY_STOP, lambda mode: mode == "emergency stop")

    def send_stop(self) -> None:
        """Sends a stop and waits for nothing. Whether the robot has stopped, `stop` tells."""
        self._write(self._plain_frame(messages.without_number(messages.STOP)))

    def _halt(self, name: str, kind: int, is_stopped: Callable[[str], bool]) -> None:
        if self._robot is None or self._key is not None:
            # Before anything else, whatever else is the matter. Without a key this is what is asked below.
            self._write(self._plain_frame(messages.without_number(kind)))
        if self._robot is None:
            self.hello()
        problem: Optional[Exception] = None
        try:
            self._enter_session(kind, _Patience())
        except (NotLocked, OtherKey, Refused, Unproven) as other:
            # Everyone may stop a robot: it is done as strangers do, and told then.
            problem = other
        is_owner = problem is None
        try:
            self._ask(name, messages.Done, kind, enters=is_owner)
        except Refused as refused:
            # It is stopped all the same.
            if refused.error.name != "StopNotStored":
                raise
            problem = problem or refused
        mode = self._ask("status", messages.Status, messages.STATUS, enters=is_owner).mode
        if not is_stopped(mode):
            raise NotStopped(name, mode)
        if problem is not None:
            raise problem

    def identity(self) -> messages.Identity:
        """Who the robot says that it is. Anybody may answer in its place: only in a session it has shown it."""
        return self._ask("identify", messages.Identity, messages.IDENTIFY, Raw(random_bytes()))

    def release(self) -> None:
        """Ends an emergency stop: the robot is stopped then, and `start` starts it."""
        self._command("release", messages.Done, messages.RELEASE)

    def start(self) -> None:
        self._command("start", messages.Done, messages.START)

    def crash_report(self) -> messages.CrashReport:
        """How the robot's run before this one ended."""
        return self._ask("last words", messages.CrashReport, messages.CRASH_REPORT)

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

    def behaviours(self) -> messages.BehaviourList:
        """What stands on the list of behaviours, and how the script is."""
        self.require("behaviours")
        return self._ask("list behaviours", messages.BehaviourList, messages.BEHAVIOUR_LIST)

    def insert_behaviour(self, task: int, params: Sequence[Union[float, int, bool]], at_head: bool = False) -> int:
        """Inserts a behaviour by the hash of its task's signature, with all its parameters: an `f32` as a float, others as int or bool.

        Returns its key.
        """
        self.require("behaviours")
        call = (messages.U8(1 if at_head else 0), task, param_bits(params), b"")
        return self._command("insert behaviour", messages.Behaviour, messages.BEHAVIOURS, *call).key

    def cancel_behaviour(self, key: int) -> None:
        """Takes a behaviour off the list."""
        self.require("behaviours")
        self._command("cancel behaviour", messages.Done, messages.BEHAVIOURS, messages.U8(2), key)

    def kept_script(self) -> messages.BehaviourList:
        """The script that the robot keeps: `script` is 0 where there is none, `state` is `runs` where it starts with the mission that runs."""
        self.require("behaviours")
        return self._command("kept script", messages.BehaviourList, messages.BEHAVIOURS, messages.U8(12))

    def keep_script(self, script: int) -> None:
        """Lets the robot keep the script that was run last, and run it each time that it starts with the mission that runs now."""
        self.require("behaviours")
        self.require("store")
        self._command("keep script", messages.Done, messages.BEHAVIOURS, messages.U8(11), script)

    def remove_script(self) -> None:
        """Lets the robot keep no script any more. What runs goes on."""
        self.require("behaviours")
        self.require("store")
        self._command("remove script", messages.Done, messages.BEHAVIOURS, messages.U8(11), 0)

    def drive(self, forward_m_per_s: float, turn_rad_per_s: float) -> None:
        """Moves the robot by hand for 300 ms at most: ask again four times a second or more, as long as it is to last.

        What it is asked for comes before all that it does otherwise, which goes on afterwards.
        """
        self.require("behaviours")
        now = time.monotonic()
        if self._robot_clock is None or now - self._robot_clock[1] > CLOCK_BELIEVED_S:
            self._robot_clock = (self.clock(), time.monotonic())
        robot_us, read = self._robot_clock
        until_us = robot_us + int((time.monotonic() - read) * 1_000_000) + DRIVE_US
        speeds = messages.Raw(struct.pack("<ff", forward_m_per_s, turn_rad_per_s))
        try:
            self._ask(DRIVE, messages.Done, messages.DRIVE, speeds, until_us)
        except Refused:
            self._robot_clock = None
            raise

    def end_drive(self) -> None:
        """Drives by hand no more."""
        self._ask("end drive", messages.Done, messages.END_DRIVE)

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

    def news(self, seconds: float) -> Iterator[messages.StatusEvent]:
        """Status events as they come, for so long. `watch` asks for them."""
        return self._listen(seconds, self._news)

    def fields(self, mission: int, net: int) -> List[Field]:
        """What values on a net of the mission are made of, by its index in the blob."""
        self.require("telemetry")
        return fields_of(self._read_text("fields", lambda offset: (messages.VALUES, ask_fields(mission, net, offset))))

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
        return self._read_text("task", lambda offset: (messages.TASK, messages.U8(index), offset))

    def read_blob(self) -> bytes:
        """The blob of the mission that runs."""
        # A robot that falls back while it is read gives parts of two missions, whose checksum is that of neither.
        for _ in range(BLOB_READS):
            blob = self._read_blob_once()
            if blob is not None and zlib.crc32(blob[:-4]) == int.from_bytes(blob[-4:], "little"):
                return blob
        raise Malformed(f"the blob of the running mission has not its checksum, {BLOB_READS} times in a row")

    def _read_blob_once(self) -> Optional[bytes]:
        """None where parts told different lengths: they are of two missions."""
        limit = (self._robot or self.hello()).blob_bytes
        try:
            return self._read_all("read the mission", limit, messages.Blob, lambda offset: (messages.READ_BLOB, offset))
        except _OtherTotal:
            return None

    def _read_text(self, name: str, request: Callable[[int], tuple]) -> str:
        try:
            return self._read_all(name, LONGEST_TEXT, messages.TaskText, request).decode()
        except (UnicodeDecodeError, _OtherTotal) as cause:
            raise Malformed(f"the robot answered `{name}` with parts that are no text") from cause

    def _read_all(self, name: str, limit: int, wanted: type, request: Callable[[int], tuple]) -> bytes:
        """Reads what comes in parts, each asked for by its offset. What never ends, or is longer than it can be, is refused."""
        whole, total = b"", None
        while total is None or len(whole) < total:
            part = self._ask(name, wanted, *request(len(whole)))
            if total is not None and part.total != total:
                raise _OtherTotal(name)
            total = part.total
            if total > limit:
                raise Malformed(f"the robot answered `{name}` with {total} bytes, of which there can be {limit}")
            if len(whole) + len(part.data) > total or (not part.data and len(whole) < total):
                raise Malformed(f"the robot answered `{name}` with {len(part.data)} bytes behind the first {len(whole)} of {total}")
            whole += part.data
        return whole

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
            self._call()
            for answer in self._receive(min(left, CALL_INTERVAL_S)):
                if self._calling is not None and self._calling.is_answered_by(answer) and self._calling.accepts(answer):
                    self._calling = None

    def _call(self) -> None:
        """Lets the robot hear that somebody listens, if it has heard nothing for a while. The answer is not waited for."""
        if time.monotonic() - self._sent_at < CALL_INTERVAL_S:
            return
        # The same as long as it is not answered: who keeps requests back has one of them at most.
        if self._calling is None:
            self._calling = self._next_frame(messages.without_number(messages.CLOCK))
        self._write(self._calling)

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
            if there > len(blob):
                raise Malformed(f"the robot answered `upload` with {there} bytes that are there, of {len(blob)}")
            chunk_bytes = min(robot.chunk_bytes, messages.MAX_CHUNK_BYTES)
            standing = Standing(len(blob), there, chunk_bytes, robot.window_bytes)
            if not self._send_from(blob, standing, loss, progress or (lambda _: None)):
                continue
            if not self._has_owner():
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
        # Chunks by the number of their message, the last one of each.
        sent_frames: Dict[int, _Frame] = {}
        is_unproven = False
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
                frame = self._next_frame(messages.without_number(messages.CHUNK, chunk[0], blob[chunk[0] : chunk[1]]))
                sent_frames[frame.seq] = frame
                self._write(frame)
                last_sign = time.monotonic()
                standing.chunk_sent(frame.seq, chunk, last_sign)
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
                frame = sent_frames.get(answer.seq)
                if frame is None:
                    continue
                if frame.is_ended_by(answer):
                    # Another session goes on where this one was.
                    return False
                if not frame.is_answered_by(answer):
                    continue
                if not frame.accepts(answer):
                    is_unproven = True
                    continue
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
                patience.check("upload", is_unproven)
            if wait is not None and time.monotonic() - last_sign >= wait:
                attempt += 1
                standing.give_up_what_was_sent(loss)
                last_sign = time.monotonic()
        return True

    # Keys (section 13).

    def install_key(self, key: Key, salt: Optional[bytes] = None) -> None:
        """From now on the robot takes commands only if this key has signed them. It must have none, or this client's.

        The salt is 16 random bytes, which need not be secret; without one it comes from the system.
        """
        self.require("keys")
        salt = random_bytes() if salt is None else salt

        def fields() -> tuple:
            secret = key.secret(salt)
            # Anew for each session: the robot takes the mask off with the one that it has.
            if self._session is not None:
                secret = self._session.mask(secret, salt)
            return key.public, salt, secret, key.sign_installation(salt, secret)

        self._change_key("install a key", messages.INSTALL_KEY, fields)
        self.use_key(key)

    def remove_key(self) -> None:
        """From now on the robot takes commands from anyone, and this client has no key."""
        self.require("keys")
        self._change_key("remove the key", messages.REMOVE_KEY, tuple)
        self.use_key(None)

    def _change_key(self, name: str, kind: int, fields: Callable[[], tuple]) -> None:
        """Has the key changed, and asks what holds then: also where the flash is said not to have taken it."""
        try:
            self._key_command(name, messages.Done, kind, fields)
        except Refused as refused:
            if refused.error.name == "NotStored":
                self._session = None
                self.hello()
            raise
        self._session = None
        self.hello()

    def _has_owner(self) -> bool:
        """Whether the robot has a key: in a session it has shown it, whatever is said outside."""
        return self._session is not None or (self._robot or self.hello()).access in messages.OWNED

    def _enter_session(self, kind: int, patience: _Patience) -> None:
        """Opens a session with a robot that has a key, if a request is for one and there is none. Who has no key reads, and stops."""
        if kind in messages.NEVER_PROVEN or (self._session is not None and self._session.number < LAST_NUMBER):
            return
        is_for_owner = kind in messages.SIGNED_ONLY or kind in messages.SESSION_ONLY
        if self._key is None:
            if is_for_owner and self._has_owner():
                raise OtherKey(self.identity().key, None)
            return
        if not self._has_owner():
            if self._insists:
                raise NotLocked((self._robot or self.hello()).access)
            return
        if self._only_reads and not is_for_owner:
            return
        try:
            self._session = self._open_session(self._key, patience)
        except OtherKey:
            if is_for_owner or self._insists:
                raise
            self._only_reads = True

    def _open_session(self, key: Key, patience: _Patience) -> OwnerSession:
        """The robot shows that it has the key's secret, and so does this side."""
        name = "open a session"
        while True:
            client = random_bytes()
            identity = self._identify(key, client, patience)
            session = OwnerSession(key.secret(identity.salt), identity.salt, client, identity.nonce)
            bare = messages.without_number(messages.OPEN_SESSION, Raw(client), Raw(identity.nonce), Raw(session.opening()))
            frame = self._plain_frame(bare)
            frame.session = session
            body = self._exchange_frame(name, patience, messages.OPEN_SESSION, frame)
            if isinstance(body, messages.Done):
                return session
            if not isinstance(body, Error):
                raise Malformed(f"the robot answered `{name}` with {body}")
            # It took too long, or another session was opened meanwhile.
            if body.name not in ("NoSession", "NoChallenge") or not patience.lasts():
                raise Refused(name, body)
            self._pause(BUSY_WAIT_S, patience)

    def _identify(self, key: Key, client: bytes, patience: _Patience) -> messages.Identity:
        """Lets the robot show that it has the secret of this key."""
        name = "identify"
        while True:
            body = self._exchange(name, patience, messages.IDENTIFY, Raw(client))
            if isinstance(body, messages.Identity):
                # Each salt has a secret of its own.
                secret = key.secret(body.salt)
                if is_same(body.proof, identity_proof(secret, client, body.key, body.salt, body.nonce, body.counter)):
                    return body
                if body.key != key.public:
                    raise OtherKey(body.key, key.public)
                # Somebody has answered in its place.
                if not patience.lasts():
                    raise Unproven(name)
                self._pause(BUSY_WAIT_S, patience)
            else:
                self._is_to_repeat(name, messages.Identity, body, patience)

    def _challenge(self) -> Tuple[Key, messages.Challenge]:
        challenge = self._ask("challenge", messages.Challenge, messages.CHALLENGE)
        if self._key is None or self._session is None:
            raise OtherKey(self.identity().key, None)
        return self._key, challenge

    def _sign_upload(self, blob: bytes) -> None:
        key, challenge = self._challenge()
        counter = challenge.counter + 1
        if counter >= 2**64:
            raise Refused("sign", Error("OldCounter", {"last": challenge.counter}))
        # The challenge came in it.
        assert self._session is not None
        signature = key.sign(upload_message(self._session.salt, counter, blob))
        self._ask("sign", messages.Done, messages.SIGN, counter, signature)
        self._signed_upload = signature

    def _command(self, name: str, wanted: type, kind: int, *fields):
        """Asks for something that changes what the robot does. It is not done after its answer was waited for, and a robot that has a key takes it signed only."""
        begun = _Patience()
        while True:
            self._enter_session(kind, begun)
            longer = self._longer(kind)
            by_us = self.clock() + COMMAND_TIME_US
            # From here on, so that nobody gives up before that time.
            patience = _Patience()
            bare = messages.without_number(messages.WITHIN, by_us, messages.without_number(kind, *fields))
            upload = self._signed_upload if kind == messages.COMMIT else NO_UPLOAD
            body = self._exchange_signed(name, patience, upload, lambda: bare, longer)
            begun.adopt(patience)
            if not self._is_to_repeat(name, wanted, body, begun):
                return body

    def _key_command(self, name: str, wanted: type, kind: int, fields: Callable[[], tuple]):
        """Asks for something that is about keys, whose fields may rest on the session. A robot that has a key takes it signed only."""
        patience = _Patience()
        while True:
            self._enter_session(kind, patience)
            longer = self._longer(kind)
            body = self._exchange_signed(name, patience, NO_UPLOAD, lambda: messages.without_number(kind, *fields()), longer)
            if not self._is_to_repeat(name, wanted, body, patience):
                return body

    def _longer(self, kind: int) -> float:
        """Seconds that the robot may take longer for this than for others."""
        return self.features().flash_ms / 1000 if kind in KEPT else 0.0

    def _exchange_signed(self, name: str, patience: _Patience, upload: bytes, bare: Callable[[], bytes], longer: float) -> object:
        """One exchange, signed where the robot has a key: it cannot be sent a second time after an answer, for the nonce is used up."""
        if not self._has_owner():
            request = bare()
            return self._exchange_frame(name, patience, request[0], self._next_frame(request), longer)
        key, challenge = self._challenge()
        # Only now, for the challenge may have opened another session.
        request = bare()
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
            # A movement by hand would come later still.
            is_worth_while = patience.is_fresh() and name != DRIVE
        elif body.name == "NoSession":
            # The robot has started anew, or another session of its owner was opened: this one ends here.
            is_worth_while = self._session is not None and patience.lasts()
            patience.has_lost_session |= self._session is not None
            self._session = None
        else:
            # Somebody else has sent it a wrong signature, where it is too soon.
            is_worth_while = body.name in ("Busy", "NoAnswer", "TooSoon") and patience.lasts()
        if not is_worth_while:
            raise Refused(name, body, patience.has_lost_session)
        self._pause(min(body.fields["ms"] / 1000, LONGEST_PAUSE_S) if body.name == "TooSoon" else BUSY_WAIT_S, patience)
        return True

    def _pause(self, seconds: float, patience: _Patience) -> None:
        time.sleep(seconds)
        patience.look()

    def _ask(self, name: str, wanted: type, kind: int, *fields, enters: bool = True):
        """`enters`: in the owner's session, where there is one to be had."""
        patience = _Patience()
        while True:
            if enters:
                self._enter_session(kind, patience)
            body = self._exchange(name, patience, kind, *fields)
            if not self._is_to_repeat(name, wanted, body, patience):
                return body

    def _plain_frame(self, bare: bytes) -> _Frame:
        """A request under a new number, as it is."""
        self._seq = (self._seq + 1) % 256
        return _Frame(self._seq, bytes([self._seq]) + bare, messages.innermost_kind(bare))

    def _next_frame(self, bare: bytes) -> _Frame:
        """A request under a new number, in the owner's session where one is open."""
        if self._session is None or bare[0] in messages.NEVER_PROVEN:
            return self._plain_frame(bare)
        number, proven = self._session.prove(bare)
        frame = self._plain_frame(proven)
        frame.session, frame.number = self._session, number
        return frame

    def _exchange(self, name: str, patience: _Patience, kind: int, *fields, longer: float = 0.0) -> object:
        return self._exchange_frame(name, patience, kind, self._next_frame(messages.without_number(kind, *fields)), longer)

    def _exchange_frame(self, name: str, patience: _Patience, kind: int, frame: _Frame, longer: float = 0.0) -> object:
        """Sends a frame that holds a request of this kind until its answer is there."""
        self._calling = None
        self._other_version = None
        self._has_asked_for_streams |= kind in (messages.SUBSCRIBE, messages.WATCH, messages.VALUES)
        is_first = True
        is_unproven = False
        # Sendings in a row of which nothing was heard: a line that brings spoiled frames is bad, and not slow.
        attempt = 0
        heard_within = None
        while True:
            self._write(frame)
            sent = time.monotonic()
            known = self._reply_time
            if heard_within is not None and not known.is_known():
                known = _ReplyTime()
                known.seen(heard_within)
            wait = known.wait(attempt, len(frame.message) + 7)
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
                    if frame.is_ended_by(answer):
                        return Error("NoSession", {})
                    if is_old or not frame.is_answered_by(answer):
                        continue
                    if not frame.accepts(answer):
                        is_unproven = True
                        continue
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
            patience.check(name, is_unproven)
            is_first = False
            self.retries += 1

    # Bytes.

    def _write(self, frame: _Frame) -> None:
        self._sent_at = time.monotonic()
        try:
            # The delimiter in front gives noise an end.
            self._port.write(DELIMITER + encode(frame.message))
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
            # Before the rest, which may be another one in another version.
            version = messages.version_in_hello(message)
            if version is not None and version != messages.PROTOCOL_VERSION:
                self._other_version = version
                continue
            try:
                read = messages.from_robot(message)
            except Malformed:
                self._reader.spoiled += 1
                continue
            if isinstance(read, Answer):
                answers.append(read)
            elif not self._has_asked_for_streams:
                continue
            elif isinstance(read, messages.StatusEvent):
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
