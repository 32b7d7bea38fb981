"""Frames: a message, its CRC-32, encoded with COBS and ended by a byte 0 (section 2 of docs/link.md)."""

import zlib
from typing import Iterator, Optional

#: With its delimiter.
MAX_FRAME_BYTES = 247
MAX_MESSAGE_BYTES = 241
CRC_BYTES = 4
DELIMITER = b"\0"


def encode(message: bytes) -> bytes:
    """The frame of a message, delimiter included."""
    if not 1 <= len(message) <= MAX_MESSAGE_BYTES:
        raise ValueError(f"a message has 1 to {MAX_MESSAGE_BYTES} bytes, not {len(message)}")
    plain = message + zlib.crc32(message).to_bytes(CRC_BYTES, "little")
    stretches = plain.split(DELIMITER)
    return b"".join(bytes([len(stretch) + 1]) + stretch for stretch in stretches) + DELIMITER


def decode(frame: bytes) -> Optional[bytes]:
    """The message of a frame without its delimiter; None if it is spoiled."""
    stretches = []
    at = 0
    while at < len(frame):
        end = at + frame[at]
        stretch = frame[at + 1 : end]
        if frame[at] == 0 or end > len(frame) or DELIMITER in stretch:
            return None
        stretches.append(stretch)
        at = end
    plain = DELIMITER.join(stretches)
    message, crc = plain[:-CRC_BYTES], plain[-CRC_BYTES:]
    if not message or zlib.crc32(message).to_bytes(CRC_BYTES, "little") != crc:
        return None
    return message


class FrameReader:
    """Cuts a stream of bytes into frames."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._overflow = False
        #: Frames that were spoiled.
        self.spoiled = 0

    def feed(self, received: bytes) -> Iterator[bytes]:
        """Takes bytes, and gives the messages that they end."""
        for byte in received:
            if byte != 0:
                if len(self._bytes) < MAX_FRAME_BYTES - len(DELIMITER):
                    self._bytes.append(byte)
                else:
                    self._overflow = True
                continue
            frame, overflow = bytes(self._bytes), self._overflow
            self._bytes.clear()
            self._overflow = False
            if not frame:
                continue
            message = None if overflow else decode(frame)
            if message is None:
                self.spoiled += 1
            else:
                yield message
