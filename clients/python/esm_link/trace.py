"""Trace records (section 9 of docs/link.md)."""

from typing import Iterator, List, Tuple

from .messages import Fields, Malformed, Part

FAULTS = ("event queue overflow", "macro step limit")


def take_record(fields: Fields) -> dict:
    """Reads one record."""
    kind = fields.u8()
    if kind == 0:
        return {"kind": "started", "mission": int.from_bytes(fields.take(4), "little"), "start_us": fields.number()}
    if kind == 1:
        return {
            "kind": "transition",
            "micro": fields.u8(),
            "region_instance": fields.number(16),
            "transition": fields.number(16),
        }
    if kind == 2:
        step, micro_steps = fields.number(), fields.u8()
        states, region = [], 0
        for _ in range(fields.number(16)):
            region += fields.number(16)
            states.append((region, fields.number(16)))
        enabled, task = [], 0
        for _ in range(fields.number(16)):
            task += fields.number(16)
            enabled.append(task)
        return {"kind": "step", "step": step, "micro_steps": micro_steps, "states": states, "enabled": enabled}
    if kind == 3:
        return {"kind": "same", "micro_steps": fields.u8()}
    if kind == 4:
        step, code = fields.number(), fields.u8()
        if code >= len(FAULTS):
            raise Malformed(f"a fault of kind {code}")
        return {"kind": "fault", "step": step, "code": FAULTS[code]}
    if kind in (5, 6):
        name = "job started" if kind == 5 else "job ended"
        return {"kind": name, "task_instance": fields.number(16), "occurrence": fields.number()}
    if kind == 7:
        return {"kind": "overrun", "task_instance": fields.number(16), "took_us": fields.number(32)}
    if kind == 8:
        return {"kind": "missed", "slot": fields.number(16), "count": fields.number(32)}
    if kind == 9:
        reason = fields.u8()
        return {"kind": "motors off", "reason": reason - 1 if reason else None}
    if kind == 10:
        return {"kind": "fell back", "mission": int.from_bytes(fields.take(4), "little"), "reason": fields.u8()}
    if kind == 11:
        # As a record of the black box has it.
        what, small = fields.u8(), fields.u8()
        return {"kind": "noted", "what": what, "small": small, "large": int.from_bytes(fields.take(4), "little")}
    raise Malformed(f"a record of kind {kind}")


class Assembler:
    """Puts the parts of the trace together."""

    def __init__(self) -> None:
        self._next = None
        self._pending = b""
        self._in_step = False
        #: Parts that the line lost.
        self.lost_parts = 0

    def take(self, part: Part) -> List[dict]:
        """Takes the next part, and gives the records that are whole."""
        if self._next is not None and part.part != self._next:
            self.lost_parts += (part.part - self._next) % 256
            self._in_step = False
        self._next = (part.part + 1) % 256
        if not part.continues:
            self._pending = b""
            self._in_step = True
        elif not self._in_step:
            return []
        records, used = [], 0
        self._pending += part.bytes
        for record, end in _records(self._pending):
            records.append(record)
            used = end
        self._pending = self._pending[used:]
        return records


def _records(pending: bytes) -> Iterator[Tuple[dict, int]]:
    at = 0
    while at < len(pending):
        fields = Fields(pending[at:])
        try:
            record = take_record(fields)
        except Malformed:
            # Its end is still to come.
            return
        at = len(pending) - len(fields.rest())
        yield record, at
