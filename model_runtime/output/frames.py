"""Aged texels as the maps of an output format, frame after frame."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..backend import Tensor, torch
from ..brdf import principled
from ..channels import lobe_maps
from ..contract import (
    FORMATS,
    HEIGHT,
    PRINCIPLED,
    PRINCIPLED_EXACT,
    TORRANCE_SPARROW,
    Format,
    frame_file,
)
from ..maps import Halves, Pixels, PrincipledMaps, TorranceSparrowMaps
from ..modelling.compose import AgedBand, AgedTexels
from ..modelling.palette import Stored, stored_frames
from ..reading.inputs import Material
from .stored import StagedResult

__all__ = (
    "FrameMaps",
    "Frames",
    "file_names",
    "maps_of",
    "write_frames",
    "write_stored_frames",
)

Mix = list[list[str | float]]

_SAMPLE = 4096
_BAND = 1 << 15
"""Texels aged at a time, in whole rows of the image: what they need stays in the cache."""


@dataclass(frozen=True)
class _Band:
    """Some rows of the image, in the order in which their texels start (`AgedBand.order`)."""

    place: slice
    order: Tensor
    texels: AgedBand
    authored: PrincipledMaps | None


@dataclass(frozen=True)
class FrameMaps:
    """Turns aged texels into the maps that `format` names, and that of their heights where these
    change, at any time.

    `authored` [H, W] is what the artist gave, needed for "principled" alone.  Only texels that are
    `covered` [H, W], or all with None, are chosen to stand for all.
    """

    aged: AgedTexels
    size: tuple[int, int]
    format: Format
    authored: PrincipledMaps | None
    covered: NDArray[np.bool_] | None = None

    def at(self, time: float) -> dict[str, Halves]:
        """Every map at `time` in 0..1: name -> [H, W, 3] or [H, W], rounded to half floats."""
        return self.named(self.planes(time))

    def planes(self, time: float) -> Tensor:
        """Every channel of every map at `time` in 0..1, one after the other: [C, H W] halves.

        A band is aged after the other, and of each only the texels that have started: the others
        stay as they are in frame 1.
        """
        planes = self._first.clone()
        for band in self._bands:
            if band.texels.started(time):
                self._fill(planes, band, band.texels.at(time), band.texels.further(time))
                if self._raises:
                    heights = torch.from_numpy(band.texels.heights(time)).half()
                    planes[-1, band.place].index_copy_(0, band.order[: len(heights)], heights)
        return planes

    def named(self, planes: Tensor) -> dict[str, Halves]:
        """Views of `planes` as maps: name -> [H, W, 3] or [H, W]."""
        maps, start = {}, 0
        for name, channels in self._channels.items():
            pixels = planes[start : start + channels].numpy().reshape(channels, *self.size)
            maps[name] = pixels[0] if channels == 1 else np.moveaxis(pixels, 0, -1)
            start += channels
        return maps

    def representable(self, times: Sequence[float]) -> bool:
        """Whether "principled-exact" can hold every texel as it was given and at all of `times`."""
        return all(
            principled.representable(TorranceSparrowMaps.of(states))
            for band in self._bands
            for states in (
                band.texels.initial,
                *(band.texels.at(time) for time in times if band.texels.started(time)),
            )
        )

    def sampled(self, seed: int, *, also: Sequence[int] = ()) -> FrameMaps:
        """The same at `_SAMPLE` random texels and those numbered in `also`, as an image one texel
        wide.
        """
        count = self.size[0] * self.size[1]
        counted = np.arange(count) if self.covered is None else np.flatnonzero(self.covered)
        rng = np.random.default_rng(seed)
        chosen = rng.choice(counted, min(len(counted), _SAMPLE), replace=False)
        rows = np.union1d(chosen, also).astype(int)
        authored = None
        if self.authored is not None:
            authored = self.authored.map(
                lambda pixels: pixels.reshape(count, 1, *pixels.shape[2:])[rows]
            )
        aged = self.aged.select(torch.from_numpy(rows))
        return FrameMaps(aged, (len(rows), 1), self.format, authored)

    @property
    def _raises(self) -> bool:
        return self.aged.residues is not None and self.aged.residues.raises

    @property
    def _channels(self) -> dict[str, int]:
        """How many channels each map has, in order."""
        lobes = lobe_maps(self.aged.turns)
        return {**FORMATS[self.format], **lobes, **({HEIGHT: 1} if self._raises else {})}

    @cached_property
    def _bands(self) -> list[_Band]:
        return list(self._cut())

    def _cut(self) -> Iterator[_Band]:
        height, width = self.size
        rows = max(1, _BAND // width)
        for row in range(0, height, rows):
            place = slice(row * width, min(row + rows, height) * width)
            texels = self.aged.band(place.start, place.stop)
            authored = None
            if self.authored is not None:
                authored = self.authored.map(
                    lambda pixels, row=row, order=texels.order: _ordered(
                        pixels[row : row + rows], order
                    )
                )
            yield _Band(place, torch.from_numpy(texels.order), texels, authored)

    @cached_property
    def _first(self) -> Tensor:
        """Frame 1: every channel of every map, one after the other, [C, H W] halves."""
        channels = sum(self._channels.values())
        planes = torch.zeros(channels, self.size[0] * self.size[1], dtype=torch.half)
        for band in self._bands:
            self._fill(planes, band, band.texels.initial, band.texels.further(None))
        return planes

    def _fill(self, planes: Tensor, band: _Band, states: Pixels, further: Pixels) -> None:
        """Put the maps of the first k texels of `band`, aged to `states` [C, k] with `further`
        lobes [L, k], into `planes`.
        """
        k = states.shape[1]
        order = band.order[:k]
        channels = iter(planes[:, band.place])
        authored = band.authored and band.authored.map(lambda pixels: pixels[:k])
        maps = principled.in_format(TorranceSparrowMaps.of(states), self.format, authored)
        for pixels in maps.values():
            for plane in torch.from_numpy(pixels.reshape(k, -1).T).half():
                next(channels).index_copy_(0, order, plane)
        for plane in torch.from_numpy(further).half():
            next(channels).index_copy_(0, order, plane)


@dataclass
class Frames:
    """The frames of `maps` at `times`, which are evenly spaced.

    Every `interval`-th frame and the last are aged; in those between, each texel that is under way
    goes straight from its start, or the aged frame before, to the next aged frame.
    """

    maps: FrameMaps
    times: Sequence[float]
    interval: int = 1
    _aged: dict[int, Tensor] = field(default_factory=dict)

    def at(self, k: int) -> dict[str, Halves]:
        """Every map in frame `k`, counted from 0; the next frame to ask for is best a later one."""
        after = self._numbers[bisect.bisect_left(self._numbers, k)]
        if after == k:
            return self.maps.named(self._planes(k))
        before = k - k % self.interval
        first, last = self._planes(before), self._planes(after)
        share = self._share(*(self.times[number] for number in (before, k, after)))
        return self.maps.named(torch.lerp(first, last, share))

    def _share(self, before: float, time: float, after: float) -> Tensor:
        """How far each texel has got from its state at `before` to that at `after`: [H W] or []."""
        onset = self.maps.aged.onset
        start = torch.tensor(before) if onset is None else onset.clamp_min(before)
        return ((time - start) / (after - start)).clamp_(0, 1).half()

    def sampled(self, seed: int) -> Frames:
        """The same at random texels and those that change most (`FrameMaps.sampled`)."""
        spots = _most_changed(self.at(0), self.at(len(self.times) - 1))
        return Frames(self.maps.sampled(seed, also=spots), self.times, self.interval)

    @cached_property
    def _numbers(self) -> list[int]:
        last = len(self.times) - 1
        return sorted({*range(0, last, self.interval), last})

    def _planes(self, k: int) -> Tensor:
        if self.interval == 1:  # nothing lies between two frames: none is needed again
            return self.maps.planes(self.times[k])
        if k not in self._aged:
            # what is asked for next lies between the latest one and this one
            self._aged = dict([*self._aged.items()][-1:])
            self._aged[k] = self.maps.planes(self.times[k])
        return self._aged[k]


def maps_of(
    aged: AgedTexels,
    material: Material,
    size: tuple[int, int],
    format: Format,
    times: Sequence[float],
    *,
    covered: NDArray[np.bool_] | None = None,
) -> FrameMaps:
    """What to write of `aged` in `format`.

    "principled" needs an authored material: the input where it is one, else the Principled material
    that looks most like frame 1. "principled-exact" is replaced by "torrance-sparrow" where any
    texel at any of `times` is beyond what it can hold.
    """
    maps = FrameMaps(aged, size, format, None, covered)
    if format == PRINCIPLED_EXACT:
        if not maps.representable(times):
            maps = replace(maps, format=TORRANCE_SPARROW)
    elif format == PRINCIPLED:
        if isinstance(material, PrincipledMaps):
            authored = material.map(lambda pixels: np.broadcast_to(pixels, size + pixels.shape[2:]))
        else:
            first = TorranceSparrowMaps.of(aged.initial.numpy().T, size)
            authored = principled.read_back(first, _neutral(size))
        maps = replace(maps, authored=authored)
    return maps


def write_frames(
    frames: Frames,
    staged: StagedResult,
    progress: Callable[[float], None],
    *,
    unit: float = 1.0,
) -> dict[str, list[str]]:
    """Write every map of every frame; returns the files of each map, in order.

    Heights are multiplied by their `unit`.
    """
    files: dict[str, list[str]] = {}
    count = len(frames.times)
    for k in range(count):
        for name, pixels in frames.at(k).items():
            files.setdefault(name, []).append(frame_file(name, k))
            _write(staged, name, k, pixels, unit)
        progress((k + 1) / count)
    return files


def _write(staged: StagedResult, name: str, k: int, pixels: Halves, unit: float) -> None:
    if name == HEIGHT:  # of a can so little that halves would not tell it from nothing
        staged.write(frame_file(name, k), pixels.astype(np.float32) * unit, depth="single")
    else:
        staged.write(frame_file(name, k), pixels)


def write_stored_frames(
    frames: Frames,
    staged: StagedResult,
    progress: Callable[[float], None],
    *,
    tolerance: float,
    seed: int,
    unit: float = 1.0,
) -> dict[str, list[Mix]]:
    """Write only the frames that others do not make up; returns, per map and frame, what makes it.

    A frame is left out where interpolation between its stored neighbors gives its map within
    `tolerance` dB (`plan.stored_frames`) on a random sample of texels and, that no small spot be
    overlooked, the one of each map that changes most.
    """
    count = len(frames.times)
    sample = frames.sampled(seed)
    looks = [sample.at(k) for k in range(count)]
    stored = {name: _stored(name, [look[name] for look in looks], tolerance) for name in looks[0]}
    for k in range(count):
        wanted = [name for name in stored if k in stored[name].frames]
        if wanted:
            frame = frames.at(k)
            for name in wanted:
                _write(staged, name, k, frame[name], unit)
        progress((k + 1) / count)
    return {
        name: [[[frame_file(name, k), weight] for k, weight in mix] for mix in kept.mix]
        for name, kept in stored.items()
    }


def _stored(name: str, looks: Sequence[Halves], tolerance: float) -> Stored:
    """Which frames of a map to keep, of which these are samples."""
    sample = torch.from_numpy(np.stack(looks)).float()
    if name != HEIGHT:
        return stored_frames(sample, tolerance)
    range_ = sample.aminmax()
    return stored_frames(
        sample / (range_.max - range_.min).clamp_min(1e-12), tolerance, seen_as=lambda each: each
    )


def _most_changed(first: Mapping[str, Halves], last: Mapping[str, Halves]) -> list[int]:
    """The texel of each map in which two frames differ most."""

    changes = (np.abs(last[name].astype(np.float32) - first[name]) for name in first)
    return [int(each.reshape(*each.shape[:2], -1).max(-1).argmax()) for each in changes]


def file_names(format: Format, frames: int, *, lobes: int, heights: bool) -> list[str]:
    """Every file that a run in `format` may write ("principled-exact" may turn out otherwise), with
    those of several `lobes`, and with `heights` those too.
    """
    formats: tuple[Format, ...] = (format,)
    if format == PRINCIPLED_EXACT:
        formats = (format, TORRANCE_SPARROW)
    maps = dict.fromkeys(name for each in formats for name in FORMATS[each])
    maps |= dict.fromkeys(lobe_maps([True] * (lobes - 1))) | ({HEIGHT: None} if heights else {})
    return [frame_file(name, k) for name in maps for k in range(frames)]


def _ordered(pixels: Pixels, order: NDArray[np.intp]) -> Pixels:
    """Texels of [H, W, 3] or [H, W] in `order`, plane after plane: [H W, 1, 3] or [H W, 1].

    One value throughout stays one value, broadcast: what is made of it is then made once.
    """
    texels = pixels.reshape(len(order), -1)
    if (texels == texels[0]).all():
        planes = np.broadcast_to(texels[0][:, None], texels.T.shape)
    else:
        planes = np.ascontiguousarray(texels.T).take(order, 1)
    return planes.T.reshape(len(order), 1, *pixels.shape[2:])


def _neutral(size: tuple[int, int]) -> PrincipledMaps:
    """Blender's default Principled material."""

    def full(value: float, *channels: int) -> Pixels:
        return np.broadcast_to(np.float32(value), (*size, *channels))

    return PrincipledMaps(full(0.8, 3), full(0), full(0.5), full(0.5), full(1.5), full(1, 3))
