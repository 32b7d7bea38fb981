"""Values on nets of the mission (sections 7 and 9 of docs/link.md)."""

import re
import struct
from dataclasses import dataclass
from typing import Dict, List, Optional, Sequence, Tuple, Union

from .messages import Malformed

Value = Union[bool, int, float]

HEAD_BYTES = 16
WORD_BYTES = 4
# How the bits of a word are read, by the name of its type.
FORMATS = {"bool": "<I", "i8": "<i", "i16": "<i", "i32": "<i", "u8": "<I", "u16": "<I", "u32": "<I", "f32": "<f"}
# And in rows that share words: how, and how many there are in a word.
ROWS = {"i8": ("<b", 4), "u8": ("<B", 4), "i16": ("<h", 2), "u16": ("<H", 2)}
LINE = re.compile(r"(\w*):(?:\[(\w+);(\d{1,5})\]|(\w+))")


def param_bits(params: Sequence[Value]) -> bytes:
    """Parameters as a request has them: the bits of each, four bytes."""
    return b"".join(struct.pack("<f", it) if isinstance(it, float) else struct.pack("<I", int(it) & 0xFFFFFFFF) for it in params)


@dataclass
class Field:
    """A field of a value. Its name ends in its unit, where it has one; fields of one name, one behind the other, are a row."""

    name: str
    type: str
    # Where it stands in its word, in bytes. A word begins with the field that stands at 0.
    at: int = 0
    # How its bytes are read; by its type, if nothing is said.
    format: str = ""


def fields_of(text: str) -> List[Field]:
    """Fields from what a robot says of a type, a line each; a row is so many fields of one name."""
    fields: List[Field] = []
    for line in text.splitlines():
        found = LINE.fullmatch(line)
        kind = found and (found.group(2) or found.group(4))
        if not found or kind not in FORMATS:
            raise Malformed(f"a field `{line}`")
        form, in_word = ROWS.get(kind, (FORMATS[kind], 1)) if found.group(2) else (FORMATS[kind], 1)
        size = struct.calcsize(form)
        count = int(found.group(3) or 1)
        fields += [Field(found.group(1), kind, place % in_word * size, form) for place in range(count)]
    return fields


def ask_fields(mission: int, net: int, offset: int) -> bytes:
    """Asks what values on a net are made of."""
    return struct.pack("<HIHH", 0, mission, net, offset)


def ask_values(mission: int, period_ms: int, nets: List[int]) -> bytes:
    """Asks for values on nets."""
    return struct.pack(f"<HIH{len(nets)}H", 1, mission, period_ms, *nets)


@dataclass
class Sample:
    """What was on nets at the same time; none where nothing was written to a net yet."""

    t_us: int
    values: List[Optional[List[Value]]]


@dataclass
class Part:
    """A part of the channel: the words of a sample, or that no more come."""

    number: int
    ended: bool
    left_out: int
    has: int
    t_us: int
    words: bytes


def part_of(data: bytes) -> Part:
    """Reads the bytes of a part."""
    if len(data) < HEAD_BYTES or len(data) % WORD_BYTES:
        raise Malformed("values of no length that there is")
    number, kind, left_out, _, has, t_us = struct.unpack_from("<BBBBIQ", data)
    if kind > 1:
        raise Malformed(f"values of kind {kind}")
    return Part(number, kind == 1, left_out, has, t_us, data[HEAD_BYTES:])


def sample_of(part: Part, nets: List[List[Field]]) -> Sample:
    """What a part says of nets whose values have these fields."""
    values: List[Optional[List[Value]]] = []
    at = 0
    for place, fields in enumerate(nets):
        if not part.has >> place & 1:
            values.append(None)
            continue
        row: List[Value] = []
        for field in fields:
            if field.at == 0:
                at += WORD_BYTES
            if at > len(part.words):
                raise Malformed("values that end too early")
            (value,) = struct.unpack_from(field.format or FORMATS[field.type], part.words, at - WORD_BYTES + field.at)
            row.append(value != 0 if field.type == "bool" else value)
        values.append(row)
    return Sample(part.t_us, values)


def as_dict(fields: List[Field], values: List[Value]) -> Union[Value, Dict[str, Union[Value, List[Value]]]]:
    """A value by the names of its fields, rows as lists; of a value that is a number itself, the number."""
    if len(fields) == 1 and not fields[0].name:
        return values[0]
    rows: List[Tuple[str, List[Value]]] = []
    for field, value in zip(fields, values):
        if rows and rows[-1][0] == field.name:
            rows[-1][1].append(value)
        else:
            rows.append((field.name, [value]))
    return {name: row[0] if len(row) == 1 else row for name, row in rows}
