"""Distances between pictures, kept from call to call."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from ...metric.texture import Seen, TextureMetric, Textures
from ..bench.kept import identity, kept_json

__all__ = ("Comparison", "Picture")

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Picture:
    """pixels: [H, W, 3], sRGB; time: when it was taken, None of a scan; seconds: what it took."""

    pixels: Array
    time: float | None = None
    seconds: float | None = None

    @cached_property
    def identity(self) -> str:
        """A digest of what is seen."""
        return identity(torch.from_numpy(np.ascontiguousarray(self.pixels)))


@dataclass
class Comparison:
    """Distances by `metric`, kept in `folder`."""

    folder: Path
    metric: TextureMetric
    _seen: dict[str, Seen] = field(default_factory=dict)

    def distance(self, first: Picture, second: Picture) -> Textures:
        """How far one looks from the other."""

        def make() -> list[float]:
            return list(self.metric.distance(self._look(first), self._look(second)).layers)

        both = identity(first.identity, second.identity)
        return Textures(tuple(kept_json(self.folder / f"distance_{both[:20]}.json", both, make)))

    def _look(self, picture: Picture) -> Seen:
        if picture.identity not in self._seen:
            self._seen[picture.identity] = self.metric.seen(picture.pixels)
        return self._seen[picture.identity]
