"""What a run starts from: the models, the material as it was read, and when each texel ages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..backend import Tensor
from ..brdf.measured import MeasuredBRDF
from ..contract import AUTO, FRAMES, PRINCIPLED, TORRANCE_SPARROW, Format
from ..errors import InputError
from ..maps import Pixels, PrincipledMaps
from ..model_files.weights import ENCODER, ESTIMATOR, find_model
from ..reading.inputs import Material, hash_file, hash_input, input_files, read_covered, read_input
from ..representation import load_representation
from ..representation.estimator import ParameterEstimator, load_estimator
from ..representation.latents import Representation
from ..run import Run
from ..surface.atlas import Atlas
from ..surface.exposure import Exposure
from ..surface.maps import read_light, read_mask, read_surface, surface_files
from ..temporal.ntm import NeuralTemporalModel
from ..temporal.wear import Course, course_of
from .measured import MeasuredFit
from .residues import Laid, lay
from .texels import Texels, exposure_of, grown_timing, initial_states, timing_maps

__all__ = ("Models", "Start", "read_start", "wear_of")

_LOOKED_AT = 1 << 16  # texels, evenly spaced, that tell whether there is wear at all
_LEAST_WEAR = 0.01  # share of them
_NO_SURFACE = (
    "Exposure, starts, mask, light, pattern size and amount say how aging grows over a surface, "
    "and count for nothing without one or where an onset is given."
)


@dataclass(frozen=True)
class Models:
    """The neural temporal model of a run, and what decodes its latents."""

    ntm: NeuralTemporalModel
    representation: Representation
    estimator: ParameterEstimator


@dataclass(frozen=True)
class Start:
    """What a run starts from.

    material: as it was read
    size: height and width of the maps to write; a uniform material has that of its onset
    texels: of the whole image; `covered` [H, W] are those that a face shows, None: all are
    format: what to write, unless it cannot hold what the texels become
    may_be_live: whether a live material may stand for all frames
    fit: of a measured material
    hashes: of the files that were read, as `aged.json` has them
    apart: onset and rate [H, W] of a layout of their own, where `texels` all begin at once
    course: of what has begun already, where anything has
    laid: what texels show beyond their histories
    grown: what `aged.json` says of wear that was there and of the surface that the aging grew on
    """

    models: Models
    material: Material
    size: tuple[int, int]
    texels: Texels
    covered: NDArray[np.bool_] | None
    format: Format
    may_be_live: bool
    fit: MeasuredFit | None
    hashes: dict[str, Any]
    apart: tuple[Pixels, Pixels] | None
    course: Course | None
    laid: Laid
    grown: dict[str, Any]

    @property
    def counted(self) -> Texels:
        """The texels that are modeled."""
        return self.texels if self.covered is None else self.texels.where(self.covered)


def read_start(run: Run) -> Start:
    """Read what `run` asks for; raises a kind of TvbrdfError where that cannot be done."""
    request = run.request
    with run.timed("read"):
        models, hashes = _read_models(run)
        with _unchanged(*input_files(request.input).values()):
            material = read_input(request.input, size=request.size)
            hashes["input"] = hash_input(request.input)
            maps_size = (1, 1) if isinstance(material, MeasuredBRDF) else material.size
            covered = read_covered(request.input, maps_size)
        initial, size, fit = initial_states(material, request)
    with run.timed("onset"):
        exposure = exposure_of(request, models.ntm)
        atlas = _read_surface(run, models.ntm, hashes)
        marks = _read_mask(run, models.ntm, atlas, hashes)
        light = _read_light(run, models.ntm, atlas, hashes)
        course, worn = None, None
        if exposure.wear > 0 and not isinstance(material, MeasuredBRDF):
            course, worn = wear_of(models.ntm, initial, size)
        apart = None
        repeats = request.timing_apart and size != (1, 1)
        if repeats:
            onset, rate, grown = _timing(
                run, models.ntm, (1, 1), exposure, None, atlas, marks, light
            )
            if onset is not None and rate is not None:
                apart, onset, rate = (onset, rate), np.zeros(size, np.float32), None
        else:
            onset, rate, grown = _timing(run, models.ntm, size, exposure, worn, atlas, marks, light)
        if onset is not None and size == (1, 1):
            size = onset.shape[0], onset.shape[1]
            initial = initial.expand(size[0] * size[1], -1)
        laid = lay(
            models.ntm,
            request,
            size,
            atlas=None if repeats else atlas,
            course=course,
            initial=initial,
        )
    own = PRINCIPLED if isinstance(material, PrincipledMaps) else TORRANCE_SPARROW
    return Start(
        models,
        material,
        size,
        Texels.of(initial, onset, rate, laid.residues),
        covered,
        format=request.format or own,
        may_be_live=request.binding != FRAMES and size != (1, 1),
        fit=fit,
        hashes=hashes,
        apart=apart,
        course=course,
        laid=laid,
        grown=grown if worn is None else {"worn": round(float(worn.mean()), 4), **grown},
    )


def wear_of(
    ntm: NeuralTemporalModel, initial: Tensor, size: tuple[int, int]
) -> tuple[Course | None, NDArray[np.bool_] | None]:
    """The course of a process, and which texels [H, W] of a material are on it already; None where
    hardly any of those are that are looked at: a speck is no rust.
    """
    course = course_of(ntm)
    some = initial[:: max(1, len(initial) // _LOOKED_AT)]
    if (course.age_of(some) > 0).float().mean() < _LEAST_WEAR:
        return None, None
    course = course.widened_to(some)
    return course, (course.age_of(initial) > 0).numpy().reshape(size)


def _timing(
    run: Run,
    ntm: NeuralTemporalModel,
    size: tuple[int, int],
    exposure: Exposure,
    worn: NDArray[np.bool_] | None,
    atlas: Atlas | None,
    marks: Mapping[str, Pixels],
    light: Pixels | None,
) -> tuple[Pixels | None, Pixels | None, dict[str, Any]]:
    """When and how fast texels age, [H, W] each, and what `aged.json` says of their surface."""
    request = run.request
    if atlas is None or not _grows(run, ntm):
        asked = request.exposure, request.pattern_size, request.starts, request.mask, request.light
        if any(asked) or request.amount < 1:
            run.warn(_NO_SURFACE)
        return *timing_maps(request, ntm, size, worn), {}
    found = grown_timing(request, ntm, size, atlas, exposure, worn, marks, light)
    mask = {"mask": request.mask_means} if request.mask else {}
    account = {"seam_ratio": found.seam_ratio, "surface": found.account | mask}
    return found.onset, found.rate, account


def _grows(run: Run, ntm: NeuralTemporalModel) -> bool:
    """Whether it is for this program to say when texels start."""
    return run.request.onset == AUTO and not ntm.changes_at_once


def _read_surface(run: Run, ntm: NeuralTemporalModel, hashes: dict[str, Any]) -> Atlas | None:
    """The surface, where there is one that anything grows on or is laid on."""
    folder = run.request.surface or run.request.input
    needed = _grows(run, ntm)
    wanted = needed or ntm.grain is not None or ntm.height is not None
    files = surface_files(folder) if wanted and (run.request.surface or folder.is_dir()) else {}
    if not files and not (run.request.surface and needed):
        return None
    with _unchanged(*files.values()):
        atlas = read_surface(folder)
        hashes["surface"] = {file.name: hash_file(file) for file in files.values()}
    return atlas


def _read_mask(
    run: Run, ntm: NeuralTemporalModel, atlas: Atlas | None, hashes: dict[str, Any]
) -> Mapping[str, Pixels]:
    """What the artist's mask says of the surface, where anything grows on it."""
    mask = run.request.mask
    if mask is None or atlas is None or not _grows(run, ntm):
        return {}
    with _unchanged(mask):
        hashes["mask"] = hash_file(mask)
        return read_mask(mask, run.request.mask_means, atlas)


