"""The figures that were asked for, from what was found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .film import COPPER
from .results import Figure, Target
from .targets import METALS, RUST, SCANS

__all__ = ("HALF_WAY", "figures_of")

HALF_WAY = "_half"
"""What the targets are called that are met half way."""

_REAL = ("same_scan",)
_FULLY, _HALF = 0.10, 0.20
_RUST, _RUST_HALF = 0.26, 0.35
_RELIEF = 0.9
_OURS = "ours"


def figures_of(
    targets: Mapping[str, Target], relief: Mapping[str, Any], spots: Mapping[str, Any]
) -> tuple[Figure, ...]:
    """Of whatever targets are there."""
    return (
        *_scans(targets),
        *_rust(targets),
        *_film(targets),
        *(_relief(relief) if relief else ()),
        *_spots(spots),
        *_learning(targets),
    )


def _scans(targets: Mapping[str, Target]) -> Iterator[Figure]:
    """Distance, and whether ours is below all rivals and another scan."""
    for title, ending, most in (("fully", "", _FULLY), ("half way", HALF_WAY, _HALF)):
        for name in SCANS:
            target = targets.get(name + ending)
            if target is None or _OURS not in target.methods:
                continue
            mine = target.methods[_OURS].distance
            rivals = {
                other: found.distance
                for other, found in target.methods.items()
                if other not in (_OURS, *_REAL)
            }
            nearest = min(rivals, key=rivals.__getitem__) if rivals else ""
            text = f"{mine:.3f}"
            if nearest:
                text += f"; nearest rival {nearest} {rivals[nearest]:.3f}"
            met = mine <= most and mine < min(rivals.values(), default=math.inf)
            asked = f"<= {most:.2f} and below all but same_scan"
            yield Figure(f"half of {name}, aged {title}", asked, text, met)


def _rust(targets: Mapping[str, Target]) -> Iterator[Figure]:
    full = [f"{metal}_{rust}" for metal in METALS for rust in RUST]
    half = [metal + HALF_WAY for metal in METALS]
    for title, names, most in (
        ("bundled rust on three metals, against other scans of rust", full, _RUST),
        ("half-way rust against a half rusted scan", half, _RUST_HALF),
    ):
        found = {
            name: targets[name].methods[_OURS].distance
            for name in names
            if name in targets and _OURS in targets[name].methods
        }
        if found:
            mean, worst = float(np.mean(list(found.values()))), max(found, key=found.__getitem__)
            text = f"mean {mean:.3f}, worst {found[worst]:.3f} ({worst})"
            yield Figure(title, f"<= {most:.2f}", text, found[worst] <= most)


def _film(targets: Mapping[str, Target]) -> Iterator[Figure]:
    """The mean over the ages of the film that was continued."""
    aged = [target for name, target in targets.items() if name.startswith(f"{COPPER}_")]
    if not aged or _OURS not in aged[0].methods:
        return
    mean = {
        name: float(np.mean([target.methods[name].distance for target in aged]))
        for name in aged[0].methods
    }
    text = f"{mean.pop(_OURS):.3f}; " + ", ".join(f"{name} {far:.3f}" for name, far in mean.items())
    yield Figure("half of copper's film, mean over its ages", "", text, None)


def _relief(relief: Mapping[str, Any]) -> Iterator[Figure]:
    alike, lip = relief["correlation"], relief["lip"]
    asked = f"correlation >= {_RELIEF:g}, a lip before the drop"
    name = "relief across a chip's edge, PaintedMetal007"
    if alike is None:
        yield Figure(name, asked, "no height changes", False)
        return
    text = f"{alike:.3f}, {'a' if lip else 'no'} lip; its own halves"
    text += f" {relief['own_half']['correlation']:.3f}"
    yield Figure(name, asked, text, bool(alike >= _RELIEF and lip))


def _spots(spots: Mapping[str, Any]) -> Iterator[Figure]:
    for name, found in spots.items():
        for method, far in found["apart"].items():
            parts = [
                f"{what} {apart:.2f} (own halves {found['spread'][what]:.2f})"
                for what, apart in far.items()
            ]
            met = all(far[what] <= most for what, most in found["spread"].items())
            asked = "inside the spread of its own halves" if method == _OURS else ""
            title = f"spots over time, {name}" + ("" if method == _OURS else f", {method}")
            yield Figure(title, asked, ", ".join(parts), met if method == _OURS else None)


def _learning(targets: Mapping[str, Target]) -> Iterator[Figure]:
    spent = [target.learned for target in targets.values() if target.learned is not None]
    if spent:
        text = f"at most {max(spent):.0f} s of a core"
        yield Figure("learn from half of a scan", "180 s", text, max(spent) <= 180)
