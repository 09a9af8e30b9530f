"""Damage: what random bytes, a lying length or an odd value make of an honest file."""

from __future__ import annotations

import copy
import json
import random
import struct
from collections.abc import Callable, Iterator
from typing import Any

__all__ = ("ODD_NUMBERS", "ODD_TEXTS", "ODD_VALUES", "damaged", "damaged_json", "odd_json")

ODD_NUMBERS: tuple[Any, ...] = (
    *(0, -1, 1, 2, 1.5, -0.0, 1e-320, 1e30, 1e308, -1e308),
    *(float("nan"), float("inf"), float("-inf")),
    *(2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63, 2**64, 10**30, -(2**63), 10**400),
)
ODD_TEXTS = (
    *(
        "",
        " ",
        "\0",
        "x\0y",
        "\n",
        "a\nb\rc",
        "\t",
        "..",
        "/proc/x",
        "-",
        "--help",
        "~",
        "%s%n",
        "{0}",
    ),
    *("\x1b[2J\x1b[31m", "\x1b]0;title\x07", "\x9b2J", "\x7f", "\u202eevil", "\ufeff"),
    *("ünïcödé", "材質", "🧱", "\ud800", "\udfff", "e\u0301", "İ", "NaN", "null", "1e999"),
    *("x" * 300, "x" * 5000, "x" * 100_000, "\u0301" * 2000, "a/" * 3000),
)
ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, [], {}, [[]], {"": {}}, [None], [1, "a"], {"a": [1]}),
    *ODD_NUMBERS,
    *ODD_TEXTS,
    *([0] * 10_000, [["x", 1.0]] * 1000, {str(k): k for k in range(1000)}),
)
_DEEP = "@deep@"


def damaged(content: bytes, rng: random.Random) -> bytes:
    """`content` with one to three damages."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        if content:
            content = rng.choice(_DAMAGES)(content, rng)
    return content


def _flip(content: bytes, rng: random.Random) -> bytes:
    """A few bytes changed, early ones, where headers lie, more often."""
    changed = bytearray(content)
    reach = rng.choice((16, 64, 512, len(changed)))
    for _ in range(rng.choice((1, 2, 8, 64))):
        changed[rng.randrange(min(reach, len(changed)))] = rng.randrange(256)
    return bytes(changed)


def _cut(content: bytes, rng: random.Random) -> bytes:
    return content[: rng.choice((0, 1, 7, 8, 12, rng.randrange(len(content)), len(content) - 1))]


def _drop(content: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(content))
    return content[:at] + content[at + rng.choice((1, 4, 100)) :]


def _insert(content: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(content))
    return content[:at] + rng.randbytes(rng.choice((1, 4, 1000))) + content[at:]


def _append(content: bytes, rng: random.Random) -> bytes:
    return content + rng.choice((b"\0", b"\0" * 4096, rng.randbytes(100), content))


def _blank(content: bytes, rng: random.Random) -> bytes:
    at, length = rng.randrange(len(content)), rng.choice((4, 64, 4096))
    fill = rng.choice((b"\0", b"\xff", b"\x7f"))
    return content[:at] + (fill * length)[: len(content) - at] + content[at + length :]


def _lie(content: bytes, rng: random.Random) -> bytes:
    """A number in the header replaced by an extreme one."""
    form = rng.choice(("<H", ">H", "<I", ">I", "<i", "<Q", "<f", "<d"))
    size = struct.calcsize(form)
    if len(content) < size:
        return content
    values = {"f": (float("nan"), float("inf"), 3e38, -1.0), "i": (-1, -(2**31), 2**31 - 1)}
    most = 2 ** (8 * size) - 1
    whole = (0, 1, most, most >> 1, (most >> 1) + 1, 65535, 16385)
    value = rng.choice(values.get("f" if form[1] in "fd" else form[1], whole))
    at = rng.randrange(min(len(content) - size + 1, rng.choice((32, 256, 2048))))
    return content[:at] + struct.pack(form, value) + content[at + size :]


_DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    *(_flip, _cut, _drop, _insert, _append, _blank, _lie, _lie),
)


def odd_json(value: Any, rng: random.Random) -> Any:
    """A copy of `value` with one or two of its parts replaced, removed, added or renamed."""
    changed = copy.deepcopy(value)
    for _ in range(rng.choice((1, 1, 2))):
        places = list(_places(changed))
        if not places:
            return rng.choice(ODD_VALUES)
        holder, key = rng.choice(places)
        odd = rng.choice((*ODD_VALUES, _DEEP))
        match rng.choice(("replace", "replace", "replace", "remove", "add")):
            case "replace":
                holder[key] = odd
            case "remove":
                del holder[key]
            case "add" if isinstance(holder, dict):
                holder[rng.choice(ODD_TEXTS)] = odd
            case "add":
                holder.append(odd)
    return changed


def damaged_json(value: Any, rng: random.Random) -> bytes:
    """`value` as JSON text with something wrong in its values or, now and then, in its text."""
    text = json.dumps(odd_json(value, rng))
    text = text.replace(json.dumps(_DEEP), "[" * 50_000 + "]" * 50_000)
    content = text.encode()
    match rng.randrange(12):
        case 0:
            return damaged(content, rng)
        case 1:
            return rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\x80", b" " * 10_000)) + content
        case 2:
            return content.decode().encode(rng.choice(("utf-16", "utf-32", "latin-1")))
        case _:
            return content


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every (holder, key) in a tree of objects and lists."""
    if isinstance(value, dict | list):
        for key in list(value) if isinstance(value, dict) else range(len(value)):
            yield value, key
            yield from _places(value[key])
