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
from model_runtime.errors import InputError, reason, shown
from model_runtime.images import read_image
from model_runtime.maps import HALF_MAX
from model_runtime.model_files.card import MOST_AGES, strict_json
from model_runtime.temporal.pace import Timing

__all__ = (
    "MOST_TEXELS",
    "Crop",
    "MixtureSequence",
    "Sequence",
    "read_sequence",
    "uniform_times",
)

Array = NDArray[np.float32]
Crop = tuple[slice, slice]

MOST_TEXELS = 1 << 28
"""Of a map in all frames: 36 of 2,730 x 2,730, which take 3 GB."""

_LARGEST_JSON = 1 << 20
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
    folder: Path, *, frames: int = 36, crop: Crop | None = None, clamp: bool = True
) -> Sequence | MixtureSequence:
    """The sequence a folder holds.

    `frames` is the number of uniform times at which polynomials are evaluated; stored frames are
    taken as they are. `crop` keeps (rows, columns) of every map. Unless `clamp` is False, values
    that a fit has carried out of range are clamped (see `Sequence.out_of_range`).

    Raises `InputError` for a folder that holds no sequence, a missing frame or map, maps of
    different sizes, values that are not numbers or beyond those of half floats, fewer than two
    frames or more than 1,000, or more texels than memory is likely to hold.
    """
    source = _Folder.of(Path(folder))
    if "mixture.json" in source.names:
        return _read_mixture(source, crop)
    if any(re.fullmatch(r"kd_.*\.exr", name) for name in source.names):
        sequence = _read_frames(source, crop)
    elif any(re.fullmatch(r"Diffuse-.*\.exr", name) for name in source.names):
        sequence = _read_polynomials(source, frames, crop)
    else:
        raise InputError(
            f"The folder {source} holds no sequence.",
            "It needs kd_0001.exr, ks_0001.exr, alpha_0001.exr, ...; or Diffuse-0.exr, ...; or"
            " mixture.json and w_0001.exr, ....",
        )
    return sequence.clamped() if clamp else sequence


@dataclass(frozen=True)
class _Folder:
    """A folder and the names in it, looked up once; as text, its path for a sentence."""

    path: Path
    names: frozenset[str]

    @classmethod
    def of(cls, path: Path) -> _Folder:
        try:
            return cls(path, frozenset(entry.name for entry in path.iterdir()))
        except (FileNotFoundError, NotADirectoryError) as error:
            raise InputError(
                f"There is no folder {shown(path)}.", "Name a folder that holds a sequence of maps."
            ) from error
        except (OSError, ValueError) as error:  # ValueError: no path at all
            raise InputError(
                f"The folder {shown(path)} cannot be read: {reason(error)}.", "Check the path."
            ) from error

    def __str__(self) -> str:
        return shown(self.path)

    def json(self, name: str) -> Any:
        """What the file `name` holds. Raises ValueError or OSError for what is no small JSON."""
        path = self.path / name
        if not path.is_file() or path.stat().st_size > _LARGEST_JSON:
            raise ValueError("it is no file of this kind")
        return strict_json(path.read_bytes())


_NOT_JSON = (OSError, ValueError, KeyError, TypeError, RecursionError)


def _read_frames(folder: _Folder, crop: Crop | None) -> Sequence:
    counts = {name: _frame_count(folder, name) for name in _MAPS}
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{count} {name}" for name, count in counts.items())
        raise InputError(
            f"The maps in {folder} have different numbers of frames ({found}).",
            "Write kd, ks and alpha for every frame.",
        )
    frames = counts["alpha"]
    maps = {name: _stack(folder, _numbered(name, frames), frames, crop) for name in _MAPS}
    given = "onset.exr" in folder.names
    onset = _stack(folder, ["onset.exr"], 1, crop)[0, ..., 0] if given else None
    sequence = _sequence(folder, maps, _times(folder, frames), onset)
    raised = "height_0001.exr" in folder.names
    height = _stack(folder, _numbered("height", frames), frames, crop) if raised else None
    return replace(
        sequence,
        timing=_timing(folder),
        height=None if height is None else height[..., 0],
        **_grain(folder, frames),
    )