def _read_light(
    run: Run, ntm: NeuralTemporalModel, atlas: Atlas | None, hashes: dict[str, Any]
) -> Pixels | None:
    """The light that falls on the surface, where that is to say how fast it ages."""
    light = run.request.light
    if light is None or atlas is None or not _grows(run, ntm):
        return None
    with _unchanged(light):
        hashes["light"] = hash_file(light)
        return read_light(light)


def _read_models(run: Run) -> tuple[Models, dict[str, Any]]:
    """The models, and the hashes of their files."""
    path = find_model(run.request.ntm)
    with _unchanged(path, ENCODER, ESTIMATOR):
        representation, identity = load_representation()
        estimator = load_estimator(identity)
        ntm = NeuralTemporalModel.load(path, identity)
        hashes: dict[str, Any] = {
            "ntm": hash_file(path),
            "encoder": hash_file(ENCODER),
            "estimator": hash_file(ESTIMATOR),
        }
    for doubt in ntm.warnings:
        run.warn(f"Of what {ntm.card.title} was learned from: {doubt}")
    return Models(ntm, representation, estimator), hashes


@contextmanager
def _unchanged(*files: Path) -> Iterator[None]:
    """Raise InputError where one of `files` is replaced or changed within the block.

    What was read and what was hashed would be two things.
    """
    before = [_version(file) for file in files]
    yield
    for file, version in zip(files, before, strict=True):
        if _version(file) != version:
            raise InputError(f"{file} changed while it was read.", "Run it again.")


def _version(file: Path) -> tuple[int, ...] | None:
    """What differs between two versions of a file; None where there is none."""
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
