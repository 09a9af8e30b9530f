"""What `--quality exact` makes of a few texels of a material: what the others are held against."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from model_runtime.age import AgeRequest
from model_runtime.brdf import principled
from model_runtime.contract import AUTO, FORMATS, LIVE, PRINCIPLED, REPORT
from model_runtime.images import read_image
from model_runtime.live.evaluate import LiveMaps
from model_runtime.live.files import read_live
from model_runtime.maps import PrincipledMaps
from model_runtime.model_files.weights import find_model
from model_runtime.modelling.aged import EFFORTS, Change, model_texels
from model_runtime.modelling.palette import appearance_psnr, build_palette
from model_runtime.modelling.residues import lay
from model_runtime.modelling.start import wear_of
from model_runtime.modelling.texels import initial_states, timing_maps
from model_runtime.output.frames import maps_of
from model_runtime.reading.inputs import read_input
from model_runtime.representation import load_representation
from model_runtime.resampling import between
from model_runtime.states import rows_of
from model_runtime.temporal.ntm import NeuralTemporalModel

from ..bench.kept import code, identity, kept

__all__ = ("Exact", "compared", "exact_texels", "interpolated")

_COMPARED = 9


def compared(frames: int) -> list[int]:
    """The frames, counted from 0, in which a run is held against exact: evenly spaced, without the
    first, which is the input.
    """
    return sorted({round(k * (frames - 1) / _COMPARED) for k in range(1, _COMPARED + 1)} - {0})


@dataclass(frozen=True)
class Exact:
    """n texels of a material of `size`, modeled each for itself with all samples.

    rows: [n] which texels, in row order
    states: [t, n, C] at `times` [t], 0 to 1, as the written maps would hold them
    rung: the model of change
    seconds: of one core that modeling one of them took; equal ones are modeled once
    distinct: how many states the whole map has
    authored: their own sockets, as an image one texel wide
    """

    rows: Tensor
    states: Tensor
    times: tuple[float, ...]
    size: tuple[int, int]
    rung: str
    seconds: float
    distinct: int
    authored: PrincipledMaps

    def psnr(self, folder: Path) -> list[float]:
        """PSNR in dB of the maps that `age` wrote to `folder`, at each of `times`.

        Its maps may be smaller (they are then interpolated, as a renderer would), its frames fewer
        (one fades into the next, as in Blender) or made of others. A live material starts as
        authored.
        """
        report = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        if report["binding"] == LIVE:
            return self._live_psnr(read_live(folder))
        found = []
        for time_, truth in zip(self.times, self.states, strict=True):
            place = round(time_ * (report["frames"] - 1), 6)
            frame = int(place)
            shares = ((frame, frame + 1 - place), (frame + 1, place - frame))
            maps = {
                name: np.sum(
                    [
                        np.float32(share) * self._texels(folder, files[k], name == "base_color")
                        for k, share in shares
                        if share > 0
                    ],
                    axis=0,
                )
                for name, files in report["files"].items()
                if name in FORMATS[PRINCIPLED]  # nothing is seen of heights here
            }
            found.append(appearance_psnr(truth, _states(maps, self.authored)))
        return found

    def _live_psnr(self, live: LiveMaps) -> list[float]:
        rows = self.rows.numpy()
        timing = (
            None if live.timing is None else interpolated(live.timing, self.size, rows)[:, None]
        )
        coefficients = interpolated(live.coefficients, self.size, rows)[:, None]
        live = LiveMaps(live.curves, timing, coefficients)
        found = []
        for time_, truth in zip(self.times, self.states, strict=True):
            aged = live.aged(self.authored, time_)
            shown = principled.forward(principled.read_back(aged, self.authored))
            found.append(appearance_psnr(truth, rows_of(shown)))
        return found

    def _texels(self, folder: Path, made_of: str | list[Any], color: bool) -> np.ndarray:
        """[n, 1] or [n, 1, 3] of a map that is one file, or a sum of files with weights."""
        mix = [(made_of, 1.0)] if isinstance(made_of, str) else made_of
        total = 0.0
        for file, weight in mix:
            pixels = read_image(folder / file, color=color)
            total = total + np.float32(weight) * interpolated(pixels, self.size, self.rows.numpy())
        return np.asarray(total, np.float32)[:, None]


def exact_texels(
    material: Path,
    ntm_name: str,
    rung: str,
    *,
    size: int,
    frames: int,
    texels: int,
    folder: Path,
    seed: int = 0,
) -> Exact:
    """`texels` random ones of `material` (all, where it has fewer), aged by `rung` (or "auto") of
    the bundled model `ntm_name` with the onset that `age --size size` gives them. What was modeled
    stays in `folder`.
    """
    representation, encoder = load_representation()
    ntm_path = find_model(ntm_name)
    ntm = NeuralTemporalModel.load(ntm_path, encoder)
    request = AgeRequest(material, ntm_name, folder, size=size, seed=seed)
    read = read_input(material, size=size)
    assert isinstance(read, PrincipledMaps)
    initial, shape, _ = initial_states(read, request)
    course, worn = wear_of(ntm, initial, shape)
    if rung == AUTO:
        rung, _ = ntm.suited(initial if course is None else course.sound(initial))
    onset, rate = (
        None if each is None else torch.from_numpy(each.reshape(-1))
        for each in timing_maps(request, ntm, shape, worn)
    )
    residues = lay(ntm, request, shape, atlas=None, course=course, initial=initial).residues
    rng = np.random.default_rng(seed)
    rows = np.sort(rng.choice(len(initial), min(texels, len(initial)), replace=False))
    chosen = torch.from_numpy(rows)
    authored = read.map(lambda pixels: pixels.reshape(len(initial), 1, *pixels.shape[2:])[rows])
    times = tuple(k / (frames - 1) for k in compared(frames))

    path = folder / f"exact_{size}_{material.name}_{rung}.safetensors"
    model = identity(code(), *ntm.tensors().values())
    made_from = identity(
        initial[chosen], encoder, model, f"{rung} {times} {seed} {size} {worn is not None} a texel"
    )

    def make() -> dict[str, Tensor]:
        start = time.process_time()
        aged = model_texels(
            initial[chosen],
            Change(ntm, rung, representation, course=course),
            EFFORTS["exact"],
            onset=None if onset is None else onset[chosen],
            rate=None if rate is None else rate[chosen],
            residues=None if residues is None else residues.select(chosen),
        )
        seconds = time.process_time() - start
        maps = maps_of(aged, authored, (len(rows), 1), PRINCIPLED, times)
        states = torch.stack([_states(maps.at(moment), authored) for moment in times])
        each = seconds / len(aged.palette.entries)
        return {"states": states, "seconds": torch.tensor(each)}

    found = kept(path, made_from, make)
    seconds, distinct = float(found["seconds"]), len(build_palette(initial, 0, most=0).entries)
    return Exact(chosen, found["states"], times, shape, rung, seconds, distinct, authored)


def _states(maps: Mapping[str, np.ndarray], authored: PrincipledMaps) -> Tensor:
    """States [n, C] of the sockets that aging writes, the others as authored."""
    written = {name: np.asarray(maps[name], np.float32) for name in FORMATS[PRINCIPLED]}
    seen = principled.forward(
        PrincipledMaps(**written, ior=authored.ior, specular_tint=authored.specular_tint)
    )
    return rows_of(seen)


def interpolated(pixels: np.ndarray, size: Sequence[int], rows: np.ndarray) -> np.ndarray:
    """The values [n, ...] of a map [h, w, ...] at the texels `rows` of a map of `size`: linear
    between texel centers, as all of `resize` would be.
    """
    row, column = np.divmod(rows, size[1])
    (top, bottom), down = (each[:, row] for each in between(pixels.shape[0], size[0]))
    (left, further), right = (each[:, column] for each in between(pixels.shape[1], size[1]))
    shares = (down[:, None] * right).astype(np.float32)
    corners = np.stack([pixels[y, x] for y in (top, bottom) for x in (left, further)])
    return np.einsum("kn,kn...->n...", shares.reshape(4, -1), corners)
