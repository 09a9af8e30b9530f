"""Sequences: how a material looked over time, read from a folder.

Three kinds of folder hold one, and are told apart by what is in them:

- *frames*: `kd_0001.exr ks_0001.exr alpha_0001.exr ...`, Torrance-Sparrow maps at uniform times
  (or at the `times` of a `sequence.json`), with an optional `onset.exr` and, in the json, `timing`;
  also `height_0001.exr ...`, and `grain_kd.exr grain_ks.exr grain_alpha.exr grain_height.exr`, the
  residues of fully weathered texels (that of alpha is of its square root);
- *polynomials*: `Diffuse-0.exr .. Diffuse-3.exr`, `Specular-*`, `Roughness-*`, coefficients of
  p(t) = c0 + c1 t + c2 t^2 + c3 t^3 per texel (the STAF database's form);
- *mixtures*: `mixture.json`, `{"materials": [first, second]}`, naming two measured BRDFs, and
  `w_0001.exr ...`, the share of the second: f(t) = (1 - w(t)) f_first + w(t) f_second.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model_runtime.channels import CHANNELS, optics
from model_runtime.errors import InputError, reason
from model_runtime.model_files.card import MOST_AGES
from model_runtime.temporal.pace import Timing

from .folder import Array, Crop, Folder, Kept, Sample, frame_count, numbered, part_of, stack

__all__ = ("MixtureSequence", "Sequence", "read_sequence", "uniform_times")

_MAPS = ("kd", "ks", "alpha")
_RESIDUES = ("kd", "ks", "alpha", "height")
_POLYNOMIALS = {"kd": "Diffuse", "ks": "Specular", "alpha": "Roughness"}


@dataclass(frozen=True)
class Sequence:
    """Torrance-Sparrow maps over time.

    `kd`, `ks` [T, H, W, 3] linear Rec.709; `alpha` [T, H, W], the GGX alpha (not squared);
    `times` [T], 0 to 1, rising; `onset` [H, W], the time at which each texel's history starts, or
    None where the sequence does not separate the two. `timing` says what an onset pattern like it
    needs to know, where the sequence brings that with it: one whose texels were started early, so
    that their histories are seen to the end, does not show it. `warnings` are sentences about what
    cannot be learned from it for sure (`training.source.steadiness`). Arrays are float32.

    height: [T, H, W] relief, 0 in the first frame, in sides of the residue's tile (or of the map,
        where there is no residue); None where nothing is known of it
    residue: [S, S, 8] what fully weathered texels have beyond their mean, in kd, ks, r =
        sqrt(alpha) and height, as a tile that wraps and covers `share` of a material's side
    strength: [T] how much of it shows at each age, 0 at first; None: as much as is lost of what
        texels began with
    sources: works of others that it was made from: name, license, credit
    """

    kd: Array
    ks: Array
    alpha: Array
    times: Array
    onset: Array | None
    name: str
    timing: Timing | None = None
    warnings: tuple[str, ...] = ()
    height: Array | None = None
    residue: Array | None = None
    strength: Array | None = None
    share: float = 1.0
    sources: tuple[Mapping[str, str], ...] = ()

    def __post_init__(self) -> None:
        frames, height, width = self.alpha.shape
        assert self.height is None or self.height.shape == self.alpha.shape, self.height.shape
        assert self.kd.shape == self.ks.shape == (frames, height, width, 3), self.kd.shape
        assert self.times.shape == (frames,), self.times.shape
        assert self.onset is None or self.onset.shape == (height, width), self.onset.shape

    def out_of_range(self) -> NDArray[np.bool_]:
        """Texels and frames that must be clamped to be rendered; fits leave them out: [T, H, W]."""
        dark = (self.kd < CHANNELS["kd"].least).any(-1) | (self.ks < CHANNELS["ks"].least).any(-1)
        _, low, high = CHANNELS["alpha"]
        return dark | (self.alpha < low) | (self.alpha > high)

    def clamped(self) -> Sequence:
        """The sequence as it can be rendered: every channel in its range (`CHANNELS`)."""
        return replace(
            self,
            **{
                name: np.clip(getattr(self, name), least, most)
                for name, (_, least, most) in CHANNELS.items()
            },
        )

    def states(self) -> Array:
        """[T, H, W, C], the channels in their order."""
        return np.concatenate((self.kd, self.ks, self.alpha[..., None]), -1)

    @classmethod
    def of(cls, states: Array, times: Array, name: str) -> Sequence:
        """Of `states` [T, H, W, C] at `times` [T]."""
        return cls(*optics(states), times, None, name)


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
    folder: Path,
    *,
    frames: int = 36,
    crop: Crop | None = None,
    sample: Sample | None = None,
    clamp: bool = True,
) -> Sequence | MixtureSequence:
    """The sequence a folder holds.

    `frames` is the number of uniform times at which polynomials are evaluated; stored frames are
    taken as they are. `crop` keeps (rows, columns) of every map; with a `sample` no more than those
    texels of a map are ever held, in maps of one column. Unless `clamp` is False, values
    that a fit has carried out of range are clamped (see `Sequence.out_of_range`).

    Raises `InputError` for a folder that holds no sequence, a missing frame or map, maps of
    different sizes, values that are not numbers or beyond those of half floats, fewer than two
    frames or more than 1,000, or more texels than memory is likely to hold.
    """
    source = Folder.of(Path(folder))
    kept = sample or part_of(crop)
    if "mixture.json" in source.names:
        return _read_mixture(source, kept)
    if any(re.fullmatch(r"kd_.*\.exr", name) for name in source.names):
        sequence = _read_frames(source, kept)
    elif any(re.fullmatch(r"Diffuse-.*\.exr", name) for name in source.names):
        sequence = _read_polynomials(source, frames, kept)
    else:
        raise InputError(
            f"The folder {source} holds no sequence.",
            "It needs kd_0001.exr, ks_0001.exr, alpha_0001.exr, ...; or Diffuse-0.exr, ...; or"
            " mixture.json and w_0001.exr, ....",
        )
    return sequence.clamped() if clamp else sequence


_NOT_JSON = (OSError, ValueError, KeyError, TypeError, RecursionError)


def _read_frames(folder: Folder, kept: Kept) -> Sequence:
    counts = {name: frame_count(folder, name) for name in _MAPS}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{count} {name}" for name, count in counts.items())
        raise InputError(
            f"The maps in {folder} have different numbers of frames ({found}).",
            "Write kd, ks and alpha for every frame.",
        )
    frames = counts["alpha"]
    maps = {name: stack(folder, numbered(name, frames), frames, kept) for name in _MAPS}
    given = "onset.exr" in folder.names
    onset = stack(folder, ["onset.exr"], 1, kept)[0, ..., 0] if given else None
    sequence = _sequence(folder, maps, _times(folder, frames), onset)
    raised = "height_0001.exr" in folder.names
    height = stack(folder, numbered("height", frames), frames, kept) if raised else None
    return replace(
        sequence,
        timing=_timing(folder),
        height=None if height is None else height[..., 0],
        **_grain(folder, frames),
    )


def _read_polynomials(folder: Folder, frames: int, kept: Kept) -> Sequence:
    if not 2 <= frames <= MOST_AGES:
        raise InputError(f"A sequence cannot have {frames} frames.", f"Ask for 2 to {MOST_AGES:,}.")
    times = uniform_times(frames)
    powers = times[:, None] ** np.arange(4, dtype=np.float32)  # [T, 4]
    maps = {}
    for name, prefix in _POLYNOMIALS.items():
        files = [f"{prefix}-{k}.exr" for k in range(4)]
        maps[name] = np.einsum("tk,khwc->thwc", powers, stack(folder, files, frames, kept))
    return _sequence(folder, maps, times, None)


def _read_mixture(folder: Folder, kept: Kept) -> MixtureSequence:
    try:
        materials = folder.json("mixture.json")["materials"]
        if not isinstance(materials, list) or not all(isinstance(name, str) for name in materials):
            raise TypeError("not names")
        first, second = materials
    except _NOT_JSON as error:
        raise InputError(
            f"The mixture.json of {folder} does not name two materials.",
            'It should read {"materials": ["first", "second"]}.',
        ) from error
    frames = frame_count(folder, "w")
    weights = stack(folder, numbered("w", frames), frames, kept)[..., 0]
    if weights.min() < 0 or weights.max() > 1:
        raise InputError(f"Weights in {folder} leave 0 to 1.", "Scale them into that range.")
    return MixtureSequence((first, second), weights, _times(folder, frames), folder.path.name)


def _sequence(
    folder: Folder, maps: dict[str, Array], times: Array, onset: Array | None
) -> Sequence:
    alpha = maps["alpha"][..., 0]
    sizes = {name: stack.shape[1:3] for name, stack in maps.items()}
    sizes |= {"onset": onset.shape} if onset is not None else {}
    if len(set(sizes.values())) > 1:
        found = ", ".join(f"{name} {w} x {h}" for name, (h, w) in sizes.items())
        raise InputError(
            f"The maps in {folder} differ in size ({found}).", "Bring them to one size."
        )
    return Sequence(maps["kd"], maps["ks"], alpha, times, onset, folder.path.name)


def _times(folder: Folder, frames: int) -> Array:
    """The `times` of `sequence.json`, or uniform ones where there is none."""
    if "sequence.json" not in folder.names:
        return uniform_times(frames)
    try:
        times = np.asarray(folder.json("sequence.json")["times"], np.float32)
        good = times.shape == (frames,) and times[0] >= 0 and times[-1] <= 1
        good = good and bool((np.diff(times) > 0).all())
    except _NOT_JSON:
        good = False
    if not good:
        raise InputError(
            f"The sequence.json of {folder} does not give a rising time between 0 and 1 for each "
            f"of {frames} frames.",
            'It should read {"times": [0, ..., 1]}, or be absent for equally spaced frames.',
        )
    return times


def _timing(folder: Folder) -> Timing | None:
    """The `timing` of `sequence.json`; None where there is none."""
    if "sequence.json" not in folder.names:
        return None
    try:
        described = folder.json("sequence.json")
        return Timing.from_json(described["timing"]) if "timing" in described else None
    except _NOT_JSON as error:
        raise InputError(
            f"The sequence.json of {folder} describes no timing ({reason(error)}).",
            "Leave its timing out, and it is measured from onset.exr or from the frames.",
        ) from error


def _grain(folder: Folder, frames: int) -> dict[str, Any]:
    """The fields of a sequence that tell of its grain, and its sources."""
    described = folder.json("sequence.json") if "sequence.json" in folder.names else {}
    found: dict[str, Any] = {"sources": tuple(described.get("sources", ()))}
    names = [f"grain_{name}.exr" for name in _RESIDUES]
    if names[0] not in folder.names:
        return found
    kd, ks, rough, height = (stack(folder, [name], 1, part_of(None))[0] for name in names)
    if len({each.shape for each in (kd, ks, rough, height)}) > 1 or len(kd) != kd.shape[1]:
        raise InputError(f"The grain in {folder} is no square.", "Write its maps in one size.")
    found["residue"] = np.concatenate((kd, ks, rough[..., :1], height[..., :1]), -1)
    try:
        grain = described["grain"]
        share = float(grain["share"])
        strength = np.asarray(grain["strength"], np.float32) if "strength" in grain else None
        if not 0 < share <= 1 or (strength is not None and strength.shape != (frames,)):
            raise ValueError("a share or strengths of other frames")
    except _NOT_JSON as error:
        raise InputError(
            f"The sequence.json of {folder} does not describe its grain ({reason(error)}).",
            'It should read "grain": {"share": 0.5}: how much of a material\'s side it covers.',
        ) from error
    return {**found, "share": share, "strength": strength}
