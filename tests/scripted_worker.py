"""What tests of the worker share: pieces of scripts that speak the protocol, and listening."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

READY = 'import json, sys, time\nprint(json.dumps({"type": "ready", "protocol": 1}), flush=True)\n'
LOADED = 'print(json.dumps({"type": "loaded"}), flush=True)\n'
REQUESTED = "request = json.loads(sys.stdin.readline())\n"
# And until it is told to go.
DONE = """
print(json.dumps({"id": request["id"], "type": "done", "result": {"fine": True}}), flush=True)
sys.stdin.readline()
"""


def all_of(messages: Iterator, each: Callable[[object], None] = lambda message: None) -> list:
    """Every message of a run, as the blocking path takes them; `each` hears them as they come."""
    heard = []
    for message in messages:
        if message is None:
            time.sleep(0.01)
        else:
            heard.append(message)
            each(message)
    return heard
