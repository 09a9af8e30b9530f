"""What a time-lapse under one light shows of how a material weathers.

Pictures are color, and that under one lamp: texels under its highlight are left out; what the
highlight's fading tells of gloss is used; metal, roughness and relief are otherwise assumed, and
that is said. Those texels that change most show what becomes of all: the others are younger.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.errors import InputError

from ..data.sequences import Sequence, uniform_times
from .change import Change
from .distance import smoothed
from .onsets import correlation_length, estimate_onset
from .pictures import read_pictures
from .quilting import quilted
from .scan import AGES
from .steadiness import steadied

__all__ = ("Timelapse", "change_of_timelapse", "read_timelapse")

Array = NDArray[np.float32]

_ALIKE = 0.4  # correlation of detail between two pictures that lie over each other
_JUMPS = 0.05  # share of steps without it, from which on they do not
_DETAIL = 6.0  # texels: what is finer is detail, what is coarser is light
_GLARE = 2.0  # times as bright as the picture usually is
_BRIGHTEST = 0.9  # beyond it cameras saturate
_LEAST_GLARE = 0.004  # share of texels
_CHANGED = 0.5  # share of texels that change least: younger than the others
_REGION = 4.0  # texels over which that is told
_WHOLE = 1024  # texels of a picture that would be a material's side: films are small, and close
_COUNTED = 3.0  # times the usual change of a step, at most
_METALS = ("rust", "patina")
_HUE = 1.5  # texels: films store hue coarsely
_DARKEST = 2e-3  # darker than that there is none
_SAME_STORY = 0.8  # correlation of what half of the pictures tell with what the others do
_SCALE = 0.15  # of a tile: the length of a pattern that is not known
_SPECULAR = 0.04
_ROUGHNESS = {"metal": 0.25, "drying": 0.35, "other": 0.5}
_ROUGHEST = {"metal": 0.75, "drying": 0.75, "other": 0.7}


@dataclass(frozen=True)
class Timelapse:
    """colors: [T, H, W, 3] steady and linear; usable: [H, W], what lies under no highlight
    glare: [T], how bright the highlight is, 1 at first; None where there is none
    """

    colors: Array
    usable: NDArray[np.bool_]
    glare: Array | None
    name: str
    warnings: tuple[str, ...]


def read_timelapse(path: Path) -> Timelapse:
    """The time-lapse at `path`; InputError where its pictures cannot be read or do not lie over
    each other.
    """
    colors = read_pictures(path)
    name = path.resolve().stem
    if _jumps(colors) > _JUMPS:
        raise InputError(
            f"The pictures of {name} do not lie over each other: nothing can be told texel by "
            "texel.",
            "Align them, or take them with a camera that stands still.",
        )
    flat = np.full(colors.shape[:3], 0.5, np.float32)
    plain = Sequence(colors, np.zeros_like(colors), flat, uniform_times(len(colors)), None, name)
    plain = steadied(plain)
    assert isinstance(plain, Sequence)
    light = smoothed(
        plain.kd[: max(1, len(plain.kd) // 10)].mean(0).max(-1), _DETAIL, (False, False)
    )
    glaring = (light > _GLARE * np.median(light)) | (plain.kd.max((0, -1)) > _BRIGHTEST)
    glaring = smoothed(glaring.astype(np.float32), 2.0, (False, False)) > 0.1
    if glaring.mean() > 0.9:
        glaring[:] = False
    glare = None
    if glaring.mean() > _LEAST_GLARE:
        beyond = np.array(
            [frame[glaring].mean() - np.median(frame[~glaring]) for frame in plain.kd]
        )
        glare = (beyond / max(beyond[0], 1e-6)).clip(0.02, 1.5).astype(np.float32)
    return Timelapse(plain.kd, ~glaring, glare, name, plain.warnings)


def change_of_timelapse(lapse: Timelapse, *, process: str = "", seed: int = 0) -> Change:
    """What `lapse` shows of a change, told at times that are even in how much changes."""
    colors = _evenly_changing(lapse.colors, lapse.usable)
    ends = np.sqrt(colors[[0, -1]])
    change = smoothed(np.linalg.norm(ends[1] - ends[0], axis=-1), _REGION, (False, False))
    oldest = lapse.usable & (change >= np.quantile(change[lapse.usable], _CHANGED))
    kind = "metal" if process in _METALS else process if process in _ROUGHNESS else "other"
    mean_color = colors[:, oldest].mean(1)
    gone = _gone(mean_color)
    mean = _values(mean_color, gone, kind, lapse.glare)
    last = _values(colors[-1], np.ones(1, np.float32), kind, None)
    residue = last - mean[-1]
    residue[..., 6:] = 0
    side, longer = sorted(colors.shape[1:3])
    tile = quilted(residue, oldest, (False, False), side, seed)
    tile -= tile.mean((0, 1))
    starts = _values(colors[0], np.zeros(1, np.float32), kind, None)[lapse.usable]
    plain = Sequence(
        colors, np.zeros_like(colors), np.full(colors.shape[:3], 0.5, np.float32),
        uniform_times(AGES), None, lapse.name,
    )  # fmt: skip
    late = estimate_onset(plain, seed=seed)
    if late is None:
        late = _lateness(lapse)
    alike = None if late is None else correlation_length(late)
    return Change(
        mean,
        gone,
        _along(mean_color),
        starts[:, :7],
        tile,
        share=min(1.0, side / _WHOLE),
        has_height=False,
        scale=alike or _SCALE,
        weathered=None if late is None else late < np.median(late),
        name=lapse.name,
        told=_told(lapse, kind),
        warnings=lapse.warnings,
        extent=min(1.0, longer / _WHOLE) if alike else 1.0,
    )


def _lateness(lapse: Timelapse) -> Array | None:
    """[H, W]: how little of the usual change of hue each texel has behind it, over all ages; None
    where every other picture tells another story. Not when it began, which is not to be told where
    one history does not do for all, but the pattern is the same, and brightness, which metals
    reflect, has no say. Under a highlight it is what it is around.
    """
    usable, gone = lapse.usable, []
    for pictures in (lapse.colors[::2], lapse.colors[1::2]):
        colors = _evenly_changing(pictures, usable)
        plain = np.stack([smoothed(each, _HUE, (False, False)) for each in colors])
        hue = np.log(np.maximum(plain, _DARKEST))
        hue -= hue.mean(-1, keepdims=True)
        change = hue - hue[0]
        far = np.linalg.norm(change[-1], axis=-1)
        usual = change[-1][usable & (far >= np.quantile(far[usable], _CHANGED))].mean(0)
        gone.append((change @ usual / max(float(usual @ usual), 1e-9)).clip(0, 1).mean(0))
    if np.corrcoef(gone[0][usable], gone[1][usable])[0, 1] < _SAME_STORY:
        return None
    known, late = usable.astype(np.float32), 1 - (gone[0] + gone[1]) / 2
    around = smoothed(np.stack((late * known, known), -1), _DETAIL, (False, False))
    around = around[..., 0] / np.maximum(around[..., 1], 1e-3)
    return np.where(usable, late, around).astype(np.float32)


def _jumps(colors: Array) -> float:
    """The share of steps from one picture to the next after which no detail is where it was."""
    lightness = np.sqrt(colors.mean(-1))
    detail = [each - smoothed(each, _DETAIL, (False, False)) for each in lightness]
    alike = [
        float((first * second).mean() / max(first.std() * second.std(), 1e-9))
        for first, second in pairwise(detail)
    ]
    return float(np.mean(np.array(alike) < _ALIKE))


def _evenly_changing(colors: Array, usable: NDArray[np.bool_]) -> Array:
    """`colors` at AGES times that are half even in time and half in how much has changed, so that
    what is fast at first has room.
    """
    mean = np.sqrt(colors[:, usable][:, ::7]).mean(1)
    mean = smoothed(mean[:, None], 1.5, (False, False))[:, 0]
    steps = np.linalg.norm(np.diff(mean, axis=0), axis=-1)
    steps = np.minimum(steps, _COUNTED * max(float(steps.mean()), 1e-9)) + 1e-9
    way = np.concatenate(([0], np.cumsum(steps))) / steps.sum()
    clock = 0.5 * way + 0.5 * np.linspace(0, 1, len(way))
    place = np.interp(np.linspace(0, 1, AGES), clock, np.arange(len(clock)))
    lower = np.minimum(place.astype(int), len(colors) - 2)
    share = (place - lower).astype(np.float32)[:, None, None, None]
    return colors[lower] * (1 - share) + colors[lower + 1] * share


def _along(mean: Array) -> Array:
    """[T]: how far mean colors [T, 3] are on the straight way from the first to the last, rising;
    what the last texels differ in shows as much.
    """
    seen = np.sqrt(mean)
    way = seen[-1] - seen[0]
    along = ((seen - seen[0]) @ way / max(float(way @ way), 1e-9)).clip(0, 1)
    return np.maximum.accumulate(along).astype(np.float32)


def _gone(mean: Array) -> Array:
    """[T]: the share of the way from the first mean color [T, 3] to the last that is behind, on
    whatever path, rising.
    """
    seen, along = np.sqrt(mean), _along(mean)
    way = seen[-1] - seen[0]
    far = np.linalg.norm(seen - seen[0], axis=-1) / max(float(np.linalg.norm(way)), 1e-9)
    gone = np.maximum.accumulate(np.maximum(along, np.minimum(far, 1)).clip(0, 1))
    return ((gone - gone[0]) / max(float(gone[-1] - gone[0]), 1e-6)).astype(np.float32)


def _values(colors: Array, gone: Array, kind: str, glare: Array | None) -> Array:
    """kd, ks, r and height [..., 8] of colors [..., 3] of which a share is `gone`."""
    gone = np.broadcast_to(gone, colors.shape[:-1])[..., None]
    values = np.zeros((*colors.shape[:-1], 8), np.float32)
    metal = 1 - gone if kind == "metal" else np.zeros_like(gone)
    values[..., :3] = colors * (1 - metal)
    values[..., 3:6] = colors * metal + _SPECULAR * (1 - metal)
    rough = _ROUGHNESS[kind] + (_ROUGHEST[kind] - _ROUGHNESS[kind]) * gone[..., 0]
    if glare is not None:  # the peak of a highlight falls with the square of alpha
        faded = np.interp(np.linspace(0, 1, len(values)), np.linspace(0, 1, len(glare)), glare)
        told = _ROUGHNESS[kind] * np.maximum.accumulate(faded.clip(0.02, 1)[::-1])[::-1] ** -0.25
        rough = np.minimum(np.maximum.accumulate(np.maximum(rough * 0.8, told)), 0.95)
    values[..., 6] = rough
    return values


def _told(lapse: Timelapse, kind: str) -> tuple[str, ...]:
    metal = "bare metal at first and none at the end" if kind == "metal" else "no metal"
    told = [f"Pictures show no roughness, metal or relief: {metal} was assumed, and no relief."]
    if lapse.glare is None:
        low, high = _ROUGHNESS[kind], _ROUGHEST[kind]
        told.append(f"A roughness from {low:g} to {high:g} was assumed.")
    else:
        told.append(
            f"What its highlight lost was taken for roughness, from an assumed {_ROUGHNESS[kind]:g}"
            f" on; the {1 - lapse.usable.mean():.0%} of texels under it were left out."
        )
    return tuple(told)
