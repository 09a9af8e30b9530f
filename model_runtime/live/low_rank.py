"""Histories as a few shapes: what all texels of a material share, and what each adds.

In local age a texel's history is nearly affine in the state it starts from; what is left lies near
a space of few dimensions. Both are fitted to the material's own histories, those of its palette.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..backend import Tensor, functional, torch
from ..channels import REFLECTANCES, clip_planes
from ..maps import Pixels
from ..modelling.compose import AgedTexels
from ..modelling.palette import Palette
from ..states import perceptual, with_reflectances, with_roughness
from .evaluate import Curves

__all__ = ("MOST_COEFFICIENTS", "LowRank", "at_ages", "fit_low_rank")

MOST_COEFFICIENTS = 12

_ENTRIES = 2048  # from whose histories the shapes are drawn, where all texels are entries
_SPREAD = 4096  # texels that tell how far they are from their entries, and their range
_NEIGHBORS = 12  # entries from which a slope is taken
_STIFFNESS = 0.03  # weight of no slope at all beside theirs
_PARTS = 4  # of the step to the first modeled age
_BAND = 1 << 14  # entries projected at a time
_DARKEST = 0.01  # albedos below it count as it: nobody sees their last digits
_ALIKE = 1e-8  # variance of a starting value below which no gain can be told from it
_NEGLIGIBLE = 1e-12  # share of the variance that no coefficient is worth


@dataclass(frozen=True)
class LowRank:
    """Histories as y(a) = G(a) y(0) + O(a) + sum_k c_k V_k(a) (`Curves`), where a texel's c_k are
    those of its palette's entry and, nearby, follow their slope.

    ages: [A] from 0 to 1, those that are modeled and some more before the first of them
    gain, offset: [A, C]; shapes: [R, A, C]
    coefficients: [P, R] of the entries, each at most 1 in size; the first of them matter most, and
        any number of them is the best choice of as many
    least, step: [R]: a texel's coefficient is a byte's number of steps above the least
    slopes: [P, C + 1, R]: a texel's coefficients are its perceptual coordinates and 1, times these;
        or None, where each texel is an entry
    worst: [R + 1] the entry that is left farthest by none, one ... all of the coefficients
    """

    ages: Tensor
    gain: Tensor
    offset: Tensor
    shapes: Tensor
    coefficients: Tensor
    least: Tensor
    step: Tensor
    slopes: Tensor | None
    worst: Tensor

    def first(self, count: int) -> LowRank:
        """Only the first `count` coefficients."""
        return replace(
            self,
            shapes=self.shapes[:count],
            coefficients=self.coefficients[:, :count],
            least=self.least[:count],
            step=self.step[:count],
            slopes=None if self.slopes is None else self.slopes[..., :count].contiguous(),
            worst=self.worst[: count + 1],
        )

    def bytes_of(self, initial: Tensor, entry: Tensor) -> Tensor:
        """Bytes [n, R], as floats, that hold the coefficients of texels `initial` [n, C] of the
        entries `entry` [n].
        """
        exact = _exact(self.coefficients, self.slopes, initial, entry)
        return ((exact - self.least) / self.step).round().clamp(0, 255)

    def of(self, initial: Tensor, entry: Tensor) -> Tensor:
        """The coefficients [n, R] that these bytes hold."""
        return self.least + self.step * self.bytes_of(initial, entry)

    def at_ages(self, initial: Tensor, entry: Tensor) -> Tensor:
        """States [n, A, C] with roughness at all ages of texels `initial` [n, C] of the entries
        `entry` [n].
        """
        states = self.gain * with_roughness(initial)[:, None] + self.offset
        states += torch.tensordot(self.of(initial, entry), self.shapes, 1)
        clip_planes(states.movedim(-1, 0).numpy(), roughness=True)
        return states

    def curves(self) -> Curves:
        """At evenly spaced ages, as near to each other as the nearest of `ages`, for coefficients
        of a byte / 255; without height.
        """
        even = np.linspace(0, 1, round(1 / float(self.ages[1])) + 1)

        def spread(curve: Tensor) -> Pixels:
            columns = [np.interp(even, self.ages, column) for column in curve.T]
            return np.stack([*columns, np.zeros_like(even)], -1).astype(np.float32)

        shapes = [spread(shape) for shape in self.shapes * (255 * self.step)[:, None, None]]
        least = torch.tensordot(self.least, self.shapes, 1)
        gain, offset = spread(self.gain), spread(self.offset + least)
        return Curves(gain, offset, np.reshape(shapes, (-1, *gain.shape)))


def at_ages(texels: AgedTexels) -> Tensor:
    """[n, A, C] with roughness of `texels` at all ages (`LowRank`), whatever their onset."""
    aging = replace(texels, onset=None, rate=None)
    ages = _ages(len(texels.gain)).tolist()
    return with_roughness(torch.stack([aging.at(age) for age in ages], 1))


def _ages(count: int) -> Tensor:
    """The `count` modeled ages and, of the step to the first, its parts.

    Much may happen in that step, and what goes straight in alpha bends in r.
    """
    ages = torch.linspace(0, 1, count)
    return torch.cat((torch.linspace(0, float(ages[1]), _PARTS + 1)[:-1], ages[1:]))


def _histories(aged: AgedTexels, entries: Tensor) -> Tensor:
    """[n, A, C] of texels that are the palette's `entries` [n]."""
    own = Palette(aged.palette.entries[entries], torch.arange(len(entries)))
    histories = replace(aged.histories, states=aged.histories.states[entries])
    return at_ages(AgedTexels(own.entries, own, histories, aged.gain, None)).double()


