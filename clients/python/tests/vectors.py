"""Reads tests/conformance/link.txt."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import List, Tuple

FILE = Path(os.environ.get("ESM_LINK_VECTORS", Path(__file__).parents[3] / "tests" / "conformance" / "link.txt"))


@dataclass
class Vector:
    kind: str
    name: str
    lines: List[Tuple[str, str]] = field(default_factory=list)

    def all(self, mark: str) -> List[bytes]:
        return [bytes.fromhex(value) for of, value in self.lines if of == mark]


def read() -> List[Vector]:
    vectors: List[Vector] = []
    # A vector begins behind an empty line: some lines in one are named as others are.
    is_first = True
    for line in FILE.read_text().splitlines():
        if line.startswith("#"):
            continue
        if line:
            mark, value = line.split(" ", 1)
            if is_first:
                vectors.append(Vector(mark, value))
            else:
                vectors[-1].lines.append((mark, value))
        is_first = not line
    return vectors


def of_kind(kind: str) -> List[Vector]:
    return [vector for vector in read() if vector.kind == kind]


def named(name: str) -> Vector:
    [vector] = [vector for vector in read() if vector.name == name]
    return vector


class Line:
    """A port that plays the robot of an exchange: it takes what the client must send, and gives what the robot said."""

    def __init__(self, name: str) -> None:
        self._left = list(named(name).lines)
        self._received = b""
        self.timeout = 0.0

    def write(self, sent: bytes) -> None:
        while self._left and self._left[0][0] == "t":
            self._left.pop(0)
        mark, expected = self._left.pop(0) if self._left else ("nothing", "")
        assert mark in ">x" and sent.hex() == expected, f"sent {sent.hex()}, expected {mark} {expected}"

    def read(self, size: int) -> bytes:
        while self._left and self._left[0][0] in "<t":
            mark, value = self._left.pop(0)
            if mark == "<":
                self._received += bytes.fromhex(value)
        received, self._received = self._received[:size], self._received[size:]
        return received

    def is_done(self) -> bool:
        self.read(0)
        return not self._left
