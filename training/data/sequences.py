"""Sequences: how a material looked over time, read from a folder.

Three kinds of folder hold one, and are told apart by what is in them:

- *frames*: `kd_0001.exr ks_0001.exr alpha_0001.exr ...`, Torrance-Sparrow maps at uniform times
  (or at the `times` of a `sequence.json`), with an optional `onset.exr` and, in the json, `timing`;
- *polynomials*: `Diffuse-0.exr .. Diffuse-3.exr`, `Specular-*`, `Roughness-*`, coefficients of
  p(t) = c0 + c1 t + c2 t^2 + c3 t^3 per texel (the STAF database's form);
- *mixtures*: `mixture.json`, `{"materials": [first, second]}`, naming two measured BRDFs, and
  `w_0001.exr ...`, the share of the second: f(t) = (1 - w(t)) f_first + w(t) f_second.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from model_runtime.errors import InputError
from model_runtime.images import read_image
from model_runtime.timing import Timing

__all__ = ("ALPHA_RANGE", "Crop", "MixtureSequence", "Sequence", "read_sequence", "uniform_times")

Array = NDArray[np.float32]
Crop = tuple[slice, slice]

ALPHA_RANGE = (1e-4, 1.0)
"""alpha outside it cannot be rendered; Kd and Ks must be at least 0 (DESIGN.md, conventions)."""

_MAPS = ("kd", "ks", "alpha")
_POLYNOMIALS = {"kd": "Diffuse", "ks": "Specular", "alpha": "Roughness"}


@dataclass(frozen=True)
class Sequence:
    """Torrance-Sparrow maps over time.

    `kd`, `ks` [T, H, W, 3] linear Rec.709; `alpha` [T, H, W], the GGX alpha (not squared);
    `times` [T], 0 to 1, rising; `onset` [H, W], the time at which each texel's history starts, or
    None where the sequence does not separate the two. `timing` says what an onset pattern like it
    needs to know, where the sequence brings that with it: one whose texels were started early, so
    that their histories are seen to the end, does not show it. `warnings` are sentences about what
    cannot be learned from it for sure (`training.steadiness`). Arrays are float32.
    """

    kd: Array
    ks: Array
    alpha: Array
    times: Array
    onset: Array | None
    name: str
    timing: Timing | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        frames, height, width = self.alpha.shape
        assert self.kd.shape == self.ks.shape == (frames, height, width, 3), self.kd.shape
        assert self.times.shape == (frames,), self.times.shape
        assert self.onset is None or self.onset.shape == (height, width), self.onset.shape

    def out_of_range(self) -> NDArray[np.bool_]:
        """Texels and frames that must be clamped to be rendered; fits leave them out: [T, H, W]."""
        low, high = ALPHA_RANGE
        dark = (self.kd < 0).any(-1) | (self.ks < 0).any(-1)
        return dark | (self.alpha < low) | (self.alpha > high)

    def clamped(self) -> Sequence:
        """The sequence as it can be rendered: Kd, Ks >= 0 and alpha within `ALPHA_RANGE`."""
        return replace(
            self,
            kd=np.maximum(self.kd, 0),
            ks=np.maximum(self.ks, 0),
            alpha=np.clip(self.alpha, *ALPHA_RANGE),
        )


@dataclass(frozen=True)
class MixtureSequence:
    """Two measured BRDFs, mixed by weights over time: f = (1 - w) f_first + w f_second.

    `materials` names the two; `weights` [T, H, W] is the share of the second; `times` [T].
    """

    materials: tuple[str, str]
    weights: Array
    times: Array
    name: str


def uniform_times(frames: int) -> Array:
    """Times of equally spaced frames, 0 to 1: [frames]."""
    return np.linspace(0.0, 1.0, frames, dtype=np.float32)


def read_sequence(
    folder: Path, *, frames: int = 36, crop: Crop | None = None, clamp: bool = True
) -> Sequence | MixtureSequence:
    """The sequence a folder holds.

    `frames` is the number of uniform times at which polynomials are evaluated; stored frames are
    taken as they are. `crop` keeps (rows, columns) of every map. Unless `clamp` is False, values
    that a fit has carried out of range are clamped (see `Sequence.out_of_range`).

    Raises `InputError` for a folder that holds no sequence, a missing frame or map, maps of
    different sizes, values that are not numbers, or fewer than two frames.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(
            f"There is no folder {folder}.", "Name a folder that holds a sequence of maps."
        )
    if (folder / "mixture.json").exists():
        return _read_mixture(folder, crop)
    if any(folder.glob("kd_*.exr")):
        sequence = _read_frames(folder, crop)
    elif any(folder.glob("Diffuse-*.exr")):
        sequence = _read_polynomials(folder, frames, crop)
    else:
        raise InputError(
            f"The folder {folder} holds no sequence.",
            "It needs kd_0001.exr, ks_0001.exr, alpha_0001.exr, ...; or Diffuse-0.exr, ...; or"
            " mixture.json and w_0001.exr, ....",
        )
    return sequence.clamped() if clamp else sequence


