"""A film of copper that patinates: ours beside what learns a film's textures from noise.

Both learn from the upper half of the pictures and are held against the lower one.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
from safetensors import safe_open

from model_runtime.reading.inputs import hash_file

from ...baselines import ode
from ...metric.texture import encoded
from ..bench.kept import code, identity, kept_json
from .aging import Aging, nearest_in_mean
from .comparing import Picture
from .continuing import CONTINUES, FROM_NOISE, aged_pictures, learned_half
from .methods import Array
from .spots import LAPSES, halves_of, read_lapse

__all__ = ("COPPER", "costs_of", "film_of")

COPPER = "copper"
"""What the target is called."""

_NAME = "copper_patinating"
_AGES = (0.0, 0.05, 0.25, 0.5, 0.75, 1.0)  # half of the way is gone by 0.1
_PICTURES = 9  # of which the cost of one is told


def film_of(data: Path, aging: Aging, names: Collection[str]) -> dict[str, dict[str, Picture]]:
    """By age of the film: the truth, and of those `names` that continue it the picture with the
    truth's mean color; *ode* has learned the film's own time, and is shown at that.
    """
    kind, lapse = LAPSES[_NAME], read_lapse(data, _NAME)
    halves = halves_of(encoded(lapse.kd))
    truth, learned = halves[kind.met], halves[kind.learned]
    pictures: dict[str, Array] = {}
    seconds: dict[str, float] = {}
    for name in (each for each in CONTINUES if each in names):
        found = CONTINUES[name](lapse, kind, aging)
        pictures[name], seconds[name] = found.pictures, found.seconds
    if "crossfade" in names:
        share = np.linspace(0, 1, len(truth), dtype=np.float32)[:, None, None, None]
        pictures["crossfade"] = truth[0] + share * (learned[-1].mean((0, 1)) - truth[0])
    shown = {}
    for age in _AGES:
        now = round(age * (len(truth) - 1))
        row = {"truth": Picture(truth[now])}
        for name, each in pictures.items():
            k = now if name == "ode" else nearest_in_mean(each, truth[now])
            row[name] = Picture(each[k], k / (len(each) - 1), seconds.get(name))
        if "same_scan" in names:
            row["same_scan"] = Picture(learned[now])
        shown[f"{age:g}"] = row
    return shown


def costs_of(data: Path, aging: Aging, sizes: tuple[int, ...]) -> dict[str, dict[str, float]]:
    """By method: seconds of a core to learn the film, seconds for one of nine pictures of as many
    texels a side as each of `sizes`, and the bytes of what was learned.
    """
    kind, lapse = LAPSES[_NAME], read_lapse(data, _NAME)
    learned = learned_half(lapse, kind, aging)
    start = halves_of(lapse.kd)[kind.met][0]
    flow = ode.load_flow(FROM_NOISE)

    def ours(side: int) -> None:
        times = [-(-side // length) for length in start.shape[:2]]
        tiled = np.tile(start, (*times, 1))[:side, :side]
        maps = {"base_color": tiled, "metallic": np.ones_like(tiled[..., 0])}
        aged_pictures(maps, learned.path, _PICTURES)

    def from_noise(side: int) -> None:
        times = np.linspace(0, 1, _PICTURES, dtype=np.float32)
        ode.play(flow, (side, side), times)

    def costs(
        name: str, play: Callable[[int], None], model: Path, seconds: float, made_from: str
    ) -> dict[str, float]:
        def make() -> list[float]:
            return [_spent(play, side) / _PICTURES for side in sizes]

        path, told = aging.folder / f"costs_{name}.json", identity(made_from, code(), str(sizes))
        played = kept_json(path, told, make)
        found = {"learn": seconds, "bytes": float(model.stat().st_size)}
        return found | {f"picture_{side}": each for side, each in zip(sizes, played, strict=True)}

    with safe_open(FROM_NOISE, framework="np") as stored:
        trained = json.loads(stored.metadata()["record"])["seconds"]
    bulk = str(sum(each.numel() for each in flow.parameters()))  # what they are does not matter
    return {
        "ours": costs("ours", ours, learned.path, learned.seconds, str(hash_file(learned.path))),
        "ode": costs("ode", from_noise, FROM_NOISE, trained, bulk),
    }


def _spent(play: Callable[[int], None], side: int) -> float:
    begun = time.process_time()
    play(side)
    return time.process_time() - begun
