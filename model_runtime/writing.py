"""Aged texels as the maps of an output format, frame after frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from .brdf import principled
from .compose import AgedTexels
from .inputs import Material
from .maps import Pixels, PrincipledMaps, TorranceSparrowMaps
from .plan import Stored, stored_frames
from .result import StagedResult

__all__ = ("Format", "FrameMaps", "maps_of", "write_frames", "write_stored_frames")

Format = Literal["torrance-sparrow", "principled", "principled-exact"]
Mix = list[list[str | float]]

_SAMPLE = 4096


@dataclass(frozen=True)
class FrameMaps:
    """Turns aged texels into the maps that `format` names, at any time.

    `authored` [H, W] is what the artist gave, needed for "principled" alone.
    """

    aged: AgedTexels
    size: tuple[int, int]
    format: Format
    authored: PrincipledMaps | None

    def at(self, time: float) -> dict[str, Pixels]:
        """Every map at `time` in 0..1: name -> [H, W, 3] or [H, W]."""
        maps = self.states_at(time)
        if self.format == "torrance-sparrow":
            return {"kd": maps.kd, "ks": maps.ks, "alpha": maps.alpha}
        if self.format == "principled-exact":
            return dict(
                zip(
                    ("base_color", "specular_tint", "roughness"),
                    principled.exact(maps),
                    strict=True,
                )
            )
        assert self.authored is not None
        back = principled.read_back(maps, self.authored)
        return {
            "base_color": back.base_color,
            "metallic": back.metallic,
            "specular": back.specular,
            "roughness": back.roughness,
        }

    def states_at(self, time: float) -> TorranceSparrowMaps:
        """The Torrance-Sparrow maps at `time`."""
        states = self.aged.at(time).reshape(*self.size, 7).numpy()
        kd, ks, alpha = states[..., :3], states[..., 3:6], states[..., 6]
        return TorranceSparrowMaps(*(np.ascontiguousarray(pixels) for pixels in (kd, ks, alpha)))

    def sampled(self, seed: int) -> FrameMaps:
        """The same at `_SAMPLE` random texels, as an image one texel wide."""
        count = self.size[0] * self.size[1]
        rng = np.random.default_rng(seed)
        rows = np.sort(rng.choice(count, min(count, _SAMPLE), replace=False))
        authored = None
        if self.authored is not None:
            authored = PrincipledMaps(
                **{
                    name: np.ascontiguousarray(pixels.reshape(count, 1, *pixels.shape[2:])[rows])
                    for name, pixels in vars(self.authored).items()
                }
            )
        aged = self.aged.select(torch.from_numpy(rows))
        return replace(self, aged=aged, size=(len(rows), 1), authored=authored)


def maps_of(
    aged: AgedTexels,
    material: Material,
    size: tuple[int, int],
    format: Format,
    times: Sequence[float],
) -> FrameMaps:
    """What to write of `aged` in `format`.

    "principled" needs an authored material: the input where it is one, else the Principled material
    that looks most like frame 1. "principled-exact" is replaced by "torrance-sparrow" where any
    texel at any of `times` is beyond what it can hold.
    """
    maps = FrameMaps(aged, size, format, None)
    if format == "principled-exact":
        if not all(principled.representable(maps.states_at(time)) for time in times):
            maps = replace(maps, format="torrance-sparrow")
    elif format == "principled":
        if isinstance(material, PrincipledMaps):
            authored = _broadcast(material, size)
        else:
            authored = principled.read_back(maps.states_at(0.0), _neutral(size))
        maps = replace(maps, authored=authored)
    return maps


def write_frames(
    maps: FrameMaps,
    staged: StagedResult,
    times: Sequence[float],
    progress: Callable[[float], None],
) -> dict[str, list[str]]:
    """Write every map of every frame; returns the files of each map, in order."""
    files: dict[str, list[str]] = {}
    for k, time in enumerate(times):
        for name, pixels in maps.at(time).items():
            files.setdefault(name, []).append(file_name(name, k))
            staged.write(file_name(name, k), pixels)
        progress((k + 1) / len(times))
    return files


def write_stored_frames(
    maps: FrameMaps,
    staged: StagedResult,
    times: Sequence[float],
    progress: Callable[[float], None],
    *,
    tolerance: float,
    seed: int,
) -> dict[str, list[Mix]]:
    """Write only the frames that others do not make up; returns, per map and frame, what makes it.

    A frame is left out where interpolation between its stored neighbours gives its map within
    `tolerance` dB (PSNR against 1) on a random sample of texels.
    """
    sample = maps.sampled(seed)
    looks = [sample.at(time) for time in times]
    stored: dict[str, Stored] = {
        name: stored_frames(torch.from_numpy(np.stack([look[name] for look in looks])), tolerance)
        for name in looks[0]
    }
    for k, time in enumerate(times):
        wanted = [name for name in stored if k in stored[name].frames]
        if wanted:
            frame = maps.at(time)
            for name in wanted:
                staged.write(file_name(name, k), frame[name])
        progress((k + 1) / len(times))
    return {
        name: [[[file_name(name, k), weight] for k, weight in mix] for mix in kept.mix]
        for name, kept in stored.items()
    }


def file_name(map_name: str, k: int) -> str:
    """The file of frame `k`, counted from 0."""
    return f"{map_name}_{k + 1:04d}.exr"


def _broadcast(maps: PrincipledMaps, size: tuple[int, int]) -> PrincipledMaps:
    if maps.size == size:
        return maps
    return PrincipledMaps(
        **{
            name: np.ascontiguousarray(np.broadcast_to(pixels, (*size, *pixels.shape[2:])))
            for name, pixels in vars(maps).items()
        }
    )


def _neutral(size: tuple[int, int]) -> PrincipledMaps:
    """Blender's default Principled material."""

    def full(value: float, *channels: int) -> Pixels:
        return np.full((*size, *channels), value, np.float32)

    return PrincipledMaps(full(0.8, 3), full(0), full(0.5), full(0.5), full(1.5), full(1, 3))
