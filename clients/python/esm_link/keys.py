"""Keys, and what they sign (section 13 of docs/link.md)."""

import os
import stat
from typing import Callable

MARK = "esm-key-1 "
MAX_FILE_BYTES = 4096
PRIVATE_BYTES = 32
SEED_BYTES = 16
SIGNATURE_BYTES = 64

#: Stands for the signature of an upload where a request has nothing to do with one.
NO_UPLOAD = bytes(SIGNATURE_BYTES)


class KeyProblem(Exception):
    """There is no key to sign with."""


def command_message(nonce: bytes, upload: bytes, request: bytes) -> bytes:
    """What is signed for a request; `upload` is the signature of the upload that a commit is about."""
    return b"esm command v1\0\0" + nonce + upload + request


def upload_message(counter: int, blob: bytes) -> bytes:
    """What is signed for a mission."""
    return b"esm upload v1\0\0\0" + counter.to_bytes(8, "little") + blob


def install_message(public: bytes, seed: bytes) -> bytes:
    """What a key signs of itself to be installed."""
    return b"esm install v1\0\0" + public + seed


def new_seed() -> bytes:
    """What a robot makes its nonces from: bytes that nobody can guess."""
    return os.urandom(SEED_BYTES)


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

    def sign_installation(self, seed: bytes) -> bytes:
        """The signature without which no robot takes this key."""
        return self.sign(install_message(self.public, seed))

    def __repr__(self) -> str:
        return f"Key({self.public.hex()})"
