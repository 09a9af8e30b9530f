"""What a run is asked for, checked: shared by the command line and the worker."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import package
from .errors import TvbrdfError, UsageError

if TYPE_CHECKING:
    from .age import AgeRequest

__all__ = ("CHOICES", "MissingLibraryError", "cards", "load_age", "option", "request_from")

CHOICES: Mapping[str, tuple[str, ...]] = {
    "quality": ("draft", "balanced", "exact"),
    "temporal_model": ("auto", "constant", "affine", "lstm_parameters", "lstm_latents"),
    "specular": ("rgb", "mono"),
    "format": ("torrance-sparrow", "principled", "principled-exact"),
    "binding": ("auto", "live", "frames"),
}


class MissingLibraryError(TvbrdfError):
    """A Python without torch, or with one that does not load."""

    code = "missing_library"


def load_age() -> Callable[..., dict[str, Any]]:
    """The function `age.age`, whose import takes torch, and so seconds.

    Raises:
        MissingLibraryError: torch or another library is absent or does not load.
    """
    try:
        from .age import age
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"{sys.executable} cannot load what ageing needs ({error}).",
            "Install the extension again from the zip made for this system, or set Worker Python "
            "in its preferences to a Python that has torch, numpy, OpenEXR and safetensors.",
        ) from error
    return age


def request_from(fields: Mapping[str, Any]) -> AgeRequest:
    """The request that `fields` (the names of `AgeRequest`) describe; None means the default.

    Raises:
        UsageError: a field is missing, unknown, of the wrong kind or out of range.
    """
    from .age import AgeRequest

    given: dict[str, Any] = {name: value for name, value in fields.items() if value is not None}
    known = {field.name for field in dataclasses.fields(AgeRequest)}
    if unknown := sorted(given.keys() - known):
        raise UsageError(f"There is no setting called {unknown[0]}.", f"There are {sorted(known)}.")
    for name in ("input", "ntm", "output"):
        if not isinstance(given.get(name), str) or not given[name]:
            raise UsageError(f"The setting {name} is missing.", "Give it as text.")
    for name in ("onset", *CHOICES):
        if name in given and not isinstance(given[name], str):
            raise UsageError(f"The setting {name} must be text, not {given[name]!r}.")
    for name, choices in CHOICES.items():
        if name in given and given[name] not in choices:
            raise UsageError(
                f"{option(name)} cannot be {given[name]}.", f"Choose one of {', '.join(choices)}."
            )
    for name, least in (("frames", 1), ("size", 1), ("seed", 0)):
        if name in given:
            value = given[name]
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise UsageError(f"{option(name)} must be a whole number of at least {least}.")
    if "tolerance" in given:
        value = given["tolerance"]
        if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
            raise UsageError(f"{option('tolerance')} must be a positive number of dB.")
        given["tolerance"] = float(value)
        if math.isinf(given["tolerance"]):
            raise UsageError(
                f"{option('tolerance')} must be finite.", "Quality exact leaves nothing out."
            )
    given["input"], given["output"] = Path(given["input"]), Path(given["output"])
    return AgeRequest(**given)


def cards(ntm: str | None) -> list[dict[str, Any]]:
    """The cards of all bundled models, or of the one that `ntm` (a name or a file) means."""
    found = package.list_models() if ntm is None else [package.read_card(package.find_model(ntm))]
    return [{**card.details, "path": str(card.path)} for card in found]


def option(name: str) -> str:
    """The command line's name of a field of `AgeRequest`."""
    return "--" + name.replace("_", "-")
