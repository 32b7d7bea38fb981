"""Messages: what is in a frame (sections 3, 5, 7, 8 and 9 of docs/link.md)."""

from dataclasses import dataclass
from typing import List, Optional, Tuple, Union

PROTOCOL_VERSION = 4

(
    HELLO, BEGIN, CHUNK, COMMIT, ABORT, STATUS, STOP, START, TASK, READ_BLOB, STATES, SLOT_COUNTERS, SUBSCRIBE, TASK_COUNTERS,
    CONFIRM, FALL_BACK, CRASH_REPORT, BLACK_BOX, CHALLENGE, SIGNED, SIGN, INSTALL_KEY, REMOVE_KEY,
    PARAM, SET_PARAM, WATCH, SAVE_PARAMS, EMERGENCY_STOP, RELEASE,
    CLOCK, WITHIN, FEATURES, VALUES,
    IDENTIFY, OPEN_SESSION, PROVEN,
    BEHAVIOUR_LIST, BEHAVIOURS, DRIVE, END_DRIVE,
    SELFTEST, FRAME_COUNTERS,
) = range(42)  # fmt: skip

#: `of` in the answer to a message that was no request.
NO_REQUEST = 255
#: Bytes of a chunk at most, whatever a robot says.
MAX_CHUNK_BYTES = 176
NONCE_BYTES = SALT_BYTES = PROOF_BYTES = 16
KEY_BYTES = 32

# What a robot with a key takes within `Signed` only.
SIGNED_ONLY = (COMMIT, START, CONFIRM, FALL_BACK, INSTALL_KEY, REMOVE_KEY, SET_PARAM, SAVE_PARAMS, RELEASE, BEHAVIOURS)
# What it takes in its owner's session only.
SESSION_ONLY = (BEGIN, CHUNK, ABORT, CHALLENGE, SIGNED, SIGN, DRIVE, END_DRIVE, SELFTEST)
# What begins a session, or is no part of one.
NEVER_PROVEN = (HELLO, IDENTIFY, OPEN_SESSION, PROVEN)

RESETS = ("power on", "reset pin", "watchdog", "panic", "processor fault", "brown-out", "software")
SAFE_REASONS = (
    "event queue overflow",
    "macro step limit",
    "overruns",
    "missed occurrences",
    "body lost",
    "low battery",
    "link lost",
    "board",
    "monitor silent",
)
FALL_BACKS = ("not confirmed", "asked for", "failed")
SOURCES = ("nothing", "slot A", "slot B", "firmware")
SLOT_STATES = (
    "runs",
    "on trial",
    "spare",
    "empty",
    "unsealed",
    "broken header",
    "other format",
    "too long",
    "no room",
    "broken payload",
    "unreadable",
    "refused",
    "trial failed",
    "trial not recorded",
    "given up",
)
CAPACITIES = ("bytes of the blob", "words for the interpreter", "slots", "task states", "nets", "exclusive groups", "entries in common with the mission before", "steps of a script", "links", "frames")
CHANNELS = ("trace", "log", "record", "values")
ACCESS = ("unsupported", "open", "locked", "unreadable", "recovering", "damaged")
# Where a robot remembers its owner's key.
OWNED = ("locked", "recovering")
# Each by its bit.
FEATURE_NAMES = ("record", "log", "news", "params", "warm", "keys", "store", "black-box", "telemetry", "behaviours", "links")
LIFE_STATES = ("INITIAL", "EXECUTE", "SUSPEND", "RESUME", "DESTROY")
ORIGINS = ("mission", "request", "script", "REMOTE_CONTROL", "IDLE")
SCRIPT_STATES = ("none", "runs", "suspended", "done", "ended")
CAUSES = ("begun", "period", "mission", "trial", "mode")


class Malformed(Exception):
    """The bytes arrived as they were sent, but are no message of this version."""


