"""The materials of the report `representation`, in groups that fit in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from model_runtime.brdf import disney, rgl, torrance_sparrow
from model_runtime.brdf.disney import DisneyParameters

from ...data.analytic import random_disney, random_torrance_sparrow
from ...data.folder import Crop
from ...data.nbrdf import HELD_OUT, NeuralBRDFs, load
from ...data.sequences import Sequence, read_sequence

__all__ = ("BAD_FITS", "BLOCK", "FRAMES", "SEED", "SETS", "UNIFORM", "Materials", "material_sets")

SEED = 20240715
BAD_FITS = ("chm_orange_rgb",)
"""Networks of the data folder that miss their own measurement: listed, and never the worst."""

UNIFORM = ("merl_seen", "merl_held_out", "rgl", "bsdf", "disney", "torrance_sparrow")
FRAMES = ("tvbtf45", "snowyground")
SETS = (*UNIFORM, *FRAMES)

BLOCK = 4
"""Pixels a side of a texel: what a texture costs is its distinct BRDFs, and some methods are
dear."""

_TIMES = 5
_ANALYTIC = 100
_TOGETHER = 25
_CENTER: Crop = (slice(80, 380), slice(80, 380))
_SOURCES: dict[str, tuple[str, Crop | None]] = {
    "tvbtf45": ("tvBTF45", _CENTER),
    "snowyground": ("SnowyGround", None),
}

Rows = Tensor
Evaluate = Callable[[Rows, Tensor], Tensor]


@dataclass(frozen=True)
class Materials:
    """BRDFs that are handled together: `evaluate`(rows [N], angles [M, 3]) -> f [N, M, 3].

    key: what they are called in files. names: what gets a score each, a uniform material or a
    frame. texels [P]: of a frame, the row that each pixel of the sphere shows; None where every row
    is a material of its own. n: how many rows there are. measured: whether they come from a
    goniometer.
    """

    key: str
    names: tuple[str, ...]
    evaluate: Evaluate
    texels: Tensor | None
    n: int
    measured: bool = False

    def every(self, angles: Tensor) -> Tensor:
        """f [n, M, 3] of all rows."""
        return self.evaluate(torch.arange(self.n), angles)

    def chosen(self, rows: Tensor) -> Materials:
        """Only the uniform materials `rows`."""
        assert self.texels is None
        return Materials(
            self.key,
            tuple(self.names[i] for i in rows),
            lambda inner, angles: self.evaluate(rows[inner], angles),
            None,
            len(rows),
            self.measured,
        )


def material_sets(
    data: Path, inside: Tensor, *, wanted: tuple[str, ...] = SETS, limit: int | None = None
) -> dict[str, list[Materials]]:
    """The sets `wanted`, for spheres that show the pixels `inside` [S, S]; of each at most `limit`
    uniform materials, evenly spread over the set.

    No bundled encoder was trained on `merl_held_out`, `rgl`, `bsdf`, the two textures or these
    draws of `disney` and `torrance_sparrow`. For MERL and RGL the truth is what Neural-BRDF's
    networks say. Textures are Torrance-Sparrow maps at five times, 0 to 1, clamped to what can be
    rendered; a texel covers 4 x 4 pixels of the sphere and is the one texel of the map at the
    block's middle.
    """
    makers: dict[str, Callable[[], list[Materials]]] = {
        "merl_seen": lambda: [_networks("merl_seen", load(data, "merl").without(HELD_OUT))],
        "merl_held_out": lambda: [
            _networks("merl_held_out", load(data, "merl").select(list(HELD_OUT)))
        ],
        "rgl": lambda: [_networks("rgl", load(data, "rgl-isotropic"))],
        "bsdf": lambda: [_measured(path) for path in sorted((data / "bsdf").glob("*.bsdf"))],
        "disney": lambda: [_analytic()[0]],
        "torrance_sparrow": lambda: [_analytic()[1]],
    }
    sets = {}
    for name in wanted:
        if name in FRAMES:
            sets[name] = _frames(name, data, inside)
        else:
            sets[name] = _grouped(makers[name](), limit)
    return sets


def _grouped(sources: list[Materials], limit: int | None) -> list[Materials]:
    """At most `limit` materials of `sources`, evenly spread, at most 25 a group."""
    total = sum(source.n for source in sources)
    count = total if limit is None else min(limit, total)
    keep = torch.linspace(0, total - 1, count).round().long()
    groups, start = [], 0
    for source in sources:
        mine = keep[(keep >= start) & (keep < start + source.n)] - start
        groups += [
            replace(source.chosen(rows), key=f"{source.key}_{part}")
            for part, rows in enumerate(mine.split(_TOGETHER))
            if len(rows)
        ]
        start += source.n
    return groups


def _networks(key: str, networks: NeuralBRDFs) -> Materials:
    return Materials(key, networks.names, networks.evaluate, None, len(networks), measured=True)


def _measured(path: Path) -> Materials:
    brdf = rgl.read(path)
    return Materials(
        f"bsdf_{brdf.name}",
        (brdf.name,),
        lambda rows, angles: brdf.evaluate(angles)[None].expand(len(rows), -1, -1),
        None,
        1,
        measured=True,
    )


def _analytic() -> tuple[Materials, Materials]:
    """A hundred random Disney and a hundred random Torrance-Sparrow materials."""
    g = torch.Generator().manual_seed(SEED)
    draws = [
        (random_disney(_TOGETHER, g), random_torrance_sparrow(_TOGETHER, g))
        for _ in range(_ANALYTIC // _TOGETHER)
    ]
    parameters = [
        torch.cat(columns)
        for columns in zip(*(tuple(vars(draw).values()) for draw, _ in draws), strict=True)
    ]
    states = [torch.cat(columns) for columns in zip(*(draw for _, draw in draws), strict=True)]

    def principled(rows: Tensor, angles: Tensor) -> Tensor:
        chosen = DisneyParameters(*(values[rows] for values in parameters))
        return disney.evaluate(chosen, angles)

    names = tuple(str(i) for i in range(_ANALYTIC))
    return (
        Materials("disney", names, principled, None, _ANALYTIC),
        Materials("torrance_sparrow", names, _torrance_sparrow(*states), None, _ANALYTIC),
    )


def _torrance_sparrow(kd: Tensor, ks: Tensor, alpha: Tensor) -> Evaluate:
    return lambda rows, angles: torrance_sparrow.evaluate(kd[rows], ks[rows], alpha[rows], angles)


def _frames(name: str, data: Path, inside: Tensor) -> list[Materials]:
    """The sequence `name`, a frame a group."""
    folder, crop = _SOURCES[name]
    sequence = read_sequence(data / "tvbtf" / folder, frames=_TIMES, crop=crop)
    assert isinstance(sequence, Sequence)
    height, width = sequence.alpha.shape[1:]
    blocks = -(-len(inside) // BLOCK)
    row, column = inside.nonzero().T // BLOCK
    shown, texels = (row * blocks + column).unique(return_inverse=True)
    y = ((shown // blocks + 0.5) / blocks * height).long()
    x = ((shown % blocks + 0.5) / blocks * width).long()
    return [
        Materials(
            f"{name}_{frame}",
            (f"t = {time:g}",),
            _torrance_sparrow(*(torch.from_numpy(values[frame])[y, x] for values in maps)),
            texels,
            len(shown),
        )
        for maps in [(sequence.kd, sequence.ks, sequence.alpha)]
        for frame, time in enumerate(sequence.times.tolist())
    ]
