"""What grows beside color: relief across the edges of chips, and spots over time."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from ...metric.texture import encoded
from .aging import Aging, Source
from .continuing import CONTINUES
from .methods import Aged, Array
from .relief import BINS, Profile, compare_profiles, profile, weathered
from .spots import LAPSES, apart, halves_of, read_lapse, spot_curves, spread
from .targets import HalvedScan

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


def spots_of(data: Path, aging: Aging, names: Collection[str]) -> dict[str, Any]:
    """By real sequence: curves of spots over time in the half that is to be met, in the one that is
    learned from, and in what those of the methods `names` make that can; how far these are `apart`
    from the truth, by method and statistic, and how far the sequence's own halves are (`spread`).
    """
    found: dict[str, Any] = {}
    for name, kind in LAPSES.items():
        lapse = read_lapse(data, name)
        pictures = encoded(lapse.kd)
        first, last = (kind.seen(pictures[k]).mean((0, 1)) for k in (0, -1))
        every = halves_of(pictures)
        methods = [each for each in CONTINUES if each in names and (kind.filmed or each == "ours")]
        every |= {each: CONTINUES[each](lapse, kind, aging).pictures for each in methods}
        curves = {each: spot_curves(kind.seen(some), first, last) for each, some in every.items()}
        shown = {"met": curves[kind.met], "learned": curves[kind.learned]}
        shown |= {each: curves[each] for each in methods}
        found[name] = {
            "curves": {each: values.tolist() for each, values in shown.items()},
            "apart": {each: apart(curves[each], curves[kind.met]) for each in methods},
            "spread": spread(curves, kind.cuts),
        }
    return found