def _read_polynomials(folder: _Folder, frames: int, crop: Crop | None) -> Sequence:
    if not 2 <= frames <= MOST_AGES:
        raise InputError(f"A sequence cannot have {frames} frames.", f"Ask for 2 to {MOST_AGES:,}.")
    times = uniform_times(frames)
    powers = times[:, None] ** np.arange(4, dtype=np.float32)  # [T, 4]
    maps = {}
    for name, prefix in _POLYNOMIALS.items():
        files = [f"{prefix}-{k}.exr" for k in range(4)]
        maps[name] = np.einsum("tk,khwc->thwc", powers, _stack(folder, files, frames, crop))
    return _sequence(folder, maps, times, None)


def _read_mixture(folder: _Folder, crop: Crop | None) -> MixtureSequence:
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
    frames = _frame_count(folder, "w")
    weights = _stack(folder, _numbered("w", frames), frames, crop)[..., 0]
    if weights.min() < 0 or weights.max() > 1:
        raise InputError(f"Weights in {folder} leave 0 to 1.", "Scale them into that range.")
    return MixtureSequence((first, second), weights, _times(folder, frames), folder.path.name)


def _sequence(
    folder: _Folder, maps: dict[str, Array], times: Array, onset: Array | None
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


def _frame_count(folder: _Folder, name: str) -> int:
    """Number of files `name_0001.exr` .. without a gap, from two to 1,000."""
    pattern = re.compile(re.escape(name) + r"_([0-9]{4,})\.exr")
    found = {int(m[1]) for file in folder.names if (m := pattern.fullmatch(file))}
    # Not up to the highest number, which may be anything.
    missing = next(k for k in range(1, len(found) + 2) if k not in found)
    if missing <= len(found) or not found:
        raise InputError(
            f"The sequence in {folder} lacks {name}_{missing:04d}.exr.",
            "Number the frames from 0001 without gaps.",
        )
    if len(found) < 2:
        raise InputError(
            f"The sequence in {folder} has only one frame.", "It needs at least two to show change."
        )
    if len(found) > MOST_AGES:
        raise InputError(
            f"The sequence in {folder} has {len(found):,} frames.",
            f"Leave out all but {MOST_AGES:,}.",
        )
    return len(found)


def _numbered(name: str, frames: int) -> list[str]:
    return [f"{name}_{k:04d}.exr" for k in range(1, frames + 1)]


def _times(folder: _Folder, frames: int) -> Array:
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


def _timing(folder: _Folder) -> Timing | None:
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


def _grain(folder: _Folder, frames: int) -> dict[str, Any]:
    """The fields of a sequence that tell of its grain, and its sources."""
    described = folder.json("sequence.json") if "sequence.json" in folder.names else {}
    found: dict[str, Any] = {"sources": tuple(described.get("sources", ()))}
    names = [f"grain_{name}.exr" for name in _RESIDUES]
    if names[0] not in folder.names:
        return found
    kd, ks, rough, height = (_stack(folder, [name], 1, None)[0] for name in names)
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


def _stack(folder: _Folder, files: list[str], frames: int, crop: Crop | None) -> Array:
    """Images of one size as float32 [N, H, W, 3], from which `frames` frames are made."""
    images: list[Array] = []
    for file in files:
        if file not in folder.names:
            raise InputError(f"The sequence in {folder} lacks {file}.", "Add the file.")
        image = read_image(folder.path / file, color=True)
        if images and image.shape != images[0].shape:
            raise InputError(
                f"{file} differs in size from {files[0]} in {folder}.",
                "Bring all maps to one size.",
            )
        height, width, _ = image.shape
        if frames * height * width > MOST_TEXELS:
            raise InputError(
                f"The sequence in {folder} has {frames} frames of {width} x {height} texels.",
                "Make them smaller, or leave some out: a model learns from 8,192 texels.",
            )
        if not bool((np.abs(image) <= HALF_MAX).all()):  # nor NaN
            raise InputError(
                f"{shown(folder.path / file)} holds values that are not numbers, "
                f"or beyond {HALF_MAX:,.0f}.",
                "Write the map again without them.",
            )
        images.append(image)
    stack = np.stack(images)
    if crop is not None:
        stack = stack[:, crop[0], crop[1]]
    if stack.size == 0:
        raise InputError(
            f"Nothing of {files[0]} in {folder} is left inside the crop.",
            "Choose a crop inside the maps.",
        )
    return stack
