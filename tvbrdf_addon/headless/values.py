"""What an option's value may be, as argparse's types: from text, or why not."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable

from ...model_runtime.contract import AUTO, exposure_weights
from .. import properties

__all__ = ("angle", "exposure", "frames", "number", "share", "size", "whole")


def frames(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(-?\d{1,18})-(-?\d{1,18})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text} is not a range such as 1-250")
    start, end = int(match[1]), int(match[2])
    if max(-start, end) > properties.LAST_FRAME:
        raise argparse.ArgumentTypeError(f"Blender knows no frame after {properties.LAST_FRAME}")
    if end <= start:
        raise argparse.ArgumentTypeError(f"{text} is empty: the last frame comes after the first")
    return start, end


def whole(least: int, most: int) -> Callable[[str], int]:
    def read(text: str) -> int:
        value = int(text) if re.fullmatch(r"-?\d{1,18}", text) else None
        if value is None or not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{text} is not a whole number of at least {least} and at most {most}"
            )
        return value

    return read


def size(text: str) -> int | str:
    return text if text == AUTO else whole(16, 8192)(text)


def number(least: float, most: float, unit: str = "") -> Callable[[str], float]:
    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f"{text} is not a number{unit} from {least:g} to {most:g}"
            )
        return value

    return read


def angle(most: float) -> Callable[[str], float]:
    """Radians, of degrees."""
    read = number(-most, most, " of degrees")
    return lambda text: math.radians(read(text))


def exposure(text: str) -> dict[str, float]:
    try:
        return exposure_weights(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def share(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d{1,9})/(\d{1,9})", text)
    part, parts = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= part <= parts:
        raise argparse.ArgumentTypeError(f"{text} is not a share such as 1/10 to 10/10")
    return part, parts
