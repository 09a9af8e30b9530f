"""What grows beside color: relief across the edges of chips, and spots over time."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from model_runtime.age import AgeRequest
from model_runtime.contract import FRAMES, PRINCIPLED, TORRANCE_SPARROW, frame_file
from model_runtime.images import read_image, write_exr

from ...data.sequences import Sequence
from ..bench.aging import age_silently
from ..bench.kept import identity
from .aging import Aging, Source
from .methods import Aged, Array
from .relief import BINS, Profile, compare_profiles, profile, weathered
from .spots import FILMED, LAPSES, apart, halves_of, read_lapse, spot_curves, spread
from .targets import HalvedScan, encoded

__all__ = ("relief_of", "spots_of")

_BEGUN = 0.005  # share of a picture that is weathered, and that is not, where it has a border


def relief_of(scan: HalvedScan, aging: Aging) -> dict[str, Any]:
    """Height by distance from the border of what is weathered: of the right half, of the left one,
    and of what ours makes of the left one's clean material when as much of it is weathered.

    `correlation` with the right half, and `lip`, whether there is one before the drop; null where
    ours changes no height.
    """
    source = Source(scan)
    learned = aging.of_scan(source)
    aged = aging.aged("ours", scan.name, lambda: scan.clean, source, learned.path)
    clean, gone = (
        scan.left.picture[some].mean(0) for some in (scan.left.depth < 0, scan.left.depth > 0)
    )
    right, left = (
        profile(half.height, weathered(half.picture, clean, gone), wraps=False)
        for half in (scan.right, scan.left)
    )
    found: dict[str, Any] = {
        "distance": ((BINS[1:] + BINS[:-1]) / 2).tolist(),
        "truth": right,
        "own_half": {"profile": left, "correlation": compare_profiles(right, left)[0]},
        "correlation": None,
        "lip": None,
    }
    mine = _profile_of(aged, clean, gone, float((scan.right.depth > 0).mean()))
    if mine is not None:
        alike, lip = compare_profiles(right, mine)
        found |= {"ours": mine, "correlation": alike, "lip": lip}
    return found


def _profile_of(aged: Aged, clean: Array, gone: Array, share: float) -> Profile | None:
    if aged.heights is None:
        return None
    masks = [weathered(picture, clean, gone) for picture in aged.pictures]
    shares = np.array([mask.mean() for mask in masks])
    begun = (shares > _BEGUN) & (shares < 1 - _BEGUN)
    if not begun.any():
        return None
    k = int(np.where(begun, np.abs(shares - share), np.inf).argmin())
    return profile(aged.heights[k], masks[k], wraps=False)


def spots_of(data: Path, aging: Aging) -> dict[str, Any]:
    """By real sequence: curves of spots over time in the right half, in the left one and in what
    ours makes of the first frame of the right one after the left one; how far ours is `apart` from
    the truth by statistic, and how far the sequence's own halves are (`spread`).
    """
    found: dict[str, Any] = {}
    for name, process in LAPSES.items():
        lapse = read_lapse(data, name)
        halves = halves_of(lapse.kd)
        first, last = (lapse.kd[k].mean((0, 1)) for k in (0, -1))
        curves = {side: spot_curves(kd, first, last) for side, kd in halves.items()}
        ours = spot_curves(_continued(lapse, process, aging), first, last)
        found[name] = {
            "curves": {
                side: each.tolist()
                for side, each in (*curves.items(), ("ours", ours))
                if side in ("left", "right", "ours")
            },
            "apart": apart(ours, curves["right"]),
            "spread": spread(curves),
        }
    return found


def _continued(lapse: Sequence, process: str, aging: Aging) -> Array:
    """Color [T, H, W, 3] of the right half's first frame, aged after the left half: as a metal
    after a film of it, or as diffuse albedo after a sequence.
    """
    middle = lapse.alpha.shape[2] // 2
    left, right = lapse.kd[:, :, :middle], lapse.kd[0, :, middle:]
    made_from = identity(torch.from_numpy(np.ascontiguousarray(left)), process)
    with tempfile.TemporaryDirectory() as folder:
        source, start, output = (Path(folder) / name for name in ("film", "start", "aged"))
        start.mkdir()
        if lapse.name in FILMED:
            shown, format = "base_color", PRINCIPLED
            learned = aging.learned(_film(left, source), lapse.name, process, made_from)
            maps = {shown: right, "metallic": np.ones_like(right[..., 0])}
        else:
            shown, format = "kd", TORRANCE_SPARROW
            half = replace(
                lapse, kd=left, ks=lapse.ks[:, :, :middle], alpha=lapse.alpha[:, :, :middle]
            )
            learned = aging.learned(half, lapse.name, process, made_from)
            maps = {name: getattr(lapse, name)[0, :, middle:] for name in ("kd", "ks", "alpha")}
        for name, pixels in maps.items():
            write_exr(start / f"{name}.exr", pixels)
        frames, model = len(lapse.times), str(learned.path)
        age_silently(AgeRequest(start, model, output, frames=frames, format=format, binding=FRAMES))
        files = [output / frame_file(shown, k) for k in range(frames)]
        return np.stack([read_image(file, color=True) for file in files])


def _film(colors: Array, folder: Path) -> Path:
    """A folder of numbered pictures."""
    folder.mkdir()
    for k, frame in enumerate(colors):
        code = np.rint(255 * encoded(frame)).astype(np.uint8)
        Image.fromarray(code).save(folder / f"frame_{k:03d}.png")
    return folder
