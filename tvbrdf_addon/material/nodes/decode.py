"""Frozen dataclasses out of JSON: everything there, of its type, and nothing else."""

from __future__ import annotations

from dataclasses import is_dataclass
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

__all__ = ("decoded",)


def decoded(kind: Any, data: object) -> Any:
    """`data` as the type `kind`: a dataclass, a tuple of any length, a union, a number, a text.

    Raises `TypeError` or `ValueError` where it is something else.
    """
    if isinstance(kind, type) and is_dataclass(kind):
        if not isinstance(data, dict):
            raise TypeError(f"no {kind.__name__}")
        hints = get_type_hints(kind)
        unknown = sorted(set(data) - set(hints))
        if unknown:
            raise ValueError(f"unknown {unknown[0]}")
        return kind(**{name: decoded(hints[name], each) for name, each in data.items()})
    if isinstance(kind, UnionType):
        return _one_of(get_args(kind), data)
    if get_origin(kind) is tuple:
        if not isinstance(data, list):
            raise TypeError("no list")
        return tuple(decoded(get_args(kind)[0], each) for each in data)
    if kind is float and type(data) is int:
        return data
    if type(data) is not kind:
        raise TypeError(f"no {kind.__name__}")
    return data


def _one_of(kinds: tuple[Any, ...], data: object) -> Any:
    for kind in kinds:
        try:
            return decoded(kind, data)
        except (TypeError, ValueError):
            continue
    raise TypeError("of no known type")
