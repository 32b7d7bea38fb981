"""Keys, what they sign, and sessions of a robot's owner (section 13 of docs/link.md)."""

import hashlib
import hmac
import os
import stat
from typing import Callable, Tuple

from .messages import NONCE_BYTES, PROOF_BYTES, PROVEN, SALT_BYTES, Raw, without_number

MARK = "esm-key-1 "
MAX_FILE_BYTES = 4096
PRIVATE_BYTES = 32
SIGNATURE_BYTES = 64
CONTEXT_BYTES = 16
# Of a number in what is proven.
NUMBER_BYTES = 4
COUNTER_BYTES = 8
#: The last number that a session has.
LAST_NUMBER = 2**32 - 1

#: Stands for the signature of an upload where a request has nothing to do with one.
NO_UPLOAD = bytes(SIGNATURE_BYTES)


class KeyProblem(Exception):
    """There is no key to sign with."""


def context(text: str) -> bytes:
    """What begins all that is signed or proven: no bytes are good for two purposes."""
    return text.encode().ljust(CONTEXT_BYTES, b"\0")


def counter_bytes(counter: int) -> bytes:
    return counter.to_bytes(COUNTER_BYTES, "little")


def command_message(nonce: bytes, upload: bytes, request: bytes) -> bytes:
    """What is signed for a request; `upload` is the signature of the upload that a commit is about."""
    return context("esm command v1") + nonce + upload + request


def upload_message(salt: bytes, counter: int, blob: bytes) -> bytes:
    """What is signed for a mission."""
    return context("esm upload v2") + salt + counter_bytes(counter) + blob


def install_message(public: bytes, salt: bytes, secret: bytes) -> bytes:
    """What a key signs of itself to be installed; the secret is the one that is sent."""
    return context("esm install v2") + public + salt + secret


def random_bytes() -> bytes:
    """A nonce or a salt: bytes that nobody can guess."""
    assert NONCE_BYTES == SALT_BYTES
    return os.urandom(NONCE_BYTES)


def mac(key: bytes, text: str, *parts: bytes) -> bytes:
    """All bytes of a proof with this context."""
    return hmac.new(key, context(text) + b"".join(parts), hashlib.sha256).digest()


def short_mac(key: bytes, text: str, *parts: bytes) -> bytes:
    """A proof as messages have it."""
    return mac(key, text, *parts)[:PROOF_BYTES]


def is_same(proof: bytes, other: bytes) -> bool:
    return hmac.compare_digest(proof, other)


def identity_proof(secret: bytes, client: bytes, key: bytes, salt: bytes, robot: bytes, counter: int) -> bytes:
    """What shows that a robot has the secret. `client` and `robot` are the nonces."""
    return short_mac(secret, "esm identity v1", client, key, salt, robot, counter_bytes(counter))


class OwnerSession:
    """A session of a robot's owner: requests that the robot can tell from those of others, and answers that are its own."""

    def __init__(self, secret: bytes, salt: bytes, client: bytes, robot: bytes) -> None:
        #: Names the robot's secret, and is part of what is signed.
        self.salt = salt
        #: Of the last request.
        self.number = 0
        key = mac(secret, "esm session v1", client, robot)
        # Not in an attribute: what prints the session does not print its key.
        self._mac: Callable[..., bytes] = lambda text, *parts: short_mac(key, text, *parts)

    def opening(self) -> bytes:
        """What shows that this side has the secret."""
        return self._mac("esm opening v1")

    def prove(self, request: bytes) -> Tuple[int, bytes]:
        """The next request, which has this number, within `Proven`."""
        self.number += 1
        proof = self._mac("esm request v1", self.number.to_bytes(NUMBER_BYTES, "little"), request)
        return self.number, without_number(PROVEN, self.number, Raw(proof), request)

    def answer_proof(self, number: int, proven: bytes) -> bytes:
        """What an answer to the request of this number must have."""
        return self._mac("esm answer v1", number.to_bytes(NUMBER_BYTES, "little"), proven)

    def mask(self, secret: bytes, salt: bytes) -> bytes:
        """The secret of a new key, so that who listens does not learn it."""
        return bytes(a ^ b for a, b in zip(secret, self._mac("esm mask v1", salt)))


class Key:
    """A key with its private part, which shows itself to nobody: neither in what it prints nor in what it raises."""

    def __init__(self, private: bytes) -> None:
        try:
            from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
            from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat
        except ImportError as cause:
            raise KeyProblem("the package `cryptography` is missing; `pip install 'esm-link[keys]'` brings it") from cause
        if len(private) != PRIVATE_BYTES:
            raise KeyProblem(f"a key has {PRIVATE_BYTES} bytes")
        pair = Ed25519PrivateKey.from_private_bytes(private)
        #: What its owner shares with the robot of this salt.
        self.secret: Callable[[bytes], bytes] = lambda salt: short_mac(private, "esm secret v1", salt)
        #: Signs a message.
        self.sign: Callable[[bytes], bytes] = pair.sign
        #: The part that everyone may know.
        self.public: bytes = pair.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)

    @classmethod
    def read(cls, path: "str | os.PathLike[str]") -> "Key":
        """Reads a file that `esm key new` made. Others must not be able to read it."""
        try:
            with open(path, "rb") as file:
                about = os.fstat(file.fileno())
                if about.st_mode & 0o077:
                    raise KeyProblem(f"others may read the key at {path}; `chmod 600` makes it yours alone")
                is_file = stat.S_ISREG(about.st_mode) and about.st_size <= MAX_FILE_BYTES
                text = file.read(MAX_FILE_BYTES) if is_file else b""
        except OSError as cause:
            raise KeyProblem(f"cannot read the key at {path}: {cause.strerror}") from cause
        for line in text.split(b"\n"):
            digits = line[len(MARK) :].rstrip()
            if line.startswith(MARK.encode()) and len(digits) == 2 * PRIVATE_BYTES:
                try:
                    private = bytes.fromhex(digits.decode("ascii"))
                except ValueError:
                    break  # Whose words would have the digits in them.
                return cls(private)
        raise KeyProblem(f"{path} is no key that `esm key new` has made")

    def sign_installation(self, salt: bytes, secret: bytes) -> bytes:
        """The signature without which no robot takes this key; the secret is the one that is sent."""
        return self.sign(install_message(self.public, salt, secret))

    def __repr__(self) -> str:
        return f"Key({self.public.hex()})"