class Fields:
    """Reads the fields of a message."""

    def __init__(self, message: bytes) -> None:
        self._message = message
        self._at = 0

    def take(self, count: int) -> bytes:
        end = self._at + count
        if end > len(self._message):
            raise Malformed("it ends too early")
        taken = self._message[self._at : end]
        self._at = end
        return taken

    def u8(self) -> int:
        return self.take(1)[0]

    def boolean(self) -> bool:
        value = self.u8()
        if value > 1:
            raise Malformed(f"{value} is no truth")
        return value == 1

    def number(self, bits: int = 64) -> int:
        value = 0
        for place in range((bits + 6) // 7):
            byte = self.u8()
            value |= (byte & 0x7F) << (7 * place)
            if byte < 0x80:
                break
        else:
            raise Malformed("a number without an end")
        if value >> bits:
            raise Malformed(f"{value} has more than {bits} bits")
        return value

    def one_of(self, names: Tuple[str, ...]) -> str:
        index = self.number(32)
        if index >= len(names):
            raise Malformed(f"alternative {index} of {len(names)}")
        return names[index]

    def option_u32(self) -> Optional[int]:
        return self.number(32) if self.boolean() else None

    def option_u16(self) -> Optional[int]:
        return self.number(16) if self.boolean() else None

    def bytes(self) -> bytes:
        return self.take(self.number(32))

    def text(self) -> str:
        try:
            return self.bytes().decode()
        except UnicodeDecodeError as cause:
            raise Malformed("a text that is no UTF-8") from cause

    def left(self) -> int:
        return len(self._message) - self._at

    def rest(self, but: int = 0) -> bytes:
        """All that is left, but for so many bytes at the end."""
        count = self.left() - but
        if count < 0:
            raise Malformed("it ends too early")
        return self.take(count)

    def end(self) -> None:
        if self._at != len(self._message):
            raise Malformed("there are bytes behind its end")


def number(value: int) -> bytes:
    """A number, seven bits a byte, the lowest first."""
    encoded = bytearray()
    while value >= 0x80:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


class U8(int):
    """A field of one byte, where other numbers have as many as they need."""


class Raw(bytes):
    """Bytes of a length that both sides know."""


def request(seq: int, kind: int, *fields: Union[int, bytes]) -> bytes:
    """The message of a request."""
    return bytes([seq]) + without_number(kind, *fields)


def without_number(kind: int, *fields: Union[int, bytes]) -> bytes:
    """The message of a request without its number, as it is signed."""
    message = bytes([kind])
    for field in fields:
        if isinstance(field, Raw):
            message += field
        elif isinstance(field, bytes):
            message += number(len(field)) + field
        elif isinstance(field, (U8, bool)):
            message += bytes([field])
        else:
            message += number(field)
    return message


def innermost_kind(bare: bytes) -> int:
    """The kind of a request without a message's number, or of the one that it holds: its answer's `of`."""
    while bare[0] in (WITHIN, SIGNED, PROVEN):
        fields = Fields(bare[1:])
        if bare[0] == SIGNED:
            fields.bytes()
        else:
            fields.number()
        if bare[0] == PROVEN:
            fields.take(PROOF_BYTES)
        bare = fields.bytes()
    return bare[0]


@dataclass
class Hello:
    protocol: int
    firmware: str
    board: str
    task_types: int
    blob_bytes: int
    arena_words: int
    slots: int
    task_instances: int
    nets: int
    exclusive_groups: int
    mission: Optional[int]
    reset: str
    chunk_bytes: int
    window_bytes: int
    access: str


@dataclass
class Received:
    len: int


@dataclass
class Committed:
    mission: int
    carried: int


@dataclass
class Done:
    pass


@dataclass
class Trial:
    left_ms: int
    before: Optional[int]


@dataclass
class FallBack:
    mission: int
    reason: str


@dataclass
class StoreStatus:
    """Where the mission is that runs, and what is in slot A and slot B of the robot's flash."""

    runs: str
    slots: List[str]


@dataclass
class FlashHealth:
    """How the robot's flash is; `way_in` says who gets into a robot whose records are damaged."""

    records: str
    way_in: Optional[str]
    flaws: int
    mission_erases: int
    record_erases: int


@dataclass
class Status:
    mode: str
    mission: Optional[int]
    steps: int
    t_us: int
    executed: int
    missed: int
    overruns: int
    max_delay_ns: int
    trace_dropped: int
    background_busy: bool
    stack_bytes: Optional[int]
    reset: str
    trial: Optional[Trial]
    fell_back: Optional[FallBack]
    kept: Optional[StoreStatus]
    changed_params: int
    record_dropped: int
    record_pending: bool
    saved_params: int
    stop_pressed: bool
    flash: Optional[FlashHealth]


@dataclass
class Param:
    value: int
    of_mission: int
    saved: Optional[int]


@dataclass
class ParamSet:
    before: int


@dataclass
class ParamsSaved:
    count: int


@dataclass
class Clock:
    """Microseconds since the robot started."""

    now_us: int


@dataclass
class Features:
    """What a firmware was built with."""

    #: A set of bits, of which FEATURE_NAMES names those that are known here.
    built_in: int
    #: So much longer than others a request may take that lets the robot write its flash.
    flash_ms: int

    def has(self, name: str) -> bool:
        return self.built_in >> FEATURE_NAMES.index(name) & 1 == 1

    def left_out(self) -> List[str]:
        return [name for name in FEATURE_NAMES if not self.has(name)]


# Of a firmware that does not say it: the robot itself refuses what it lacks.
UNTOLD = Features(2**32 - 1, 0)


@dataclass
class TaskText:
    total: int
    data: bytes


@dataclass
class Blob:
    total: int
    data: bytes


@dataclass
class States:
    step: int
    total: int
    states: List[int]


@dataclass
class Slot:
    number: int
    executed: int
    missed: int
    overruns: int
    total_execution_ns: int
    min_execution_ns: int
    max_execution_ns: int
    min_delay_ns: int
    max_delay_ns: int
    first_bucket_ns: int
    delays: List[int]


@dataclass
class Frame:
    passed: int
    missing: int
    repeated: int
    older: int
    link_errors: int
    link_dropped: int


@dataclass
class TaskInstance:
    enabled: bool
    busy: bool
    overruns: int


@dataclass
class CrashReport:
    reset: str
    after_us: int
    task: Optional[int]
    line: int
    pc: int
    lr: int
    status: int
    hard_status: int
    address: int
    silent: Optional[str]
    bad_starts: int
    file: bytes


@dataclass
class Record:
    """A record of the flight recorder; section 7 says what the values of each kind are."""

    sequence: int
    t_us: int
    kind: int
    small: int
    large: int


@dataclass
class BlackBox:
    end: int
    records: List[Record]


@dataclass
class Challenge:
    nonce: bytes
    counter: int


@dataclass
class Identity:
    """Who a robot says that it is; `proof` shows it to those who know the secret of this salt."""

    key: bytes
    salt: bytes
    nonce: bytes
    counter: int
    proof: bytes


@dataclass
class Behaviour:
    """A behaviour was inserted; `key` names it in requests."""

    key: int


@dataclass
class ListEntry:
    """A behaviour on the list. `task` is the lower quarter of the hash of its task's signature."""

    key: int
    task: int
    state: str
    origin: str
    is_held: bool


@dataclass
class BehaviourList:
    """What stands on the list of behaviours, the head first, and how the last script is."""

    script: int
    steps: int
    ended: int
    state: str
    entries: List[ListEntry]


@dataclass
class Error:
    """Why a request was not carried out; the fields are named in section 8."""

    name: str
    fields: dict

    def __str__(self) -> str:
        fields = ", ".join(f"{name} {value}" for name, value in self.fields.items())
        return f"{self.name} ({fields})" if fields else self.name


@dataclass
class Answer:
    seq: int
    body: object
    #: The kind of the request that it is to.
    of: int
    #: None of an answer without one.
    proof: Optional[bytes] = None
    #: What the proof is of.
    proven: bytes = b""

    def is_to(self, kind: int) -> bool:
        """Whether it is to a request of this kind. A robot that did not understand a message cannot tell which it was."""
        is_misunderstood = isinstance(self.body, Error) and self.body.name == "Malformed"
        return self.of == kind or (self.of == NO_REQUEST and is_misunderstood)


@dataclass
class Part:
    channel: str
    part: int
    continues: bool
    dropped: int
    bytes: bytes


@dataclass
class StatusEvent:
    """What a robot tells that was asked to (`Client.watch`)."""

    seq: int
    cause: str
    mode: str
    mission: Optional[int]
    on_trial: bool
    fell_back: Optional[FallBack]
    steps: int
    t_us: int
    executed: int
    missed: int
    overruns: int
    max_delay_ns: int
    corrupt_frames: int


def version_in_hello(message: bytes) -> Optional[int]:
    """The version that a robot tells in its answer to hello, from a message of any version."""
    fields = Fields(message)
    try:
        if fields.u8() != 0:
            return None
        fields.u8()
        if (fields.u8(), fields.u8()) != (0, 0):
            return None
        return fields.number(16)
    except Malformed:
        return None


def from_robot(message: bytes) -> Union[Answer, Part, StatusEvent]:
    """Reads a message from a robot."""
    fields = Fields(message)
    kind = fields.number(32)
    if kind in (0, 3):
        seq = fields.u8()
        proof, proven = None, b""
        if kind == 3:
            proof = fields.take(PROOF_BYTES)
            proven = message[len(message) - fields.left() :]
        result = fields.number(32)
        if result == 0:
            body = _answer(fields)
        elif result == 1:
            body = _error(fields)
        else:
            raise Malformed("neither an answer nor an error")
        read: Union[Answer, Part, StatusEvent] = Answer(seq, body, fields.u8(), proof, proven)
    elif kind == 1:
        read = Part(fields.one_of(CHANNELS), fields.u8(), fields.boolean(), fields.number(32), fields.bytes())
    elif kind == 2:
        seq, cause, mode, mission = fields.u8(), fields.one_of(CAUSES), _mode(fields), fields.option_u32()
        on_trial, fell_back = fields.boolean(), _fell_back(fields)
        steps, t_us, counts = fields.number(), fields.number(), [fields.number(32) for _ in range(5)]
        read = StatusEvent(seq, cause, mode, mission, on_trial, fell_back, steps, t_us, *counts)
    else:
        raise Malformed(f"a message of kind {kind}")
    fields.end()
    return read


def _answer(fields: Fields) -> object:
    kind = fields.number(32)
    if kind == 0:
        protocol, firmware, board, task_types = fields.number(16), fields.text(), fields.text(), fields.u8()
        blob_bytes, arena_words = fields.number(32), fields.number(32)
        counts = [fields.number(16) for _ in range(4)]
        mission, reset = fields.option_u32(), fields.one_of(RESETS)
        return Hello(
            protocol, firmware, board, task_types, blob_bytes, arena_words, *counts, mission, reset, fields.number(16), fields.number(16), fields.one_of(ACCESS)
        )
    if kind == 1:
        return Received(fields.number(32))
    if kind == 2:
        return Committed(fields.number(32), fields.number(16))
    if kind == 3:
        return Done()
    if kind == 4:
        return _status(fields)
    if kind == 5:
        return TaskText(fields.number(16), fields.bytes())
    if kind == 6:
        return Blob(fields.number(32), fields.bytes())
    if kind == 7:
        step, total, states = fields.number(64), fields.number(16), fields.bytes()
        pairs = zip(states[::2], states[1::2])
        return States(step, total, [low | high << 8 for low, high in pairs])
    if kind == 8:
        numbers = [fields.number(bits) for bits in (32, 32, 32, 32, 64, 32, 32, 32, 32, 32)]
        return Slot(*numbers, [fields.number(16) for _ in range(8)])
    if kind == 9:
        return TaskInstance(fields.boolean(), fields.boolean(), fields.number(16))
    if kind == 10:
        reset, after_us, task = fields.one_of(RESETS), fields.number(64), fields.option_u16()
        numbers = [fields.number(32) for _ in range(6)]
        silent = None
        if fields.boolean():
            silent = fields.one_of(("slot", "link", "slot 0", "slot 0, for the link"))
            if silent == "slot":
                silent = f"slot at place {fields.u8()}"
        return CrashReport(reset, after_us, task, *numbers, silent, fields.number(32), fields.bytes())
    if kind == 11:
        end, records = fields.number(32), fields.bytes()
        return BlackBox(end, [_record(records[at : at + 16]) for at in range(0, len(records) - 15, 16)])
    if kind == 12:
        return Challenge(fields.take(NONCE_BYTES), fields.number(64))
    if kind == 13:
        return Param(fields.number(32), fields.number(32), fields.option_u32())
    if kind == 14:
        return ParamSet(fields.number(32))
    if kind == 15:
        return ParamsSaved(fields.u8())
    if kind == 16:
        return Clock(fields.number())
    if kind == 17:
        return Features(fields.number(32), fields.number(16))
    if kind == 18:
        key, salt, nonce = fields.take(KEY_BYTES), fields.take(SALT_BYTES), fields.take(NONCE_BYTES)
        return Identity(key, salt, nonce, fields.number(64), fields.take(PROOF_BYTES))
    if kind == 19:
        return Behaviour(fields.number(16))
    if kind == 20:
        script, steps, ended = fields.number(32), fields.u8(), fields.u8()
        state, entries = fields.one_of(SCRIPT_STATES), fields.bytes()
        return BehaviourList(script, steps, ended, state, [_list_entry(entries[at : at + 6]) for at in range(0, len(entries) - 5, 6)])
    if kind == 21:
        return Frame(*(fields.number(32) for _ in range(6)))
    raise Malformed(f"an answer of kind {kind}")


def _list_entry(entry: bytes) -> ListEntry:
    key, task, state, origin = entry[0] | entry[1] << 8, entry[2] | entry[3] << 8, entry[4], entry[5] & 0x7F
    if state >= len(LIFE_STATES) or origin >= len(ORIGINS):
        raise Malformed("a behaviour in no state, or that nobody has put there")
    return ListEntry(key, task, LIFE_STATES[state], ORIGINS[origin], entry[5] >= 0x80)


def _record(record: bytes) -> Record:
    def little(part: bytes) -> int:
        return int.from_bytes(part, "little")

    return Record(little(record[:4]), little(record[4:10]), record[10], record[11], little(record[12:]))


def _mode(fields: Fields) -> str:
    mode = fields.one_of(("empty", "running", "stopped", "safe", "emergency stop"))
    return f"safe: {fields.one_of(SAFE_REASONS)}" if mode == "safe" else mode


def _fell_back(fields: Fields) -> Optional[FallBack]:
    return FallBack(fields.number(32), _fall_back_reason(fields)) if fields.boolean() else None


def _status(fields: Fields) -> Status:
    mode = _mode(fields)
    mission, steps, t_us = fields.option_u32(), fields.number(64), fields.number(64)
    counts = [fields.number(32) for _ in range(5)]
    busy, stack, reset = fields.boolean(), fields.option_u32(), fields.one_of(RESETS)
    trial = Trial(fields.number(32), fields.option_u32()) if fields.boolean() else None
    fell_back = _fell_back(fields)
    kept = StoreStatus(fields.one_of(SOURCES), [_slot_state(fields) for _ in range(2)]) if fields.boolean() else None
    changed_params, record_dropped, record_pending, saved_params = fields.u8(), fields.number(32), fields.boolean(), fields.u8()
    stop_pressed = fields.boolean()
    flash = _flash_health(fields) if fields.boolean() else None
    return Status(
        mode, mission, steps, t_us, *counts, busy, stack, reset, trial, fell_back, kept, changed_params, record_dropped, record_pending, saved_params,
        stop_pressed, flash,
    )


def _flash_health(fields: Fields) -> FlashHealth:
    records, way_in = fields.one_of(("new", "whole", "once", "unreadable", "older")), None
    if records in ("unreadable", "older"):
        way_in = fields.one_of(("key", "anybody", "nobody"))
    return FlashHealth(records, way_in, fields.number(16), fields.number(32), fields.number(32))


def _slot_state(fields: Fields) -> str:
    state = fields.one_of(SLOT_STATES)
    return f"{state} for {fields.number(32)} bytes" if state == "no room" else state


def _fall_back_reason(fields: Fields) -> str:
    reason = fields.one_of(FALL_BACKS)
    return f"{reason}: {fields.one_of(SAFE_REASONS)}" if reason == "failed" else reason


def _error(fields: Fields) -> Error:
    kind = fields.number(32)
    u16 = lambda *names: {name: fields.number(16) for name in names}  # noqa: E731
    u32 = lambda *names: {name: fields.number(32) for name in names}  # noqa: E731
    plain = {
        0: "Malformed",
        1: "NoUpload",
        3: "TooLong",
        5: "WrongChecksum",
        11: "NoMission",
        12: "NoSuchIndex",
        13: "Busy",
        14: "NoAnswer",
        17: "OnTrial",
        18: "NotOnTrial",
        19: "NeedsKey",
        20: "NotSigned",
        21: "WrongSignature",
        23: "NoChallenge",
        24: "NoKey",
        25: "NoKeySupport",
        26: "NotStored",
        28: "FlashRefused",
        29: "OtherMission",
        30: "ParamNoValue",
        33: "NotBuiltIn",
        34: "NoStore",
        35: "EmergencyStopped",
        36: "StopNotStored",
        37: "Late",
        38: "NoSession",
        39: "WrongProof",
        41: "DeadlineTooFar",
        43: "StopCame",
        44: "NoBehaviours",
        45: "NotABehaviour",
        46: "ListFull",
        47: "NotOnList",
        48: "NoScript",
        49: "NoSituation",
        50: "TooFast",
        51: "PositionOutside",
        52: "NoPosition",
    }
    if kind in plain:
        return Error(plain[kind], {})
    if kind == 2:
        return Error("WrongOffset", u32("expected"))
    if kind == 4:
        return Error("Incomplete", u32("received"))
    if kind == 6:
        refusal = fields.one_of(("magic", "cut", "trailing bytes", "checksum", "section length", "record"))
        if refusal == "checksum":
            return Error("Invalid", {"refusal": refusal, **u32("stored", "computed")})
        if refusal in ("section length", "record"):
            # What follows belongs to the blob's format, but for `of` at the end.
            return Error("Invalid", {"refusal": refusal, "detail": fields.rest(but=1).hex()})
        return Error("Invalid", {"refusal": refusal})
    if kind == 42:
        return Error("FlashBudget", u32("s"))
    if kind == 31:
        return Error("ParamOutside", u32("min", "max"))
    if kind == 32:
        return Error("TooManyParams", {"available": fields.u8()})
    if kind == 7:
        return Error("UnknownTask", u16("task"))
    if kind == 8:
        return Error("SignatureDiffers", u16("task"))
    if kind == 9:
        return Error("TooManyInstances", u16("task", "needed", "available"))
    if kind == 10:
        return Error("CapacityExceeded", {"what": fields.one_of(CAPACITIES), **u32("needed", "available")})
    if kind == 15:
        return Error("NetTypeDiffers", u16("task", "port"))
    if kind == 16:
        return Error("ParamOutOfRange", u16("task", "param"))
    if kind == 53:
        return Error("PayloadDiffers", u16("frame", "needed"))
    if kind == 22:
        return Error("OldCounter", {"last": fields.number(64)})
    if kind == 40:
        return Error("CounterTooFar", {"last": fields.number(64)})
    if kind == 27:
        return Error("TooSoon", u32("ms"))
    raise Malformed(f"an error of kind {kind}")
