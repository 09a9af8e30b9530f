"""How much to model: few distinct BRDFs instead of every texel, few frames instead of all."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..backend import Tensor, torch
from ..brdf.half_angle import above_horizon
from ..brdf.torrance_sparrow import evaluate
from ..brdf.views import tone_map
from ..channels import optics
from ..states import clamped, perceptual

__all__ = (
    "Palette",
    "Stored",
    "appearance_psnr",
    "build_palette",
    "look",
    "stored_frames",
    "viewed",
    "viewed_psnr",
    "viewing_angles",
)

_BAND = 1 << 15
"""Texels sorted into cells at a time: few enough to stay in the cache."""


@dataclass(frozen=True)
class Palette:
    """Distinct initial states `entries` [P, C], row by row, and which of them is that of each of n
    texels: `index` [n].
    """

    entries: Tensor
    index: Tensor


def build_palette(states: Tensor, step: float, *, most: int) -> Palette:
    """Gather texels `states` [n, C] that fall into one cell of a perceptual grid.

    A cell is `step` wide in every perceptual coordinate; its entry is the mean of its texels. The
    grid is coarsened until at most `most` entries are left. With step 0 only texels that are equal
    to the last bit share an entry.
    """
    if step == 0:
        return _distinct(states)
    largest, bands = states.amax(0, keepdim=True), states.split(_BAND)
    while (found := _cells(bands, largest, step, most)) is None:
        step *= 1.25
    cells, index = found
    total = torch.zeros(len(cells), states.shape[1], dtype=torch.float64)
    count = torch.bincount(index, minlength=len(cells))
    for band, rows in zip(bands, index.split(_BAND), strict=True):
        total.index_add_(0, rows, band.double())
    return Palette((total / count[:, None]).float(), index)


def _distinct(states: Tensor) -> Palette:
    """The rows of `states` [n, C] that differ in any bit, in the order in which they come."""
    rows = np.ascontiguousarray(states.numpy())
    bits = rows.view(np.dtype((np.void, rows[:1].nbytes)))[:, 0]
    _, first, index = np.unique(bits, return_index=True, return_inverse=True)
    place = np.argsort(np.argsort(first))
    return Palette(torch.from_numpy(rows[np.sort(first)]), torch.from_numpy(place[index]))


def _cells(
    bands: Sequence[Tensor], largest: Tensor, step: float, most: int
) -> tuple[Tensor, Tensor] | None:
    """The occupied cells, as sorted numbers, and each texel's place among them; None where there
    are more than `most`.
    """
    sides = (_grid(largest, step)[0] + 1).tolist()
    cells, numbers = torch.empty(0, dtype=torch.long), []
    for band in bands:
        number = torch.zeros(len(band), dtype=torch.long)
        for side, column in zip(sides, _grid(band, step).unbind(1), strict=True):
            number = number * side + column
        numbers.append(number)
        cells = torch.cat((cells, number.unique())).unique()
        if len(cells) > most:
            return None
    return cells, torch.cat([torch.searchsorted(cells, number) for number in numbers])


def _grid(states: Tensor, step: float) -> Tensor:
    """Whole coordinates [n, C] of the cell that each texel lies in."""
    return (perceptual(states) / step + 0.5).floor().long()


def viewing_angles() -> Tensor:
    """Directions [M, 3] above the horizon that look on and off the highlight."""
    theta_h = torch.tensor((0.0, 0.03, 0.1, 0.25, 0.5, 0.8))
    theta_d = torch.tensor((0.2, 0.7, 1.1))
    grid = torch.stack(
        torch.meshgrid(theta_h, theta_d, torch.tensor((0.0, 1.6)), indexing="ij"), -1
    )
    grid = grid.reshape(-1, 3)
    return grid[above_horizon(grid, margin=0.1)]


def viewed(states: Tensor) -> Tensor:
    """f [N, M, 3] per steradian of states [..., C], N in all, at `viewing_angles()`; values out of
    range count as clamped.
    """
    return evaluate(*optics(clamped(states.flatten(0, -2))), viewing_angles())


def viewed_psnr(truth: Tensor, estimate: Tensor) -> float:
    """PSNR in dB, at most 100, of two lists of BRDF values [N, M, 3] at `viewing_angles()`.
    tone-mapped as `look` does.
    """
    error = (look(truth) - look(estimate)).square().mean()
    return float(-10 * error.clamp_min(1e-10).log10())


def look(f: Tensor) -> Tensor:
    """Radiance pi f, so that a white diffuse surface is 1, tone-mapped."""
    return tone_map(f, torch.pi)


def appearance_psnr(truth: Tensor, estimate: Tensor) -> float:
    """PSNR in dB of two lists of states [..., C], looked at from `viewing_angles()`."""
    return viewed_psnr(viewed(truth), viewed(estimate))


@dataclass(frozen=True)
class Stored:
    """Which frames of a map are kept: frame k is the sum of weight x stored frame over `mix[k]`."""

    frames: tuple[int, ...]
    mix: tuple[tuple[tuple[int, float], ...], ...]


def stored_frames(
    sample: Tensor, tolerance: float, seen_as: Callable[[Tensor], Tensor] = torch.sqrt
) -> Stored:
    """Choose the frames from which all others follow by linear interpolation.

    `sample` [T, n, ...] holds one map at n texels; from each stored frame the next one is the
    farthest such that the interpolated frames between, `seen_as` what shows of them, have a PSNR
    (peak 1) of at least `tolerance` dB. Of reflectances, which are not negative, the square roots
    are about what the eye sees. A map that never changes keeps one frame.
    """
    last = len(sample) - 1
    if bool((sample == sample[0]).all()):
        return Stored((0,), (((0, 1.0),),) * (last + 1))
    seen = seen_as(sample)

    def good(start: int, end: int) -> bool:
        if end - start < 2:
            return True
        share = torch.linspace(0, 1, end - start + 1)[1:-1]
        share = share.reshape(-1, *[1] * (sample.ndim - 1))
        between = torch.lerp(sample[start][None], sample[end][None], share)
        error = (seen[start + 1 : end] - seen_as(between)).square().flatten(1).mean(1).max()
        return float(error) <= 10 ** (-tolerance / 10)

    kept = [0]
    while kept[-1] < last:
        end = kept[-1] + 1
        while end < last and good(kept[-1], end + 1):
            end += 1
        kept.append(end)
    mix: list[tuple[tuple[int, float], ...]] = [((0, 1.0),)]
    for start, end in itertools.pairwise(kept):
        for k in range(start + 1, end):
            share = (k - start) / (end - start)
            mix.append(((start, 1 - share), (end, share)))
        mix.append(((end, 1.0),))
    return Stored(tuple(kept), tuple(mix))
