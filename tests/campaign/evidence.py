"""What a trial leaves behind: the program's answer, and the files before and after."""

from __future__ import annotations

import json
import os
import re
import stat
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenEXR

__all__ = ("Answer", "Ended", "Evidence", "Result", "Tree", "read_result", "tree_of")

Ended = Literal["done", "refused", "stopped", "died", "hung"]
Tree = Mapping[str, str]
"""What lies at each path below a folder: a file's checksum, a link's target, or its sort."""

_MOST_BYTES = 1 << 28
_FRAME = re.compile(r"[a-z_]+_[0-9]{4,}\.exr")


@dataclass(frozen=True)
class Answer:
    """How a program ended what it was asked.

    ended:   "stopped" means by the signal that the trial sent, "died" by any other way out that is
             not the program's own
    code:    the exit code, the name of the signal, or the worker's code of an error
    words:   what the user reads, each sentence for itself
    log:     stderr
    noise:   what stderr holds besides progress, warnings and the sentence
    result:  what the worker handed back
    """

    ended: Ended
    code: str = ""
    words: tuple[str, ...] = ()
    log: str = ""
    noise: str = ""
    seconds: float = 0.0
    peak_mb: float = 0.0
    result: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Result:
    """What an output holds, read without the program's own code.

    files:  checksums of what its report lists, and of the report, by name
    broken: what is listed and is absent, cannot be read, or has another number of frames
    absurd: files with values that are NaN or infinite
    """

    files: Mapping[str, str]
    broken: tuple[str, ...] = ()
    absurd: tuple[str, ...] = ()

    @property
    def textures(self) -> dict[str, str]:
        """`files` without the report, which tells times and so is never the same."""
        return {name: sort for name, sort in self.files.items() if name != "aged.json"}


@dataclass(frozen=True)
class Evidence:
    """One answer of the program, and what its trial's folder held before and after it.

    output:     the output's path below that folder; None where the program has to write nothing
    earlier:    the result that it held before
    result:     the result that it holds now
    expected:   how the program has to end, where only that is right
    alone:      what the textures may be: results of undisturbed runs; empty where any will do
    beside:     endings of what may appear beside the output
    abandoned:  the program was killed beyond cleaning up: what it staged may still lie there
    untold:     the program could not tell of its result: a refusal may leave a whole new one
    complaints: what the trial itself saw and is wrong
    """

    answer: Answer
    before: Tree
    after: Tree
    output: str | None
    earlier: Result | None = None
    result: Result | None = None
    expected: Ended | None = None
    alone: tuple[Mapping[str, str], ...] = ()
    beside: tuple[str, ...] = ()
    abandoned: bool = False
    untold: bool = False
    complaints: tuple[str, ...] = ()


def tree_of(folder: Path) -> dict[str, str]:
    """Everything below `folder`; nothing that would wait, or lies elsewhere, is opened."""
    tree: dict[str, str] = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            try:
                tree[str(path.relative_to(folder))] = _sort_of(path)
            except OSError as error:
                tree[str(path.relative_to(folder))] = f"unreadable: {error.strerror}"
    return tree


def _sort_of(path: Path) -> str:
    mode = path.lstat().st_mode
    if stat.S_ISLNK(mode):
        return f"link to {path.readlink()}"
    if stat.S_ISDIR(mode):
        return "folder"
    return _checksum(path) if stat.S_ISREG(mode) else "special"


def _checksum(path: Path) -> str:
    if (size := path.stat().st_size) > _MOST_BYTES:
        return f"{size} bytes"
    content = path.read_bytes()
    return f"{len(content)} bytes {zlib.crc32(content):08x}"


def read_result(output: Path) -> Result | None:
    """What `output` holds: aged maps in a folder, or a model file; None where it is neither."""
    try:
        if output.is_file():
            return _read_model(output)
        described = output / "aged.json"
        if not described.is_file() or described.stat().st_size > _MOST_BYTES:
            return None
        report = json.loads(described.read_text(encoding="utf-8"))
        maps = {
            name: [_names(entry) for entry in entries] for name, entries in report["files"].items()
        }
        frames = report["frames"]
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
        struct.error,
    ):
        return None
    broken = [name for name, entries in maps.items() if len(entries) != frames]
    absurd = []
    files = {"aged.json": _checksum(output / "aged.json")}
    for name in sorted({each for entries in maps.values() for names in entries for each in names}):
        try:
            if not _FRAME.fullmatch(name):
                raise ValueError(name)
            files[name] = _checksum(output / name)
            if not _is_finite(output / name):
                absurd.append(name)
        except Exception:  # OpenEXR raises many kinds
            broken.append(name)
    return Result(files, tuple(broken), tuple(absurd))


def _names(entry: Any) -> list[str]:
    """The files that make a frame: one, or several with the weight of each."""
    return [entry] if isinstance(entry, str) else [name for name, _weight in entry]


def _is_finite(path: Path) -> bool:
    with path.open("rb") as file:  # OpenEXR takes no name that is not UTF-8
        name = f"/proc/self/fd/{file.fileno()}"
        channels = OpenEXR.File(name, separate_channels=True).channels()
    return all(np.isfinite(channel.pixels).all() for channel in channels.values())


def _read_model(path: Path) -> Result | None:
    content = path.read_bytes()
    (length,) = struct.unpack_from("<Q", content)
    header = json.loads(content[8 : 8 + length])
    json.loads(header.pop("__metadata__")["card"])
    body, absurd = content[8 + length :], []
    for name, entry in header.items():
        start, end = entry["data_offsets"]
        if not np.isfinite(np.frombuffer(body[start:end], "<f4")).all():
            absurd.append(name)
    return Result({path.name: _checksum(path)}, absurd=tuple(absurd))