def _read_frames(folder: Path, crop: Crop | None) -> Sequence:
    counts = {name: _frame_count(folder, name) for name in _MAPS}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{count} {name}" for name, count in counts.items())
        raise InputError(
            f"The maps in {folder} have different numbers of frames ({found}).",
            "Write kd, ks and alpha for every frame.",
        )
    frames = counts["alpha"]
    maps = {
        name: _stack([folder / f"{name}_{k:04d}.exr" for k in range(1, frames + 1)], crop)
        for name in _MAPS
    }
    onset_path = folder / "onset.exr"
    onset = _stack([onset_path], crop)[0, ..., 0] if onset_path.exists() else None
    return replace(_sequence(folder, maps, _times(folder, frames), onset), timing=_timing(folder))


def _read_polynomials(folder: Path, frames: int, crop: Crop | None) -> Sequence:
    if frames < 2:
        raise InputError(f"A sequence cannot have {frames} frames.", "Ask for at least 2.")
    times = uniform_times(frames)
    powers = times[:, None] ** np.arange(4, dtype=np.float32)  # [T, 4]
    maps = {}
    for name, prefix in _POLYNOMIALS.items():
        coefficients = _stack([folder / f"{prefix}-{k}.exr" for k in range(4)], crop)
        maps[name] = np.einsum("tk,khwc->thwc", powers, coefficients)
    return _sequence(folder, maps, times, None)


def _read_mixture(folder: Path, crop: Crop | None) -> MixtureSequence:
    path = folder / "mixture.json"
    try:
        materials = json.loads(path.read_text(encoding="utf-8"))["materials"]
        first, second = (str(name) for name in materials)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} does not name two materials.",
            'It should read {"materials": ["first", "second"]}.',
        ) from error
    frames = _frame_count(folder, "w")
    weights = _stack([folder / f"w_{k:04d}.exr" for k in range(1, frames + 1)], crop)[..., 0]
    if weights.min() < 0 or weights.max() > 1:
        raise InputError(f"Weights in {folder} leave 0 to 1.", "Scale them into that range.")
    return MixtureSequence((first, second), weights, _times(folder, frames), folder.name)


def _sequence(folder: Path, maps: dict[str, Array], times: Array, onset: Array | None) -> Sequence:
    alpha = maps["alpha"][..., 0]
    sizes = {name: stack.shape[1:3] for name, stack in maps.items()}
    sizes |= {"onset": onset.shape} if onset is not None else {}
    if len(set(sizes.values())) > 1:
        found = ", ".join(f"{name} {w} x {h}" for name, (h, w) in sizes.items())
        raise InputError(
            f"The maps in {folder} differ in size ({found}).", "Bring them to one size."
        )
    return Sequence(maps["kd"], maps["ks"], alpha, times, onset, folder.name)


def _frame_count(folder: Path, name: str) -> int:
    """Number of files `name_0001.exr` .. without a gap, at least two."""
    pattern = re.compile(re.escape(name) + r"_(\d{4,})\.exr")
    found = {int(m[1]) for path in folder.iterdir() if (m := pattern.fullmatch(path.name))}
    missing = set(range(1, max(found, default=1) + 1)) - found
    if missing:
        raise InputError(
            f"The sequence in {folder} lacks {name}_{min(missing):04d}.exr.",
            "Number the frames from 0001 without gaps.",
        )
    if len(found) < 2:
        raise InputError(
            f"The sequence in {folder} has only one frame.", "It needs at least two to show change."
        )
    return len(found)


def _times(folder: Path, frames: int) -> Array:
    """The `times` of `sequence.json`, or uniform ones where there is none."""
    path = folder / "sequence.json"
    if not path.exists():
        return uniform_times(frames)
    try:
        times = np.asarray(json.loads(path.read_text(encoding="utf-8"))["times"], np.float32)
        good = times.shape == (frames,) and times[0] >= 0 and times[-1] <= 1
        good = good and bool((np.diff(times) > 0).all())
    except (ValueError, KeyError, TypeError):
        good = False
    if not good:
        raise InputError(
            f"{path} does not give a rising time between 0 and 1 for each of {frames} frames.",
            'It should read {"times": [0, ..., 1]}, or be absent for equally spaced frames.',
        )
    return times


def _timing(folder: Path) -> Timing | None:
    """The `timing` of `sequence.json`; None where there is none."""
    path = folder / "sequence.json"
    if not path.exists():
        return None
    try:
        described = json.loads(path.read_text(encoding="utf-8"))
        return Timing.from_json(described["timing"]) if "timing" in described else None
    except (ValueError, TypeError) as error:
        raise InputError(
            f"{path} describes no timing ({error}).",
            "Leave its timing out, and it is measured from onset.exr or from the frames.",
        ) from error


def _stack(paths: list[Path], crop: Crop | None) -> Array:
    """Images of one size as float32 [N, H, W, 3]."""
    images: list[Array] = []
    for path in paths:
        if not path.exists():
            raise InputError(f"The sequence in {path.parent} lacks {path.name}.", "Add the file.")
        image = read_image(path, color=True)
        if images and image.shape != images[0].shape:
            raise InputError(
                f"{path.name} differs in size from {paths[0].name} in {path.parent}.",
                "Bring all maps to one size.",
            )
        if not np.isfinite(image).all():
            raise InputError(
                f"{path} holds values that are not numbers.", "Write the map again without them."
            )
        images.append(image)
    stack = np.stack(images)
    if crop is not None:
        stack = stack[:, crop[0], crop[1]]
    if stack.size == 0:
        raise InputError(
            f"Nothing of {paths[0]} is left inside the crop.", "Choose a crop inside the maps."
        )
    return stack
