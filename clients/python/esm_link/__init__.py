"""A client of the link of a robot that runs the esm framework. The protocol is described in docs/link.md."""

from .client import Client, LinkLost, NoReply, OtherVersion, Refused, open_port
from .messages import PROTOCOL_VERSION, Malformed

__all__ = ["Client", "LinkLost", "Malformed", "NoReply", "OtherVersion", "PROTOCOL_VERSION", "Refused", "open_port"]
