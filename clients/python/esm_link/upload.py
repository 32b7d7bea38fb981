"""Uploads: which chunk is sent next (section 6 of docs/link.md)."""

import bisect
import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

# Bytes of a chunk's frame beside its data.
OVERHEAD = 12
FIRST_SPOILED = 0.1
FIRST_BYTES = 1_000.0
MEMORY_BYTES = 1_000.0
BEST_RATE = 1e-5
LEAST_WORTH = 0.05
MAX_CHUNKS = 100


class Loss:
    """How often the line spoils a byte, as far as frames tell that passed or did not."""

    def __init__(self) -> None:
        self._spoiled = FIRST_SPOILED
        self._bytes = FIRST_BYTES

    def rate(self) -> float:
        return max(BEST_RATE, self._spoiled / self._bytes)

    def passes(self, chunk: int) -> float:
        """The probability that a chunk of so many bytes passes."""
        return math.exp(-self.rate() * (chunk + OVERHEAD))

    def best_chunk(self, largest: int) -> int:
        root = math.sqrt(OVERHEAD * OVERHEAD + 4 * OVERHEAD / self.rate())
        return max(1, min(largest, int((root - OVERHEAD) / 2 + 0.5)))

    def chunk_passed(self, chunk: int) -> None:
        self._fade(chunk + OVERHEAD)

    def chunk_lost(self, chunk: int) -> None:
        expected = self.rate() * (chunk + OVERHEAD)
        self._fade(chunk + OVERHEAD)
        self._spoiled += expected / (1 - math.exp(-expected))

    def _fade(self, frame: int) -> None:
        rest = max(0.0, 1 - frame / MEMORY_BYTES)
        self._spoiled *= rest
        self._bytes = self._bytes * rest + frame


@dataclass
class _Sent:
    """A chunk that was sent and not answered."""

    seq: int
    start: int
    end: int
    at: float
    given_up: bool = False


class Standing:
    """What the robot has, what was sent, and what is best sent next."""

    def __init__(self, length: int, there: int, chunk_bytes: int, window_bytes: int) -> None:
        self.there = there
        #: The first byte that was never sent.
        self.unsent = there
        self._len = length
        self._window = max(1, window_bytes)
        self._largest = max(1, min(chunk_bytes, self._window))
        # Bytes that the line may have to carry at a time.
        self._frames_ahead = self._window * (self._largest + OVERHEAD) // self._largest
        self._sent: List[_Sent] = []

    def _waited_for(self) -> List[_Sent]:
        return [chunk for chunk in self._sent if not chunk.given_up]

    def _likely(self, loss: Loss) -> List[List[float]]:
        """How many bytes the robot has by now, and how likely."""
        likely = [[self.there, 1.0]]
        for chunk in self._waited_for():
            passes = loss.passes(chunk.end - chunk.start)
            moved = 0.0
            for place in likely:
                if chunk.start <= place[0] < chunk.end:
                    moved += place[1] * passes
                    place[1] *= 1 - passes
            if moved > 0:
                at = bisect.bisect_left([place[0] for place in likely], chunk.end)
                if at < len(likely) and likely[at][0] == chunk.end:
                    likely[at][1] += moved
                else:
                    likely.insert(at, [chunk.end, moved])
        return likely

    def next_chunk(self, loss: Loss) -> Optional[Tuple[int, int]]:
        """Where the chunk begins and ends that brings most in its time on the line, if one may be sent now and is worth it."""
        under_way = sum(chunk.end - chunk.start + OVERHEAD for chunk in self._waited_for())
        length = loss.best_chunk(self._largest)
        likely = self._likely(loss)
        best, most = None, 0.0
        for number, (start, _) in enumerate(likely):
            end = min(self._len, start + length, self.there + self._window)
            size = end - start
            if size <= 0 or under_way + size + OVERHEAD > self._frames_ahead:
                continue
            brings = sum((end - at) * probability for at, probability in likely[number:] if at < end)
            by_time = brings * loss.passes(size) / (size + OVERHEAD)
            if brings >= LEAST_WORTH * size and by_time > most:
                best, most = (start, end), by_time
        return best

    def chunk_sent(self, seq: int, chunk: Tuple[int, int], at: float) -> None:
        self.unsent = max(self.unsent, chunk[1])
        self._sent = self._sent[-(MAX_CHUNKS - 1) :] + [_Sent(seq, *chunk, at)]

    def is_sent(self, seq: int) -> bool:
        return any(chunk.seq == seq for chunk in self._sent)

    def take(self, seq: int, there: int, loss: Loss) -> Optional[float]:
        """Takes an answer that says how much is there. Returns when its chunk was sent, if it was one."""
        places = [place for place, chunk in enumerate(self._sent) if chunk.seq == seq]
        if not places or there > self._len:
            return None
        place = places[-1]
        before, self.there = self.there, max(self.there, there)
        # The answers to those before it were lost, or left out.
        decided, self._sent = self._sent[: place + 1], self._sent[place + 1 :]
        for at, chunk in enumerate(decided):
            size = chunk.end - chunk.start
            others = decided[:at] + decided[at + 1 :]
            is_alone = not any(other.start < chunk.end and chunk.start < other.end for other in others)
            if at == place or (chunk.end <= self.there and is_alone):
                loss.chunk_passed(size)
            elif chunk.end > self.there and chunk.start <= before and not chunk.given_up:
                loss.chunk_lost(size)
        return decided[-1].at

    def give_up_what_was_sent(self, loss: Loss) -> None:
        """Nothing came: all that was sent is lost, or its answers are."""
        for chunk in self._waited_for():
            chunk.given_up = True
            loss.chunk_lost(chunk.end - chunk.start)

    def on_the_way(self) -> int:
        return sum(chunk.end - chunk.start for chunk in self._waited_for())
