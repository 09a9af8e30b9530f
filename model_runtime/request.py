"""What a run is asked for, checked: shared by the command line and the worker."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from .contract import (
    AUTO,
    CHOICES,
    DEVICES,
    EXPOSURES,
    FRAMES,
    LONGEST_PATTERN,
    MOST_DB,
    RANGES,
    SHORTEST_PATTERN,
    AgeRequest,
    exposure_weights,
    is_device,
    option,
    start_places,
)
from .errors import ModelFileError, TvbrdfError, UsageError, reason, shown
from .memory import check_limits, memory_in_words
from .model_files import weights
from .output.kept import Kept

__all__ = ("MissingLibraryError", "cards", "load_age", "load_look", "request_from")


class MissingLibraryError(TvbrdfError):
    """A Python without a library that is needed, or with one that does not load."""

    code = "missing_library"


def load_age(kept: Kept | None = None) -> Callable[..., dict[str, Any]]:
    """The function `age.age`, whose import takes seconds where it takes torch; where results are
    `kept`, it takes them.

    Raises:
        MissingLibraryError: a library is absent or does not load.
        OutOfMemoryError: there is not enough memory for them.
    """
    with _loading():
        if kept is not None:
            from .keeping import age_or_take

            return partial(age_or_take, kept=kept)
        from .age import age
    return age


def load_look() -> Callable[..., dict[str, Any]]:
    """The function `look.look`; raises as `load_age` does."""
    with _loading():
        from .look import look
    return look


@contextmanager
def _loading() -> Iterator[None]:
    check_limits()
    try:
        with memory_in_words("Close other programs."):
            yield
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"{shown(Path(sys.executable))} cannot load what aging needs ({reason(error)}).",
            "Install the extension again from the zip made for this system, or set Worker Python "
            "in its preferences to a Python that has numpy, OpenEXR, safetensors and Pillow, "
            "and torch or not.",
        ) from error


def request_from(fields: Mapping[str, Any]) -> AgeRequest:
    """The request that `fields` (the names of `AgeRequest`) describe; None means the default.

    Raises:
        UsageError: a field is missing, unknown, of the wrong kind or out of range.
    """
    given: dict[str, Any] = {name: value for name, value in fields.items() if value is not None}
    known = {field.name for field in dataclasses.fields(AgeRequest)}
    if unknown := sorted(given.keys() - known):
        raise UsageError(
            f"There is no setting called {shown(unknown[0])}.", f"There are {sorted(known)}."
        )
    for name in ("input", "ntm", "output"):
        if not isinstance(given.get(name), str) or not given[name]:
            raise UsageError(f"The setting {name} is missing.", "Give it as text.")
    for name in ("onset", "device", "surface", "exposure", "starts", "mask", "light", *CHOICES):
        if name in given and not isinstance(given[name], str):
            raise UsageError(f"The setting {name} must be text, not {shown(given[name])}.")
    for name, choices in CHOICES.items():
        if name in given and given[name] not in choices:
            raise UsageError(
                f"{option(name)} cannot be {shown(given[name])}.",
                f"Choose one of {', '.join(choices)}.",
            )
    for name, (least, most) in RANGES.items():
        if name in given and not (type(given[name]) is int and least <= given[name] <= most):
            raise UsageError(f"{option(name)} must be a whole number from {least} to {most}.")
    if not is_device(given.get("device", AUTO)):
        raise UsageError(
            f"{option('device')} cannot be {shown(given['device'])}.",
            f"Choose one of {DEVICES.replace('|', ', ')}.",
        )
    for name in ("sparse", "timing_apart"):
        if type(given.get(name, False)) is not bool:
            raise UsageError(f"The setting {name} must be true or false.")
    if "tolerance" in given:
        value = given["tolerance"]
        if type(value) not in (int, float) or not 0 < value <= MOST_DB:
            raise UsageError(
                f"{option('tolerance')} must be a positive number of dB, at most {MOST_DB}.",
                "Quality exact leaves nothing out.",
            )
        given["tolerance"] = float(value)
    if "grain" in given:
        value = given["grain"]
        if type(value) not in (int, float) or not 0 <= value <= 1:
            raise UsageError(f"{option('grain')} must be a number from 0 to 1.")
        given["grain"] = float(value)
    _check_growth(given)
    given["input"], given["output"] = Path(given["input"]), Path(given["output"])
    for name in {"surface", "mask", "light"} & given.keys():
        given[name] = Path(given[name])
    return AgeRequest(**given)


def _check_growth(given: dict[str, Any]) -> None:
    """The fields that say how aging grows over a surface: UsageError, or floats."""
    for name, least, most, what in (
        ("pattern_size", SHORTEST_PATTERN, LONGEST_PATTERN, "meters"),
        ("amount", 0, 1, "the surface"),
    ):
        if name in given:
            value = given[name]
            if type(value) not in (int, float) or not least <= value <= most:
                raise UsageError(
                    f"{option(name)} must be a number of {what} from {least:g} to {most:g}."
                )
            given[name] = float(value)
    if given.get("timing_apart") and (
        "surface" not in given
        or given.get("onset", AUTO) != AUTO
        or given.get("binding", FRAMES) == FRAMES
    ):
        raise UsageError(
            f"{option('timing_apart')} needs a surface for its layout, and a live material.",
            f"Give {option('surface')} and {option('binding')} live, and no {option('onset')}.",
        )
    try:
        start_places(given.get("starts", ""))
    except ValueError as error:
        raise UsageError(
            f"{option('starts')} cannot be read: {shown(error)}.",
            "Write each place as X,Y,Z in meters of the world, with a ; in between.",
        ) from error
    try:
        exposure_weights(given.get("exposure", ""))
    except ValueError as error:
        raise UsageError(
            f"{option('exposure')} cannot be read: {shown(error)}.",
            f"Write it like edges=0.5,ground=-1 with any of {', '.join(EXPOSURES)}.",
        ) from error


def cards(
    ntm: str | None, *, skipped: Callable[[ModelFileError], None] = lambda error: None
) -> list[dict[str, Any]]:
    """The cards of all bundled models, or of the one that `ntm` (a name or a file) means; `skipped`
    hears of each file that cannot be listed.
    """
    if ntm is None:
        found = weights.list_models(skipped=skipped)
    else:
        card = weights.read_card(weights.find_model(ntm))
        bundled = {each.name: each.path for each in weights.list_models()}.get(card.name)
        found = [card if bundled == card.path else replace(card, namesake=bundled)]
    return [
        {
            "description": card.description,
            **card.details,
            "summary": card.summary,
            "path": str(card.path),
        }
        for card in found
    ]