def fit_low_rank(aged: AgedTexels) -> LowRank:
    """Fit the sum to the histories of the palette of `aged`, each weighted by its texels, so that
    errors count as they do in the square roots of kd and ks, and in r.
    """
    entries, index = aged.palette.entries, aged.palette.index
    chosen = torch.arange(len(entries))
    if len(entries) > _ENTRIES:
        chance = torch.Generator().manual_seed(0)
        chosen = torch.randperm(len(entries), generator=chance)[:_ENTRIES]
    weight = torch.bincount(index, minlength=len(entries))[chosen].double()
    weight /= weight.sum()
    histories = _histories(aged, chosen)
    seen = weight[:, None, None] * _sensitivity(histories).square()
    ages = _ages(len(aged.gain))
    gain, offset = _affine(histories, seen, _between(aged.gain.double(), ages), _spread(aged))
    left = _left(histories, gain, offset)

    scale = seen.sum(0).flatten().sqrt()
    weighted = left * scale * weight.sqrt()[:, None]
    variance, directions = torch.linalg.eigh(weighted.T @ weighted)
    worth = variance > _NEGLIGIBLE * variance.sum().clamp_min(_NEGLIGIBLE)
    directions = directions[:, worth].fliplr()[:, :MOST_COEFFICIENTS]
    coefficients, distance = [], []
    for band in torch.arange(len(entries)).split(_BAND):
        whole = _left(_histories(aged, band), gain, offset) * scale
        coefficients.append(whole @ directions)
        distance.append(whole.square().sum(1, keepdim=True))
    coefficients = torch.cat(coefficients)
    reached = functional.pad(coefficients.square().cumsum(1), (1, 0))
    worst = (torch.cat(distance) - reached).argmax(0)
    largest = coefficients.abs().amax(0)
    shapes = (directions / scale[:, None] * largest).T.unflatten(1, gain.shape)
    shapes[:, 0] = 0
    coefficients = (coefficients / largest).float()
    slopes = None if len(entries) > _ENTRIES else _slopes(entries, coefficients)
    rows = _some(aged)
    seen = torch.cat((coefficients, _exact(coefficients, slopes, aged.initial[rows], index[rows])))
    least = seen.amin(0)
    step = ((seen.amax(0) - least) / 255).clamp_min(1e-6)
    curves = (gain.float(), offset.float(), shapes.float())
    return LowRank(ages, *curves, coefficients, least, step, slopes, worst)


