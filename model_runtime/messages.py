"""What the worker and its client say to each other, one JSON object a line.

Both ends write and read them here; docs/worker-protocol.md tells when. What comes from the other
end may be anything at all: it is read without an error, and its words are not yet fit to be shown.
Standard library only.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

__all__ = (
    "Alive",
    "Done",
    "Failed",
    "Loaded",
    "Message",
    "Notice",
    "Progress",
    "Ready",
    "Reply",
    "Request",
    "Verb",
)

Verb = Literal["age", "look", "info", "cancel", "shutdown"]


@dataclass(frozen=True)
class Request:
    """What the client asks for: `verb` is one of `Verb` if it is right; answers repeat the `id`."""

    id: int | str
    verb: Any
    args: Mapping[str, Any]

    def line(self) -> str:
        """Without its end."""
        return json.dumps({"id": self.id, "verb": self.verb, "args": dict(self.args)})

    @classmethod
    def read(cls, line: bytes) -> Request | None:
        """The request in `line`; None where it is none."""
        try:
            asked = json.loads(line.decode())
            request_id, verb, args = asked["id"], asked["verb"], asked.get("args")
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return None
        if not isinstance(request_id, int | str) or not isinstance(args, dict | None):
            return None
        return cls(request_id, verb, args or {})


@dataclass(frozen=True)
class Ready:
    """The first line of all: the worker listens, and speaks this version of the protocol."""

    protocol: Any
    version: str


@dataclass(frozen=True)
class Loaded:
    """What computes is imported: a `backend` and its version, on a `device` by default; empty where
    a worker does not say.
    """

    backend: str = ""
    device: str = ""


@dataclass(frozen=True)
class Alive:
    """A sign of life, while it imports or ages."""


@dataclass(frozen=True)
class Progress:
    """How far a run is: `fraction` of the whole, 0 to 1."""

    stage: str
    fraction: float


@dataclass(frozen=True)
class Notice:
    """Something the user should know about the run; it goes on."""

    message: str


@dataclass(frozen=True)
class Failed:
    """The end of a request that was not carried out: a kind of failure, what is wrong, what to do.

    `details` is the traceback of what nobody foresaw.
    """

    code: str
    message: str
    hint: str
    details: str = ""


@dataclass(frozen=True)
class Done:
    """The end of a request that was; of `age`, the content of `aged.json`."""

    result: Any


Message = Ready | Loaded | Alive | Progress | Notice | Failed | Done

_NAMES: Mapping[type[Message], str] = {
    Ready: "ready",
    Loaded: "loaded",
    Alive: "alive",
    Progress: "progress",
    Notice: "warning",
    Failed: "error",
    Done: "done",
}


@dataclass(frozen=True)
class Reply:
    """What the worker says: a message, and the `id` of the request that it answers, if any.

    `message` is None where a worker says what is not known here.
    """

    message: Message | None
    id: int | str | None = None

    def line(self) -> str:
        """Without its end; raises TypeError, ValueError or RecursionError for a result that is no
        JSON.
        """
        assert self.message is not None
        fields = {"type": _NAMES[type(self.message)], **vars(self.message)}
        if not isinstance(self.message, Ready):
            fields = {"id": self.id, **fields}
        return json.dumps({k: v for k, v in fields.items() if (k, v) != ("details", "")})

    @classmethod
    def read(cls, line: str) -> Reply | None:
        """The reply in `line`; None where it is none."""
        try:
            said = json.loads(line)
        except (ValueError, RecursionError):
            return None
        return cls(_message(said), said.get("id")) if isinstance(said, dict) else None


def _message(said: Mapping[str, Any]) -> Message | None:
    match said:
        case {"type": "ready"}:
            return Ready(said.get("protocol"), str(said.get("version")))
        case {"type": "loaded"}:
            return Loaded(*(str(said.get(name) or "") for name in ("backend", "device")))
        case {"type": "alive"}:
            return Alive()
        case {"type": "progress", "stage": str(stage), "fraction": int() | float() as fraction}:
            return Progress(stage, fraction)
        case {"type": "warning", "message": str(message)}:
            return Notice(message)
        case {"type": "error"}:
            words = (str(said.get(name) or "") for name in ("code", "message", "hint", "details"))
            return Failed(*words)
        case {"type": "done", "result": result}:
            return Done(result)
    return None
