"""A client of the link of a robot that runs the esm framework. The protocol is described in docs/link.md."""

from .client import Client, LinkLost, NoReply, NotBuiltIn, OtherKey, OtherVersion, Refused, open_port
from .keys import Key, KeyProblem
from .messages import PROTOCOL_VERSION, Malformed

__all__ = ["Client", "Key", "KeyProblem", "LinkLost", "Malformed", "NoReply", "NotBuiltIn", "OtherKey", "OtherVersion", "PROTOCOL_VERSION", "Refused", "open_port"]
