"""The command `esm-link`."""

import argparse
import dataclasses
import json
import os
import sys

from . import (
    Client,
    Key,
    KeyProblem,
    LinkLost,
    Malformed,
    NoReply,
    NotBuiltIn,
    NotLocked,
    NotStopped,
    OtherKey,
    OtherVersion,
    Refused,
    Unproven,
    open_port,
)

DONE, REFUSED, WORLD_FAILED = 0, 1, 3


def read_key(path):
    return None if path is None else Key.read(path)


def stop(client: Client, path) -> None:
    """Stops the robot, whatever is the matter with the key."""
    client.send_stop()
    try:
        client.use_key(read_key(path))
    except KeyProblem:
        client.stop()
        raise
    client.stop()


def main(arguments=None) -> int:
    parser = argparse.ArgumentParser(prog="esm-link", description="Talks to a robot that runs the esm framework.")
    parser.add_argument("port", help="a serial line, or a URL of pyserial's (socket://HOST:PORT)")
    parser.add_argument("--baud", type=int, default=115_200)
    parser.add_argument("--key", metavar="FILE", default=os.environ.get("ESM_KEY") or None, help="the robot's key, which `esm key new` made [default: ESM_KEY]")
    commands = parser.add_subparsers(dest="command", required=True)
    for name, text in (
        ("hello", "who the robot is"),
        ("status", "how it is"),
        ("features", "what its firmware was built with, and without"),
        ("stop", "motors off, until `start`"),
        ("start", "the mission runs again"),
    ):
        commands.add_parser(name, help=text)
    upload = commands.add_parser("upload", help="gives it a mission")
    upload.add_argument("blob", type=argparse.FileType("rb"), help="what `esm build` made")
    trace = commands.add_parser("trace", help="its trace records, as JSON lines")
    trace.add_argument("--seconds", type=float, default=5.0)
    options = parser.parse_args(arguments)
    try:
        with open_port(options.port, options.baud) as port:
            client = Client(port)
            if options.command == "stop":
                stop(client, options.key)
                return DONE
            client.use_key(read_key(options.key))
            robot = client.hello()
            if options.command == "hello":
                print(json.dumps(dataclasses.asdict(robot)))
            elif options.command == "status":
                print(json.dumps(dataclasses.asdict(client.status())))
            elif options.command == "features":
                features = client.features()
                print(json.dumps({**dataclasses.asdict(features), "built_without": features.left_out()}))
            elif options.command == "upload":
                blob = options.blob.read()
                is_terminal = sys.stderr.isatty()

                def progress(there: int) -> None:
                    if is_terminal:
                        print(f"\r{there} of {len(blob)} bytes", end="", file=sys.stderr, flush=True)

                mission = client.upload(blob, progress)
                if is_terminal:
                    print(file=sys.stderr)
                print(json.dumps({"mission": mission, "bytes": len(blob)}))
            elif options.command == "trace":
                client.subscribe(trace=True)
                for record in client.trace(options.seconds):
                    print(json.dumps(record), flush=True)
                client.subscribe()
            else:
                getattr(client, options.command)()
        return DONE
    except (NotBuiltIn, NotLocked, OtherKey, Refused) as error:
        print(f"esm-link: {error}", file=sys.stderr)
        return REFUSED
    except (KeyProblem, LinkLost, Malformed, NoReply, NotStopped, OtherVersion, Unproven, OSError) as error:
        print(f"esm-link: {error}", file=sys.stderr)
        return WORLD_FAILED


if __name__ == "__main__":
    sys.exit(main())