def _exact(coefficients: Tensor, slopes: Tensor | None, initial: Tensor, entry: Tensor) -> Tensor:
    """Coefficients [n, R] of texels `initial` [n, C] of the entries `entry` [n] (`LowRank`)."""
    if slopes is None:
        return coefficients[entry]
    place = functional.pad(perceptual(initial), (0, 1), value=1.0)
    return torch.bmm(place[:, None], slopes[entry])[:, 0]


def _some(aged: AgedTexels) -> Tensor:
    """Rows of texels at random."""
    return torch.randint(len(aged.initial), (_SPREAD,), generator=torch.Generator().manual_seed(0))


def _slopes(entries: Tensor, coefficients: Tensor) -> Tensor:
    """[P, C + 1, R]: planes through each entry's coefficients [P, R] that lie nearest to those of
    its neighbors, over perceptual coordinates.
    """
    place = perceptual(entries)
    nearest = torch.cdist(place, place).topk(min(_NEIGHBORS + 1, len(place)), largest=False)
    neighbor = nearest.indices[:, 1:]
    away = place[neighbor] - place[:, None]
    square = away.square().sum(2, keepdim=True)
    weighted = (away / (square + square.mean(1, keepdim=True))).mT
    normal = weighted @ away + _STIFFNESS * torch.eye(place.shape[1])
    slope = torch.linalg.solve(normal, weighted @ (coefficients[neighbor] - coefficients[:, None]))
    level = coefficients[:, None] - place[:, None] @ slope
    return torch.cat((slope, level), 1)


def _between(curve: Tensor, ages: Tensor) -> Tensor:
    """The values [A, C] of a curve [T, C] over evenly spaced ages, at `ages` [A]."""
    place = ages * (len(curve) - 1)
    lower = place.long().clamp_max(len(curve) - 2)
    return torch.lerp(curve[lower], curve[lower + 1], (place - lower)[:, None].double())


def _sensitivity(states: Tensor) -> Tensor:
    """By how much the square roots of kd and ks, and r, change with each of `states` [..., C]."""
    albedos = states[..., REFLECTANCES]
    slope = 0.5 / perceptual(albedos, least=_DARKEST, most=math.inf)
    return with_reflectances(torch.ones_like(states), slope)


def _spread(aged: AgedTexels) -> Tensor:
    """[C]: mean square by which texels differ from their entry, with roughness."""
    rows = _some(aged)
    entry = aged.palette.entries[aged.palette.index[rows]]
    away = with_roughness(aged.initial[rows]) - with_roughness(entry)
    return away.double().square().mean(0)


def _affine(
    histories: Tensor, weight: Tensor, usual: Tensor, spread: Tensor
) -> tuple[Tensor, Tensor]:
    """Gain and offset [A, C] of `histories` [P, A, C] by least squares, `weight` [P, A, C].

    What texels differ by within their entry, `spread` [C], fades as `usual` [A, C] says.
    """
    start = histories[:, :1]
    total = weight.sum(0)
    mean_start, mean = (weight * start).sum(0) / total, (weight * histories).sum(0) / total
    away = start - mean_start
    variance = (weight * away.square()).sum(0) / total
    covariance = (weight * away * (histories - mean)).sum(0) / total
    spread = spread.clamp_min(_ALIKE)
    gain = ((covariance + spread * usual) / (variance + spread)).clamp(0, 4)
    gain[0] = 1
    offset = mean - gain * mean_start
    offset[0] = 0
    return gain, offset


def _left(histories: Tensor, gain: Tensor, offset: Tensor) -> Tensor:
    """[P, A C]: what the affine part leaves of `histories` [P, A, C]."""
    return (histories - gain * histories[:, :1] - offset).flatten(1)
