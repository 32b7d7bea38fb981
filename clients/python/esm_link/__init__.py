"""A client of the link of a robot that runs the esm framework. The protocol is described in docs/link.md."""

from .client import Client, LinkLost, NoReply, NotBuiltIn, NotLocked, NotStopped, OtherKey, OtherVersion, Refused, Unproven, open_port
from .keys import Key, KeyProblem
from .messages import PROTOCOL_VERSION, Malformed

__all__ = [
    "Client",
    "Key",
    "KeyProblem",
    "LinkLost",
    "Malformed",
    "NoReply",
    "NotBuiltIn",
    "NotLocked",
    "NotStopped",
    "OtherKey",
    "OtherVersion",
    "PROTOCOL_VERSION",
    "Refused",
    "Unproven",
    "open_port",
]
